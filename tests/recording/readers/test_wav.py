from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
from tests.recording.readers.machine_files import chunk, sound

from ballscrew.base.errors import InputError
from ballscrew.recording.channels import ChannelMap
from ballscrew.recording.load import read_recording
from ballscrew.recording.readers import reader_for
from ballscrew.recording.readers.wav import WavReader

READER = WavReader()


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "a.wav"


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize(
    ("bits", "tag", "expected"),
    [
        (8, 1, [[-128.0, 127.0], [0.0, 1.0]]),
        (16, 1, [[-32768.0, 32767.0], [0.0, 1.0]]),
        (24, 1, [[-8388608.0, 8388607.0], [0.0, 1.0]]),
        (32, 1, [[-2147483648.0, 2147483647.0], [0.0, 1.0]]),
        (32, 3, [[-1.5, 0.25], [0.0, 1.0]]),
        (64, 3, [[-1.5, 0.1], [0.0, 1.0]]),
    ],
)
def test_numbers_of_each_width(
    path: Path, order: str, bits: int, tag: int, expected: list[list[float]]
) -> None:
    long = {"<": "little", ">": "big"}[order]
    if tag == 3:
        samples = np.ravel(expected).astype(f"{order}f{bits // 8}").tobytes()
    else:
        shift = 128 if bits == 8 else 0
        samples = b"".join(
            (int(value) + shift).to_bytes(bits // 8, long, signed=bits > 8)  # type: ignore[arg-type]
            for value in np.ravel(expected)
        )
    path.write_bytes(sound(samples, channels=2, bits=bits, tag=tag, order=order, rate=12800))
    assert reader_for(path).name == "wav"
    header = READER.read_header(path)
    assert header.sample_rate == 12800.0
    assert [(c.name, c.size, c.unit, c.scaled) for c in header.channels] == [
        ("channel 1", 2, None, False),
        ("channel 2", 2, None, False),
    ]
    values = READER.read(path, ["channel 2", "channel 1"])
    np.testing.assert_array_equal(values["channel 1"], np.array(expected)[:, 0])
    np.testing.assert_array_equal(values["channel 2"], np.array(expected)[:, 1])
    assert values["channel 1"].dtype == (np.float32 if (bits, tag) == (32, 3) else np.float64)


def test_extensible_format_and_start_time(path: Path) -> None:
    guid = struct.pack("<I", 3) + bytes.fromhex("00001000800000aa00389b71")
    layout = struct.pack("<HHIIHHHHI", 0xFFFE, 1, 500, 2000, 4, 32, 22, 32, 0) + guid
    bext = b"\0" * 320 + b"2026-01-3108:00:00" + b"\0" * 264
    data = np.array([1.5, 2.5], "<f4").tobytes()
    body = (
        b"WAVE" + chunk(b"bext", bext) + chunk(b"fmt ", layout) + chunk(b"data", data) + chunk(b"id3 ", b"x")
    )
    path.write_bytes(chunk(b"RIFF", body))
    header = READER.read_header(path)
    assert (header.sample_rate, header.started_at) == (500.0, "2026-01-31T08:00:00")
    np.testing.assert_array_equal(READER.read(path, ["channel 1"])["channel 1"], [1.5, 2.5])


def test_more_than_4_gib_are_declared_in_a_chunk_of_their_own(path: Path) -> None:
    whole = sound(np.arange(4, dtype="<i2").tobytes())
    sizes = chunk(b"ds64", struct.pack("<QQQI", 0, 8, 4, 0))
    whole = b"RF64\xff\xff\xff\xffWAVE" + sizes + whole[12:]
    whole = whole.replace(b"data\x08\0\0\0", b"data\xff\xff\xff\xff")
    path.write_bytes(whole)
    np.testing.assert_array_equal(READER.read(path, ["channel 1"])["channel 1"], [0, 1, 2, 3])


def test_scale_and_unit_are_asked_for(path: Path) -> None:
    path.write_bytes(sound(np.arange(40, dtype="<i2").tobytes()))
    row_without_unit = {"source": "channel 1", "quantity": "acceleration"}
    row = row_without_unit | {"unit": "g"}
    with pytest.raises(InputError, match="gives no scale and no unit of 'channel 1'; give both"):
        read_recording(path, ChannelMap.from_settings({"channel": [row]}))
    with pytest.raises(InputError, match="gives no scale and no unit"):
        read_recording(path, ChannelMap.from_settings({"channel": [{**row_without_unit, "scale": 2.0}]}))
    recording = read_recording(path, ChannelMap.from_settings({"channel": [row | {"scale": 1.0}]}))
    np.testing.assert_allclose(recording.array("acceleration"), 9.80665 * np.arange(40))


@pytest.mark.parametrize(
    ("content", "why"),
    [
        (sound(b"\0\0" * 9)[:-3], "the file is cut"),
        (sound(b"\0\0" * 9, tag=7), "compressed .format 7."),
        (sound(b"\0\0" * 9, tag=3), "floats of 16 bits"),
        (sound(b"\0\0\0", channels=1), "no whole number of samples"),
        (sound(b""), "no whole number of samples"),
        (sound(b"\0\0" * 9, rate=0), "0 blocks"),
        (sound(b"\0\0" * 9, bits=0), "0 bits"),
        (sound(b"\0\0" * 9).replace(b"\xd0\x07", b"\xd1\x07"), "are not the 2001 bytes"),
        (sound(b"\0\0" * 9, channels=0), "0 channels"),
        (sound(b"\0\0" * 9, more=chunk(b"data", b"\0\0")), "two blocks of samples"),
        (sound(b"\0\0" * 9).replace(b"data\x12\0\0\0", b"data\xff\xff\xff\xff"), "never closed"),
        (b"RIFF\0\0\0\0WAVE", "no samples"),
    ],
)
def test_damaged_files_are_refused(path: Path, content: bytes, why: str) -> None:
    path.write_bytes(content)
    with pytest.raises(InputError, match=why):
        READER.read_header(path)
    with pytest.raises(InputError, match=why):
        READER.read(path, ["channel 1"])


def test_a_channel_that_is_not_there(path: Path) -> None:
    path.write_bytes(sound(b"\0\0" * 9))
    with pytest.raises(InputError, match="has no channel 'channel 2'"):
        READER.read(path, ["channel 2"])


@pytest.mark.parametrize(
    ("text", "expected"),
    [(b"2026-01-3108:00:00", "2026-01-31T08:00:00"), (b"2026-02-3108:00:00", None), (b"", None)],
)
def test_a_start_that_is_no_time_is_not_known(path: Path, text: bytes, expected: str | None) -> None:
    bext = chunk(b"bext", bytes(320) + text.ljust(18, b"\0") + bytes(264))
    path.write_bytes(sound(b"\0\0" * 9, more=bext))
    assert READER.read_header(path).started_at == expected
