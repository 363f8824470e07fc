"""All cells of a run: each identified, or listed and refused with a reason."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import xarray as xr

from ballscrew.axis.frequency import predicted_frequency
from ballscrew.axis.sheet import DataSheet
from ballscrew.base.tables import FREQUENCY_RESPONSE, validate
from ballscrew.fcft.cells import cells as planned_cells
from ballscrew.fcft.conditions import Condition
from ballscrew.fcft.plan import Plan
from ballscrew.modal.continuity import off_the_curve, too_few
from ballscrew.modal.judge import CERTAIN
from ballscrew.modal.paper import METHOD, CellMode, identify
from ballscrew.modal.run import CellResult
from ballscrew.modal.settings import PaperSettings
from ballscrew.modal.spectra import coherence, frf
from ballscrew.modal.uncertainty import condition_term
from ballscrew.modal.unsure import unsure
from ballscrew.recording.quality.finding import Quality

__all__ = ["identify_cells"]

Key = tuple[float, str, int]


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
        The table *Transients*; None where no recording could be used.
    quality : Quality
        Of the run; where it is bad, every cell is refused.
    sheet : DataSheet or None
        Gives the expected frequency.
    plan : Plan or None
        Its cells are all listed, also those that were not measured.
    mass : float
        Load on the table, kg.
    settings : PaperSettings
        Of the method.
    spectra_alone : bool
        Whether another method will read the frequencies: then all cells are listed without one.

    Returns
    -------
    cells : tuple of CellResult
        By position, condition and motion.
    response : Dataset or None
        The table *FrequencyResponse* of the cells that have spectra.
    """
    groups = _groups(transients)
    keys = list(groups)
    if plan is not None:
        keys += [
            k for c in planned_cells(plan) if (k := (c.position, str(c.condition), c.motion)) not in groups
        ]
    keys = sorted(set(keys), key=lambda k: (k[0], list(Condition).index(Condition(k[1])), k[2]))
    modes = [
        (key, _identify(transients, groups.get(key), key, quality, sheet, mass, settings, spectra_alone))
        for key in keys
    ]
    if not spectra_alone:
        modes = _with_condition_term(_continuous(modes), settings)
    kept = [(key, mode) for key, mode in modes if mode.spectra is not None]
    results = tuple(_result(key, mode) for key, mode in modes)
    return results, _table(kept, transients) if kept else None


def _continuous(modes: Sequence[tuple[Key, CellMode]]) -> list[tuple[Key, CellMode]]:
    """Refuse peaks that do not run along the axis as a mode does."""
    found = [(key, mode.frequency) for key, mode in modes if mode.frequency is not None]
    if not found:
        return list(modes)
    off = off_the_curve([key[0] for key, _ in found], [frequency for _, frequency in found])
    strays = {key for (key, _), stray in zip(found, off, strict=True) if stray}
    measured = sum(mode.repetitions > 0 for _, mode in modes)
    shown = len(found) - len(strays)
    few = f"only {shown} of {measured} cells show a peak on one curve along the axis: that is no mode of it"
    out = []
    for key, mode in modes:
        if key in strays:
            mode = mode.refuse(f"the peak at {mode.frequency:.1f} Hz lies off the curve of the other cells")
        elif mode.frequency is not None and too_few(shown, measured):
            mode = mode.refuse(few)
        out.append((key, mode))
    return out


def _with_condition_term(
    modes: Sequence[tuple[Key, CellMode]], settings: PaperSettings
) -> list[tuple[Key, CellMode]]:
    """Add what the conditions of one stop disagree by; motions are told apart, since they load the nut."""
    whole = [(key, mode.plus("conditions", _disagreement(modes, key[2]))) for key, mode in modes]
    return [(key, _judged_again(mode, settings)) for key, mode in whole]


def _judged_again(mode: CellMode, settings: PaperSettings) -> CellMode:
    """The verdict that the whole uncertainty deserves."""
    if mode.frequency is None or mode.uncertainty is None:
        return mode
    if mode.uncertainty > settings.most_uncertainty * mode.frequency:
        return mode.refuse(
            f"{unsure(mode.uncertainty, settings.most_uncertainty)}: the conditions of one stop disagree"
        )
    if mode.verdict == "good" and mode.uncertainty > CERTAIN * mode.frequency:
        return replace(mode, verdict="suspect", reasons=(unsure(mode.uncertainty, CERTAIN),))
    return mode


