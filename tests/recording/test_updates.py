"""Signals that are recorded more often than they are updated."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ballscrew.recording.channels import ChannelMap
from ballscrew.recording.load import read_recording
from ballscrew.recording.quality.signals import check_signals
from ballscrew.recording.updates import update_interval

TIME = np.arange(8000) / 2000.0
MOTION = 0.1 * np.sin(2.0 * TIME) ** 3  # m
ROWS = [
    {"source": "torque [Nm]", "quantity": "torque"},
    {"source": "position [mm]", "quantity": "position"},
    {"source": "speed [mm/s]", "quantity": "speed"},
    {
        "source": "position [mm]",
        "quantity": "acceleration",
        "derive": "second-derivative",
        "location": "motor",
    },
    {"source": "time [s]", "quantity": "time"},
]


def updated(values, interval, first=0):
    """Values at every so many samples, each repeated until the next."""
    index = np.arange(values.size)
    return values[np.maximum(np.floor((index - first) / interval) * interval + first, 0).astype(int)]


@pytest.mark.parametrize("step", [1e-8, 1e-6, 2e-5])
@pytest.mark.parametrize(("interval", "first"), [(1, 0), (2, 1), (5, 3), (8, 0), (64, 17)])
def test_a_signal_changes_at_multiples_of_its_cycle(step, interval, first):
    values = np.round(updated(MOTION, interval, first) / step) * step
    assert update_interval(values) == (interval, first)


def test_a_lost_sample_does_not_hide_the_cycle():
    values = np.delete(updated(MOTION, 8), 3001)
    assert update_interval(values)[0] == 8


@pytest.mark.parametrize("interval", [2.5, 8.3])
def test_a_cycle_that_is_no_number_of_samples(interval):
    assert update_interval(updated(MOTION, interval))[0] == 0


@pytest.mark.parametrize("values", [np.zeros(8000), np.round(MOTION, 4), np.round(MOTION, 3), MOTION[:15]])
def test_a_coarse_or_constant_signal_has_no_cycle(values):
    assert update_interval(values) == (1, 0)


def recorded(path: Path, position, speed=None):
    """Recording of a CSV file at 2 kHz."""
    speed = 2e2 * np.gradient(position) if speed is None else speed
    noise = np.random.default_rng(0).normal(size=TIME.size)
    columns = np.stack([TIME, noise, 1e3 * position, speed], axis=1)
    head = "time [s],torque [Nm],position [mm],speed [mm/s]"
    np.savetxt(path, columns, fmt="%.6f", delimiter=",", header=head, comments="")
    return read_recording(path, ChannelMap.from_settings({"channel": ROWS}))


def test_a_repeated_position_has_the_rate_of_its_cycle(tmp_path):
    recording = recorded(tmp_path / "trip.csv", updated(MOTION, 8, 3), 1e3 * np.gradient(MOTION))
    (position,) = recording.of("position")
    assert recording.rate("torque") == recording.rate("speed") == 2000.0
    assert recording.rate(position) == recording.rate("acceleration:motor") == 250.0
    assert recording.channels[position].attrs["start"] == pytest.approx(3 / 2000)
    np.testing.assert_allclose(recording.array(position), MOTION[3::8], atol=1e-9)
    assert recording.notes == (
        "position [mm]: is updated every 8 samples (4 ms) and used at that rate, 250 Hz.",
    )
    assert not [finding for finding in check_signals(recording) if finding.code in ("updates", "rate")]


def test_a_repeated_input_contradicts_no_rate(tmp_path):
    rows = [{**row, "source": "speed [mm/s]"} if row["quantity"] == "torque" else row for row in ROWS]
    recorded(tmp_path / "trip.csv", MOTION, updated(np.random.default_rng(1).normal(size=8000), 4))
    settings = {"channel": [row for row in rows if row["quantity"] != "speed"], "sample_rate": "2 kHz"}
    settings["channel"][0]["unit"] = "N m"
    recording = read_recording(tmp_path / "trip.csv", ChannelMap.from_settings(settings))
    assert recording.sample_rate == 500.0
    assert not [finding for finding in check_signals(recording) if finding.code == "rate"]


def test_a_position_without_a_constant_cycle_is_bad(tmp_path):
    found = check_signals(recorded(tmp_path / "trip.csv", updated(MOTION, 2.5), 1e3 * MOTION))
    assert [(finding.severity, finding.code) for finding in found] == [("bad", "updates")]
    assert "trip.csv: position is updated less often than it is recorded" in found[0].message
