"""The plan as the position shows it."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from scipy import signal

from ballscrew.base.errors import MeasurementError
from ballscrew.recording import measured_plan
from ballscrew.recording.measured_plan import measure_plan

RATE = 4000.0


def moves(speed: float, acceleration: float, way: float, dwell: float) -> np.ndarray:
    """Position of three round trips of one move, with accelerations that begin and end at once."""
    ramp, cruise = round(speed / acceleration * RATE), round((way / speed - speed / acceleration) * RATE)
    rest = np.zeros(round(dwell * RATE))
    forth = np.concatenate([np.linspace(0, 1, ramp), np.ones(cruise), np.linspace(1, 0, ramp), rest])
    return np.cumsum(speed * np.concatenate([rest, *[forth, -forth] * 3])) / RATE


def test_a_servo_that_overshoots_does_not_raise_the_speed() -> None:
    position = moves(0.4, 6.0, 0.3, 0.6)
    servo = signal.cont2discrete(([150.0**2], [1, 60.0, 150.0**2]), 1 / RATE)
    measured = signal.lfilter(np.ravel(servo[0]), servo[1], position)
    highest = np.max(np.diff(measured)) * RATE
    plan = measure_plan(measured, RATE)
    assert highest > 0.42
    assert plan is not None
    assert plan.speed == pytest.approx(0.4, rel=0.01)
    assert plan.stops == pytest.approx((0.0, 0.3), abs=1e-3)


def test_stops_are_those_of_an_axis_that_has_settled() -> None:
    creep = signal.cont2discrete(([10.0], [1, 10.0]), 1 / RATE)
    position = signal.lfilter(np.ravel(creep[0]), creep[1], moves(0.4, 6.0, 0.3, 1.2))
    plan = measure_plan(position, RATE)
    assert plan is not None
    assert plan.stops == pytest.approx((0.0, 0.3), abs=2e-5)


def stairs(*stops: float) -> np.ndarray:
    """Position of an axis that moves from stop to stop, one way."""
    parts = [np.full(3000, stops[0])]
    for start, stop in pairwise(stops):
        ramp, cruise = 400, round((abs(stop - start) / 0.2 - 0.1) * RATE)
        speed = np.concatenate([np.linspace(0, 0.2, ramp), np.full(cruise, 0.2), np.linspace(0.2, 0, ramp)])
        parts.append(start + np.sign(stop - start) * np.cumsum(speed) / RATE)
        parts.append(np.full(3000, parts[-1][-1]))
    return np.concatenate(parts)


@pytest.mark.parametrize(
    "position", [np.full(8000, 0.1), np.full(8000, np.nan), np.r_[0.0, np.full(7999, np.inf)]]
)
def test_an_axis_that_stands_or_whose_position_is_missing_shows_no_plan(position: np.ndarray) -> None:
    assert measure_plan(position, RATE) is None


def test_a_motion_without_phases_shows_no_plan(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(_: object) -> None:
        raise MeasurementError("no phase")

    position = moves(0.4, 6.0, 0.3, 0.6)
    assert measure_plan(position, RATE) is not None
    monkeypatch.setattr(measured_plan, "find_phases", fail)
    assert measure_plan(position, RATE) is None


def test_stops_of_which_the_last_is_not_left_are_those_that_were_reached() -> None:
    plan = measure_plan(stairs(0.0, 0.1, 0.2, 0.3), RATE)
    assert plan is not None
    assert plan.stops == pytest.approx((0.0, 0.1, 0.2, 0.3), abs=2e-3)
    assert plan.step == pytest.approx(0.1, abs=1e-3)


def test_stops_of_unequal_distances_have_no_step() -> None:
    plan = measure_plan(stairs(0.0, 0.1, 0.3, 0.1, 0.0), RATE)
    assert plan is not None
    assert plan.step is None
    assert plan.stops == pytest.approx((0.0, 0.1, 0.3), abs=2e-3)


def test_an_axis_that_never_stands_has_no_dwell() -> None:
    assert np.isnan(measured_plan._dwell((), RATE))


def test_stops_that_are_closer_than_half_a_millimetre_are_one_and_no_plan() -> None:
    assert measure_plan(moves(0.02, 6.0, 0.0003, 0.3), RATE) is None
    plan = measure_plan(moves(0.02, 6.0, 0.0006, 0.3), RATE)
    assert plan is not None
    assert len(plan.stops) == 2
