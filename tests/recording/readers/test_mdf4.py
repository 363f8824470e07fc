from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.recording.readers.machine_files import Mdf

from ballscrew.base.errors import InputError
from ballscrew.recording.readers import mdf4 as module
from ballscrew.recording.readers import reader_for
from ballscrew.recording.readers.mdf4 import Mdf4Reader
from ballscrew.recording.readers.process import opened

READER = Mdf4Reader()
N = 120
LAYOUT = [("t", "<f8"), ("torque", "<i2"), ("position", ">f4"), ("bits", "u1"), ("invalid", "u1")]


def records(rate: float = 2000.0, size: int = N) -> NDArray[Any]:
    """Records with a time, two channels, a byte of bits and a byte of invalidation bits."""
    rows = np.zeros(size, dtype=LAYOUT)
    rows["t"] = 0.25 + np.arange(size) / rate
    rows["torque"] = np.arange(size) - 60
    rows["position"] = np.sqrt(np.arange(size))
    rows["bits"] = np.arange(size) % 7 << 3
    rows["invalid"] = 2 * (np.arange(size) % 10 == 4)
    return rows


def add_group(file: Mdf, rows: NDArray[Any], data: int | None = None, **torque: Any) -> None:
    """Group of the records, whose torque is 0.001 N m a count with an offset of 2 N m."""
    more = {"bits": 16, "unit": "N m", "conversion": file.conversion(1, 2.0, 0.001), **torque}
    at = file.channel("bits", 14, data_type=0, bits=6, unit="1")
    at = file.channel("position", 10, at, data_type=5, bits=32, unit="mm", flags=2, invalid=1)
    at = file.channel("torque", 8, at, data_type=2, **more)
    at = file.channel("t", 0, at, kind=2, sync=1, unit="s")
    data = file.add("DT", data=rows.tobytes()) if data is None else data
    file.group(at, data, rows.size, 15, invalidation=1)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    pytest.importorskip("asammdf")
    return tmp_path / "a.mf4"


@pytest.mark.parametrize("layout", ["plain", "compressed", "transposed", "list"])
def test_channels_units_rates_and_start(path: Path, layout: str) -> None:
    file, rows = Mdf(), records()
    content = rows.tobytes()
    blocks = {
        "plain": lambda: file.add("DT", data=content),
        "compressed": lambda: file.packed(content),
        "transposed": lambda: file.packed(content, rows.itemsize),
        "list": lambda: file.listed(file.packed(content[:800]), file.packed(content[800:], 32)),
    }
    add_group(file, rows, blocks[layout]())
    path.write_bytes(file.to_bytes())
    assert reader_for(path).name == "mdf4"
    with opened(path) as read:  # in the process that can neither write nor open another file
        header = read.header
        values = read.read(["torque", "position", "bits"])
    assert header.started_at == "2026-01-31T08:00:00.250000+00:00"
    found = [(c.name, c.size, c.unit, c.sample_rate, c.start) for c in header.channels]
    assert found == [
        ("torque", N, "N m", pytest.approx(2000.0, rel=1e-12), 0.0),
        ("position", N, "mm", pytest.approx(2000.0, rel=1e-12), 0.0),
        ("bits", N, "1", pytest.approx(2000.0, rel=1e-12), 0.0),
    ]
    np.testing.assert_allclose(values["torque"], 2 + 0.001 * rows["torque"], rtol=1e-15)
    expected = np.where(rows["invalid"] == 2, np.nan, rows["position"].astype(float))
    np.testing.assert_array_equal(values["position"], expected)
    np.testing.assert_array_equal(values["bits"], rows["bits"] & 63)


def test_groups_have_their_own_rates_and_starts(path: Path) -> None:
    file = Mdf()
    add_group(file, records(250.0, 40))
    later = records(4000.0)
    later["t"] += 0.5
    add_group(file, later)
    path.write_bytes(file.to_bytes())
    channels = {channel.name: channel for channel in READER.read_header(path).channels}
    assert list(channels)[::3] == ["torque", "torque (2)"]
    assert [channels[name].start for name in ("torque", "torque (2)")] == [0.5, 0.0]
    assert channels["torque (2)"].sample_rate == pytest.approx(250.0, rel=1e-12)
    assert READER.read(path, ["torque (2)"])["torque (2)"].size == 40


