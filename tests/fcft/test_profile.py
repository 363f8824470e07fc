from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.fcft.controller import move_time as stepped

from ballscrew.base.errors import InputError
from ballscrew.fcft.conditions import Condition, conditions_at
from ballscrew.fcft.plan import Motion, Plan, read_plan
from ballscrew.fcft.profile import planned_transients, profile, route, set_points
from ballscrew.fcft.schedule import trip_time

MOTION = Motion(0.15, 2.5, 1500.0, 0.35)
TRIANGLE = Motion(0.1, 10.0, 100.0, 0.2)
JUST = Motion(1.0, 10.0, 100.0, 0.1)  # the acceleration is reached and not held


def plan(motion, factors=(1.0, 2.5, 1.2), start=-0.03):
    way = 2 * motion.acceleration_distance
    stops = tuple(itertools.accumulate((factor * way for factor in factors), initial=start))
    return Plan(stops, 1, (0.0,), (motion,), source="plan.toml")


@st.composite
def cases(draw):
    motion = Motion(
        draw(st.floats(0.001, 2)),
        draw(st.floats(0.01, 50)),
        draw(st.floats(1, 1e5)),
        draw(st.sampled_from([0.0, 0.01, 0.35, 10.0])),
    )
    factors = draw(st.lists(st.floats(1.0, 5.0), min_size=1, max_size=5))
    return plan(motion, factors, draw(st.floats(-1, 1))), motion


def test_the_route():
    assert route(Plan((0.0, 1.0, 2.0), 1, (0.0,), (MOTION,))) == (0.0, 1.0, 2.0, 1.0, 0.0)
    assert route(Plan((0.0, 1.0), 1, (0.0,), (MOTION,))) == (0.0, 1.0, 0.0)


@settings(deadline=None)
@given(cases())
def test_each_piece_ends_where_the_next_begins(case):
    test, motion = case
    trip = profile(test, motion)
    t, a, j = np.diff(trip.time), trip.acceleration[:-1], trip.jerk[:-1]
    assert np.all(t >= 0)
    ends = (
        trip.position[:-1] + trip.speed[:-1] * t + a * t**2 / 2 + j * t**3 / 6,
        trip.speed[:-1] + a * t + j * t**2 / 2,
        a + j * t,
    )
    scale = np.ptp(test.positions) + abs(test.positions[0])
    np.testing.assert_allclose(ends[0], trip.position[1:], rtol=0, atol=1e-8 * scale)
    np.testing.assert_allclose(ends[1], trip.speed[1:], rtol=0, atol=1e-8 * motion.speed)
    rounding = 4 * np.spacing(trip.duration)  # of a time, which the jerk turns into acceleration
    slack = 1e-8 * motion.acceleration + rounding * motion.jerk
    np.testing.assert_allclose(ends[2], trip.acceleration[1:], rtol=0, atol=slack)


@settings(deadline=None)
@given(cases())
def test_no_limit_is_exceeded_and_each_stop_is_reached_exactly(case):
    test, motion = case
    trip = profile(test, motion)
    assert np.abs(trip.speed).max() == pytest.approx(motion.speed)
    assert np.abs(trip.acceleration).max() == pytest.approx(motion.peak_acceleration)
    assert np.abs(trip.acceleration).max() <= motion.acceleration * (1 + 1e-12)
    assert set(np.abs(trip.jerk)) == {0.0, motion.jerk}
    standing = trip.position[8::8]
    np.testing.assert_array_equal(standing, route(test)[1:])
    assert (trip.position[0], trip.position[-1]) == (test.positions[0], test.positions[0])
    assert (trip.speed[-1], trip.acceleration[-1], trip.jerk[-1]) == (0.0, 0.0, 0.0)
    assert trip.duration == pytest.approx(trip_time(test, motion), rel=1e-12)


@pytest.mark.parametrize("motion", [MOTION, TRIANGLE, JUST])
def test_the_position_is_the_integral_of_the_speed(motion):
    test = plan(motion)
    trip = profile(test, motion)
    time = np.linspace(0, trip.duration, 400_001)
    points = set_points(trip, time)
    for low, high in ((points.acceleration, points.speed), (points.speed, points.position)):
        summed = np.concatenate([[0.0], np.cumsum((low[1:] + low[:-1]) / 2 * np.diff(time))])
        np.testing.assert_allclose(summed + high[0], high, atol=1e-6 * np.abs(high).max())
    rise = np.abs(np.diff(points.acceleration)) / np.diff(time)
    assert rise.max() <= motion.jerk * (1 + 1e-6)
    assert np.abs(points.speed).max() <= motion.speed * (1 + 1e-12)
    assert points.position.min() >= test.positions[0] - 1e-12
    assert points.position.max() <= test.positions[-1] + 1e-12


