"""The drive does what its settings say."""

from __future__ import annotations

import math

import numpy as np
import pytest
from tests.testbed.rigs import NO_WAVES, RATE, Array, at, constant_speed, lossless, machine

from ballscrew.axis.compliance import transmission_ratio
from ballscrew.base.errors import InputError
from ballscrew.testbed.integrator import integrate
from ballscrew.testbed.machine import constants
from ballscrew.testbed.servo import Servo, loop

BETA = transmission_ratio(0.010)
C = constants(machine(), 0.0, 0.2)._replace(structural=5e-5)


def _record(servo: Servo, wanted: Array, speed: float = 0.0) -> Array:
    start = at(wanted[0, 0], speed)
    return integrate(
        C, loop(servo, machine(), C), wanted, np.zeros((len(wanted), 2)), NO_WAVES, 4, RATE, start
    )[0]


def _step(size: float, n: int = 6400) -> Array:
    wanted = constant_speed(n, 0.2, 0.0)
    wanted[1:, 0] += size
    return wanted


def test_gains_are_those_of_the_bandwidths():
    got = loop(Servo(8.0, 40.0, 0.02, mass_ahead=0.5), machine(), C)
    mass = C.motor + C.screw + C.table
    assert got.position_gain == pytest.approx(2 * math.pi * 8)
    assert got.speed_gain == pytest.approx(mass * 2 * math.pi * 40)
    assert got.integral_gain == pytest.approx(got.speed_gain / 0.02)
    assert got.mass_ahead == pytest.approx(mass / 2)
    assert got.on


def test_torque_never_exceeds_its_limit():
    records = _record(Servo(torque_limit=0.2), _step(1e-3))
    assert np.abs(records[:, 7]).max() == pytest.approx(0.2 / BETA, rel=1e-12)
    assert np.abs(records[:, 0]).max() <= 0.2 / BETA * (1 + 1e-12)
    assert np.abs(_record(Servo(), _step(1e-3))[:, 0]).max() > 0.3 / BETA


def test_a_drive_at_its_limit_does_not_wind_up():
    """After half a second at the limit it comes to its place and does not overshoot by half."""
    place = _record(Servo(torque_limit=0.25), _step(0.02, 25600))[:, 5] - 0.2
    assert place.max() < 0.03
    assert place[-1] == pytest.approx(0.02, abs=2e-4)


@pytest.mark.parametrize("dead", [0, 1, 3, 10])
def test_torque_comes_late_by_the_dead_time(dead):
    records = _record(Servo(lag=0.0, dead_samples=dead), _step(1e-4, 400))
    asked, given = records[:, 7], records[:, 0]
    assert given[dead:] == pytest.approx(asked[: len(asked) - dead], rel=1e-12)
    assert not given[:dead].any()


def test_torque_follows_with_the_lag_of_the_current_loop():
    """At the limit what is asked for is a step."""
    records = _record(Servo(lag=2e-3, dead_samples=0, torque_limit=0.05), _step(0.05, 100))
    asked = records[:, 7]
    assert np.all(asked[1:] == asked[1])
    edges = np.arange(100) / RATE
    mean = 1 - 2e-3 * RATE * (np.exp(-(edges[1:] - 1 / RATE) / 2e-3) - np.exp(-edges[1:] / 2e-3))
    assert records[1:, 0] / asked[1] == pytest.approx(mean, abs=0.005)


def test_encoder_counts_in_its_resolution():
    fine = _record(Servo(resolution=0.0), constant_speed(3200, 0.2, 0.05), 0.05)
    coarse = _record(Servo(resolution=1e-6), constant_speed(3200, 0.2, 0.05), 0.05)
    counts = coarse[:, 4] / 1e-6
    assert counts == pytest.approx(np.round(counts), abs=1e-6)
    assert np.ptp(counts) > 1000
    assert np.abs(coarse[:, 4] - coarse[:, 5]).max() < 5e-6
    assert not np.array_equal(fine[:, 4], np.round(fine[:, 4], 6))
    assert np.std(coarse[1600:, 7]) > 2 * np.std(fine[1600:, 7])


def test_a_slower_filter_quiets_the_torque():
    quick = _record(Servo(resolution=1e-6, filter_time=0.0), constant_speed(6400, 0.2, 0.0503), 0.0503)
    slow = _record(Servo(resolution=1e-6, filter_time=1e-3), constant_speed(6400, 0.2, 0.0503), 0.0503)
    assert np.std(slow[3200:, 7]) < 0.5 * np.std(quick[3200:, 7])


def test_the_table_goes_where_it_shall():
    records = _record(Servo(), _step(1e-3, 12800))
    assert records[-1, 4] - 0.2 == pytest.approx(1e-3, abs=5e-6)


def test_speed_ahead_takes_the_following_error():
    """Without it the table lags by v over the position gain."""
    with_it = _record(Servo(), constant_speed(12800, 0.2, 0.05), 0.05)
    without = _record(Servo(speed_ahead=0.0), constant_speed(12800, 0.2, 0.05), 0.05)
    wanted = constant_speed(12800, 0.2, 0.05)[:, 0]
    assert np.abs(wanted - with_it[:, 4])[-1280:].mean() < 2e-5
    behind = (wanted - without[:, 4])[-1280:].mean()
    assert behind == pytest.approx(0.05 / (2 * math.pi * 8), rel=0.02)


def test_speed_loop_has_its_bandwidth():
    """A step of the wanted speed is followed with the time constant of the loop."""
    c = lossless(C)
    got = loop(Servo(speed_bandwidth=5.0, position_bandwidth=0.0, integral_time=1e3, mass_ahead=0.0, lag=0.0,
                     filter_time=0.0, dead_samples=0, resolution=0.0), machine(), c)  # fmt: skip
    wanted = constant_speed(2560, 0.2, 0.01)
    records, _ = integrate(c, got, wanted, np.zeros((2560, 2)), NO_WAVES, 4, RATE, at(0.2))
    speed = np.diff(records[:, 4]) * RATE
    slow = np.convolve(speed, np.ones(200) / 200, "same")
    reached = np.argmax(slow > 0.01 * (1 - math.exp(-1))) / RATE
    assert reached == pytest.approx(1 / (2 * math.pi * 5), rel=0.10)


@pytest.mark.parametrize(
    "changes",
    [
        {"position_bandwidth": -1.0},
        {"speed_bandwidth": math.nan},
        {"integral_time": 0.0},
        {"lag": -1e-4},
        {"filter_time": math.inf},
        {"torque_limit": 0.0},
        {"resolution": -1e-9},
        {"speed_ahead": "all"},
        {"dead_samples": -1},
        {"dead_samples": 1.5},
        {"dead_samples": 10**9},
    ],
)
def test_what_no_drive_is_is_refused(changes):
    (name,) = changes
    with pytest.raises(InputError, match=name.split("_")[0]):
        Servo(**changes)
