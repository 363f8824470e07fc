"""The plan as the position shows it."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import signal

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
