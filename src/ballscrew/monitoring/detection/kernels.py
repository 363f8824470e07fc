"""Compiled kernels of the odds: density of a run and of a run with its repeat, and the update by a visit.

A run is ordinary, an outlier, or, rarely, anything. All histories are computed at once.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ballscrew.base.arrays import Array
from ballscrew.base.compilation import compiled
from ballscrew.monitoring.detection.settings import MonitorSettings

Single = NDArray[np.float32]
# Fast arithmetic of finite numbers without reassociation: loops are vectorised, each element as if alone.
_FAST = {"nsz", "nnan", "ninf"}

_ANYTHING = 1e-5  # density of a run that may be anything, over the largest density of an ordinary run
_F = np.float32
_LOWEST = _F(-60.0)  # exp of less is negligible beside a run that may be anything
_PER_LN2, _HALF, _UNITY = _F(1.44269504), _F(0.5), _F(1.0)
_LN2_HIGH, _LN2_LOW = _F(0.693359375), _F(-2.12194440e-4)
_C0, _C1, _C2 = _F(1.9875691500e-4), _F(1.3981999507e-3), _F(8.3334519073e-3)
_C3, _C4, _C5 = _F(4.1665795894e-2), _F(1.6666665459e-1), _F(5.0000001201e-1)
_BIAS, _MANTISSA = np.int32(127), np.int32(23)


# Plain tuples: a class in a signature would be part of the stored code, and fail where it is renamed.
VisitUpdate = tuple[Single, Single, Single, Single]  # gain, bound of the innovation, both mixtures
OddsArrays = tuple[Single, Single, Single, Single]  # coefficients without and with wear, ratio, largest


@compiled(fastmath=_FAST)
def _exp(x: np.float32) -> np.float32:
    """Exponential of 0 or less, with a relative error of 1e-7.

    Power of two and a minimax polynomial, as in the Cephes library (Moshier, 1989): unlike the system's it
    can be vectorised.
    """
    x = max(x, _LOWEST)
    power = np.floor(x * _PER_LN2 + _HALF)
    r = x - power * _LN2_HIGH - power * _LN2_LOW
    rest = ((((_C0 * r + _C1) * r + _C2) * r + _C3) * r + _C4) * r + _C5
    two = np.int32((np.int32(power) + _BIAS) << _MANTISSA).view(np.float32)
    return np.float32((rest * r * r + r + _UNITY) * two)


def run_mixture(noise: Array, doubt: Array, settings: MonitorSettings) -> Single:
    """Mixture of an ordinary and an outlying run, for :func:`run_density`.

    Parameters
    ----------
    noise, doubt : ndarray
        Variance of an ordinary run, and of its expected level.
    settings : MonitorSettings
        Rate and size of outliers.

    Returns
    -------
    ndarray of float32, shape (..., 5)
        Exponent per squared error and largest density of an ordinary run, the same of an outlying run, and
        the least density.
    """
    usual, outlying = noise + doubt, settings.odd_size**2 * noise + doubt
    numbers = [
        -0.5 / usual,
        (1 - settings.odd) / np.sqrt(usual),
        -0.5 / outlying,
        settings.odd / np.sqrt(outlying),
        _ANYTHING / np.sqrt(usual),
    ]
    return np.stack(numbers, axis=-1).astype(np.float32)


@compiled(fastmath=_FAST)
def _run_density(error: np.float32, mixture: Single) -> np.float32:
    square = error * error
    ordinary = mixture[1] * _exp(square * mixture[0])
    outlying = mixture[3] * _exp(square * mixture[2])
    return np.float32(ordinary + outlying + mixture[4])


@compiled(fastmath=_FAST)
def run_density(error: Single, mixture: Single, density: Single) -> None:
    """Compute the density of runs, over 1/√2π.

    Parameters
    ----------
    error : ndarray of float32, shape (r, m)
        Observed minus expected level.
    mixture : ndarray of float32, shape (5,)
        As :func:`run_mixture` returns it.
    density : ndarray of float32, shape (r, m)
        Filled; more than 0.
    """
    for r in range(error.shape[0]):
        for j in range(error.shape[1]):
            density[r, j] = _run_density(error[r, j], mixture)


def pair_mixture(noise: Array, doubt: Array, settings: MonitorSettings) -> Single:
    """Mixture of a run and its repeat, for :func:`pair_density`.

    Parameters
    ----------
    noise, doubt, settings
        As for :func:`run_mixture`.

    Returns
    -------
    ndarray of float32, shape (..., kinds, 4)
        Largest density, and the coefficients in the exponent of the square of the first run, that of the
        repeat, and their product.
    """
    odd, stays, size = settings.odd, settings.odd_stays, settings.odd_size**2
    outlying = size * noise
    rows = []
    for weight, first, second, common in (
        ((1 - odd) ** 2, noise, noise, doubt),
        (odd * (1 - stays) * (1 - odd), outlying, noise, doubt),
        (odd * (1 - odd), noise, outlying, doubt),
        (odd * (1 - stays) * odd, outlying, outlying, doubt),
        (odd * stays, noise, noise, doubt + (size - 1) * noise),
    ):
        spread = first * second + common * (first + second)
        sizes = np.stack([second + common, first + common, -2 * common])
        rows.append(np.stack([weight / np.sqrt(spread), *(-0.5 / spread * sizes)], axis=-1))
    return np.stack(rows, axis=-2).astype(np.float32)


@compiled(fastmath=_FAST)
def pair_density(first: Single, repeat: Single, mixture: Single, both: Single, density: Single) -> None:
    """Compute the density of runs and their repeats, over 1/2π.

    Both share the error of the expected level, and sometimes the cause of an outlying first run.

    Parameters
    ----------
    first, repeat : ndarray of float32, shape (r, m)
        Observed minus expected level.
    mixture : ndarray of float32, shape (5,)
        As :func:`run_mixture` returns it.
    both : ndarray of float32, shape (kinds, 4)
        As :func:`pair_mixture` returns it.
    density : ndarray of float32, shape (r, m)
        Filled; more than 0.
    """
    for r in range(first.shape[0]):
        for j in range(first.shape[1]):
            anything = mixture[4]
            singles = _run_density(first[r, j], mixture) + _run_density(repeat[r, j], mixture)
            density[r, j] = anything * (singles - anything)
        for kind in range(both.shape[0]):
            for j in range(first.shape[1]):
                a, b = first[r, j], repeat[r, j]
                power = both[kind, 1] * a * a + both[kind, 2] * b * b + both[kind, 3] * a * b
                density[r, j] += both[kind, 0] * _exp(min(power, _F(0.0)))


@compiled(fastmath=_FAST)
def innovation(level: Single, wear: Single, row: Single, mean: Single, error: Single) -> None:
    """Compute the innovation of a visit: observed minus expected level.

    Parameters
    ----------
    level : ndarray of float32, shape (m,)
        Levels of m histories.
    wear : ndarray of float32, shape (r,)
        Loss by then at r rates of wear.
    row : ndarray of float32, shape (p,)
        Effect of each coefficient on the level.
    mean : ndarray of float32, shape (p, r, m) or (p, 1, m)
        Expected coefficients.
    error : ndarray of float32, shape (r, m)
        Filled.
    """
    for r in range(error.shape[0]):
        of_rate = min(r, mean.shape[1] - 1)
        for j in range(error.shape[1]):
            error[r, j] = level[j] - wear[r]
        for p in range(len(row)):
            for j in range(error.shape[1]):
                error[r, j] -= row[p] * mean[p, of_rate, j]


@compiled(fastmath=_FAST)
def mean_or_lower(error: Single, repeat: Single, most: np.float32) -> None:
    """Replace the innovation of a run by the mean with its repeat where both agree, else by the lower.

    Parameters
    ----------
    error, repeat : ndarray of float32, shape (r, m)
        Innovations; the first is overwritten.
    most : float32
        Largest difference of two that agree.
    """
    half = np.float32(0.5)
    for r in range(error.shape[0]):
        for j in range(error.shape[1]):
            low, difference = min(error[r, j], repeat[r, j]), abs(repeat[r, j] - error[r, j])
            error[r, j] = low + half * difference * np.float32(difference <= most)


@compiled(fastmath=_FAST)
def update_coefficients(error: Single, gain: Single, most: np.float32, mean: Single, updated: Single) -> None:
    """Update the expected coefficients by a visit, with its innovation bounded.

    Parameters
    ----------
    error : ndarray of float32, shape (r, m)
        Innovation.
    gain : ndarray of float32, shape (p,)
        Change of each coefficient per innovation.
    most : float32
        Bound of the innovation.
    mean : ndarray of float32, shape (p, r, m) or (p, 1, m)
        Expected coefficients before the visit.
    updated : ndarray of float32, shape (p, r, m)
        The same after it; filled.
    """
    for p in range(len(gain)):
        for r in range(error.shape[0]):
            of_rate = min(r, mean.shape[1] - 1)
            for j in range(error.shape[1]):
                updated[p, r, j] = mean[p, of_rate, j] + gain[p] * min(max(error[r, j], -most), most)


@compiled(fastmath=_FAST)
def accumulate_ratio(
    density: Single,
    healthy: Single,
    repeated: bool,
    caps: Single,
    weight: np.float32,
    ratio: Single,
    largest: Single,
    later: Single,
    peak: Single,
    summed: NDArray[np.float64],
) -> None:
    """Update the likelihood ratio of wear against none by a visit, and add its mean over the rates.

    Parameters
    ----------
    density : ndarray of float32, shape (r, m)
        Density of the visit with wear at r rates.
    healthy : ndarray of float32, shape (m,)
        Density of the visit without wear.
    repeated : bool
        True if the visit has a repeat.
    caps : ndarray of float32, shape (3,)
        1 over the largest ratio of a single run that counts, 1 over that of its repeat, and the largest ratio
        in all.
    weight : float32
        Weight of this onset.
    ratio, largest : ndarray of float32, shape (r, m) or (1, m)
        Ratio so far, and the largest factor of a single run.
    later, peak : ndarray of float32, shape (r, m)
        The same after the visit (filled).
    summed : ndarray, shape (m,)
        Added to.
    """
    per_run, per_repeat, most = caps
    share = weight / np.float32(density.shape[0])
    factor = per_repeat if repeated else np.float32(1.0)
    for r in range(density.shape[0]):
        of_rate = min(r, ratio.shape[0] - 1)
        for j in range(density.shape[1]):
            now = density[r, j] / healthy[j]
            later[r, j] = min(ratio[of_rate, j] * now, most)
            peak[r, j] = max(largest[of_rate, j], now * factor)
            summed[j] += share * later[r, j] / max(peak[r, j] * per_run, np.float32(1.0))


@compiled(fastmath=_FAST)
def update_histories(
    visit: tuple[Single, Single, Single],
    wear: Single,
    healthy_update: VisitUpdate,
    worn_update: VisitUpdate,
    weight: Single,
    caps: Single,
    before: OddsArrays,
    after: OddsArrays,
    new: int,
    density: Single,
    summed: NDArray[np.float64],
) -> None:
    """Update histories by a visit, and add their likelihood ratios.

    Parameters
    ----------
    visit : tuple of ndarray of float32
        Levels of the visit, (m,), and of its repeat, (m,) or empty; effect of each coefficient, (p,).
    wear : ndarray of float32, shape (o, r)
        Loss by then, since each onset at r rates.
    healthy_update, worn_update : tuple of ndarray of float32
        Without wear, and with wear since each of o onsets, the second axis of each array: gain, (s, o, p),
        and bound, (s, o), as for :func:`update_coefficients`; mixtures of a run, (s, o, 5), and with its
        repeat, (s, o, kinds, 4), which is empty without one.
    weight, caps : ndarray of float32, shapes (o,) and (3,)
        As for :func:`accumulate_ratio`.
    before, after : tuple of ndarray of float32
        Before, and after the visit (filled): coefficients without wear, (s, p, 1, m), and with it,
        (s, o, p, r, m); ratio and largest factor of a run, (s, o, r, m).
    new : int
        Number of onsets, 0 or 1, that begin at the visit. They come first in ``after``; ``before`` has none
        of their rows: its row i is of onset i + ``new``, and rows beyond the o onsets are ignored.
    density : ndarray of float32, shape (s, m)
        Of the visit without wear; filled.
    summed : ndarray, shape (s, m)
        Sum of the ratios over the onsets; added to.
    """
    level, repeat, row = visit
    none, repeated = np.zeros((1, 1), np.float32), len(repeat) > 0
    healthy, worn, ratio, largest = before
    healthy_after, worn_after, ratio_after, largest_after = after
    gain, most, mixture, both = healthy_update
    worn_gain, worn_most, worn_mixture, worn_both = worn_update
    no_evidence = np.ones((1, density.shape[1]), np.float32)
    errors = np.empty((2, wear.shape[1], density.shape[1]), np.float32)
    worn_density = np.empty(errors.shape[1:], np.float32)
    for g in range(density.shape[0]):
        for o in range(-1, wear.shape[0]):
            # One call for both: code that is inlined twice takes twice as long to compile.
            mean, so_far, peak = healthy[g], no_evidence, no_evidence
            if o < 0:
                loss, error, second, found = none[0], errors[0, :1], errors[1, :1], density[g : g + 1]
                change, bound, single, pair = gain[g], most[g], mixture[g], both[g]
                updated = healthy_after[g]
            else:
                loss, error, second, found = wear[o], errors[0], errors[1], worn_density
                change, bound = worn_gain[g, o], worn_most[g, o]
                single, pair = worn_mixture[g, o], worn_both[g, o]
                if o >= new:
                    mean, so_far, peak = worn[g, o - new], ratio[g, o - new], largest[g, o - new]
                updated = worn_after[g, o]
            innovation(level, loss, row, mean, error)
            if repeated:
                innovation(repeat, loss, row, mean, second)
                pair_density(error, second, single, pair, found)
                mean_or_lower(error, second, bound)
            else:
                run_density(error, single, found)
            update_coefficients(error, change, bound, mean, updated)
            if o >= 0:
                accumulate_ratio(
                    found, density[g], repeated, caps, weight[o], so_far, peak,
                    ratio_after[g, o], largest_after[g, o], summed[g],
                )  # fmt: skip


@compiled()
def put_histories(part: Array | Single, which: NDArray[np.int_], whole: Array | Single) -> None:
    """Overwrite some histories; NumPy's indexing of the last axis takes three times as long.

    Parameters
    ----------
    part : ndarray, shape (n, k)
        Their numbers.
    which : ndarray of int, shape (k,)
        Those to overwrite.
    whole : ndarray, shape (n, m)
        Numbers of m histories.
    """
    for row in range(whole.shape[0]):
        for j in range(len(which)):
            whole[row, which[j]] = part[row, j]
