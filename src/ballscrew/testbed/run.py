"""A whole run of the testbed as files: recordings, the four TOML files that an analysis needs, the truth."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from datetime import datetime, timedelta
from pathlib import Path

import h5py
import numpy as np

from ballscrew.axis.model import pretension_reserve
from ballscrew.axis.sheet import DataSheet
from ballscrew.axis.sheet_file import axis_toml
from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError
from ballscrew.base.files import Progress, ignore_progress, replacing, write_text
from ballscrew.base.settings import check_whole
from ballscrew.fcft.conditions import Condition
from ballscrew.fcft.nutload import hardest, nut_load
from ballscrew.fcft.plan import Plan, validate_plan
from ballscrew.fcft.planfile import plan_toml
from ballscrew.fcft.schedule import trip_time, trips
from ballscrew.testbed.linear import natural_frequencies, true_frequency
from ballscrew.testbed.machine import Machine
from ballscrew.testbed.trip import Rig, prepared, simulate_trip

# Source, quantity, unit, location and axis of each channel that a map names.
_MAPPED = (
    ("torque", "torque", "N m", "", ""),
    ("position", "position", "m", "", ""),
    ("acc1_x", "acceleration", "m/s^2", "nut-1", "x"),
    ("acc2_x", "acceleration", "m/s^2", "nut-2", "x"),
)
_SCALE = ("scale", "position", "m", "table", "")
_PROBE = ("backlash", "backlash", "m", "nut-1", "")


@dataclass(frozen=True, slots=True)
class RunFiles:
    """Files of a simulated run.

    Parameters
    ----------
    run : Path
        ``run.toml``, which names all else.
    recordings : tuple of Path
        One a round trip.
    truth : Path
        ``truth.json``: preload, backlash and natural frequencies as they are.
    """

    run: Path
    recordings: tuple[Path, ...]
    truth: Path


def simulate_run(
    rig: Rig,
    plan: Plan,
    load: float,
    folder: Path,
    *,
    seed: int = 0,
    sheet: DataSheet | None = None,
    measured_at: str | None = None,
    workers: int = 2,
    progress: Progress | None = None,
) -> RunFiles:
    """Run a test on a machine and write the recordings of its instruments.

    Parameters
    ----------
    rig : Rig
        The machine.
    plan : Plan
        The test.
    load : float
        Load on the table, kg.
    folder : path-like
        Where the files go; made where it is not there.
    seed : int
        The same seed gives the same files, whatever the number of workers.
    sheet : DataSheet, optional
        Data sheet written to ``axis.toml``; by default the true values.
    measured_at : str, optional
        ISO 8601, for ``run.toml``; recordings have start times from it on.
    workers : int
        Trips at once; one trip each is in memory.
    progress : callable, optional
        Called with the number of trips that are done, the number of all, and the last one's file.

    Returns
    -------
    RunFiles
        The files.

    Raises
    ------
    InputError
        If the plan does not suit the axis, the seed is negative, or a file cannot be written.
    """
    check_whole("seed", seed, 0)
    validate_plan(plan, rig.machine.sheet)
    report = progress or ignore_progress
    measured = [trip for trip in trips(plan) if trip.repetition]
    starts = _start_times(plan, measured_at)
    names = [folder / f"trip{index:03d}.h5" for index in range(1, len(measured) + 1)]

    def simulate(index: int) -> Path:
        channels = simulate_trip(rig, plan, measured[index].executed, load, _seed(seed, index))
        _write(names[index], channels, rig.sample_rate, starts[index])
        return names[index]

    try:
        folder.mkdir(parents=True, exist_ok=True)
        with ThreadPoolExecutor(max_workers=max(1, workers)) as pool:
            for done, path in enumerate(pool.map(simulate, range(len(names))), start=1):
                report(done, len(names), path.name)
        files = {
            "axis.toml": axis_toml(sheet or rig.machine.sheet),
            "plan.toml": plan_toml(plan),
            "channels.toml": channels_toml(rig),
            "run.toml": _run_toml(names, load, measured_at),
            "truth.json": json.dumps(truth(rig, plan, load), indent=1) + "\n",
        }
        for name, text in files.items():
            write_text(folder / name, text)
    except OSError as error:
        raise InputError(f"{folder}: cannot be written ({error.strerror or error}).") from None
    return RunFiles(folder / "run.toml", tuple(names), folder / "truth.json")


def channels_toml(rig: Rig) -> str:
    """The channel map of a rig's recordings: what an analysis needs, scale and probe where there are."""
    instruments = rig.instruments
    rows = list(_MAPPED)
    if instruments.linear_scale:
        rows.append(_SCALE)
    if instruments.backlash_probe:
        rows.append(_PROBE)
    blocks = []
    for row in rows:
        block = "[[channel]]\n"
        for name, text in zip(("source", "quantity", "unit", "location", "axis"), row, strict=True):
            if text:
                block += f"{name} = {json.dumps(text)}\n"
        blocks.append(block)
    return "# What each channel of the files is.\n" + "\n".join(blocks)


