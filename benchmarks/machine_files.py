"""Files of machines and measuring systems, compared with independent readers.

Each file of a folder is read in the reader process, and by another reader where one is installed: pyuff
(UFF), lvm-read (LVM), SciPy (WAV), pytcs (TwinCAT Scope), pandas (SINUMERIK traces). A row of the table has
reader, channels, samples, rate, unit, first and last value of the first channel that is no time; and over all
channels the largest difference of a sample, as a share of the largest value, and of a rate. For a file that
is refused it has the reason, and what the other reader does with it.

    python -m benchmarks.machine_files --folder FOLDER
"""

from __future__ import annotations

import argparse
import contextlib
import io
import struct
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ballscrew.base.errors import InputError
from ballscrew.recording.readers.process import opened


@dataclass(frozen=True)
class Signal:
    """Samples by another reader, and its rate, Hz, where it gives one."""

    samples: NDArray[Any]
    rate: float | None = None


def uff_signals(path: Path) -> list[Signal]:
    """Real functions of time, by pyuff."""
    import pyuff

    file = pyuff.UFF(str(path))
    signals = []
    for index in np.flatnonzero(np.asarray(file.get_set_types()) == 58):
        each = file.read_sets(int(index))
        if each["abscissa_spec_data_type"] == 17 and each["ord_data_type"] in (2, 4):
            rate = 1 / each["abscissa_inc"] if each["abscissa_spacing"] == 1 else None
            signals.append(Signal(np.asarray(each["data"]), rate))
    return signals


def lvm_signals(path: Path) -> list[Signal]:
    """Columns that are not empty, by lvm-read."""
    import lvm_read

    file = lvm_read.read(str(path), read_from_pickle=False, dump_file=False)
    signals = []
    for segment in range(int(file["Segments"])):
        for column in np.asarray(file[segment]["data"], dtype=float).T:
            filled = np.flatnonzero(np.isfinite(column))
            if filled.size:
                signals.append(Signal(column[: filled[-1] + 1]))
    return signals


def wav_signals(path: Path) -> list[Signal]:
    """Counts of each channel, by SciPy, which moves them to the upper end of its words."""
    from scipy.io import wavfile

    rate, samples = wavfile.read(path)
    raw = path.read_bytes()
    order = ">" if raw[:4] == b"RIFX" else "<"
    at = raw.index(b"fmt ") + 8
    channels, block = (struct.unpack_from(f"{order}H", raw, at + place)[0] for place in (2, 12))
    samples = samples.reshape(len(samples), -1)
    if samples.dtype == np.uint8:
        samples = samples.astype(float) - 128
    elif samples.dtype.kind == "i":
        samples = samples >> (8 * samples.itemsize - 8 * block // channels)
    return [Signal(column, float(rate)) for column in samples.T]


def twincat_signals(path: Path) -> list[Signal]:
    """Channels with their intervals in ms, by pytcs."""
    import pytcs

    file = pytcs.ScopeFile(path)
    file.load(backend="pandas")
    signals = []
    for each in file.values():
        samples = np.asarray(each.values, dtype=float)  # padded to the length of the longest
        signals.append(Signal(samples[np.isfinite(samples)], 1e3 / each.sample_time))
    return signals


def trace_signals(path: Path) -> list[Signal]:
    """Signals of a trace at one rate without absent records, by the standard library and pandas."""
    from xml.etree import ElementTree

    import pandas as pd

    root = ElementTree.parse(path).getroot()  # noqa: S314  files of one's own folder
    records = pd.DataFrame([record.attrib for record in root.iter("rec")]).astype(float).ffill()
    signals = []
    for each in root.iter("dataSignal"):
        samples = records[each.attrib["id"]].dropna().to_numpy()
        signals.append(Signal(samples, 1 / float(each.attrib["interval"])))
    return signals


OTHERS: dict[str, Callable[[Path], list[Signal]]] = {
    "uff": uff_signals,
    "lvm": lvm_signals,
    "wav": wav_signals,
    "twincat-scope": twincat_signals,
    "sinumerik-trace": trace_signals,
}
"""Other readers, by the name of the reader that they are compared with."""


def other_signals(path: Path, reader: str) -> list[Signal] | str:
    """Signals by another reader, or why there are none."""
    other = OTHERS.get(reader)
    if other is None:
        return "none"
    try:
        with warnings.catch_warnings(), contextlib.redirect_stdout(io.StringIO()):
            warnings.simplefilter("ignore")
            return other(path)
    except ImportError as error:
        return f"not installed: {error.name}"
    except Exception as error:  # noqa: BLE001  another reader may fail in any way
        return f"refused: {type(error).__name__}"


def difference(ours: Sequence[Signal], others: Sequence[Signal]) -> str:
    """Largest difference of the samples over the largest value, and of the rates; or what disagrees."""
    sizes, other_sizes = [each.samples.size for each in ours], [each.samples.size for each in others]
    if sizes != other_sizes:
        return f"sizes {sizes[:4]} and {other_sizes[:4]}"
    of_samples: list[float] = [0.0]
    of_rates: list[float] = []
    for mine, other in zip(ours, others, strict=True):
        scale = np.nanmax(np.abs(other.samples.astype(float))) or 1.0
        of_samples.append(float(np.nanmax(np.abs(mine.samples.astype(float) - other.samples)) / scale))
        if mine.rate and other.rate:
            of_rates.append(abs(mine.rate / other.rate - 1))
    rates = f"rate {max(of_rates):.1e}" if of_rates else "rate not given"
    return f"{max(of_samples):.1e}; {rates}"


def row(path: Path) -> str:
    """Row of the table for one file."""
    try:
        with opened(path) as file:
            header = file.header
            values = file.read([channel.name for channel in header.channels])
    except InputError as error:
        guess = {".uff": "uff", ".lvm": "lvm", ".wav": "wav"}.get(path.suffix.casefold(), "")
        signals = other_signals(path, guess)
        other = f"reads {len(signals)}" if isinstance(signals, list) else signals
        reason = str(error).removeprefix(f"{path}: ")
        return f"| `{path.name}` | refused: {reason} | | | | | | other reader: {other} |"
    ours = [Signal(values[each.name], each.sample_rate or header.sample_rate) for each in header.channels]
    signals = other_signals(path, file.reader)
    compared = signals if isinstance(signals, str) else difference(ours, signals)
    first = next((index for index, each in enumerate(header.channels) if each.unit != "s"), 0)
    rate = ours[first].rate
    samples = ours[first].samples
    return (
        f"| `{path.name}` | {file.reader} | {len(ours)} | {samples.size} | {rate and f'{rate:.7g}'} |"
        f" {header.channels[first].unit or '-'} | {samples[0]:.7g}, {samples[-1]:.7g} | {compared} |"
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--folder", type=Path, required=True)
    folder = parser.parse_args().folder
    print("| file | reader | channels | samples | rate (Hz) | unit | first, last | difference |")
    print("|---|---|---|---|---|---|---|---|")
    for path in sorted(folder.rglob("*")):
        if path.is_file():
            print(row(path), flush=True)


if __name__ == "__main__":
    main()
