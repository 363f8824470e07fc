"""Calibrate an axis: runs at several loads and a data sheet become one model with its covariance."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ballscrew.axis.axial import from_vector
from ballscrew.axis.axial_prior import BED, DISCREPANCY
from ballscrew.axis.sheet import DataSheet
from ballscrew.base.errors import MeasurementError
from ballscrew.base.provenance import Made, digest
from ballscrew.base.quantity import Quantity
from ballscrew.base.threads import single_threaded
from ballscrew.calibration.assumptions import Assumptions
from ballscrew.calibration.bearing import bearing_share
from ballscrew.calibration.between import WORN
from ballscrew.calibration.calibrated_axis import CalibratedAxis
from ballscrew.calibration.fit import FULL, Fit, Problem, solve
from ballscrew.calibration.frequency_table import REPEATS
from ballscrew.calibration.identifiability import knowledge
from ballscrew.calibration.learned import anchors_learned, complaints, runs_used
from ballscrew.calibration.model_selection import Choice, choose
from ballscrew.calibration.preload_groups import when
from ballscrew.calibration.preparation import NOTHING, Prepared, prepare
from ballscrew.calibration.rows import FLOOR, FORM, LOAD
from ballscrew.calibration.scattered import scattered, widened
from ballscrew.calibration.tolerances import estimate_tolerances, tolerance_warnings
from ballscrew.modal.run import Run

__all__ = ["Solved", "calibrate", "solve_calibration"]


@dataclass(frozen=True, slots=True, eq=False)
class Solved:
    """A calibration with the problem that it solved.

    Parameters
    ----------
    calibrated : CalibratedAxis
        The model.
    problem, fit
        Rows and prior of the chosen form, and the most probable unknowns.
    """

    calibrated: CalibratedAxis
    problem: Problem
    fit: Fit


def calibrate(
    runs: Sequence[Run],
    sheet: DataSheet,
    *,
    known: Mapping[str, Quantity] = NOTHING,
    correlation: float = REPEATS,
    centre: float | None = None,
    assumptions: Assumptions | None = None,
) -> CalibratedAxis:
    """Fit the axis's working vector to the frequencies of several runs.

    The most probable values given frequencies, anchors and data sheet, and their full covariance. Runs of one
    experiment (:func:`~ballscrew.calibration.preload_groups.groups`) share one preload; the first is the
    reference.
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
    assumptions : Assumptions, optional
        Between runs of several days or preloads: by how much the bearing drifts, and what the test's own load
        leaves on a worn nut. Of the rest nothing is used.

    Returns
    -------
    CalibratedAxis
        The model.

    Raises
    ------
    InputError
        If there is no run, one is given twice or belongs to another axis, a known preload belongs to no run,
        or a position does not lie on the screw.
    MeasurementError
        If no run has a frequency, or the fit does not settle.
    """
    return solve_calibration(
        runs, sheet, known=known, correlation=correlation, centre=centre, assumptions=assumptions
    ).calibrated


@single_threaded
def solve_calibration(
    runs: Sequence[Run],
    sheet: DataSheet,
    *,
    known: Mapping[str, Quantity] = NOTHING,
    correlation: float = REPEATS,
    centre: float | None = None,
    assumptions: Assumptions | None = None,
) -> Solved:
    """Calibrate, and keep the problem and its solution; parameters and errors as :func:`calibrate`."""
    # The first run is the reference; the order of the others does not matter.
    runs = [*runs[:1], *sorted(runs[1:], key=lambda run: (when(run.measured_at), run.id))]
    ready, choice, refused = _chosen(runs, sheet, known, correlation, centre, assumptions)
    robust, form = choice.robust, choice.form
    said = scattered(robust.problem, robust.fit)
    rows = widened(robust.problem, said.scale)
    fit = robust.fit if said.scale == 1.0 else solve(rows, robust.fit.unknown)
    covariance, model = fit.covariance, from_vector(fit.unknown[:FULL], ready.centre)
    found = estimate_tolerances(form, fit.unknown[:FULL])
    groups_ = max(ready.groups) + 1
    ratios, ratio_covariance = np.zeros(groups_), np.zeros((groups_, groups_))
    ratios[1:], ratio_covariance[1:, 1:] = fit.unknown[FULL:], covariance[FULL:, FULL:]
    calibrated = CalibratedAxis(
        axis=sheet.name,
        model=model,
        covariance=covariance[:FULL, :FULL],
        free=form.free,
        runs=runs_used(ready, robust, fit, ratios, ratio_covariance, {run.id: run for run in runs}),
        log_ratios=ratios,
        log_ratio_covariance=ratio_covariance,
        cross_covariance=np.column_stack([np.zeros(FULL), covariance[:FULL, FULL:]]),
        prior_covariance=form.covariance,
        chi2=said.chi2,
        degrees=said.degrees,
        candidates=choice.candidates,
        anchors=anchors_learned(ready, rows, fit),
        load_rating=sheet.screw.dynamic_load_rating,
        nut_mass=sheet.table.mass,
        bearing_share=bearing_share(sheet, model),
        reasons=(*refused, *ready.reasons, *said.reasons, *complaints(ready, robust),
            *tolerance_warnings(found, sheet)),
        tolerances=found,
        knowledge=knowledge(ready.runs, rows, fit, correlation, ready.between, sheet=sheet, scale=said.scale),
        made=Made(
            settings={
                "correlation": correlation, "discrepancy": dict(DISCREPANCY), "bed": list(BED), "form": FORM,
                "floor": FLOOR, "load": LOAD, "worn": WORN, "sheet": sheet.to_settings(),
                "bearing_drift": ready.between.kept.bearing_drift,
                "nut_load": [ready.between.kept.nut_load, ready.between.kept.nut_load_spread],
                "known_preload_N": {
                    key: [value.value, value.standard_uncertainty] for key, value in known.items()
                },
            },
            inputs={"axis": digest(sheet.to_settings())},
        ),
    )  # fmt: skip
    return Solved(calibrated, rows, fit)


def _chosen(
    runs: Sequence[Run],
    sheet: DataSheet,
    known: Mapping[str, Quantity],
    correlation: float,
    centre: float | None,
    assumptions: Assumptions | None,
) -> tuple[Prepared, Choice, tuple[str, ...]]:
    """Prepare and choose; a run of which too many cells do not fit is left out, and all is done again."""
    said: list[str] = []
    left = list(runs)
    while True:
        ready = prepare(
            left, sheet, known=known, correlation=correlation, centre=centre, assumptions=assumptions
        )
        choice = choose(ready)
        if not choice.robust.refused:
            return ready, choice, tuple(said)
        gone = {ready.runs[i].id for i in choice.robust.refused}
        said += [
            f"run {one[:12]} was left out: more than a quarter of its cells do not fit the others"
            for one in gone
        ]
        left = [run for run in left if run.id not in gone]
        known = {key: value for key, value in known.items() if key not in gone}
        if not left:
            raise MeasurementError(f"no run can be used: {'; '.join(said)}.")
