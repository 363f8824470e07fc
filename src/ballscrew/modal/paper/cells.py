"""All cells of a run by the paper's method: each identified, or listed and refused with a reason."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from operator import attrgetter
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.optimize import least_squares

from ballscrew.axis.frequency import predicted_frequency
from ballscrew.axis.sheet import DataSheet
from ballscrew.base.arrays import Array
from ballscrew.base.tables import FREQUENCY_RESPONSE, table_rows, validate
from ballscrew.fcft.cells import cells as planned_cells
from ballscrew.fcft.conditions import Condition
from ballscrew.fcft.plan import Plan
from ballscrew.modal.paper.cell import METHOD, PeakEstimate, identify
from ballscrew.modal.paper.judge import CERTAIN
from ballscrew.modal.paper.settings import PaperSettings
from ballscrew.modal.paper.uncertainty import condition_term
from ballscrew.modal.reasons import large_uncertainty
from ballscrew.modal.run import CellKey, CellResult
from ballscrew.modal.spectra import Spectra, coherence, frf
from ballscrew.recording.quality.finding import Quality

_TOLERANCE = 0.08  # of the frequency: a local defect changes it by 1 or 2 %, a wrong peak by more
_SCALE = 0.02  # of the frequency, beyond which a cell's weight in the curve fades
_LEAST_PART = 1 / 3  # of the measured cells that must show the mode
_CONDITIONS = [str(condition) for condition in Condition]
_SLOPE_STEP = 1e-3  # m

Estimates = dict[CellKey, PeakEstimate]


def identify_cells(
    transients: xr.Dataset | None,
    quality: Quality,
    sheet: DataSheet | None,
    plan: Plan | None,
    mass: float,
    settings: PaperSettings,
    *,
    spectra_alone: bool = False,
) -> tuple[tuple[CellResult, ...], xr.Dataset | None]:
    """Identify every cell of a run.

    Parameters
    ----------
    transients : Dataset or None
        The table *Transients*; None if no recording could be used.
    quality : Quality
        Of the run; if it is bad, every cell is refused.
    sheet : DataSheet or None
        Gives the expected frequency.
    plan : Plan or None
        Its cells are all listed, also those that were not measured.
    mass : float
        Load on the table, kg.
    settings : PaperSettings
        Of the method.
    spectra_alone : bool
        Whether another method estimates the frequencies: then all cells are listed without one.

    Returns
    -------
    cells : tuple of CellResult
        By position, condition and motion.
    response : Dataset or None
        The table *FrequencyResponse* of the cells that have spectra.
    """
    rows_of_cells = _complete_rows(transients)
    keys = set(rows_of_cells)
    if plan is not None:
        keys |= {CellKey(c.position, str(c.condition), c.motion) for c in planned_cells(plan)}
    estimates: Estimates = {}
    for key in sorted(keys, key=lambda k: (k.position, _CONDITIONS.index(k.condition), k.motion)):
        rows = rows_of_cells.get(key, [])
        if quality.verdict == "bad":
            reason = "the measurement is bad: " + "; ".join(quality.reasons)
            estimates[key] = PeakEstimate.refused(reason, len(rows))
        elif transients is None or not rows:
            estimates[key] = PeakEstimate.refused("no transient of this cell was measured", 0)
        else:
            cell, condition = transients.isel(transient=rows), Condition(key.condition)
            predicted = _predict(sheet, key.position, mass)
            estimates[key] = identify(cell, condition, *predicted, settings, spectra_alone=spectra_alone)
    if not spectra_alone:
        estimates = _refuse_strays(estimates)
        estimates = _with_condition_term(estimates, settings)
    results = tuple(_result(key, estimate) for key, estimate in estimates.items())
    return results, _table(estimates, transients)


def _complete_rows(transients: xr.Dataset | None) -> dict[CellKey, list[int]]:
    """Complete rows of each cell of the table; none for a cell of cut phases alone."""
    rows: dict[CellKey, list[int]] = {}
    if transients is None:
        return rows
    names = ("position_m", "condition", "motion", "complete")
    for index, (*key, complete) in enumerate(table_rows(transients, *names)):
        found = rows.setdefault(CellKey(*key), [])
        if complete:
            found.append(index)
    return rows


def _predict(sheet: DataSheet | None, position: float, mass: float) -> tuple[float | None, float]:
    """Predicted frequency and its slope along the axis, Hz and Hz/m."""
    if sheet is None:
        return None, 0.0
    low = max(position - _SLOPE_STEP, -0.999 * sheet.screw.bearing_to_zero)
    high = min(position + _SLOPE_STEP, sheet.travel_limit)
    here, below, above = (float(predicted_frequency(sheet, x, mass)) for x in (position, low, high))
    return here, (above - below) / (high - low)


def _refuse_strays(estimates: Estimates) -> Estimates:
    """Refuse peaks that do not lie on one smooth curve along the axis, as those of a mode do."""
    peaks = {key: each.frequency for key, each in estimates.items() if each.frequency is not None}
    if not peaks:
        return estimates
    off = off_the_curve([key.position for key in peaks], list(peaks.values()))
    measured = sum(each.repetitions > 0 for each in estimates.values())
    on_curve = len(peaks) - int(np.count_nonzero(off))
    few = (
        f"only {on_curve} of {measured} cells show a peak on one curve along the axis: that is no mode of it"
    )
    out = dict(estimates)
    for (key, frequency), stray in zip(peaks.items(), off, strict=True):
        if stray:
            out[key] = out[key].refuse(
                f"the peak at {frequency:.1f} Hz lies off the curve of the other cells"
            )
        elif few_on_the_curve(on_curve, measured):
            out[key] = out[key].refuse(few)
    return out


def off_the_curve(position: Sequence[float], frequency: Sequence[float]) -> NDArray[np.bool_]:
    """Whether each peak lies off the curve of the others.

    The curve is 1/f² as a polynomial of the position, as in Eq. (3): of first degree if one end of the screw
    is free, of second if both are fixed. It is fitted with a loss that is robust against outliers.

    Parameters
    ----------
    position : sequence of float
        Stops, m.
    frequency : sequence of float
        Peaks, Hz.

    Returns
    -------
    ndarray of bool
        True for those off the curve.
    """
    x, f = np.asarray(position, dtype=np.float64), np.asarray(frequency, dtype=np.float64)
    stops = len(np.unique(x))
    if len(f) < 3:
        return np.zeros(len(f), dtype=bool)
    span = np.ptp(x) or 1.0
    centre = np.median(f)
    basis = np.vander((x - x.mean()) / span, 1 + min(2, max(0, (stops - 1) // 2)), increasing=True)

    def residual(coefficients: Array) -> Array:
        # d(1/f²)·f²/2 is the relative deviation of the frequency
        return np.asarray((basis @ coefficients - (centre / f) ** 2) * (f / centre) ** 2 / 2)

    start = np.zeros(basis.shape[1])
    start[0] = 1.0
    fit = least_squares(residual, start, loss="cauchy", f_scale=_SCALE)
    return np.abs(residual(fit.x)) > _TOLERANCE


def few_on_the_curve(on_curve: int, measured: int) -> bool:
    """Whether fewer than a third of the measured cells have a peak on the curve: too few for a mode."""
    return on_curve < _LEAST_PART * measured


def _with_condition_term(estimates: Estimates, settings: PaperSettings) -> Estimates:
    """Add the scatter of the conditions of one stop, by motion, since motions differ in the nut's load."""
    out: Estimates = {}
    for key, estimate in estimates.items():
        scatter = _condition_scatter(estimates, key.motion)
        out[key] = _assessed_again(estimate.with_term("conditions", scatter), settings)
    return out


