from __future__ import annotations

import pytest

from ballscrew.base.errors import InputError
from ballscrew.modal.job import read_run, timestamp

FULL = """
axis = "axis.toml"
plan = "../plan.toml"
channels = "channels.toml"
load = "100 kg"
measured_at = "2026-01-31T08:00Z"
temperature = "23 degC"
files = ["trip1.h5", "data/trip2.h5"]
"""


def write(folder, text):
    (folder / "run.toml").write_text(text, encoding="utf-8")
    return folder / "run.toml"


def test_all_that_can_be_said(tmp_path):
    run = read_run(write(tmp_path, FULL))
    assert run.files == (tmp_path / "trip1.h5", tmp_path / "data" / "trip2.h5")
    assert (run.channels, run.axis) == (tmp_path / "channels.toml", tmp_path / "axis.toml")
    assert run.plan == tmp_path / ".." / "plan.toml"
    assert run.load == 100.0
    assert run.measured_at == "2026-01-31T08:00:00+00:00"
    assert run.temperature == pytest.approx(23.0)


def test_the_least_that_must_be_said(tmp_path):
    run = read_run(write(tmp_path, 'channels = "c.toml"\nfiles = ["a.csv"]\n'))
    assert (run.axis, run.plan, run.load, run.measured_at, run.temperature) == (None,) * 5


def test_absolute_paths_stay(tmp_path):
    other = tmp_path / "elsewhere" / "a.h5"
    run = read_run(write(tmp_path, f"channels = 'c.toml'\nfiles = ['{other}']\n"))
    assert run.files == (other,)


@pytest.mark.parametrize(
    ("time", "expected"),
    [
        ("2026-01-31T08:00:00+01:00", "2026-01-31T08:00:00+01:00"),
        ("2026-01-31 08:00:00", "2026-01-31T08:00:00"),
        ("2026-01-31", "2026-01-31"),
    ],
)
def test_tomls_own_times(tmp_path, time, expected):
    run = read_run(write(tmp_path, f'channels = "c.toml"\nfiles = ["a"]\nmeasured_at = {time}\n'))
    assert run.measured_at == expected


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('files = ["trip1.h5", "data/trip2.h5"]', "", "files is missing"),
        ('["trip1.h5", "data/trip2.h5"]', "[]", r"files is \[\]; it must be a list of file names"),
        ('["trip1.h5", "data/trip2.h5"]', '"trip1.h5"', "it must be a list of file names"),
        ('["trip1.h5", "data/trip2.h5"]', "[7]", "it must be a list of file names"),
        ('["trip1.h5", "data/trip2.h5"]', '[""]', "it must be a list of file names"),
        ('channels = "channels.toml"', "", "channels is missing"),
        ('channels = "channels.toml"', "channels = 3", "channels is 3"),
        ('"100 kg"', '"100 mm"', "load is '100 mm'"),
        ('"100 kg"', '"-1 kg"', "load is '-1 kg'"),
        ('"2026-01-31T08:00Z"', '"yesterday"', "measured_at is 'yesterday'; it must be a time in ISO 8601"),
        ('"2026-01-31T08:00Z"', "true", "measured_at is True"),
        ('"2026-01-31T08:00Z"', "1.5", "measured_at is 1.5"),
        ('"23 degC"', '"-300 degC"', "temperature is '-300 degC'"),
        ('"23 degC"', '"23 kg"', "temperature is '23 kg'"),
        ("load =", "lod =", "lod is not a known field"),
    ],
)
def test_what_is_wrong_is_named(tmp_path, old, new, message):
    assert old in FULL
    with pytest.raises(InputError, match=rf"run\.toml.*{message}"):
        read_run(write(tmp_path, FULL.replace(old, new)))


def test_times_by_hand():
    assert timestamp("2026-01-31T08:00Z", "measured_at") == "2026-01-31T08:00:00+00:00"
    for wrong in ("", "8 o'clock", "2026-13-01", "T"):
        with pytest.raises(InputError, match="measured_at is"):
            timestamp(wrong, "measured_at")
