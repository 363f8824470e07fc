"""How much each constant of the estimators matters: halved and doubled, one after the other.

    python -m benchmarks.constants [--data FOLDER] [--workers 2] [--page PAGE]

Every number that a module of ``modal/joint``, ``calibration`` or ``estimation`` names in capitals, and every
number in the settings of joint estimator and preload, is halved and doubled (a fraction: its odds; a range
around 1: its logarithms), and the analyses are repeated. For ``modal/joint`` these are the worn state of the
bench (BALLSCREW_DATA, or --data), a testbed axis without a data sheet, and one near a mode of the frame; for
the others, models and preloads of worn axes, one of them with a load that was not declared. Recordings are
the same throughout. Constants in compiled code are left out, and those that are only a guard against overflow
or a malformed file.
"""

from __future__ import annotations

import argparse
import ast
import importlib
import math
import os
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, fields, replace
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

import ballscrew
from ballscrew.axis.sheet_file import read_axis
from ballscrew.base.errors import BallscrewError
from ballscrew.base.threads import single_threaded
from ballscrew.calibration.assumptions import DEFAULT_ASSUMPTIONS, Assumptions
from ballscrew.calibration.calibration import calibrate
from ballscrew.estimation.preload import preload
from ballscrew.fcft.plan import read_plan
from ballscrew.modal.joint.analysis import analyse_jointly, signal_reducer
from ballscrew.modal.joint.settings import JointSettings
from ballscrew.modal.paper.cells import identify_cells
from ballscrew.modal.paper.settings import PaperSettings
from ballscrew.modal.run import Run
from ballscrew.recording.channels import read_channels
from ballscrew.recording.measure import measure
from ballscrew.testbed.run import simulate_run
from benchmarks.axis_sampling import random_axis
from benchmarks.identification import Given
from benchmarks.identification_tables import write
from benchmarks.machine import heading
from benchmarks.other_worlds import LOW_LOAD, bench

Number = float | tuple[float, ...]
Answers = dict[str, tuple[float, float, str]]  # value, standard uncertainty and verdict of each result


class Settings(NamedTuple):
    """Settings of an analysis."""

    joint: JointSettings = JointSettings()
    assumptions: Assumptions = DEFAULT_ASSUMPTIONS


Analysis = Callable[[Settings], Answers]

PACKAGES = {"joint": "modal/joint", "preload": "calibration estimation"}
GUARDS = 1e-5  # smaller numbers, and larger ones than their inverse, only keep arithmetic from failing
SOURCE = Path(ballscrew.__file__).parent
UNDECLARED = 20.0  # kg
SETTINGS_FILES = ("modal/joint/settings.py", "calibration/assumptions.py")


@dataclass(frozen=True)
class Constant:
    """One constant.

    Parameters
    ----------
    module : str
        Path below ``src/ballscrew``.
    name : str
        In the module, or field of the settings.
    value : float or tuple of float
        As it is.
    """

    module: str
    name: str
    value: Number

    @property
    def label(self) -> str:
        """File and name, for the table."""
        return f"`{self.module}` `{self.name}`"

    def changed(self, factor: float) -> Number:
        """Its value with a factor."""
        if not isinstance(self.value, tuple):
            return scaled(self.value, factor)
        low, high = self.value[0], self.value[-1]
        if 0 < low < 1 < high:
            return tuple(value**factor for value in self.value)
        return tuple(scaled(value, factor) for value in self.value)


def scaled(value: float, factor: float) -> float:
    """A number with a factor; a fraction with a factor of its odds, a whole number at least 1."""
    if isinstance(value, int):
        return max(1, round(value * factor))
    if 0 < value < 1:
        odds = factor * value / (1 - value)
        return odds / (1 + odds)
    return value * factor


