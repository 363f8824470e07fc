"""A run as files: what an analysis needs is there, and it reads them as it reads a bench's."""

from __future__ import annotations

import json
import math
import tomllib
from dataclasses import replace
from datetime import UTC, datetime

import h5py
import numpy as np
import pytest

import ballscrew
from ballscrew.axis.sheet_file import read_axis
from ballscrew.base.errors import InputError
from ballscrew.fcft.plan import read_plan
from ballscrew.fcft.schedule import trip_time
from ballscrew.recording.channels import ChannelMap
from ballscrew.testbed.example import AXIS, LOAD, PLAN, example_rig
from ballscrew.testbed.instruments import Instruments
from ballscrew.testbed.run import channels_toml, simulate_run, truth

SHORT = replace(PLAN, positions=PLAN.positions[:4], repetitions=3)


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    return simulate_run(example_rig(), SHORT, LOAD, tmp_path_factory.mktemp("run"), seed=3)


def test_analyze_reads_it_unchanged(files):
    run = ballscrew.analyze(files.run)
    assert run.quality.verdict == "good", run.quality.reasons
    assert len(run.cells) == 12
    assert len(run.files) == 3
    reported = json.loads(files.truth.read_text())["axial_natural_frequency_Hz"]
    read = [cell for cell in run.cells if cell.frequency_Hz is not None]
    assert len(read) >= 9
    off = [abs(cell.frequency_Hz - reported[f"{cell.position_m:.6f}"]) for cell in read]
    assert np.median(off) < 3.0
    # Table 41.5, load 50, rotor 225 kg: what the fit of torque on acceleration must find.
    assert run.rigid_body.equivalent_mass_kg == pytest.approx(41.5 + 50 + 225, rel=0.02)


def test_the_files_say_what_was_simulated(files):
    folder = files.run.parent
    assert replace(read_axis(folder / "axis.toml"), source=AXIS.source) == AXIS
    assert replace(read_plan(folder / "plan.toml"), source=SHORT.source) == SHORT
    assert [path.name for path in files.recordings] == ["trip001.h5", "trip002.h5", "trip003.h5"]


@pytest.mark.parametrize("warm_up", [0, 1])
def test_recordings_of_a_run_with_a_time_have_start_times(tmp_path, warm_up):
    plan = replace(SHORT, warm_up=warm_up, repetitions=2)
    files = simulate_run(example_rig(), plan, LOAD, tmp_path, measured_at="2026-01-31T08:00Z")
    starts = []
    for path in files.recordings:
        with h5py.File(path) as file:
            starts.append(datetime.fromisoformat(file.attrs["started_at"]))
    first = datetime(2026, 1, 31, 8, tzinfo=UTC)
    trip = trip_time(plan, plan.motions[0])
    assert [(start - first).total_seconds() for start in starts] == pytest.approx(
        [warm_up * trip, (warm_up + 1) * trip], abs=1e-3
    )
    run = ballscrew.analyze(files.run)
    assert [file.name for file in run.files] == ["trip001.h5", "trip002.h5"]
    assert run.measured_at == "2026-01-31T08:00:00+00:00"


def test_the_same_seed_gives_the_same_files_whatever_the_workers(files, tmp_path):
    other = simulate_run(example_rig(), SHORT, LOAD, tmp_path / "other", seed=3, workers=1)
    for name in ("trip001.h5", "trip002.h5", "trip003.h5"):
        pairs = []
        for each in (files, other):
            with h5py.File(each.run.parent / name) as file:
                pairs.append({key: file[key][:] for key in file if file[key].shape})
        assert pairs[0].keys() == pairs[1].keys()
        assert len(pairs[0]) >= 3
        for key, values in pairs[0].items():
            np.testing.assert_array_equal(values, pairs[1][key])


def test_a_data_sheet_that_is_wrong(tmp_path):
    reported = replace(AXIS, screw=replace(AXIS.screw, rigidity=1.2 * AXIS.screw.rigidity))
    files = simulate_run(example_rig(), replace(SHORT, repetitions=1), LOAD, tmp_path, sheet=reported)
    assert read_axis(files.run.parent / "axis.toml").screw.rigidity == reported.screw.rigidity


def test_the_truth():
    new, old = (truth(rig, SHORT, LOAD) for rig in (example_rig(), example_rig(340.0)))
    for key in ("axial_natural_frequency_Hz", "rotor_held_frequency_Hz"):
        assert len(new[key]) == 4
        assert all(new[key][place] > old[key][place] for place in new[key])
    gone = truth(example_rig(0.0, 1e-6), SHORT, LOAD)
    assert gone["axial_natural_frequency_Hz"] == {}
    assert gone["backlash_m"] == 1e-6


@pytest.mark.parametrize(("pretension", "stops"), [(0.0, 0), (1.0, 0), (1e4, 4), (math.inf, 4)])
def test_a_screw_whose_ends_pull_in_turn_has_no_true_frequency(pretension, stops):
    rig, sheet = example_rig(), replace(AXIS, support="fixed-fixed")
    rig = replace(rig, machine=replace(rig.machine, sheet=sheet, pretension=pretension))
    stated = truth(rig, SHORT, LOAD)
    for key in ("axial_natural_frequency_Hz", "rotor_held_frequency_Hz", "coupled_frequencies_Hz"):
        assert len(stated[key]) == stops


def test_progress_is_reported(tmp_path):
    reported = []
    simulate_run(
        example_rig(), replace(SHORT, repetitions=2), LOAD, tmp_path,
        progress=lambda done, total, name: reported.append((done, total, name)),
    )  # fmt: skip
    assert reported == [(1, 2, "trip001.h5"), (2, 2, "trip002.h5")]


def test_a_folder_that_cannot_be(tmp_path):
    (tmp_path / "file").write_text("x", encoding="utf-8")
    with pytest.raises(InputError, match="cannot be written"):
        simulate_run(example_rig(), SHORT, LOAD, tmp_path / "file")


def test_a_negative_seed(tmp_path):
    with pytest.raises(InputError, match="seed is -1; it must be a whole number, 0 or more"):
        simulate_run(example_rig(), SHORT, LOAD, tmp_path, seed=-1)


def test_a_plan_that_leaves_the_screw(tmp_path):
    with pytest.raises(InputError, match="not on the screw"):
        simulate_run(example_rig(), replace(SHORT, positions=(0.0, 2.0)), LOAD, tmp_path)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("scale", [False, True])
@pytest.mark.parametrize("probe", [False, True])
def test_the_channel_map_has_the_instruments_of_the_rig(scale: bool, probe: bool) -> None:
    instruments = Instruments(linear_scale=scale, backlash_probe=probe)
    text = channels_toml(replace(example_rig(), instruments=instruments))
    plain = channels_toml(replace(example_rig(), instruments=Instruments()))
    rows, others = (tomllib.loads(each)["channel"] for each in (text, plain))
    assert len(rows) == len(others) + scale + probe
    assert ChannelMap.from_settings(tomllib.loads(text)).channels
