from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ballscrew.modal.paper.peak import first_peak, highest_point

GRID = np.arange(100.0, 200.0, 0.5)


def bell(centre, height=1.0, width=4.0, grid=GRID):
    """A parabola of the logarithm: the three-point formula is exact for it."""
    return height * np.exp(-(((grid - centre) / width) ** 2))


@given(centre=st.floats(110, 190), width=st.floats(1.5, 10), height=st.floats(1e-6, 1e6))
def test_the_parabola_through_the_logarithms_is_exact(centre, width, height):
    peak = first_peak(GRID, bell(centre, height, width))
    assert peak.frequency == pytest.approx(centre, abs=1e-6)
    assert not peak.at_edge
    assert peak.height <= height * (1 + 1e-12)


def test_of_equals_the_first():
    peak = first_peak(GRID, bell(130.0) + bell(170.0))
    assert peak.frequency == pytest.approx(130.0, abs=0.01)


@pytest.mark.parametrize(("lower", "which"), [(0.5, 170.0), (0.75, 170.0), (0.85, 130.0), (1.5, 130.0)])
def test_a_rival_counts_from_four_fifths_on(lower, which):
    assert first_peak(GRID, bell(130.0, lower) + bell(170.0)).frequency == pytest.approx(which, abs=0.1)


def test_a_ripple_beside_the_peak_is_none():
    curve = bell(150.0, width=20.0) * (1 + 0.03 * np.cos(2 * np.pi * GRID / 5))
    assert first_peak(GRID, curve).frequency == pytest.approx(150.0, abs=1.0)


def test_a_curve_that_is_highest_at_the_edge_is_marked():
    slope = 3.0 * np.exp(-(GRID - 100.0) / 10)
    peak = first_peak(GRID, slope + bell(150.0, 1.0))
    assert peak.frequency == pytest.approx(150.0, abs=0.5)
    assert peak.at_edge
    assert not first_peak(GRID, 0.1 * slope + bell(150.0, 1.0)).at_edge


@pytest.mark.parametrize(("depth", "found"), [(0.35, False), (0.45, True)])
def test_a_peak_stands_four_tenths_above_the_saddles_beside_it(depth, found):
    assert (first_peak(GRID, 1 - depth + depth * bell(150.0)) is not None) is found


@pytest.mark.parametrize(
    "curve",
    [
        np.linspace(1, 2, len(GRID)),
        np.linspace(2, 1, len(GRID)),
        np.ones(len(GRID)),
        np.zeros(len(GRID)),
        1 - bell(150.0, 0.9),
        np.full(len(GRID), np.nan),
        np.where(GRID == 150.0, np.nan, bell(150.0)),
        np.where(GRID == 150.0, np.inf, bell(150.0)),
    ],
    ids=["rising", "falling", "level", "nought", "a dip", "NaN", "one NaN", "infinite"],
)
def test_there_is_none(curve):
    assert first_peak(GRID, curve) is None


def test_a_grid_of_few_lines_has_none():
    assert first_peak(GRID[:4], np.array([1.0, 3.0, 2.0, 1.0])) is None


def test_the_highest_point_near_a_known_peak():
    curves = np.stack([bell(145.0), bell(152.3), bell(150.0, 0.1) + bell(180.0)])
    found = highest_point(GRID, curves, 150.0, 10.0)
    np.testing.assert_allclose(found, [145.0, 152.3, 150.0], atol=0.02)
    assert highest_point(GRID, bell(145.0), 150.0, 10.0) == pytest.approx(145.0)


def test_the_highest_point_stays_within_reach():
    assert abs(highest_point(GRID, bell(180.0), 150.0, 10.0) - 150.0) <= 10.5
    assert highest_point(GRID, bell(180.0), 50.0, 10.0) == 50.0


def test_the_highest_point_never_leaves_the_band():
    rising = np.linspace(1, 2, len(GRID))
    assert GRID[0] <= highest_point(GRID, rising, GRID[-1], 5.0) <= GRID[-1]
