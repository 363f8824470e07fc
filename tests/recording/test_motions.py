"""Motions are separated by speed and acceleration, and by their order where both are the same."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.modal.plant import Plant, trip, way

from ballscrew.fcft.plan import Motion, Plan
from ballscrew.fcft.schedule import trips
from ballscrew.recording.kinematics import kinematics
from ballscrew.recording.motions import (
    assign_motions,
    cluster,
    indistinguishable_motions,
    median_acceleration,
    nearest,
    nearest_motion,
    number_trips,
    warm_up_trips,
)
from ballscrew.recording.phases import find_phases

RATE = 4000
STOPS = (0.0, 0.06, 0.12)
SOFT = Motion(0.15, 2.5, 500.0, 0.3)
SHARP = Motion(0.15, 2.5, 2000.0, 0.3)
NEARLY = Motion(0.15, 2.5, 1900.0, 0.3)
LESS = Motion(0.15, 2.2, 2000.0, 0.3)
SLOW = Motion(0.10, 2.5, 1500.0, 0.3)
HARD = Motion(0.15, 5.0, 1500.0, 0.3)
TRIANGULAR = Motion(0.15, 20.0, 100.0, 0.3)  # 3.9 m/s² at its peak


def measured(plan, which=slice(None)):
    """Phases of each recorded trip of a plan, with their files, and what each truly is."""
    phases, file, truth = [], [], []
    for index, item in enumerate(trips(plan)[which]):
        aligned = Plant().run(way(trip(plan.positions), RATE, item.executed), index)
        found = find_phases(kinematics(aligned.position, aligned.rate))
        phases += found
        file += [index] * len(found)
        truth += [item.motion] * len(found)
    return phases, file, truth


def assigned(plan, phases, file):
    position = np.array([min(plan.positions, key=lambda stop: abs(stop - p.stop_position)) for p in phases])
    numbers = number_trips(file, position, [str(p.condition) for p in phases], plan.positions[0])
    return assign_motions(phases, numbers, plan).tolist()


@pytest.mark.parametrize(
    "motions",
    [(SOFT, SHARP), (SHARP, SLOW), (SHARP, HARD), (SHARP, TRIANGULAR), (SOFT, SHARP, HARD, SLOW)],
    ids=["jerk only", "speed", "acceleration", "triangular", "all"],
)
def test_every_phase_gets_its_motion(motions):
    plan = Plan(STOPS, 2, (100.0,), motions)
    *observed, truth = measured(plan)
    assert len(truth) == 2 * len(motions) * 8
    assert assigned(plan, *observed) == truth


def test_a_chain_of_which_neighbours_look_alike():
    motions = tuple(Motion(0.15, a, 1500.0, 0.3) for a in (2.0, 2.24, 2.5))
    plan = Plan(STOPS, 2, (100.0,), motions)
    *observed, truth = measured(plan)
    assert assigned(plan, *observed) == truth


@pytest.mark.parametrize("missing", [0, 1, 2])
def test_a_missing_trip_moves_no_label(missing):
    plan = Plan(STOPS, 2, (100.0,), (SHARP, LESS))
    *observed, truth = measured(plan)
    rest = [row for row, file in enumerate(observed[1]) if file != missing]
    assert assigned(plan, *([part[row] for row in rest] for part in observed)) == [truth[row] for row in rest]


def test_a_phase_that_is_cut_in_the_middle_of_a_run_moves_no_label():
    plan = Plan(STOPS, 2, (100.0,), (SHARP, NEARLY))
    phases, file, truth = measured(plan)
    phases[9] = replace(phases[9], complete=False, stop=phases[9].stop - 50)
    assert assigned(plan, phases, file) == truth


def test_what_no_recording_determines_goes_by_its_turn():
    plan = Plan(STOPS, 3, (100.0,), (SHARP, NEARLY))
    *observed, truth = measured(plan)
    assert assigned(plan, *observed) == truth


def test_a_warm_up_that_was_recorded_takes_no_turn():
    plan = Plan(STOPS, 2, (100.0,), (SHARP, NEARLY), warm_up=1)
    *observed, truth = measured(plan)
    assert assigned(plan, *observed) == truth
    assert warm_up_trips(5, plan) == 1
    *observed, truth = measured(plan, slice(1, None))
    assert assigned(plan, *observed) == truth
    assert warm_up_trips(4, plan) == 0


@pytest.mark.parametrize(
    "motions",
    [
        (Motion(0.15, 2.5, 1000.0, 0.3, jerk_spread=0.5, start_spread=0.05), HARD),
        (Motion(0.15, 50.0, 100.0, 0.3, jerk_spread=1.0), Motion(0.15, 50.0, 900.0, 0.3, jerk_spread=0.2)),
    ],
    ids=["reached", "triangular"],
)
def test_a_varied_jerk_is_still_one_motion(motions):
    plan = Plan(STOPS, 4, (100.0,), motions)
    *observed, truth = measured(plan)
    assert assigned(plan, *observed) == truth


def test_trips_are_separated_in_one_file_and_in_many():
    plan = Plan(STOPS, 3, (100.0,), (SHARP,))
    phases, file, _ = measured(plan)
    position = np.array([min(plan.positions, key=lambda stop: abs(stop - p.stop_position)) for p in phases])
    conditions = [str(p.condition) for p in phases]
    for files in (file, [0] * len(file)):
        assert number_trips(files, position, conditions, 0.0).tolist() == file
    # Also where the first departure of a trip was not seen.
    rows = [row for row in range(len(file)) if row != 8]
    got = number_trips([0] * len(rows), position[rows], [conditions[row] for row in rows], 0.0)
    assert got.tolist() == [file[row] for row in rows]


@pytest.mark.parametrize("motion", [SOFT, SHARP, HARD, TRIANGULAR])
def test_the_acceleration_that_is_found(motion):
    phases = measured(Plan(STOPS, 1, (100.0,), (motion,)))[0]
    observed = np.median([phase.acceleration for phase in phases])
    assert observed == pytest.approx(median_acceleration(motion), rel=0.02)


def test_one_motion_or_none_to_choose_from():
    plan = Plan(STOPS, 1, (100.0,), (SHARP,))
    *observed, truth = measured(plan)
    assert assigned(plan, *observed) == truth
    assert nearest_motion(observed[0][0], plan) == 0
    assert assign_motions([], np.empty(0, np.int64), plan).size == 0


def test_without_a_plan_speeds_are_clustered():
    phases, file, truth = measured(Plan(STOPS, 1, (100.0,), (SLOW, SHARP)))
    assert assign_motions(phases, np.array(file), None).tolist() == truth


def test_which_motions_only_their_order_distinguishes():
    def alike(*motions):
        return indistinguishable_motions(Plan(STOPS, 1, (100.0,), motions))

    assert alike(SOFT, SHARP, HARD) == (0, 1)
    assert alike(SHARP, LESS, SLOW) == ()


def test_stops_that_scatter():
    rng = np.random.default_rng(0)
    true = np.array([0.0, 0.045, 0.09, 0.45])
    positions = np.concatenate([t + 2e-4 * rng.standard_normal(7) for t in true])
    rng.shuffle(positions)
    np.testing.assert_allclose(cluster(positions), true, rtol=0, atol=3e-4)


def test_a_single_stop_and_no_stop():
    assert cluster([]).size == 0
    assert cluster([0.3]).tolist() == [0.3]
    assert cluster([0.3, 0.3004, 0.3002]).tolist() == [0.3002]


def test_a_gap_is_a_two_hundredth_of_the_travel_or_half_a_millimetre():
    assert len(cluster([0.0, 0.0045, 1.0])) == 2
    assert len(cluster([0.0, 0.0055, 1.0])) == 3
    assert len(cluster([i / 100 for i in range(61)])) == 61, "a fine grid of stops is no single one"
    assert len(cluster([0.0, 0.0004, 0.001])) == 2
    assert len(cluster([0.0, 0.0006, 0.0012])) == 3


def test_the_median_resists_an_outlier():
    assert cluster([0.0, 0.0, 0.0, 0.004, 0.5])[0] == 0.0


@given(
    st.lists(st.integers(-20, 20), min_size=1, max_size=12, unique=True),
    st.integers(0, 2**31),
)
def test_any_stops_of_sufficient_distance(stops, seed):
    rng = np.random.default_rng(seed)
    true = np.sort(np.array(stops)) * 0.05
    positions = np.repeat(true, 3) + rng.uniform(-2e-4, 2e-4, 3 * len(true))
    rng.shuffle(positions)
    found = cluster(positions)
    assert len(found) == len(true)
    assert np.abs(found - true).max() <= 2e-4
    assert np.all(np.diff(found) > 0)
    assert nearest(positions, true).tolist() == [int(np.argmin(np.abs(true - x))) for x in positions]


def test_the_nearest_of_a_plan():
    stops = (0.0, 0.1, 0.3)
    assert nearest([-5.0, 0.049, 0.051, 0.21, 9.0], stops).tolist() == [0, 0, 1, 2, 2]
    assert nearest([], stops).shape == (0,)
    with pytest.raises(ValueError, match="empty"):
        nearest([0.1], [])
