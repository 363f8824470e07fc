"""``ballscrew calibrate``."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from ballscrew.axis.axial import PARAMETERS
from ballscrew.axis.axial_theta import to_theta
from ballscrew.axis.sheet import read_axis
from ballscrew.base.errors import DONE, InputError
from ballscrew.base.percent import percent
from ballscrew.base.quantity import Quantity
from ballscrew.calibration.anchors import known_preload
from ballscrew.calibration.assumptions import Assumptions
from ballscrew.calibration.calibrated_axis import CalibratedAxis
from ballscrew.calibration.calibration import solve_calibration
from ballscrew.calibration.modelfile import UNITS, model_json, write_model
from ballscrew.calibration.sampler import SamplerCheck, sample_posterior
from ballscrew.cli.output import check_folder, console, count, print_json
from ballscrew.modal.run import Run

__all__ = ["calibrate_command"]


def calibrate_command(
    paths: Sequence[Path],
    *,
    axis: Path,
    out: Path,
    known: Sequence[str],
    assumptions: Assumptions,
    sampled: bool,
    as_json: bool,
    plot: Path | None,
) -> int:
    """Calibrate, write the model, print what was learned, and return the exit status."""
    check_folder(out)
    if plot is not None:
        from ballscrew.report.canvas import check_target

        check_target(plot)
    sheet = read_axis(axis)
    runs = [Run.read(path) for path in paths]
    found = solve_calibration(runs, sheet, known=_known(known, paths, runs), assumptions=assumptions)
    drawn = sample_posterior(found.problem, found.fit) if sampled else None
    write_model(found.calibrated, out)
    if plot is not None:
        from ballscrew.report.calibration_figure import draw_calibration
        from ballscrew.report.canvas import save_figure

        save_figure(draw_calibration(found.calibrated, runs), plot)
    if as_json:
        document = model_json(found.calibrated)
        if drawn is not None:
            document["sample"] = _sample_json(drawn)
        print_json(document)
        return DONE
    _say(console(), found.calibrated, drawn, out)
    return DONE


def _known(texts: Sequence[str], paths: Sequence[Path], runs: Sequence[Run]) -> dict[str, Quantity]:
    """Known preloads by run id; the file must be one of those that were given."""
    found: dict[str, Quantity] = {}
    for text in texts:
        name, sign, value = text.rpartition("=")
        if not sign:
            raise InputError(f"--known-preload {text!r}: must be RUN.json=600N or RUN.json=600N±10N.")
        same = [run for path, run in zip(paths, runs, strict=True) if path == Path(name)]
        same = same or [run for path, run in zip(paths, runs, strict=True) if path.name == name]
        if len(same) != 1:
            raise InputError(
                f"--known-preload {text!r}: {name!r} must be one of the runs that are calibrated with."
            )
        if same[0].id in found:
            raise InputError(f"--known-preload {text!r}: the preload of this run was told twice.")
        found[same[0].id] = known_preload(value)
    return found


def _sample_json(drawn: SamplerCheck) -> dict[str, Any]:
    return {
        "agrees": drawn.agrees,
        "samples": drawn.samples,
        "acceptance": drawn.acceptance,
        "shift": dict(zip(drawn.names, drawn.shift, strict=True)),
        "ratio": dict(zip(drawn.names, drawn.ratio, strict=True)),
    }


def _say(out: Console, found: CalibratedAxis, drawn: SamplerCheck | None, path: Path) -> None:
    groups = len(found.log_ratios)
    cells = sum(run.cells for run in found.runs)
    frequencies = count(cells, "frequency").replace("frequencys", "frequencies")
    out.print(
        f"[bold]{escape(found.axis)}[/]: {count(len(found.runs), 'run')}, {frequencies}, "
        f"{count(groups, 'preload')}; χ² {found.chi2:.0f} at {found.degrees:.0f} degrees of freedom"
    )
    for reason in found.reasons:
        out.print(f"  • {reason}", markup=False)
    out.print(_parameters(found))
    if found.model.curve == 0:
        theta = to_theta(found.model, min(found.nut_mass, found.model.mass))
        out.print(
            f"θ of Eqs. (2) and (3), as good as the preload in newtons: a {theta.a:.4g}, b {theta.b:.4g}, "
            f"c {theta.c:.4g}, d {theta.d:.3g} kg\n"
        )
    _say_runs(out, found)
    out.print(_candidates(found))
    _say_anchors(out, found)
    _say_knowledge(out, found)
    if drawn is not None:
        worst = max(zip(drawn.names, drawn.shift, strict=True), key=lambda row: abs(row[1]))
        out.print(
            f"sampler: {drawn.samples} samples {'agree' if drawn.agrees else 'do not agree'} with the model; "
            f"the largest shift, of {worst[0]}, is {worst[1]:+.2f} standard uncertainties, widths are "
            f"{min(drawn.ratio):.2f} to {max(drawn.ratio):.2f} of the model's"
        )
    out.print(f"wrote {path}", markup=False)


def _parameters(found: CalibratedAxis) -> Table:
    table = Table("", "value", "±", "by the sheet alone ±", title="model", title_justify="left")
    model, share = found.model, found.model.share
    for k, name in enumerate(PARAMETERS):
        value = getattr(model, name)
        # Logarithms and the logit of the working vector, back in the parameter's own unit.
        scale = {"slope": 1.0, "curve": 1.0, "share": share * (1 - share)}.get(name, value)
        after, before = found.covariance[k, k] ** 0.5, found.prior_covariance[k, k] ** 0.5
        if not before > 0:
            if name == "rotor":
                table.add_row("rotor", "∞", "", "")
            continue
        unit = UNITS[name]
        table.add_row(f"{name} {unit}".strip(), f"{value:.4g}", _doubt(after * scale), _doubt(before * scale))
    return table


def _doubt(spread: float) -> str:
    """Two digits; of hundreds and more all before the point."""
    return f"{spread:.2g}" if spread < 100 else f"{spread:.0f}"


def _say_runs(out: Console, found: CalibratedAxis) -> None:
    table = Table(
        "run", "load", "measured", "P/P_ref", "cells", "level", "weight", title="runs", title_justify="left"
    )
    for run in found.runs:
        ratio = "1" if run.group == 0 else _ratio(run.log_ratio, run.log_ratio_uncertainty)
        table.add_row(
            escape(run.id[:12]), f"{run.load:g} kg", escape(run.measured_at or ""), ratio, str(run.cells),
            f"{100 * run.level:+.2f} %", f"{100 * run.weight:.0f} %",
        )  # fmt: skip
    out.print(table)
    for run in found.runs:
        for cell in run.cells_out:
            out.print(f"  • run {run.id[:12]}: cell {cell} does not fit and hardly counts", markup=False)


def _ratio(log_ratio: float, spread: float) -> str:
    value = math.exp(log_ratio)
    return f"{value:.3f} ± {value * spread:.3f}"


def _candidates(found: CalibratedAxis) -> Table:
    table = Table("form", "ln evidence", "χ²", "", title="forms of the model", title_justify="left")
    for one in found.candidates:
        table.add_row(one.name, f"{one.log_evidence:.1f}", f"{one.chi2:.0f}", "chosen" if one.chosen else "")
    return table


def _say_anchors(out: Console, found: CalibratedAxis) -> None:
    if not found.anchors:
        out.print("No anchor: the preload in newtons is the data sheet's.\n")
        return
    table = Table(
        "anchor", "run", "preload", "ln preload ± without it", "with", "share ± without it", "with",
        title="anchors", title_justify="left",
    )  # fmt: skip
    for one in found.anchors:
        table.add_row(
            one.kind, escape(one.run[:12]), f"{one.preload:.0f} ± {one.standard_uncertainty:.0f} N",
            f"{one.log_preload_without:.3f}", f"{one.log_preload_with:.3f}",
            f"{one.share_without:.3f}", f"{one.share_with:.3f}",
        )  # fmt: skip
    out.print(table)


def _say_knowledge(out: Console, found: CalibratedAxis) -> None:
    out.print("[bold]What is known, and by whom[/]")
    for kind in ("quantity", "direction"):
        for one in found.knowledge:
            if one.get("kind") == kind:
                out.print(f"  {one.get('sentence')}", markup=False)
        out.print("")
    table = Table(
        "one more measurement", "share ±", "preload ±", "mass ±", title="what it would leave",
        title_justify="left",
    )  # fmt: skip
    for one in found.knowledge:
        if one.get("kind") == "offer":
            numbers: dict[str, Any] = dict(one)
            table.add_row(
                str(numbers["what"]),
                *(percent(numbers[key]) for key in ("share", "log_preload", "mass")),
            )
    out.print(table)
