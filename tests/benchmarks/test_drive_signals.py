from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from benchmarks.drive_signals import (
    FORMATS,
    HEAD,
    POSITION_STEP,
    TORQUE_STEP,
    Record,
    Row,
    merged,
    record_of,
    sampled,
)
from scipy.signal import lfilter

import ballscrew
from ballscrew.cli.output import report_quality
from ballscrew.recording.channels import ChannelMap
from ballscrew.recording.load import read_recording
from ballscrew.recording.measure import measure

TIME = np.arange(400) / 2000.0


@pytest.mark.parametrize("name", [name for name in FORMATS if not name.startswith("UFF")])  # by pyuff
def test_a_record_is_read_as_it_was_written(tmp_path: Path, name: str) -> None:
    """Signals in steps, written on change in two of the formats; absent samples are the ones before."""
    form = FORMATS[name]
    torque_rate = 4000.0 if form.two_rates else 2000.0
    torque_time = np.arange(round(TIME.size * torque_rate / 2000)) / torque_rate
    random = np.random.default_rng(0)
    torque = 1e-3 * random.normal(size=torque_time.size)
    position = 0.1 + 2e-8 * random.normal(size=TIME.size)
    record = Record(
        np.round(torque / TORQUE_STEP) * TORQUE_STEP,
        np.round(position / POSITION_STEP) * POSITION_STEP,
        torque_rate,
        2000.0,
        np.round(torque / TORQUE_STEP) * TORQUE_STEP if form.with_speed else None,
    )
    path = tmp_path / "trip"
    form.write(path, record)
    read = read_recording(path, form.channels(2000.0))
    (position,) = read.of("position")
    (torque,) = read.of("torque") or read.of("current")
    assert (read.rate(torque), read.rate(position)) == pytest.approx((torque_rate, 2000.0), rel=1e-6)
    torques, positions = read.array(torque), read.array(position)
    np.testing.assert_allclose(torques, record.torque[: len(torques)], rtol=0, atol=1e-9)
    np.testing.assert_allclose(positions, record.position[: len(positions)], rtol=0, atol=1e-12)
    for speed in read.of("speed"):
        np.testing.assert_allclose(read.array(speed), record.speed[: len(torques)], rtol=0, atol=1e-9)
    assert min(len(torques) / torque_rate, len(positions) / 2000) > 0.19


def test_sampled_signals_have_no_delay() -> None:
    slow = sampled(np.sin(50 * np.arange(12800) / 12800), 12800.0, 500.0, 1e-6)
    np.testing.assert_allclose(slow, np.sin(50 * np.arange(500) / 500), rtol=0, atol=1e-6)


def test_a_row_of_refused_cells_has_their_reason() -> None:
    row = Row([], [], ["refused"], ["too slow"])
    assert row.text("TDMS", "250") == "| TDMS | 250 | 0 / 0 / 1 | too slow | | | | |"
    row = Row([0.1, -0.3], [0.1, 0.1], ["good", "suspect"], [])
    assert row.text("TDMS", "2000") == "| TDMS | 2000 | 1 / 1 / 0 | 0.20 | 0.30 | 0.20 | 100.0 % | 50.0 % |"


def test_rows_that_are_refused_for_one_reason_are_one() -> None:
    few = "samples per second are too few for a mode near 140 Hz"
    rows = [
        f"| {name} | {rate} | 0 / 0 / 80 | {rate} {few} | | | | |" for name in "AB" for rate in (500, 250)
    ]
    other = "| C | 500 | 0 / 0 / 260 | 500 samples per second are too few for a mode near 149 Hz | | | | |"
    good = "| A | 2000 | 80 / 0 / 0 | 0.07 | 0.23 | 0.27 | 100.0 % | 100.0 % |"
    assert merged([HEAD, *rows, good, other]) == [
        HEAD,
        good,
        "| A, B | 500, 250 | 0 / 0 / 80 each | too few for a mode near 140 Hz | | | | |",
        "| C | 500 | 0 / 0 / 260 each | too few for a mode near 149 Hz | | | | |",
    ]


@pytest.mark.parametrize(("scale", "whys"), [(1.0, []), (1.5, ["1.5 times"]), (-1.0, ["is inverted"])])
def test_a_speed_is_checked_against_the_position(
    bench: Path, tmp_path: Path, scale: float, whys: list[str]
) -> None:
    form = FORMATS["TwinCAT Scope with speed"]
    path = tmp_path / "trip"
    form.write(path, record_of(bench / "preload-4-percent-trip1.h5", 2000.0, form))
    settings = form.channels(2000.0).to_settings()
    settings["channel"][3]["scale"] = scale
    found = measure([path], ChannelMap.from_settings(settings)).quality
    assert len(found.reasons) == len(whys)
    assert all(why in reason for why, reason in zip(whys, found.reasons, strict=True)), found.reasons


def test_too_low_a_rate_is_a_bad_measurement(bench: Path, tmp_path: Path) -> None:
    """Without a data sheet the mode is not known, and the highest that the rate suffices for is stated."""
    form = FORMATS["TwinCAT Scope"]
    path = tmp_path / "trip"
    form.write(path, record_of(bench / "preload-4-percent-trip1.h5", 500.0, form))
    given = {"channels": form.channels(500.0), "axis": bench / "axis.toml", "mass": "100 kg"}
    found, run = ballscrew.quality([path], **given), ballscrew.analyze([path], **given)
    assert re.fullmatch(
        r"500 samples per second are too few for a mode near 1\d\d Hz: record at 1\d{3} Hz or more",
        found.reasons[0],
    )
    assert (found.verdict, report_quality(run.quality)) == ("bad", 1)
    assert run.quality.reasons == found.reasons
    assert {cell.reasons for cell in run.cells} == {found.reasons[:1]}
    bare = ballscrew.quality([path], channels=form.channels(500.0))
    assert bare.verdict == "good"
    assert "suffice for a mode up to 50 Hz" in bare.notes[-1]


def test_a_speed_that_lacks_samples_is_bad(bench: Path, tmp_path: Path) -> None:
    """Rounded values that repeat show that it was not written on change: its gaps are lost samples."""
    form = FORMATS["TwinCAT Scope with speed"]
    record = record_of(bench / "preload-4-percent-trip1.h5", 4000.0, form)
    path = tmp_path / "trip"
    form.write(path, replace(record, speed=lfilter([0.22], [1, -0.78], record.speed)))
    found = measure([path], form.channels(4000.0)).quality
    assert found.verdict == "bad"
    assert "speed has" in found.reasons[0]
    assert "NaN" in found.reasons[0]
