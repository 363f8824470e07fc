from __future__ import annotations

import numpy as np
import pytest

from ballscrew.base.errors import InputError
from ballscrew.modal.joint.signals import decimate, trip_signals
from ballscrew.recording.aligned import Aligned


def tone(frequency: float, rate: float = 12800.0) -> Aligned:
    t = np.arange(12800) / rate
    x = np.sin(2 * np.pi * frequency * t)
    return Aligned(rate, x, "torque", 0.4 + 1e-6 * x, np.stack([2 * x]), ("acc",))


def test_what_lies_below_the_new_rate_stays_in_step_and_size() -> None:
    trip = trip_signals(tone(200.0), 3000.0)
    assert trip.rate == 3200.0
    expected = np.sin(2 * np.pi * 200.0 * np.arange(len(trip.force)) / 3200.0)
    inside = slice(50, -50)
    assert np.abs(trip.force - expected)[inside].max() < 5e-3
    assert np.abs(trip.response[0] - 2 * expected)[inside].max() < 1e-2
    assert np.abs(trip.position - 0.4 - 1e-6 * expected)[inside].max() < 5e-9


def test_what_lies_above_it_goes() -> None:
    assert np.abs(trip_signals(tone(3000.0), 3200.0).force[50:-50]).max() < 5e-3


def test_thinning_again_keeps_the_least_rate() -> None:
    trip = trip_signals(tone(100.0), 6400.0)
    assert decimate(trip, 3000.0).rate == 3200.0
    assert decimate(trip, 5000.0) is trip


def test_a_rate_of_nothing_is_refused() -> None:
    with pytest.raises(InputError, match="more than 0"):
        trip_signals(tone(100.0), 0.0)


def test_the_motion_of_the_motor_is_decimated_as_the_other_channels_are() -> None:
    aligned = tone(200.0)
    motor = 3 * aligned.input
    trip = trip_signals(
        Aligned(12800.0, aligned.input, "torque", aligned.position, aligned.response, ("acc",), motor=motor),
        3000.0,
    )
    assert trip.motor is not None
    assert len(trip.motor) == len(trip.force)
    np.testing.assert_allclose(trip.motor, 3 * trip.force, atol=1e-9)
    assert len(trip.response) == 1
    assert trip_signals(aligned, 3000.0).motor is None
