from __future__ import annotations

from collections.abc import Callable
from itertools import zip_longest
from pathlib import Path

import numpy as np
import pytest

from ballscrew.base.errors import InputError
from ballscrew.recording.readers import reader_for
from ballscrew.recording.readers.process import opened
from ballscrew.recording.readers.twincat import TwinCatReader

START = 132959733843760000  # 2022-05-02 13:56:24.376 UTC


def scope(rows: list[list[str]], *, separator: str = "\t", scale: str = "1") -> str:
    """An export of a current at 0.5 ms, beside position and speed, which share a time column at 1 ms."""
    head = [
        ["Name", "axis"],
        ["File", r"C:\axis.svdx"],
        ["Starttime of export", str(START), "Montag, 2. Mai 2022", "15:56:24.376"],
        ["Endtime of export", str(START), "Montag, 2. Mai 2022", "15:56:25.375"],
        [],
        ["Name", "current", "Name", "position", "speed"],
        ["SymbolComment", "", "SymbolComment"],
        ["SampleTime[ms]", "0,5", "SampleTime[ms]", "1", "1"],
        ["Unit", "A (Current)", "Unit", "mm (Length)", "(None)"],
        ["ScaleFactor", scale, "ScaleFactor", "1", "1"],
        [],
    ]
    return "\n".join(separator.join(row) for row in [*head, *rows]) + "\n"


SCALED = {
    "default": ["func_scaled", "func_scaled_int", "func_units_scaled"],
    "decimal-comma": ["func_units_scaled", "func_scaled_int", "func_scaled"],
}

ROWS = [
    ["0", "1.5", "0.5", "100", "7"],
    ["0.5", "2", "1.5", "101", "8"],
    ["1", "2.5", "2.5", "102.25", " "],
    ["2", "3"],
]


def ticks(milliseconds: float) -> str:
    return str(START + round(1e4 * milliseconds))


FULL = [  # with full timestamps
    [ticks(0), "1.5", ticks(0.5), "100", "7"],
    [ticks(0.5), "2", ticks(1.5), "101", "8"],
    [ticks(1), "2.5", ticks(2.5), "102.25"],
    [ticks(2), "3"],
]


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "scope.csv"


def comma(rows: list[list[str]]) -> list[list[str]]:
    return [[cell.replace(".", ",") for cell in row] for row in rows]


@pytest.mark.parametrize(
    "text",
    [
        scope(ROWS),
        scope(comma(ROWS)),
        scope(ROWS, separator=";").replace("\n", "\r\n"),
        scope(comma(ROWS), separator=":"),
        scope([*ROWS, ["EOF"]]),
        "\ufeff" + scope(ROWS),
        scope(FULL),
    ],
)
def test_each_channel_has_its_own_times(path: Path, text: str) -> None:
    path.write_text(text, encoding="utf-8", newline="")
    assert reader_for(path).name == "twincat-scope"
    with opened(path) as file:
        header, values = file.header, file.read(["current", "position", "speed"])
    assert header.started_at == "2022-05-02T13:56:24.376000+00:00"
    assert [(c.name, c.unit, c.size) for c in header.channels] == [
        ("current", "A", 5),
        ("position", "mm", 3),
        ("speed", None, 2),
    ]
    assert [c.sample_rate for c in header.channels] == [2000.0, 1000.0, 1000.0]
    assert [c.start for c in header.channels] == pytest.approx([0.0, 0.0005, 0.0005], abs=2e-6)
    np.testing.assert_array_equal(values["current"], [1.5, 2, 2.5, np.nan, 3])
    np.testing.assert_array_equal(values["position"], [100, 101, 102.25])
    np.testing.assert_array_equal(values["speed"], [7, 8])