def test_a_virtual_master_is_the_index_with_a_conversion(path: Path) -> None:
    file = Mdf()
    at = file.channel("torque", 0, unit="N m")
    clock = file.conversion(1, 0.0, 1 / 8000)
    at = file.channel("t", 0, at, kind=3, sync=1, bits=0, data_type=0, conversion=clock)
    file.group(at, file.add("DT", data=np.arange(50.0).tobytes()), 50, 8)
    path.write_bytes(file.to_bytes())
    (channel,) = READER.read_header(path).channels
    assert (channel.name, channel.size) == ("torque", 50)
    assert channel.sample_rate == pytest.approx(8000.0, rel=1e-12)


def test_an_absent_record_is_missing(path: Path) -> None:
    file, rows = Mdf(), np.delete(records(), [30, 31])
    add_group(file, rows)
    path.write_bytes(file.to_bytes())
    assert READER.read_header(path).channels[0].size == N
    torque = READER.read(path, ["torque"])["torque"]
    assert np.flatnonzero(np.isnan(torque)).tolist() == [30, 31]
    assert torque[-1] == pytest.approx(2.059)


def test_irregular_times_are_a_channel(path: Path) -> None:
    file, rows = Mdf(), records()
    rows["t"] += 2e-4 * np.sin(np.arange(N) ** 2)
    add_group(file, rows)
    path.write_bytes(file.to_bytes())
    header = READER.read_header(path)
    assert [(c.name, c.sample_rate) for c in header.channels[:2]] == [("t", None), ("torque", None)]
    np.testing.assert_array_equal(READER.read(path, ["t"])["t"], rows["t"])


@pytest.mark.parametrize(
    ("kind", "values", "expected"),
    [
        (2, (1.0, 0.0, 3.0, 0.0, 0.0, 2.0), lambda x: (x**2 + 3) / 2),
        (4, (-60.0, 0.0, 0.0, 1.0, 59.0, 5.0), lambda x: np.interp(x, [-60, 0, 59], [0, 1, 5])),
    ],
)
def test_conversions_of_whole_numbers(
    path: Path, kind: int, values: tuple[float, ...], expected: Any
) -> None:
    file, rows = Mdf(), records()
    rows["torque"] *= 4 if kind == 2 else 1  # whose square has more than 15 bits
    add_group(file, rows, conversion=file.conversion(kind, *values))
    path.write_bytes(file.to_bytes())
    torque = READER.read(path, ["torque"])["torque"]
    np.testing.assert_allclose(torque, expected(rows["torque"].astype(float)), rtol=1e-14)


def test_a_formula_is_not_executed(path: Path) -> None:
    file = Mdf()
    add_group(file, records(), conversion=file.conversion(3, refs=[file.text("X*2")]))
    path.write_bytes(file.to_bytes())
    assert [channel.name for channel in READER.read_header(path).channels] == ["position", "bits"]


def damaged(what: str) -> bytes:
    file, rows = Mdf(), records()
    if what == "cut":
        add_group(file, rows, file.add("DT", data=rows[:-5].tobytes()))
    elif what == "record":
        add_group(file, rows, bits=160)
    elif what == "length":
        add_group(file, rows, file.packed(rows.tobytes(), declared=rows.nbytes - 30))
    else:
        add_group(file, rows)
    whole = file.to_bytes()
    if what == "unfinished":
        return b"UnFinMF " + whole[8:]
    if what == "count":
        return whole.replace(N.to_bytes(8, "little"), (1 << 60).to_bytes(8, "little"))
    return whole


@pytest.mark.parametrize(
    ("what", "why"),
    [
        ("cut", "the file is cut"),
        ("record", "'torque' lies outside its record"),
        ("length", "cannot be read as MDF"),
        ("unfinished", "it was not finalised; open and save it in the program that wrote it"),
        ("count", "declares 9223372036854775808 bytes"),
    ],
)
def test_damaged_files_are_refused(path: Path, what: str, why: str) -> None:
    path.write_bytes(damaged(what))
    with pytest.raises(InputError, match=why):
        READER.read_header(path)
    with pytest.raises(InputError, match=why):
        READER.read(path, ["torque"])


