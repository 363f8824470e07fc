"""Calibrate an axis: runs at several loads and a data sheet become one model with its covariance."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2 as chi2_law

from ballscrew.axis.axial import PARAMETERS, AxialModel, from_sheet, from_vector
from ballscrew.axis.axial_prior import BED, DISCREPANCY
from ballscrew.axis.sheet import DataSheet
from ballscrew.base.errors import InputError, MeasurementError, shown
from ballscrew.base.provenance import Made, digest
from ballscrew.base.quantity import Quantity
from ballscrew.health.anchors import Row, anchor_rows
from ballscrew.health.calibrated import Anchor, Calibrated, Candidate, RunUsed
from ballscrew.health.candidates import ASK, Form, forms
from ballscrew.health.fit import FULL, Fit, Problem, solve
from ballscrew.health.groups import groups
from ballscrew.health.identifiability import knowledge, posterior
from ballscrew.health.observed import REPEATS, Observed, observed
from ballscrew.health.robust import Robust, fit_robustly
from ballscrew.health.rows import FLOOR, FORM, LOAD, WORN, problem, relative_covariance
from ballscrew.modal.run import Run

__all__ = ["Prepared", "Solved", "calibrate", "prepare", "solved"]

Array = NDArray[np.float64]

_NOTHING: Mapping[str, Quantity] = MappingProxyType({})
_SURE = 0.999
_MOST_RUNS = 200


@dataclass(frozen=True, slots=True, eq=False)
class Prepared:
    """A calibration before it is fitted.

    Parameters
    ----------
    runs : tuple of Observed
        Those that have cells.
    groups : tuple of int
        Of each its preload.
    rows : tuple of Row
        Anchors.
    centre : float
        m.
    forms : tuple of Form
        Candidates, the sheet's own first.
    covariance : ndarray
        Of ln f.
    reasons : tuple of str
        What was left out.
    """

    runs: tuple[Observed, ...]
    groups: tuple[int, ...]
    rows: tuple[Row, ...]
    centre: float
    forms: tuple[Form, ...]
    covariance: Array
    reasons: tuple[str, ...]

    def problem(self, form: Form) -> Problem:
        """Rows and prior of one form."""
        return problem(
            self.runs, self.groups, self.rows, (form.mean, form.covariance), self.centre, self.covariance
        )


@dataclass(frozen=True, slots=True, eq=False)
class Solved:
    """A calibration with the problem that it solved.

    Parameters
    ----------
    calibrated : Calibrated
        The model.
    problem, fit
        Rows and prior of the chosen form, and the most probable unknowns.
    """

    calibrated: Calibrated
    problem: Problem
    fit: Fit


def calibrate(
    runs: Sequence[Run],
    sheet: DataSheet,
    *,
    known: Mapping[str, Quantity] = _NOTHING,
    correlation: float = REPEATS,
    centre: float | None = None,
) -> Calibrated:
    """Fit the axis's working vector to the frequencies of several runs.

    The most probable values given frequencies, anchors and data sheet, and their full covariance. Runs of one
    experiment (:func:`~ballscrew.health.groups.groups`) share one preload; the first run's is the reference.
    Cells, then runs that do not fit the rest lose weight and are named. Another form of the model takes the
    place of the sheet's where the evidence is 20 to 1 for it.

    Parameters
    ----------
    runs : sequence of Run
        Of one axis, at several loads on the table where possible.
    sheet : DataSheet
        The axis, with its tolerances.
    known : mapping of str to Quantity
        Known preloads, N, by run id.
    correlation : float
        From run to run, of errors that repeat.
    centre : float, optional
        Where the compliance is stated, m; the middle of the stops otherwise.

    Returns
    -------
    Calibrated
        The model.

    Raises
    ------
    InputError
        If there is no run, one is given twice or belongs to another axis, a known preload belongs to no run,
        or a position does not lie on the screw.
    MeasurementError
        If no run has a frequency, or the fit does not settle.
    """
    return solved(runs, sheet, known=known, correlation=correlation, centre=centre).calibrated


def solved(
    runs: Sequence[Run],
    sheet: DataSheet,
    *,
    known: Mapping[str, Quantity] = _NOTHING,
    correlation: float = REPEATS,
    centre: float | None = None,
) -> Solved:
    """Calibrate, and keep the problem and its solution; parameters and errors as :func:`calibrate`."""
    ready = prepare(runs, sheet, known=known, correlation=correlation, centre=centre)
    robust = fit_robustly(ready.problem(ready.forms[0]))
    cells = len(robust.problem.position)
    ready = replace(ready, covariance=robust.problem.covariance[:cells, :cells])
    fits = [robust.fit, *(solve(ready.problem(form)) for form in ready.forms[1:])]
    evidence = np.array([fit.log_evidence for fit in fits])
    chosen = int(np.argmax(evidence)) if evidence.max() > evidence[0] + ASK else 0
    fit, form, rows = fits[chosen], ready.forms[chosen], ready.problem(ready.forms[chosen])
    held = float(np.trace(np.linalg.solve(fit.information + np.eye(len(fit.information)), fit.information)))
    degrees = len(rows.told) - held
    scale, reasons = _scatter(fit, degrees)
    covariance = fit.covariance * scale
    model = from_vector(fit.unknown[:FULL], ready.centre)
    candidates = sorted(
        (
            Candidate(f.name, f.free, float(e - evidence.max()), x.chi2, i == chosen)
            for i, (f, e, x) in enumerate(zip(ready.forms, evidence, fits, strict=True))
        ),
        key=lambda one: -one.log_evidence,
    )
    groups_ = max(ready.groups) + 1
    ratios, ratio_covariance = np.zeros(groups_), np.zeros((groups_, groups_))
    ratios[1:], ratio_covariance[1:, 1:] = fit.unknown[FULL:], covariance[FULL:, FULL:]
    calibrated = Calibrated(
        axis=sheet.name,
        model=model,
        covariance=covariance[:FULL, :FULL],
        free=form.free,
        runs=_used(ready, robust, fit, ratios, ratio_covariance, {run.id: run for run in runs}),
        log_ratios=ratios,
        log_ratio_covariance=ratio_covariance,
        cross_covariance=np.column_stack([np.zeros(FULL), covariance[:FULL, FULL:]]),
        prior_covariance=form.covariance,
        chi2=fit.chi2,
        degrees=degrees,
        candidates=tuple(candidates),
        anchors=_anchors(ready, rows, fit),
        load_rating=sheet.screw.dynamic_load_rating,
        nut_mass=sheet.table.mass,
        bearing_share=_bearing_share(sheet, model),
        reasons=(*ready.reasons, *reasons, *_complaints(ready, robust)),
        knowledge=knowledge(ready.runs, rows, fit, correlation),
        made=Made(
            settings={
                "correlation": correlation, "discrepancy": dict(DISCREPANCY), "bed": list(BED), "form": FORM,
                "floor": FLOOR, "load": LOAD, "worn": WORN, "sheet": sheet.to_settings(),
                "known_preload_N": {
                    key: [value.value, value.standard_uncertainty] for key, value in known.items()
                },
            },
            inputs={"axis": digest(sheet.to_settings())},
        ),
    )  # fmt: skip
    return Solved(calibrated, rows, fit)


def prepare(
    runs: Sequence[Run],
    sheet: DataSheet,
    *,
    known: Mapping[str, Quantity] = _NOTHING,
    correlation: float = REPEATS,
    centre: float | None = None,
) -> Prepared:
    """Check what a calibration is given, and make rows of it; parameters and errors as :func:`calibrate`."""
    if not 1 <= len(runs) <= _MOST_RUNS:
        raise InputError(f"{len(runs)} runs were given; a calibration takes 1 to {_MOST_RUNS}.")
    for index, run in enumerate(runs):
        if run.id in {other.id for other in runs[:index]}:
            raise InputError(f"run {run.id[:12]} was given twice; each run counts once.")
        if run.axis is not None and run.axis != sheet.name:
            raise InputError(
                f"run {run.id[:12]} is of the axis {shown(run.axis)}; it must be of {shown(sheet.name)}, the "
                f"axis of {sheet.source}."
            )
    for key in known:
        if key not in {run.id for run in runs}:
            raise InputError(f"a known preload belongs to run {key[:12]}, which was not given.")
    seen = [observed(run) for run in runs]
    used = tuple(one for one in seen if len(one.frequency) and one.verdict != "bad")
    reasons = [
        f"run {one.id[:12]} was left out: {(one.reasons or ('it is bad',))[0]}"
        for one in seen if one not in used
    ]  # fmt: skip
    if not used:
        raise MeasurementError("no run has a frequency that can be used: all cells were refused.")
    reasons += [
        f"run {one.id[:12]} is suspect: {one.reasons[0]}"
        for one in used
        if one.verdict == "suspect" and one.reasons
    ]
    loaded = [run.id[:12] for run in runs if any(c.method == "paper" for c in run.cells)]
    if loaded:
        reasons.append(
            f"{'run' if len(loaded) == 1 else 'runs'} {', '.join(loaded)} by method paper: these frequencies "
            "are of a nut under load, which reads as up to 10 % less preload; method ml corrects it"
        )
    positions, loads = np.concatenate([one.position for one in used]), [one.load for one in used]
    low, high = -sheet.screw.bearing_to_zero, sheet.travel_limit
    for place in positions[(positions < low) | (positions > high)][:1]:
        raise InputError(
            f"a run has a stop at {place:g} m; it must lie between {low:g} and {high:g} m, on the screw of "
            f"{sheet.source}."
        )
    middle = float(positions.min() + positions.max()) / 2 if centre is None else centre
    candidates = forms(sheet, middle, (min(loads) + max(loads)) / 2)
    share = groups([one.id for one in used], [one.measured_at for one in used], known)
    return Prepared(
        runs=used,
        groups=share,
        rows=anchor_rows(used, share, known, sheet.table.mass),
        centre=middle,
        forms=candidates,
        covariance=relative_covariance(used, share, from_vector(candidates[0].mean, middle), correlation),
        reasons=tuple(reasons),
    )


def _scatter(fit: Fit, degrees: float) -> tuple[float, list[str]]:
    """Factor on the covariance where the data scatter beyond chance (R. T. Birge, 1932)."""
    limit = float(chi2_law.ppf(_SURE, max(degrees, 1.0)))
    if fit.chi2 <= limit:
        return 1.0, []
    words = (
        f"the frequencies scatter more than their uncertainties allow (χ² {fit.chi2:.0f} at {degrees:.0f} "
        "degrees of freedom): all uncertainties were widened"
    )
    return fit.chi2 / max(degrees, 1.0), [words]


def _used(
    ready: Prepared, robust: Robust, fit: Fit, ratios: Array, spread: Array, runs: Mapping[str, Run]
) -> tuple[RunUsed, ...]:
    used, start = [], 0
    for index, (one, group) in enumerate(zip(ready.runs, ready.groups, strict=True)):
        stop = start + len(one.frequency)
        out = [i - start for i in robust.cells if start <= i < stop]
        plan = runs[one.id].made.inputs.get("plan")
        used.append(
            RunUsed(
                id=one.id,
                load=one.load,
                measured_at=one.measured_at,
                group=group,
                cells=len(one.frequency),
                log_ratio=float(ratios[group]),
                log_ratio_uncertainty=float(np.sqrt(max(spread[group, group], 0.0))),
                plan=plan if isinstance(plan, str) else None,
                level=float(np.mean(fit.residual[start:stop])),
                weight=float(robust.weights[index]),
                cells_out=tuple(
                    f"{1e3 * one.position[i]:g} mm {one.condition[i]} ({off:+.2f} %)"
                    for i, off in zip(out, 1e2 * fit.residual[start + np.array(out, dtype=int)], strict=True)
                ),
            )
        )
        start = stop
    return tuple(used)


def _anchors(ready: Prepared, rows: Problem, fit: Fit) -> tuple[Anchor, ...]:
    n = len(rows.position)
    every = np.arange(len(rows.told))
    at_share, at_preload = PARAMETERS.index("share"), PARAMETERS.index("preload")
    share = from_vector(fit.unknown[:FULL], ready.centre).share
    whole = posterior(rows, fit, every)
    found = []
    for index, row in enumerate(ready.rows):
        without = posterior(rows, fit, np.delete(every, n + index))
        sd = [float(np.sqrt(c[k, k])) for c in (without, whole) for k in (at_preload, at_share)]
        value = float(np.exp(row.told))
        found.append(
            Anchor(
                row.kind, ready.runs[row.run].id, value, value * row.spread,
                sd[0], sd[2], share * (1 - share) * sd[1], share * (1 - share) * sd[3],
            )
        )  # fmt: skip
    return tuple(found)


def _complaints(ready: Prepared, robust: Robust) -> list[str]:
    said = []
    for index, weight in enumerate(robust.weights):
        if weight < 1:
            run = ready.runs[index]
            said.append(
                f"run {run.id[:12]} ({run.load:g} kg) does not fit the others and counts "
                f"{100 * weight:.0f} %: is its load or its preload another?"
            )
    if robust.disagree:
        names = ", ".join(ready.runs[i].id[:12] for i in robust.disagree)
        said.append(
            f"runs {names} do not fit each other at one preload, and nothing tells which is wrong: say when "
            "they were measured, if not on one day"
        )
    for index, score in robust.anchors:
        row = ready.rows[index]
        said.append(
            f"the {row.kind} of run {ready.runs[row.run].id[:12]}, {np.exp(row.told):.0f} N, lies "
            f"{abs(score):.1f} standard deviations {'above' if score > 0 else 'below'} what all else says"
        )
    return said


def _bearing_share(sheet: DataSheet, model: AxialModel) -> float:
    """−d ln U / d ln k_b: by the sheet, of what is not the nut's."""

    def whole(factor: float) -> AxialModel:
        bearing = replace(sheet.bearing, stiffness=sheet.bearing.stiffness * factor)
        return from_sheet(replace(sheet, bearing=bearing), model.centre)

    step = 1e-4
    part = -np.log(whole(1 + step).compliance / whole(1 - step).compliance) / (2 * step)
    return float(part / (1 - whole(1.0).share) * (1 - model.share))