def constants(group: str) -> Iterator[Constant]:
    """The constants of a group of packages, in the order of the files."""
    for package in PACKAGES[group].split():
        for path in sorted((SOURCE / package).glob("*.py")):
            module = f"{package}/{path.name}"
            loaded = loaded_module(module)
            compiled = names_in_compiled_code(loaded)
            for name in assigned_names(path):
                value = getattr(loaded, name)
                if is_number(value) and name not in compiled:
                    yield Constant(module, name, value)
    default = Settings()
    stated = (
        (SETTINGS_FILES[0], default.joint) if group == "joint" else (SETTINGS_FILES[1], default.assumptions)
    )
    for field in fields(stated[1]):
        value = getattr(stated[1], field.name)
        if is_number(value):
            yield Constant(stated[0], field.name, value)


def assigned_names(path: Path) -> Iterator[str]:
    """Names in capitals to which a file assigns numbers, and not an index or a length."""
    for statement in ast.parse(path.read_text(encoding="utf-8")).body:
        targets: Sequence[ast.expr] = ()
        if isinstance(statement, ast.Assign):
            targets = statement.targets
        elif isinstance(statement, ast.AnnAssign):
            targets = [statement.target]
        calls = {ast.unparse(node.func) for node in ast.walk(statement) if isinstance(node, ast.Call)}
        if not all(call.startswith("math.") for call in calls):
            continue
        for target in targets:
            if isinstance(target, ast.Name) and target.id.isupper():
                yield target.id


def is_number(value: Any) -> bool:
    """True of a number, or a tuple of numbers, that is no guard."""
    if isinstance(value, tuple):
        return bool(value) and all(is_number(item) for item in value)
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    return GUARDS <= abs(value) <= 1 / GUARDS


def names_in_compiled_code(module: ModuleType) -> set[str]:
    """Names that compiled functions of a module have built in."""
    functions = [getattr(value, "py_func", None) for value in vars(module).values()]
    return {name for function in functions if function is not None for name in function.__code__.co_names}


def loaded_module(module: str) -> ModuleType:
    """A module by its path below ``src/ballscrew``."""
    return importlib.import_module("ballscrew." + module.removesuffix(".py").replace("/", "."))


@contextmanager
def altered(constant: Constant, value: Number) -> Iterator[Settings]:
    """Another value of a constant, wherever it was imported to, or of a setting."""
    settings = Settings()
    if not constant.name.lstrip("_").isupper():
        field: dict[str, Any] = {constant.name: value}
        if constant.module == SETTINGS_FILES[0]:
            yield settings._replace(joint=replace(settings.joint, **field))
        else:
            yield settings._replace(assumptions=replace(settings.assumptions, **field))
        return
    original = getattr(loaded_module(constant.module), constant.name)
    public = not constant.name.startswith("_")
    holders = [loaded_module(constant.module)]
    if public:
        holders += [
            module
            for name, module in sorted(sys.modules.items())
            if name.startswith("ballscrew.") and vars(module).get(constant.name) is original
        ]
    for module in holders:
        setattr(module, constant.name, value)
    clear_caches()
    try:
        yield settings
    finally:
        for module in holders:
            setattr(module, constant.name, original)
        clear_caches()


def clear_caches() -> None:
    """Forget results that were computed with another value."""
    for name, module in sorted(sys.modules.items()):
        if name.startswith("ballscrew."):
            for value in vars(module).values():
                clear = getattr(value, "cache_clear", None)
                if callable(clear):
                    clear()


def joint_analyses(data: Path, folder: Path) -> dict[str, Analysis]:
    """Analyses by method joint, of recordings that are read anew each time."""
    sampled, near = random_axis(3), bench(4, "frame 0.9")
    files = data / "bench"
    sheet, plan = read_axis(files / "axis.toml"), read_plan(files / "plan.toml")
    recordings = tuple(sorted(files.glob("preload-2-percent-trip*.h5")))
    given = {"bench": (Given(recordings, read_channels(files / "channels.toml"), sheet, plan, 100.0), True)}
    simulated = {
        "no sheet": (
            sampled.rig,
            replace(sampled.plan, repetitions=3),
            sampled.load,
            sampled.data_sheet,
            False,
        ),
        "frame": (near.rig, near.plan, near.load, near.sheet, True),
    }
    for name, (rig, test, load, stated, used) in simulated.items():
        place = folder / name
        place.mkdir()
        run = simulate_run(rig, test, load, place, sheet=stated, seed=1, workers=1)
        channels = read_channels(place / "channels.toml")
        given[name] = (Given(run.recordings, channels, stated, test, load), used)
    return {name: joint_analysis(one, used) for name, (one, used) in given.items()}


