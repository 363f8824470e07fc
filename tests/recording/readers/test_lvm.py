from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from tests.recording.readers.machine_files import measurement

from ballscrew.base.errors import InputError
from ballscrew.recording.readers import reader_for
from ballscrew.recording.readers.lvm import LvmReader

READER = LvmReader()
X = np.arange(20.0) / 8
HEAD = "LabVIEW Measurement\nSeparator\tComma\nMulti_Headings\tNo\nX_Columns\tOne\n***End_of_Header***\n\n"


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "a.lvm"


@pytest.mark.parametrize("decimal", [".", ","])
def test_channels_units_rates_and_start(path: Path, decimal: str) -> None:
    path.write_bytes(measurement([X, -X], decimal=decimal))
    assert reader_for(path).name == "lvm"
    header = READER.read_header(path)
    assert header.started_at == "2026-01-31T08:00:00.500000"
    assert [(c.name, c.size, c.unit) for c in header.channels] == [
        ("torque", 20, "N m"),
        ("position", 20, "mm"),
    ]
    assert [c.sample_rate for c in header.channels] == [pytest.approx(1000.0, rel=1e-12)] * 2
    values = READER.read(path, ["position", "torque"])
    np.testing.assert_array_equal(values["torque"], X)
    np.testing.assert_array_equal(values["position"], -X)


def test_several_segments(path: Path) -> None:
    one = measurement([X, -X], ends="\n")
    path.write_bytes(one + one[one.index(b"Channels") :].replace(b"8:00:00.5", b"7:00:00.5"))
    header = READER.read_header(path)
    assert [c.name for c in header.channels] == [
        f"segment {n}/{c}" for n in (1, 2) for c in ("torque", "position")
    ]
    assert header.started_at == "2026-01-31T07:00:00.500000"
    np.testing.assert_array_equal(READER.read(path, ["segment 2/torque"])["segment 2/torque"], X)


def test_times_comments_unequal_lengths_and_empty_cells(path: Path) -> None:
    table = ["Channels,3", "Samples,5,3,0,5", "Y_Unit_Label,V,,V,°C", "X_Dimension,Time,Time,Time,Time",
             "Delta_X,0.5,0.5,0.5,0.5", "***End_of_Header***", "X_Value,a,b,absent,a,Comment",
             "0.0,1,10,,5,begin", "0.5,2,20,,6", "1.0,,30,,7", "1.5,4,,,8", "2.0,5,,,9,end", ""]  # fmt: skip
    path.write_bytes((HEAD + "\n".join(table)).encode("latin-1"))
    header = READER.read_header(path)
    assert [(c.name, c.size, c.unit, c.sample_rate) for c in header.channels] == [
        ("X_Value", 5, "s", None),
        ("a", 5, "V", 2.0),
        ("b", 3, None, 2.0),
        ("a (2)", 5, "°C", 2.0),
    ]
    values = READER.read(path, ["X_Value", "a", "b", "a (2)"])
    np.testing.assert_array_equal(values["X_Value"], [0, 0.5, 1, 1.5, 2])
    np.testing.assert_array_equal(values["a"], [1, 2, np.nan, 4, 5])
    np.testing.assert_array_equal(values["b"], [10, 20, 30])


@pytest.mark.parametrize(
    ("old", "new"),
    [("Delta_X,0.5", "Delta_X,0.4"), ("Dimension,Time", "Dimension,Frequency"), ("Delta_X,0.5", "Delta_X,0")],
)
def test_a_rate_that_does_not_agree_is_not_listed(path: Path, old: str, new: str) -> None:
    table = "Channels,1\nX_Dimension,Time\nDelta_X,0.5\n***End_of_Header***\nX_Value,a\n0,1\n0.5,2\n1,3\n"
    path.write_text(HEAD + table)
    assert READER.read_header(path).channels[1].sample_rate == 2.0
    path.write_text(HEAD + table.replace(old, new))
    assert READER.read_header(path).channels[1].sample_rate is None


@pytest.mark.parametrize(
    ("content", "why"),
    [
        (measurement([X, X])[:-5], "in the middle of a line"),
        (measurement([X, X])[:-26], "in the middle of a line"),
        (measurement([X, X])[:-28], "holds 19 of 20 samples"),
        (measurement([X, X])[:100], "in the middle of a line"),
        (measurement([X, X])[:100] + b"\n", "cut in a header"),
        (measurement([X, X]).replace(b"2.250000000", b"2.25x", 1), "has '2.25x' in place of a number"),
        (measurement([X, X]).replace(b"Separator\t.", b"Separator\t;"), "decimal mark is ';'"),
        (b"LabVIEW Measurement", "in the middle of a line"),
        (b"LabVIEW Measurement\n", "cut in a header"),
        (b"LabVIEW Measurement\n***End_of_Header***\n\n***Start_Special***\n", "cannot be read as LVM"),
    ],
)
def test_damaged_files_are_refused(path: Path, content: bytes, why: str) -> None:
    path.write_bytes(content)
    with pytest.raises(InputError, match=why):
        READER.read_header(path)


def test_a_channel_that_is_not_there(path: Path) -> None:
    path.write_bytes(measurement([X, X]))
    with pytest.raises(InputError, match="has no channel 'X_Value'"):
        READER.read(path, ["X_Value"])


FOREIGN: list[tuple[str, dict[str, tuple[object, ...]]]] = [
    ("short.lvm", {"Excitation (Trigger)": (10, "Newtons", 25600.0, 0.914018, 0.680572)}),
    ("multi-time-column.lvm", {"Acceleration": (3, "g", 51200.0, 0.532608, 0.467541)}),
]


def test_files_of_labview(data: Path) -> None:
    for name, expected in FOREIGN:
        path = data / "machine-files" / name
        header = READER.read_header(path)
        for channel in header.channels:
            if channel.name in expected:
                x = READER.read(path, [channel.name])[channel.name]
                assert (x.size, channel.unit, channel.sample_rate, x[0], x[-1]) == expected[channel.name]
        assert expected.keys() <= {channel.name for channel in header.channels}
