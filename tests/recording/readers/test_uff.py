from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.recording.readers.machine_files import function

from ballscrew.base.errors import InputError
from ballscrew.recording.readers import reader_for
from ballscrew.recording.readers.uff import UffReader

READER = UffReader()
X = np.linspace(-1.0, 1.0, 22)
PAIRS = np.stack([X * 2 + 2, X], axis=1).ravel()
UNITS = b"    -1\n   164\n%10d  system               2\n  1.0  1.0  1.0\n  2.7315E+02\n    -1\n"
UNEVEN = "         0  0.00000E+00  0.00000E+00  0.00000E+00"
NO_UNIT = "        %2d    0    0    0 NONE                 NONE                "


def binary(size: int, order: int = 1, kind: int = 2) -> str:
    return f"    58b{order:6}{kind:6}{11:12}{size:12}{0:6}{0:6}{0:12}{0:12}"


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "a.uff"


@pytest.mark.parametrize(
    ("values", "options"),
    [
        (X, {}),
        (X, {"head": binary(8 * 22)}),
        (X.astype(">f8"), {"head": binary(8 * 22, order=2)}),
        (X.astype("<f4"), {"head": binary(4 * 22), "kind": 2}),
    ],
)
def test_functions_of_time(path: Path, values: Any, options: dict[str, Any]) -> None:
    whole = function(values, **options)
    if not options:
        whole = b"\n" + whole.replace(b"\n", b"\r\n")
    path.write_bytes(whole)
    assert reader_for(path).name == "uff"
    header = READER.read_header(path)
    assert header.started_at == "2026-01-31T08:00:00"
    name = "NUT 3+X Acceleration"
    assert [(c.name, c.size, c.unit) for c in header.channels] == [(name, 22, "m/s^2")]
    assert header.channels[0].sample_rate == pytest.approx(1000.0)
    read = READER.read(path, [name])[name]
    np.testing.assert_allclose(read, X, rtol=0, atol=1e-7 if options.get("kind") == 2 else 1e-12)
    assert read.dtype == (np.float32 if options.get("kind") == 2 else np.float64)


@pytest.mark.parametrize("head", ["    58", binary(16 * 22)])
def test_uneven_times_are_a_channel(path: Path, head: str) -> None:
    path.write_bytes(function(PAIRS, head, spacing=UNEVEN))
    header = READER.read_header(path)
    name = "NUT 3+X Acceleration"
    assert [(c.name, c.unit, c.sample_rate) for c in header.channels] == [
        (name, "m/s^2", None),
        (f"{name} time", "s", None),
    ]
    values = READER.read(path, [name, f"{name} time"])
    np.testing.assert_allclose(values[name], X, atol=1e-12)
    np.testing.assert_allclose(values[f"{name} time"], 2 * X + 2, atol=1e-12)


def test_times_in_milliseconds(path: Path) -> None:
    abscissa = "        17    0    0    0 Time                 ms                  "
    path.write_bytes(function(X, abscissa=abscissa))
    assert READER.read_header(path).channels[0].sample_rate == pytest.approx(1e6)


@pytest.mark.parametrize(
    ("system", "kind", "unit"), [(1, 12, "m/s^2"), (5, 8, "mm"), (7, 13, "lbf"), (9, 12, None), (1, 1, None)]
)
def test_units_by_code(path: Path, system: int, kind: int, unit: str | None) -> None:
    path.write_bytes(UNITS % system + function(X, ordinate=NO_UNIT % kind))
    assert READER.read_header(path).channels[0].unit == unit


def test_names_are_unique_and_other_functions_are_left_out(path: Path) -> None:
    bare = "    1         0    0         0 NONE               0   0 NONE               0   0"
    complex_one = function(np.repeat(X, 2), kind=6).replace(b"        44", b"        22", 1)
    spectrum = function(X, abscissa="        18    0    0    0 Frequency            Hz                  ")
    path.write_bytes(
        function(X)
        + complex_one
        + spectrum
        + function(2 * X)
        + function(X, response=bare, ordinate=NO_UNIT % 1)
    )
    names = ["NUT 3+X Acceleration", "NUT 3+X Acceleration (2)", "Acceleration at the nut"]
    assert [c.name for c in READER.read_header(path).channels] == names
    np.testing.assert_allclose(READER.read(path, names)[names[1]], 2 * X, atol=1e-12)
    path.write_bytes(spectrum)
    with pytest.raises(InputError, match="has no real function of time; it has datasets 58"):
        READER.read_header(path)