def joint_analysis(given: Given, use_sheet: bool) -> Analysis:
    """Frequencies of all cells of a run."""
    sheet = given.sheet if use_sheet else None
    before = given.measured()
    cells, table = identify_cells(
        before.transients, before.quality, given.sheet, given.plan, given.load, PaperSettings()
    )

    @single_threaded
    def answers(settings: Settings) -> Answers:
        reduced = signal_reducer(given.sheet, given.load, settings.joint)
        data = measure(
            given.files, given.channels, sheet=given.sheet, plan=given.plan, mass=given.load, extract=reduced
        )
        found = analyse_jointly(data, cells, table, sheet, given.load, settings.joint, "both").cells
        out: Answers = {}
        for cell in found:
            f, u = cell.frequency_Hz, cell.standard_uncertainty_Hz
            name = f"{cell.position_m:g} {cell.condition} {cell.motion}"
            out[name] = (math.nan, math.nan, cell.verdict)
            if f is not None and u is not None:
                out[name] = (f, u, cell.verdict)
        return out

    return answers


def preload_analyses(_data: Path, folder: Path) -> dict[str, Analysis]:
    """Calibrations with two loads, and preloads of later runs."""
    return {
        "worn": preload_analysis("as new", 3, folder, 0.0),
        "worn, bearing too": preload_analysis("bearing", 6, folder, 0.0),
        "undeclared load": preload_analysis("as new", 5, folder, UNDECLARED),
    }


def preload_analysis(group: str, seed: int, folder: Path, undeclared: float) -> Analysis:
    """Preload of an axis at 0.85 and 0.6 of that when new."""
    one = bench(seed, group)
    states = {"low": (one.rig.machine, round(LOW_LOAD * one.load, 1)), "new": (one.rig.machine, one.load),
              "0.85": (one.later(0.85), one.load), "0.6": (one.later(0.6), one.load)}  # fmt: skip
    runs: dict[str, Run] = {}
    for number, (state, (machine, load)) in enumerate(states.items()):
        place = folder / f"{group} {seed} {state}"
        place.mkdir()
        rig = replace(one.rig, machine=machine)
        test = replace(one.plan, masses=(load + (undeclared if state == "0.85" else 0.0),))
        day = f"2026-0{number // 2 + 1}-05T{8 + number:02d}:00Z"
        files = simulate_run(
            rig, test, test.masses[0], place, seed=number, sheet=one.sheet, measured_at=day, workers=1
        )
        runs[state] = ballscrew.analyze(
            list(files.recordings), channels=place / "channels.toml", axis=place / "axis.toml",
            plan=replace(one.plan, masses=(load,)), mass=load, measured_at=day,
        )  # fmt: skip

    @single_threaded
    def answers(settings: Settings) -> Answers:
        model = calibrate([runs["low"], runs["new"]], one.sheet, assumptions=settings.assumptions)
        out: Answers = {}
        for state in ("0.85", "0.6"):
            estimate = preload(runs[state], model, runs["new"], assumptions=settings.assumptions)
            for name, quantity, verdict in (
                ("stiffness", estimate.stiffness_relative_to_baseline, estimate.verdict),
                ("nut", estimate.relative_to_baseline, estimate.nut_verdict),
            ):
                out[f"{state} {name}"] = (math.nan, math.nan, verdict)
                if quantity is not None:
                    low, high = quantity.interval
                    out[f"{state} {name}"] = (quantity.value, (high - low) / 4, verdict)
        return out

    return answers


