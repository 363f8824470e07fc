from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from ballscrew.base.errors import InputError
from ballscrew.recording.readers import process, profile, reader_for

OWN = """
match = '^\\[Axis scope\\]'
delimiter = ";"
decimal = ","
names_after = '^\\[Data\\]'
names_line = 1
units_line = 2
first_line = 4
ends_before = '^\\[Statistics\\]'
start_pattern = '^Date=(\\S+)'

[rate]
pattern = '^Rate=(.*)$'
unit = "kHz"

[units]
'Pos.*' = "mm"
"""
FILE = """[Axis scope]
Date=2026-01-31T08:00:00
Rate=2,5
[Data]
Iq;PosX;Load
[A];;%
---;---;---
1,5;100;7
2;101,25;8
-2;102;9
[Statistics]
Rows;3
"""

KOLLMORGEN = "3,1\nIL.FB,VL.CMD,VL.FB\n-0.086,0.000,2.661\n0.000,0.000,3.605\n0.029,0.000,-0.486\n"
LECROY = (
    "LECROY9354,935412345\nSegments,1,SegmentSize,3\nSegment,Trig Time,TimeSinceFirstSegment\n"
    "#1,21 Mar 1990 9:37:08,0.0\nTime,Ampl\n0.0,1\n0.1,2\n0.2,4\n"
)
TNCSCOPE = """%[GLOBAL]
%VERSION=1
%
%[CURVE1]
%CHANNELTYPE=s actual
%AXISTYPE=X
%DIMENSION=mm
%CYCLETIME=600
%
%[CURVE2]
%CHANNELTYPE=I nominal
%AXISTYPE=X
%DIMENSION=A
%CYCLETIME=600
%
%[DATA]
0;1.5;2.5;
600;1.75;2.25;
1200;2;2;
"""


@pytest.fixture
def own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[str], None]]:
    """Makes a text the profile of the user."""

    def use(text: str) -> None:
        folder = tmp_path / "profiles"
        folder.mkdir()
        (folder / "axis-scope.toml").write_text(text)
        monkeypatch.setenv(profile.FOLDER, str(folder))
        profile.profiles.cache_clear()

    process.stop()
    yield use
    process.stop()
    profile.profiles.cache_clear()


def test_a_profile_of_the_user_is_used_also_in_the_reading_process(
    tmp_path: Path, own: Callable[[str], None]
) -> None:
    own(OWN)
    path = tmp_path / "a.csv"
    path.write_text(FILE)
    with process.opened(path) as file:
        header, values = file.header, file.read(["Iq", "PosX", "Load"])
    assert [(c.name, c.unit) for c in header.channels] == [("Iq", "A"), ("PosX", "mm"), ("Load", "%")]
    assert (header.sample_rate, header.started_at) == (2500.0, "2026-01-31T08:00:00")
    assert header.reader == "profile axis-scope"
    np.testing.assert_array_equal(values["Iq"], [1.5, 2, -2])
    np.testing.assert_array_equal(values["PosX"], [100, 101.25, 102])


