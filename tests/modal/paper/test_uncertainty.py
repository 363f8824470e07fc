from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.modal.conftest import RATE

from ballscrew.fcft.conditions import Condition
from ballscrew.modal.paper.lines import Lines, magnitude
from ballscrew.modal.paper.peak import Peak, first_peak
from ballscrew.modal.paper.settings import PaperSettings
from ballscrew.modal.paper.uncertainty import (
    METHOD_ERROR,
    condition_term,
    repetition_term,
    travelled,
    window_term,
)
from ballscrew.modal.paper.window import Extent, extent, tapered

GRID = np.arange(130.0, 170.0, 0.1)
DEFAULT = PaperSettings()


def lines_at(frequencies):
    """Records of one input, each with a bell at a frequency of its own: for small shifts, their average
    peaks at their mean.
    """
    bells = np.exp(-(((GRID - np.array(frequencies)[:, None]) / 12.0) ** 2)).astype(complex)
    return Lines(GRID, np.ones((len(frequencies), len(GRID)), complex), bells[None])


@pytest.mark.parametrize("count", [3, 5, 12])
def test_the_jackknife_is_the_standard_error_of_a_mean(count):
    frequencies = 150 + 0.4 * np.random.default_rng(count).standard_normal(count)
    peak = Peak(frequencies.mean(), 1.0, at_edge=False)
    expected = frequencies.std(ddof=1) / np.sqrt(count)
    assert repetition_term(lines_at(frequencies), peak, DEFAULT) == pytest.approx(expected, rel=0.02)


def test_one_repetition_or_equal_ones_show_no_scatter():
    peak = Peak(150.0, 1.0, at_edge=False)
    assert repetition_term(lines_at([150.0]), peak, DEFAULT) == 0.0
    assert repetition_term(lines_at([150.0] * 4), peak, DEFAULT) == pytest.approx(0.0, abs=1e-9)


def test_conditions_that_disagree():
    """Two stops, two conditions each, 1 Hz and 3 Hz apart: pooled variance (0.5 + 4.5) / 2."""
    position, frequency = [0.0, 0.0, 0.1, 0.1], [150.0, 151.0, 140.0, 143.0]
    assert condition_term(position, frequency, [0.0] * 4) == pytest.approx(np.sqrt(2.5))
    assert condition_term(position, frequency, [1.0] * 4) == pytest.approx(np.sqrt(1.5))
    assert condition_term(position, frequency, [2.0] * 4) == 0.0, "their own scatter explains it"


def test_stops_of_one_condition_say_nothing():
    assert condition_term([0.0, 0.1, 0.2], [150.0, 140.0, 130.0], [0.1] * 3) == 0.0
    assert condition_term([], [], []) == 0.0


def test_the_condition_term_finds_the_spread_that_was_put_in():
    rng = np.random.default_rng(0)
    stops = np.repeat(np.arange(500.0), 4)
    frequency = 150 - 0.01 * stops + 0.3 * rng.standard_normal(2000) + 0.2 * rng.standard_normal(2000)
    assert condition_term(stops, frequency, [0.2] * 2000) == pytest.approx(0.3, rel=0.05)


@given(shift=st.floats(-50, 50), seed=st.integers(0, 100))
def test_a_shift_of_all_changes_no_disagreement(shift, seed):
    frequency = 150 + np.random.default_rng(seed).standard_normal(12)
    stops = np.repeat([0.0, 0.1, 0.2], 4)
    one, other = (condition_term(stops, f, [0.1] * 12) for f in (frequency, frequency + shift))
    assert one == pytest.approx(other, rel=1e-6, abs=1e-6)


def test_a_peak_lies_this_far_from_its_pole():
    """Torque → acceleration with 4 % damping: the magnitude of (1 + 2jζr)/(1 − r² + 2jζr) has its peak low.

    The limit covers up to 4 % damping, and is not many times too wide.
    """
    assert METHOD_ERROR == 0.006
    r = np.linspace(0.9, 1.1, 200_001)
    for damping in (0.02, 0.04):
        high = np.abs((1 + 2j * damping * r) / (1 - r**2 + 2j * damping * r))
        assert abs(r[high.argmax()] - 1) <= 0.0017


def test_the_way_that_the_table_makes_while_it_rings(cell):
    rows = cell("PA")
    window = extent(rows, Condition.PA, 1 / 150)
    way = travelled(rows, Condition.PA, window)
    onset = int(rows["onset"].values[0])
    whole = abs(rows["position"].values[0, onset + int(window.after) - 1] - rows["reached_m"].values[0])
    assert 0.05 * whole < way < 0.8 * whole
    standing = travelled(cell("PD"), Condition.PD, extent(cell("PD"), Condition.PD, 1 / 150))
    assert standing < 2e-5, "after an arrival the table stands"


def test_the_way_by_hand(cell):
    rows = cell("PA").isel(transient=[0]).copy(deep=True)
    at, window = int(rows["onset"].values[0]), Extent(100, 200)
    rows["position"].values[:] = float(rows["reached_m"].values[0])
    assert travelled(rows, Condition.PA, window) == 0.0
    rows["position"].values[:, at:] += 0.002
    assert travelled(rows, Condition.PA, window) == pytest.approx(0.002)
    rows["position"].values[:, :at] += 5.0
    assert travelled(rows, Condition.PA, window) == pytest.approx(0.002), "before the blow nothing rings"


def test_the_choice_of_the_window_costs_certainty(cell):
    """The window matters if another blow's ringing lies inside, and hardly otherwise."""
    terms = {}
    for condition in (Condition.PA, Condition.PD):
        rows = cell(condition)
        grid = np.arange(112.5, 187.5, 0.2)
        window = extent(rows, condition, 1 / 150)
        peak = first_peak(grid, magnitude(Lines.of(*tapered(rows, condition, window), RATE, grid), DEFAULT))
        terms[condition] = window_term(rows, condition, 150.0, grid, peak, DEFAULT)
    assert terms[Condition.PA] < 0.2
    assert terms[Condition.PD] > 5 * terms[Condition.PA]