def test_numbers_that_touch_each_other_and_exponents_of_fortran(path: Path) -> None:
    whole = function(-np.ones(4))
    path.write_bytes(whole.replace(b"-1.000000000000E+00 ", b"-1.000000000000D+00"))
    np.testing.assert_array_equal(
        READER.read(path, ["NUT 3+X Acceleration"])["NUT 3+X Acceleration"], -np.ones(4)
    )


TEXT = function(X)
BINARY = function(X, binary(8 * 22))


@pytest.mark.parametrize(
    ("content", "why"),
    [
        (TEXT[:-60], "the file is cut"),
        (TEXT[:-7], "the file is cut"),
        (BINARY[:-60], "the file is cut: it holds"),
        (BINARY[:-7], "the file is cut"),
        (TEXT.replace(b"        22", b"        23"), "holds 22 of 23 values"),
        (TEXT.replace(b"        22", b"4000000000"), "holds 22 of 4000000000 values"),
        (BINARY.replace(b"        22", b"        23"), "has 176 bytes and declares 23 values"),
        (BINARY.replace(b"         176", b"         168"), "longer than it says"),
        (BINARY.replace(b"         176", b"999999999999"), "the file is cut"),
        (function(X, binary(176, kind=1)), "not of IEEE 754"),
        (TEXT.replace(b"-1.000000000000E+00", b"-1.00000000000xE+00"), "other text than numbers"),
        (TEXT + b"rest", "is not the mark of a dataset"),
        (TEXT + b"    -1\nx\n    -1\n", "is not the number of a dataset"),
        (b"    -1\n    58\n    -1\n", "cannot be read as UFF"),
        (b"    -1\n    15\n    -1\n", "it has datasets 15"),
    ],
)
def test_damaged_files_are_refused(path: Path, content: bytes, why: str) -> None:
    path.write_bytes(content)
    assert reader_for(path).name == "uff"
    with pytest.raises(InputError, match=why):
        READER.read_header(path)


def test_a_channel_that_is_not_there(path: Path) -> None:
    path.write_bytes(TEXT)
    with pytest.raises(InputError, match="has no channel 'x'"):
        READER.read(path, ["x"])


FOREIGN = [
    ("sample-58b.uff", ("Mic 01 Pressure", 79292, "Pa", 1 / 1.52588e-05, -0.01475526, -0.004314689)),
    ("time-history-short-row.uff", ("1x", 13, "m/s²", 20000.0, -3.81956, -5.84096)),
]


def test_files_of_measuring_systems(data: Path) -> None:
    for name, expected in FOREIGN:
        path = data / "machine-files" / name
        (channel,) = READER.read_header(path).channels
        x = READER.read(path, [channel.name])[channel.name]
        found = (channel.name, channel.size, channel.unit, channel.sample_rate, x[0], x[-1])
        assert found == (*expected[:3], *(pytest.approx(value, rel=1e-6) for value in expected[3:]))


def test_a_function_whose_header_is_cut_is_refused(path: Path) -> None:
    lines = function(X).splitlines(keepends=True)
    path.write_bytes(b"".join(lines[:8] + lines[-1:] + lines))
    with pytest.raises(InputError, match="the header of a function is cut"):
        READER.read_header(path)


@pytest.mark.parametrize(
    ("unit", "rate"), [("ms", 1e6), ("min", 1000 / 60), ("parsec", 1000.0), ("", 1000.0)]
)
def test_a_unit_of_time_that_is_not_understood_is_the_second(path: Path, unit: str, rate: float) -> None:
    abscissa = f"        17    0    0    0 Time                 {unit:20}"
    path.write_bytes(function(X, abscissa=abscissa))
    assert READER.read_header(path).channels[0].sample_rate == pytest.approx(rate)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (b"31-Jan-69 08:00:00", "1969-01-31T08:00:00"),
        (b"31-Jan-68 08:00:00", "2068-01-31T08:00:00"),
        (b"31-Feb-26 08:00:00", None),
        (b"31-Jux-26 08:00:00", None),
        (b"NONE", None),
    ],
)
def test_a_start_that_is_no_time_is_not_known(path: Path, text: bytes, expected: str | None) -> None:
    path.write_bytes(function(X).replace(b"31-Jan-26 08:00:00", text))
    assert READER.read_header(path).started_at == expected
