from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("matplotlib")

from docs.pictures.nut import draw_nut
from tests.report.axis_m import (
    AXIS,
    assert_every_axis_has_its_unit,
    assert_nothing_leaves_the_picture,
    assert_the_same_file_twice,
    curves,
    texts,
)


def draw():
    return draw_nut(AXIS, parts=(1.0, 0.5), furthest=8.0, heaviest=3000.0)


@pytest.mark.slow
def test_units_margins_and_the_same_file(tmp_path):
    figure = draw()
    assert_every_axis_has_its_unit(figure)
    assert_nothing_leaves_the_picture(figure)
    assert_the_same_file_twice(draw, tmp_path)


def test_two_flanks_add_up_to_the_force_which_rises_and_is_odd():
    near, far, both = (y for _, y in curves(draw().axes[0]))
    np.testing.assert_allclose(near + far, both, atol=1e-6)
    assert np.all(near >= 0)
    assert np.all(far <= 0)
    assert np.all(np.diff(both) > 0)
    np.testing.assert_allclose(both, -both[::-1], atol=1e-9)


def test_rigidity_falls_to_release_and_rises_beyond():
    _, ratio, _, reading = draw().axes
    for axes, least, first in ((ratio, np.sqrt(0.5), 1.0), (reading, 100 / np.sqrt(8), 100.0)):
        ((load, values),) = curves(axes)
        lowest = int(np.argmin(values))
        assert load[lowest] == pytest.approx(2 * np.sqrt(2))
        assert values[lowest] == pytest.approx(least)
        assert values[0] == values[-1] == pytest.approx(first)
        assert np.all(np.diff(values[: lowest + 1]) <= 0)
        assert np.all(np.diff(values[lowest:]) > 0)


def test_each_nut_ends_on_the_curve_of_one_flank():
    single, *nuts = curves(draw().axes[2])
    assert len(nuts) == 2
    assert np.all(np.diff(single[1]) > 0)
    for load, rigidity in nuts:
        assert np.interp(load[-1], *single) == pytest.approx(rigidity[-1], rel=1e-4)
    assert nuts[0][1][0] == pytest.approx(265.25, abs=0.01)


def test_the_limits_are_named():
    words = texts(draw())
    for part in ("2.83 P = 1923 N", "1.5 P: 0.965", "2.83 P: 0.707", "1.5 P: 90 %", "2.83 P: 35 %"):
        assert part in words
