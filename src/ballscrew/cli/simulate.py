"""``ballscrew simulate``: recordings of a machine whose truth is known."""

from __future__ import annotations

from pathlib import Path

from rich.markup import escape

from ballscrew.axis.sheet import read_axis
from ballscrew.base.errors import DONE, InputError
from ballscrew.base.units import parse
from ballscrew.cli.output import console, count, print_json, progress_bar
from ballscrew.fcft.plan import Plan, read_plan
from ballscrew.testbed.machine import Machine
from ballscrew.testbed.run import simulate_run, truth
from ballscrew.testbed.trip import Rig

__all__ = ["simulate_run_command"]


def simulate_run_command(
    plan: Path,
    *,
    axis: Path,
    out: Path,
    preload: str | None,
    backlash: str,
    mass: str | None,
    seed: int,
    as_json: bool,
) -> int:
    """Simulate one run, say where its files are, and return the exit status."""
    sheet, test = read_axis(axis), read_plan(plan)
    force = sheet.nominal_preload if preload is None else _given("--preload", preload, "N")
    clearance = _given("--backlash", backlash, "m")
    load = _load(test, mass)
    rig = Rig(Machine(sheet, force, clearance))
    with progress_bar("simulating") as report:
        files = simulate_run(rig, test, load, out, seed=seed, progress=report)
    if as_json:
        print_json(
            {
                "schema": 1,
                "run": str(files.run),
                "recordings": [str(path) for path in files.recordings],
                "truth": truth(rig, test, load),
            }
        )
        return DONE
    said = console()
    said.print(
        f"{count(len(files.recordings), 'recording')}, the four TOML files and the truth: {escape(str(out))}"
    )
    said.print(f"Next: ballscrew analyze {escape(str(files.run))}", soft_wrap=True)
    return DONE


def _given(option: str, text: str, unit: str) -> float:
    try:
        value = parse(text, unit)
    except InputError as error:
        raise InputError(
            f"{option} is {text!r}; it must be a number with a unit of {unit} ({error})."
        ) from None
    if not value >= 0:
        raise InputError(f"{option} is {text!r}; it must be 0 {unit} or more.")
    return value


def _load(test: Plan, mass: str | None) -> float:
    if mass is not None:
        return _given("--mass", mass, "kg")
    if len(test.masses) > 1:
        listed = ", ".join(f"{value:g} kg" for value in test.masses)
        raise InputError(f"{test.source}: the plan has several loads ({listed}); say which with --mass.")
    return test.masses[0]
