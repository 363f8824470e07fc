"""Channels of a recording that an analysis needs, at one rate: input, position, responses."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from itertools import chain

import numpy as np

from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError
from ballscrew.recording.quantities import INPUTS
from ballscrew.recording.recording import Recording

AXIAL = ("x", "")  # directions along the screw


@dataclass(frozen=True, slots=True)
class Aligned:
    """Input, position and axial accelerations of a recording, at one rate.

    Parameters
    ----------
    rate : float
        Sample rate, Hz: the lowest of the channels.
    input : ndarray, shape (n,)
        Torque (N m), force (N) or current (A).
    quantity : str
        Quantity of the input: torque, force or current.
    position : ndarray, shape (n,)
        m.
    response : ndarray, shape (n_responses, n)
        Accelerations, m/s².
    responses : tuple of str
        Names of the responses in the recording.
    """

    rate: float
    input: Array
    quantity: str
    position: Array
    response: Array
    responses: tuple[str, ...]


def align(recording: Recording) -> Aligned:
    """Choose the channels that an analysis needs, and resample them to one rate.

    Accelerometers at the nut are preferred to the motor's own acceleration, as in the paper.

    Parameters
    ----------
    recording : Recording
        Recording as read.

    Returns
    -------
    Aligned
        At the lowest rate of the chosen channels; the others are resampled with a zero-phase filter.

    Raises
    ------
    InputError
        If there is no torque, force or current, no position, or no acceleration along the screw.
    """
    file = recording.file.name
    inputs = list(chain.from_iterable(map(recording.of, INPUTS)))
    if not inputs:
        raise InputError(f"{file}: no channel is a torque, force or current; the channel map must name one.")
    places = recording.of("position")
    if not places:
        raise InputError(f"{file}: no channel is a position; the channel map must name one.")
    drive, names = inputs[0], _responses(recording)
    if not names:
        raise InputError(
            f'{file}: no channel is an acceleration along the screw (axis = "x"); the channel map must name '
            'one, or derive it from the position with derive = "second-derivative".'
        )
    chosen = [drive, places[0], *names]
    rate = min(map(recording.rate, chosen))
    arrays = [_at_rate(recording.array(name), recording.rate(name), rate) for name in chosen]
    size = min(map(len, arrays))
    force, position, *responses = (array[:size] for array in arrays)
    quantity = str(recording.channels[drive].attrs["quantity"])
    return Aligned(rate, force, quantity, position, np.stack(responses), tuple(names))


def _responses(recording: Recording) -> list[str]:
    """Accelerations along the screw, without the motor's where there are others."""
    names: list[str] = []
    for direction in AXIAL:
        names += recording.of("acceleration", direction=direction)
    at_nut = [name for name in names if recording.channels[name].attrs["location"] != "motor"]
    return at_nut or names


def _at_rate(x: Array, rate: float, target: float) -> Array:
    """Resample by a ratio of small whole numbers, without delay and without a step at the ends."""
    if abs(rate / target - 1) < 1e-9:
        return x
    from scipy.signal import resample_poly

    ratio = Fraction(target / rate).limit_denominator(1000)
    return np.asarray(resample_poly(x, ratio.numerator, ratio.denominator, padtype="line"), dtype=np.float64)
