"""``ballscrew frf``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rich.markup import escape

from ballscrew.base.result import check_export
from ballscrew.base.words import plural
from ballscrew.cli.output import (
    check_outputs,
    console,
    print_json,
    report_quality,
    right_aligned,
    styled_verdict,
)
from ballscrew.modal.analyze_frf import examine_frf, listed_places
from ballscrew.modal.excited_record import Signals
from ballscrew.modal.job import Job
from ballscrew.modal.resonance_verdicts import EstimatedMode
from ballscrew.modal.resonances import Resonances
from ballscrew.modal.run import Run
from ballscrew.report.canvas import check_target, save_figure


def frf_command(
    job: Job,
    signals: Signals,
    positions: Sequence[str],
    band: tuple[float, float] | None,
    *,
    as_json: bool,
    plot: Path | None,
    table: Path | None = None,
) -> int:
    """Estimate resonances, print and plot them, and return the exit status."""
    if plot is not None:
        check_target(plot)
    if table is not None:
        check_export(table)
    check_outputs((plot, table), job.inputs_read)
    run, cells = examine_frf(job, signals, listed_places(positions), band)
    if plot is not None:
        from ballscrew.report.resonance_figure import draw_responses

        save_figure(draw_responses(cells), plot)
    if table is not None:
        run.export(table)
    if as_json:
        print_json(run.to_json())
    else:
        _print(run, signals, cells)
    return report_quality(run.quality)


def _print(run: Run, signals: Signals, cells: Sequence[tuple[float, Resonances]]) -> None:
    screen = console()
    load = "load not given" if run.mass_kg is None else f"load {run.mass_kg:g} kg"
    title = f"{run.axis or 'axis without a data sheet'}, {load}, {plural(len(run.files), 'file')}"
    screen.print(f"[bold]{escape(title)}[/], run {run.id[:12]}")
    reference = "no reference" if signals.reference is None else f"reference {signals.reference}"
    screen.print(f"{signals.input} → {signals.output}, {reference}", markup=False)
    headings = ["position\nmm", "mode", "frequency\nHz", "standard unc.\nHz", "95 %\nHz", "damping"]
    table = right_aligned(headings, "verdict")
    for position, found in cells:
        rows = (("resonance", found.resonance), ("antiresonance", found.antiresonance))
        for name, mode in rows:
            table.add_row(f"{1e3 * position:.1f}", name, *_numbers(mode), styled_verdict(mode.verdict))
    screen.print(table)
    for position, found in cells:
        for line in _remarks(found):
            screen.print(f"  • {1e3 * position:.0f} mm: {line}", markup=False)


def _numbers(mode: EstimatedMode) -> tuple[str, str, str, str]:
    if mode.frequency is None or mode.damping is None:
        return "–", "–", "–", "–"
    low, high = mode.frequency.interval
    value, spread = mode.frequency.value, mode.frequency.standard_uncertainty
    return f"{value:.2f}", f"± {spread:.2f}", f"{low:.2f} to {high:.2f}", f"{mode.damping:.3f}"


def _remarks(found: Resonances) -> list[str]:
    """Reasons of both frequencies, each once, then coherence and halves."""
    reasons = [reason.text for reason in (*found.resonance.reasons, *found.antiresonance.reasons)]
    lines = [*dict.fromkeys(reasons)]
    if found.coherence is not None:
        lines.append(f"coherence at the mode {found.coherence:.2f}")
    if found.halves:
        lines.append("halves of the record: " + ", ".join(map(str, found.halves)))
    return lines