def compared(before: Answers, after: Answers) -> tuple[float, float, int]:
    """Largest move in standard uncertainties, largest factor of a standard uncertainty, changed verdicts."""
    move, factor, verdicts = 0.0, 1.0, 0
    for name, (value, spread, verdict) in before.items():
        other, other_spread, other_verdict = after[name]
        if verdict != other_verdict:
            verdicts += 1
        elif math.isfinite(value + other):
            move = max(move, abs(other - value) / spread)
            ratio = other_spread / spread
            factor = max(factor, ratio, 1 / ratio)
    return move, factor, verdicts


ANALYSES = {"joint": joint_analyses, "preload": preload_analyses}
Effect = tuple[float, float, int, str]  # as compared() returns, and what ended the analysis


def effects(group: str, data: Path, part: int, parts: int) -> list[tuple[Constant, list[Effect]]]:
    """Effects of every ``parts``-th constant of a group, halved and doubled."""
    out = []
    with tempfile.TemporaryDirectory() as folder:
        analyses = ANALYSES[group](data, Path(folder))
        before = {name: analysis(Settings()) for name, analysis in analyses.items()}
        for constant in list(constants(group))[part::parts]:
            row = [effect(constant, constant.changed(factor), analyses, before) for factor in (0.5, 2.0)]
            out.append((constant, row))
            print(f"{constant.label}: {row}", file=sys.stderr, flush=True)
    return out


def effect(
    constant: Constant, value: Number, analyses: Mapping[str, Analysis], before: Mapping[str, Answers]
) -> Effect:
    """Largest effect of one value over all analyses."""
    move, factor, verdicts, ended = 0.0, 1.0, 0, ""
    for name, analysis in analyses.items():
        try:
            with altered(constant, value) as settings:
                after = analysis(settings)
        except (BallscrewError, ArithmeticError, ValueError, IndexError, TypeError) as error:
            ended = type(error).__name__
            continue
        here = compared(before[name], after)
        move, factor, verdicts = max(move, here[0]), max(factor, here[1]), verdicts + here[2]
    return move, factor, verdicts, ended


def table(rows: Sequence[tuple[Constant, list[Effect]]]) -> Iterator[str]:
    """Lines of the table, the most influential first."""
    yield (
        "| constant | value | halved: shift / u | factor of u | verdicts changed | doubled: shift / u "
        "| factor of u | verdicts changed |"
    )
    yield "|---|---|---|---|---|---|---|---|"
    changed = [row for row in rows if any(one != (0.0, 1.0, 0, "") for one in row[1])]
    for constant, row in sorted(changed, key=lambda row: -max(one[0] for one in row[1])):
        cells = " | ".join(effect_cells(*each) for each in row)
        yield f"| {constant.label} | {constant.value} | {cells} |"
    yield ""
    yield f"The {len(rows) - len(changed)} others changed no number."


def effect_cells(move: float, factor: float, verdicts: int, ended: str) -> str:
    """Cells of the table for one value."""
    if ended:
        return f"{ended} | – | –"
    return f"{move:.2f} | {factor:.2f} | {verdicts}"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--data", type=Path, default=Path(os.environ.get("BALLSCREW_DATA", "../shared/data")))
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--page", type=Path)
    given = parser.parse_args()
    for group in PACKAGES:
        rows: list[tuple[Constant, list[Effect]]] = []
        with ProcessPoolExecutor(given.workers) as pool:
            tasks = [
                pool.submit(effects, group, given.data, part, given.workers) for part in range(given.workers)
            ]
            for task in tasks:
                rows += task.result()
        lines = [heading("python -m benchmarks.constants"), "", *table(rows)]
        print("\n".join(lines), end="\n\n")
        if given.page is not None:
            write(given.page, f"constants, {group}", lines)


if __name__ == "__main__":
    main()
