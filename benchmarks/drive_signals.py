"""Torque and position as a drive records them, without an accelerometer, in the formats that are read.

    python -m benchmarks.drive_signals [--data FOLDER] [--formats NAME ...] [--rates HZ ...] [--axes COUNT]
        [--page PAGE]

The bench is written in each format: the torque in steps of 0.5 mN m, the position in steps of 10 nm, as of an
encoder of 20 bits on a lead of 10 mm, both sampled without a filter. Formats with a rate for each signal have
the torque at twice the rate of the position; those written on change omit each value that equals the one
before. One has the motor's speed too, as fast as the torque, in steps of 10 µm/s (0.06 r/min at a lead of
10 mm), averaged over its sample interval, beside a position every 4 ms. Simulated machines follow, of the
bench's kind and others, with recordings of one format.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.io import wavfile

from ballscrew.axis.sheet_file import read_axis
from ballscrew.base.errors import BallscrewError
from ballscrew.base.quantity import NORMAL_95
from ballscrew.base.threads import single_threaded
from ballscrew.fcft.plan import read_plan
from ballscrew.modal.analyze import analyze
from ballscrew.modal.run import Run
from ballscrew.recording.channels import ChannelMap
from ballscrew.testbed.linear import true_frequency
from ballscrew.testbed.machine import Machine
from ballscrew.testbed.run import simulate_run
from ballscrew.testbed.trip import Rig, prepared
from benchmarks.axis_sampling import random_axis
from benchmarks.identification_tables import write
from benchmarks.machine import heading

RATES = (8000.0, 4000.0, 2000.0, 500.0, 250.0)
STATES = ("preload-4-percent", "preload-2-percent")
TORQUE_STEP, POSITION_STEP, SPEED_STEP = 5e-4, 1e-8, 1e-5  # N m, m, m/s
SLOW = 250.0  # Hz, of a position every 4 ms
COUNT = 1e-8  # m, of a WAV; a torque of 10 N m has as many counts

Samples = NDArray[np.float64]
Truth = Callable[[float], float]


@dataclass(frozen=True)
class Record:
    """Torque (N m) and position (m) of a trip, their rates (Hz), and a speed (m/s) at that of the torque."""

    torque: Samples
    position: Samples
    torque_rate: float
    rate: float
    speed: Samples | None = None


@dataclass(frozen=True)
class Format:
    """Writer of a format, channel map of torque and position, and whether each signal has its own rate."""

    write: Callable[[Path, Record], Any]
    torque: dict[str, Any]
    position: dict[str, Any]
    two_rates: bool = False
    states_rate: bool = True
    with_speed: bool = False

    def channels(self, rate: float) -> ChannelMap:
        """Channel map, with an acceleration derived from the position."""
        rows = [
            {"quantity": "torque", **self.torque},
            {"quantity": "position", **self.position},
            {"quantity": "acceleration", "source": self.position["source"], "derive": "second-derivative",
             "location": "motor", "axis": "x"},
        ]  # fmt: skip
        if self.with_speed:
            average = [{"type": "moving average", "time": f"{1 / rate} s"}]
            rows += [
                {"quantity": "speed", "source": "ActVelo", "filtered_by": average},
                {"quantity": "acceleration", "source": "ActVelo", "derive": "derivative", "location": "motor",
                 "axis": "x"},
            ]  # fmt: skip
        settings = {"channel": rows} if self.states_rate else {"channel": rows, "sample_rate": f"{rate} Hz"}
        return ChannelMap.from_settings(settings)


def _on_change(values: Samples) -> NDArray[np.intp]:
    """Indices of the values that differ from the one before."""
    return np.flatnonzero(np.diff(values, prepend=np.nan) != 0)


def _texts(record: Record) -> list[list[tuple[float, str]]]:
    """Time (s) and text of each torque (N m), position (mm) and speed (mm/s) that is written on change."""
    signals = [(record.torque, record.torque_rate, 4), (1e3 * record.position, record.rate, 5)]
    if record.speed is not None:
        signals.append((1e3 * record.speed, record.torque_rate, 2))
    return [
        [(index / rate, f"{values[index]:.{digits}f}") for index in _on_change(values)]
        for values, rate, digits in signals
    ]


def _twincat(path: Path, record: Record) -> None:
    columns = _texts(record)
    rates = (record.torque_rate, record.rate, record.torque_rate)[: len(columns)]
    names = ("ActualTorque", "ActPos", "ActVelo")[: len(columns)]
    units = ("Nm (Torque)", "mm (Length)", "mm/s (Velocity)")[: len(columns)]
    lines = [
        "Name\taxis", "File\taxis.svdx",
        "Starttime of export\t132959733843760000\tMonday, May 2, 2022\t15:56:24.376",
        "Endtime of export\t132959733943760000\tMonday, May 2, 2022\t15:56:34.376", "",
        "\t".join(f"Name\t{name}" for name in names),
        "\t".join(f"SampleTime[ms]\t{1e3 / rate:g}" for rate in rates),
        "\t".join(f"Unit\t{unit}" for unit in units),
        "\t".join("ScaleFactor\t1" for _ in names), "",
    ]  # fmt: skip
    for index in range(max(map(len, columns))):
        row = []
        for column in columns:
            row += [f"{1e3 * column[index][0]:.4f}", column[index][1]] if index < len(column) else ["", ""]
        lines.append("\t".join(row))
    path.write_text("\n".join(lines) + "\n", encoding="utf-8", newline="\r\n")


def _sinumerik(path: Path, record: Record) -> None:
    times: dict[float, str] = {}
    for name, column in zip(("f1", "f2"), _texts(record), strict=True):
        for time, text in column:
            times[time] = times.get(time, "") + f' {name}="{text}"'
    signals = "".join(
        f'<dataSignal key="s{number}" id="f{number}" name="{name}" unitsType="{kind}" interval="{1 / rate}"/>'
        for number, name, kind, rate in (
            (1, "/Nck/!SD/nckServoDataActTorque64 [u1, 1]", "torque", record.torque_rate),
            (2, "/Nck/!SD/nckServoDataActPos1stEnc64 [u1, 1]", "posn", record.rate),
        )
    )
    rows = "\n".join(f'<rec time="{time:.6f}"{times[time]}/>' for time in sorted(times))
    path.write_text(
        '<?xml version="1.0" encoding="utf-8"?>\n<traceSession version="01.00.03.02"><traceData><dataFrame>'
        '<frameHeader dropOuts="0" startTime="2019-06-03T17:57:40.613Z"/>'
        f"{signals}{rows}</dataFrame></traceData></traceSession>",
        encoding="utf-8",
    )


def _tdms(path: Path, record: Record) -> None:
    from nptdms import ChannelObject, TdmsWriter

    with TdmsWriter(path) as writer:
        for name, values, unit, rate in (
            ("torque", record.torque, "N.m", record.torque_rate),
            ("position", record.position, "m", record.rate),
        ):
            about = {"wf_increment": 1 / rate, "unit_string": unit}
            writer.write_segment([ChannelObject("drive", name, values, properties=about)])


def _uff(path: Path, record: Record, binary: bool) -> None:
    import pyuff

    about = {
        "type": 58, "binary": int(binary), "func_type": 1, "rsp_dir": 1, "ref_node": 1, "ref_dir": 1,
        "ord_data_type": 4, "abscissa_spacing": 1, "abscissa_inc": 1 / record.rate, "abscissa_min": 0.0,
        "abscissa_spec_data_type": 17, "orddenom_spec_data_type": 0,
    }  # fmt: skip
    sets = []
    for node, (name, values) in enumerate(
        (("TORQUE", record.torque), ("POSITION", record.position)), start=1
    ):
        times = np.arange(len(values)) / record.rate
        names = {"id1": name, "rsp_ent_name": name, "rsp_node": node, "num_pts": len(values)}
        sets.append({**about, **names, "data": values, "x": times})
    pyuff.UFF(str(path)).write_sets(sets, "add")


def _lvm(path: Path, record: Record) -> None:
    head = ["LabVIEW Measurement", "Writer_Version\t2", "Separator\tTab", "Decimal_Separator\t.",
            "X_Columns\tNo", "***End_of_Header***\t", "", "Channels\t2\t",
            "Samples" + 2 * f"\t{len(record.torque)}", "Y_Unit_Label\tN m\tmm",
            "Delta_X" + 2 * f"\t{1 / record.rate}", "***End_of_Header***\t\t",
            "X_Value\tdrive torque\taxis position\tComment"]  # fmt: skip
    rows = zip(record.torque, 1e3 * record.position, strict=True)
    text = "\n".join([*head, *(f"\t{torque:.4f}\t{place:.5f}" for torque, place in rows), ""])
    path.write_text(text, encoding="utf-8", newline="\r\n")


def _wav(path: Path, record: Record) -> None:
    counts = np.stack([record.torque / (10 * COUNT), record.position / COUNT], axis=1)
    wavfile.write(path, round(record.rate), np.rint(counts).astype(np.int32))


def _kollmorgen(path: Path, record: Record) -> None:
    rows = zip(record.torque, 1e3 * record.position, strict=True)
    text = f"{len(record.torque)},1\nIL.FB,PL.FB\n"
    path.write_text(text + "".join(f"{torque:.4f},{place:.5f}\n" for torque, place in rows), encoding="utf-8")


def _heidenhain(path: Path, record: Record) -> None:
    cycle = 1e6 / record.rate
    curves = "".join(
        f"%[CURVE{number}]\n%CHANNELTYPE={name}\n%AXISTYPE=X\n%DIMENSION={unit}\n%CYCLETIME={cycle:g}\n%\n"
        for number, (name, unit) in enumerate((("I nominal", "A"), ("s actual", "mm")), start=1)
    )
    rows = zip(count(), record.torque, 1e3 * record.position)
    data = "".join(f"{cycle * index:g};{torque:.4f};{place:.5f};\n" for index, torque, place in rows)
    path.write_text(f"%[GLOBAL]\n%VERSION=1\n%\n{curves}%[DATA]\n{data}", encoding="utf-8")


def _source(name: str, unit: str = "", scale: float | None = None) -> dict[str, Any]:
    row: dict[str, Any] = {"source": name}
    if unit:
        row["unit"] = unit
    return row if scale is None else {**row, "scale": scale}


FORMATS = {
    "TwinCAT Scope": Format(_twincat, _source("ActualTorque"), _source("ActPos"), two_rates=True),
    "TwinCAT Scope with speed": Format(_twincat, _source("ActualTorque"), _source("ActPos"), with_speed=True),
    "SINUMERIK trace": Format(
        _sinumerik,
        _source("/Nck/!SD/nckServoDataActTorque64 [u1, 1]"),
        _source("/Nck/!SD/nckServoDataActPos1stEnc64 [u1, 1]"),
        two_rates=True,
    ),
    "TDMS": Format(_tdms, _source("drive/torque"), _source("drive/position"), two_rates=True),
    "UFF58": Format(
        lambda path, record: _uff(path, record, binary=False),
        _source("TORQUE 1+X", "N m"),
        _source("POSITION 2+X", "m"),
    ),
    "UFF58b": Format(
        lambda path, record: _uff(path, record, binary=True),
        _source("TORQUE 1+X", "N m"),
        _source("POSITION 2+X", "m"),
    ),
    "LVM": Format(_lvm, _source("drive torque"), _source("axis position")),
    "WAV": Format(_wav, _source("channel 1", "N m", 10 * COUNT), _source("channel 2", "m", COUNT)),
    "Kollmorgen": Format(_kollmorgen, _source("IL.FB", "N m"), _source("PL.FB", "mm"), states_rate=False),
    "HEIDENHAIN": Format(
        _heidenhain, {"source": "I nominal X", "quantity": "current"}, _source("s actual X")
    ),
}
"""Formats by name."""


def sampled(values: Samples, rate: float, wanted: float, step: float) -> Samples:
    """Values at another rate, without a filter, in whole steps."""
    times = np.arange(len(values)) / rate
    samples = CubicSpline(times, values)(np.arange(int(times[-1] * wanted) + 1) / wanted)
    return np.asarray(np.round(samples / step) * step)


def record_of(path: Path, rate: float, form: Format, position_step: float = POSITION_STEP) -> Record:
    """Signals of a simulated trip as a drive records them."""
    torque_rate = 2 * rate if form.two_rates else rate
    position_rate = SLOW if form.with_speed else rate
    speed = None
    with h5py.File(path) as file:
        stored = float(file.attrs.get("sample_rate", 12800.0))
        torque = sampled(file["torque"][:].astype(float), stored, torque_rate, TORQUE_STEP)
        position = sampled(file["position"][:], stored, position_rate, position_step)
        if form.with_speed:
            finest = sampled(file["position"][:], stored, torque_rate, 1e-12)
            speed = np.round(np.diff(finest, prepend=finest[0]) * torque_rate / SPEED_STEP) * SPEED_STEP
    return Record(torque, position, torque_rate, position_rate, speed)


@dataclass
class Row:
    """Errors and standard uncertainties of the cells of some runs, Hz, with their verdicts."""

    errors: list[float]
    uncertainties: list[float]
    verdicts: list[str]
    reasons: list[str]

    def add(self, run: Run, truth: Truth) -> None:
        """Add the cells of a run."""
        for cell in run.cells:
            self.verdicts.append(cell.verdict)
            if cell.frequency_Hz is None or cell.standard_uncertainty_Hz is None:
                self.reasons += map(str, cell.reasons)
                continue
            self.errors.append(cell.frequency_Hz - truth(cell.position_m))
            self.uncertainties.append(cell.standard_uncertainty_Hz)

    def text(self, name: str, rate: str) -> str:
        """Row of the table."""
        shares = " / ".join(str(self.verdicts.count(each)) for each in ("good", "suspect", "refused"))
        if not self.errors:
            kinds = [re.sub(r"\d+", "", reason) for reason in self.reasons]
            reason = self.reasons[kinds.index(max(set(kinds), key=kinds.count))]
            return f"| {name} | {rate} | {shares} | {reason} | | | | |"
        errors, widths = np.abs(self.errors), NORMAL_95 * np.array(self.uncertainties)
        reported = np.array([verdict for verdict in self.verdicts if verdict != "refused"])
        inside = errors <= widths
        good = f"{100 * np.mean(inside[reported == 'good']):.1f} %" if "good" in reported else ""
        return (
            f"| {name} | {rate} | {shares} | {np.median(errors):.2f} | {errors.max():.2f} "
            f"| {np.median(widths):.2f} | {good} | {100 * np.mean(inside):.1f} % |"
        )


_REFUSED = re.compile(
    r"\| (?P<name>[^|]+) \| (?P<rate>[\d, ]+) \| (?P<shares>0 / 0 / \d+) \| "
    r"\d+ samples per second are (?P<reason>[^|]+) \| \| \| \| \|"
)
HEAD = (
    "| recording | rate (Hz) | cells good / suspect / refused | median error (Hz) | largest "
    "| half-width of 95 % | within, good cells | within, all |\n|---|---|---|---|---|---|---|---|"
)


def merged(lines: list[str]) -> list[str]:
    """Rows of the table, those that are refused for one reason as one row."""
    refused: dict[tuple[str, str], list[tuple[str, str]]] = {}
    table: list[str] = []
    for line in lines:
        found = _REFUSED.match(line)
        if found is None:
            table.append(line)
        else:
            refused.setdefault((found["shares"], found["reason"]), []).append((found["name"], found["rate"]))
    for (shares, reason), rows in refused.items():
        names, rates = (", ".join(dict.fromkeys(column)) for column in zip(*rows, strict=True))
        table.append(f"| {names} | {rates} | {shares} each | {reason} | | | | |")
    return table


def runs_of_bench(data: Path, form: Format, rate: float, step: float = POSITION_STEP) -> Row:
    """Both states of the bench in a format."""
    row = Row([], [], [], [])
    known = json.loads((data / "truth.json").read_text(encoding="utf-8"))
    for state in STATES:
        true = known[state]["axial_natural_frequency_Hz"]
        with tempfile.TemporaryDirectory() as folder:
            paths = []
            for source in sorted(data.glob(f"{state}-trip*.h5")):
                paths.append(Path(folder) / source.stem)
                form.write(paths[-1], record_of(source, rate, form, step))
            given: dict[str, Any] = {"axis": data / "axis.toml", "plan": data / "plan.toml", "mass": "100 kg"}
            run = analyze(paths, channels=form.channels(rate), **given)
        row.add(run, lambda place, true=true: true[f"{place:.3f}"])  # type: ignore[misc]
    return row


def machines(data: Path, axes: int, folder: Path) -> Iterator[tuple[str, list[Path], dict[str, Any], Truth]]:
    """Simulated machines: kind, recordings, what ``analyze`` is given, true frequencies."""
    sheet, plan = read_axis(data / "axis.toml"), read_plan(data / "plan.toml")
    for seed in range(axes):
        for kind in ("bench", "random axes"):
            axis = random_axis(seed)
            rig, load, test, known = axis.rig, axis.load, axis.plan, axis.data_sheet
            if kind == "bench":
                preload = float(np.random.default_rng(seed).uniform(200, 700))
                rig, load, test, known = Rig(Machine(sheet, preload)), 100.0, plan, sheet
            files = simulate_run(rig, test, load, folder / f"{kind} {seed}", seed=seed, sheet=known)
            constants = prepared(rig.machine, load, test)
            given = {"axis": known, "plan": test, "mass": load}
            truth: Truth = lambda place, c=constants: true_frequency(c, place)  # type: ignore[misc]  # noqa: E731
            yield kind, list(files.recordings), given, truth


def simulated(data: Path, axes: int, form: Format, rates: list[float]) -> Iterator[str]:
    """Rows of simulated machines, and a line for each machine on the way."""
    rows = {(kind, rate): Row([], [], [], []) for kind in ("bench", "random axes") for rate in rates}
    with tempfile.TemporaryDirectory() as temporary:
        for kind, recordings, given, truth in machines(data, axes, Path(temporary)):
            for rate in rates:
                paths = [path.with_suffix(f".{rate:.0f}") for path in recordings]
                for source, path in zip(recordings, paths, strict=True):
                    form.write(path, record_of(source, rate, form))
                try:
                    rows[kind, rate].add(analyze(paths, channels=form.channels(rate), **given), truth)
                except BallscrewError as error:
                    print(f"{kind}, {rate:g} Hz: {error}")
                print(kind, recordings[0].parent.name, rows[kind, rate].text("", f"{rate:g}"), flush=True)
                for path in paths:
                    path.unlink()
            for path in recordings:
                path.unlink()
    for (kind, rate), row in rows.items():
        yield row.text(f"{axes} simulated: {kind}", f"{rate:g}")


@single_threaded
def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    folder = Path(os.environ.get("BALLSCREW_DATA", "../shared/data")) / "bench"
    parser.add_argument("--data", type=Path, default=folder)
    parser.add_argument("--formats", nargs="*", default=list(FORMATS), choices=list(FORMATS))
    parser.add_argument("--rates", nargs="+", type=float, default=list(RATES))
    parser.add_argument("--axes", type=int, default=10, help="simulated machines of each kind")
    parser.add_argument("--page", type=Path)
    given = parser.parse_args()
    lines = [heading("python -m benchmarks.drive_signals"), "", *HEAD.splitlines()]
    print("\n".join(lines))
    for name in given.formats:
        for rate in given.rates:
            lines.append(runs_of_bench(given.data, FORMATS[name], rate).text(name, f"{rate:g}"))
            print(lines[-1], flush=True)
    if given.axes:
        rows = list(simulated(given.data, given.axes, FORMATS["TwinCAT Scope"], given.rates))
        print("\n".join(rows))
        lines += rows
    if given.page is not None:
        write(given.page, "drive-signals", merged(lines))


if __name__ == "__main__":
    main()
