"""Joint estimator: the axial mode in every cell, from the signals of a run."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ballscrew.axis.sheet import DataSheet
from ballscrew.base.errors import InputError
from ballscrew.fcft.trace import SAMPLES_PER_PERIOD
from ballscrew.modal.cell import TransientRow
from ballscrew.modal.joint.initial import (
    FREQUENCY_SCALES,
    InitialValues,
    inertia_and_viscous_friction,
    initial_values,
    typical_form_curve,
)
from ballscrew.modal.joint.result import JointResult
from ballscrew.modal.joint.search import SearchResult, search
from ballscrew.modal.joint.settings import RESPONSES, JointSettings, Response
from ballscrew.modal.joint.signals import TripSignals, decimate, position_range
from ballscrew.modal.joint.verdicts import joint_result, refused_run
from ballscrew.modal.reason import Reason

_LEAST_CELLS = 3  # least number of cells: the compliance along the axis has two or three parameters

# Without a data sheet.
_SEARCHES = 4  # largest number of searches, each around the frequency that the previous one found
# Initial values of a search.
_ROTOR_HELD_RATIO = 0.8  # rotor-held over rotor-free frequency, as for a rotor of 1.8 times the moving mass
_FAR_ABOVE = 1.5  # frequency over that by the data sheet from which on the sheet is in doubt, not the rate
_SLOPE = 1.0  # 1/m, relative slope of the compliance along the axis


def identify_jointly(
    trips: Sequence[TripSignals],
    transients: Sequence[TransientRow],
    sheet: DataSheet | None = None,
    load: float = 0.0,
    settings: JointSettings | None = None,
    response: Response = "both",
) -> JointResult:
    """Identify the axial mode in all cells of a run by one model.

    The compliance along the axis is one curve, so that the data of every cell contribute to all others. The
    table's acceleration is modelled twice: as the response to the motor's torque, with the mode of the free
    rotor, and as the response to the motor's own motion, with the mode of the held rotor. The motor's
    acceleration is modelled as the response to the torque, with the mode of the free rotor.

    Parameters
    ----------
    trips : sequence of TripSignals
        Signals of the run's recordings.
    transients : sequence of TransientRow
        Complete transients; the file of each is the index of its trip.
    sheet : DataSheet, optional
        Gives initial values, the lead, and the expected load on the nut with its uncertainty; without it
        neither the ripple of the motor nor the softening of the nut is fitted.
    load : float
        Load on the table, kg.
    settings : JointSettings, optional
        Settings of the method.
    response : {"nut", "motor", "both"}
        Fitted response: the nut's accelerometers, the motor's encoder, or both if both were measured.

    Returns
    -------
    JointResult
        Every cell of the transients, with a frequency and its uncertainty, or refused with a reason.

    Raises
    ------
    InputError
        If trips and transients do not belong together, or if the response was not measured.
    """
    settings = settings or JointSettings()
    _check(trips, transients, response)
    if not transients:
        return JointResult((), (Reason("measurement", "no acceleration phase was found"),))
    for number, trip in enumerate(trips, start=1):
        if not all(np.isfinite(channel).all() for channel in trip.channels):
            text = f"trip {number} has samples that are no numbers"
            return refused_run(transients, Reason("measurement", text))
    low, high = position_range(trips)
    rigid_body = inertia_and_viscous_friction(trips)
    if rigid_body is None or not high > low:
        return refused_run(transients, Reason("measurement", "the axis does not move"))
    inertia, viscous = rigid_body
    # Power spectral density of the rounding error of the force, over the total inertia, (m/s²)²/Hz.
    rounding = max(trip.rounding for trip in trips) / inertia**2
    form_curve = typical_form_curve(low, high)
    if sheet is not None:
        initial = initial_values(sheet, load, low, high, viscous)
    else:
        frequency = math.sqrt(settings.lowest * settings.highest)
        highest_sampled = trips[0].rate / _least_samples_per_period(settings)
        frequency = max(min(frequency, highest_sampled), settings.lowest)
        initial = _initial_values_around(frequency, form_curve)
    for _ in range(_SEARCHES):
        found = _search_around(trips, transients, inertia, initial, settings, response)
        if isinstance(found, Reason):
            return refused_run(transients, found)
        frequency = found.fit.modes[0].middle_frequency
        refusal = _frequency_refusal(trips[0].rate, frequency, initial, settings)
        if refusal is not None:
            return refused_run(transients, refusal)
        # A mode at the edge of the frequencies tried may not be the best one: the band may exclude a better
        # one.
        within_range = FREQUENCY_SCALES[0] < frequency / initial.rotor_free < FREQUENCY_SCALES[-1]
        if sheet is not None or within_range:
            return joint_result(found, transients, settings, rounding)
        initial = _initial_values_around(frequency, form_curve)
    return refused_run(transients, _no_mode(settings))


def _no_mode(settings: JointSettings) -> Reason:
    """Reason to refuse a run without a data sheet in which no mode was found."""
    text = f"no mode was found near {settings.lowest:g} to {settings.highest:g} Hz"
    return Reason("no-mode", text)


def _frequency_refusal(
    rate: float, frequency: float, initial: InitialValues, settings: JointSettings
) -> Reason | None:
    """Reason to refuse a mode whose frequency (Hz) is too high for the sampling rate (Hz); None if it is not.

    Recordings are decimated for the frequency that a data sheet predicts, or without one for modes up to
    ``settings.highest``. Far above it, a higher rate of the recording would not change the rate after
    decimation.
    """
    refusal = rate_refusal(rate, frequency, settings)
    if refusal is None:
        return None
    if initial.sheet is None and frequency > settings.highest:
        return _no_mode(settings)
    if initial.sheet is not None and frequency > _FAR_ABOVE * initial.rotor_free:
        text = (
            f"the mode is near {frequency:.0f} Hz, far above the {initial.rotor_free:.0f} Hz that the data "
            "sheet predicts: check the data sheet"
        )
        return Reason("low-rate", text)
    return refusal


def _search_around(
    trips: Sequence[TripSignals],
    transients: Sequence[TransientRow],
    inertia: float,
    initial: InitialValues,
    settings: JointSettings,
    response: Response,
) -> SearchResult | Reason:
    """Decimate the trips, search for the modes around initial values and fit them.

    ``inertia`` is the total inertia, in units of the recorded force per m/s². Returns the reason if it fails.
    """
    reduced = [decimate(trip, settings.rate * initial.rotor_free) for trip in trips]
    refusal = rate_refusal(reduced[0].rate, initial.rotor_free, settings)
    if refusal is not None:
        return refusal
    found = search(reduced, transients, inertia, initial, _block_names(trips, response), settings)
    if found is None or len(found.fit.blocks[0].windows.cells) < _LEAST_CELLS:
        return Reason("measurement", "too few transients of one kind to average")
    return found


def rate_refusal(rate: float, frequency: float, settings: JointSettings) -> Reason | None:
    """Reason to refuse a sampling rate (Hz) that is too low for a frequency (Hz); None if it suffices."""
    least = _least_samples_per_period(settings) * frequency
    if rate >= least:
        return None
    text = (
        f"{rate:.0f} samples per second are too few for a mode near {frequency:.0f} Hz: "
        f"record at {least:.0f} Hz or more"
    )
    return Reason("low-rate", text)


def _least_samples_per_period(settings: JointSettings) -> float:
    """Least number of samples per period of the mode; smaller where the settings decimate to less."""
    return min(SAMPLES_PER_PERIOD, settings.rate)


def _initial_values_around(frequency: float, form_curve: float) -> InitialValues:
    """Initial values without a data sheet, for a rotor-free frequency (Hz) and an expected curve (1/m²)."""
    return InitialValues(
        rotor_free=frequency,
        rotor_held=_ROTOR_HELD_RATIO * frequency,
        slope=_SLOPE,
        form_curves=(form_curve, form_curve),
    )


def _block_names(trips: Sequence[TripSignals], response: Response) -> tuple[str, ...]:
    """Names of the blocks to fit; those with the response of the nut, if it was measured, come first."""
    names: tuple[str, ...] = ()
    if response != "motor" and len(trips[0].response):
        names = ("torque-nut", "motor-nut")
    if response != "nut":
        names = (*names, "torque-motor")
    return names


def _check(trips: Sequence[TripSignals], transients: Sequence[TransientRow], response: str) -> None:
    """Raise an InputError for trips and transients that do not belong together."""
    if response not in RESPONSES:
        raise InputError(f"the response is {response!r}; it must be one of {', '.join(RESPONSES)}.")
    if not trips:
        raise InputError("no trip was given; a run has one or more.")
    if len({(trip.rate, len(trip.response)) for trip in trips}) > 1:
        raise InputError("the trips have different rates or accelerometers; a run has one set of channels.")
    for number, trip in enumerate(trips, start=1):
        if len({len(channel) for channel in trip.channels}) > 1:
            raise InputError(f"trip {number} has channels of different lengths.")
    if any(not 0 <= transient.file < len(trips) for transient in transients):
        raise InputError(f"a transient belongs to a trip that is not among the {len(trips)}.")
    if response == "nut" and not len(trips[0].response):
        raise InputError("the response is 'nut', but no accelerometer at the nut was measured.")
