"""Odds that wear began at one of the newest runs, against none.

The statistic of Shiryaev and Roberts (Roberts, 1966, DOI 10.1080/00401706.1966.10490374). Of every onset,
rate of wear and size of the scatter the likelihood ratio against a healthy axis is followed from run to run;
the statistic is log(1 + their sum over onsets and mean over rates), over scatters by what the runs so far say
of them. Level, temperature and steps of each are followed beside, since its onset, by a filter whose gain is
the same in all histories. A run is odd as often as the settings believe, and now and then anything at all.
The one run that speaks most for a ramp counts no more than ``_ONE``: one alone, however far off, is no wear.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballscrew.health.detection.design import Design

__all__ = ["odds"]

Array = NDArray[np.float64]
Single = NDArray[np.float32]
_RATES = (1 / 350, 1 / 160, 1 / 90)  # of the level a day: worn out in so many days by contact pressure
_ONSETS = 5  # newest runs that wear may have begun before; the ramp looks farther back
_SCALES = np.exp(np.linspace(-1.2, 1.0, 6))  # of the scatter, over that believed
_SCALE_SPREAD = 0.6  # of ln: axes differ by more than one axis's runs leave open
_ONE = np.float32(np.exp(4.0))  # likelihood ratio, at most, of the run that speaks most for a ramp
_ANYTHING = 1e-5  # density of a run that may be anything, over that of an ordinary one at its middle
_FAR = 3.0  # standard deviations beyond which a run teaches no more
_LEVEL = 0.3  # of the level before the first run
_FELT = 0.5  # of the square of what a wrong temperature does to a typical axis
_MOST = np.float32(1e30)


@dataclass(frozen=True, slots=True)
class _Belief:
    """Coefficients of m histories at r rates, each (r, m), and their covariance (p, p), common to all."""

    middle: tuple[Single, ...]
    covariance: Array


@dataclass(frozen=True, slots=True)
class _Onset:
    """Wear since a day: what is believed, the likelihood ratio so far, and the largest of one run, (r, m)."""

    belief: _Belief
    ratio: Single
    largest: Single
    day: float
    weight: float


def odds(of: Design, levels: Array, begin: int) -> Array:
    """Tell at each run how much speaks for wear that began lately.

    Parameters
    ----------
    of : Design
        The epoch.
    levels : ndarray, shape (n, m)
        Of m histories, as they are.
    begin : int
        First run that is judged, 1 or more.

    Returns
    -------
    ndarray, shape (n, m)
        0 or more; 0 before ``begin``. What comes later changes nothing.
    """
    kept, (count, draws) = of.settings, levels.shape
    prior = np.where(np.isfinite(of.sizes), of.sizes, _LEVEL) ** 2
    start = _Belief(tuple(np.zeros((1, draws), np.float32) for _ in prior), np.diag(prior))
    read = _FELT * (of.sizes[1] * kept.thermometer) ** 2 if of.warm else 0.0
    own = np.array([(kept.scale * one * of.told) ** 2 + of.loose**2 + read * of.known for one in _SCALES])
    said = np.repeat(-0.5 * (np.log(_SCALES) / _SCALE_SPREAD)[:, None] ** 2, draws, axis=1)
    healthy = [start] * len(_SCALES)
    since: list[list[_Onset]] = [[] for _ in _SCALES]
    found, summed = np.zeros((count, draws)), np.zeros_like(said)
    for k in range(count):
        level = levels[k].astype(np.float32)[None]
        for g, noise in enumerate(own[:, k]):
            before = healthy[g]
            density, healthy[g] = _next(of, k, before, level, float(noise))
            said[g] += np.log(density[0])
            if k >= begin:
                followed = [_begun(of, k, before), *since[g]][:_ONSETS]
                since[g] = [_followed(of, k, one, level, float(noise), density) for one in followed]
                summed[g] = sum(
                    one.weight * (one.ratio / np.maximum(one.largest / _ONE, 1)).mean(axis=0)
                    for one in since[g]
                )
        said -= said.max(axis=0)
        if k >= begin:
            share = np.exp(said)
            found[k] = np.log1p((share * summed).sum(axis=0) / share.sum(axis=0))
    return found


def _begun(of: Design, k: int, healthy: _Belief) -> _Onset:
    """Wear that begins in the middle between a run and the one before; a longer gap is as much likelier."""
    gap = float(of.days[k] - of.days[k - 1])
    shape = len(_RATES), healthy.middle[0].shape[1]
    wide = tuple(np.broadcast_to(one, shape) for one in healthy.middle)
    one = np.ones(shape, np.float32)
    return _Onset(_Belief(wide, healthy.covariance), one, one, float(of.days[k]) - gap / 2, gap)


def _followed(of: Design, k: int, since: _Onset, level: Single, noise: float, healthy: Single) -> _Onset:
    """One run later."""
    lost = (np.array(_RATES) * (of.days[k] - since.day)).astype(np.float32)[:, None]
    density, belief = _next(of, k, since.belief, level - lost, noise)
    density /= healthy
    return _Onset(
        belief,
        np.minimum(since.ratio * density, _MOST),
        np.maximum(since.largest, density),
        since.day,
        since.weight,
    )


def _next(of: Design, k: int, belief: _Belief, level: Single, noise: float) -> tuple[Single, _Belief]:
    """Density of a run, and what is believed after it; far ones teach no more than less far ones."""
    x, kept = of.columns[k], of.settings
    toward = belief.covariance @ x
    doubt = float(x @ toward)
    usual, odd = noise + doubt, kept.odd_size**2 * noise + doubt
    off = np.array(level)
    for part, middle in zip(x, belief.middle, strict=True):
        if part:
            off = off - np.float32(part) * middle
    square = off * off
    density = np.exp(square * np.float32(-0.5 / usual))
    density *= np.float32((1 - kept.odd) / np.sqrt(usual))
    square *= np.float32(-0.5 / odd)
    np.exp(square, out=square)
    square *= np.float32(kept.odd / np.sqrt(odd))
    density += square
    density += np.float32(_ANYTHING / np.sqrt(usual))
    most = np.float32(_FAR * np.sqrt(usual))
    np.clip(off, -most, most, out=off)
    gain = (toward / usual).astype(np.float32)
    taught = tuple(one + part * off if part else one for part, one in zip(gain, belief.middle, strict=True))
    return density, _Belief(taught, belief.covariance - np.outer(toward, toward) / usual)