@pytest.mark.parametrize(("step", "nan"), [(0.001, 0), (None, 40)])
def test_a_signal_in_steps_without_equal_neighbours_was_written_on_change(
    path: Path, step: float | None, nan: int
) -> None:
    """The same samples are lost in a signal without steps, in which no two values are equal."""
    values = np.cumsum(np.tile([1, -1, 1, 0, -1, 0], 20)) * 0.001
    absent = np.flatnonzero(np.diff(values, prepend=np.nan) == 0)
    if step is None:
        values = np.random.default_rng(0).normal(size=values.size).round(6)
    cells = [["0", "0", f"{time}", f"{value:.6f}", "1"] for time, value in enumerate(values)]
    text = scope([row for time, row in enumerate(cells) if time not in absent])
    path.write_text(text.replace("\t0.5\t", "\t1\t"))
    read = TwinCatReader().read(path, ["position"])["position"]
    assert np.isnan(read).sum() == nan - (absent[-1] == len(values) - 1 and nan > 0)
    if not nan:
        np.testing.assert_allclose(read, values[: len(read)], atol=1e-9)


@pytest.mark.parametrize(("repeated", "nan"), [(1, 0), (6, 0), (400, 399)])
def test_a_few_repeated_values_do_not_hide_that_a_signal_was_written_on_change(
    path: Path, repeated: int, nan: int
) -> None:
    """As many equal neighbours as single steps are those of a signal of which each sample was recorded."""
    values = np.cumsum(np.tile([1, -1, 1, 0, -1, 0], 400)) * 0.001
    equal = np.flatnonzero(np.diff(values) == 0) + 1
    absent = equal[repeated:]
    cells = [["0", "0", f"{time}", f"{value:.6f}", "1"] for time, value in enumerate(values)]
    text = scope([row for time, row in enumerate(cells) if time not in absent])
    path.write_text(text.replace("\t0.5\t", "\t1\t"))
    read = TwinCatReader().read(path, ["position"])["position"]
    assert np.isnan(read).sum() == nan
    if not nan:
        np.testing.assert_allclose(read, values[: len(read)], atol=1e-9)


@pytest.mark.parametrize(("beside", "nan"), [("on change", 0), ("recorded", 99)])
def test_a_signal_with_one_rest_is_written_as_another_of_its_file(path: Path, beside: str, nan: int) -> None:
    """One gap proves nothing: samples may have been lost while the axis rested."""
    random = np.random.default_rng(0)
    move = 100.0 + np.cumsum(random.integers(50, 90, 600))
    values = 0.001 * np.concatenate([move, np.full(99, move[-1]), move[-1] - 40 + move[0] - move])
    torque = np.cumsum(random.integers(-1, 2, values.size))
    shown = np.flatnonzero(np.diff(values, prepend=0))
    steps = np.arange(values.size)
    if beside == "on change":
        steps = np.flatnonzero(np.diff(torque, prepend=-9))
    currents = [[f"{0.5 * time}", f"{torque[time]}"] for time in steps]
    places = [[f"{time}", f"{values[time]:.3f}", "1"] for time in shown]
    cells = zip_longest(currents, places, fillvalue=["", ""])
    path.write_text(scope([[*current, *place] for current, place in cells]))
    read = TwinCatReader().read(path, ["position"])["position"]
    assert np.isnan(read).sum() == nan


@pytest.mark.parametrize("at_rest", [True, False])
def test_a_signal_that_lacks_samples_only_at_rest_was_written_on_change(path: Path, at_rest: bool) -> None:
    """Where it moves by many steps a sample, hardly any neighbours differ by one."""
    steps = np.random.default_rng(0).integers(50, 90, (6, 65))
    steps[:, 50:64], steps[:, 64] = 0, 1  # a rest, and one step
    values = 0.001 * np.cumsum(steps)
    absent = np.flatnonzero(np.diff(values, prepend=np.nan) == 0)
    if not at_rest:
        absent = np.arange(5, values.size, 40)
    rows = [["0", "0", f"{time}", f"{values[time]:.6f}", "1"] for time in range(values.size)]
    text = scope([row for time, row in enumerate(rows) if time not in absent])
    path.write_text(text.replace("\t0.5\t", "\t1\t"))
    read = TwinCatReader().read(path, ["position"])["position"]
    assert np.isnan(read).sum() == (0 if at_rest else absent.size)


