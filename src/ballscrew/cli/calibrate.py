"""``ballscrew calibrate``."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from ballscrew.axis.axial import PARAMETERS
from ballscrew.axis.axial_theta import to_theta
from ballscrew.axis.sheet_file import read_axis
from ballscrew.base.errors import DONE, BallscrewError, InputError
from ballscrew.base.files import check_folder
from ballscrew.base.quantity import Quantity
from ballscrew.base.words import percent, plural, without_repeats
from ballscrew.calibration.anchors import known_preload
from ballscrew.calibration.assumptions import Assumptions
from ballscrew.calibration.calibrated_axis import UNITS, CalibratedAxis
from ballscrew.calibration.calibration import solve_calibration
from ballscrew.calibration.modelfile import model_json, write_model
from ballscrew.calibration.sampler import SamplerCheck, sample_posterior
from ballscrew.cli.output import (
    TIME_WIDTH,
    VERDICT_STYLE,
    check_outputs,
    console,
    name_runs,
    print_json,
)
from ballscrew.modal.run import Run
from ballscrew.report.canvas import check_target, save_figure

_PRELOAD = PARAMETERS.index("preload")


def calibrate_command(
    paths: Sequence[Path],
    *,
    axis: Path,
    out: Path,
    known_preloads: Sequence[str],
    assumptions: Assumptions,
    with_sampler: bool,
    verbose: bool,
    as_json: bool,
    plot: Path | None,
) -> int:
    """Calibrate, write the model, print the result, and return the exit status."""
    check_folder(out)
    check_outputs((out, plot), (axis, *paths))
    if plot is not None:
        check_target(plot)
    sheet = read_axis(axis)
    runs = [Run.read(path) for path in paths]
    known = _parse_known_preloads(known_preloads, paths, runs)
    names = {run.id: run.name for run in runs}
    try:
        calibrated, fit = solve_calibration(runs, sheet, known, assumptions)
    except BallscrewError as error:
        raise type(error)(name_runs(str(error), names)) from None
    sampled = sample_posterior(fit) if with_sampler else None
    write_model(calibrated, out)
    if plot is not None:
        from ballscrew.report.calibration_figure import draw_calibration

        save_figure(draw_calibration(calibrated, runs), plot)
    if as_json:
        document = model_json(calibrated)
        if sampled is not None:
            document["sample"] = _sample_json(sampled)
        print_json(document)
        return DONE
    screen = console()
    _print_model(screen, calibrated, names, verbose=verbose)
    if sampled is not None:
        _print_sample(screen, sampled)
    screen.print(f"wrote {out}", markup=False)
    return DONE


def _parse_known_preloads(
    texts: Sequence[str], paths: Sequence[Path], runs: Sequence[Run]
) -> dict[str, Quantity]:
    """Known preloads by run id; the file must be one of the runs of the calibration."""
    known: dict[str, Quantity] = {}
    for text in texts:
        name, sign, value = text.rpartition("=")
        if not sign:
            raise InputError(f"--known-preload {text!r}: must be RUN.json=600N or RUN.json=600N±10N.")
        run = _find_run(name, paths, runs)
        if run is None:
            raise InputError(
                f"--known-preload {text!r}: {name!r} must be one of the runs of the calibration."
            )
        if run.id in known:
            raise InputError(f"--known-preload {text!r}: the preload of this run is given twice.")
        try:
            known[run.id] = known_preload(value)
        except InputError as error:
            raise InputError(f"--known-preload: {error}") from None
    return known


def _find_run(name: str, paths: Sequence[Path], runs: Sequence[Run]) -> Run | None:
    """The run of a file, by its path or else its name; None unless exactly one matches."""
    for matches in ([path == Path(name) for path in paths], [path.name == name for path in paths]):
        if any(matches):
            return runs[matches.index(True)] if sum(matches) == 1 else None
    return None


def _sample_json(sampled: SamplerCheck) -> dict[str, Any]:
    return {
        "agrees": sampled.agrees,
        "samples": sampled.samples,
        "acceptance": sampled.acceptance,
        "shift": dict(zip(sampled.names, sampled.shift, strict=True)),
        "ratio": dict(zip(sampled.names, sampled.ratio, strict=True)),
    }


def _print_model(screen: Console, axis: CalibratedAxis, names: Mapping[str, str], *, verbose: bool) -> None:
    """Print a model: the preload in one line, doubts, runs and what would improve it, or all details."""
    preload = axis.model.preload
    spread = axis.covariance[_PRELOAD, _PRELOAD] ** 0.5 * axis.working_scale("preload")
    screen.print(
        f"[bold]{escape(axis.axis)}[/]: preload {preload:.0f} ± {2 * spread:.0f} N (95 %) by "
        f"{plural(len(axis.runs), 'run')}, [bold {VERDICT_STYLE[axis.verdict]}]{axis.verdict}[/]"
    )
    for line in without_repeats(f"{doubt.name}: {doubt.text}" for doubt in axis.reasons):
        screen.print(f"  • {name_runs(line, names)}", markup=False)
    for note in axis.notes:
        screen.print(f"  • assumed: {name_runs(note, names)}", markup=False)
    _print_runs(screen, axis, names)
    _print_conventions(screen, axis)
    if verbose:
        _print_fit(screen, axis)
        _print_anchors(screen, axis, names)
        _print_knowledge(screen, axis)
    screen.print(_offer_table(axis))
    if not verbose:
        screen.print("Parameters, goodness of fit and what determines them: --verbose", markup=False)


def _print_fit(screen: Console, axis: CalibratedAxis) -> None:
    cells = sum(run.cells for run in axis.runs)
    preloads = plural(len(axis.log_ratios), "preload")
    screen.print(
        f"{plural(cells, 'cell')} at {preloads}: χ² {axis.chi2:.0f} for {axis.degrees:.0f} degrees of freedom"
    )
    screen.print(_parameter_table(axis))
    if axis.model.curve == 0:
        theta = to_theta(axis.model, min(axis.nut_mass, axis.model.mass))
        screen.print(
            f"θ of Eqs. (2) and (3), as accurate as the preload in newtons: a {theta.a:.4g}, "
            f"b {theta.b:.4g}, c {theta.c:.4g}, d {theta.d:.3g} kg\n"
        )
    screen.print(_candidate_table(axis))


def _print_sample(screen: Console, sampled: SamplerCheck) -> None:
    shifts = dict(zip(sampled.names, sampled.shift, strict=True))
    worst = max(shifts, key=lambda name: abs(shifts[name]))
    agreement = "agree" if sampled.agrees else "do not agree"
    screen.print(
        f"sampler: {sampled.samples} samples {agreement} with the model; the largest shift, of {worst}, is "
        f"{shifts[worst]:+.2f} standard uncertainties; widths are {min(sampled.ratio):.2f} to "
        f"{max(sampled.ratio):.2f} of the model's"
    )


def _parameter_table(axis: CalibratedAxis) -> Table:
    table = Table("", "value", "±", "± by the data sheet alone", title="model", title_justify="left")
    after = axis.covariance.diagonal() ** 0.5
    before = axis.prior_covariance.diagonal() ** 0.5
    for index, name in enumerate(PARAMETERS):
        value = getattr(axis.model, name)
        if before[index] > 0:
            scale = axis.working_scale(name)
            row = (f"{name} {UNITS[name]}".strip(), f"{value:.4g}")
            table.add_row(*row, _spread(after[index] * scale), _spread(before[index] * scale))
        elif name == "rotor":
            table.add_row("rotor", "∞", "", "")
    return table


def _spread(value: float) -> str:
    """Two significant digits; from 100 on, all digits before the point."""
    return f"{value:.2g}" if value < 100 else f"{value:.0f}"


def _print_runs(screen: Console, axis: CalibratedAxis, names: Mapping[str, str]) -> None:
    table = Table(
        "run", "load", "measured", "P/P_ref", "cells", "level", "weight", title="runs", title_justify="left"
    )
    for run in axis.runs:
        ratio = "1"
        if run.group > 0:
            value = math.exp(run.log_ratio)
            ratio = f"{value:.3f} ± {value * run.log_ratio_uncertainty:.3f}"
        time = escape((run.measured_at or "")[:TIME_WIDTH])
        table.add_row(
            escape(names[run.id]), f"{run.load:g} kg", time, ratio, str(run.cells),
            f"{100 * run.level:+.2f} %", f"{100 * run.weight:.0f} %",
        )  # fmt: skip
    screen.print(table)
    for run in axis.runs:
        for cell in run.outliers:
            screen.print(f"  • {names[run.id]}: cell {cell} does not fit and is downweighted", markup=False)


def _candidate_table(axis: CalibratedAxis) -> Table:
    table = Table("form", "ln evidence", "χ²", "", title="forms of the model", title_justify="left")
    for form in axis.candidates:
        chosen = "chosen" if form.chosen else ""
        table.add_row(form.name, f"{form.log_evidence:.1f}", f"{form.chi2:.0f}", chosen)
    return table


def _print_conventions(screen: Console, axis: CalibratedAxis) -> None:
    if not axis.conventions:
        return
    table = Table(
        "convention", "probability", "K by the data", title_justify="left",
        title="K of the data sheet may be stated in another convention",
    )  # fmt: skip
    for reading in axis.conventions:
        table.add_row(
            reading.convention, f"{reading.probability:.2f}", f"{percent(reading.ratio)} of the sheet's"
        )
    screen.print(table)


def _print_anchors(screen: Console, axis: CalibratedAxis, names: Mapping[str, str]) -> None:
    if not axis.anchors:
        screen.print("No anchor: the preload in newtons rests on the data sheet.\n")
        return
    table = Table(
        "anchor", "run", "preload", "± of ln preload without it", "with it", "± of share without it",
        "with it", title="anchors", title_justify="left",
    )  # fmt: skip
    for anchor in axis.anchors:
        table.add_row(
            anchor.kind,
            escape(names[anchor.run]),
            f"{anchor.preload:.0f} ± {anchor.standard_uncertainty:.0f} N",
            f"{anchor.log_preload_without:.3f}",
            f"{anchor.log_preload_with:.3f}",
            f"{anchor.share_without:.3f}",
            f"{anchor.share_with:.3f}",
        )
    screen.print(table)


def _print_knowledge(screen: Console, axis: CalibratedAxis) -> None:
    screen.print("[bold]What the data and the data sheet determine[/]")
    for kind in ("quantity", "direction"):
        for item in axis.knowledge:
            if item.get("kind") == kind:
                screen.print(f"  {item.get('sentence')}", markup=False)
        screen.print("")


def _offer_table(axis: CalibratedAxis) -> Table:
    table = Table(
        "one more measurement", "± of share", "± of preload", "± of mass", title="expected uncertainty",
        title_justify="left",
    )  # fmt: skip
    for item in axis.knowledge:
        if item.get("kind") == "offer":
            numbers: dict[str, Any] = dict(item)
            share, preload = percent(numbers["share"]), percent(numbers["log_preload"])
            table.add_row(str(numbers["what"]), share, preload, percent(numbers["mass"]))
    return table
