from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ballscrew.modal.paper.cells import few_on_the_curve, off_the_curve


def along(stops, slope=-0.6, curve=0.0, f0=170.0):
    """1/f² linear (or bent) in the position, as Eq. (3) has it."""
    return f0 / np.sqrt(1 - slope * stops / 0.45 + curve * (stops / 0.45) ** 2)


STOPS = np.repeat(np.linspace(0, 0.45, 11), 4)


def test_a_mode_is_on_its_own_curve():
    f = along(STOPS) * (1 + 0.005 * np.random.default_rng(0).standard_normal(44))
    assert not off_the_curve(STOPS, f).any()


@pytest.mark.parametrize("wrong", [0.8, 0.88, 1.15, 1.3])
def test_strays_are_found_and_no_others(wrong):
    f = along(STOPS)
    strays = np.zeros(44, bool)
    strays[[3, 17, 30]] = True
    f[strays] *= wrong
    np.testing.assert_array_equal(off_the_curve(STOPS, f), strays)


def test_a_local_defect_is_no_stray():
    f = along(STOPS)
    f[20:24] *= 0.975
    assert not off_the_curve(STOPS, f).any()


def test_a_screw_fixed_at_both_ends_bends_the_curve():
    f = along(STOPS, slope=-0.8, curve=-0.8)
    assert f[20] < 0.95 * f[0]
    assert not off_the_curve(STOPS, f).any()


@given(seed=st.integers(0, 1000))
@settings(max_examples=25, deadline=None)
def test_peaks_anywhere_are_not_all_on_one_curve(seed):
    f = np.random.default_rng(seed).uniform(100, 200, 44)
    assert off_the_curve(STOPS, f).sum() >= 15


def test_one_stop_needs_no_slope():
    assert off_the_curve([0.1] * 4, [150.0, 151.0, 149.0, 190.0]).tolist() == [False] * 3 + [True]


@pytest.mark.parametrize("count", [0, 1, 2])
def test_two_cells_make_no_curve(count):
    assert off_the_curve([0.0, 0.1][:count], [150.0, 60.0][:count]).tolist() == [False] * count


def test_a_third_of_the_cells_must_show_it():
    assert few_on_the_curve(13, 40)
    assert not few_on_the_curve(14, 40)
    assert not few_on_the_curve(1, 3)
    assert not few_on_the_curve(0, 0)