@pytest.mark.parametrize("part", [0.4, 0.8, 0.99])
def test_a_file_that_is_cut_off_says_so(path: Path, part: float) -> None:
    whole = damaged("nothing")
    path.write_bytes(whole[: int(part * len(whole))])
    with pytest.raises(InputError, match="ends too early: it is cut off or damaged; copy or export it again"):
        READER.read_header(path)


def test_the_library_itself_is_left_unchanged(path: Path) -> None:
    from asammdf.blocks import mdf_v4

    names = ("MDF4", "NamedTemporaryFile")
    before = [getattr(mdf_v4, name) for name in names]
    path.write_bytes(damaged("nothing"))
    READER.read_header(path)
    assert [getattr(mdf_v4, name) for name in names] == before
    assert "tempfile" in before[1].__module__
    assert before[0].__del__.__module__ == mdf_v4.__name__


def test_a_channel_that_is_not_there(path: Path) -> None:
    path.write_bytes(damaged("nothing"))
    with pytest.raises(InputError, match="has no channel 'speed'"):
        READER.read(path, ["speed"])


def test_without_the_library(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "MDF", None)
    (tmp_path / "a.mf4").write_bytes(damaged("nothing"))
    with pytest.raises(InputError, match=r'asammdf reads: pip install "ballscrew\[mdf4\]"'):
        READER.read_header(tmp_path / "a.mf4")


def test_channels_that_have_no_number_in_each_record_are_omitted(path: Path) -> None:
    """Texts, and samples whose length varies or that another channel counts."""
    file = Mdf()
    at = file.channel("text", 16, data_type=7)
    at = file.channel("long", 8, at, kind=1, data_type=0)
    at = file.channel("torque", 0, at, unit="N m")
    rows = np.stack([np.arange(50.0)] * 3, axis=1)
    file.group(at, file.add("DT", data=rows.tobytes()), 50, 24)
    path.write_bytes(file.to_bytes())
    (channel,) = READER.read_header(path).channels
    assert (channel.name, channel.size, channel.sample_rate) == ("torque", 50, None)  # no master of time
    np.testing.assert_array_equal(READER.read(path, ["torque"])["torque"], np.arange(50.0))


def test_a_channel_whose_samples_are_all_invalid_is_missing(path: Path) -> None:
    file = Mdf()
    add_group(file, records(), flags=1)
    path.write_bytes(file.to_bytes())
    values = READER.read(path, ["torque", "bits"])
    assert np.isnan(values["torque"]).all()
    assert values["torque"].shape == (N,)
    assert np.isfinite(values["bits"]).all()


@pytest.mark.parametrize("times", [[np.nan, 1.0, 2.0], [0.0], [0.0, np.inf, 1.0]])
def test_without_two_finite_times_there_is_no_rate(path: Path, times: list[float]) -> None:
    file, rows = Mdf(), records(size=len(times))
    rows["t"] = times
    add_group(file, rows)
    path.write_bytes(file.to_bytes())
    channels = {channel.name: channel for channel in READER.read_header(path).channels}
    assert channels["torque"].sample_rate is None
    assert READER.read(path, ["torque"])["torque"].size == len(times)


@pytest.mark.parametrize(
    ("start", "expected"), [(0, None), (2**64 - 1, "2554-"), (10**9, "1970-01-01T00:00:01")]
)
def test_a_start_that_was_not_stored_is_not_known(path: Path, start: int, expected: str | None) -> None:
    file = Mdf(start)
    add_group(file, records())
    path.write_bytes(file.to_bytes())
    found = READER.read_header(path).started_at
    assert found is None if expected is None else str(found).startswith(expected)


def test_a_start_that_no_calendar_has_is_not_known() -> None:
    header = SimpleNamespace(abs_time=10**30, time_flags=0)
    assert module._started_at(header) is None


def test_a_group_with_its_times_in_another_group_has_those(path: Path) -> None:
    path.write_bytes(damaged("nothing"))
    with module._opened(path) as file:
        (group,) = file.groups
        remote = SimpleNamespace(
            channel_group=SimpleNamespace(flags=module._REMOTE_MASTER, cg_master_index=0), channels=[]
        )
        file.mdf.groups.append(remote)
        times = module._times(path, file.mdf, 1, N)
        assert times is not None
        assert group.times is not None
        assert times.interval == group.times.interval == pytest.approx(1 / 2000)
