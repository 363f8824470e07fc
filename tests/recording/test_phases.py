from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from tests.modal.plant import MOTION, Plant, trip, way

from ballscrew.fcft.plan import Motion
from ballscrew.recording.kinematics import kinematics
from ballscrew.recording.phases import find_phases

STOPS = [0.0, 0.06, 0.12, 0.18]
MIRROR = {"PA": "NA", "PD": "ND", "NA": "PA", "ND": "PD"}
REVERSE = {"PA": "ND", "PD": "NA", "NA": "PD", "ND": "PA"}  # played backwards, a departure is an arrival


def phases_of(move, noise=0.0, seed=0, **options):
    x = move.position + noise * np.random.default_rng(seed).standard_normal(len(move.position))
    return find_phases(kinematics(x, move.rate), **options)


def check(found, move, within, place_within=1e-4):
    """Every phase is there, none more, each with its name, and starts and stops where it does."""
    assert [str(p.condition) for p in found] == [t.condition for t in move.truth]
    for phase, true in zip(found, move.truth, strict=True):
        assert phase.start / move.rate == pytest.approx(true.start, abs=within)
        assert phase.stop / move.rate == pytest.approx(true.stop, abs=within)
        assert phase.stop_position == pytest.approx(true.place, abs=place_within)


@pytest.mark.parametrize("rate", [1000.0, 5000.0, 12800.0])
def test_jerk_limited_moves_with_dwell(rate):
    move = way(trip(STOPS), rate)
    found = phases_of(move, noise=1e-7)
    check(found, move, 2e-3, 1e-5)
    assert all(p.complete for p in found)
    for phase in found:
        assert phase.speed == pytest.approx(0.15, rel=0.03)  # read where the phase ends, so a little low
        assert phase.acceleration == pytest.approx(2.5, rel=0.03)


def test_a_ringing_table_is_found_as_well():
    move = way(trip(STOPS), 5000)
    # A mode of 40 Hz rings two and a half times in a phase of 62 ms: its end is told 8 ms late at worst.
    for frequency, within in ((40.0, 8e-3), (80.0, 4e-3), (150.0, 3e-3)):
        position = Plant(frequency=frequency, damping=0.03).run(move).position
        check(find_phases(kinematics(position, 5000)), move, within, 1e-4)


def test_momentary_stops_without_dwell():
    """Going on in the same direction after a stop of no length: four phases, not two."""
    move = way([0.0, 0.06, 0.12, 0.18], 2000, replace(MOTION, dwell=0.0))
    # Where there is no pause at all, the place is that of the sample next to the stop.
    check(phases_of(move, noise=1e-7), move, 4e-3, 1e-3)


@pytest.mark.parametrize("jerk", [1500.0, 100.0])
def test_a_reversal_is_two(jerk):
    """PD and NA, of one acceleration that keeps its sign: parted where the speed changes its own."""
    motion = Motion(0.15, 2.5, jerk, 0.0)
    move = way([0.0, 0.06, 0.0, 0.06], 2000, motion)
    found = phases_of(move, noise=1e-7)
    check(found, move, 5e-3 if jerk > 1000 else 12e-3, 1e-3)
    turn = [t.stop for t in move.truth][1]
    assert found[1].stop / 2000 == pytest.approx(turn, abs=2e-3)
    assert found[2].start / 2000 == pytest.approx(turn, abs=2e-3)


def test_an_overshoot_is_no_phase():
    """A loop that swings 3 % past the speed and the stop, at 8 Hz."""
    move = way(trip(STOPS), 2000, replace(MOTION, dwell=0.6))
    t, swing = move.time, np.zeros(len(move.position))
    for true in move.truth:
        after = t >= true.stop
        s = (t - true.stop)[after]
        sign = 1 if true.condition in ("PA", "ND") else -1
        swing[after] += sign * 0.05 * 0.15 / 50 * np.exp(-12 * s) * np.sin(2 * np.pi * 8 * s)
    found = find_phases(kinematics(move.position + swing, 2000))
    check(found, move, 6e-3, 3e-4)


def test_speeds_of_one_to_three_in_one_record():
    slow, fast = Motion(0.05, 2.0, 500.0, 0.3), Motion(0.15, 2.0, 500.0, 0.3)
    move = way([0.0, 0.06, 0.12, 0.06, 0.0], 4000, [slow, fast, fast, slow])
    found = phases_of(move, noise=1e-7)
    check(found, move, 3e-3)
    assert [round(p.speed, 2) for p in found] == [0.05, 0.05, 0.15, 0.15, 0.15, 0.15, 0.05, 0.05]


def test_accelerations_of_one_to_three_in_one_record():
    soft, hard = Motion(0.1, 1.0, 500.0, 0.3), Motion(0.1, 3.0, 500.0, 0.3)
    move = way([0.0, 0.06, 0.12, 0.06, 0.0], 4000, [soft, hard, hard, soft])
    check(phases_of(move, noise=1e-7), move, 5e-3)


