"""``ballscrew preload``."""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

from rich.markup import escape
from rich.table import Table

from ballscrew.base.errors import DONE, REFUSED, InputError, printable
from ballscrew.base.jsonfile import SCHEMA
from ballscrew.base.quantity import Quantity
from ballscrew.base.result import check_export, export_table
from ballscrew.base.words import form, plural, without_repeats
from ballscrew.calibration.assumptions import Assumptions
from ballscrew.calibration.modelfile import read_model
from ballscrew.calibration.preload_groups import sort_key
from ballscrew.cli.output import (
    TIME_WIDTH,
    VERDICT_STYLE,
    check_outputs,
    console,
    print_json,
    right_aligned,
    styled_verdict,
)
from ballscrew.estimation.estimate import PreloadEstimate
from ballscrew.estimation.preload import preload
from ballscrew.modal.run import Run
from ballscrew.report.canvas import check_target, save_figure

_TERMS = 6  # largest terms of the uncertainty that are printed
_WIDTH = 36  # characters of the first column
_OF_CALIBRATION = "calibration is suspect ("  # followed by the name of the doubt


def preload_command(
    paths: Sequence[Path],
    *,
    model: Path,
    baselines: Sequence[Path],
    assumptions: Assumptions,
    accept: Sequence[str],
    verbose: bool,
    as_json: bool,
    plot: Path | None,
    table: Path | None = None,
) -> int:
    """Estimate the preload of each run, print and plot it, and return the exit status."""
    if plot is not None:
        check_target(plot)
    if table is not None:
        check_export(table)
    check_outputs((plot, table), (model, *paths, *baselines))
    axis = read_model(model)
    runs = [Run.read(path) for path in paths]
    baseline_runs = [Run.read(path) for path in baselines]
    if len({run.id for run in baseline_runs}) < len(baseline_runs):
        raise InputError("a baseline is given twice; each file is one run.")
    baseline = baseline_runs[0] if baseline_runs else None
    estimates = []
    for run in runs:
        estimate = preload(
            run, axis, baseline, more=baseline_runs[1:], assumptions=assumptions, accept=accept
        )
        estimates.append(estimate)
    if plot is not None:
        _plot(estimates, plot)
    if table is not None:
        _export(estimates, runs, table)
    if as_json:
        _print_json(estimates)
        return max(map(_report_refusal, estimates, runs))
    names = {run.id: run.name for run in (*runs, *baseline_runs)}
    console().print(_answer(max(estimates, key=lambda estimate: sort_key(estimate.measured_at))))
    if len(estimates) == 1:
        _print_estimate(estimates[0], names, verbose=verbose)
    else:
        _print_table(estimates, names, verbose=verbose)
    _print_options(estimates, verbose=verbose)
    return max(map(_report_refusal, estimates, runs))


def _print_options(estimates: Sequence[PreloadEstimate], *, verbose: bool) -> None:
    """Options that could follow on this result."""
    if any(_OF_CALIBRATION in reason for estimate in estimates for reason in estimate.reasons):
        console().print("To accept a doubt of the calibration after a check: --accept NAME", markup=False)
    if not verbose:
        console().print("Parts of the uncertainty, checks and causes: --verbose", markup=False)


def _plot(estimates: Sequence[PreloadEstimate], path: Path) -> None:
    if len(estimates) == 1:
        from ballscrew.report.preload_figure import draw_preload

        save_figure(draw_preload(estimates[0]), path)
    else:
        from ballscrew.report.preload_map_figure import draw_preload_map

        save_figure(draw_preload_map(estimates), path)


def _export(estimates: Sequence[PreloadEstimate], runs: Sequence[Run], path: Path) -> None:
    """Write one table of the quantities of all runs."""
    import pandas as pd

    tables = []
    for estimate, run in zip(estimates, runs, strict=True):
        about = {"run": run.name, "measured_at": estimate.measured_at, "verdict": estimate.verdict}
        columns = estimate.to_dataframe()
        for place, (name, value) in enumerate(about.items()):
            columns.insert(place, name, value)
        tables.append(columns)
    export_table(pd.concat(tables), path)


def _print_json(estimates: Sequence[PreloadEstimate]) -> None:
    documents = [estimate.to_json() for estimate in estimates]
    if len(documents) == 1:
        print_json(documents[0])
    else:
        print_json({"schema": SCHEMA, "runs": documents})


