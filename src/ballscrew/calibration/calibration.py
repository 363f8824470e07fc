"""Calibration: runs at several loads and a data sheet become one axial model with its covariance."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

import numpy as np

from ballscrew.axis.axial import PARAMETERS, from_vector
from ballscrew.axis.axial_prior import BED, DISCREPANCY
from ballscrew.axis.sheet import DataSheet
from ballscrew.axis.sheet_file import read_axis
from ballscrew.base.errors import InputError, MeasurementError
from ballscrew.base.provenance import Made, digest
from ballscrew.base.quantity import Quantity
from ballscrew.base.threads import single_threaded
from ballscrew.calibration.anchors import known_preload
from ballscrew.calibration.assumptions import DEFAULT_ASSUMPTIONS, FORM, LOAD, Assumptions
from ballscrew.calibration.bearing import bearing_share
from ballscrew.calibration.calibrated_axis import Anchor, CalibratedAxis, CalibrationRun, Doubt
from ballscrew.calibration.conventions import (
    add_convention,
    compare_conventions,
    explains_better,
    likely_convention,
)
from ballscrew.calibration.covariance import FLOOR, WORN_NUT
from ballscrew.calibration.fit import SIZE, Fit, goodness_of_fit, scaled, solve
from ballscrew.calibration.identifiability import (
    describe_directions,
    describe_quantities,
    posterior_covariance,
    rank_doubts,
)
from ballscrew.calibration.method import method_of
from ballscrew.calibration.model_forms import SINGLE_END, ModelForm, model_forms
from ballscrew.calibration.model_selection import SelectedForm, select_form
from ballscrew.calibration.next_measurement import next_measurements
from ballscrew.calibration.preload_groups import preload_doubts, sort_key
from ballscrew.calibration.preparation import CalibrationInput, prepare
from ballscrew.calibration.robust_fit import RobustFit
from ballscrew.calibration.temperature import slope_of_runs, temperature_notes
from ballscrew.calibration.tolerances import estimate_tolerances, tolerance_doubts
from ballscrew.modal.amend import current_runs
from ballscrew.modal.run import Run


def calibrate(
    runs: Run | Sequence[Run | str | Path],
    sheet: DataSheet | str | Path,
    *,
    known: Mapping[str, Quantity | str] = MappingProxyType({}),
    assumptions: Assumptions = DEFAULT_ASSUMPTIONS,
) -> CalibratedAxis:
    """Fit the axial model to the frequencies of several runs.

    The estimates are the most probable values given frequencies, anchors and data sheet, with their full
    covariance. Runs of one experiment (:func:`~ballscrew.calibration.preload_groups.preload_groups`) share
    one preload; that of the first run is the reference. Outlying cells and runs lose weight and are named.
    Another form of the model replaces the sheet's where the evidence for it is 20 to 1.

    Parameters
    ----------
    runs : Run, or sequence of Run or path-like
        Of one axis, at several loads on the table where possible.
    sheet : DataSheet or path-like
        The axis, with its tolerances.
    known : mapping of str to Quantity or str
        Known preloads by run id, as quantities of a force or texts such as ``"600 N ± 10 N"``.
    assumptions : Assumptions
        Correlation of repeating errors from run to run; drift of the bearing, and correction for the test's
        load on a worn nut, between runs of several days or preloads; effect of the temperature, and error of
        the position, between those of one preload; limits for doubts and notes. The others are not used.

    Returns
    -------
    CalibratedAxis
        The model; its compliance is stated in the middle of the stops.

    Raises
    ------
    InputError
        If there is no run, one is given twice or belongs to another axis, a known preload belongs to no run,
        a known preload is no force, or a position is not on the screw.
    MeasurementError
        If no run has a frequency, or the fit does not converge.
    """
    given = [runs] if isinstance(runs, Run) else runs
    if isinstance(given, str | Path):
        given = [given]
    read = [Run.of(run) for run in given]
    if not isinstance(sheet, DataSheet):
        sheet = read_axis(sheet)
    preloads = {run: _known_force(value, run) for run, value in known.items()}
    return solve_calibration(read, sheet, preloads, assumptions)[0]


def _known_force(given: Quantity | str, run: str) -> Quantity:
    """Known preload of a run, N."""
    try:
        if not isinstance(given, Quantity):
            return known_preload(given)
        force = given.to("N")
        if not 0 < force.standard_uncertainty < force.value:
            raise InputError(f"{force} was given; it must be above 0 N, and its uncertainty between 0 and it")
        return force
    except InputError as error:
        text = str(error).removesuffix(".")
        raise InputError(f"the known preload of run {run[:12]}: {text}.") from None


def axis_of_sheet(sheet: DataSheet, centre: float, load: float) -> CalibratedAxis:
    """Axial model by a data sheet alone, with its tolerances; suspect, since no run has confirmed it.

    Parameters
    ----------
    sheet : DataSheet
        The axis.
    centre : float
        Position where the compliance is stated, m.
    load : float
        On the table, kg.

    Returns
    -------
    CalibratedAxis
        Without runs.

    Raises
    ------
    InputError
        If the centre is not on the screw.
    """
    form = model_forms(sheet, centre, load)[0]
    model = from_vector(form.mean, centre)
    text = f"no run has calibrated the axis: the model is that of {sheet.source} alone"
    return CalibratedAxis(
        axis=sheet.name,
        model=model,
        covariance=form.covariance,
        free=form.free,
        runs=(),
        log_ratios=np.zeros(1),
        log_ratio_covariance=np.zeros((1, 1)),
        cross_covariance=np.zeros((SIZE, 1)),
        prior_covariance=form.covariance,
        chi2=0.0,
        degrees=0.0,
        candidates=(),
        anchors=(),
        load_rating=sheet.screw.dynamic_load_rating,
        nut_mass=sheet.table.mass,
        bearing_share=bearing_share(sheet, model),
        reasons=(Doubt("not-calibrated", text), *_spring_doubts(sheet)),
        tolerances=estimate_tolerances(form, form.mean),
        made=_made(sheet, {}, DEFAULT_ASSUMPTIONS),
    )


@single_threaded
def solve_calibration(
    runs: Sequence[Run], sheet: DataSheet, known: Mapping[str, Quantity], assumptions: Assumptions
) -> tuple[CalibratedAxis, Fit]:
    """The calibrated axis, and the fit that it is from; parameters and errors as :func:`calibrate`."""
    # The first run is the reference; the order of the others does not matter.
    runs = current_runs(runs)
    runs = [*runs[:1], *sorted(runs[1:], key=lambda run: (sort_key(run.measured_at), run.id))]
    prepared, selected, omitted = _select(runs, sheet, known, assumptions)
    robust, form, fit = selected.robust, selected.form, selected.robust.fit
    goodness = goodness_of_fit(fit)
    if goodness.scale != 1.0:
        fit = solve(scaled(fit.problem, goodness.scale), fit.unknown)
    tolerances = estimate_tolerances(form, fit.unknown[:SIZE])
    conventions = compare_conventions(form, fit, sheet)
    temperature = slope_of_runs(prepared.runs, fit, prepared.temperature_error, assumptions)
    # The first group is the reference: its ratio is 1, without uncertainty.
    log_ratios = np.pad(fit.unknown[SIZE:], (1, 0))
    ratio_covariance = np.pad(fit.covariance[SIZE:, SIZE:], (1, 0))
    doubts, insignificant = tolerance_doubts(
        tolerances,
        sheet,
        form.covariance,
        fit.covariance[:SIZE, :SIZE],
        explained=explains_better(conventions),
    )
    doubts, convention_notes = add_convention(doubts, conventions)
    calibrated = CalibratedAxis(
        axis=sheet.name,
        model=fit.model,
        covariance=fit.covariance[:SIZE, :SIZE],
        free=form.free,
        runs=_calibration_runs(prepared, robust, fit, {run.id: run for run in runs}),
        log_ratios=log_ratios,
        log_ratio_covariance=ratio_covariance,
        cross_covariance=np.pad(fit.covariance[:SIZE, SIZE:], ((0, 0), (1, 0))),
        prior_covariance=form.covariance,
        chi2=goodness.chi2,
        degrees=goodness.degrees,
        candidates=selected.candidates,
        anchors=_anchors(prepared, fit),
        load_rating=sheet.screw.dynamic_load_rating,
        nut_mass=sheet.table.mass,
        bearing_share=bearing_share(sheet, fit.model),
        reasons=(
            *omitted,
            *_spring_doubts(sheet),
            *rank_doubts(fit),
            *prepared.reasons,
            *goodness.reasons,
            *_support_doubts(sheet, form),
            *_outlier_doubts(prepared, robust),
            *preload_doubts(prepared.runs, prepared.groups, log_ratios, ratio_covariance, known, assumptions),
            *doubts,
        ),
        notes=(
            *prepared.notes,
            *insignificant,
            *convention_notes,
            *likely_convention(form, fit, sheet),
            *temperature_notes(prepared.runs, prepared.groups, temperature, assumptions),
        ),
        tolerances=tolerances,
        temperature=temperature,
        conventions=conventions,
        knowledge=(
            *describe_quantities(fit),
            *describe_directions(fit),
            *next_measurements(prepared, fit, goodness.scale, sheet),
        ),
        made=_made(sheet, known, assumptions),
    )
    return calibrated, fit


def _select(
    runs: Sequence[Run], sheet: DataSheet, known: Mapping[str, Quantity], assumptions: Assumptions
) -> tuple[CalibrationInput, SelectedForm, list[Doubt]]:
    """Input of the fit, selected form, and doubts by the runs that were left out.

    A run with too many outlying cells is left out, and the form is selected again without it.
    """
    omitted: list[Doubt] = []
    remaining = list(runs)
    while True:
        prepared = prepare(remaining, sheet, known, assumptions)
        selected = select_form(prepared)
        refused = {prepared.runs[i].id for i in selected.robust.refused}
        if not refused:
            return prepared, selected, omitted
        reason = "more than a quarter of its cells do not fit the others"
        omitted += [Doubt("omitted-run", f"run {run[:12]} was left out: {reason}") for run in refused]
        remaining = [run for run in remaining if run.id not in refused]
        known = {run: preload for run, preload in known.items() if run not in refused}
        if not remaining:
            reasons = "; ".join(doubt.text for doubt in omitted)
            raise MeasurementError(f"no run can be used: {reasons}.")


def _calibration_runs(
    prepared: CalibrationInput, robust: RobustFit, fit: Fit, run_of: Mapping[str, Run]
) -> tuple[CalibrationRun, ...]:
    """Each run that was used, in the order of the fit; ``run_of`` is the run of each id."""
    log_ratios = np.pad(fit.unknown[SIZE:], (1, 0))
    spreads = np.pad(np.sqrt(np.diag(fit.covariance)[SIZE:]), (1, 0))
    used = []
    for index, (table, group) in enumerate(zip(prepared.runs, prepared.groups, strict=True)):
        run, rows = run_of[table.id], np.flatnonzero(fit.problem.run == index)
        outliers = []
        for cell in robust.cells:
            if cell in rows:
                place = f"{round(1e3 * fit.problem.position[cell], 1):g} mm {table.condition[cell - rows[0]]}"
                outliers.append(f"{place} ({1e2 * fit.residual[cell]:+.2f} %)")  # residual of ln f
        used.append(
            CalibrationRun(
                id=run.id,
                load=table.load,
                measured_at=run.measured_at,
                group=group,
                cells=len(rows),
                log_ratio=float(log_ratios[group]),
                log_ratio_uncertainty=float(spreads[group]),
                plan=run.made.inputs.get("plan"),
                method=method_of(run),
                level=float(np.mean(fit.residual[rows])),
                weight=float(robust.weights[index]),
                outliers=tuple(outliers),
            )
        )
    return tuple(used)


def _anchors(prepared: CalibrationInput, fit: Fit) -> tuple[Anchor, ...]:
    """Each anchor, with the standard uncertainties of ln P_ref and of the share without it and with it."""
    # Rows of the fit: those of n cells, then one for each anchor.
    n, rows = len(fit.problem.position), np.arange(len(fit.problem.observed))
    share = fit.model.share
    per_logit = share * (1 - share)  # d share / d logit
    at_share, at_preload = PARAMETERS.index("share"), PARAMETERS.index("preload")
    with_anchor = np.sqrt(np.diag(posterior_covariance(fit, rows)))
    anchors = []
    for index, row in enumerate(prepared.anchors):
        without = np.sqrt(np.diag(posterior_covariance(fit, np.delete(rows, n + index))))
        preload = float(np.exp(row.log_preload))
        anchors.append(
            Anchor(
                kind=row.kind,
                run=prepared.runs[row.run].id,
                preload=preload,
                standard_uncertainty=preload * row.spread,
                log_preload_without=float(without[at_preload]),
                log_preload_with=float(with_anchor[at_preload]),
                share_without=per_logit * float(without[at_share]),
                share_with=per_logit * float(with_anchor[at_share]),
            )
        )
    return tuple(anchors)


def _support_doubts(sheet: DataSheet, form: ModelForm) -> list[Doubt]:
    """Doubt of a screw fixed at both ends whose frequencies are those of one fixed at one end."""
    if form.name != SINGLE_END:
        return []
    text = (
        f"{sheet.source} states support = 'fixed-fixed', and the frequencies are those of a screw fixed at "
        "one end: has an end lost its pretension (warm screw, loose bearing nut), or is the support another?"
    )
    return [Doubt("support", text)]


def _spring_doubts(sheet: DataSheet) -> list[Doubt]:
    """Doubt of a nut that a spring preloads: corrections for the load of the test are those of two flanks."""
    if sheet.screw.preload_by != "spring":
        return []
    text = (
        "a spring preloads the nut: one flank carries and loses contact at a load of P, not of 2.83 P, but "
        "the corrections for the load of the test are those of two flanks"
    )
    return [Doubt("spring-preload", text)]


def _outlier_doubts(prepared: CalibrationInput, robust: RobustFit) -> list[Doubt]:
    """Doubts by runs and anchors that do not fit the others."""
    doubts = []
    for run, weight in zip(prepared.runs, robust.weights, strict=True):
        if weight < 1:
            text = (
                f"run {run.id[:12]} ({run.load:g} kg) does not fit the others and has a weight of "
                f"{100 * weight:.0f} %: check its load and its preload"
            )
            doubts.append(Doubt("outlying-run", text))
    if robust.unfinished:
        text = (
            f"the search for outliers stopped after {len(robust.cells)} cells and {len(robust.runs)} runs: "
            "more do not fit"
        )
        doubts.append(Doubt("unfinished-search", text))
    if robust.contradicting:
        names = ", ".join(prepared.runs[i].id[:12] for i in sorted(robust.contradicting))
        text = (
            f"runs {names} contradict each other at one preload, and the data do not show which is wrong: "
            "state when they were measured, if not on one day"
        )
        if len(robust.contradicting) == 1:
            text = (
                f"run {names} does not fit the data sheet, and no other run shows which of the two is wrong"
            )
        doubts.append(Doubt("contradicting-runs", text))
    for index, distance in robust.anchors:
        row = prepared.anchors[index]
        side = "above" if distance > 0 else "below"
        text = (
            f"the {row.kind} of run {prepared.runs[row.run].id[:12]}, {np.exp(row.log_preload):.0f} N, lies "
            f"{abs(distance):.1f} standard deviations {side} the estimate from all other data"
        )
        doubts.append(Doubt(row.kind.replace(" ", "-"), text))
    return doubts


def _made(sheet: DataSheet, known: Mapping[str, Quantity], assumptions: Assumptions) -> Made:
    """Settings that the numbers depend on, and the digest of the sheet."""
    preloads = {run: [preload.value, preload.standard_uncertainty] for run, preload in known.items()}
    settings = {
        "correlation": assumptions.repeats,
        "discrepancy": dict(DISCREPANCY),
        "bed": list(BED),
        "form": FORM,
        "floor": FLOOR,
        "load": LOAD,
        "worn": WORN_NUT,
        "sheet": sheet.to_settings(),
        "bearing_drift": assumptions.bearing_daily_drift,
        "nut_load": [assumptions.nut_load, assumptions.nut_load_spread],
        "temperature": assumptions.temperature,
        "known_preload_N": preloads,
    }
    return Made(settings=settings, inputs={"axis": digest(sheet.to_settings())})
