"""``ballscrew analyze``."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

from rich.markup import escape
from rich.table import Table

from ballscrew.base.errors import InputError
from ballscrew.base.quantity import Quantity
from ballscrew.cli.explain import explain_cell, wanted
from ballscrew.cli.output import (
    VERDICT_STYLE,
    check_folder,
    console,
    count,
    print_json,
    progress_bar,
    report_quality,
)
from ballscrew.modal.analyze import AnalysisOptions, examine
from ballscrew.modal.job import Job
from ballscrew.modal.joint.settings import RESPONSES
from ballscrew.modal.paper.settings import AVERAGES, ESTIMATORS, PaperSettings
from ballscrew.modal.run import CellResult, Run

__all__ = ["analyze_command"]


def analyze_command(
    files: Sequence[Path],
    *,
    channels: Path | None,
    axis: Path | None,
    plan: Path | None,
    mass: str | None,
    measured_at: str | None,
    temperature: str | None,
    method: str,
    response: str,
    band: tuple[float, float] | None,
    estimator: str,
    average: str,
    explain: str | None,
    as_json: bool,
    plot: Path | None,
    spectra: Path | None,
) -> int:
    """Analyse a run, print and draw it or one of its cells, and return the exit status."""
    if response not in RESPONSES:
        raise InputError(f"the response is {response!r}; it must be one of {', '.join(RESPONSES)}.")
    cell = None if explain is None else wanted(explain)
    options = AnalysisOptions(
        method=method,
        response=next(each for each in RESPONSES if each == response),
        paper=PaperSettings(
            band=band,
            estimator=next((e for e in ESTIMATORS if e == estimator), estimator),  # type: ignore[arg-type]  # it checks
            average=next((a for a in AVERAGES if a == average), average),  # type: ignore[arg-type]
        ),
    )
    draw = _drawer(plot)
    if spectra is not None:
        check_folder(spectra)
    job = Job.of(files, channels, axis, plan, mass, measured_at, temperature)
    with progress_bar("reading") as report:
        analysis = examine(job, options, compared=cell is not None, progress=report)
    run = analysis.run
    if plot is not None and draw is not None and cell is None:
        draw(run)
    if spectra is not None:
        _write_spectra(run, spectra)
    if cell is not None:
        explain_cell(analysis, cell, as_json=as_json, plot=plot)
    elif as_json:
        print_json(run.to_json())
    else:
        _print(run)
    return report_quality(run.quality)


def _drawer(plot: Path | None):  # type: ignore[no-untyped-def]  # the report room is loaded only where it is wanted
    """Find out before the work whether the picture can be drawn after it."""
    if plot is None:
        return None
    from ballscrew.report.canvas import check_target, save_figure
    from ballscrew.report.run_figure import draw_run

    check_target(plot)
    return lambda run: save_figure(draw_run(run), plot)


def _write_spectra(run: Run, path: Path) -> None:
    if run.frequency_response is None:
        sys.stderr.write(f"ballscrew: {path}: was not written, since no cell has spectra.\n")
        return
    from ballscrew.base.native import write_table

    write_table(run.frequency_response, path)


def _print(run: Run) -> None:
    out = console()
    style = VERDICT_STYLE[run.quality.verdict]
    load = "load not said" if run.mass_kg is None else f"load {run.mass_kg:g} kg"
    axis = escape(run.axis or "axis without a data sheet")
    out.print(f"[bold]{axis}[/], {load}, {count(len(run.files), 'file')}, run {run.id[:12]}")
    out.print(f"Measurement: [bold {style}]{run.quality.verdict}[/]")
    for reason in run.quality.reasons:
        out.print(f"  • {reason}", markup=False)
    _print_rigid_body(run)
    out.print(_cells(run))
    judged = [cell.verdict for cell in run.cells]
    counts = ", ".join(f"{judged.count(v)} {v}" for v in ("good", "suspect", "refused") if v in judged)
    out.print(f"{count(len(judged), 'cell')}: {counts or 'none found'}.")
    _print_reasons(run)


def _print_rigid_body(run: Run) -> None:
    body, out = run.rigid_body, console()
    rows = (
        ("Equivalent mass", "equivalent_mass_kg", "kg"),
        ("  the same from the FRF", "frf_equivalent_mass_kg", "kg"),
        ("Moving mass", "moving_mass_kg", "kg"),
        ("Viscous friction", "viscous_N_s_per_m", "N s/m"),
        ("Coulomb friction", "coulomb_N", "N"),
        ("Offset", "offset_N", "N"),
    )
    for words, name, unit in rows:
        value = getattr(body, name)
        if value is not None:
            out.print(f"{words:<24} {Quantity(value, body.standard_uncertainty.get(name, 0.0), unit)}")
    for reason in body.reasons:
        out.print(f"  • {reason}", markup=False)


def _cells(run: Run) -> Table:
    table = Table(title="Axial natural frequency, undamped, rotor free", title_justify="left")
    held = any(cell.method == "joint" for cell in run.cells)
    for heading in (
        "position\nmm",
        "cond.",
        "motion",
        "repeti-\ntions",
        "frequency\nHz",
        "standard unc.\nHz",
        *(("rotor held\nHz",) if held else ()),
        "coher-\nence",
    ):
        table.add_column(heading, justify="right")
    table.add_column("verdict")
    for cell in run.cells:
        table.add_row(
            f"{round(cell.position_m * 1e3, 1) + 0.0:.1f}",
            cell.condition,
            str(cell.motion),
            str(cell.repetitions),
            _number(cell.frequency_Hz),
            _number(cell.standard_uncertainty_Hz, "± "),
            *((_held(cell),) if held else ()),
            _number(cell.coherence),
            f"[{VERDICT_STYLE[cell.verdict]}]{cell.verdict}[/]",
        )
    return table


def _number(value: float | None, before: str = "") -> str:
    return "–" if value is None else f"{before}{value:.2f}"


def _held(cell: CellResult) -> str:
    """Frequency with the rotor held and its standard uncertainty, both in one column."""
    frequency, deviation = cell.rotor_held_frequency_Hz, cell.rotor_held_standard_uncertainty_Hz
    return _number(frequency) if deviation is None else f"{_number(frequency)} ± {deviation:.2f}"


def _print_reasons(run: Run) -> None:
    """The first reason of each cell, once, with the cells that it speaks of; the JSON has all."""
    out = console()
    cells: dict[str, list[CellResult]] = {}
    for cell in run.cells:
        for reason in cell.reasons[:1]:
            cells.setdefault(reason, []).append(cell)
    for reason, which in cells.items():
        names = ", ".join(f"{round(c.position_m * 1e3) + 0.0:.0f} mm {c.condition}" for c in which)
        out.print(f"  • {names if len(which) < 5 else f'{len(which)} cells'}: {reason}", markup=False)
