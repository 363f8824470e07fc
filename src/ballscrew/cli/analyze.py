"""``ballscrew analyze``, ``amend`` and ``quality``."""

from __future__ import annotations

import math
import sys
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.markup import escape
from rich.table import Table

from ballscrew.axis.sheet_file import read_axis
from ballscrew.base.errors import InputError
from ballscrew.base.files import check_folder, write_text
from ballscrew.base.jsonfile import SCHEMA, write_json
from ballscrew.base.quantity import Quantity
from ballscrew.base.result import check_export
from ballscrew.base.words import plural
from ballscrew.cli.explain import explain_cell, parse_cell
from ballscrew.cli.output import (
    VERDICT_STYLE,
    check_outputs,
    console,
    print_json,
    progress_bar,
    report_quality,
    right_aligned,
    styled_verdict,
)
from ballscrew.fcft.plan import read_plan
from ballscrew.modal.amend import amend
from ballscrew.modal.analyze import AnalysisOptions, examine, quality
from ballscrew.modal.cell import CellResult
from ballscrew.modal.job import Job
from ballscrew.modal.joint.settings import RESPONSES
from ballscrew.modal.paper.settings import PaperSettings
from ballscrew.modal.run import Run
from ballscrew.recording.rotation import TableRotation
from ballscrew.report.canvas import check_target, save_figure
from ballscrew.report.explain_words import frame_words

_TITLE = "Axial natural frequency, undamped, rotor free"


@dataclass(frozen=True, slots=True)
class Output:
    """Form of the output, and files to write.

    Parameters
    ----------
    explain : str or None
        Cell to explain, such as ``"45mm:PD"``.
    as_json : bool
        Whether to print JSON.
    plot, spectra : Path or None
        Files for the picture and for the spectra.
    verbose : bool
        Whether to print masses and every cell.
    table : Path or None
        File for the table of the cells.
    """

    explain: str | None
    as_json: bool
    plot: Path | None
    spectra: Path | None
    verbose: bool = False
    table: Path | None = None

    def check(self, job: Job) -> None:
        """Refuse a file that cannot be written or is an input, before any work is done."""
        if self.plot is not None:
            check_target(self.plot)
        if self.spectra is not None:
            check_folder(self.spectra)
        if self.table is not None:
            check_export(self.table)
        check_outputs((self.plot, self.spectra, self.table), job.inputs_read)


def parse_options(
    method: str, response: str, band: tuple[float, float] | None, estimator: str, average: str
) -> AnalysisOptions:
    """Options of the analysis from those of the command line."""
    if response not in RESPONSES:
        raise InputError(f"the response is {response!r}; it must be one of {', '.join(RESPONSES)}.")
    settings: dict[str, Any] = {"band": band, "estimator": estimator, "average": average}
    return AnalysisOptions(method, response, PaperSettings(**settings))


def analyze_command(job: Job, options: AnalysisOptions, output: Output) -> int:
    """Analyse a run, print and plot it or one of its cells, and return the exit status."""
    cell = None if output.explain is None else parse_cell(output.explain)
    output.check(job)
    with progress_bar("reading") as progress:
        analysis = examine(job, options, compared=cell is not None, progress=progress)
    run = analysis.run
    if output.spectra is not None:
        _write_spectra(run, output.spectra)
    if output.table is not None:
        run.export(output.table)
    if cell is not None:
        explain_cell(analysis, cell, as_json=output.as_json, plot=output.plot)
        return report_quality(run.quality)
    if output.plot is not None:
        from ballscrew.report.run_figure import draw_run

        save_figure(draw_run(run), output.plot)
    if output.as_json:
        print_json(run.to_json())
    else:
        print_run(run, verbose=output.verbose)
    return report_quality(run.quality)


def quality_command(
    files: Sequence[Path],
    *,
    channels: Path | None,
    axis: Path | None,
    plan: Path | None,
    mass: str | None,
    as_json: bool,
) -> int:
    """Check a measurement, print the verdict, and return the exit status."""
    with progress_bar("reading") as progress:
        verdict = quality(files, channels=channels, axis=axis, plan=plan, mass=mass, progress=progress)
    if as_json:
        print_json({"schema": SCHEMA, "quality": verdict.to_json(), "files": [file.name for file in files]})
    else:
        out = console()
        out.print(f"[bold {VERDICT_STYLE[verdict.verdict]}]{verdict.verdict}[/]")
        for sentence in (*verdict.reasons, *verdict.notes):
            out.print(f"  • {sentence}", markup=False)
    return report_quality(verdict)


