"""Odds that wear began at one of the newest runs, against none.

The statistic of Shiryaev and Roberts (Roberts, 1966, DOI 10.1080/00401706.1966.10490374). Of every onset,
rate of wear and size of the scatter the likelihood ratio against a healthy axis is followed from run to run;
the statistic is log(1 + their sum over onsets and mean over rates), over scatters by what the runs so far say
of them. Level, temperature and steps of each are followed beside, since its onset, by a filter whose gain is
the same in all histories. A run is odd as often as the settings believe, and now and then anything at all.
The one run that speaks most for a ramp counts no more than ``_ONE``: one alone, however far off, is no wear.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from ballscrew.base.arrays import Array
from ballscrew.monitoring.detection.density import mixture, ordinary, pair, single
from ballscrew.monitoring.detection.design import Design
from ballscrew.monitoring.detection.follow import apart, met, teach, weigh

__all__ = ["Odds", "odds"]

Single = NDArray[np.float32]
Real = TypeVar("Real", np.float32, np.float64)
_RATES = (1 / 350, 1 / 160, 1 / 90)  # of the level a day: worn out in so many days by contact pressure
_ONSETS = 5  # newest runs that wear may have begun before; the ramp looks farther back
_SCALES = np.exp(np.linspace(-1.2, 1.0, 6))  # of the scatter, over that believed
_SCALE_SPREAD = 0.6  # of ln: axes differ by more than one axis's runs leave open
_ONE = np.float32(np.exp(4.0))  # likelihood ratio, at most, of the run that speaks most for a ramp
_TWO = np.float32(np.exp(4.0))  # how much more a run and its repeat may speak for it
_FAR = 3.0  # standard deviations beyond which a run teaches no more
_LEVEL = 0.3  # of the level before the first run
_FELT = 0.5  # of the square of what a wrong temperature does to a typical axis
_MOST = np.float32(1e20)
_CAPS = np.array([_ONE, _TWO, _MOST])
_BEYOND = 1e12  # of a level: its square is still a number
_NONE: Single = np.empty(0, np.float32)
_SOUND: Single = np.zeros(1, np.float32)  # lost by an axis that does not wear


@dataclass(frozen=True, slots=True, eq=False)
class Odds:
    """Of n visits in m histories.

    Parameters
    ----------
    first : ndarray, shape (n, m)
        After the first run of each visit.
    all : ndarray, shape (n, m)
        After its repeat too; the same where there was none.
    repeated : ndarray of bool, shape (n, m)
        Where one was made.
    """

    first: Array
    all: Array
    repeated: NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class _Belief:
    """Coefficients of m histories at r rates, (p, r, m), and their covariance (p, p), common to all."""

    middle: Single
    covariance: Array


@dataclass(frozen=True, slots=True)
class _Onset:
    """Wear since a day: what is believed, the likelihood ratio so far, and the largest of one run, (r, m)."""

    belief: _Belief
    ratio: Single
    largest: Single
    day: float
    weight: float


@dataclass(frozen=True, slots=True)
class _Visit:
    """What a visit showed: its level, and that of its repeat, each (m,); none where none was made."""

    level: Single
    again: Single


def odds(
    of: Design,
    levels: Array,
    begin: int,
    again: Array | None = None,
    asked: Callable[[int, Array], float] | None = None,
    besides: NDArray[np.bool_] | None = None,
) -> Odds:
    """Tell at each visit how much speaks for wear that began lately.

    Parameters
    ----------
    of : Design
        The epoch, a row a visit.
    levels : ndarray, shape (n, m)
        Of m histories, as they are; finite.
    begin : int
        First visit that is judged, 1 or more.
    again : ndarray, shape (n, m), optional
        Levels of the repeats; nan where there is none.
    asked : callable, optional
        Of a visit's number and of the odds after its first run: above what a repeat is made. Without it
        every repeat that there is counts.
    besides : ndarray of bool, shape (n, m), optional
        Where one is made besides.

    Returns
    -------
    Odds
        0 or more; 0 before ``begin``. What comes later changes nothing.
    """
    kept, (count, draws) = of.settings, levels.shape
    prior = np.where(np.isfinite(of.sizes), of.sizes, _LEVEL) ** 2
    start = _Belief(np.zeros((len(prior), 1, draws), np.float32), np.diag(prior))
    shown = np.clip(levels, -_BEYOND, _BEYOND).astype(np.float32)
    read = _FELT * (of.sizes[1] * kept.thermometer) ** 2 if of.warm else 0.0
    own = np.array([(kept.scale * one * of.told) ** 2 + of.loose**2 + read * of.known for one in _SCALES])
    said = np.repeat(-0.5 * (np.log(_SCALES) / _SCALE_SPREAD)[:, None] ** 2, draws, axis=1)
    healthy = [start] * len(_SCALES)
    since: list[list[_Onset]] = [[] for _ in _SCALES]
    first, found = np.zeros((2, count, draws))
    repeated = np.zeros((count, draws), dtype=bool)
    for k in range(count):
        visit = _Visit(shown[k], _NONE)
        if k >= begin:
            since = [[_begun(of, k, one), *each][:_ONSETS] for one, each in zip(healthy, since, strict=True)]
        before = _State(healthy, since, said)
        after, found[k] = _told(of, k, before, visit, own[:, k], begin)
        first[k] = found[k]
        if again is not None and k >= begin:
            repeated[k] = np.isfinite(again[k])
            if asked is not None:
                wanted = found[k] > asked(k, found[k])
                repeated[k] &= wanted if besides is None else wanted | besides[k]
            which = np.flatnonzero(repeated[k])
            if len(which):
                second = np.clip(again[k, which], -_BEYOND, _BEYOND).astype(np.float32)
                both = _Visit(np.ascontiguousarray(visit.level[which]), second)
                other, found[k, which] = _told(of, k, before.of(which), both, own[:, k], begin)
                after = after.put(which, other)
        healthy, since, said = after.healthy, after.since, after.said
    return Odds(first, found, repeated)


@dataclass(frozen=True, slots=True)
class _State:
    """Of m histories by scale: beliefs without wear, with it since each onset, and ln of the scale's odds."""

    healthy: list[_Belief]
    since: list[list[_Onset]]
    said: Array

    def of(self, which: NDArray[np.int_]) -> _State:
        """Some of the histories."""
        return _State(
            [_part(one, which) for one in self.healthy],
            [
                [
                    replace(
                        o, belief=_part(o.belief, which), ratio=o.ratio[:, which], largest=o.largest[:, which]
                    )
                    for o in each
                ]
                for each in self.since
            ],
            self.said[:, which],
        )

    def put(self, which: NDArray[np.int_], other: _State) -> _State:
        """With others in their places."""
        return _State(
            [_placed(one, which, new) for one, new in zip(self.healthy, other.healthy, strict=True)],
            [
                [
                    replace(
                        o,
                        belief=_placed(o.belief, which, n.belief),
                        ratio=_columns(o.ratio, which, n.ratio),
                        largest=_columns(o.largest, which, n.largest),
                    )
                    for o, n in zip(each, new, strict=True)
                ]
                for each, new in zip(self.since, other.since, strict=True)
            ],
            _columns(self.said, which, other.said),
        )


