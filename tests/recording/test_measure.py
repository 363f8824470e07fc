from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
import xarray as xr
from tests.recording.synthetic import LOAD, PLAN, SHEET, synthetic_trip, write_trip
from tests.recording.test_encoder import moves

from ballscrew.axis.model import rotor_mass
from ballscrew.base.errors import InputError, MeasurementError
from ballscrew.base.provenance import hash_file
from ballscrew.fcft.cells import cells
from ballscrew.recording import measure as measure_module
from ballscrew.recording.aligned import align
from ballscrew.recording.channels import ChannelMap
from ballscrew.recording.load import read_recording
from ballscrew.recording.measure import _without_encoder_error, measure
from ballscrew.recording.quality.finding import Finding

RATE = 6400.0
CHANNELS = ChannelMap.from_settings(
    {
        "channel": [
            {"source": "torque", "quantity": "torque", "unit": "N m"},
            {"source": "position", "quantity": "position", "unit": "m"},
            {"source": "acc1_x", "quantity": "acceleration", "location": "nut-1", "axis": "x"},
            {"source": "acc2_x", "quantity": "acceleration", "location": "nut-2", "axis": "x"},
        ]
    }
)
PLANNED = replace(PLAN, repetitions=2)
KNOWN = {"sheet": SHEET, "plan": PLANNED, "mass": LOAD}


def write(folder: Path, name: str, seed: int, change=None, rate: float = RATE) -> Path:
    signals = synthetic_trip(rate=rate, seed=seed)
    return write_trip(folder / name, change(signals) if change else signals, rate)


@pytest.fixture(scope="module")
def files(tmp_path_factory) -> list[Path]:
    folder = tmp_path_factory.mktemp("run")
    return [write(folder, f"trip{i}.h5", i) for i in (1, 2)]


@pytest.fixture(scope="module")
def measured(files):
    return measure(files, CHANNELS, **KNOWN)


def test_a_good_run(measured, files):
    assert (measured.quality.verdict, measured.quality.reasons) == ("good", ())
    assert {f.name: f.sha256 for f in measured.files} == {path.name: hash_file(path) for path in files}
    assert measured.reasons == ()
    table = measured.transients
    keys = list(zip(table["position_m"].values, table["condition"].values, strict=True))
    wanted = [(c.position, str(c.condition)) for c in cells(PLANNED)]
    assert sorted(keys) == sorted(wanted * 2)
    assert table["input"].attrs["unit"] == "N m"
    assert table.sizes["response"] == 2


def test_a_recorded_temperature_is_that_of_the_run(tmp_path):
    files = []
    for i in (1, 2):
        file = write(tmp_path, f"trip{i}.h5", i)
        with h5py.File(file, "a") as opened:
            samples = len(opened["torque"])
            opened["temp"] = np.linspace(18.0 + 2 * i, 20.0 + 2 * i, samples)
        files.append(file)
    sensor = {"source": "temp", "quantity": "temperature", "unit": "degC", "location": "nut"}
    channels = ChannelMap.from_settings({"channel": [*CHANNELS.to_settings()["channel"], sensor]})
    course = measure(files, channels, **KNOWN).temperature
    assert course is not None
    assert course.mean_C == pytest.approx(22.0, abs=0.01)
    assert course.range_K == pytest.approx(3.8, abs=0.02)


def test_the_mass_is_in_kilograms(measured):
    """Torque over the lead: table, load and rotor, within 2 %."""
    expected = rotor_mass(SHEET) + SHEET.table.mass + LOAD
    assert measured.rigid_body.equivalent_mass == pytest.approx(expected, rel=0.02)
    assert abs(measured.rigid_body.equivalent_mass - expected) < 3 * measured.rigid_body.uncertainty[0] + 2


def test_without_a_sheet_a_torque_is_no_force(files):
    bare = measure(files, CHANNELS)
    assert bare.rigid_body is None
    assert "a torque is no force without the lead of a data sheet (--axis)" in bare.reasons[0]
    assert bare.transients.sizes["transient"] == 2 * len(cells(PLANNED))


def test_currents_that_are_not_of_this_motor_are_bad(files):
    rows = CHANNELS.to_settings()["channel"][1:]
    for source, phase in (("torque", "u"), ("acc2_x", "v")):
        rows.append({"source": source, "quantity": "current", "unit": "A", "phase": phase})
    got = measure(files, ChannelMap.from_settings({"channel": rows}), **KNOWN)
    assert got.quality.verdict == "bad"
    assert "trip1.h5" in got.quality.reasons[0]
    assert "the currents of the phases" in got.quality.reasons[0]


def test_progress_is_reported(files):
    message = []
    measure(files, CHANNELS, progress=lambda *step: message.append(step), **KNOWN)
    assert message == [(0, 2, "trip1.h5"), (1, 2, "trip2.h5"), (2, 2, "")]


