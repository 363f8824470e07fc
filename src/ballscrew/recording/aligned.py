"""Brings what an analysis needs of a recording to one rate: input, position, responses."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from ballscrew.base.errors import InputError
from ballscrew.recording.recording import Recording

__all__ = ["AXIAL", "INPUTS", "SI_UNIT", "Aligned", "align"]

INPUTS = ("torque", "force", "current")  # in the order of preference
SI_UNIT = {"torque": "N m", "force": "N", "current": "A"}
AXIAL = ("x", "")  # directions along the screw


@dataclass(frozen=True, slots=True)
class Aligned:
    """Input, position and axial accelerations of a recording, at one rate.

    Parameters
    ----------
    rate : float
        Samples per second, Hz: the lowest of the channels'.
    input : ndarray, shape (n,)
        Torque (N m), force (N) or current (A).
    quantity : str
        Which of these it is.
    position : ndarray, shape (n,)
        m.
    response : ndarray, shape (n_responses, n)
        Accelerations, m/s².
    responses : tuple of str
        Their names in the recording.
    """

    rate: float
    input: NDArray[np.float64]
    quantity: str
    position: NDArray[np.float64]
    response: NDArray[np.float64]
    responses: tuple[str, ...]


def align(recording: Recording) -> Aligned:
    """Pick the channels that an analysis needs, and bring them to one rate.

    Accelerometers at the nut are taken before the motor's own acceleration, as the paper does.

    Parameters
    ----------
    recording : Recording
        As read.

    Returns
    -------
    Aligned
        At the lowest rate of the channels picked; a higher one is filtered down by a zero-phase filter.

    Raises
    ------
    InputError
        If there is no torque, force or current, no position, or no acceleration along the screw.
    """
    file = recording.file.name
    drive = next((name for q in INPUTS for name in recording.of(q)), None)
    if drive is None:
        raise InputError(f"{file}: no channel is a torque, force or current; the channel map must name one.")
    places = recording.of("position")
    if not places:
        raise InputError(f"{file}: no channel is a position; the channel map must name one.")
    axial = [n for d in AXIAL for n in recording.of("acceleration", direction=d)]
    names = [n for n in axial if recording.channels[n].attrs["location"] != "motor"] or axial
    if not names:
        raise InputError(
            f'{file}: no channel is an acceleration along the screw (axis = "x"); the channel map must name '
            'one, or derive it from the position with derive = "second-derivative".'
        )
    wanted = [drive, places[0], *names]
    rate = min(recording.rate(name) for name in wanted)
    arrays = [_at_rate(recording.array(name), recording.rate(name), rate) for name in wanted]
    size = min(len(array) for array in arrays)
    force, position, *responses = (array[:size] for array in arrays)
    quantity = str(recording.channels[drive].attrs["quantity"])
    return Aligned(rate, force, quantity, position, np.stack(responses), tuple(names))


def _at_rate(x: NDArray[np.float64], rate: float, wanted: float) -> NDArray[np.float64]:
    """Resample by a ratio of small whole numbers, without delay and without a step at the ends."""
    if abs(rate / wanted - 1) < 1e-9:
        return x
    from scipy.signal import resample_poly

    ratio = Fraction(wanted / rate).limit_denominator(1000)
    return np.asarray(resample_poly(x, ratio.numerator, ratio.denominator, padtype="line"), dtype=np.float64)
