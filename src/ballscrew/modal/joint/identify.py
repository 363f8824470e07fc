"""The joint estimator: from a run's signals to the axial mode in every cell."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ballscrew.axis.sheet import DataSheet
from ballscrew.base.errors import InputError
from ballscrew.modal.joint.guess import Guess, guess, least_load, whole_mass
from ballscrew.modal.joint.result import JointResult
from ballscrew.modal.joint.search import search
from ballscrew.modal.joint.settings import RESPONSES, JointSettings, Response
from ballscrew.modal.joint.shape import frequency
from ballscrew.modal.joint.signals import Mark, TripSignals, thinned
from ballscrew.modal.joint.start import SCALES
from ballscrew.modal.joint.told import refused, told

__all__ = ["identify_jointly"]

_LEAST_CELLS = 3
_STARTS = 4  # where no data sheet says where to look


def identify_jointly(
    trips: Sequence[TripSignals],
    marks: Sequence[Mark],
    sheet: DataSheet | None = None,
    load: float = 0.0,
    settings: JointSettings | None = None,
    response: Response = "both",
) -> JointResult:
    """Identify all cells of a run as one.

    The compliance along the axis is one line, so that every cell tells of all others. The table's
    acceleration is explained twice: from the motor's torque, whose mode is the one with the rotor free, and
    from the motor's own motion, whose mode is the one with the rotor held.

    Parameters
    ----------
    trips : sequence of TripSignals
        The run, one a recording.
    marks : sequence of Mark
        Where the acceleration phases lie.
    sheet : DataSheet, optional
        Says where to look first; it does not decide.
    load : float
        On the table, kg.
    settings : JointSettings, optional
        Settings.
    response : {"nut", "motor", "both"}
        What answers: the nut's accelerometers, the motor's encoder, or what there is.

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
    bad = next((i for i, t in enumerate(trips) if not _finite(t)), None)
    if bad is not None:
        return refused(marks, f"trip {bad + 1} has samples that are no numbers")
    low = min(float(t.position.min()) for t in trips)
    high = max(float(t.position.max()) for t in trips)
    mass = whole_mass(trips)
    if mass is None or not high > low:
        return refused(marks, "the axis does not move")
    guessed = guess(sheet, load, low, high) if sheet else Guess(*_looked(settings), 1.0)
    nut = response != "motor" and all(len(t.response) for t in trips)
    names = (*(("torque-nut", "motor-nut") if nut else ()), *(("torque-motor",) if response != "nut" else ()))
    curved = sheet is not None and sheet.support == "fixed-fixed"
    for _ in range(1 if sheet else _STARTS):
        thin = [thinned(t, settings.rate * guessed.free) for t in trips]
        if thin[0].rate < 5 * guessed.free:
            return refused(
                marks,
                f"{thin[0].rate:.0f} samples per second are too few for a mode near {guessed.free:.0f} Hz",
            )
        found = search(thin, marks, mass, guessed, names, settings, curved)
        if found is None or len(found.fit.blocks[0].windows.cells) < _LEAST_CELLS:
            return refused(marks, "too few transients of one kind to average")
        centre = float(frequency(found.fit.shapes[0], np.zeros(1))[0])
        if sheet or SCALES[0] < centre / guessed.free < SCALES[-1]:
            break
        # Far from where the starts were: without a sheet the band may have hidden a better one.
        guessed = Guess(centre, 0.8 * centre, 1.0)
    else:
        return refused(marks, f"no mode was found near {settings.lowest:g} to {settings.highest:g} Hz")
    assert found is not None  # noqa: S101  the loop ran
    at = found.fit.blocks[0].windows.middle
    least = least_load(sheet, load, at, centre) if sheet else 0.0
    return told(found, marks, settings, response, least)


def _looked(settings: JointSettings) -> tuple[float, float]:
    middle = math.sqrt(settings.lowest * settings.highest)
    return middle, 0.8 * middle


def _check(trips: Sequence[TripSignals], marks: Sequence[Mark], response: str) -> None:
    if response not in RESPONSES:
        raise InputError(f"the response is {response!r}; it must be one of {', '.join(RESPONSES)}.")
    if not trips:
        raise InputError("no trip was given; a run has one or more.")
    if len({(t.rate, len(t.response)) for t in trips}) > 1:
        raise InputError("the trips have different rates or accelerometers; a run has one set of channels.")
    for i, t in enumerate(trips):
        if len({len(t.force), len(t.position), t.response.shape[-1]} - {0}) > 1:
            raise InputError(f"trip {i + 1} has channels of different lengths.")
    if any(not 0 <= m.trip < len(trips) for m in marks):
        raise InputError(f"a mark names a trip that is not among the {len(trips)}.")
    if response == "nut" and not all(len(t.response) for t in trips):
        raise InputError("the response is 'nut', but no accelerometer at the nut was measured.")


def _finite(trip: TripSignals) -> bool:
    return all(bool(np.all(np.isfinite(x))) for x in (trip.force, trip.position, trip.response))
