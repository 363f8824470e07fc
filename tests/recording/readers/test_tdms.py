from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.recording.readers.machine_files import tdms

from ballscrew.base.errors import InputError
from ballscrew.recording.readers import reader_for
from ballscrew.recording.readers import tdms as module
from ballscrew.recording.readers.tdms import TdmsReader

READER = TdmsReader()
X = np.linspace(-1.0, 1.0, 24)
WAVEFORM = {"wf_increment": 0.0005, "wf_start_time": 3_852_691_200, "unit_string": "N m"}
AT = "2026-01-31T08:00:00"


@pytest.fixture
def path(tmp_path: Path) -> Path:
    pytest.importorskip("nptdms")
    return tmp_path / "a.tdms"


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("layout", [{}, {"interleaved": True}, {"chunks": 3}])
def test_channels_units_rates_and_start(path: Path, order: str, layout: dict[str, Any]) -> None:
    path.write_bytes(tdms({"torque": X, "position": 2 * X}, properties=WAVEFORM, order=order, **layout))
    assert reader_for(path).name == "tdms"
    header = READER.read_header(path)
    assert header.started_at == f"{AT}.000000+00:00"
    found = [(c.name, c.size, c.unit, c.sample_rate, c.start, c.scaled) for c in header.channels]
    assert found == [
        ("g/torque", 24, "N m", 2000.0, None, True),
        ("g/position", 24, "N m", 2000.0, None, True),
    ]
    values = READER.read(path, ["g/position", "g/torque"])
    np.testing.assert_array_equal(values["g/torque"], X)
    np.testing.assert_array_equal(values["g/position"], 2 * X)


def test_segments_follow_each_other_and_may_begin_at_different_times(path: Path) -> None:
    later = WAVEFORM | {"wf_start_time": 3_852_691_202, "wf_start_offset": 0.5}
    path.write_bytes(
        tdms({"a": X}, properties=WAVEFORM) + tdms({"a": -X}) + tdms({"b": X[:5]}, properties=later)
    )
    header = READER.read_header(path)
    assert [(c.name, c.size, c.start) for c in header.channels] == [("g/a", 48, 0.0), ("g/b", 5, 2.5)]
    np.testing.assert_array_equal(READER.read(path, ["g/a"])["g/a"], [*X, *-X])


def test_scaling_of_ni(path: Path) -> None:
    scale: dict[str, Any] = {
        "NI_Scaling_Status": "unscaled",
        "NI_Scale[0]_Scale_Type": "Linear",
        "NI_Scale[0]_Linear_Slope": 3.0,
        "NI_Scale[0]_Linear_Y_Intercept": 1.0,
    }
    path.write_bytes(tdms({"a": X}, properties=scale))
    assert READER.read_header(path).channels[0].scaled
    np.testing.assert_allclose(READER.read(path, ["g/a"])["g/a"], 3 * X + 1, atol=1e-15)
    path.write_bytes(tdms({"a": X}, properties=scale | {"NI_Scale[0]_Scale_Type": "other"}))
    assert not READER.read_header(path).channels[0].scaled


WHOLE = tdms({"a": X, "b": X})


@pytest.mark.parametrize(
    ("content", "why"),
    [
        (WHOLE[:-8], "the file is cut: it holds"),
        (WHOLE[:20], "byte 0 is not the start of a segment"),
        (WHOLE + WHOLE[:100], "the file is cut: it holds"),
        (WHOLE + b"TDSm", f"byte {len(WHOLE)} is not the start"),
        (WHOLE[:12] + b"\xff" * 8 + WHOLE[20:], "never completed"),
        (WHOLE[:20] + b"\xff" * 8 + WHOLE[28:], "the file is cut"),
        # A segment that says that it is shorter, and one whose last chunk is not complete.
        (
            WHOLE[:12] + (len(WHOLE) - 36).to_bytes(8, "little") + WHOLE[20:-8],
            "samples of a segment are not complete",
        ),
        (WHOLE.replace(b"\x18\0\0\0\0\0\0\0", b"\xff\xff\xff\xff\xff\xff\xff\x7f"), "not complete"),
        (WHOLE.replace(b"\x04\0\0\0\x01", b"\xff\xff\xff\xff\x01", 1), "cannot be read as TDMS"),
    ],
)
def test_damaged_files_are_refused(path: Path, content: bytes, why: str) -> None:
    path.write_bytes(content)
    with pytest.raises(InputError, match=why):
        READER.read_header(path)
    with pytest.raises(InputError, match=why):
        READER.read(path, ["g/a"])


def test_an_index_file_beside_it_is_not_read(path: Path) -> None:
    path.write_bytes(WHOLE)
    path.with_name("a.tdms_index").write_bytes(b"TDSh" + WHOLE[4:-300])
    assert len(READER.read_header(path).channels) == 2


def test_a_channel_that_is_not_there(path: Path) -> None:
    path.write_bytes(WHOLE)
    with pytest.raises(InputError, match="has no channel 'a'"):
        READER.read(path, ["a"])


def test_without_the_library(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "TdmsFile", None)
    (tmp_path / "a.tdms").write_bytes(WHOLE)
    with pytest.raises(InputError, match=r'npTDMS reads: pip install "ballscrew\[tdms\]"'):
        READER.read_header(tmp_path / "a.tdms")


FOREIGN = [
    (
        "raw1.tdms",
        (
            "Layer Data/First  Channel",
            2000,
            "Volts",
            50000.0,
            -0.18402661214026306,
            0.0009155552842799158,
        ),
    ),
    ("big-endian.tdms", ("Measured Data/Amplitude sweep", 3500, None, 1000.0, 0.0, 5.067986572324634)),
]


def test_files_of_labview(data: Path) -> None:
    pytest.importorskip("nptdms")
    for name, expected in FOREIGN:
        path = data / "machine-files" / name
        channel = READER.read_header(path).channels[0]
        x = READER.read(path, [channel.name])[channel.name]
        assert (channel.name, x.size, channel.unit) == expected[:3]
        assert (channel.sample_rate, x[0], x[-1]) == pytest.approx(expected[3:], rel=1e-9)


class Channel:
    """As npTDMS gives one."""

    name = "a"

    def __init__(self, values: np.ndarray, declared: int) -> None:
        self.values, self.declared = values, declared

    def __len__(self) -> int:
        return self.declared

    def read_data(self) -> np.ndarray:
        return self.values


def test_time_stamps_are_seconds_since_the_first() -> None:
    stamps = np.datetime64("2026-01-31T08:00:00", "us") + np.array([0, 500, 1_000_000], dtype="m8[us]")
    np.testing.assert_allclose(module._values(Channel(stamps, 3)), [0.0, 5e-4, 1.0], rtol=1e-12)


def test_a_channel_with_fewer_samples_than_declared_is_refused() -> None:
    with pytest.raises(ValueError, match="'a' has 2 of 3 samples"):
        module._values(Channel(np.zeros(2), 3))