@settings(deadline=None)
@given(cases(), st.lists(st.floats(0, 1), min_size=1, max_size=50))
def test_set_points_never_leave_the_stops_nor_the_limits(case, parts):
    test, motion = case
    trip = profile(test, motion)
    points = set_points(trip, np.array(parts) * trip.duration)
    slack = 1e-8 * (np.ptp(test.positions) + abs(test.positions[0]))
    assert np.all(points.position >= test.positions[0] - slack)
    assert np.all(points.position <= test.positions[-1] + slack)
    assert np.all(np.abs(points.speed) <= motion.speed * (1 + 1e-9))
    rounding = 4 * np.spacing(trip.duration) * motion.jerk
    assert np.all(np.abs(points.acceleration) <= motion.acceleration * (1 + 1e-9) + rounding)


@pytest.mark.parametrize("motion", [MOTION, TRIANGLE, JUST])
def test_a_move_takes_as_long_as_a_drive_takes_for_it(motion):
    test = Plan((0.0, 0.3), 1, (0.0,), (motion,))
    alone = (profile(test, motion).duration - 3 * motion.dwell) / 2
    assert alone == pytest.approx(stepped(0.3, motion.speed, motion.acceleration, motion.jerk), rel=2e-4)


def test_before_and_after_a_trip_the_axis_stands_at_its_first_stop():
    test = plan(MOTION)
    trip = profile(test, MOTION)
    points = set_points(trip, [-5.0, 0.0, trip.duration, trip.duration + 5])
    np.testing.assert_array_equal(points.position, [test.positions[0]] * 4)
    np.testing.assert_array_equal(points.speed, [0.0] * 4)
    np.testing.assert_array_equal(points.acceleration, [0.0] * 4)
    assert list(points.time) == [-5.0, 0.0, trip.duration, trip.duration + 5]


def test_no_drift_over_a_thousand_stops():
    stops = tuple(round(0.001 * i, 9) for i in range(1000))
    motion = Motion(0.01, 1.0, 1000.0, 0.1)
    trip = profile(Plan(stops, 1, (0.0,), (motion,)), motion)
    np.testing.assert_array_equal(trip.position[8::8], [*stops[1:], *stops[-2::-1]])


def test_nothing_is_held_in_a_triangle():
    trip = profile(plan(TRIANGLE), TRIANGLE)
    held = (trip.jerk[:-1] == 0) & (np.abs(trip.acceleration[:-1]) > 0)
    assert np.diff(trip.time)[held].max() <= 1e-15


@pytest.mark.parametrize("motion", [MOTION, TRIANGLE])
def test_transients_are_where_the_axis_accelerates(motion):
    test = plan(motion)
    found = planned_transients(test, motion)
    trip = profile(test, motion)
    assert len(found) == 4 * len(test.positions) - 4
    for one in found:
        duration = one.stop_s - one.start_s
        assert duration == pytest.approx(motion.acceleration_time)
        inside = set_points(trip, np.linspace(one.start_s, one.stop_s, 101)[1:-1])
        sign = one.condition.direction * (1 if one.condition.accelerating else -1)
        assert np.all(np.sign(inside.acceleration) == sign)
        assert np.all(np.sign(inside.speed) == one.condition.direction)
        at = one.start_s if one.condition.accelerating else one.stop_s
        assert float(set_points(trip, at).position) == pytest.approx(one.position, abs=1e-9)
        assert float(set_points(trip, at).speed) == pytest.approx(0, abs=1e-9)
    # And nowhere else.
    time = np.linspace(0, trip.duration, 20_001)
    busy = np.zeros(len(time), dtype=bool)
    for one in found:
        busy |= (time > one.start_s - 1e-9) & (time < one.stop_s + 1e-9)
    assert np.abs(set_points(trip, time[~busy]).acceleration).max() < 1e-6


def test_every_cell_is_met_once_a_trip():
    test = plan(MOTION)
    met = {(one.position, one.condition) for one in planned_transients(test, MOTION)}
    count = len(test.positions)
    wanted = {
        (stop, condition)
        for index, stop in enumerate(test.positions)
        for condition in conditions_at(index, count)
    }
    assert met == wanted
    assert {one.condition for one in planned_transients(test, MOTION)} == set(Condition)


def test_the_bench_follows_it(bench):
    h5py = pytest.importorskip("h5py")
    test = read_plan(bench / "plan.toml")
    with h5py.File(bench / "preload-4-percent-trip1.h5") as file:
        names = []
        file.visit(names.append)
        measured = file[next(name for name in names if name.endswith("position"))][()]
    points = set_points(profile(test, test.motions[0]), np.arange(len(measured)) / 12_800)
    # Another program's profile and servo: a lag of a few ms at 150 mm/s, and another wait before the start.
    shift = np.arange(-6400, 6401, 16)
    worst = min(np.abs(np.roll(points.position, s)[7000:-7000] - measured[7000:-7000]).max() for s in shift)
    assert worst < 0.002


def test_stops_too_close():
    close = replace(plan(MOTION), positions=(0.0, 0.009))
    with pytest.raises(
        InputError, match=r"^plan\.toml: two stops lie 0\.009 m apart; .* 0\.00925 m to reach"
    ):
        profile(close, MOTION)
