from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from tests.modal.plant import MOTION
from tests.recording.synthetic import SHEET

from ballscrew.base.errors import InputError
from ballscrew.base.provenance import FileRef
from ballscrew.fcft.plan import Plan
from ballscrew.modal.job import Job
from ballscrew.recording.channels import ChannelMap

CHANNELS = '[[channel]]\nsource = "torque"\nquantity = "torque"\nunit = "N m"\n'
PLAN = """
positions = [0, 0.1]
repetitions = 1
masses = ["60 kg"]
[motion]
speed = 0.1
acceleration = 2
jerk = 500
dwell = 0.2
"""
ONE = Plan((0.0, 0.1), 1, (60.0,), (MOTION,))
TWO = Plan((0.0, 0.1), 1, (60.0, 80.0), (MOTION,))


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "channels.toml").write_text(CHANNELS)
    (tmp_path / "other.toml").write_text(CHANNELS.replace("torque", "force").replace("N m", "N"))
    (tmp_path / "plan.toml").write_text(PLAN)
    (tmp_path / "run.toml").write_text(
        'channels = "channels.toml"\nplan = "plan.toml"\nload = "42 kg"\nfiles = ["a.h5", "b.h5"]\n'
        'measured_at = 2026-01-31T08:00:00Z\ntemperature = "20 degC"\n'
    )
    return tmp_path


def job(files, **given):
    names = ("channels", "axis", "plan", "mass", "measured_at", "temperature")
    return Job.read(files, **{name: given.get(name) for name in names})


def test_what_run_toml_says(folder):
    settings = job(folder / "run.toml")
    assert settings.files == (folder / "a.h5", folder / "b.h5")
    assert settings.channels.channels[0].quantity == "torque"
    assert settings.plan.masses == (60.0,)
    assert (settings.mass, settings.sheet, settings.temperature) == (42.0, None, pytest.approx(20.0))
    assert settings.measured_at.startswith("2026-01-31T08:00")


def test_flags_go_before_it(folder):
    settings = job(
        folder / "run.toml",
        channels=folder / "other.toml",
        plan=TWO,
        axis=SHEET,
        mass="7 kg",
        measured_at="2025-01-01T00:00Z",
        temperature="300 K",
    )
    assert settings.channels.channels[0].quantity == "force"
    assert settings.plan is TWO
    assert settings.sheet is SHEET
    assert settings.mass == 7.0
    assert settings.measured_at == "2025-01-01T00:00:00+00:00"
    assert settings.temperature == pytest.approx(26.85)


def test_flags_of_nought_go_before_it_too(folder):
    settings = job(folder / "run.toml", mass="0 kg", temperature="0 degC")
    assert settings.mass == 0.0
    assert settings.temperature == pytest.approx(0.0)
    assert job(folder / "run.toml", mass=0).mass == 0.0, "a bare number as well"


@pytest.mark.parametrize("files", ["a.h5", Path("a.h5"), ["a.h5"], (Path("a.h5"),)])
def test_files_in_any_form(folder, files):
    assert job(files, channels=folder / "channels.toml").files == (Path("a.h5"),)


def test_the_load(folder):
    channels = folder / "channels.toml"
    assert job("a.h5", channels=channels).mass is None
    assert job("a.h5", channels=channels, plan=ONE).mass == 60.0
    assert job("a.h5", channels=channels, plan=ONE, mass=5).mass == 5.0
    assert job("a.h5", channels=channels, plan=TWO).mass is None
    assert job("a.h5", channels=channels, axis=SHEET, plan=ONE).mass == 60.0
    for plan in (TWO, None):
        with pytest.raises(InputError, match="the load on the table is not stated"):
            job("a.h5", channels=channels, axis=SHEET, plan=plan)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"mass": "-1 kg"}, "load on the table .* -1 kg"),
        ({"mass": "3 m"}, r"the load \(mass\) is '3 m'"),
        ({"mass": "heavy"}, r"the load \(mass\) is 'heavy'"),
        ({"mass": float("nan")}, "the load"),
        ({"measured_at": "now"}, "measured_at is 'now'"),
        ({"temperature": "warm"}, "the temperature is 'warm'"),
        ({"temperature": 21.0}, r"the temperature is -252.15 °C; .* such as \"21 degC\""),
        ({"temperature": "200 degC"}, "it must be between -40 and 150 °C"),
        ({"temperature": "20 kg"}, "the temperature is '20 kg'"),
        ({"axis": "none.toml"}, "none.toml"),
        ({"plan": "none.toml"}, "none.toml"),
    ],
)
def test_what_is_wrong_is_named(folder, given, message):
    with pytest.raises(InputError, match=message):
        job("a.h5", channels=folder / "channels.toml", **given)


def test_run_toml_goes_alone(folder):
    for files in ([folder / "run.toml", "a.h5"], ["a.h5", folder / "run.toml"], [folder / "run.toml"] * 2):
        with pytest.raises(InputError, match="give it alone"):
            job(files)


def test_the_identity_is_of_all_that_was_said_and_measured(folder):
    base = job(folder / "run.toml")
    refs = [FileRef("a.h5", "1" * 64), FileRef("b.h5", "2" * 64)]
    when = base.measured_at
    known = base.identity(refs, when)
    assert len(known) == 64
    assert job(folder / "run.toml").identity(refs, when) == known, "the same again"
    renamed = [replace(ref, name="moved-" + ref.name) for ref in refs]
    assert base.identity(renamed, when) == known, "a name is no content"
    assert base.identity(refs[::-1], when) == known, "nor is the order of arrival"
    warmed = replace(base, plan=replace(TWO, warm_up=1))
    assert warmed.identity(refs[::-1], when) != warmed.identity(refs, when), "but where it tells trips apart"
    thinned = ChannelMap.from_settings({**base.channels.to_settings(), "sample_rate": 1000.0})
    others = [
        base.identity([replace(refs[0], sha256="3" * 64), refs[1]], when),
        base.identity(refs, None),
        replace(base, mass=43.0).identity(refs, when),
        replace(base, temperature=None).identity(refs, when),
        replace(base, plan=TWO).identity(refs, when),
        replace(base, sheet=SHEET).identity(refs, when),
        replace(base, channels=thinned).identity(refs, when),
    ]
    assert len({known, *others}) == 1 + len(others)


def test_a_missing_file_is_named_before_a_missing_channel_map(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    with pytest.raises(InputError, match=r"a\.csv: cannot be read"):
        Job.read(path)
    path.touch()
    with pytest.raises(InputError, match="no channel map is given"):
        Job.read(path)


@pytest.mark.parametrize(
    "files", [np.zeros(3), pd.DataFrame({"torque": [1.0]}), {"torque": [1.0]}, [np.zeros(3)], 1.0]
)
def test_arrays_that_are_no_recording_are_refused_with_what_to_do(files):
    with pytest.raises(InputError, match=r"Recording\.from_arrays"):
        job(files)


def test_any_iterable_of_paths_is_a_run(folder):
    settings = job((folder / name for name in ("a.h5", "b.h5")), channels=folder / "channels.toml")
    assert settings.files == (folder / "a.h5", folder / "b.h5")


def test_a_time_may_be_a_datetime(folder):
    when = datetime(2026, 1, 31, 8, tzinfo=UTC)
    assert job(folder / "run.toml", measured_at=when).measured_at == "2026-01-31T08:00:00+00:00"
