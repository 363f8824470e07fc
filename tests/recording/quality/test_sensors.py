from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import bilinear, lfilter
from tests.recording.quality.conftest import codes, moved
from tests.recording.synthetic import changed

from ballscrew.recording.aligned import align
from ballscrew.recording.kinematics import kinematics
from ballscrew.recording.phases import find_phases
from ballscrew.recording.quality.sensors import _worst_band, crosswise_gains, is_pitching

RATE = 12800.0


def with_mode(x, frequency, share, damping=0.03):
    """Motion of a sensor on a carrier with a mode; a loose sensor has all of the mode."""
    w = 2 * RATE * np.tan(np.pi * frequency / RATE)
    whole = lfilter(*bilinear([-1.0, 0.0, 0.0], [1.0, 2 * damping * w, w * w], RATE), x)
    return x + share * whole


def both(run, frequency, shares):
    turn = {"acc1_x": shares[0], "acc2_x": shares[1]}
    return changed(run.one, lambda source, x: with_mode(x, frequency, turn[source]), *turn)


@pytest.mark.parametrize("frequency", [120.0, 160.0, 210.0, 280.0])
@pytest.mark.parametrize("shares", [(0.05, -0.2), (0.2, -0.2), (-0.15, 0.1), (0.1, 0.0)])
def test_a_table_that_pitches_is_no_loose_sensor(run, frequency, shares):
    assert moved(both(run, frequency, shares), run.plan) == ()


@pytest.mark.parametrize("frequency", [120.0, 150.0, 205.0, 300.0])
@pytest.mark.parametrize("shares", [(1.0, 0.0), (0.0, 1.0)])
def test_a_loose_sensor_still_is_one(run, frequency, shares):
    assert codes(moved(both(run, frequency, shares), run.plan)) == {"sensors-disagree": "suspect"}


@pytest.mark.parametrize("sensor", ["acc1_x", "acc2_x"])
def test_a_loose_sensor_on_a_table_that_pitches_is_found(run, sensor):
    pitching = both(run, 230.0, (0.15, -0.1))
    loose = changed(pitching, lambda _, x: with_mode(x, 160.0, 1.0, 0.05), sensor)
    assert codes(moved(loose, run.plan)) == {"sensors-disagree": "suspect"}


def turned(run, degrees, source="acc1_x"):
    """The first sensor turned about the vertical, with its other axes as channels."""
    name = next(name for name, x in run.one.channels.items() if x.attrs["source"] == source)
    x, angle = run.one.channels[name], np.radians(degrees)
    noise = 0.02 * np.random.default_rng(1).standard_normal((2, x.size))
    channels = dict(run.one.channels)
    channels[name] = x.copy(data=np.cos(angle) * x.to_numpy() + noise[0])
    across = x.copy(data=np.sin(angle) * x.to_numpy() + noise[1])
    across.attrs["direction"] = "y"
    channels[name[:-1] + "y"] = across
    return replace(run.one, channels=channels)


@pytest.mark.parametrize(
    ("degrees", "found", "words"),
    [
        (8, {}, ""),
        (30, {"direction": "suspect"}, "nut-1:x is mounted 30° off the screw, towards acceleration:nut-1:y"),
        (150, {"direction": "suspect"}, "its polarity is inverted"),
    ],
)
def test_a_turned_sensor_is_named(run, degrees, found, words):
    findings = moved(turned(run, degrees), run.plan)
    assert codes(findings) == found
    assert words in "".join(finding.message for finding in findings)


def test_swapped_axes_of_a_sensor_are_named(run):
    findings = moved(turned(run, 90), run.plan)
    assert codes(findings)["direction"] == "bad"
    assert "acceleration:nut-1:y measures along the screw" in findings[-1].message


def test_two_that_differ_by_no_mode_are_not_excused():
    random = np.random.default_rng(0)
    frequency = np.arange(0, 500.0, 6.0)
    item, other = random.standard_normal((2, 10, len(frequency))) + 1j
    assert not is_pitching(frequency, item, other)


def test_nothing_excuses_nothing():
    frequency = np.arange(0, 500.0, 6.0)
    zero = np.zeros((4, len(frequency)), complex)
    assert not is_pitching(frequency, zero, zero)
    assert not is_pitching(frequency[:3], zero[:, :3] + 1, zero[:, :3] + 1)
    assert not is_pitching(frequency, zero + np.nan, zero + 1)


def test_without_phases_no_gain_across_the_screw_is_known(run):
    recording = turned(run, 10.0)
    aligned = align(recording)
    phases = find_phases(kinematics(aligned.position, aligned.rate))
    assert crosswise_gains(aligned, phases)
    assert crosswise_gains(aligned, ()) == {}
    assert crosswise_gains(replace(aligned, across={}), phases) == {}


def test_sensors_without_anything_in_common_are_not_compared():
    frequency = np.arange(0.0, 3200.0, 5.0)
    random = np.random.default_rng(0)
    first, second = random.standard_normal((2, 6, len(frequency))) + 0j
    assert _worst_band(frequency, first, second) is None
    assert _worst_band(frequency, first, 0 * first) is None
    assert _worst_band(frequency, first, 2 * first) is None  # in all bands alike
    louder = first * np.where(frequency >= 80.0, 3.0, 1.0)
    found = _worst_band(frequency, first, louder)
    assert found is not None
    assert found[2] == pytest.approx(3.0, rel=0.2)
