"""Does a damaged file give a number that it does not contain?  Mutants of small files.

    python -m benchmarks.mutants --results FILE [--mutants 100000] [--first BATCH] [--only PART,PART]
        [--samples FOLDER] [--page PAGE]

A mutant is a small file with a changed bit, byte, word or block, or cut off. Each is read with all its
channels, as by any command, in the process that reads recordings, and compared with the file that it was
made from. A format has a line in :data:`SAMPLES`; FOLDER may hold files of others. Every hundred mutants are
a line of FILE, and those that it has already are not repeated; --first leaves out those of an earlier FILE.
``--mutants 0`` only makes the table, which --page writes into a page between its marks.
"""

from __future__ import annotations

import argparse
import json
import resource
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import scipy.io
import xarray as xr
from tests.recording.readers.machine_files import Mdf, function

from ballscrew.base.errors import BallscrewError
from ballscrew.recording.readers import process
from benchmarks.drive_signals import FORMATS, Record
from benchmarks.identification_tables import write
from benchmarks.machine import heading

Row = dict[str, Any]
BATCH = 100
RATE = 1000.0
_RANDOM = np.random.default_rng(0)
TORQUE = np.round(_RANDOM.normal(size=300), 4)
POSITION = np.round(np.cumsum(_RANDOM.random(300)), 3)
COLUMNS: dict[str, Any] = {"torque": TORQUE, "position": POSITION}
MESSAGES = {"reader crashed": "its reader crashes", "out of time": "cannot be read within"}
_HEAD = "    58b     1     2          11        2400     0     0     0     0"
_WORDS = (0, 1, 2**31 - 1, 2**32 - 1, 2**63 - 1, 2**64 - 1)


def _hdf5(path: Path, **storage: Any) -> None:
    with h5py.File(path, "w") as file:
        file.attrs["sample_rate"] = RATE
        for name, values in COLUMNS.items():
            file.create_dataset(name, data=values, **storage)


def _checked_hdf5(path: Path) -> None:
    """Every part has a checksum: the metadata since HDF5 1.8, the samples with this filter."""
    with h5py.File(path, "w", libver="latest") as file:
        file.attrs["sample_rate"] = RATE
        for name, values in COLUMNS.items():
            file.create_dataset(name, data=values, chunks=(100,), compression="gzip", fletcher32=True)


def _netcdf(path: Path) -> None:
    columns = {name: ("sample", values) for name, values in COLUMNS.items()}
    xr.Dataset(columns, attrs={"sample_rate": RATE}).to_netcdf(path, engine="h5netcdf")


def _mat73(path: Path) -> None:
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, values in {**COLUMNS, "fs": np.array([RATE])}.items():
            file.create_dataset(name, data=values[None, :]).attrs["MATLAB_class"] = np.bytes_("double")
    with path.open("rb+") as stream:
        stream.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")


def _parquet(path: Path, checked: bool) -> None:
    pq.write_table(pa.table(COLUMNS), path, write_page_checksum=checked)


def _csv(path: Path, separator: str, decimal: str) -> None:
    pd.DataFrame(COLUMNS).to_csv(path, sep=separator, decimal=decimal)


def _noted_text(path: Path) -> None:
    rows = "".join(f"{a:.4f}\t{b:.3f}\n" for a, b in zip(TORQUE, POSITION, strict=True))
    path.write_text(f"Sample rate: 1000 Hz\n\ntorque [Nm]\tposition [mm]\n{rows}", encoding="latin-1")


@dataclass(frozen=True)
class Sample:
    """A small file of a format: how it is made, and whether checksums cover its samples and its rate."""

    make: Callable[[Path], Any]
    checked: bool = False


def _mdf(path: Path, packed: bool) -> None:
    file = Mdf()
    channels = file.channel("torque", 8, file.channel("position", 16, unit="mm"), unit="N m")
    channels = file.channel("t", 0, channels, kind=2, sync=1, unit="s")
    rows = np.stack([np.arange(len(TORQUE)) / RATE, TORQUE, POSITION], axis=1).astype("<f8").tobytes()
    data = file.listed(file.packed(rows, 24)) if packed else file.add("DT", data=rows)
    file.group(channels, data, len(TORQUE), 24)
    path.write_bytes(file.to_bytes())


def _drive(name: str) -> Sample:
    """A file of a drive, of one of the formats of :mod:`benchmarks.drive_signals`."""
    return Sample(
        lambda path: FORMATS[name].write(
            path, Record(TORQUE, np.asarray(1e-3 * POSITION, dtype=float), RATE, RATE)
        )
    )