def _part(one: _Belief, which: NDArray[np.int_]) -> _Belief:
    return _Belief(np.ascontiguousarray(one.middle[:, :, which]), one.covariance)


def _placed(one: _Belief, which: NDArray[np.int_], new: _Belief) -> _Belief:
    return _Belief(_columns(one.middle, which, new.middle), one.covariance)


def _columns(whole: NDArray[Real], which: NDArray[np.int_], new: NDArray[Real]) -> NDArray[Real]:
    copy = whole.copy()
    copy[..., which] = new
    return copy


def _told(of: Design, k: int, before: _State, visit: _Visit, own: Array, begin: int) -> tuple[_State, Array]:
    """One visit later, and the odds by then."""
    healthy, since, said = [], [], np.array(before.said)
    summed = np.zeros_like(said)
    for g, noise in enumerate(own.tolist()):
        density, belief = _next(of, k, before.healthy[g], visit, noise)
        healthy.append(belief)
        said[g] += np.log(density[0])
        since.append([_followed(of, k, one, visit, noise, density[0], summed[g]) for one in before.since[g]])
    said -= said.max(axis=0)
    if k < begin:
        return _State(healthy, since, said), np.zeros(said.shape[1])
    share = np.exp(said)
    return _State(healthy, since, said), np.log1p((share * summed).sum(axis=0) / share.sum(axis=0))


def _begun(of: Design, k: int, healthy: _Belief) -> _Onset:
    """Wear that begins in the middle between a run and the one before; a longer gap is as much likelier."""
    gap = float(of.days[k] - of.days[k - 1])
    wide = np.repeat(healthy.middle, len(_RATES), axis=1)
    one = np.ones(wide.shape[1:], np.float32)
    return _Onset(_Belief(wide, healthy.covariance), one, one, float(of.days[k]) - gap / 2, gap)


def _followed(
    of: Design, k: int, since: _Onset, visit: _Visit, noise: float, sound: Single, summed: Array
) -> _Onset:
    """One visit later; what speaks for wear since then is added. What a repeat agrees with is not one run."""
    lost = (np.array(_RATES) * (of.days[k] - since.day)).astype(np.float32)
    density, belief = _next(of, k, since.belief, visit, noise, lost)
    later, peak = np.empty_like(since.ratio), np.empty_like(since.largest)
    weight, twice = np.float32(since.weight), bool(len(visit.again))
    weigh(density, sound, twice, _CAPS, weight, since.ratio, since.largest, later, peak, summed)
    return _Onset(belief, later, peak, since.day, since.weight)


def _next(
    of: Design, k: int, belief: _Belief, visit: _Visit, noise: float, lost: Single = _SOUND
) -> tuple[Single, _Belief]:
    """Density of a visit, and what is believed after it."""
    x, kept = of.columns[k], of.settings
    toward = belief.covariance @ x
    doubt = float(x @ toward)
    usual = noise + doubt
    most = np.float32(_FAR * np.sqrt(usual))
    off, density = np.empty((2, *belief.middle.shape[1:]), np.float32)
    taught = np.empty_like(belief.middle)
    apart(visit.level, lost, x.astype(np.float32), belief.middle, off)
    if len(visit.again):
        other = np.empty_like(off)
        apart(visit.again, lost, x.astype(np.float32), belief.middle, other)
        pair(off, other, ordinary(noise, doubt, kept), mixture(noise, doubt, kept), density)
        met(off, other, most)
    else:
        single(off, ordinary(noise, doubt, kept), density)
    teach(off, (toward / usual).astype(np.float32), most, belief.middle, taught)
    return density, _Belief(taught, belief.covariance - np.outer(toward, toward) / usual)