def _report_refusal(estimate: PreloadEstimate, run: Run) -> int:
    """Print the reasons of a refusal on standard error.

    Returns status 1 if a run with frequencies, or a bad measurement, was refused, else 0.
    """
    if estimate.verdict != "refused":
        return DONE
    for reason in without_repeats(estimate.reasons):
        sys.stderr.write(f"ballscrew: {printable(run.name)}: refused: {printable(reason)}\n")
    has_frequencies = any(cell.frequency_Hz is not None for cell in run.cells)
    return REFUSED if has_frequencies or run.quality.verdict == "bad" else DONE


def _answer(estimate: PreloadEstimate) -> str:
    """The nut's preload in one line, as markup."""
    nut, reference = estimate.relative_to_model, "the model's preload"
    if estimate.baseline is not None:
        nut, reference = estimate.relative_to_baseline, "the baseline preload"
    axis = escape(estimate.axis or "axis")
    if nut is None:
        return f"[bold]{axis}: no estimate of the preload[/]"
    low, high = 100 * nut.interval[0], 100 * nut.interval[1]
    text = f"{100 * nut.value:.0f} % of {reference} (95 %: {low:.0f} to {high:.0f} %)"
    if not low > 0:
        text = f"below {high:.0f} % of {reference}"
    elif math.isinf(high):
        text = f"above {low:.0f} % of {reference}"
    return f"[bold]{axis}: {text}[/], {styled_verdict(estimate.nut_verdict)}"


def _print_estimate(estimate: PreloadEstimate, names: Mapping[str, str], *, verbose: bool) -> None:
    screen = console()
    text = f"Run {names[estimate.run]}"
    if estimate.baseline is not None:
        text += f", baseline {names[estimate.baseline]}"
    screen.print(text, markup=False)
    heading = "Axial stiffness" if estimate.baseline is not None else "Comparison with the model"
    of_nut = [reason for reason in estimate.nut_reasons if reason not in estimate.reasons]
    reasons = without_repeats((*estimate.reasons, *of_nut))
    count = len(estimate.reasons)
    _print_part(heading, estimate.verdict, reasons[:count], _stiffness_lines(estimate))
    _print_part("Preload of the nut", estimate.nut_verdict, reasons[count:], _nut_lines(estimate))
    if not verbose:
        return
    for line in _uncertainty_lines(estimate) + _check_lines(estimate):
        screen.print(line, markup=False)
    if estimate.causes:
        screen.print(_cause_table(estimate))
    for note in estimate.notes:
        screen.print(f"  • {note}", markup=False)


def _print_part(heading: str, verdict: str, reasons: Sequence[str], lines: Sequence[str]) -> None:
    """A result with its verdict, reasons and quantities."""
    console().print(f"{heading}: [bold {VERDICT_STYLE[verdict]}]{verdict}[/]")
    for line in [*(f"  • {reason}" for reason in reasons), *lines]:
        console().print(line, markup=False)


def _uncertainty_lines(estimate: PreloadEstimate) -> list[str]:
    if estimate.random_ratio is None or estimate.systematic_ratio is None:
        return []
    total = (
        f"Standard uncertainty of the first ratio: {estimate.random_ratio:.3f} is random (differs in every "
        f"run), {estimate.systematic_ratio:.3f} is systematic:"
    )
    return [total] + [f"  {term.standard_uncertainty:.3f}  {term.name}" for term in estimate.terms[:_TERMS]]


def _check_lines(estimate: PreloadEstimate) -> list[str]:
    lines = []
    if estimate.chi2 is not None and estimate.degrees is not None:
        lines.append(
            f"Agreement of the cells with one preload: χ² {estimate.chi2:.1f}, "
            f"expected {estimate.degrees:.1f}"
        )
    if estimate.nut_or_bearing is not None and estimate.nut_or_bearing.identifiable:
        lines.append(f"Nut or bearing: {estimate.nut_or_bearing.text}")
    if estimate.profile is not None:
        lines.append(f"Along the axis: {estimate.profile.text}")
    if estimate.mass is not None:
        lines.append(f"Load: {estimate.mass.text}")
    return lines + [f"Corrected: {correction}" for correction in estimate.corrections]


def _stiffness_lines(estimate: PreloadEstimate) -> list[str]:
    stiffness = estimate.stiffness_relative_to_baseline
    if stiffness is None:
        return []
    text = f"  corresponds to {100 * stiffness.value:.0f} % of the baseline preload"
    if estimate.nut_verdict != "good":
        text += ", if nothing but the nut has changed"
    return [text, *_quantity_lines([("  as P/P₀", stiffness, 1.0, "")])]