@pytest.mark.parametrize(
    ("text", "reader", "channels", "rate", "last"),
    [
        (
            KOLLMORGEN,
            "profile kollmorgen-recorder",
            [("IL.FB", None), ("VL.CMD", None), ("VL.FB", None)],
            None,
            [0.029, 0.0, -0.486],
        ),
        (LECROY, "profile lecroy-spreadsheet", [("Time", "s"), ("Ampl", None)], None, [0.2, 4.0]),
        (
            TNCSCOPE,
            "profile heidenhain-tncscope",
            [("time [us]", None), ("s actual X", "mm"), ("I nominal X", "A")],
            1e6 / 600,
            [1200.0, 2.0, 2.0],
        ),
    ],
)
@pytest.mark.parametrize("newline", ["\n", "\r\n"])
def test_profiles_of_the_package(
    tmp_path: Path,
    text: str,
    reader: str,
    channels: list[tuple[str, str | None]],
    rate: float | None,
    last: list[float],
    newline: str,
) -> None:
    path = tmp_path / "a.txt"
    path.write_text(text, newline=newline)
    found = reader_for(path)
    header = found.read_header(path)
    assert header.reader == reader
    assert [(channel.name, channel.unit) for channel in header.channels] == channels
    assert header.sample_rate == (None if rate is None else pytest.approx(rate))
    values = found.read(path, [name for name, _ in channels])
    assert [array[-1] for array in values.values()] == last
    assert {len(array) for array in values.values()} == {3}


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("match = '('", "match is no regular expression"),
        ("first_line = 1", "match"),
        (OWN.replace('";"', '"and"'), "delimiter is 'and'"),
        (OWN.replace("names_line = 1", ""), "names_line"),
        (OWN.replace("names_line", "name_line"), "name_line"),
        (OWN.replace('"kHz"', '"mm"'), "unit"),
        (OWN.replace("Rate=(.*)", "Rate="), "one group"),
        (OWN.replace("names_line = 1", "names = 1"), "a list of texts"),
        ("match = ", "is not TOML"),
    ],
)
def test_a_wrong_profile_of_the_user_is_named(
    tmp_path: Path, own: Callable[[str], None], text: str, reason: str
) -> None:
    own(text)
    path = tmp_path / "a.csv"
    path.write_text(FILE)
    with pytest.raises(InputError, match=f"axis-scope.toml.*{reason}.*{profile.FOLDER}"):
        reader_for(path).read_header(path)


@pytest.mark.parametrize(
    ("old", "new", "reason"),
    [
        ("[Data]", "[Dat]", "has no line"),
        ("Rate=2,5", "Rate=x", "states no rate"),
        ("Rate=2,5", "Rate=0", "states no rate"),
        ("Rate=2,5", "Rate=2\nRate=3", "states several intervals or rates"),
        ("1,5;100;7", "1,5;100", "cells; the table has 3 columns"),
        ("1,5;100;7", "1,5;x;7", "column 'PosX' is 'x'"),
        (FILE[60:], "", "ends before its table|has no line"),
    ],
)
def test_a_file_that_is_not_as_its_profile_is_one_sentence(
    tmp_path: Path, own: Callable[[str], None], old: str, new: str, reason: str
) -> None:
    own(OWN)
    path = tmp_path / "a.csv"
    path.write_text(FILE.replace(old, new))
    reader = reader_for(path)
    with pytest.raises(InputError, match=reason):
        reader.read(path, [channel.name for channel in reader.read_header(path).channels])


def test_an_empty_folder_of_profiles_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(profile.FOLDER, str(tmp_path))
    profile.profiles.cache_clear()
    path = tmp_path / "a.csv"
    path.write_text("x,y\n1,2\n")
    try:
        with pytest.raises(InputError, match="has no profile"):
            reader_for(path).read_header(path)
    finally:
        profile.profiles.cache_clear()


@pytest.mark.parametrize("text", [KOLLMORGEN, LECROY, TNCSCOPE])
def test_a_changed_byte_is_a_recording_or_one_sentence(
    tmp_path: Path, text: str, survives: Callable[[Path], bool]
) -> None:
    raw, path = text.encode(), tmp_path / "a.txt"
    generator = np.random.default_rng(0)
    places, values = generator.integers(0, len(raw), 150), generator.integers(0, 256, 150)
    for position, byte in zip(places, values, strict=True):
        path.write_bytes(raw[:position] + bytes([byte]) + raw[position + 1 :])
        survives(path)


def test_columns_of_a_profile_that_are_not_there(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    path.write_text(KOLLMORGEN)
    reader = profile.ProfileReader()
    with pytest.raises(InputError, match=r"has no channel 'IL\.CMD'"):
        reader.read(path, ["IL.FB", "IL.CMD"])
    assert reader.read(path, []) == {}
    path.write_text("a;b\n1;2\n")
    with pytest.raises(InputError, match="does not begin as any profile states"):
        reader.read_header(path)


def test_a_file_without_the_names_that_its_profile_expects_is_refused(
    tmp_path: Path, own: Callable[[str], None]
) -> None:
    own(OWN)
    path = tmp_path / "a.csv"
    path.write_text(FILE.replace("Iq;PosX;Load", ";;"))
    with pytest.raises(InputError, match="has no names of columns where the profile axis-scope expects them"):
        reader_for(path).read_header(path)
