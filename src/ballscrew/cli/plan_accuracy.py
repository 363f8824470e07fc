"""Accuracy options of ``ballscrew plan``: best stops and loads, smallest detectable loss."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.markup import escape
from rich.table import Table

from ballscrew.axis.axial_prior import KNOWN_PRELOAD
from ballscrew.base.errors import InputError
from ballscrew.base.files import check_folder
from ballscrew.base.units import parse_named
from ballscrew.base.words import duration, percent, plural
from ballscrew.cli.output import (
    console,
    right_aligned,
)
from ballscrew.fcft.plan import Plan
from ballscrew.fcft.planned import PlannedTest

if TYPE_CHECKING:
    from ballscrew.fcft.optimise import Optimised
    from ballscrew.fcft.plan_information import PlanInformation
    from ballscrew.monitoring.capability import Capability

_WORDS = {
    "compliance": "compliance at mid-travel",
    "slope": "slope of the compliance",
    "curve": "curvature of the compliance",
    "mass": "moving mass without load",
    "rotor": "rotor, as a mass",
    "share": "nut's share of the compliance",
    "preload": "preload in newtons",
}


@dataclass(frozen=True, slots=True)
class AccuracyOptions:
    """Options of ``plan`` about accuracy.

    Parameters
    ----------
    optimize, capability : bool
        Whether to choose stops and loads, and to compute the smallest detectable loss.
    out : Path, optional
        File for the chosen plan.
    loads, change, preloads, adjust : str, optional
        Candidate loads and time to change the load; candidate preloads and time to set another one.
    model : Path, optional
        MODEL.json.
    baseline : tuple of Path
        RUN.json of runs of the new axis.
    """

    optimize: bool = False
    capability: bool = False
    out: Path | None = None
    loads: str | None = None
    change: str | None = None
    model: Path | None = None
    baseline: tuple[Path, ...] = ()
    preloads: str | None = None
    adjust: str | None = None

    def check(self) -> None:
        """Refuse an option without the one that it belongs to, and a file that cannot be written."""
        for option, value in (
            ("--out", self.out), ("--loads", self.loads), ("--change", self.change),
            ("--preloads", self.preloads), ("--adjust", self.adjust),
        ):  # fmt: skip
            _require(option, value, "--optimize", given=self.optimize)
        _require("--model", self.model, "--optimize or --capability", given=self.optimize or self.capability)
        _require("--baseline", self.baseline or None, "--capability", given=self.capability)
        if self.out is not None:
            check_folder(self.out)


def _require(option: str, value: object, needed: str, *, given: bool) -> None:
    if value is not None and not given:
        raise InputError(f"{option} was given without {needed}; they go together.")


@dataclass(frozen=True, slots=True)
class Prediction:
    """Chosen plan and smallest detectable loss; None where not requested."""

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


def predict_accuracy(options: AccuracyOptions, test: PlannedTest) -> Prediction:
    """Compute the requested predictions."""
    optimised = capability = None
    if options.optimize:
        optimised = _optimise(options, test)
    if options.capability:
        from ballscrew.monitoring.capability import capability as compute_capability

        capability = compute_capability(
            test.plan, axis=test.sheet, model=options.model, baseline=options.baseline
        )
    return Prediction(optimised, capability)


def _minutes(option: str, text: str) -> float:
    """Minutes of an option, which must have a unit: a bare number would be seconds."""
    if text.strip().rstrip(".")[-1:].isdigit():
        raise InputError(f"{option} is {text!r}; state its unit, such as '10 min'.")
    return parse_named(option, text, "s") / 60


def _optimise(options: AccuracyOptions, test: PlannedTest) -> Optimised:
    from ballscrew.fcft.optimise import ADJUST_MINUTES, CHANGE_MINUTES, optimise

    change = CHANGE_MINUTES
    if options.change is not None:
        change = _minutes("--change", options.change)
    adjust = ADJUST_MINUTES
    if options.adjust is not None:
        adjust = _minutes("--adjust", options.adjust)
    loads = preloads = None
    if options.loads is not None:
        loads = [parse_named("--loads", text, "kg") for text in options.loads.split(",")]
    if options.preloads is not None:
        preloads = [parse_named("--preloads", text, "N") for text in options.preloads.split(",")]
    model = covariance = None
    if options.model is not None:
        from ballscrew.monitoring.capability import known_axis

        middle = (test.plan.positions[0] + test.plan.positions[-1]) / 2
        model, covariance, *_ = known_axis(options.model, test.sheet, middle)
    return optimise(
        test.plan,
        test.sheet,
        loads=loads,
        preloads=preloads,
        change_minutes=change,
        adjust_minutes=adjust,
        model=model,
        covariance=covariance,
    )


def write_optimised(options: AccuracyOptions, prediction: Prediction, report: Callable[..., Any]) -> None:
    """Write the chosen plan if a file was given."""
    if options.out is None or prediction.optimised is None:
        return
    from ballscrew.base.files import write_texts
    from ballscrew.fcft.planfile import plan_toml

    write_texts([(options.out, [plan_toml(prediction.optimised.plan)])])
    report(f"Optimised plan: {escape(str(options.out))}")


def print_prediction(prediction: Prediction) -> None:
    """Print the predictions as tables and sentences."""
    if prediction.optimised is not None:
        _print_optimised(prediction.optimised)
    if prediction.capability is not None:
        _print_capability(prediction.capability)


def _print_optimised(best: Optimised) -> None:
    screen = console()
    stops = ", ".join(f"{round(1e3 * x, 1):g}" for x in best.plan.positions)
    loads = ", ".join(f"{load:.4g}" for load in best.plan.masses)
    candidates = [plural(len(best.stops), "stop"), plural(len(best.loads), "load")]
    factors = f"{plural(len(best.plan.masses), 'load')} of {loads} kg"
    changes = f"{best.change_minutes:g} min to change the load"
    if best.preloads:
        candidates.append(plural(len(best.preloads), "preload"))
        factors += f" and {plural(len(best.plan.preloads), 'preload')} of {_newtons(best.plan)}"
        changes += f", {best.adjust_minutes:g} min to set another preload"
    screen.print(
        f"[bold]Most information per minute:[/] {plural(len(best.plan.positions), 'stop')} at {stops} mm "
        f"with {factors}, chosen from {', '.join(candidates[:-1])} and {candidates[-1]}"
    )
    screen.print(
        f"{duration(60 * best.chosen.minutes)} in all, {changes}; "
        f"the given plan takes {duration(60 * best.given.minutes)}."
    )
    if math.isfinite(best.ratio):
        screen.print(f"Information per minute: [bold]{best.ratio:.2f} times[/] that of the given plan.")
    else:
        few = "it has one load, or too few stops"
        if best.preloads:
            few = "it has one load, fewer than two preloads, or too few stops"
        screen.print(f"The given plan leaves a parameter undetermined: {few}.")
    screen.print(_accuracy_table(best))
    rest = "which no choice of stops and loads determines; two runs at two known preloads do"
    if len(best.plan.preloads) > 1:
        rest = "by the ratio of the known preloads"
    screen.print(
        "Runs: the part that differs from run to run and averages out. The rest is the uncertainty of the "
        f"nut's share of the compliance, {rest}.",
        markup=False,
    )
    scatter = best.scatter
    screen.print(
        f"Assumed scatter ({scatter.source}): {scatter.of_run(best.plan.repetitions):.2f} Hz between runs, "
        f"{scatter.lasting:.2f} Hz common to all runs, {scatter.cell:.2f} Hz per cell, loads known to "
        f"{100 * scatter.load:g} %.",
        markup=False,
    )


def _newtons(plan: Plan) -> str:
    return ", ".join(f"{preload:.4g}" for preload in plan.preloads) + " N"


def print_calibration(plan: Plan, expected: PlanInformation) -> None:
    """Print the runs of a plan with preloads, what they determine, and the expected accuracy."""
    screen = console()
    screen.print(
        f"[bold]{plural(plan.run_count, 'run')}[/]: {plural(len(plan.masses), 'load')} at "
        f"{plural(len(plan.preloads), 'preload')} ({_newtons(plan)}). Their frequencies determine "
        f"{expected.rank} of {expected.parameters} parameters without the data sheet:"
    )
    factors = (
        (len(plan.positions), "stop", "the slope of the compliance"),
        (len(plan.masses), "load", "the moving mass"),
        (len(plan.preloads), "preload", "the nut's share of the compliance, its law"),
    )
    for count, factor, parameter in factors:
        determine = "determine" if count > 1 else "does not determine"
        screen.print(f"  • {plural(count, factor)} {determine} {parameter}")
    table = Table(title="Expected standard uncertainty of the calibrated model", title_justify="left")
    table.add_column("", no_wrap=True)
    for heading in ("data sheet", "with all runs"):
        table.add_column(heading, justify="right", no_wrap=True)
    for row in expected.accuracy:
        table.add_row(_WORDS[row.name], percent(row.before), percent(row.after))
    for run in expected.later:
        table.add_row(f"a later P/P₀ of {run.ratio:g}", "–", f"{run.standard_uncertainty:.3f}")
    screen.print(table)
    screen.print(
        "Set the nut, run every load, then set it anew. Each preload is assumed to be known to "
        f"{percent(KNOWN_PRELOAD)}. To calibrate, state that of every run: --known-preload RUN.json="
        f"{plan.preloads[0]:g}N",
        markup=False,
        soft_wrap=True,
    )


def _accuracy_table(best: Optimised) -> Table:
    table = Table(title="Predicted standard uncertainty", title_justify="left")
    table.add_column("", no_wrap=True)
    for heading in (best.known_from, "given plan", "chosen plan"):
        table.add_column(heading, justify="right", no_wrap=True)
    for given, chosen in zip(best.given.accuracy, best.chosen.accuracy, strict=True):
        table.add_row(_WORDS[given.name], percent(given.before), percent(given.after), percent(chosen.after))
    for given_run, chosen_run in zip(best.given.later, best.chosen.later, strict=True):
        table.add_row(
            f"a later P/P₀ of {given_run.ratio:g}",
            "–",
            f"{given_run.standard_uncertainty:.3f}, runs {given_run.random:.3f}",
            f"{chosen_run.standard_uncertainty:.3f}, runs {chosen_run.random:.3f}",
        )
    return table


def _print_capability(result: Capability) -> None:
    screen = console()
    baseline = f"a baseline of {plural(result.baseline_runs, 'run')}"
    if max(run.runs for run in result.scatter) == 0:
        baseline += ", none measured yet"
    screen.print(
        f"[bold]Smallest detectable loss of preload[/]: with a false alarm in one of "
        f"{1 / result.false_alarm:.0f} tests, a loss detected in {100 * result.power:.0f} of 100, "
        f"and {baseline}"
    )
    headings = (
        "load\nkg",
        "after\nruns",
        "loss\n% of P",
        "95 % interval\n% of P",
        "change at\nmid-travel, Hz",
    )
    table = right_aligned(headings)
    for loss in result.smallest:
        row = [f"{loss.load_kg:g}", str(loss.runs), "–", "–", "–"]
        if loss.loss is not None and loss.interval95 is not None:
            low, high = loss.interval95
            row[2:] = [
                f"{100 * loss.loss:.1f}",
                f"{100 * low:.1f} to {100 * high:.1f}",
                f"{loss.change_Hz:.2f}",
            ]
        table.add_row(*row)
    screen.print(table)
    screen.print(
        f"The interval reflects the uncertainty of the axis by the {result.known_from}, mainly that of the "
        f"nut's share of the compliance, {result.share:.2f} ± {result.share_standard_uncertainty:.2f}.",
        markup=False,
    )
    for run in result.scatter:
        screen.print(
            f"  • scatter of one run with {run.load_kg:g} kg: {run.level_Hz:.3f} Hz, "
            f"{percent(run.log_ratio)} of the preload ({run.degrees:.2g} degrees of freedom)",
            markup=False,
        )
    for sentence in result.notes:
        screen.print(f"  • {sentence}", markup=False)
