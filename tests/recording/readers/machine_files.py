"""Files of measuring systems, assembled from the published layouts."""

from __future__ import annotations

import struct
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
