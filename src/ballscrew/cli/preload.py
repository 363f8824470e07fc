"""``ballscrew preload``."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rich.markup import escape
from rich.table import Table

from ballscrew.base.errors import DONE, REFUSED, InputError
from ballscrew.base.jsonfile import SCHEMA
from ballscrew.base.quantity import Quantity
from ballscrew.calibration.assumptions import Assumptions
from ballscrew.calibration.modelfile import read_model
from ballscrew.cli.output import VERDICT_STYLE, console, count, print_json
from ballscrew.estimation.estimate import PreloadEstimate
from ballscrew.estimation.preload import preload
from ballscrew.modal.run import Run

__all__ = ["preload_command"]

_TERMS = 6
_WIDTH = 36


def preload_command(
    paths: Sequence[Path],
    *,
    model: Path,
    baselines: Sequence[Path],
    assumptions: Assumptions,
    as_json: bool,
    plot: Path | None,
) -> int:
    """Tell the preload of each run, print and draw it, and return the exit status."""
    if plot is not None:
        from ballscrew.report.canvas import check_target

        check_target(plot)
    calibrated = read_model(model)
    runs = [Run.read(path) for path in paths]
    base = [Run.read(path) for path in baselines]
    if len({run.id for run in base}) < len(base):
        raise InputError("a baseline was given twice; each file is one run.")
    found = [
        preload(run, calibrated, base[0] if base else None, more=base[1:], assumptions=assumptions)
        for run in runs
    ]
    if plot is not None:
        _draw(found, plot)
    if as_json:
        documents: list[dict[str, Any]] = [one.to_json() for one in found]
        print_json(documents[0] if len(documents) == 1 else {"schema": SCHEMA, "runs": documents})
    elif len(found) == 1:
        _say(found[0])
    else:
        _list(found)
    return max(_status(one, run) for one, run in zip(found, runs, strict=True))


def _draw(found: Sequence[PreloadEstimate], path: Path) -> None:
    from ballscrew.report.canvas import save_figure
    from ballscrew.report.preload_figure import draw_preload
    from ballscrew.report.preload_map_figure import draw_preload_map

    save_figure(draw_preload(found[0]) if len(found) == 1 else draw_preload_map(found), path)


def _status(one: PreloadEstimate, run: Run) -> int:
    """1 where nothing is told of a run that has frequencies, or is a bad measurement; the reasons always."""
    if one.verdict != "refused":
        return DONE
    for reason in one.reasons:
        sys.stderr.write(f"ballscrew: {one.run[:12]}: refused: {reason}\n")
    read = any(cell.frequency_Hz is not None for cell in run.cells)
    return REFUSED if read or run.quality.verdict == "bad" else DONE


def _say(one: PreloadEstimate) -> None:
    out = console()
    out.print(f"[bold]{escape(one.axis or 'axis')}[/], run {escape(one.run[:12])}{_since(one)}")
    out.print(f"Verdict: [bold {VERDICT_STYLE[one.verdict]}]{one.verdict}[/]")
    for reason in one.reasons:
        out.print(f"  • {reason}", markup=False)
    rows = (
        ("Preload", one.preload_N, 1.0, "N"),
        ("  of the load rating Ca", one.preload_ratio, 100.0, "%"),
        ("  over the baseline's", one.relative_to_baseline, 1.0, ""),
        (f"    {_if_bearing(one)}", one.relative_if_bearing_changed, 1.0, ""),
        ("  over the model's", one.relative_to_model if one.baseline is None else None, 1.0, ""),
    )
    for words, quantity, scale, unit in rows:
        if quantity is not None:
            out.print(f"{words:<{_WIDTH}} {_number(quantity, scale, unit)}", markup=False)
    if one.random_ratio is not None and one.systematic_ratio is not None:
        out.print(
            f"Of the ratio's ±, {one.random_ratio:.3f} is random (another run would draw it anew), "
            f"and {one.systematic_ratio:.3f} is not:"
        )
        for term in one.terms[:_TERMS]:
            out.print(f"  {term.standard_uncertainty:.3f}  {term.name}", markup=False)
    if one.chi2 is not None and one.degrees is not None:
        out.print(f"Cells against one preload: χ² {one.chi2:.1f}, {one.degrees:.1f} expected")
    if one.along is not None:
        out.print(f"Along the axis: {one.along.text}", markup=False)
    if one.mass is not None:
        out.print(f"Load: {one.mass.text}", markup=False)
    for correction in one.corrections:
        out.print(f"Corrected: {correction}", markup=False)
    if one.causes:
        out.print(_causes(one))
    for note in one.notes:
        out.print(f"  • {note}", markup=False)


def _since(one: PreloadEstimate) -> str:
    return "" if one.baseline is None else f", baseline {escape(one.baseline[:12])}"


def _number(quantity: Quantity, scale: float, unit: str) -> str:
    scaled = Quantity(scale * quantity.value, scale * quantity.standard_uncertainty, unit)
    low, high = (scale * end for end in quantity.interval)
    digits = 3 if unit == "" else 0 if unit == "N" and low > 100 else 2
    return f"{scaled}, 95 %: {low:.{digits}f} to {high:.{digits}f} {unit}".rstrip()


def _causes(one: PreloadEstimate) -> Table:
    table = Table(title="What explains the change", title_justify="left")
    table.add_column("cause")
    table.add_column("probability", justify="right")
    table.add_column("χ² left", justify="right")
    table.add_column("it would be")
    for cause in one.causes:
        mark = cause.text if cause.possible else f"[dim]{cause.text}[/]"
        table.add_row(cause.name, f"{cause.probability:.2f}", f"{cause.chi2:.1f}", mark)
    return table


def _if_bearing(one: PreloadEstimate) -> str:
    """What the second interval allows, in words."""
    return f"if the bearing may be ± {100 * float(one.made.settings['bearing_change']):g} % off"


def _list(found: Sequence[PreloadEstimate]) -> None:
    out = console()
    relative = any(one.baseline is not None for one in found)
    table = Table(title=count(len(found), "run"), title_justify="left")
    headings = ["measured at", "preload, N", "P/P₀" if relative else "P/P of the model", "95 %"]
    if relative:
        headings.append(_if_bearing(found[0]))
    for heading in headings:
        table.add_column(heading, justify="right")
    table.add_column("verdict")
    for one in found:
        ratio = one.relative_to_baseline if relative else one.relative_to_model
        row = [escape(_when(one)), _short(one.preload_N), _short(ratio), _ends(ratio)]
        if relative:
            row.append(_ends(one.relative_if_bearing_changed))
        table.add_row(*row, f"[{VERDICT_STYLE[one.verdict]}]{one.verdict}[/]")
    out.print(table)
    said: dict[str, list[str]] = {}
    for one in found:
        for text in (*one.reasons, *one.notes):
            said.setdefault(text, []).append(_when(one))
    for text, when in said.items():
        of = when[0] if len(when) == 1 else "all runs" if len(when) == len(found) else count(len(when), "run")
        out.print(f"  • {of}: {text}", markup=False)


def _when(one: PreloadEstimate) -> str:
    return one.measured_at or one.run[:12]


def _short(quantity: Quantity | None) -> str:
    if quantity is None:
        return "–"
    return str(Quantity(quantity.value, quantity.standard_uncertainty))


def _ends(quantity: Quantity | None) -> str:
    return "–" if quantity is None else "{:.3f} to {:.3f}".format(*quantity.interval)