def amend_command(
    path: Path,
    *,
    measured_at: str | None,
    mass: str | None,
    axis: Path | None,
    plan: Path | None,
    out: Path | None,
    as_json: bool,
) -> int:
    """Amend a run, write it, and return the exit status."""
    target = path if out is None else out
    check_folder(target)
    check_outputs((target,), (axis, plan))
    run = amend(
        Run.read(path),
        measured_at=measured_at,
        mass=mass,
        axis=None if axis is None else read_axis(axis),
        plan=None if plan is None else read_plan(plan),
    )
    write_text(target, write_json(run.to_json()) + "\n")
    if as_json:
        print_json(run.to_json())
        return report_quality(run.quality)
    screen = console()
    screen.print(f"{target}: run {run.id[:12]}, measurement {run.quality.verdict}", markup=False)
    for reason in run.quality.reasons:
        screen.print(f"  • {reason}", markup=False)
    return report_quality(run.quality)


def _write_spectra(run: Run, path: Path) -> None:
    if run.frequency_response is None:
        sys.stderr.write(f"ballscrew: {path}: was not written, since no cell has spectra.\n")
        return
    from ballscrew.base.native import write_table

    write_table(run.frequency_response, path)


def _hint(run: Run) -> str:
    """How to ask why the first refused cell is refused."""
    cell = min(run.cells, key=lambda cell: cell.verdict != "refused")
    name = f"{round(1e3 * cell.position_m, 1) + 0.0:g}mm:{cell.condition}"
    if max(other.motion for other in run.cells):
        name += f":{cell.motion}"
    return f"Why it is refused, and what would help: --explain {name}"


def print_run(run: Run, *, verbose: bool) -> None:
    """Print a run: the result in one line, the verdict, and its stops or, if verbose, all details."""
    screen = console()
    screen.print(_answer(run))
    style = VERDICT_STYLE[run.quality.verdict]
    screen.print(f"Measurement: [bold {style}]{run.quality.verdict}[/]; {escape(_conditions(run))}")
    for sentence in (*run.quality.reasons, *run.quality.notes):
        screen.print(f"  • {sentence}", markup=False)
    if verbose:
        _print_details(run)
    elif run.cells:
        screen.print(_stop_table(run))
    numbers = Counter(cell.verdict for cell in run.cells)
    parts = [
        f"{numbers[verdict]} {verdict}" for verdict in ("good", "suspect", "refused") if numbers[verdict]
    ]
    screen.print(f"{plural(len(run.cells), 'cell')}: {', '.join(parts) or 'none found'}.")
    _print_reasons(run)
    if not verbose:
        screen.print("Masses, friction and every cell: --verbose", markup=False)
        if numbers["refused"]:
            screen.print(_hint(run), markup=False)


def _answer(run: Run) -> str:
    """The result in one line, as markup."""
    axis = escape(run.axis or "axis without a data sheet")
    cells = [cell for cell in run.cells if cell.frequency_Hz is not None]
    if not cells:
        return f"[bold]{axis}: no natural frequency[/]"
    stops = _stops(cells)
    frequencies = [stop.frequency for stop in stops]
    text = f"{min(frequencies):.1f}"
    if len(stops) > 1:
        text += f" to {max(frequencies):.1f}"
    return f"[bold]{axis}: axial natural frequency {text} Hz[/] at {plural(len(stops), 'stop')}"


def _conditions(run: Run) -> str:
    """Load, temperature and number of files of a run."""
    parts = ["load not given" if run.mass_kg is None else f"load {run.mass_kg:g} kg"]
    if run.temperature_C is not None:
        parts.append(f"{run.temperature_C:.1f} °C")
        if run.temperature is not None:
            parts[-1] += f" ± {run.temperature.range_K / math.sqrt(12):.1f} K"
    return ", ".join([*parts, plural(len(run.files), "file")])


def _print_details(run: Run) -> None:
    """Input, masses, friction, other modes, and every cell."""
    screen = console()
    screen.print(f"Run {run.id[:12]}", markup=False)
    if run.drive_input is not None and run.drive_input.commutation is not None:
        sources, angle = ", ".join(run.drive_input.channels), run.drive_input.commutation
        screen.print(f"Driven by {sources}, pole pairs by the {angle}", markup=False)
    _print_rigid_body(run)
    if run.frame_mode is not None:
        screen.print(frame_words(run.frame_mode), markup=False)
    for rotation in run.table_rotation:
        if rotation.ratio_at_mode is not None or rotation.frequency_Hz is not None:
            screen.print(_rotation_words(rotation), markup=False)
    screen.print(_cell_table(run))


@dataclass(frozen=True, slots=True)
class _Stop:
    """Cells of one stop, m and Hz: means of those with the best verdict, NaN where there is no number."""

    position: float
    verdict: str
    frequency: float
    uncertainty: float
    rotor_held: float


