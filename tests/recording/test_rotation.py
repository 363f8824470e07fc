from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import bilinear, lfilter
from tests.recording.synthetic import recorded, synthetic_trip

from ballscrew.recording.aligned import align
from ballscrew.recording.kinematics import kinematics
from ballscrew.recording.phases import find_phases
from ballscrew.recording.rotation import _Lines, _mode, rotating_modes, rotation_sums, table_rotations

RATE = 12800.0
TRIP = recorded(synthetic_trip())


def rotating(frequency, lifts, axis="z", damping=0.03, sensitivity=0.03):
    """A trip whose table has a mode that moves its two sensors across the screw, beside their sensitivity."""
    w = 2 * RATE * np.tan(np.pi * frequency / RATE)
    mode = bilinear([-1.0, 0.0, 0.0], [1.0, 2 * damping * w, w * w], RATE)
    random, channels = np.random.default_rng(3), dict(TRIP.channels)
    for index, lift in enumerate(lifts, start=1):
        x = TRIP.channels[f"acceleration:nut-{index}:x"]
        across = lift * lfilter(*mode, x.to_numpy()) + sensitivity * x.to_numpy()
        across = x.copy(data=across + 0.02 * random.standard_normal(len(across)))
        across.attrs["direction"] = axis
        channels[f"acceleration:nut-{index}:{axis}"] = across
    return sums(replace(TRIP, channels=channels))


def sums(recording):
    aligned = align(recording)
    return rotation_sums(aligned, find_phases(kinematics(aligned.position, aligned.rate)))


@pytest.mark.parametrize(("frequency", "axis"), [(140.0, "z"), (180.0, "y"), (280.0, "z")])
def test_a_mode_of_the_table_is_found(frequency, axis):
    trip = rotating(frequency, (0.3, -0.3), axis)
    found = table_rotations([trip, trip], [100.0, 120.0, 130.0])
    assert [each.direction for each in found] == [{"z": "pitch", "y": "yaw"}[axis]]
    assert found[0].frequency_Hz == pytest.approx(frequency, rel=0.02)
    assert found[0].ratio == pytest.approx(0.3 / 0.06, rel=0.3)  # over twice the damping ratio
    own = 0.3 / ((frequency / 120.0) ** 2 - 1)
    assert found[0].ratio_at_mode == pytest.approx(own, rel=0.3)


def test_a_table_that_lifts_or_only_slides_does_not_rotate():
    for trip in (rotating(200.0, (0.3, 0.3)), rotating(200.0, (0.0, 0.0))):
        found = table_rotations([trip], [120.0])
        assert found[0].frequency_Hz is None
        assert (found[0].ratio_at_mode or 0.0) < 0.02


def test_a_mode_that_rotates_is_named():
    trip = rotating(140.0, (0.3, -0.3))
    rotations = rotating_modes([trip], [100.0, 140.0, None])
    assert rotations[0] is None
    assert rotations[1][0] == "pitch"
    assert rotations[1][1] > 3.0
    assert rotations[2] is None


def test_without_two_sensors_across_nothing_is_known():
    assert sums(TRIP) == {}
    assert table_rotations([{}], [120.0]) == ()
    assert rotating_modes([{}], [120.0]) == [None]


FREQUENCY = np.arange(60.0, 400.0, 2.0)


@pytest.mark.parametrize(
    ("mode", "slope", "size", "found"),
    [
        (200.0, 1.0, 0.3, True),
        (1000.0, 1.0, 0.3, False),  # beyond the lines
        (200.0, -1.0, 0.3, False),  # no mode: the ratio decreases everywhere
        (200.0, 1.0, 1e-4, False),  # the table does not rotate
    ],
)
def test_only_a_mode_among_the_lines_of_which_the_table_rotates_is_one(mode, slope, size, found):
    x = FREQUENCY / mode
    ratio = size / (1 + 2j * 0.03 * x - slope * x**2)
    lines = _Lines(FREQUENCY, np.ones_like(x), ratio, 2.0)
    result = _mode(lines)
    assert (result is not None) is found
    if result is not None:
        assert result[:2] == pytest.approx((200.0, 0.03), rel=1e-3)


def test_lines_that_no_mode_explains_have_none():
    x = FREQUENCY / 200.0
    noise = np.random.default_rng(0).standard_normal((2, len(x)))
    ratio = 0.3 / (1 + 0.06j * x - x**2) + 3 * (noise[0] + 1j * noise[1])
    assert _mode(_Lines(FREQUENCY, np.ones_like(x), ratio, 2.0)) is None
