"""What others watch: vibration RMS, kurtosis, friction, torque RMS, the peak of the response alone.

They are here to be compared with, by the limits that are usual for them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError
from ballscrew.modal.run import Run

__all__ = ["kurtosis", "of_run", "response_peak", "rms", "three_sigma"]


def rms(signal: ArrayLike) -> float:
    """Root mean square about the mean: of an acceleration or a torque.

    Parameters
    ----------
    signal : array_like, shape (n,)
        Two samples or more.

    Returns
    -------
    float
        In the signal's unit.

    Raises
    ------
    InputError
        If it is too short, or a sample is not finite.
    """
    return float(np.std(_checked(signal)))


def kurtosis(signal: ArrayLike) -> float:
    """Fourth moment over the squared variance: 3 for Gaussian noise, more for knocks.

    Parameters
    ----------
    signal : array_like, shape (n,)
        Two samples or more.

    Returns
    -------
    float
        nan of a signal that does not change.

    Raises
    ------
    InputError
        If it is too short, or a sample is not finite.
    """
    away = _checked(signal)
    away = away - away.mean()
    square = float(np.mean(away**2))
    return float(np.mean(away**4)) / square**2 if square > 0 else math.nan


def response_peak(signal: ArrayLike, rate: float, band: tuple[float, float]) -> float:
    """Frequency at which the response alone is largest: it moves with the servo's gains, a pole does not.

    Parameters
    ----------
    signal : array_like, shape (n,)
        Acceleration, zero padded here to four times its length.
    rate : float
        Samples a second.
    band : tuple of float
        Where it is sought, Hz.

    Returns
    -------
    float
        Hz, by a parabola through the three largest lines.

    Raises
    ------
    InputError
        If no line lies in the band, or a number cannot be.
    """
    samples = _checked(signal)
    if not (math.isfinite(rate) and rate > 0):
        raise InputError(f"a rate of {rate:g} was given; it must be more than 0 samples a second.")
    lines = np.fft.rfftfreq(4 * len(samples), 1 / rate)
    inside = np.flatnonzero((lines >= band[0]) & (lines <= band[1]))
    inside = inside[(inside > 0) & (inside < len(lines) - 1)]
    if not len(inside):
        raise InputError(
            f"no line of the spectrum lies between {band[0]:g} and {band[1]:g} Hz; the band must lie below "
            "half of the rate and be wider than a line."
        )
    size = np.abs(np.fft.rfft(samples - samples.mean(), 4 * len(samples)))
    top = int(inside[np.argmax(size[inside])])
    left, middle, right = size[top - 1 : top + 2]
    bend = left - 2 * middle + right
    return float(lines[top] + (0.5 * (left - right) / bend if bend < 0 else 0.0) * lines[1])


def of_run(run: Run) -> Mapping[str, float]:
    """What a run tells of them: friction, and the mean of its frequencies.

    Parameters
    ----------
    run : Run
        Analysed.

    Returns
    -------
    mapping of str to float
        What is known, in SI.
    """
    told = [c.frequency_Hz for c in run.cells if c.verdict != "refused" and c.frequency_Hz is not None]
    rigid = run.rigid_body
    found = {
        "coulomb_N": rigid.coulomb_N,
        "viscous_N_s_per_m": rigid.viscous_N_s_per_m,
        "frf_equivalent_mass_kg": rigid.frf_equivalent_mass_kg,
        "mean_frequency_Hz": float(np.mean(told)) if told else None,
    }
    return {name: float(value) for name, value in found.items() if value is not None}


def three_sigma(values: ArrayLike, baseline: int, sign: int = 1, times: int = 2) -> int | None:
    """The usual limit: mean and three standard deviations of the first runs, so many times in a row.

    Parameters
    ----------
    values : array_like, shape (n,)
        Of a feature, in time order; nan where it is missing.
    baseline : int
        How many of the first runs make the limit; 2 or more.
    sign : int
        1 where wear makes it grow, -1 where it makes it fall.
    times : int
        In a row.

    Returns
    -------
    int or None
        The run that alarms.

    Raises
    ------
    InputError
        If the baseline is too short.
    """
    if baseline < 2 or times < 1:
        raise InputError(f"a baseline of {baseline} runs was given; it must be of 2 or more.")
    told = sign * np.asarray(values, dtype=float)
    limit = np.nanmean(told[:baseline]) + 3 * np.nanstd(told[:baseline], ddof=1)
    row = 0
    for k in range(baseline, len(told)):
        row = row + 1 if told[k] > limit else 0
        if row == times:
            return k
    return None


def _checked(signal: ArrayLike) -> Array:
    samples = np.asarray(signal, dtype=float).ravel()
    if len(samples) < 2 or not np.isfinite(samples).all():
        raise InputError(f"a signal of {len(samples)} samples was given; it must be two or more, all finite.")
    return samples