def nan(signals):
    signals["torque"][1000] = np.nan
    return signals


def test_a_bad_recording_is_excluded_and_reported(files, tmp_path):
    bad = write(tmp_path, "trip3.h5", 3, nan)
    got = measure([*files, bad], CHANNELS, **KNOWN)
    assert got.quality.verdict == "suspect"
    assert any("excluded because they are bad: trip3.h5" in reason for reason in got.quality.reasons)
    assert any("NaN" in reason for reason in got.quality.reasons)
    used = [index for index, file in enumerate(got.files) if file.name != "trip3.h5"]
    assert sorted(set(got.transients["file"].values)) == used
    assert len(got.files) == 3


def test_where_all_are_bad_there_is_nothing(tmp_path):
    got = measure([write(tmp_path, "a.h5", 1, nan)], CHANNELS, **KNOWN)
    assert got.quality.verdict == "bad"
    assert (got.transients, got.rigid_body) == (None, None)
    assert got.reasons == ("no recording is good enough",)


def started(folder: Path, times: Sequence[str | None]) -> list[Path]:
    """One recording for each start time; None and "" are none."""
    paths = [write(folder, f"at{i}.h5", i) for i in range(len(times))]
    for path, time in zip(paths, times, strict=True):
        with h5py.File(path, "a") as file:
            if time is not None:
                file.attrs["started_at"] = time
    return paths


@pytest.mark.parametrize("times", list(itertools.permutations(("08:00", "08:02", "08:04"))))
def test_files_lie_in_the_order_of_their_start_times(tmp_path, times):
    day = "2026-01-31T"
    got = measure(started(tmp_path, [day + time for time in times]), CHANNELS, **KNOWN)
    assert [file.name for file in got.files] == [f"at{times.index(time)}.h5" for time in sorted(times)]
    assert got.started_at == "2026-01-31T08:00"
    assert sorted(set(got.transients["file"].values)) == [0, 1, 2]
    assert list(got.transients["file"].values) == sorted(got.transients["file"].values)


@pytest.mark.parametrize(
    "times",
    [
        (None, None),
        ("2026-01-31T08:00", None),
        (None, "2026-01-31T08:00"),
        ("2026-01-31T08:00", "yesterday"),
        ("2026-01-31T08:00", "2026-01-31T09:00Z"),
        ("2026-01-31T08:00", "2026-01-31T08:00"),
        ("", "2026-01-31T08:00"),
    ],
    ids=["none", "first", "second", "no time", "one zone", "same time", "empty"],
)
def test_without_start_times_that_can_be_compared_files_lie_in_the_order_of_their_hashes(tmp_path, times):
    paths = started(tmp_path, times)
    item, other = (measure(each, CHANNELS, **KNOWN) for each in (paths, paths[::-1]))
    hashes = [file.sha256 for file in item.files]
    assert hashes == sorted(hash_file(path) for path in paths)
    assert other.files == item.files
    assert other.started_at == item.started_at
    assert item.started_at in times or not any(times)
    assert other.transients.identical(item.transients)
    assert other.rigid_body == item.rigid_body


TWO_JERKS = replace(PLANNED, motions=(*PLAN.motions, replace(PLAN.motions[0], jerk=2 * PLAN.motions[0].jerk)))


@pytest.mark.parametrize("plan", [replace(PLANNED, warm_up=1), TWO_JERKS], ids=["warm-up", "jerk"])
@pytest.mark.parametrize("times", [(None, None), ("2026-01-31", "2026-01-31")], ids=["none", "a day"])
def test_where_only_their_order_says_which_trip_is_which_files_lie_as_given(tmp_path, plan, times):
    paths = started(tmp_path, times)
    for given in (paths, paths[::-1]):
        got = measure(given, CHANNELS, sheet=SHEET, plan=plan, mass=LOAD)
        assert [file.name for file in got.files] == [path.name for path in given]


def test_start_times_say_which_trip_is_the_warm_up(tmp_path):
    paths = started(tmp_path, ("2026-01-31T08:04", "2026-01-31T08:00"))
    got = measure(paths, CHANNELS, sheet=SHEET, plan=replace(PLANNED, warm_up=1), mass=LOAD)
    assert [file.name for file in got.files] == ["at1.h5", "at0.h5"]


def test_twins_are_refused(files, tmp_path):
    twin = tmp_path / "other-name.h5"
    twin.write_bytes(files[0].read_bytes())
    with pytest.raises(InputError, match=r"other-name\.h5: has the same content as trip1\.h5"):
        measure([files[0], twin], CHANNELS)