def truth(rig: Rig, plan: Plan, load: float) -> dict[str, object]:
    """True state of a machine at every stop: preload, backlash, natural frequencies, rotor free and fixed.

    ``preload_N`` is the mean over the stops, ``backlash_m`` the largest. ``coupled_frequencies_Hz`` are those
    of all modes of the whole machine, rotor free: where the bed is blocked for the axial mode, none is that.
    Stops at which the nut has no preload, or the plan's nut load uses up the pretension of an end, have no
    frequency: there each half of the vibration has its own.
    """
    c = prepared(rig.machine, load, plan)
    preloads = rig.machine.local_preload(plan.positions)
    backlashes = rig.machine.local_backlash(plan.positions)
    stops = [
        x
        for x, preload in zip(plan.positions, preloads, strict=True)
        if preload > 0 and _pulls_at_both_ends(rig.machine, plan, load, x)
    ]
    return {
        "preload_N": _nine(preloads.mean()),
        "backlash_m": _nine(backlashes.max()),
        "load_kg": load,
        "local_preload_N": _by_place(plan.positions, preloads),
        "local_backlash_m": _by_place(plan.positions, backlashes),
        "axial_natural_frequency_Hz": _by_place(stops, [true_frequency(c, x) for x in stops]),
        "rotor_held_frequency_Hz": _by_place(stops, [true_frequency(c, x, rotor_fixed=True) for x in stops]),
        "coupled_frequencies_Hz": {
            f"{x:.6f}": [_nine(f) for f in natural_frequencies(c, x)[0][1:]] for x in stops
        },
    }


def _pulls_at_both_ends(machine: Machine, plan: Plan, load: float, place: float) -> bool:
    sheet, motion = machine.sheet, hardest(plan.motions)
    pretension = None if math.isinf(machine.pretension) else machine.pretension
    reserve = pretension_reserve(replace(sheet, bearing=replace(sheet.bearing, pretension=pretension)), place)
    loads = [abs(nut_load(sheet, motion, load, condition)) for condition in Condition]
    return reserve is None or reserve[0] > max(loads)


def _by_place(places: Sequence[float], values: Sequence[float] | Array) -> dict[str, float]:
    """Values by position, which JSON keeps as text."""
    return {f"{place:.6f}": _nine(value) for place, value in zip(places, values, strict=True)}


def _nine(value: float) -> float:
    """A number to nine digits, as results are written."""
    return float(f"{value:.9g}")


def _seed(seed: int, index: int) -> int:
    return int(np.random.SeedSequence([seed, index]).generate_state(1)[0])


def _start_times(plan: Plan, measured_at: str | None) -> list[str | None]:
    """Start of each measured trip, ISO 8601; None for a run without a time."""
    starts = []
    elapsed = timedelta()
    for trip in trips(plan):
        if trip.repetition:
            starts.append(elapsed)
        elapsed += timedelta(seconds=trip_time(plan, trip.executed))
    if measured_at is None:
        return [None] * len(starts)
    begin = datetime.fromisoformat(measured_at)
    return [(begin + start).isoformat(timespec="milliseconds") for start in starts]


def _write(path: Path, channels: dict[str, Array], rate: float, started_at: str | None) -> None:
    with replacing(path) as temporary, h5py.File(temporary, "w") as file:
        file.attrs["sample_rate"] = rate
        if started_at is not None:
            file.attrs["started_at"] = started_at
        for name, values in channels.items():
            fine = name in ("position", "scale", "backlash")  # a long way in small steps
            data = file.create_dataset(name, data=values if fine else values.astype(np.float32))
            data.attrs["unit"] = _unit(name)


def _unit(name: str) -> str:
    for start, unit in (("torque", "N m"), ("current", "A"), ("acc", "m/s^2")):
        if name.startswith(start):
            return unit
    return "m"


def _run_toml(names: Sequence[Path], load: float, measured_at: str | None) -> str:
    listed = "\n".join(f"    {json.dumps(path.name)}," for path in names)
    when = f'measured_at = "{measured_at}"\n' if measured_at else ""
    return (
        'axis = "axis.toml"\nplan = "plan.toml"\nchannels = "channels.toml"\n'
        f'load = "{load:g} kg"\n{when}files = [\n{listed}\n]\n'
    )
