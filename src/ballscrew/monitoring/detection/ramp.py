"""Generalised likelihood ratio for a ramp of unknown onset: wear that began somewhere, and goes on since.

For every onset τ the ramp's slope is estimated by generalised least squares over all runs so far, level,
temperature and steps with their priors profiled out; the statistic is the largest of slope over its standard
deviation (Willsky and Jones, 1976, DOI 10.1109/TAC.1976.1101146). Onsets lie on a grid that is finer towards
today: a ramp is found about as well from an onset that is a little off.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ballscrew.base.arrays import Array
from ballscrew.monitoring.detection.design import Design

__all__ = ["onsets", "ramp"]

_LEAST = 1e-9


def onsets(k: int) -> NDArray[np.int_]:
    """Runs at which a ramp may have begun, as run k sees it.

    Parameters
    ----------
    k : int
        From 1.

    Returns
    -------
    ndarray of int
        Descending; 1, 2, 3, 4, 6, 8, 12, … runs back, and the first.
    """
    back = [1, 2, 3]
    while back[-1] < k:
        back.append(back[-2] * 2 if len(back) > 2 else back[-1] + 1)
    return np.array(sorted({max(k - one, 0) for one in back}, reverse=True))


def ramp(
    of: Design, level: Array, scale: Array, begin: int, first: Array | None = None
) -> tuple[Array, NDArray[np.int_], Array]:
    """Tell at each run how much speaks for a ramp.

    Parameters
    ----------
    of : Design
        The epoch.
    level : ndarray, shape (n, m)
        Of m histories, odd runs drawn back.
    scale : ndarray, shape (n, m)
        Scatter over the told one.
    begin : int
        First run that is judged.
    first : ndarray, shape (n, m), optional
        Levels after the first run of each visit, where its repeat made it another.

    Returns
    -------
    ndarray, shape (n, m)
        Largest slope over its standard deviation; 0 before ``begin``.
    ndarray of int, shape (n, m)
        The onset of it.
    ndarray, shape (n, m)
        The statistic after the first run of each visit.
    """
    count = len(of.days)
    weight = 1 / of.noise
    when = of.days - of.days[0] if count else of.days
    found, at = np.zeros_like(level), np.zeros(level.shape, dtype=int)
    early = np.zeros_like(level)
    weighted = weight[:, None] * level
    zero, one = np.cumsum(weighted, axis=0), np.cumsum(when[:, None] * weighted, axis=0)
    columns = of.columns * weight[:, None]
    inner = np.cumsum(columns[:, :, None] * of.columns[:, None, :], axis=0)
    pulled = columns[:begin].T @ level[:begin]
    for k in range(begin, count):
        pulled = pulled + columns[k][:, None] * level[k]
        start = onsets(k)
        slopes = np.maximum(when[: k + 1, None] - when[start], 0.0)  # (k + 1, w)
        across = columns[: k + 1].T @ slopes  # (p, w)
        profile = np.linalg.solve(inner[k] + np.diag(of.information), across)
        known = (weight[: k + 1, None] * slopes**2).sum(axis=0) - (across * profile).sum(axis=0)
        usable = known > _LEAST * (weight[: k + 1, None] * slopes**2).sum(axis=0)
        if not usable.any():
            continue
        start, profile, known = start[usable], profile[:, usable], known[usable]
        sums = one[k] - one[start] - when[start, None] * (zero[k] - zero[start]) - profile.T @ pulled
        values = sums / np.sqrt(known)[:, None]
        best = np.argmax(values, axis=0)
        found[k] = values[best, range(values.shape[1])] * of.settings.scale / scale[k]
        at[k] = start[best]
        early[k] = found[k]
        other = np.flatnonzero(first[k] != level[k]) if first is not None else best[:0]
        if first is not None and len(other):
            felt = weight[k] * (when[k] - when[start]) - profile.T @ columns[k]
            more = (felt / np.sqrt(known))[:, None] * (first[k, other] - level[k, other])
            highest = (values[:, other] + more).max(axis=0)
            early[k, other] = highest * of.settings.scale / scale[k, other]
    return found, at, early