def test_rates_that_agree_to_100_ppm_are_one_rate(files, tmp_path):
    near = [write(tmp_path, f"trip{i}.h5", i, rate=RATE) for i in (1, 2)]
    for file, rate in zip(near, (6399.79, 6400.31), strict=True):
        with h5py.File(file, "a") as opened:
            opened.attrs["sample_rate"] = rate
    got = measure(near, CHANNELS, **KNOWN)
    assert got.transients.attrs["sample_rate"] == RATE
    exact = measure(files, CHANNELS, **KNOWN).transients
    assert sorted(got.transients["start_s"].values) == pytest.approx(sorted(exact["start_s"].values))
    turned = measure(near[::-1], CHANNELS, **KNOWN)
    xr.testing.assert_identical(turned.transients, got.transients)


def test_rates_that_differ_are_refused(files, tmp_path):
    other = write(tmp_path, "slow.h5", 5, rate=5120.0)
    with pytest.raises(InputError, match=r"slow\.h5: does not belong to one run with trip1\.h5"):
        measure([files[0], other], CHANNELS)
    with pytest.raises(InputError, match=r"5120 Hz and 6400 Hz.*declare it as sample_rate in channels\.toml"):
        measure([files[0], other], CHANNELS)


def test_no_file():
    with pytest.raises(InputError, match="no file is given"):
        measure([], CHANNELS)


@pytest.mark.parametrize("mass", [-1.0, float("nan"), float("inf")])
def test_a_load_that_cannot_be(files, mass):
    with pytest.raises(InputError, match="the load on the table is"):
        measure(files, CHANNELS, mass=mass)


def test_a_plan_outside_the_screw(files):
    far = replace(PLANNED, positions=(0.0, 0.9))
    with pytest.raises(InputError, match="not on the screw"):
        measure(files, CHANNELS, sheet=SHEET, plan=far, mass=LOAD)


def test_an_axis_that_stands(tmp_path):
    def still(signals):
        rng = np.random.default_rng(0)
        size = len(signals["torque"])
        return {
            name: np.full(size, 0.1) if name == "position" else 0.01 * rng.standard_normal(size)
            for name in signals
        }

    got = measure([write(tmp_path, "still.h5", 0, still)], CHANNELS, **KNOWN)
    assert got.quality.verdict != "good"
    assert got.rigid_body is None
    assert got.reasons


def test_a_file_without_a_channel_map_is_refused(files):
    with pytest.raises(
        InputError, match=r"trip1\.h5: no channel map is given \(channels\), which a file req"
    ):
        measure(files[:1], None)


def test_recordings_of_other_responses_are_not_of_one_run(files):
    fewer = ChannelMap.from_settings({"channel": CHANNELS.to_settings()["channel"][:3]})
    first, second = read_recording(files[0], CHANNELS), read_recording(files[1], fewer)
    with pytest.raises(InputError, match=r"trip2\.h5: does not belong to one run .* they must be the same"):
        measure([first, second], None, **KNOWN)


def test_a_fit_that_too_little_motion_determines_is_a_reason(files, monkeypatch):
    def fail(*_):
        raise MeasurementError("the axis does not move enough to separate its mass from its friction")

    monkeypatch.setattr(measure_module, "estimate_rigid_body", fail)
    found = measure(files, CHANNELS, **KNOWN)
    assert found.rigid_body is None
    assert found.reasons == ("the axis does not move enough to separate its mass from its friction",)


def test_a_rate_that_is_known_to_be_wrong_is_not_found_wrong_by_the_clock_again(monkeypatch):
    clock, finding = object(), Finding("suspect", "clock", "the clock is wrong")
    monkeypatch.setattr(measure_module, "estimate_clock", lambda _: clock)
    monkeypatch.setattr(measure_module, "check_clock", lambda *_: [finding])
    assert measure_module._clock([], RATE, []) == (clock, [finding])
    assert measure_module._clock([], RATE, [Finding("suspect", "rate", "the rate is wrong")]) == (clock, [])


def test_the_error_of_an_encoder_is_removed_from_the_position_and_what_is_derived_from_it(files):
    aligned = align(read_recording(files[0], CHANNELS))
    true = moves()
    error = 1e-6 * np.sin(2 * np.pi * true / 20e-6)
    rate = 8000.0
    derived = np.zeros((2, len(true)))
    derived[:, 1:-1] = np.diff(true + error, 2) * rate**2
    wrong = replace(aligned, position=true + error, rate=rate, response=derived)
    found = _without_encoder_error(wrong, (True, False))
    assert np.std(found.position - true) < 0.05 * np.std(error)
    np.testing.assert_array_equal(found.response[1], derived[1])
    own = np.diff(found.position, 2) * rate**2
    np.testing.assert_allclose(found.response[0, 1:-1], own, atol=1e-6)
    right = replace(wrong, position=true)
    assert _without_encoder_error(right, (True, False)) is right
