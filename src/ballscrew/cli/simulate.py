"""``ballscrew simulate``: recordings of a machine with known truth."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from rich.markup import escape

from ballscrew.axis.sheet import DataSheet
from ballscrew.axis.sheet_file import read_axis
from ballscrew.base.errors import DONE, InputError
from ballscrew.base.files import Progress, write_text
from ballscrew.base.jsonfile import SCHEMA
from ballscrew.base.units import parse_named
from ballscrew.base.words import plural
from ballscrew.cli.output import (
    check_outputs,
    console,
    print_json,
    progress_bar,
)
from ballscrew.fcft.plan import Plan, read_plan
from ballscrew.reproduction.experiment import check_space, simulated_runs
from ballscrew.testbed.example import AXIS, PLAN
from ballscrew.testbed.experiments import PlannedRun, bench, multi_level_mass, run_to_failure
from ballscrew.testbed.machine import Machine
from ballscrew.testbed.run import RunFiles, simulate_run, truth
from ballscrew.testbed.temperature import warmed
from ballscrew.testbed.trip import Rig

_NAMES = ("axis.toml", "plan.toml", "channels.toml", "run.toml", "truth.json", "experiment.json")
_LARGEST_DIFFERENCE = 50.0  # K, between screw and nut


def simulate(
    plan: str | Path,
    *,
    axis: str | Path,
    out: str | Path,
    preload: str | None = None,
    backlash: str = "0 um",
    mass: str | None = None,
    warmer: str = "0 K",
    seed: int = 0,
    progress: Progress | None = None,
) -> RunFiles:
    """Simulate the recordings of one run on a machine with known true values.

    Parameters
    ----------
    plan, axis : path-like
        The test and the axis.
    out : path-like
        Folder of the files; made if absent.
    preload : str, optional
        True preload, ``"450 N"``; by default the data sheet's.
    backlash : str
        True backlash, ``"5 um"``.
    mass : str, optional
        Load on the table, ``"100 kg"``; by default the plan's, where it has one.
    warmer : str
        Temperature of the screw above that of the nut, ``"5 K"``.
    seed : int
        The same seed gives the same files.
    progress : callable, optional
        Called with how many trips are done, how many there are, and the last one's file.

    Returns
    -------
    RunFiles
        Recordings, ``run.toml`` with what it names, and the true values.

    Raises
    ------
    InputError
        If a file or a value is wrong, or the plan does not suit the axis.
    """
    _check_folder(Path(out), (Path(plan), Path(axis)))
    sheet, test = read_axis(axis), read_plan(plan)
    force = sheet.nominal_preload if preload is None else _parse("--preload", preload, "N")
    clearance = _parse("--backlash", backlash, "m")
    load = _load(test, mass)
    rig = Rig(_warmed(Machine(sheet, force, clearance), warmer))
    return simulate_run(rig, test, load, Path(out), seed=seed, progress=progress)


def simulate_run_command(plan: Path, *, out: Path, as_json: bool, **options: Any) -> int:
    """Simulate one run, print where its files are, and return the exit status."""
    with progress_bar("simulating") as progress:
        files = simulate(plan, out=out, progress=progress, **options)
    if as_json:
        print_json(
            {
                "schema": SCHEMA,
                "run": str(files.run),
                "recordings": [str(path) for path in files.recordings],
                "truth": json.loads(files.truth.read_text(encoding="utf-8")),
            }
        )
        return DONE
    screen = console()
    screen.print(
        f"{plural(len(files.recordings), 'recording')}, the four TOML files and the truth: {escape(str(out))}"
    )
    screen.print(f"Next: ballscrew analyze {escape(str(files.run))}", soft_wrap=True)
    return DONE


def simulate_multi_level_mass_command(
    loads: str, *, axis: Path | None, plan: Path | None, repetitions: int, out: Path, seed: int, as_json: bool
) -> int:
    """Simulate one run for each load, print where the files are, and return the exit status."""
    sheet, test = _machine_and_plan(axis, plan, repetitions)
    masses = [_parse("--loads", part, "kg") for part in loads.split(",")]
    planned = multi_level_mass(bench(sheet), test, masses, seed=seed)
    return _experiment(planned, out, (axis, plan), as_json=as_json)


def simulate_run_to_failure_command(
    mass: str,
    *,
    axis: Path | None,
    plan: Path | None,
    repetitions: int,
    days: float,
    every: float,
    out: Path,
    seed: int,
    as_json: bool,
) -> int:
    """Simulate a run every few days until there is backlash, and return the exit status."""
    sheet, test = _machine_and_plan(axis, plan, repetitions)
    load = _parse("--mass", mass, "kg")
    planned = run_to_failure(bench(sheet), test, load, days, every, seed=seed)
    return _experiment(planned, out, (axis, plan), as_json=as_json)


def _check_folder(out: Path, inputs: Iterable[Path | None]) -> None:
    """Check that no input is a file of a folder that is to be written."""
    check_outputs([*(out / name for name in _NAMES), *out.glob("trip*.h5")], inputs)


def _experiment(
    planned: Sequence[PlannedRun], out: Path, inputs: Sequence[Path | None], *, as_json: bool
) -> int:
    for folder in (out, *(out / each.name for each in planned)):
        _check_folder(folder, inputs)
    size = check_space(planned, out, keep=True)
    if not as_json:
        console().print(size)
    rows: list[dict[str, object]] = []
    last = out
    with progress_bar("simulating") as progress:
        for planned_run, files in simulated_runs(planned, out, progress):
            last = files.run
            row = {
                "run": files.run.relative_to(out).as_posix(),
                "day": planned_run.day,
                "load_kg": planned_run.load,
                "truth": truth(planned_run.rig, planned_run.plan, planned_run.load),
            }
            rows.append(row)
    document = {"schema": SCHEMA, "runs": rows}
    write_text(out / "experiment.json", json.dumps(document, indent=1) + "\n")
    if as_json:
        print_json(document)
        return DONE
    screen = console()
    screen.print(f"{plural(len(rows), 'run')}, each in its folder, and experiment.json: {escape(str(out))}")
    screen.print(f"Next: ballscrew analyze {escape(str(last))}", soft_wrap=True)
    return DONE


def _machine_and_plan(axis: Path | None, plan: Path | None, repetitions: int) -> tuple[DataSheet, Plan]:
    sheet = AXIS if axis is None else read_axis(axis)
    test = PLAN if plan is None else read_plan(plan)
    return sheet, replace(test, repetitions=repetitions)


def _parse(option: str, text: str, unit: str) -> float:
    value = parse_named(option, text, unit)
    if not value >= 0:
        raise InputError(f"{option} is {text!r}; it must be 0 {unit} or more.")
    return value


def _warmed(machine: Machine, warmer: str) -> Machine:
    difference = parse_named("--warmer", warmer, "kelvin")
    if abs(difference) > _LARGEST_DIFFERENCE:
        raise InputError(
            f"--warmer is {warmer!r}; a screw is at most {_LARGEST_DIFFERENCE:g} K warmer or colder than its "
            "nut. It is a temperature difference, such as '5 K'."
        )
    return warmed(machine, difference) if difference else machine


def _load(test: Plan, mass: str | None) -> float:
    if mass is not None:
        return _parse("--mass", mass, "kg")
    if len(test.masses) > 1:
        listed = ", ".join(f"{value:g} kg" for value in test.masses)
        raise InputError(f"{test.source}: the plan has several loads ({listed}); choose one with --mass.")
    return test.masses[0]
