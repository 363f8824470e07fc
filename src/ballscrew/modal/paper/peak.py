"""The first axial peak of an FRF's magnitude inside a band."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

_PROMINENCE = 0.4  # of its height that a peak must stand above the saddles beside it: ripple does not
_RIVAL = 0.8  # of the highest peak, from which on a lower-frequency peak is the first one


@dataclass(frozen=True, slots=True)
class Peak:
    """A peak.

    Parameters
    ----------
    frequency : float
        Hz, refined by a parabola through the logarithms of three points.
    height : float
        Magnitude there.
    at_edge : bool
        Whether the magnitude at one of the band's edges is larger still.
    """

    frequency: float
    height: float
    at_edge: bool


def first_peak(
    frequency: NDArray[np.float64], magnitude: NDArray[np.float64], band: tuple[float, float] | None = None
) -> Peak | None:
    """Find the first peak: the lowest in frequency of those nearly as high as the highest.

    Parameters
    ----------
    frequency : ndarray, shape (n,)
        Evenly spaced, Hz; may reach beyond the band, so that a peak near its edge is seen whole.
    magnitude : ndarray, shape (n,)
        Of the FRF.
    band : tuple of float, optional
        Where the peak must lie, Hz; by default anywhere.

    Returns
    -------
    Peak or None
        None where the magnitude has no peak inside the band, or is not finite.
    """
    from scipy.signal import find_peaks

    if len(magnitude) < 5 or not np.all(np.isfinite(magnitude)) or magnitude.max() <= 0:
        return None
    peaks, found = find_peaks(magnitude, prominence=0.0)
    low, high = np.searchsorted(frequency, band) if band else (0, len(frequency))
    inside = (peaks >= low) & (peaks < high)
    peaks = peaks[inside & (found["prominences"] >= _PROMINENCE * magnitude[peaks])]
    if len(peaks) == 0:
        return None
    first = int(peaks[magnitude[peaks] >= _RIVAL * magnitude[peaks].max()][0])
    edge = max(magnitude[low], magnitude[high - 1]) > magnitude[first]
    return Peak(_refined(frequency, magnitude, first), float(magnitude[first]), bool(edge))


def highest_point(
    frequency: NDArray[np.float64], magnitude: NDArray[np.float64], near: float, reach: float
) -> NDArray[np.float64]:
    """Frequency of the highest point near a known peak, for many curves at once.

    Parameters
    ----------
    frequency : ndarray, shape (n,)
        Hz.
    magnitude : ndarray, shape (..., n)
        Curves.
    near, reach : float
        Where to look: ``near`` ± ``reach``, Hz.

    Returns
    -------
    ndarray, shape (...)
        Hz.
    """
    inside = np.flatnonzero(np.abs(frequency - near) <= reach)
    inside = inside[(inside > 0) & (inside < len(frequency) - 1)]
    if len(inside) == 0:
        return np.full(magnitude.shape[:-1], near)
    top = inside[0] + np.argmax(magnitude[..., inside], axis=-1)
    flat = magnitude.reshape(-1, len(frequency))
    refined = [_refined(frequency, curve, int(i)) for curve, i in zip(flat, np.ravel(top), strict=True)]
    return np.array(refined).reshape(magnitude.shape[:-1])


def _refined(frequency: NDArray[np.float64], magnitude: NDArray[np.float64], top: int) -> float:
    """Vertex (Hz) of the parabola through the logarithms of three points around line ``top``."""
    before, top_value, after = np.log(np.maximum(magnitude[top - 1 : top + 2], np.finfo(float).tiny))
    curvature = before - 2 * top_value + after
    shift = float(np.clip(0.5 * (before - after) / curvature, -0.5, 0.5)) if curvature < 0 else 0.0
    return float(frequency[top] + shift * (frequency[1] - frequency[0]))
