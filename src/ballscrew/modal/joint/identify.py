"""The joint estimator: from the signals of a run to the axial mode in every cell."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ballscrew.axis.sheet import DataSheet
from ballscrew.base.errors import InputError
from ballscrew.modal.joint.initial import (
    FREQUENCY_SCALES,
    InitialValues,
    initial_values,
    least_nut_load,
    total_inertia,
)
from ballscrew.modal.joint.result import JointResult
from ballscrew.modal.joint.results import joint_result, refused_run
from ballscrew.modal.joint.search import search
from ballscrew.modal.joint.settings import RESPONSES, JointSettings, Response
from ballscrew.modal.joint.signals import Mark, TripSignals, decimated

__all__ = ["identify_jointly"]

_LEAST_CELLS = 3
_LEAST_RATE = 5.0  # samples per period of the mode
_STARTS = 4  # searches without a data sheet, each around the frequency found by the one before
_HELD_RATIO = 0.8  # of the rotor-held frequency to the free one, without a data sheet


def identify_jointly(
    trips: Sequence[TripSignals],
    marks: Sequence[Mark],
    sheet: DataSheet | None = None,
    load: float = 0.0,
    settings: JointSettings | None = None,
    response: Response = "both",
) -> JointResult:
    """Identify all cells of a run as one.

    The compliance along the axis is one curve, so that every cell contributes to all others. The table's
    acceleration is explained twice: by the motor's torque, whose mode is the one with the rotor free, and by
    the motor's own motion, whose mode is the one with the rotor held.

    Parameters
    ----------
    trips : sequence of TripSignals
        The run, one per recording.
    marks : sequence of Mark
        Where the acceleration phases lie.
    sheet : DataSheet, optional
        Gives initial values; the data decide.
    load : float
        On the table, kg.
    settings : JointSettings, optional
        Settings.
    response : {"nut", "motor", "both"}
        Fitted response: the nut's accelerometers, the motor's encoder, or what there is.

    Returns
    -------
    JointResult
        Every cell that was marked, with a frequency and its uncertainty, or refused with a reason.

    Raises
    ------
    InputError
        If trips and marks do not fit together, or the response asked for was not measured.
    """
    settings = settings or JointSettings()
    _check(trips, marks, response)
    if not marks:
        return JointResult((), ("no acceleration phase was found",))
    finite = [_finite(trip) for trip in trips]
    if not all(finite):
        return refused_run(marks, f"trip {finite.index(False) + 1} has samples that are no numbers")
    low, high = _reach(trips)
    inertia = total_inertia(trips)
    if inertia is None or not high > low:
        return refused_run(marks, "the axis does not move")
    if sheet is not None:
        initial = initial_values(sheet, load, low, high)
    else:
        initial = _without_sheet(math.sqrt(settings.lowest * settings.highest))
    names = _block_names(trips, response)
    curved = sheet is not None and sheet.support == "fixed-fixed"
    for _ in range(_STARTS):
        reduced = [decimated(trip, settings.rate * initial.free) for trip in trips]
        rate = reduced[0].rate
        if rate < _LEAST_RATE * initial.free:
            reason = f"{rate:.0f} samples per second are too few for a mode near {initial.free:.0f} Hz"
            return refused_run(marks, reason)
        found = search(reduced, marks, inertia, initial, names, settings, curved)
        if found is None or len(found.fit.blocks[0].windows.cells) < _LEAST_CELLS:
            return refused_run(marks, "too few transients of one kind to average")
        centre = found.fit.modes[0].centre
        if sheet is not None:
            least_load = least_nut_load(sheet, load, found.fit.blocks[0].windows.middle, centre)
            return joint_result(found, marks, settings, response, least_load)
        if FREQUENCY_SCALES[0] < centre / initial.free < FREQUENCY_SCALES[-1]:
            return joint_result(found, marks, settings, response, 0.0)
        # Far from where the search began, the band may have excluded a better mode.
        initial = _without_sheet(centre)
    return refused_run(marks, f"no mode was found near {settings.lowest:g} to {settings.highest:g} Hz")


def _reach(trips: Sequence[TripSignals]) -> tuple[float, float]:
    """Range of the motion of all trips, m."""
    low = min(float(trip.position.min()) for trip in trips)
    high = max(float(trip.position.max()) for trip in trips)
    return low, high


def _without_sheet(frequency: float) -> InitialValues:
    return InitialValues(free=frequency, held=_HELD_RATIO * frequency, slope=1.0)


def _block_names(trips: Sequence[TripSignals], response: Response) -> tuple[str, ...]:
    """Blocks to fit: drive and response of each."""
    names: tuple[str, ...] = ()
    if response != "motor" and all(len(trip.response) for trip in trips):
        names = ("torque-nut", "motor-nut")
    if response != "nut":
        names = (*names, "torque-motor")
    return names


def _check(trips: Sequence[TripSignals], marks: Sequence[Mark], response: str) -> None:
    """Refuse trips and marks that do not belong together."""
    if response not in RESPONSES:
        raise InputError(f"the response is {response!r}; it must be one of {', '.join(RESPONSES)}.")
    if not trips:
        raise InputError("no trip was given; a run has one or more.")
    if len({(trip.rate, len(trip.response)) for trip in trips}) > 1:
        raise InputError("the trips have different rates or accelerometers; a run has one set of channels.")
    for i, trip in enumerate(trips):
        _check_lengths(trip, i + 1)
    if any(not 0 <= mark.trip < len(trips) for mark in marks):
        raise InputError(f"a mark names a trip that is not among the {len(trips)}.")
    if response == "nut" and not all(len(trip.response) for trip in trips):
        raise InputError("the response is 'nut', but no accelerometer at the nut was measured.")


def _check_lengths(trip: TripSignals, number: int) -> None:
    lengths = {len(trip.force), len(trip.position)}
    if len(trip.response):
        lengths.add(trip.response.shape[-1])
    if len(lengths) > 1:
        raise InputError(f"trip {number} has channels of different lengths.")


def _finite(trip: TripSignals) -> bool:
    return all(bool(np.all(np.isfinite(x))) for x in (trip.force, trip.position, trip.response))
