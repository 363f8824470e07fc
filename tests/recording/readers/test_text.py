"""Dialects of text tables: each row of the table below is a file that some logger writes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from ballscrew.base.errors import InputError
from ballscrew.recording.readers import reader_for
from ballscrew.recording.readers.labels import split_label
from ballscrew.recording.readers.process import opened
from ballscrew.recording.readers.text import TextReader

READER = TextReader()
N = 20


def rows(pattern: str, *, comma: bool = False, end: str = "\n", count: int = N) -> str:
    lines = [pattern.format(i, i + 0.5) for i in range(count)]
    return end.join(line.replace(".", ",") if comma else line for line in lines) + end


DIALECTS = {
    "comma": ("a,b\n" + rows("{0},{1}"), ["a", "b"]),
    "comma and blank": ("a, b\n" + rows("{0}, {1}"), ["a", "b"]),
    "semicolon, decimal comma": ("a;b\n" + rows("{0};{1}", comma=True), ["a", "b"]),
    "tab, decimal comma": ("a\tb\n" + rows("{0}\t{1}", comma=True), ["a", "b"]),
    "bar": ("a|b\n" + rows("{0}|{1}"), ["a", "b"]),
    "blanks": ("a  b\n" + rows("  {0}   {1} "), ["a", "b"]),
    "blanks, decimal comma": ("a b\n" + rows("{0} {1}", comma=True), ["a", "b"]),
    "blanks and tabs": ("a b\n" + rows(" {0} \t {1}"), ["a", "b"]),
    "no titles": (rows("{0},{1}"), ["column_1", "column_2"]),
    "titles in a comment": ("# made by hand\n# a b\n" + rows("{0} {1}"), ["a", "b"]),
    "titles in a comment of %": ("%a,b\n" + rows("{0},{1}"), ["a", "b"]),
    "titles with blanks": ("my a [mm] my b [Nm]\n" + rows("{0} {1}"), None),
    "quotes": ('"a","b"\n' + rows('"{0}","{1}"'), ["a", "b"]),
    "quoted decimal comma": ("a,b\n" + rows('"{0}","{1}"', comma=True), ["a", "b"]),
    "Windows": ("a;b\r\n" + rows("{0};{1}", end="\r\n"), ["a", "b"]),
    "old Macintosh": ("a;b\r" + rows("{0};{1}", end="\r"), ["a", "b"]),
    "spreadsheet's hint": ("sep=;\na;b\n" + rows("{0};{1}", comma=True), ["a", "b"]),
    "empty lines at the end": ("a;b\n" + rows("{0};{1}") + "\n" * 5000 + ";\n" * 5000, ["a", "b"]),
    "comments between": (
        "a;b\n" + rows("{0};{1}", count=N - 1) + f"# pause\n\n+{N - 1};{N - 0.5}\n",
        ["a", "b"],
    ),
    "exponents": ("a;b\n" + rows("{0}e0;{1}E+00"), ["a", "b"]),
    "same titles": ("a;a\n" + rows("{0};{1}"), ["a", "a_2"]),
    "preamble": ("Machine;DMG\nOperator;A. B.\n\na;b\n" + rows("{0};{1}"), ["a", "b"]),
}


@pytest.mark.parametrize("name", DIALECTS)
@pytest.mark.parametrize("codec", ["utf-8", "utf-8-sig", "utf-16", "latin-1"])
def test_dialects(tmp_path: Path, name: str, codec: str) -> None:
    text, names = DIALECTS[name]
    path = tmp_path / "a.csv"
    path.write_bytes(text.encode(codec))
    assert reader_for(path).name == "text"
    header = READER.read_header(path)
    if names is not None:
        assert [channel.name for channel in header.channels] == names
    first, second = READER.read(path, [channel.name for channel in header.channels]).values()
    np.testing.assert_array_equal(first, np.arange(N))
    np.testing.assert_array_equal(second, np.arange(N) + 0.5)


@pytest.mark.parametrize(
    ("title", "unit"),
    [
        ("Torque [Nm]", "Nm"),
        ("Torque (Nm)", "Nm"),
        ("torque / N m", "N m"),
        ("t/s", "s"),
        ("Weg in mm", "mm"),
        ("a [m/s²]", "m/s²"),
        ("a [m/s^2]", "m/s^2"),
        ("T (°C)", "°C"),
        ("x [µm]", "µm"),
        ("speed (mm/s)", "mm/s"),
        ("position (actual)", None),
        ("acc[0]", None),
        ("v m/s", None),
        ("torque", None),
        ("a / b", None),
    ],
)
def test_unit_in_the_title(tmp_path: Path, title: str, unit: str | None) -> None:
    path = tmp_path / "a.csv"
    path.write_text(f"{title};b\n" + rows("{0};{1}"), encoding="utf-8")
    channel = READER.read_header(path).channels[0]
    assert (channel.name, channel.unit, channel.size) == (title, unit, N)


def test_row_of_units_rate_and_start_above_the_table(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    above = "Abtastrate: 12,8 kHz\nStart time;2026-01-31T08:00:00Z\n\nZeit;Weg;Drehmoment\n[ms];µm;Nm\n"
    path.write_bytes((above + rows("{0};{1};{0}", comma=True)).encode("latin-1"))
    header = READER.read_header(path)
    assert [(c.name, c.unit) for c in header.channels] == [
        ("Zeit", "ms"),
        ("Weg", "µm"),
        ("Drehmoment", "Nm"),
    ]
    assert (header.sample_rate, header.started_at) == (12800.0, "2026-01-31T08:00:00Z")


@pytest.mark.parametrize("cell", ["", "nan", "NaN", " NaN "])
def test_an_empty_cell_is_nan(tmp_path: Path, cell: str) -> None:
    path = tmp_path / "a.csv"
    path.write_text("a;b\n" + rows("{0};{1}") + f"{cell};7\n" + rows("{0};{1}"))
    values = READER.read(path, ["a", "b"])
    assert np.flatnonzero(np.isnan(values["a"])).tolist() == [N]
    assert values["b"][N] == 7


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("1;abc", f"line {N + 2}, column 'b' is 'abc'"),
        ("1;1.5x", "is '1.5x'"),
        ("1;1_000", "is '1_000'"),
        ("1;0x10", "is '0x10'"),
        ("1;1.000,5", "is '1.000,5'"),
        ("1;\x80\xff", f"line {N + 2}, column 'b'"),
        ("1", f"line {N + 2} has 1 cells; the table has 2 columns"),
        ("1;2;3", f"line {N + 2} has 3 cells"),
    ],
)
def test_a_bad_line_is_named(tmp_path: Path, line: str, message: str) -> None:
    path = tmp_path / "a.csv"
    path.write_bytes(("a;b\n" + rows("{0};{1}") + line + "\n" + rows("{0};{1}")).encode("latin-1"))
    with pytest.raises(InputError) as caught:
        READER.read(path, ["a", "b"])
    assert message in str(caught.value)


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize("pair", [("1", "1;2;3"), ('1;"2', '3";4')])
def test_a_short_line_before_a_long_line(tmp_path: Path, pair: tuple[str, str], end: str) -> None:
    path = tmp_path / "a.csv"
    lines = ["a;b", *["0.5;0"] * N, *pair, *["0.5;0"] * N]
    path.write_bytes(end.join([*lines, ""]).encode())
    with pytest.raises(InputError, match=f"line ({N + 2}|{N + 3})"):
        READER.read(path, ["a"])


def test_words_in_a_column_that_is_not_read(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("when,a,state\n" + rows("2026-01-31 08:00:00.1,{1},RUN"))
    np.testing.assert_array_equal(READER.read(path, ["a"])["a"], np.arange(N) + 0.5)
    with pytest.raises(InputError, match="column 'state' is 'RUN'"):
        READER.read(path, ["state"])


def test_the_decimal_comma_comes_late(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("a;b\n" + "0;0\n" * 1000 + "1,5;2\n")
    assert READER.read(path, ["a"])["a"][-1] == 1.5
    path.write_text("a;b\n" + "0;0\n" * 1000 + "1,5;2\n1.5;2\n")
    with pytest.raises(InputError, match=r"line 1003, column 'a' is '1\.5'"):
        READER.read(path, ["a"])


@pytest.mark.parametrize(
    "content", ["hello\nworld\n", "\n\n\n", "a,b\n", "# 1,2\n", "<html><body>1</body></html>"]
)
def test_no_table(tmp_path: Path, content: str) -> None:
    path = tmp_path / "a.csv"
    path.write_text(content)
    with pytest.raises(InputError, match="holds no table"):
        READER.read_header(path)


def test_zero_bytes_after_the_beginning(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_bytes(b"a;b\n" + b"1;2\n" * 3000 + b"1\x003;4\n")
    with pytest.raises(InputError, match="zero bytes"):
        READER.read(path, ["a"])


def test_a_hundred_thousand_columns(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    count = 100_000
    titles = ",".join(f"channel {i} [mm]" for i in range(count))
    path.write_text(titles + "\n" + "\n".join(",".join([f"{i}.5"] * count) for i in range(3)))
    header = READER.read_header(path)
    assert (len(header.channels), header.channels[-1].unit) == (count, "mm")
    assert READER.read(path, ["channel 99999 [mm]"])["channel 99999 [mm]"].tolist() == [0.5, 1.5, 2.5]


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    values=st.lists(st.tuples(*[st.floats(allow_infinity=False)] * 3), min_size=3, max_size=40),
    style=st.sampled_from([(";", "."), (";", ","), (",", "."), ("\t", ","), (" ", "."), (" ", ",")]),
)
def test_what_is_written_is_read(
    values: list[tuple[float, ...]], style: tuple[str, str], tmp_path: Path
) -> None:
    delimiter, decimal = style
    path = tmp_path / "a.csv"
    lines = [delimiter.join(repr(value).replace(".", decimal) for value in row) for row in values]
    path.write_text("one" + delimiter + "two" + delimiter + "three\n" + "\n".join(lines) + "\n")
    read = READER.read(path, ["one", "two", "three"])
    np.testing.assert_array_equal(np.array(list(read.values())).T, np.array(values))


def test_a_column_that_is_not_there_and_no_column(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text(DIALECTS["comma"][0])
    with pytest.raises(InputError, match="has no channel 'c'"):
        READER.read(path, ["a", "c"])
    assert READER.read(path, []) == {}


@pytest.mark.parametrize(
    ("titles", "names"),
    [
        ("a;b;", ["a", "b"]),
        ('"""a""";b', ["a", "b"]),
        ("x;x_2;x", ["x", "x_2", "x_3"]),
        ("x;x;x", ["x", "x_2", "x_3"]),
        ("x_2;x;x", ["x_2", "x", "x_3"]),
    ],
)
def test_titles_are_names_without_quotes_and_never_twice(
    tmp_path: Path, titles: str, names: list[str]
) -> None:
    path = tmp_path / "a.csv"
    row = ";".join(["{0}"] * len(names))
    path.write_text(f"{titles}\n{rows(row)}")
    assert [channel.name for channel in READER.read_header(path).channels] == names


def test_a_long_label_has_no_unit() -> None:
    assert split_label(" a [mm] ") == ("a", "mm")
    assert split_label(" " + "a" * 300 + " [mm] ") == ("a" * 300 + " [mm]", None)


def test_a_comma_that_separates_and_marks_decimals(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("Zeit [ms],Drehmoment [Nm],Weg [mm]\n" + "0,25,0,0003,1,5\n" * 50, encoding="utf-8")
    with pytest.raises(InputError, match="the heading has 3 names and the rows have 6 numbers"), opened(path):
        pass
    path.write_text("lathe, axis, x\n" + "1.5,2.5,3,4\n" * 50, encoding="utf-8")
    with opened(path) as source:
        assert len(source.header.channels) == 4