def _stops(cells: Sequence[CellResult]) -> list[_Stop]:
    """Stops of a run; the errors of a stop's cells are largely the same, so that a mean has theirs."""
    stops = []
    for position in sorted({cell.position_m for cell in cells}):
        here = [cell for cell in cells if cell.position_m == position]
        numbers = Counter(cell.verdict for cell in here)
        best = min(numbers, key=list(VERDICT_STYLE).index)
        usable = [cell for cell in here if cell.verdict == best]
        names = ("frequency_Hz", "standard_uncertainty_Hz", "rotor_held_frequency_Hz")
        means = [_mean(getattr(cell, name) for cell in usable) for name in names]
        verdict = best
        if len(numbers) > 1:
            verdict = ", ".join(f"{numbers[name]} {name}" for name in VERDICT_STYLE if numbers[name])
        stops.append(_Stop(position, verdict, *means))
    return stops


def _mean(values: Iterable[float | None]) -> float:
    """Mean of the values that there are; NaN without any."""
    found = [value for value in values if value is not None]
    return sum(found) / len(found) if found else math.nan


def _stop_table(run: Run) -> Table:
    stops = _stops(run.cells)
    headings = ["position\nmm", "frequency\nHz", "standard unc.\nHz"]
    with_rotor_held = not all(math.isnan(stop.rotor_held) for stop in stops)
    if with_rotor_held:
        headings.append("rotor held\nHz")
    table = right_aligned(headings, "verdict", title=_TITLE)
    for stop in stops:
        row = [_position(stop.position), _number(stop.frequency), _number(stop.uncertainty, "± ")]
        if with_rotor_held:
            row.append(_number(stop.rotor_held))
        table.add_row(*row, styled_verdict(stop.verdict))
    return table


def _position(metres: float) -> str:
    return f"{round(metres * 1e3, 1) + 0.0:.1f}"


def _rotation_words(rotation: TableRotation) -> str:
    words = f"Table: {rotation.direction}"
    if rotation.ratio_at_mode is not None:
        words += f" {rotation.ratio_at_mode:.2g} of the motion along the screw at the mode"
    if rotation.frequency_Hz is not None:
        words += f", most at {rotation.frequency_Hz:.0f} Hz"
    return words


def _print_rigid_body(run: Run) -> None:
    body, screen = run.rigid_body, console()
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
        if value is None:
            continue
        text = f"{words:<24} {Quantity(value, body.standard_uncertainty.get(name, 0.0), unit)}"
        if body.repeatability.get(name) is not None:
            text += f" (repeatability {body.repeatability[name]:.2g} {unit})"
        screen.print(text)
    for reason in body.reasons:
        screen.print(f"  • {reason}", markup=False)


def _cell_table(run: Run) -> Table:
    with_rotor_held = any(cell.rotor_held_frequency_Hz is not None for cell in run.cells)
    headings = ["position\nmm", "cond.", "motion", "repeti-\ntions", "frequency\nHz", "standard unc.\nHz"]
    if with_rotor_held:
        headings.append("rotor held\nHz")
    headings.append("coher-\nence")
    table = right_aligned(headings, "verdict", title=_TITLE)
    for cell in run.cells:
        row = [
            _position(cell.position_m),
            cell.condition,
            str(cell.motion),
            str(cell.repetitions),
            _number(cell.frequency_Hz),
            _number(cell.standard_uncertainty_Hz, "± "),
        ]
        if with_rotor_held:
            row.append(_rotor_held(cell))
        row.append(_number(cell.coherence))
        table.add_row(*row, styled_verdict(cell.verdict))
    return table


def _number(value: float | None, before: str = "") -> str:
    return "–" if value is None or math.isnan(value) else f"{before}{value:.2f}"


def _rotor_held(cell: CellResult) -> str:
    """Frequency with the rotor held and its standard uncertainty, in one column."""
    text = _number(cell.rotor_held_frequency_Hz)
    if cell.rotor_held_standard_uncertainty_Hz is not None:
        text += f" ± {cell.rotor_held_standard_uncertainty_Hz:.2f}"
    return text


def _print_reasons(run: Run) -> None:
    """First reason of each cell, once, with its cells; the JSON has all reasons."""
    cells: dict[str, list[CellResult]] = {}
    for cell in run.cells:
        for reason in cell.reasons[:1]:
            cells.setdefault(reason, []).append(cell)
    for reason, affected in cells.items():
        which = f"{len(affected)} cells"
        if len(affected) < 5:
            which = ", ".join(f"{round(c.position_m * 1e3) + 0.0:.0f} mm {c.condition}" for c in affected)
        console().print(f"  • {which}: {reason}", markup=False)
