from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.modal.conftest import RATE, STOPS, cell_of, table_of
from tests.modal.plant import MOTION, Plant, trip, way

from ballscrew.fcft.conditions import Condition
from ballscrew.modal.paper.window import LEAST, Extent, blow, extent, tapered

PERIOD = 1 / 150


@pytest.mark.parametrize("condition", list(Condition))
def test_the_window_in_periods_around_the_blow_next_to_standstill(cell, condition):
    rows = cell(condition)
    at = blow(rows, condition)
    edge = rows["onset"] if condition.accelerating else rows["end"]
    np.testing.assert_array_equal(at, edge.values)
    window = extent(rows, condition, PERIOD, before=5.0, after=8.0)
    assert window.before == pytest.approx(5 * PERIOD * RATE, abs=1)
    assert window.after == pytest.approx(8 * PERIOD * RATE, abs=1)


@pytest.mark.parametrize("condition", list(Condition))
def test_one_blow_only(cell, condition):
    """However long it is asked to be, the window ends where the phase's other blow comes."""
    rows = cell(condition)
    phase = float(np.median(rows["end"].values - rows["onset"].values))
    long = extent(rows, condition, PERIOD, before=1000.0, after=1000.0)
    assert (long.after if condition.accelerating else long.before) <= phase + 1
    room = rows["length"].values
    at = blow(rows, condition)
    assert long.before <= np.median(at)
    assert long.after <= np.median(room - at)


def test_a_phase_shorter_than_four_periods_is_not_cut_at_its_other_blow():
    """The other blow is inside then: a window of less than four periods tells no mode from its neighbour."""
    quick = replace(MOTION, acceleration=15.0, jerk=15000.0)
    rows = cell_of(table_of(Plant(servo=0.5), move=way(trip(STOPS), RATE, quick)), "PA")
    assert float(np.median(rows["end"].values - rows["onset"].values)) / RATE < LEAST * PERIOD
    assert extent(rows, Condition.PA, PERIOD).after == pytest.approx(LEAST * PERIOD * RATE, abs=1)


def test_a_neighbour_cuts_the_window():
    near = replace(MOTION, dwell=0.03)
    rows = cell_of(table_of(Plant(servo=0.5), move=way(trip(STOPS), RATE, near)), "PD")
    assert extent(rows, Condition.PD, PERIOD).after <= 0.035 * RATE


def test_tapered_records_are_free_of_their_mean_and_hann_windowed(cell):
    rows = cell("PA")
    window = Extent(200, 300)
    force, response = tapered(rows, Condition.PA, window)
    assert force.shape == (3, 500)
    assert response.shape == (1, 3, 500)
    hann = 0.5 - 0.5 * np.cos(2 * np.pi * np.arange(500) / 500)
    for row in range(3):
        first = int(rows["onset"].values[row]) - 200
        raw = rows["input"].values[row, first : first + 500].astype(float)
        np.testing.assert_allclose(force[row], (raw - raw.mean()) * hann, atol=1e-9)
        raw = rows["acceleration"].values[0, row, first : first + 500].astype(float)
        np.testing.assert_allclose(response[0, row], (raw - raw.mean()) * hann, atol=1e-9)


def test_repetitions_that_do_not_hold_the_window_are_left_out(cell):
    rows = cell("PA").copy(deep=True)
    rows["length"].values[1] = rows["onset"].values[1] + 100
    assert len(tapered(rows, Condition.PA, Extent(200, 300))[0]) == 2
    rows["length"].values[:] = 50
    force, response = tapered(rows, Condition.PA, Extent(200, 300))
    assert force.shape == (0, 500)
    assert response.shape == (1, 0, 500)


def test_a_little_too_near_moves_the_window_a_little(cell):
    rows = cell("PA").copy(deep=True)
    rows["length"].values[1] = rows["onset"].values[1] + 290
    force, _ = tapered(rows, Condition.PA, Extent(200, 300))
    assert len(force) == 3
    first = int(rows["onset"].values[1]) - 210
    raw = rows["input"].values[1, first : first + 500].astype(float)
    hann = 0.5 - 0.5 * np.cos(2 * np.pi * np.arange(500) / 500)
    np.testing.assert_allclose(force[1], (raw - raw.mean()) * hann, atol=1e-9)


def test_no_sample_past_the_record_is_used(cell):
    """Padding is nought: were it used, the result would change with what it holds."""
    rows = cell("PD").copy(deep=True)
    window = extent(rows, Condition.PD, PERIOD)
    before = tapered(rows, Condition.PD, window)
    for row, length in enumerate(rows["length"].values):
        rows["input"].values[row, length:] = np.nan
        rows["acceleration"].values[:, row, length:] = np.nan
    after = tapered(rows, Condition.PD, window)
    np.testing.assert_array_equal(before[0], after[0])
    np.testing.assert_array_equal(before[1], after[1])