SAMPLES = {
    "hdf5.h5": Sample(_hdf5),
    "hdf5-chunked.h5": Sample(lambda path: _hdf5(path, chunks=(100,), compression="lzf", shuffle=True)),
    "hdf5-checked.h5": Sample(_checked_hdf5, checked=True),
    "netcdf4.nc": Sample(_netcdf),
    "mat5.mat": Sample(lambda path: scipy.io.savemat(path, {**COLUMNS, "fs": RATE})),
    "mat5-compressed.mat": Sample(
        lambda path: scipy.io.savemat(path, {**COLUMNS, "fs": RATE}, do_compression=True), checked=True
    ),
    "mat73.mat": Sample(_mat73),
    "comma.csv": Sample(lambda path: _csv(path, ",", ".")),
    "semicolon.csv": Sample(lambda path: _csv(path, ";", ",")),
    "noted.txt": Sample(_noted_text),
    "plain.parquet": Sample(lambda path: _parquet(path, checked=False)),
    "checked.parquet": Sample(lambda path: _parquet(path, checked=True), checked=True),
    "stored.npz": Sample(lambda path: np.savez(path, fs=RATE, **COLUMNS), checked=True),
    "compressed.npz": Sample(lambda path: np.savez_compressed(path, fs=RATE, **COLUMNS), checked=True),
    "uff58.uff": Sample(lambda path: path.write_bytes(function(TORQUE) + function(POSITION))),
    "uff58b.uff": Sample(lambda path: path.write_bytes(function(TORQUE, _HEAD) + function(POSITION, _HEAD))),
    "plain.mf4": Sample(lambda path: _mdf(path, packed=False)),
    "packed.mf4": Sample(lambda path: _mdf(path, packed=True)),
    "twincat.csv": _drive("TwinCAT Scope"),
    "sinumerik.xml": _drive("SINUMERIK trace"),
    "labview.tdms": _drive("TDMS"),
    "labview.lvm": _drive("LVM"),
    "sound.wav": _drive("WAV"),
    "kollmorgen.csv": _drive("Kollmorgen"),
    "tncscope.sco": _drive("HEIDENHAIN"),
}
"""File name, and how such a file is made."""


def mutate(whole: bytes, seed: Sequence[int]) -> bytes:
    """Change a file in one of ten ways, at random; never gives the same bytes."""
    random = np.random.default_rng(seed)
    while True:
        changed = _changed(bytearray(whole), random)
        if changed != whole:
            return bytes(changed)


def _changed(content: bytearray, random: np.random.Generator) -> bytearray:
    at = int(random.integers(len(content)))
    length = int(random.integers(1, 64))
    match random.integers(10):
        case 0 | 1:
            content[at] ^= 1 << int(random.integers(8))
        case 2:
            content[at] = int(random.integers(256))
        case 3:
            content[at] = int(random.choice([0, 255]))
        case 4:
            content[at : at + 4] = random.bytes(len(content[at : at + 4]))
        case 5:
            size = int(random.choice([2, 4, 8]))
            word = _WORDS[random.integers(len(_WORDS))].to_bytes(8, random.choice(["little", "big"]))
            content[at : at + size] = word[:size]
        case 6:
            del content[at:]
        case 7:
            del content[at : at + length]
        case 8:
            content[at:at] = content[at : at + length]
        case 9:
            other = int(random.integers(len(content)))
            content[at : at + length] = content[other : other + length]
    return content


Content = tuple[dict[str, float | None], dict[str, Any]]


def content_of(path: Path) -> Content:
    """Rates and samples, read as any command reads them."""
    with process.opened(path) as file:
        values = file.read([channel.name for channel in file.header.channels])
        rates = {each.name: each.sample_rate or file.header.sample_rate for each in file.header.channels}
        return rates, values


def outcome(path: Path, original: Content) -> tuple[str, str]:
    """What reading a mutant gives, and the sentence or what differs."""
    try:
        rates, values = content_of(path)
    except BallscrewError as error:
        text = str(error)
        if "\n" in text or not text.startswith(str(path)):
            return "fault", text
        named = [name for name, part in MESSAGES.items() if part in text]
        return (named[0] if named else "refused"), text
    except Exception as error:  # noqa: BLE001  whatever reaches the caller is a fault
        return "fault", repr(error)
    changed = [name for name in original[1] if name in values and not _same(values[name], original[1][name])]
    for name, rate in rates.items():
        if rate is not None and name in original[0] and rate != original[0][name]:
            changed.append(f"rate {rate}")
    if changed:
        return "other numbers", ", ".join(changed)
    return ("same numbers", "") if set(values) >= set(original[1]) else ("channels missing", "")


