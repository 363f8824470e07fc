"""TDMS, of LabVIEW and DAQmx, read by npTDMS; its cut files are refused, of which npTDMS reads a part.

Source of the lead-in of a segment: NI, TDMS File Format Internal Structure, 2023.
"""

from __future__ import annotations

import logging
import struct
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from ballscrew.base.errors import InputError
from ballscrew.recording.header import Header, RawChannel
from ballscrew.recording.readers.attributes import rate_of, unit_of
from ballscrew.recording.readers.guard import as_channel, check_size, missing_channel, refusing

try:
    from nptdms import TdmsFile
    from nptdms.log import log_manager

    log_manager.set_level(logging.CRITICAL)  # what it warns of is refused, or a text that it decodes in part
except ImportError:
    TdmsFile = None

_TAG = b"TDSm"
_LEAD_IN = 28
_BIG_ENDIAN = 1 << 6
_UNSET = np.datetime64("1970-01-01")  # LabVIEW's zero is 1904
_STATUS = "NI_Scaling_Status"
_NEVER_CLOSED = 0xFFFFFFFFFFFFFFFF


class TdmsReader:
    """Numeric channels as ``group/channel``, with NI's scaling; time stamps become seconds."""

    name = "tdms"

    def can_open(self, path: Path, head: bytes) -> bool:  # noqa: ARG002  the content alone decides
        """True if the file begins with the tag of a segment."""
        return head.startswith(_TAG)

    def read_header(self, path: Path) -> Header:
        """Read channels with units, rates and starts (of waveforms), and the first start time."""
        with refusing(path, "TDMS"), _opened(path) as found:
            starts = {name: _start(channel) for name, channel in found.items()}
            moments = {start for start in starts.values() if start is not None}
            first = min(moments, default=None)
            channels = []
            for name, channel in found.items():
                start = starts[name]
                seconds = None
                if len(moments) > 1 and start is not None:
                    seconds = float((start - first) / np.timedelta64(1, "us")) * 1e-6
                rate = rate_of({"dt": channel.properties.get("wf_increment")})
                unit = "s" if channel.dtype.kind == "M" else unit_of(channel.properties)
                scaled = channel._scaling is not None or channel.properties.get(_STATUS) != "unscaled"
                channels.append(RawChannel(name, len(channel), unit, rate, seconds, scaled))
            started_at = None if first is None else f"{first}+00:00"  # TDMS has UTC
            return Header(tuple(channels), None, started_at, self.name)

    def read(self, path: Path, names: Sequence[str]) -> dict[str, NDArray[Any]]:
        """Read the channels asked for; time stamps in seconds since the first."""
        with refusing(path, "TDMS"), _opened(path) as found:
            for name in names:
                if name not in found:
                    raise missing_channel(path, name)
            check_size(path, ", ".join(names), sum(8 * len(found[name]) for name in names))
            return {name: _values(found[name]) for name in names}


@contextmanager
def _opened(path: Path) -> Iterator[dict[str, Any]]:
    """Channels of numbers and of time stamps, by their names, while the file is open."""
    if TdmsFile is None:
        raise InputError(f'{path}: is a TDMS file, which npTDMS reads: pip install "ballscrew[tdms]".')
    with path.open("rb") as stream:
        _check_segments(stream, path.stat().st_size)
        stream.seek(0)
        # A stream, since beside a path its index file would be read.
        with TdmsFile.open(stream) as file:
            if any(each.final_chunk_lengths_override is not None for each in file._reader._segments):
                raise ValueError("the file is cut: the samples of a segment are not complete")
            channels = [channel for group in file.groups() for channel in group.channels()]
            yield {
                f"{channel.group_name}/{channel.name}": channel
                for channel in channels
                if len(channel) and channel.dtype.kind in "iufM"
            }


def _check_segments(stream: IO[bytes], size: int) -> None:
    """Refuse a file whose segments do not fill it: of a shorter file npTDMS reads a part, or reads zeros."""
    at = 0
    while at < size:
        stream.seek(at)
        lead_in = stream.read(_LEAD_IN)
        if len(lead_in) < _LEAD_IN or not lead_in.startswith(_TAG):
            raise ValueError(f"byte {at} is not the start of a segment: the file is cut or damaged")
        order = ">" if lead_in[4] & _BIG_ENDIAN else "<"
        length, metadata = struct.unpack_from(f"{order}QQ", lead_in, 12)
        if length == _NEVER_CLOSED:
            raise ValueError("its last segment was never completed; open and save it in LabVIEW or DIAdem")
        at += _LEAD_IN + length
        if at > size or metadata > length:
            raise ValueError(f"the file is cut: it holds {size} of {at} bytes")


def _start(channel: Any) -> np.datetime64 | None:
    """Time of the first sample of a waveform, µs."""
    moment = channel.properties.get("wf_start_time")
    offset = channel.properties.get("wf_start_offset", 0.0)
    if not isinstance(moment, np.datetime64) or not moment > _UNSET or not np.isfinite(offset):
        return None
    start: np.datetime64 = moment.astype("M8[us]") + np.timedelta64(round(1e6 * offset), "us")
    return start


def _values(channel: Any) -> NDArray[Any]:
    values = channel.read_data()
    if len(values) != len(channel):
        raise ValueError(f"{channel.name!r} has {len(values)} of {len(channel)} samples")
    if values.dtype.kind == "M":
        values = (values - values[0]) / np.timedelta64(1, "us") * 1e-6
    return as_channel(values)