def _condition_scatter(estimates: Estimates, motion: int) -> float:
    position, frequency, uncertainty = [], [], []
    for key, estimate in estimates.items():
        if key.motion == motion and estimate.frequency is not None:
            position.append(key.position)
            frequency.append(estimate.frequency)
            uncertainty.append(estimate.random_uncertainty)
    if not frequency:
        return 0.0
    return condition_term(position, frequency, uncertainty)


def _assessed_again(estimate: PeakEstimate, settings: PaperSettings) -> PeakEstimate:
    """The same with the verdict that follows from its whole uncertainty."""
    f, u = estimate.frequency, estimate.uncertainty
    if f is None or u is None:
        return estimate
    if u > settings.most_uncertainty * f:
        reason = large_uncertainty(u, settings.most_uncertainty)
        return estimate.refuse(f"{reason}: the conditions of one stop disagree")
    if estimate.verdict == "good" and u > CERTAIN * f:
        return replace(estimate, verdict="suspect", reasons=(large_uncertainty(u, CERTAIN),))
    return estimate


def _result(key: CellKey, estimate: PeakEstimate) -> CellResult:
    return CellResult(
        *key,
        repetitions=estimate.repetitions,
        frequency_Hz=estimate.frequency,
        standard_uncertainty_Hz=estimate.uncertainty,
        damping_ratio=None,  # under a window this short the width of the peak is that of the window
        method=METHOD,
        verdict=estimate.verdict,
        reasons=estimate.reasons,
        coherence=estimate.coherence,
        band_Hz=estimate.band,
        uncertainty_terms_Hz=dict(estimate.terms),
    )


def _table(estimates: Estimates, transients: xr.Dataset | None) -> xr.Dataset | None:
    """The table *FrequencyResponse*: all cells on the grid of the cell with the fewest lines."""
    measured = {key: each.spectra for key, each in estimates.items() if each.spectra is not None}
    if not measured or transients is None:
        return None
    frequency = min((each.frequency for each in measured.values()), key=len)
    spectra = [each.on(frequency) for each in measured.values()]
    position, condition, motion = zip(*measured, strict=True)
    dims = ("cell", "response", "frequency")
    dataset = xr.Dataset(
        {
            "S_uu": (("cell", "frequency"), _stack(spectra, attrgetter("uu"))),
            "S_yy": (dims, _stack(spectra, attrgetter("yy"))),
            "S_uy": (dims, _stack(spectra, attrgetter("uy"))),
            "H1": (dims, _stack(spectra, partial(frf, estimator="H1"))),
            "H2": (dims, _stack(spectra, partial(frf, estimator="H2"))),
            "Hv": (dims, _stack(spectra, partial(frf, estimator="Hv"))),
            "coherence": (dims, _stack(spectra, coherence)),
            "repetitions": ("cell", _stack(spectra, attrgetter("count")).astype(np.int64)),
        },
        coords={
            "position_m": ("cell", np.array(position)),
            "condition": ("cell", np.array(condition)),
            "motion": ("cell", np.array(motion, np.int64)),
            "mass_kg": ("cell", np.full(len(measured), float(transients["mass_kg"].values[0]))),
            "response": ("response", transients["response"].values),
            "frequency": ("frequency", frequency),
        },
        attrs={
            "input": transients["input"].attrs["quantity"],
            "input_unit": transients["input"].attrs["unit"],
        },
    )
    return validate(dataset, FREQUENCY_RESPONSE)


def _stack(spectra: Sequence[Spectra], function: Callable[[Spectra], Any]) -> Any:
    """Values of a function for all cells, with the cell as first dimension."""
    return np.stack([function(each) for each in spectra])