def _nut_lines(estimate: PreloadEstimate) -> list[str]:
    nut = estimate.relative_to_baseline
    if nut is not None and not nut.interval[0] > 0:
        return [f"  below {100 * nut.interval[1]:.0f} % of the baseline preload"]
    rows = [("  relative to the baseline", nut, 1.0, "")]
    if estimate.baseline is None:
        rows = [("  relative to the model", estimate.relative_to_model, 1.0, "")]
    rows.append(("  in newtons", estimate.preload_N, 1.0, "N"))
    rows.append(("  of the load rating Ca", estimate.preload_ratio, 100.0, "%"))
    return _quantity_lines(rows)


def _quantity_lines(rows: Sequence[tuple[str, Quantity | None, float, str]]) -> list[str]:
    lines = []
    for words, quantity, scale, unit in rows:
        if quantity is not None:
            lines.append(f"{words:<{_WIDTH}} {_format_quantity(quantity, scale, unit)}")
    return lines


def _format_quantity(quantity: Quantity, scale: float, unit: str) -> str:
    scaled = Quantity(scale * quantity.value, scale * quantity.standard_uncertainty, unit)
    low, high = scale * quantity.interval[0], scale * quantity.interval[1]
    digits = 3 if unit == "" else 2
    if unit == "N" and low > 100:
        digits = 0
    return f"{scaled}, 95 %: {low:.{digits}f} to {high:.{digits}f} {unit}".rstrip()


def _cause_table(estimate: PreloadEstimate) -> Table:
    table = Table(title="Possible causes of the change", title_justify="left")
    table.add_column("cause")
    table.add_column("probability", justify="right")
    table.add_column("remaining χ²", justify="right")
    table.add_column("change if this is the cause")
    for cause in estimate.causes:
        text = cause.text if cause.possible else f"[dim]{cause.text}[/]"
        table.add_row(cause.name, f"{cause.probability:.2f}", f"{cause.chi2:.1f}", text)
    return table


def _print_table(estimates: Sequence[PreloadEstimate], names: Mapping[str, str], *, verbose: bool) -> None:
    screen = console()
    relative = any(estimate.baseline is not None for estimate in estimates)
    headings = ["measured at", "stiffness, P/P₀", "95 %", "verdict", "nut, 95 %", "preload, N"]
    if not relative:
        headings = ["measured at", "verdict", "P/P of the model", "95 %", "preload, N"]
    table = right_aligned(headings, "nut", title=plural(len(estimates), "run"))
    for estimate in estimates:
        row = [escape(_label(estimate, names))]
        if relative:
            stiffness = estimate.stiffness_relative_to_baseline
            row += [_value(stiffness), _interval(stiffness), styled_verdict(estimate.verdict)]
            row.append(_interval(estimate.relative_to_baseline))
        else:
            nut = estimate.relative_to_model
            row += [styled_verdict(estimate.verdict), _value(nut), _interval(nut)]
        table.add_row(*row, _value(estimate.preload_N), styled_verdict(estimate.nut_verdict))
    screen.print(table)
    _print_remarks(estimates, names, verbose=verbose)


def _print_remarks(estimates: Sequence[PreloadEstimate], names: Mapping[str, str], *, verbose: bool) -> None:
    """Each reason once, and note if verbose, with its runs; numbers in it are those of the first."""
    runs: dict[str, tuple[str, list[str]]] = {}
    for estimate in estimates:
        notes = estimate.notes if verbose else ()
        texts = {form(text): text for text in (*estimate.reasons, *estimate.nut_reasons, *notes)}
        for alike, text in texts.items():
            runs.setdefault(alike, (text, []))[1].append(_label(estimate, names))
    lines = []
    for text, labels in runs.values():
        which = plural(len(labels), "run")
        if len(labels) == 1:
            which = labels[0]
        elif len(labels) == len(estimates):
            which = "all runs"
        lines.append(f"{which}: {text}")
    for line in without_repeats(lines):
        console().print(f"  • {line}", markup=False)


def _label(estimate: PreloadEstimate, names: Mapping[str, str]) -> str:
    """Time of a run to the minute, or else its file."""
    return (estimate.measured_at or "")[:TIME_WIDTH] or names[estimate.run]


def _value(quantity: Quantity | None) -> str:
    if quantity is None:
        return "–"
    return str(Quantity(quantity.value, quantity.standard_uncertainty))


def _interval(quantity: Quantity | None) -> str:
    if quantity is None:
        return "–"
    low, high = quantity.interval
    return f"{low:.2f} to {high:.2f}"
