"""WAV: sampled sound of any number of channels, which states a rate, but neither scale nor unit.

Source: IBM and Microsoft, Multimedia Programming Interface and Data Specifications 1.0; Microsoft, Multiple
Channel Audio Data and WAVE Files; EBU Tech 3285 (``bext``) and 3306 (RF64).
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from ballscrew.recording.header import Header, RawChannel
from ballscrew.recording.readers.guard import as_channel, check_size, missing_channel, refusing

_PCM, _FLOAT, _EXTENSIBLE = 1, 3, 0xFFFE
_SUBFORMAT_END = bytes.fromhex("800000aa00389b71")
_UNKNOWN_SIZE = 0xFFFFFFFF
_MOST_OF_A_CHUNK = 4096  # bytes of a chunk other than the samples that are read


@dataclass(frozen=True, slots=True)
class _Sound:
    rate: float
    channels: int
    kind: str  # of numpy's dtype
    width: int  # bytes of a value
    order: str
    start: int
    frames: int
    started_at: str | None

    @property
    def names(self) -> list[str]:
        return [f"channel {number}" for number in range(1, self.channels + 1)]


class WavReader:
    """Whole numbers of 1 to 64 bits and floats; channels are ``channel 1``, ``channel 2`` and so on."""

    name = "wav"

    def can_open(self, path: Path, head: bytes) -> bool:  # noqa: ARG002  the content alone decides
        """True if the file begins with the signature of WAV, RIFX, RF64 or BW64."""
        return head[:4] in (b"RIFF", b"RIFX", b"RF64", b"BW64") and head[8:12] == b"WAVE"

    def read_header(self, path: Path) -> Header:
        """Read channels, rate, and the start time of a broadcast file."""
        with refusing(path, "WAV"), path.open("rb") as stream:
            sound = _sound(stream, path.stat().st_size)
            channels = [RawChannel(name, sound.frames, scaled=False) for name in sound.names]
            return Header(tuple(channels), sound.rate, sound.started_at, self.name)

    def read(self, path: Path, names: Sequence[str]) -> dict[str, NDArray[Any]]:
        """Read the channels asked for: whole numbers as counts, of 8 bits or less from -128."""
        with refusing(path, "WAV"), path.open("rb") as stream:
            sound = _sound(stream, path.stat().st_size)
            check_size(path, ", ".join(names), 8 * sound.frames * len(names))
            stream.seek(sound.start)
            count = sound.frames * sound.channels * sound.width
            raw = np.fromfile(stream, np.uint8, count).reshape(sound.frames, sound.channels, sound.width)
            listed = sound.names
            for name in names:
                if name not in listed:
                    raise missing_channel(path, name)
            return {name: as_channel(_values(raw[:, listed.index(name)], sound)) for name in names}


def _values(raw: NDArray[Any], sound: _Sound) -> NDArray[Any]:
    """Numbers of bytes of shape (frames, width)."""
    if sound.width == 1:
        return raw[:, 0].astype(np.float64) - 128.0
    if sound.kind == "f" or sound.width in (2, 4, 8):
        return np.ascontiguousarray(raw).view(f"{sound.order}{sound.kind}{sound.width}")[:, 0]
    wide = np.zeros((sound.frames, 8), np.uint8)
    wide[:, 8 - sound.width :] = raw if sound.order == "<" else raw[:, ::-1]
    return np.asarray(wide.view("<i8")[:, 0] >> (64 - 8 * sound.width))


def _chunks(stream: IO[bytes], size: int, order: str) -> Iterator[tuple[bytes, int, int, bytes]]:
    """Name, place, declared size and first bytes of each chunk, which must fill the file."""
    at = 12
    long_size = None
    while at + 8 <= size:
        stream.seek(at)
        name, length = struct.unpack(f"{order}4sI", stream.read(8))
        if name == b"data" and length == _UNKNOWN_SIZE and long_size is not None:
            length = long_size
        if at + 8 + length > size:
            raise ValueError(f"the file is cut, or was never closed: it holds {size} bytes and declares more")
        content = stream.read(min(length, _MOST_OF_A_CHUNK))
        if name == b"ds64":
            long_size = struct.unpack_from("<Q", content, 8)[0]
        yield name, at + 8, length, content
        at += 8 + length + length % 2


def _sound(stream: IO[bytes], size: int) -> _Sound:
    order = ">" if stream.read(4) == b"RIFX" else "<"
    found: dict[bytes, tuple[int, int, bytes]] = {}
    for name, start, length, content in _chunks(stream, size, order):
        if name in found and name in (b"fmt ", b"data"):
            raise ValueError("it has two blocks of samples, or two layouts of them")
        found[name] = start, length, content
    if not {b"fmt ", b"data"} <= found.keys():
        raise ValueError("it has no samples")
    rate, channels, kind, width = _layout(found[b"fmt "][2], order)
    start, length, _ = found[b"data"]
    frames, rest = divmod(length, channels * width)
    if rest or not frames:
        raise ValueError(f"its {length} bytes are no whole number of samples of {channels} channels")
    started_at = _moment(found[b"bext"][2][320:338]) if b"bext" in found else None
    return _Sound(rate, channels, kind, width, order, start, frames, started_at)


def _layout(content: bytes, order: str) -> tuple[float, int, str, int]:
    """Rate, number of channels, kind and width of a value."""
    tag, channels, rate, speed, block, bits = struct.unpack_from(f"{order}HHIIHH", content)
    if tag == _EXTENSIBLE and content[32:40] == _SUBFORMAT_END:
        tag = struct.unpack_from(f"{order}I", content, 24)[0]
    if tag not in (_PCM, _FLOAT):
        raise ValueError(f"its samples are compressed (format {tag}); save it as PCM or float")
    width, rest = divmod(block, max(channels, 1))
    if rest or not 0 < bits <= 8 * width <= 64:
        raise ValueError(f"{channels} channels of {bits} bits do not make blocks of {block} bytes")
    if not 0 < rate * block == speed:
        raise ValueError(
            f"{rate} blocks of {block} bytes per second are not the {speed} bytes that it states"
        )
    if tag == _PCM:
        return float(rate), channels, "i", width
    if bits not in (32, 64) or bits != 8 * width:
        raise ValueError(f"it has floats of {bits} bits")
    return float(rate), channels, "f", width


def _moment(text: bytes) -> str | None:
    """Date and time of ``2026-01-3108:00:00``, whose separators the writer chooses; None for others."""
    digits = text.decode("ascii", "replace")
    try:
        return datetime.fromisoformat(
            f"{digits[0:4]}-{digits[5:7]}-{digits[8:10]} {digits[10:12]}:{digits[13:15]}:{digits[16:18]}"
        ).isoformat()
    except ValueError:
        return None
