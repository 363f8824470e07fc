"""What ``ballscrew plan`` is asked besides checking: the best stops and loads, and what the axis can show."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.markup import escape
from rich.table import Table

from ballscrew.base.errors import InputError
from ballscrew.base.percent import percent
from ballscrew.base.units import parse
from ballscrew.cli.output import check_folder, console, count
from ballscrew.fcft.planned import PlannedTest

if TYPE_CHECKING:
    from ballscrew.fcft.optimise import Optimised
    from ballscrew.fcft.worth import Worth
    from ballscrew.monitoring.capability import Capability

__all__ = ["Answers", "Ask", "answer", "check_ask", "print_answers", "write_optimised"]

_WORDS = {
    "compliance": "compliance in the middle",
    "slope": "its slope along the axis",
    "curve": "its curve along the axis",
    "mass": "moving mass without load",
    "rotor": "rotor, as a mass",
    "share": "the nut's share of the compliance",
    "preload": "preload in newtons",
}


@dataclass(frozen=True, slots=True)
class Ask:
    """What is asked.

    Parameters
    ----------
    optimize, capability : bool
        Whether for the best stops and loads, and for the smallest loss.
    out : Path, optional
        Where the best plan is written.
    loads, change : str, optional
        That can be laid on the table; time to change the load.
    model : Path, optional
        MODEL.json.
    baseline : tuple of Path
        RUN.json.
    """

    optimize: bool = False
    capability: bool = False
    out: Path | None = None
    loads: str | None = None
    change: str | None = None
    model: Path | None = None
    baseline: tuple[Path, ...] = ()


@dataclass(frozen=True, slots=True)
class Answers:
    """What is answered; None where it was not asked."""

    optimised: Optimised | None = None
    capability: Capability | None = None

    def to_json(self) -> dict[str, Any]:
        """Keys to be added to the plan's document."""
        document: dict[str, Any] = {}
        if self.optimised is not None:
            document["optimized"] = self.optimised.to_json()
        if self.capability is not None:
            document["capability"] = self.capability.to_json()
        return document


def check_ask(ask: Ask) -> None:
    """Find an option that belongs to what was not asked, and a file that cannot be written."""
    for given, option, needed, there in (
        (ask.out, "--out", "--optimize", ask.optimize),
        (ask.loads, "--loads", "--optimize", ask.optimize),
        (ask.change, "--change", "--optimize", ask.optimize),
        (ask.model, "--model", "--optimize or --capability", ask.optimize or ask.capability),
        (ask.baseline or None, "--baseline", "--capability", ask.capability),
    ):
        if given is not None and not there:
            raise InputError(f"{option} was given without {needed}; they go together.")
    if ask.out is not None:
        check_folder(ask.out)


def answer(ask: Ask, test: PlannedTest) -> Answers:
    """Work out what was asked."""
    optimised = capability = None
    if ask.optimize:
        from ballscrew.fcft.optimise import CHANGE_MINUTES, optimise

        change = CHANGE_MINUTES if ask.change is None else _given("--change", ask.change, "s") / 60
        loads = None if ask.loads is None else [_given("--loads", one, "kg") for one in ask.loads.split(",")]
        model = covariance = None
        if ask.model is not None:
            from ballscrew.monitoring.capability import known_axis

            middle = (test.plan.positions[0] + test.plan.positions[-1]) / 2
            model, covariance, _ = known_axis(ask.model, test.sheet, middle)
        optimised = optimise(
            test.plan, test.sheet, loads=loads, change_minutes=change, model=model, covariance=covariance
        )
    if ask.capability:
        from ballscrew.monitoring.capability import capability as capability_of

        capability = capability_of(test.plan, axis=test.sheet, model=ask.model, baseline=ask.baseline)
    return Answers(optimised, capability)


def write_optimised(ask: Ask, answers: Answers, tell: Callable[..., Any]) -> None:
    """Write the best plan where it was asked for."""
    if ask.out is None or answers.optimised is None:
        return
    from ballscrew.base.files import write_texts
    from ballscrew.fcft.planfile import plan_toml

    write_texts([(ask.out, [plan_toml(answers.optimised.plan)])])
    tell(f"Optimised plan: {escape(str(ask.out))}")


def print_answers(answers: Answers) -> None:
    """Print them as tables and sentences."""
    if answers.optimised is not None:
        _print_optimised(answers.optimised)
    if answers.capability is not None:
        _print_capability(answers.capability)


