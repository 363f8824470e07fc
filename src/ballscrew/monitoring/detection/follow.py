"""One visit later, in all histories at once; compiled."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ballscrew.monitoring.detection.density import FAST

__all__ = ["apart", "met", "teach", "weigh"]

Single = NDArray[np.float32]


@njit(cache=True, fastmath=set(FAST), error_model="numpy")
def apart(level: Single, lost: Single, row: Single, middle: Single, off: Single) -> None:
    """Tell how far a visit stands off what is expected.

    Parameters
    ----------
    level : ndarray of float32, shape (m,)
        Of m histories.
    lost : ndarray of float32, shape (r,)
        What r rates of wear have taken by then.
    row : ndarray of float32, shape (p,)
        What each coefficient does to the level.
    middle : ndarray of float32, shape (p, r, m)
        The coefficients as they are believed.
    off : ndarray of float32, shape (r, m)
        Filled.
    """
    for r in range(off.shape[0]):
        for j in range(off.shape[1]):
            off[r, j] = level[j] - lost[r]
        for p in range(len(row)):
            for j in range(off.shape[1]):
                off[r, j] -= row[p] * middle[p, r, j]


@njit(cache=True, fastmath=set(FAST), error_model="numpy")
def met(off: Single, other: Single, most: np.float32) -> None:
    """Put in the place of a visit the mean of its two runs where they agree, else the lower.

    Parameters
    ----------
    off, other : ndarray of float32, shape (r, m)
        How far each is off; the first is filled.
    most : float32
        By how much two that agree differ at most.
    """
    half = np.float32(0.5)
    for r in range(off.shape[0]):
        for j in range(off.shape[1]):
            low, between = min(off[r, j], other[r, j]), abs(other[r, j] - off[r, j])
            off[r, j] = low + half * between * np.float32(between <= most)


@njit(cache=True, fastmath=set(FAST), error_model="numpy")
def teach(off: Single, gain: Single, most: np.float32, middle: Single, taught: Single) -> None:
    """Tell what a visit teaches; far ones teach no more than less far ones.

    Parameters
    ----------
    off : ndarray of float32, shape (r, m)
        How far it is off.
    gain : ndarray of float32, shape (p,)
        What each coefficient is taught by one that is off.
    most : float32
        By how far one may be off and teach in full.
    middle, taught : ndarray of float32, shape (p, r, m)
        The coefficients as they were believed; filled: as they are now.
    """
    for p in range(len(gain)):
        for r in range(off.shape[0]):
            for j in range(off.shape[1]):
                taught[p, r, j] = middle[p, r, j] + gain[p] * min(max(off[r, j], -most), most)


@njit(cache=True, fastmath=set(FAST), error_model="numpy")
def weigh(
    density: Single,
    sound: Single,
    repeated: bool,
    caps: Single,
    weight: np.float32,
    ratio: Single,
    largest: Single,
    later: Single,
    peak: Single,
    summed: NDArray[np.float64],
) -> None:
    """Take the likelihood ratio of wear against none on by a visit, and add its mean over the rates.

    Parameters
    ----------
    density : ndarray of float32, shape (r, m)
        Of the visit, worn at r rates.
    sound : ndarray of float32, shape (m,)
        Of the visit, healthy.
    repeated : bool
        Whether it has a repeat.
    caps : ndarray of float32, shape (3,)
        What one run may count at most, what a repeat may count more, and the largest ratio.
    weight : float32
        Of this onset.
    ratio, largest : ndarray of float32, shape (r, m)
        The ratio so far and the largest of one run.
    later, peak : ndarray of float32, shape (r, m)
        Filled: the same by then.
    summed : ndarray, shape (m,)
        Added to.
    """
    one, two, most = caps
    share = weight / np.float32(density.shape[0])
    for r in range(density.shape[0]):
        for j in range(density.shape[1]):
            now = density[r, j] / sound[j]
            later[r, j] = min(ratio[r, j] * now, most)
            peak[r, j] = max(largest[r, j], now / two if repeated else now)
            summed[j] += share * later[r, j] / max(peak[r, j] / one, np.float32(1.0))
