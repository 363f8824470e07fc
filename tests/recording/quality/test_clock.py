from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from ballscrew.fcft.conditions import Condition
from ballscrew.recording.aligned import align
from ballscrew.recording.kinematics import Kinematics, kinematics
from ballscrew.recording.phases import MotionPhase, find_phases
from ballscrew.recording.quality.clock import (
    Clock,
    MoveTimes,
    check_clock,
    clock_difference,
    cruising_speed,
    estimate_clock,
    measure_move_times,
)


def paces(error=0.0, override=0.0, wait=0.0, trips=3, moves=18):
    """Logarithms of dwell and speed under a rate declared too high, an override and a wait for position."""
    random = np.random.default_rng(1)
    out = []
    for _ in range(trips):
        scatter = 5e-4 * random.standard_normal((2, moves))
        out.append(MoveTimes(scatter[0] - error + wait, scatter[1] + error + override, 0.6))
    return out


@pytest.mark.parametrize("error", [0.003, -0.003, 0.01])
def test_a_wrong_rate_shows_in_dwell_and_speed(error):
    clock = estimate_clock(paces(error))
    assert clock is not None
    assert clock.rate_error == pytest.approx(np.expm1(error), abs=4 * clock.rate_error_uncertainty)
    [finding] = check_clock(clock, 12800.0)
    assert finding.code == "rate"
    assert f"{12800 / (1 + clock.rate_error):.5g} Hz" in finding.message


@pytest.mark.parametrize("other", [{}, {"override": 0.01}, {"wait": 0.01}, {"override": -0.003}])
def test_neither_override_nor_wait_is_a_wrong_rate(other):
    assert check_clock(estimate_clock(paces(**other)), 12800.0) == []


def test_few_moves_determine_no_clock():
    assert estimate_clock(paces(moves=1)) is None
    assert estimate_clock([]) is None
    assert check_clock(None, 12800.0) == []


def test_a_tenth_of_a_per_cent_shows_against_the_baseline():
    baseline, later = estimate_clock(paces()), estimate_clock(paces(0.001))
    assert clock_difference(baseline, baseline) is None
    assert "+0.10 %" in (clock_difference(later, baseline) or "")
    assert clock_difference(later, None) is None
    assert clock_difference(Clock(0.001, 0.0005), Clock(0.0, 0.0005)) is None


def test_a_difference_that_a_worn_servo_can_cause_is_no_other_clock():
    assert clock_difference(Clock(0.0009, 1e-5, 4e-4), Clock(0.0, 1e-5, 2e-4)) is None
    assert clock_difference(Clock(0.0009, 1e-5, 2e-4), Clock(0.0, 1e-5, 2e-4)) is not None


def test_the_servo_counts_more_where_the_dwell_is_short():
    long, short = (estimate_clock([replace(trip, planned=time) for trip in paces()]) for time in (0.6, 0.2))
    assert short.servo_uncertainty == pytest.approx(3 * long.servo_uncertainty)


def test_the_clock_of_good_recordings_fits_the_plan(run):
    found = {}
    for error in (0.0, 0.004):
        trips = []
        for recording in run.recordings:
            aligned = align(recording)
            motion = kinematics(aligned.position, aligned.rate * (1 + error))
            trips.append(measure_move_times(motion, find_phases(motion), run.plan))
        found[error] = estimate_clock(trips)
    good = found[0.0]
    if good is None:  # too few moves of one direction
        pytest.skip("the run has too few moves")
    assert abs(good.rate_error) < 1e-3
    assert found[0.004].rate_error - good.rate_error == pytest.approx(0.004, abs=3e-4)


def test_a_plan_with_random_stops_determines_no_clock(run):
    aligned = align(run.one)
    motion = kinematics(aligned.position, aligned.rate)
    spread = replace(run.plan, motions=tuple(replace(m, start_spread=0.1) for m in run.plan.motions))
    assert len(measure_move_times(motion, find_phases(motion), spread).dwell) == 0


def test_the_start_after_a_reversal_is_late_and_does_not_count(run):
    rate, late, way = 20_000.0, 0.003, 0.1
    planned = run.plan.motions[0]
    cruise = way / planned.speed - planned.acceleration_time
    place, time, positions, phases = 0.0, planned.dwell, [(0.0, 0.0)], []
    for sign, leaves, reaches in ((1, Condition.PA, Condition.PD), (-1, Condition.NA, Condition.ND)):
        for move in range(4):
            positions.append((time, place))
            stop = time + planned.acceleration_time
            end = stop + cruise
            place += sign * way
            positions += [
                (stop, place - sign * (way - planned.acceleration_distance)),
                (end, place - sign * planned.acceleration_distance),
                (end + planned.acceleration_time, place),
            ]
            start = time + late * (move == 0)
            for first, last, condition, at in (
                (start, stop, leaves, place - sign * way),
                (end, end + planned.acceleration_time, reaches, place),
            ):
                samples = round(first * rate), round(last * rate)
                size = (planned.speed, planned.acceleration)
                phases.append(MotionPhase(*samples, condition, at, *size, complete=True))
            time = end + planned.acceleration_time + planned.dwell
    times, places = np.array(positions).T
    position = np.interp(np.arange(round(time * rate)) / rate, times, places)
    nothing = np.zeros_like(position)
    found = measure_move_times(Kinematics(position, nothing, nothing, rate, 0.0, 0.0), phases, run.plan)
    assert len(found.dwell) == 4  # two of four in each direction: not the first, and none follows the last
    assert found.dwell == pytest.approx(0.0, abs=2 / rate / planned.dwell)


@pytest.mark.parametrize(("stop", "start", "speed"), [(100, 900, 0.2), (100, 103, None), (100, 100, None)])
def test_a_speed_that_is_constant_too_briefly_is_not_measured(stop, start, speed):
    position = 0.2 * np.arange(1000) / 1000.0
    motion = SimpleNamespace(position=position, rate=1000.0)
    found = cruising_speed(motion, SimpleNamespace(stop=stop), SimpleNamespace(start=start))
    assert found == (None if speed is None else pytest.approx(speed))
