"""Motions are told apart by speed and acceleration, and by their order where both are the same."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.modal.plant import Plant, trip, way

from ballscrew.fcft.plan import Motion, Plan
from ballscrew.fcft.schedule import trips
from ballscrew.recording.kinematics import kinematics
from ballscrew.recording.motions import assign_motions, nearest_motion, seen_acceleration
from ballscrew.recording.phases import find_phases

RATE = 4000
STOPS = (0.0, 0.06, 0.12)
SOFT = Motion(0.15, 2.5, 500.0, 0.3)
SHARP = Motion(0.15, 2.5, 2000.0, 0.3)
SLOW = Motion(0.10, 2.5, 1500.0, 0.3)
HARD = Motion(0.15, 5.0, 1500.0, 0.3)
TRIANGULAR = Motion(0.15, 20.0, 100.0, 0.3)  # 3.9 m/s² at its peak


def measured(plan):
    """Phases that a recording of each trip of a plan shows, and the motion that each truly is."""
    phases, truth = [], []
    for index, one in enumerate(trips(plan)):
        aligned = Plant().run(way(trip(plan.positions), RATE, one.executed), index)
        found = find_phases(kinematics(aligned.position, aligned.rate))
        phases += found
        truth += [one.motion] * len(found)
    return phases, truth


def assigned(plan, phases):
    position = np.array([min(plan.positions, key=lambda stop: abs(stop - p.stop_position)) for p in phases])
    return assign_motions(phases, position, [str(p.condition) for p in phases], plan).tolist()


@pytest.mark.parametrize(
    "motions",
    [(SOFT, SHARP), (SHARP, SLOW), (SHARP, HARD), (SHARP, TRIANGULAR), (SOFT, SHARP, HARD, SLOW)],
    ids=["jerk only", "speed", "acceleration", "triangular", "all"],
)
def test_every_phase_gets_its_motion(motions):
    plan = Plan(STOPS, 2, (100.0,), motions)
    phases, truth = measured(plan)
    assert len(phases) == 2 * len(motions) * 8
    assert assigned(plan, phases) == truth


def test_a_varied_jerk_is_still_one_motion():
    plan = Plan(
        STOPS, 3, (100.0,), (Motion(0.15, 2.5, 1000.0, 0.3, jerk_spread=0.5, start_spread=0.05), HARD)
    )
    phases, truth = measured(plan)
    assert assigned(plan, phases) == truth


def test_a_phase_that_the_record_cuts_takes_no_turn():
    plan = Plan(STOPS, 1, (100.0,), (SOFT, SHARP))
    phases, truth = measured(plan)
    cut = replace(phases[0], complete=False)
    assert assigned(plan, [cut, *phases]) == [0, *truth]


@pytest.mark.parametrize("motion", [SOFT, SHARP, HARD, TRIANGULAR])
def test_the_acceleration_that_is_seen(motion):
    phases, _ = measured(Plan(STOPS, 1, (100.0,), (motion,)))
    seen = np.median([phase.acceleration for phase in phases])
    assert seen == pytest.approx(seen_acceleration(motion), rel=0.02)


def test_one_motion_or_none_to_choose_from():
    plan = Plan(STOPS, 1, (100.0,), (SHARP,))
    phases, truth = measured(plan)
    assert assigned(plan, phases) == truth
    assert nearest_motion(phases[0], plan) == 0
    assert assign_motions([], np.empty(0), [], plan).size == 0


def test_without_a_plan_speeds_are_clustered():
    phases, truth = measured(Plan(STOPS, 1, (100.0,), (SLOW, SHARP)))
    got = assign_motions(phases, np.zeros(len(phases)), ["PA"] * len(phases), None)
    assert got.tolist() == truth