@pytest.mark.parametrize("part", [0.25, 0.5, 0.75])
def test_a_record_cut_inside_a_phase(part):
    move = way(trip(STOPS), 4000)
    first, last = move.truth[0], move.truth[-1]
    a = round(4000 * (first.start + part * (first.stop - first.start)))
    b = round(4000 * (last.start + part * (last.stop - last.start)))
    found = find_phases(kinematics(move.position[a:b], 4000))
    assert [str(p.condition) for p in found] == [t.condition for t in move.truth]
    assert [p.complete for p in found] == [False, *[True] * (len(found) - 2), False]
    assert found[0].start / 4000 < 3e-3
    assert (b - a - found[-1].stop) / 4000 < 3e-3


def test_a_record_cut_between_phases_loses_none_and_invents_none():
    move = way(trip(STOPS), 4000)
    inner = move.truth[1:-1]
    a = round(4000 * (move.truth[0].stop + 0.1))
    b = round(4000 * (move.truth[-1].start - 0.1))
    found = find_phases(kinematics(move.position[a:b], 4000))
    assert [str(p.condition) for p in found] == [t.condition for t in inner]
    assert all(p.complete for p in found)


@pytest.mark.parametrize("noise", [0.0, 1e-7])
def test_an_axis_that_stands_has_none(noise):
    x = 0.2 + noise * np.random.default_rng(0).standard_normal(8000)
    found = find_phases(kinematics(x, 4000), least_speed=0.05)
    assert found == ()
    if not noise:
        assert find_phases(kinematics(x, 4000)) == ()


def test_an_axis_that_only_cruises_has_none():
    x = 0.1 * np.arange(8000) / 4000 + 1e-7 * np.random.default_rng(0).standard_normal(8000)
    assert find_phases(kinematics(x, 4000)) == ()


def test_a_change_between_two_speeds_is_none():
    """Neither end is near standstill: 0.1 → 0.15 → 0.1 m/s on the way."""
    bump = way([0.0, 0.06], 4000, Motion(0.05, 2.0, 500.0, 0.5), lead=0.5)
    move = way([0.0, 0.4], 4000, Motion(0.1, 2.0, 500.0, 0.3))
    x = move.position.copy()
    at = round(1.0 * 4000)
    x[at : at + len(bump.position)] += bump.position
    x[at + len(bump.position) :] += bump.position[-1]
    found = find_phases(kinematics(x, 4000))
    assert [str(p.condition) for p in found] == ["PA", "PD"]


def test_the_least_speed_that_a_plan_gives():
    slow, fast = Motion(0.02, 2.0, 500.0, 0.3), Motion(0.15, 2.0, 500.0, 0.3)
    move = way([0.0, 0.06, 0.12], 4000, [slow, fast])
    assert len(phases_of(move, least_speed=0.01)) == 4
    assert len(phases_of(move, least_speed=0.075)) == 2


@given(
    speed=st.floats(0.02, 1.0),
    time=st.floats(0.03, 0.5),  # of one acceleration
    sharpness=st.floats(0.02, 0.5),  # jerk time as a part of it
    dwell=st.floats(0.12, 0.6),
    rate=st.sampled_from([1000.0, 2000.0, 5120.0, 12800.0, 25600.0]),
    seed=st.integers(0, 1000),
)
@settings(max_examples=80, deadline=None)
def test_any_motion(speed, time, sharpness, dwell, rate, seed):
    """Nothing lost, nothing invented, and within a few milliseconds of the truth."""
    jerk_time = sharpness * time
    acceleration = speed / (time - jerk_time)
    motion = Motion(speed, acceleration, acceleration / jerk_time, dwell)
    step = 2.2 * motion.acceleration_distance
    move = way([0.0, step, 2 * step, step, 0.0], rate, motion)
    assume(len(move.position) < 150_000)
    noise = 2e-6 * step + 2e-8
    assume(noise < 1e-3 * acceleration * time**2)
    found = phases_of(move, noise, seed)
    check(found, move, 3e-3 + 0.05 * time, 0.02 * step)
    assert all(p.complete for p in found)


@given(seed=st.integers(0, 10_000), offset=st.floats(-1, 1))
@settings(max_examples=20, deadline=None)
def test_mirrored_reversed_and_shifted(seed, offset):
    move = way(trip(STOPS[:3]), 3000)
    x = move.position + 2e-7 * np.random.default_rng(seed).standard_normal(len(move.position))
    found = find_phases(kinematics(x, 3000))
    mirrored = find_phases(kinematics(-x, 3000))
    backwards = find_phases(kinematics(x[::-1].copy(), 3000))
    shifted = find_phases(kinematics(x + offset, 3000))
    size = len(x)
    assert [(p.start, p.stop, MIRROR[p.condition]) for p in found] == [
        (p.start, p.stop, str(p.condition)) for p in mirrored
    ]
    assert len(backwards) == len(found)
    for phase, other in zip(found, reversed(backwards), strict=True):
        assert str(other.condition) == REVERSE[phase.condition]
        assert (other.start, other.stop) == pytest.approx((size - phase.stop, size - phase.start), abs=3)
        assert other.stop_position == pytest.approx(phase.stop_position, abs=1e-5)
    assert len(shifted) == len(found)
    for phase, other in zip(found, shifted, strict=True):
        assert other.condition is phase.condition
        assert (other.start, other.stop) == pytest.approx((phase.start, phase.stop), abs=1)
        assert other.stop_position == pytest.approx(phase.stop_position + offset, abs=1e-9)