def _given(option: str, text: str, unit: str) -> float:
    try:
        return parse(text.strip(), unit)
    except InputError as error:
        raise InputError(f"{option} is {text!r}; it must be a quantity in {unit} ({error}).") from None


def _print_optimised(best: Optimised) -> None:
    out = console()
    stops = ", ".join(f"{1e3 * x:g}" for x in best.plan.positions)
    loads = ", ".join(f"{load:g}" for load in best.plan.masses)
    out.print(
        f"[bold]Most per minute:[/] {count(len(best.plan.positions), 'stop')} at {stops} mm with "
        f"{count(len(best.plan.masses), 'load')} of {loads} kg, "
        f"of {count(len(best.stops), 'stop')} and {count(len(best.loads), 'load')} to choose from"
    )
    out.print(
        f"{_minutes(best.worth)} in all, {best.change_minutes:g} min to change the load; the plan as given "
        f"takes {_minutes(best.given)}."
    )
    if math.isfinite(best.ratio):
        out.print(f"Information per minute: [bold]{best.ratio:.2f} times[/] that of the plan as given.")
    else:
        out.print(
            "The plan as given leaves a number open that data could tell: it has one load, or too few stops."
        )
    table = Table(title="Expected accuracy, one standard uncertainty", title_justify="left")
    for heading in ("", best.known_from, "plan as given", "most per minute"):
        table.add_column(heading, justify="left" if not heading else "right", no_wrap=True)
    for given, chosen in zip(best.given.accuracy, best.worth.accuracy, strict=True):
        table.add_row(_WORDS[given.name], percent(given.before), percent(given.after), percent(chosen.after))
    for now, then in zip(best.given.later, best.worth.later, strict=True):
        table.add_row(
            f"a later P/P₀ of {now.ratio:g}",
            "–",
            f"{now.standard_uncertainty:.3f}, runs {now.random:.3f}",
            f"{then.standard_uncertainty:.3f}, runs {then.random:.3f}",
        )
    out.print(table)
    out.print(
        "Runs: what scatters from run to run and averages out. The rest is the nut's share of "
        "the compliance, which no choice of stops and loads tells: two runs at two known preloads do.",
        markup=False,
    )
    one = best.scatter
    of_run = one.of_run(best.plan.repetitions)
    out.print(
        f"Taken for it ({one.source}): {of_run:.2f} Hz from run to run, {one.lasting:.2f} Hz in all runs "
        f"alike, {one.cell:.2f} Hz a cell, loads known to {100 * one.load:g} %.",
        markup=False,
    )


def _print_capability(found: Capability) -> None:
    out = console()
    measured = max(run.runs for run in found.scatter)
    where = f"a baseline of {count(found.baseline_runs, 'run')}" + ("" if measured else ", none measured yet")
    out.print(
        f"[bold]Smallest loss of preload that this axis shows[/]: a false alarm in one of "
        f"{1 / found.false_alarm:.0f} tests, the loss called in {100 * found.power:.0f} of 100, {where}"
    )
    table = Table()
    for heading in (
        "load\nkg",
        "after\nruns",
        "loss\n% of P",
        "95 % interval\n% of P",
        "change in the\nmiddle, Hz",
    ):
        table.add_column(heading, justify="right", no_wrap=True)
    for one in found.smallest:
        if one.loss is None or one.interval95 is None:
            table.add_row(f"{one.load_kg:g}", str(one.runs), "–", "–", "–")
            continue
        low, high = one.interval95
        table.add_row(
            f"{one.load_kg:g}",
            str(one.runs),
            f"{100 * one.loss:.1f}",
            f"{100 * low:.1f} to {100 * high:.1f}",
            f"{one.change_Hz:.2f}",
        )
    out.print(table)
    out.print(
        f"The interval is what the {found.known_from} does not know of the axis, above all the nut's share "
        f"of the compliance, {found.share:.2f} ± {found.share_standard_uncertainty:.2f}.",
        markup=False,
    )
    for run in found.scatter:
        out.print(
            f"  • one run with {run.load_kg:g} kg scatters by {run.level_Hz:.3f} Hz, "
            f"{percent(run.log_ratio)} of the preload ({run.degrees:g} degrees of freedom)",
            markup=False,
        )
    for sentence in found.notes:
        out.print(f"  • {sentence}", markup=False)


def _minutes(worth: Worth) -> str:
    minutes = worth.minutes
    return f"{minutes:.1f} min" if minutes < 120 else f"{minutes / 60:.1f} h"
