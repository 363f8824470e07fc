"""Whether the torque is in step with the two masses that it moves, in full motion, where friction is even.

Below the mode a torque follows the encoder's acceleration alone, but near standstill friction bends it, and
by how much depends on the servo: a delay that is read there is off by up to half a millisecond. In full
motion only dry friction, which is one number from stop to stop, and viscous friction are left; and with the
table's own acceleration beside the rotor's, the mode needs no model.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_erosion, gaussian_filter1d

from ballscrew.base.arrays import Array
from ballscrew.recording.quality.lowband import Fit, LowBand

__all__ = ["TwoMasses", "two_masses"]


_SMOOTHING = 5e-3  # s: a jerk of 10 ms still shows, ripple and noise above 50 Hz go
_LEAST_SMOOTHING = 2.0  # samples
_FAST = 0.3  # of the cruising speed
_GUARD = 2.0  # standard deviations of the smoothing, over which standstill reaches into the motion
_LEAST_SPAN = 10  # samples
_FEWEST = 3  # spans from stop to stop
_PASSES = 8
_LONGEST = 0.06  # s
_GROUPS = 20  # parts left out in turn to see the scatter


@dataclass(frozen=True, slots=True)
class TwoMasses:
    """The torque as rotor and table, each with its own acceleration.

    Parameters
    ----------
    fit : Fit
        Of the torque; its gain is that of both masses together.
    torque, model : ndarray, shape (n,)
        Smoothed torque, and what the fit makes of the motion.
    spans : tuple of ndarray of int
        Samples in full motion, from each stop to the next.
    rate : float
        Of these, Hz.
    """

    fit: Fit
    torque: Array
    model: Array
    spans: tuple[NDArray[np.intp], ...]
    rate: float


def two_masses(band: LowBand, responses: Sequence[tuple[int, Fit]]) -> TwoMasses | None:
    """Fit a torque with the accelerations of rotor and table, viscous friction and the delay.

    Parameters
    ----------
    band : LowBand
        One recording.
    responses : sequence of (int, Fit)
        Accelerometers that follow the encoder: which, and how.

    Returns
    -------
    TwoMasses or None
        None where there is no accelerometer or too little full motion.
    """
    sigma = max(_SMOOTHING * band.rate, _LEAST_SMOOTHING)
    at = np.arange(len(band.place), dtype=np.float64)

    def smooth(x: Array) -> Array:
        return np.asarray(gaussian_filter1d(x, sigma))

    speed = band.derivative(smooth(band.place))
    spans = _spans(speed, _FAST * band.cruise, sigma)
    if not responses or len(spans) < _FEWEST:
        return None
    rotor = band.derivative(speed)
    tables = [
        np.interp(at + fit.late * band.rate, at, band.raw_response[index]) / fit.gain
        for index, fit in responses
    ]
    table = smooth(np.mean(tables, axis=0))
    torque = smooth(band.raw_drive)
    whole = np.stack([rotor, table - rotor, band.derivative(rotor), speed])
    rows = np.concatenate(spans)
    number = np.repeat(np.arange(len(spans)), [len(span) for span in spans])
    columns = _levelled(whole[:, rows], number)
    scale = columns.std(axis=1)
    if len(rows) < 5 * len(columns) or not np.isfinite(scale).all() or scale.min() <= 0:
        return None
    columns /= scale[:, None]
    late, answer = 0.0, np.zeros(len(columns))
    for _ in range(_PASSES):
        wanted = _levelled(np.interp(rows + late * band.rate, at, torque)[None], number)[0]
        answer = np.linalg.lstsq(columns.T, wanted, rcond=1e-10)[0]
        if answer[0] == 0:
            return None
        change = -float(answer[2] / answer[0] * scale[0] / scale[2])
        late = float(np.clip(late + change, -_LONGEST, _LONGEST))
        if not abs(change) > 1e-7:
            break
    total = float(np.sum(wanted**2))
    left = float(np.sum((wanted - answer @ columns) ** 2)) / total if total > 0 else 1.0
    group = number * min(_GROUPS, len(spans)) // len(spans)
    apart = [_left(columns, scale, wanted, group != one) for one in range(int(group.max()) + 1)]
    spread = np.sqrt((len(apart) - 1) * np.var(apart))
    if not np.isfinite([late, spread]).all():
        return None
    fit = Fit(float(answer[0] / scale[0]), late, float(spread), 1.0 - left)
    model = (answer / scale)[[0, 1, 3]] @ whole[[0, 1, 3]]
    return TwoMasses(fit, torque, model, tuple(spans), band.rate)


def _spans(speed: Array, least: float, sigma: float) -> list[NDArray[np.intp]]:
    fast = binary_erosion(np.abs(speed) > least, iterations=max(1, round(_GUARD * sigma)))
    edge = round(4 * sigma)
    fast[:edge] = fast[-edge:] = False
    bounds = np.flatnonzero(np.diff(np.concatenate([[0], fast.astype(np.int8), [0]])))
    return [np.arange(a, b) for a, b in zip(bounds[::2], bounds[1::2], strict=True) if b - a >= _LEAST_SPAN]


def _levelled(x: Array, number: NDArray[np.intp]) -> Array:
    """Signals less their mean over each span: dry friction goes, whatever it is there."""
    count = np.bincount(number)
    return np.stack([row - (np.bincount(number, row) / count)[number] for row in x])


def _left(columns: Array, scale: Array, wanted: Array, used: NDArray[np.bool_]) -> float:
    """Delay that is left in some of the samples, s."""
    answer = np.linalg.lstsq(columns[:, used].T, wanted[used], rcond=1e-10)[0]
    return -float(answer[2] / answer[0] * scale[0] / scale[2]) if answer[0] != 0 else 0.0