def test_a_channel_with_a_scale_asks_for_it(path: Path) -> None:
    """The same scale stands above scaled and unscaled values."""
    path.write_text(scope(ROWS, scale="-0,5"))
    assert [c.scaled for c in TwinCatReader().read_header(path).channels] == [False, True, True]


def test_the_longest_channel_may_be_the_last(path: Path) -> None:
    path.write_text(scope([["0", "1", "0", "2", "3"], [" ", " ", "1", "4", "5"]]))
    values = TwinCatReader().read(path, ["current", "speed"])
    assert [values["current"].tolist(), values["speed"].tolist()] == [[1.0], [3.0, 5.0]]


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (scope(ROWS, separator=","), "export it with tabs or semicolons"),
        (scope([]), "no row of numbers"),
        (scope(ROWS).replace("Name\tcurrent", "Channel\tcurrent"), "no row of numbers|no column of times"),
        (scope([["0", "1", "0", "x", "1"]]), "column 'position' is 'x'"),
        (scope([["0", "1", "0", "1", "1", "9"]]), "has 6 cells; the table has 5 columns"),
        (scope([["0", "1"]]), "'position' has no value"),
        (scope([["0", "1", "", "1", "1"]]), "values without a time"),
        (scope([["0", "1", "0", "1", "1"], ["0.7", "1", "1", "1", "1"]]), "no multiple of its interval"),
        (scope([["0", "1", "0", "1", "1"], ["0", "1", "1", "1", "1"]]), "do not increase"),
        (scope([["0", "1", "0", "1", "1"], ["1e9", "1", "1", "1", "1"]]), "a file of this size can hold"),
    ],
)
def test_a_damaged_export_is_one_sentence(path: Path, text: str, reason: str) -> None:
    path.write_text(text)
    with pytest.raises(InputError, match=reason):
        TwinCatReader().read_header(path)


def test_a_changed_byte_is_a_recording_or_one_sentence(path: Path, survives: Callable[[Path], bool]) -> None:
    raw = scope(ROWS).encode()
    generator = np.random.default_rng(0)
    places, values = generator.integers(0, len(raw), 300), generator.integers(0, 256, 300)
    for position, byte in zip(places, values, strict=True):
        path.write_bytes(raw[:position] + bytes([byte]) + raw[position + 1 :])
        survives(path)


def test_real_exports(data: Path) -> None:
    """Counters of 1 ms, and one of 0.2 ms that begins as late; one of 5 ms begins 3 ms before the others."""
    for name in ("default", "decimal-comma"):
        path = data / "machine-files" / f"twincat-scope-{name}.csv"
        channels = {channel.name: channel for channel in TwinCatReader().read_header(path).channels}
        assert len(channels) == 21
        assert (channels["func_units_unscaled"].unit, channels["func_units_scaled"].unit) == ("V", "dV")
        assert [key for key, channel in channels.items() if not channel.scaled] == SCALED[name]
        values = TwinCatReader().read(path, ["var_REAL64", "func_OS", "func_freesample"])
        np.testing.assert_array_equal(values["var_REAL64"], np.arange(1000.0))
        np.testing.assert_allclose(values["func_OS"], np.arange(4996) / 5, rtol=1e-12)
        assert channels["func_OS"].sample_rate == 5000.0
        assert channels["func_freesample"].start == 0.0
        assert channels["var_REAL64"].start == pytest.approx(0.003)
        np.testing.assert_array_equal(values["func_freesample"][1:], np.arange(2, 1000, 5.0))


def test_a_start_that_no_calendar_has_is_not_known(path: Path) -> None:
    path.write_text(scope(ROWS).replace(str(START), "9" * 19))
    header = TwinCatReader().read_header(path)
    assert (header.started_at, len(header.channels)) == (None, 3)


def test_a_channel_that_is_not_there_and_another_file(path: Path) -> None:
    path.write_text(scope(ROWS))
    with pytest.raises(InputError, match="has no channel 'speed 2'"):
        TwinCatReader().read(path, ["speed", "speed 2"])
    path.write_text("a;b\n1;2\n")
    with pytest.raises(InputError, match="does not begin as an export of TwinCAT Scope"):
        TwinCatReader().read_header(path)
