"""All cells of a run by the paper's method: each identified, or listed and refused with a reason."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache, partial
from operator import attrgetter
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.optimize import least_squares

from ballscrew.axis.frequency import predicted_frequency
from ballscrew.axis.sheet import DataSheet
from ballscrew.base.arrays import Array
from ballscrew.base.tables import FREQUENCY_RESPONSE, group_rows, validate
from ballscrew.fcft.cells import cells as planned_cells
from ballscrew.fcft.conditions import Condition
from ballscrew.fcft.plan import Plan
from ballscrew.modal.cell import CellKey, CellResult
from ballscrew.modal.paper.cell import METHOD, identify, root_sum_square, without_frequency
from ballscrew.modal.paper.judge import CERTAIN
from ballscrew.modal.paper.settings import PaperSettings
from ballscrew.modal.paper.uncertainty import condition_term
from ballscrew.modal.reason import Reason, large_uncertainty
from ballscrew.modal.spectra import Spectra, coherence, frf
from ballscrew.recording.quality.finding import Quality

_TOLERANCE = 0.08  # of the frequency: a local defect changes it by 1 or 2 %, a wrong peak by more
_SCALE = 0.02  # of the frequency, beyond which a cell's weight in the curve fades
_LEAST_PART = 1 / 3  # of the measured cells that must show the mode
_CONDITIONS = [str(condition) for condition in Condition]
_SLOPE_STEP = 1e-3  # m

Results = dict[CellKey, CellResult]


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
    results: Results = {}
    spectra: dict[CellKey, Spectra] = {}
    predict_at = cache(partial(_predict, sheet, mass))
    for key in sorted(keys, key=lambda k: (k.position, _CONDITIONS.index(k.condition), k.motion)):
        rows = rows_of_cells.get(key, [])
        if quality.verdict == "bad":
            reason = "the measurement is bad: " + "; ".join(quality.reasons)
            results[key] = CellResult.refused(key, len(rows), METHOD, [Reason("measurement", reason)])
        elif transients is None or not rows:
            reason = "no transient of this cell was measured"
            results[key] = CellResult.refused(key, 0, METHOD, [Reason("measurement", reason)])
        else:
            cell, (frequency, slope) = transients.isel(transient=rows), predict_at(key.position)
            results[key], own = identify(cell, key, frequency, slope, settings, spectra_alone=spectra_alone)
            if own is not None:
                spectra[key] = own
    if not spectra_alone:
        results = _refuse_strays(results)
        results = _with_condition_term(results, settings)
    return tuple(results.values()), _table(spectra, transients)


def _complete_rows(transients: xr.Dataset | None) -> dict[CellKey, list[int]]:
    """Complete rows of each cell of the table; none for a cell of cut phases alone."""
    if transients is None:
        return {}
    complete = transients["complete"].values
    groups = group_rows(transients, "position_m", "condition", "motion")
    return {CellKey(*key): [row for row in rows if complete[row]] for key, rows in groups.items()}


def _predict(sheet: DataSheet | None, mass: float, position: float) -> tuple[float | None, float]:
    """Predicted frequency and its slope along the axis, Hz and Hz/m."""
    if sheet is None:
        return None, 0.0
    low = max(position - _SLOPE_STEP, -0.999 * sheet.screw.bearing_to_zero)
    high = min(position + _SLOPE_STEP, sheet.travel_limit)
    here, below, above = predicted_frequency(sheet, [position, low, high], mass).tolist()
    return here, (above - below) / (high - low)


def _refuse_strays(results: Results) -> Results:
    """Refuse peaks that do not lie on one smooth curve along the axis, as those of a mode do."""
    peaks = {key: cell.frequency_Hz for key, cell in results.items() if cell.frequency_Hz is not None}
    if not peaks:
        return results
    off = off_the_curve([key.position for key in peaks], list(peaks.values()))
    measured = sum(cell.repetitions > 0 for cell in results.values())
    on_curve = len(peaks) - int(np.count_nonzero(off))
    few = (
        f"only {on_curve} of {measured} cells show a peak on one curve along the axis: that is no mode of it"
    )
    out = dict(results)
    for (key, frequency), stray in zip(peaks.items(), off, strict=True):
        if stray:
            reason = f"the peak at {frequency:.1f} Hz lies off the curve of the other cells"
            out[key] = without_frequency(out[key], Reason("no-mode", reason))
        elif few_on_the_curve(on_curve, measured):
            out[key] = without_frequency(out[key], Reason("no-mode", few))
    return out


def off_the_curve(position: Sequence[float], frequency: Sequence[float]) -> NDArray[np.bool_]:
    """Peaks that lie off the curve of the others.

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
    """True if fewer than a third of the measured cells have a peak on the curve: too few for a mode."""
    return on_curve < _LEAST_PART * measured


def _with_condition_term(results: Results, settings: PaperSettings) -> Results:
    """Add the scatter of the conditions of one stop, by motion, since motions differ in the nut's load."""
    out: Results = {}
    for key, cell in results.items():
        out[key] = _assess_again(cell, _condition_scatter(results, key.motion), settings)
    return out


def _condition_scatter(results: Results, motion: int) -> float:
    """Scatter of the conditions of one stop beyond that of repetitions and windows, Hz."""
    position, frequency, uncertainty = [], [], []
    for key, cell in results.items():
        if key.motion == motion and cell.frequency_Hz is not None:
            terms = cell.uncertainty_terms_Hz
            position.append(key.position)
            frequency.append(cell.frequency_Hz)
            uncertainty.append(math.hypot(terms["repetitions"], terms["window"]))
    if not frequency:
        return 0.0
    return condition_term(position, frequency, uncertainty)


def _assess_again(cell: CellResult, scatter: float, settings: PaperSettings) -> CellResult:
    """The cell with the scatter of conditions in its uncertainty, and the verdict that follows from it."""
    f = cell.frequency_Hz
    if f is None:
        return cell
    terms = cell.uncertainty_terms_Hz | {"conditions": scatter}
    u = root_sum_square(terms)
    if u > settings.most_uncertainty * f:
        kind, text = large_uncertainty(u, settings.most_uncertainty)
        return without_frequency(cell, Reason(kind, f"{text}: the conditions of one stop disagree"))
    cell = replace(cell, standard_uncertainty_Hz=u, uncertainty_terms_Hz=terms)
    if cell.verdict == "good" and u > CERTAIN * f:
        return replace(cell, verdict="suspect").with_reasons(large_uncertainty(u, CERTAIN))
    return cell


def _table(measured: dict[CellKey, Spectra], transients: xr.Dataset | None) -> xr.Dataset | None:
    """The table *FrequencyResponse*: all cells on the grid of the cell with the fewest lines."""
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
