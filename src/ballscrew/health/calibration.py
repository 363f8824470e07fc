"""Calibrate an axis: runs at several loads and a data sheet become one model with its covariance."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ballscrew.axis.axial import AxialModel, from_sheet, from_vector
from ballscrew.axis.axial_prior import BED, DISCREPANCY
from ballscrew.axis.sheet import DataSheet
from ballscrew.base.provenance import Made, digest
from ballscrew.base.quantity import Quantity
from ballscrew.health.calibrated import Calibrated, Candidate
from ballscrew.health.candidates import ASK
from ballscrew.health.fit import FULL, Fit, Problem, solve
from ballscrew.health.identifiability import knowledge
from ballscrew.health.learned import anchors_learned, complaints, runs_used, scatter
from ballscrew.health.observed import REPEATS
from ballscrew.health.prepared import NOTHING, prepare
from ballscrew.health.robust import fit_robustly
from ballscrew.health.rows import FLOOR, FORM, LOAD, WORN
from ballscrew.modal.run import Run

__all__ = ["Solved", "calibrate", "solved"]


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
    known: Mapping[str, Quantity] = NOTHING,
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
    known: Mapping[str, Quantity] = NOTHING,
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
    scale, reasons = scatter(fit, degrees)
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
        runs=runs_used(ready, robust, fit, ratios, ratio_covariance, {run.id: run for run in runs}),
        log_ratios=ratios,
        log_ratio_covariance=ratio_covariance,
        cross_covariance=np.column_stack([np.zeros(FULL), covariance[:FULL, FULL:]]),
        prior_covariance=form.covariance,
        chi2=fit.chi2,
        degrees=degrees,
        candidates=tuple(candidates),
        anchors=anchors_learned(ready, rows, fit),
        load_rating=sheet.screw.dynamic_load_rating,
        nut_mass=sheet.table.mass,
        bearing_share=_bearing_share(sheet, model),
        reasons=(*ready.reasons, *reasons, *complaints(ready, robust)),
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


def _bearing_share(sheet: DataSheet, model: AxialModel) -> float:
    """−d ln U / d ln k_b: by the sheet, of what is not the nut's."""

    def whole(factor: float) -> AxialModel:
        bearing = replace(sheet.bearing, stiffness=sheet.bearing.stiffness * factor)
        return from_sheet(replace(sheet, bearing=bearing), model.centre)

    step = 1e-4
    part = -np.log(whole(1 + step).compliance / whole(1 - step).compliance) / (2 * step)
    return float(part / (1 - whole(1.0).share) * (1 - model.share))