def _same(values: Any, expected: Any) -> bool:
    return bool(np.array_equal(values, expected, equal_nan=True))


def batch(folder: Path, name: str, number: int, original: Content) -> Row:
    """Outcomes of a hundred mutants of a file."""
    whole = (folder / name).read_bytes()
    counts: Counter[str] = Counter()
    noted: list[Row] = []
    slowest = 0.0
    checked = name in SAMPLES and SAMPLES[name].checked
    start = time.process_time()
    for index in range(number * BATCH, (number + 1) * BATCH):
        path = folder / f"mutant-{name}"
        path.write_bytes(mutate(whole, [*name.encode(), index]))
        begin = time.monotonic()
        kind, text = outcome(path, original)
        slowest = max(slowest, time.monotonic() - begin)
        counts[kind] += 1
        if kind in (*MESSAGES, "fault") or (kind == "other numbers" and checked):
            noted.append({"mutant": index, "outcome": kind, "text": text.replace(str(folder), "")[:200]})
    return {
        "sample": name, "batch": number, "counts": counts, "noted": noted, "slowest_s": round(slowest, 2),
        "caller_cpu_s": round(time.process_time() - start, 2),
        "caller_peak_MB": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1000,
    }  # fmt: skip


_COLUMNS = {
    "refused": "refused",
    "reader crashed": "of these, reader crashed",
    "out of time": "out of time",
    "same numbers": "read: same numbers",
    "channels missing": "without a channel",
    "other numbers": "other numbers",
    "fault": "faults of the caller",
}


def table(rows: Sequence[Row]) -> list[str]:
    """Outcomes of each sample; a shortened text has fewer numbers, which are counted as others."""
    out = [
        f"| file | check | mutants | {' | '.join(_COLUMNS.values())} | slowest, s |",
        "|---" * (4 + len(_COLUMNS)) + "|",
    ]
    order = list(dict.fromkeys([*SAMPLES, *(row["sample"] for row in rows)]))
    groups = {name: [row for row in rows if row["sample"] == name] for name in order}
    groups["**all**"] = list(rows)
    for name, group in groups.items():
        if not group:
            continue
        counts: Counter[str] = sum((Counter(row["counts"]) for row in group), Counter())
        counts["refused"] += counts["reader crashed"] + counts["out of time"]
        sample = SAMPLES.get(name)
        check = "" if sample is None else ("yes" if sample.checked else "no")
        cells = [str(counts[column]) for column in _COLUMNS]
        slowest = max(row["slowest_s"] for row in group)
        out.append(f"| {name} | {check} | {BATCH * len(group)} | {' | '.join(cells)} | {slowest:.1f} |")
    return out


def _run(given: argparse.Namespace, rows: list[Row]) -> None:
    """Run the missing batches, one of each sample after the other."""
    done = {(row["sample"], row["batch"]) for row in rows}
    with tempfile.TemporaryDirectory() as temporary, given.results.open("a", encoding="utf-8") as file:
        folder = Path(temporary)
        for name, sample in SAMPLES.items():
            sample.make(folder / name)
        if given.samples is not None:
            for path in given.samples.iterdir():
                (folder / path.name).write_bytes(path.read_bytes())
        names = [path.name for path in sorted(folder.iterdir()) if _wanted(path.name, given.only)]
        originals = {name: content_of(folder / name) for name in names}
        count = -(-given.mutants // (BATCH * len(names)))
        for number in range(given.first, given.first + count):
            for name in names:
                if (name, number) not in done:
                    rows.append(batch(folder, name, number, originals[name]))
                    file.write(json.dumps(rows[-1]) + "\n")
                    file.flush()


def _wanted(name: str, parts: str) -> bool:
    return any(part in name for part in parts.split(","))


def main() -> None:
    """Run what is missing and print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--results", type=Path, required=True)
    parser.add_argument("--mutants", type=int, default=100_000, help="of all samples together")
    parser.add_argument("--first", type=int, default=0, help="number of the first batch of each sample")
    parser.add_argument("--only", default="", help="parts of names")
    parser.add_argument("--samples", type=Path, help="folder of other small files")
    parser.add_argument("--page", type=Path)
    given = parser.parse_args()
    rows: list[Row] = []
    if given.results.exists():
        rows = [json.loads(line) for line in given.results.read_text(encoding="utf-8").splitlines()]
    if given.mutants:
        _run(given, rows)
    lines = [heading("python -m benchmarks.mutants --results FILE"), "", *table(rows)]
    print("\n".join(lines))
    if given.page is not None:
        write(given.page, "mutants", lines)


if __name__ == "__main__":
    main()