def _disagreement(modes: Sequence[tuple[Key, CellMode]], motion: int) -> float:
    found = [
        (key[0], mode.frequency, mode.random)
        for key, mode in modes
        if key[2] == motion and mode.frequency is not None
    ]
    return condition_term(*zip(*found, strict=True)) if found else 0.0


def _groups(transients: xr.Dataset | None) -> dict[Key, np.ndarray]:
    """Rows of each cell; a cell that holds only cut phases has none."""
    if transients is None:
        return {}
    rows: dict[Key, list[int]] = {}
    columns = (transients[name].values.tolist() for name in ("position_m", "condition", "motion", "complete"))
    for index, (position, condition, motion, complete) in enumerate(zip(*columns, strict=True)):
        found = rows.setdefault((position, condition, motion), [])
        if complete:
            found.append(index)
    return {key: np.array(found, dtype=np.intp) for key, found in rows.items()}


def _identify(
    transients: xr.Dataset | None,
    rows: np.ndarray | None,
    key: Key,
    quality: Quality,
    sheet: DataSheet | None,
    mass: float,
    settings: PaperSettings,
    spectra_alone: bool,
) -> CellMode:
    if quality.verdict == "bad":
        return _empty(
            "the measurement is bad: " + "; ".join(quality.reasons), 0 if rows is None else len(rows)
        )
    if transients is None or rows is None or len(rows) == 0:
        return _empty("no transient of this cell was measured", 0)
    expected, slope = _expected(sheet, key[0], mass)
    cell = transients.isel(transient=rows)
    return identify(cell, Condition(key[1]), expected, slope, settings, spectra_alone=spectra_alone)


def _expected(sheet: DataSheet | None, position: float, mass: float) -> tuple[float | None, float]:
    """Predicted frequency and its slope with the position, Hz and Hz/m."""
    if sheet is None:
        return None, 0.0
    step = 1e-3
    low, high = (
        max(position - step, -0.999 * sheet.screw.bearing_to_zero),
        min(position + step, sheet.travel_limit),
    )
    at, below, above = (float(predicted_frequency(sheet, x, mass)) for x in (position, low, high))
    return at, (above - below) / (high - low)


def _empty(reason: str, count: int) -> CellMode:
    return CellMode(None, None, "refused", (reason,), count, None, None, None)


def _result(key: Key, mode: CellMode) -> CellResult:
    return CellResult(
        position_m=key[0],
        condition=key[1],
        motion=key[2],
        repetitions=mode.repetitions,
        frequency_Hz=mode.frequency,
        standard_uncertainty_Hz=mode.uncertainty,
        damping_ratio=None,  # under a window this short the width of the peak is the window's
        method=METHOD,
        verdict=mode.verdict,
        reasons=mode.reasons,
        coherence=mode.coherence,
        band_Hz=mode.band,
        uncertainty_terms_Hz=dict(mode.terms),
    )


def _table(kept: Sequence[tuple[Key, CellMode]], transients: xr.Dataset | None) -> xr.Dataset:
    """The table *FrequencyResponse*: all cells on the grid of the one that reaches least far."""
    spectra = [mode.spectra for _, mode in kept if mode.spectra is not None]
    frequency = min((s.frequency for s in spectra), key=len)
    spectra = [s.on(frequency) for s in spectra]
    assert transients is not None  # noqa: S101  spectra come from transients
    of = ("cell", "response", "frequency")
    keys = [key for key, _ in kept]
    dataset = xr.Dataset(
        {
            "S_uu": (("cell", "frequency"), np.stack([s.uu for s in spectra])),
            "S_yy": (of, np.stack([s.yy for s in spectra])),
            "S_uy": (of, np.stack([s.uy for s in spectra])),
            **{name: (of, np.stack([frf(s, name) for s in spectra])) for name in ("H1", "H2", "Hv")},
            "coherence": (of, np.stack([coherence(s) for s in spectra])),
            "repetitions": ("cell", np.array([s.count for s in spectra], np.int64)),
        },
        coords={
            "position_m": ("cell", np.array([k[0] for k in keys])),
            "condition": ("cell", np.array([k[1] for k in keys])),
            "motion": ("cell", np.array([k[2] for k in keys], np.int64)),
            "mass_kg": ("cell", np.full(len(keys), float(transients["mass_kg"].values[0]))),
            "response": ("response", transients["response"].values),
            "frequency": ("frequency", frequency),
        },
        attrs={
            "input": transients["input"].attrs["quantity"],
            "input_unit": transients["input"].attrs["unit"],
        },
    )
    return validate(dataset, FREQUENCY_RESPONSE)
