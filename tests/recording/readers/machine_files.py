"""Files of measuring systems, assembled from the published layouts."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike


def chunk(name: bytes, content: bytes, order: str = "<") -> bytes:
    """One chunk of a RIFF file, padded to an even size."""
    return struct.pack(f"{order}4sI", name, len(content)) + content + b"\0" * (len(content) % 2)


def sound(
    samples: bytes, *, rate: int = 1000, channels: int = 1, bits: int = 16, tag: int = 1, order: str = "<",
    more: bytes = b"",
) -> bytes:  # fmt: skip
    """Bytes of a WAV file."""
    block = channels * -(-bits // 8)
    layout = struct.pack(f"{order}HHIIHH", tag, channels, rate, rate * block, block, bits)
    body = b"WAVE" + chunk(b"fmt ", layout, order) + more + chunk(b"data", samples, order)
    return chunk(b"RIFF" if order == "<" else b"RIFX", body, order)


def function(
    values: ArrayLike,
    head: str = "    58",
    *,
    kind: int = 4,
    spacing: str = "         1  0.00000E+00  1.00000E-03  0.00000E+00",
    response: str = "    1         0    0         0 NUT                3   1 NONE               0   0",
    abscissa: str = "        17    0    0    0 Time                 s                   ",
    ordinate: str = "        12    0    0    0 Acceleration         m/s^2               ",
) -> bytes:
    """Dataset 58 with double precision by default; 58b if its head is binary."""
    samples = np.asarray(values)
    size = samples.size if spacing.split()[0] == "1" else samples.size // 2
    none = "         0    0    0    0 NONE                 NONE                "
    lines = ["    -1", head, "Acceleration at the nut", "NONE", "31-Jan-26 08:00:00", "NONE", "NONE",
             response, f"{kind:10}{size:10}{spacing}", abscissa, ordinate, none, none]  # fmt: skip
    if head[6:7] == "b":
        data = samples.tobytes()
    else:
        rows = [samples[at : at + 4] for at in range(0, samples.size, 4)]
        data = "".join("".join(f"{value:20.12E}" for value in row) + "\n" for row in rows).encode()
    return "\n".join(lines).encode("latin-1") + b"\n" + data + b"    -1\n"


def measurement(
    columns: Sequence[ArrayLike],
    *,
    units: Sequence[str] = ("N m", "mm"),
    decimal: str = ".",
    ends: str = "\r\n",
) -> bytes:
    """LabVIEW measurement without a column of times, its segment closed by an empty line."""
    count = len(columns)
    rows = np.stack([np.asarray(column) for column in columns], axis=1)
    about = ["LabVIEW Measurement\t", "Writer_Version\t2", "Reader_Version\t2", "Separator\tTab",
             f"Decimal_Separator\t{decimal}", "Multi_Headings\tYes", "X_Columns\tNo", "Time_Pref\tAbsolute",
             "Operator\tA", "Date\t2026/01/31", "Time\t08:00:00.25",
             "***End_of_Header***\t", "\t"]  # fmt: skip
    fields = {"Channels": [str(count)], "Samples": [str(len(rows))] * count, "Date": ["2026/01/31"] * count,
              "Time": ["08:00:00.5"] * count, "Y_Unit_Label": list(units), "X_Dimension": ["Time"] * count,
              "X0": ["0.0"] * count, "Delta_X": ["1.000000E-3"] * count, "***End_of_Header***": [""] * count,
              "X_Value": [*("torque", "position")[:count], "Comment"]}  # fmt: skip
    table = [f"{key}\t" + "\t".join(cells) for key, cells in fields.items()]
    table += ["\t" + "\t".join(f"{value:.9f}" for value in row) for row in rows]
    text = ends.join([*about, *(line.replace(".", decimal) for line in table), "", ""])
    return text.encode("latin-1")


def tdms(
    channels: dict[str, ArrayLike],
    *,
    properties: dict[str, float | int | str] | None = None,
    order: str = "<",
    interleaved: bool = False,
    chunks: int = 1,
) -> bytes:
    """One segment of a TDMS file with doubles in the group ``g``; whole numbers are times in s since 1904."""

    def text(value: str) -> bytes:
        return struct.pack(f"{order}I", len(value.encode())) + value.encode()

    def stated(value: float | str) -> bytes:
        if isinstance(value, str):
            return struct.pack(f"{order}I", 0x20) + text(value)
        if isinstance(value, int):
            words = struct.pack("<IQq", 0x44, 0, value)
            return words if order == "<" else words[3::-1] + words[:3:-1]
        return struct.pack(f"{order}Id", 10, value)

    objects = [text(path) + struct.pack(f"{order}II", 0xFFFFFFFF, 0) for path in ("/", "/'g'")]
    samples = [np.asarray(values).astype(f"{order}f8") for values in channels.values()]
    about = properties or {}
    content = b"".join(text(key) + stated(value) for key, value in about.items())
    for name, values in zip(channels, samples, strict=True):
        index = struct.pack(f"{order}IIIQI", 20, 10, 1, values.size // chunks, len(about))
        objects.append(text(f"/'g'/'{name}'") + index + content)
    metadata = struct.pack(f"{order}I", len(objects)) + b"".join(objects)
    if interleaved:
        data = np.stack(samples, axis=1).astype(f"{order}f8").tobytes()
    else:
        parts = zip(*(np.split(each, chunks) for each in samples), strict=True)
        data = b"".join(part.tobytes() for chunk_ in parts for part in chunk_)
    lead_in = b"TDSm" + struct.pack("<I", 0b1110 | interleaved << 5 | (order == ">") << 6)
    return lead_in + struct.pack(f"{order}IQQ", 4713, len(metadata + data), len(metadata)) + metadata + data


def _block(kind: str, links: Sequence[int], data: bytes) -> bytes:
    """Block of an MDF file, padded to whole words."""
    size = 24 + 8 * len(links) + len(data)
    head = struct.pack("<4s4xQQ", b"##" + kind.encode(), size, len(links))
    return head + struct.pack(f"<{len(links)}Q", *links) + data + bytes(-size % 8)


class Mdf:
    """An MDF file that grows block by block; a block links only to those before it."""

    def __init__(self, start: int = 1_769_846_400_250_000_000) -> None:
        head = struct.pack("<QhhBBBxdd", start, 0, 0, 0, 0, 0, 0.0, 0.0)
        self.head = b"MDF     4.10    test\0\0\0\0" + struct.pack("<4xH34x", 410), head
        self.content = bytearray(64 + 24 + 6 * 8 + len(head))
        self.first_group = 0

    def add(self, kind: str, links: Sequence[int] = (), data: bytes = b"") -> int:
        """Append a block; its address."""
        self.content += _block(kind, links, data)
        return len(self.content) - len(_block(kind, links, data))

    def text(self, text: str) -> int:
        """Append a text block."""
        return self.add("TX", data=text.encode() + b"\0")

    def conversion(self, kind: int, *values: float, refs: Sequence[int] = ()) -> int:
        """Append a conversion: 1 linear, 2 rational, 3 a formula, 4 a table with interpolation."""
        about = struct.pack("<BBHHHdd", kind, 0, 0, len(refs), len(values), 0.0, 0.0)
        return self.add("CC", [0, 0, 0, 0, *refs], about + struct.pack(f"<{len(values)}d", *values))

    def channel(
        self, name: str, at: int, following: int = 0, *, kind: int = 0, sync: int = 0, data_type: int = 4,
        bits: int = 64, unit: str = "", conversion: int = 0, flags: int = 0, invalid: int = 0,
    ) -> int:  # fmt: skip
        """Append a channel at a byte of its record."""
        links = [following, 0, self.text(name), 0, conversion, 0, self.text(unit) if unit else 0, 0]
        numbers = struct.pack("<BBBBIIII4x", kind, sync, data_type, 0, at, bits, flags, invalid)
        return self.add("CN", links, numbers + bytes(48))

    def group(self, channels: int, data: int, size: int, record: int, *, invalidation: int = 0) -> None:
        """Append a group of channels with its data."""
        about = struct.pack("<QQHH4xII", 0, size, 0, 0, record, invalidation)
        channel_group = self.add("CG", [0, channels, 0, 0, 0, 0], about)
        self.first_group = self.add("DG", [self.first_group, channel_group, data, 0], bytes(8))

    def packed(self, samples: bytes, record: int = 0, declared: int | None = None) -> int:
        """Append compressed data, transposed if a length of its records is given."""
        plain = samples
        if record:
            plain = np.frombuffer(samples, np.uint8).reshape(-1, record).T.tobytes()
        squeezed = zlib.compress(plain)
        size = len(samples) if declared is None else declared
        return self.add(
            "DZ", (), b"DT" + struct.pack("<BxIQQ", bool(record), record, size, len(squeezed)) + squeezed
        )

    def listed(self, *blocks: int) -> int:
        """Append a list of data blocks, with its head."""
        flags = struct.pack("<B3xI", 0, len(blocks)) + bytes(8 * len(blocks))
        return self.add("HL", [self.add("DL", [0, *blocks], flags)], struct.pack("<HB5x", 0, 0))

    def to_bytes(self) -> bytes:
        """The whole file."""
        name, head = self.head
        content = bytes(self.content)
        start = name + _block("HD", [self.first_group, 0, 0, 0, 0, 0], head)
        return start + content[len(start) :]
