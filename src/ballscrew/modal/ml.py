"""The default method: all cells of a run as one, by :mod:`ballscrew.modal.joint`."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import xarray as xr

from ballscrew.axis.frequency import predicted_frequency
from ballscrew.axis.sheet import DataSheet
from ballscrew.base.quantity import Quantity
from ballscrew.modal.joint.identify import identify_jointly
from ballscrew.modal.joint.result import CellEstimate, Push
from ballscrew.modal.joint.settings import JointSettings, Response
from ballscrew.modal.joint.signals import TripSignals, marks_of, trip_signals
from ballscrew.modal.run import CellResult, SharedError
from ballscrew.recording.aligned import Aligned
from ballscrew.recording.measure import Measurement

__all__ = ["METHOD", "Identified", "identify_ml", "keeping"]

METHOD = "joint"

Key = tuple[float, str, int]


@dataclass(frozen=True, slots=True)
class Identified:
    """What the joint estimator says of a run, in the run's own words.

    Parameters
    ----------
    cells, shared_errors, mass_over_preload
        As in :class:`~ballscrew.modal.run.Run`.
    pushes : tuple of Push
        Forces of the motor that were told beside the mode.
    """

    cells: tuple[CellResult, ...]
    shared_errors: tuple[SharedError, ...] = ()
    mass_over_preload: Quantity | None = None
    pushes: tuple[Push, ...] = ()


def keeping(
    sheet: DataSheet | None, load: float, settings: JointSettings
) -> Callable[[Aligned], TripSignals]:
    """What to keep of each recording: its channels, at a rate that the mode needs.

    Parameters
    ----------
    sheet : DataSheet or None
        Says where the mode is expected.
    load : float
        On the table, kg.
    settings : JointSettings
        Of the method.

    Returns
    -------
    callable
        For :func:`ballscrew.recording.measure.measure`.
    """
    # Never less than the estimator takes, which is told by the mode in the middle of the axis.
    mode = math.sqrt(settings.lowest * settings.highest)
    if sheet is not None:
        mode = float(predicted_frequency(sheet, 0.0, load))

    def keep(aligned: Aligned) -> TripSignals:
        nut = [row for row, name in enumerate(aligned.responses) if ":motor" not in name]
        return trip_signals(replace(aligned, response=aligned.response[nut]), settings.rate * mode)

    return keep


def identify_ml(
    measurement: Measurement,
    cells: Sequence[CellResult],
    response: xr.Dataset | None,
    sheet: DataSheet | None,
    load: float,
    settings: JointSettings,
    which: Response,
) -> Identified:
    """Identify all cells of a run jointly.

    Parameters
    ----------
    measurement : Measurement
        With what :func:`keeping` kept.
    cells : sequence of CellResult
        All cells of the run, as the paper's method lists them: their coherence is taken over.
    response : Dataset or None
        The table *FrequencyResponse*.
    sheet : DataSheet or None
        Where to look first.
    load : float
        On the table, kg.
    settings : JointSettings
        Of the method.
    which : {"nut", "motor", "both"}
        What answers.

    Returns
    -------
    Identified
        Cells in the order of ``cells``.
    """
    if measurement.quality.verdict == "bad" or measurement.transients is None:
        return Identified(tuple(replace(cell, method=METHOD) for cell in cells))
    places = {file: index for index, file in enumerate(measurement.extracts)}
    marks = [
        replace(mark, trip=places[mark.trip])
        for mark in marks_of(measurement.transients)
        if mark.trip in places
    ]
    found = identify_jointly(list(measurement.extracts.values()), marks, sheet, load, settings, which)
    estimates = {(each.position, each.condition, each.motion): each for each in found.cells}
    coherences = _coherences(response)
    keys = [(cell.position_m, cell.condition, cell.motion) for cell in cells]
    rows = {(each.position, each.condition, each.motion): row for row, each in enumerate(found.cells)}
    over = found.mass_over_preload
    return Identified(
        tuple(
            _result(cell, estimates.get(key), found.band, coherences.get(key))
            for cell, key in zip(cells, keys, strict=True)
        ),
        tuple(
            SharedError(
                cause.name,
                cause.repeats,
                tuple(cause.effects[rows[key]] if key in rows else 0.0 for key in keys),
            )
            for cause in found.causes
        ),
        Quantity(*over, "kg/N") if over else None,
        found.pushes,
    )


def _result(
    cell: CellResult,
    estimate: CellEstimate | None,
    band: tuple[float, float] | None,
    coherence: tuple[np.ndarray, np.ndarray] | None,
) -> CellResult:
    """One cell; one that was never measured stays as it is listed."""
    if estimate is None:
        return replace(cell, method=METHOD)
    at = None
    if coherence is not None and estimate.frequency is not None and estimate.repetitions > 1:
        at = float(np.interp(estimate.frequency, *coherence))
    return CellResult(
        position_m=cell.position_m,
        condition=cell.condition,
        motion=cell.motion,
        repetitions=estimate.repetitions,
        frequency_Hz=estimate.frequency,
        standard_uncertainty_Hz=estimate.uncertainty,
        damping_ratio=estimate.damping,
        method=METHOD,
        verdict=estimate.verdict,
        reasons=estimate.reasons,
        coherence=at,
        band_Hz=band,
        uncertainty_terms_Hz=dict(estimate.terms),
        rotor_held_frequency_Hz=estimate.held_frequency,
        rotor_held_standard_uncertainty_Hz=estimate.held_uncertainty,
        deviation_Hz=estimate.deviation,
        deviation_standard_uncertainty_Hz=estimate.deviation_uncertainty,
    )


def _coherences(response: xr.Dataset | None) -> dict[Key, tuple[np.ndarray, np.ndarray]]:
    """Mean coherence of each cell over its responses, against frequency."""
    if response is None:
        return {}
    frequency = response["frequency"].values
    keys = zip(
        *(response[name].values.tolist() for name in ("position_m", "condition", "motion")), strict=True
    )
    return {
        key: (frequency, row)
        for key, row in zip(keys, response["coherence"].values.mean(axis=1), strict=True)
    }
