from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ballscrew.axis.frequency import predicted_frequency
from ballscrew.axis.sheet_file import read_axis
from ballscrew.axis.tolerances import with_uncertainty
from ballscrew.base.errors import InputError
from ballscrew.fcft.cells import cells
from ballscrew.fcft.excitation import blow_spectrum
from ballscrew.fcft.expected import executed, expected_cells, least_excitation
from ballscrew.fcft.nutload import nut_load, ringing_load
from ballscrew.fcft.plan import Motion, Plan, read_plan

BENCH = Motion(0.15, 2.5, 1500.0, 0.35)
FAST = Motion(0.2, 5.0, 2000.0, 0.35)
PLAN = Plan((0.0, 0.1, 0.25, 0.45), 3, (0.0, 100.0), (BENCH, FAST))


def test_every_cell_once_and_in_order(sheet):
    found = expected_cells(PLAN, sheet)
    assert [(c.mass, c.position, c.condition, c.motion) for c in found] == [
        (c.mass, c.position, c.condition, c.motion) for c in cells(PLAN)
    ]


def test_each_number_is_that_of_its_own_cell(sheet):
    for cell in expected_cells(PLAN, sheet):
        motion = PLAN.motions[cell.motion]
        predicted = with_uncertainty(sheet, cell.position, cell.mass)
        force = nut_load(sheet, motion, cell.mass, cell.condition)
        ringing = ringing_load(sheet, motion, cell.mass, cell.condition)
        loaded = predicted_frequency(sheet, cell.position, cell.mass, nut_load=ringing)
        assert cell.frequency == pytest.approx(float(predicted.value), rel=1e-12)
        assert cell.standard_uncertainty == pytest.approx(float(predicted.standard_uncertainty), rel=1e-9)
        assert cell.excitation == pytest.approx(float(blow_spectrum(cell.frequency, motion)))
        assert cell.nut_load == force
        assert cell.nut_load_ratio == pytest.approx(abs(force) / 600.0)
        assert cell.nut_load_shift == pytest.approx(float(loaded) - cell.frequency, abs=1e-9)
        assert 0 <= cell.least_excitation <= cell.excitation


def test_a_nut_load_lowers_the_frequency_until_eight_times_the_preload(sheet):
    plan = replace(PLAN, masses=(100.0,), motions=(replace(BENCH, acceleration=30.0, jerk=1e5, speed=1.0),))
    (first, *_) = expected_cells(plan, sheet)
    assert first.nut_load_ratio == pytest.approx((132 * 30 + 25) / 600)
    assert first.nut_load_shift < 0
    harder = replace(plan, motions=(replace(plan.motions[0], acceleration=40.0),))
    assert expected_cells(harder, sheet)[0].nut_load_shift > 0


def test_the_bench_lies_near_what_was_measured_on_it(foreign_bench):
    truth = json.loads((foreign_bench / "truth.json").read_text(encoding="utf-8"))["preload-4-percent"]
    for cell in expected_cells(
        read_plan(foreign_bench / "plan.toml"), read_axis(foreign_bench / "axis.toml")
    ):
        real = truth["axial_natural_frequency_Hz"][f"{cell.position:.3f}"]
        assert cell.frequency == pytest.approx(real, rel=0.025)
        assert abs(cell.frequency - real) < 2 * cell.standard_uncertainty


def test_the_least_is_looked_for_as_far_as_the_sheet_is_unsure():
    soft = replace(BENCH, jerk=375.0)  # null at 150 Hz
    assert least_excitation(140.0, 5.0, [soft]) == pytest.approx(0.0, abs=1e-3)
    assert least_excitation(140.0, 2.0, [soft]) == pytest.approx(float(blow_spectrum(147.0, soft)))
    assert least_excitation(140.0, 0.0, [soft]) == pytest.approx(float(blow_spectrum(147.0, soft))), "5 %"
    assert least_excitation([[100.0, 150.0]], [[1.0, 1.0]], [soft]).shape == (1, 2)


@given(frequency=st.floats(10, 1000), u=st.floats(0, 50), jerk=st.floats(100, 1e5))
def test_the_least_is_no_more_than_any_in_the_band(frequency, u, jerk):
    motion = replace(BENCH, jerk=jerk)
    band = frequency + np.linspace(-1, 1, 7) * max(2 * u, 0.05 * frequency)
    # The band is searched in steps, so it may miss the very bottom of a null.
    missed = np.pi * motion.jerk_time * max(2 * u, 0.05 * frequency) / 40
    assert float(least_excitation(frequency, u, [motion])) <= blow_spectrum(band, motion).min() + missed


def test_repetitions_of_a_motion_are_those_of_the_schedule():
    plan = replace(PLAN, motions=(BENCH, replace(FAST, jerk_spread=0.3)), warm_up=2)
    assert executed(plan, 0) == (BENCH,) * 3
    assert [run.jerk == 2000.0 for run in executed(plan, 1)] == [True, False, False]


def test_a_long_plan_with_many_repetitions(sheet):
    stops = tuple(round(0.0005 * index, 6) for index in range(250))
    slow = Motion(0.01, 0.5, 600.0, 0.35, jerk_spread=0.5)
    found = expected_cells(Plan(stops, 3000, (100.0,), (slow,)), sheet)
    assert len(found) == 996
    assert all(0 < cell.excitation <= 1 for cell in found)


def test_a_stop_beside_the_screw_is_refused(sheet):
    with pytest.raises(InputError, match="position"):
        expected_cells(replace(PLAN, positions=(0.0, 0.7)), sheet)
