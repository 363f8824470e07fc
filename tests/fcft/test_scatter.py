"""Expected scatter of runs that are not measured yet."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from ballscrew.base.errors import InputError
from ballscrew.fcft.scatter import FrequencyScatter, default_scatter, run_causes


@pytest.mark.parametrize(
    ("diameter", "change"), [(0.010, 0.15), (0.016, 0.15), (0.0205, 0.10), (0.025, 0.05), (0.040, 0.05)]
)
def test_two_runs_differ_by_what_was_measured(sheet, diameter, change):
    sheet = replace(sheet, screw=replace(sheet.screw, root_diameter=0.008, nominal_diameter=diameter))
    assert math.sqrt(2) * default_scatter(sheet).run == pytest.approx(change)


def test_repetitions_mend_only_what_is_noise():
    one = FrequencyScatter(cell=0.1, trip=0.3, run=0.05, lasting=0.1)
    assert one.own(1) == pytest.approx(math.hypot(0.1, 0.3))
    assert one.own(9) == pytest.approx(math.hypot(0.1, 0.1))
    assert one.own(10_000) == pytest.approx(0.1, rel=1e-3)


def test_fewer_than_ten_trips_scatter_more_and_more_than_ten_no_less():
    one = FrequencyScatter(cell=0.1, trip=0.3, run=0.05, lasting=0.1)
    assert [one.of_run(n) for n in (10, 30)] == [0.05, 0.05]
    assert one.of_run(3) == pytest.approx(0.05 * math.sqrt(10 / 3))


def test_a_run_has_a_level_and_a_tilt():
    level, tilt = run_causes(0.05, np.array([0.1, 0.3, 0.5]), 0.1, 0.5)
    np.testing.assert_allclose(level, 0.05)
    np.testing.assert_allclose(tilt, [-0.05, 0.0, 0.05], atol=1e-15)


@pytest.mark.parametrize("name", ["cell", "trip", "run", "lasting", "load"])
@pytest.mark.parametrize("value", [-1.0, math.nan, math.inf])
def test_a_scatter_that_cannot_be_is_refused(name, value):
    given = {"cell": 0.1, "trip": 0.1, "run": 0.1, "lasting": 0.1, "load": 0.001, name: value}
    with pytest.raises(InputError, match=name):
        FrequencyScatter(**given)


def test_a_cell_without_an_error_is_refused():
    with pytest.raises(InputError, match="error of its own"):
        FrequencyScatter(0.0, 0.1, 0.1, 0.1)
