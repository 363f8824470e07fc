from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("matplotlib")

from docs.pictures.quarter import draw_quarter, preload_uncertainty, smallest_loss
from tests.report.axis_m import (
    AXIS,
    PLAN,
    assert_every_axis_has_its_unit,
    assert_nothing_leaves_the_picture,
    assert_the_same_file_twice,
    curves,
    texts,
)

from ballscrew.axis.frequency import axial_natural_frequency
from ballscrew.base.errors import InputError


def draw():
    return draw_quarter(AXIS, PLAN, left=0.75, uncertainties=(0.3, 0.9))


@pytest.mark.slow
def test_units_margins_and_the_same_file(tmp_path):
    figure = draw()
    assert_every_axis_has_its_unit(figure)
    assert_nothing_leaves_the_picture(figure)
    assert_the_same_file_twice(draw, tmp_path)


def test_the_loss_lowers_the_frequency_and_less_so_away_from_the_bearing():
    (x, free), (_, rotor_held) = curves(draw().axes[1])
    assert (x[0], x[-1]) == (0.0, 300.0)
    assert free[0] == pytest.approx(-3.0635, abs=1e-4)
    assert np.all(free < rotor_held)
    assert np.all(rotor_held < 0)
    for change in (free, rotor_held):
        assert np.all(np.diff(change) > 0)


def test_the_share_falls_along_the_axis():
    ((_, share),) = curves(draw().axes[2])
    assert share[0] == pytest.approx(34.44, abs=0.01)
    assert np.all(np.diff(share) < 0)


def test_more_cells_see_less():
    lines = curves(draw().axes[3])
    assert len(lines) == 2
    for _, loss in lines:
        assert np.all(np.diff(loss) < 0)
    ticks = [tick.get_text() for tick in draw().axes[3].get_xticklabels()]
    assert "12" in ticks, "the plan of this test has 12 cells"
    shown = texts(draw())
    for u, count in ((0.3, 1), (0.3, 12), (0.9, 1), (0.9, 12)):
        assert f"{100 * float(smallest_loss(AXIS, PLAN, u, count)):.2g} %" in shown


def test_one_cell_is_what_a_difference_of_two_frequencies_says():
    """A plan whose stops all but coincide: u(P)/P is u(f) over the slope, here by differences."""
    near = replace(PLAN, positions=(0.0, 1e-7))
    low, high = (float(axial_natural_frequency(AXIS, 0.0, 0.0, 680 * part)) for part in (0.999, 1.001))
    slope = (high - low) / np.log(1.001 / 0.999)
    assert preload_uncertainty(AXIS, near, 0.3, 1) == pytest.approx(0.3 / slope, rel=1e-5)
    assert preload_uncertainty(AXIS, near, 0.3, 1) == pytest.approx(0.0288, abs=1e-4)


def test_four_times_the_cells_halve_it_and_it_is_in_proportion():
    single, four = preload_uncertainty(AXIS, PLAN, 0.3, [1, 4])
    assert single == pytest.approx(2 * four)
    assert preload_uncertainty(AXIS, PLAN, 0.9, 1) == pytest.approx(3 * single)


def test_the_smallest_loss_never_reaches_all_of_the_preload():
    loss = smallest_loss(AXIS, PLAN, 1e6, 1), smallest_loss(AXIS, PLAN, 1e-9, 1)
    assert loss == (1.0, pytest.approx(0, abs=1e-8))
    small = float(smallest_loss(AXIS, PLAN, 0.001, 1))
    single = float(preload_uncertainty(AXIS, PLAN, 0.001, 1))
    assert small == pytest.approx(1.96 * np.sqrt(2) * single, rel=1e-3)


def test_a_loss_of_that_size_is_seen_at_95_percent_in_trials():
    rng = np.random.default_rng(1)
    near = replace(PLAN, positions=(0.0, 1e-7))
    loss = float(smallest_loss(AXIS, near, 0.3, 1))
    new, worn = (float(axial_natural_frequency(AXIS, 0.0, 0.0, 680 * part)) for part in (1.0, 1 - loss))
    assert (new - worn) / (0.3 * np.sqrt(2)) == pytest.approx(1.96, rel=0.02)
    alike = rng.normal(0, 0.3, 100_000) - rng.normal(0, 0.3, 100_000)
    assert np.mean(np.abs(alike) > new - worn) == pytest.approx(0.05, abs=0.006)


@pytest.mark.parametrize(("uncertainty", "count"), [(0.0, 1), (-0.3, 1), (np.nan, 1), (np.inf, 1), (0.3, 0)])
def test_what_cannot_be_is_refused(uncertainty, count):
    with pytest.raises(InputError, match="it must be more than 0"):
        smallest_loss(AXIS, PLAN, uncertainty, count)
