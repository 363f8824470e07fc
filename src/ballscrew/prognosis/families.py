"""Families of wear: courses of the loss over the duty, each on a cloud of parameters.

With x = 1 − w/δ₀ the remaining part of the flanks' approach, P = P₀ x^1.5, wear after Archard is

    −dx/dS = max(x^p, f),

so that z = ∫ dx / max(x^p, f) from x to 1 is proportional to the duty S. p says what presses: 0 a constant
outer load, 0.5 the contact pressure of the preload, 1 an exponential law, 1.5 the preload itself; p = −0.5 is
a preload that falls on a straight line. Below x = 0.05 wear is that of the load alone, also with backlash.
Beyond the laws the pace itself may grow in proportion to what it has done, or change at once:

    z = z₀ + b g(s) + motion,    g(s) = (e^(k s) − 1)/k + (c − 1) (s − s_c)₊

with s the duty since the onset, and Brownian motion, which is the duty's unevenness. Running-in has k < 0,
s_c = 0 and a steady pace beside it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from ballscrew.base.arrays import Array

LAW_EXPONENTS = {"external-load": 0.0, "contact-pressure": 0.5, "exponential": 1.0, "preload": 1.5}
"""p of each law of wear."""

N_PARAMETERS = 6
"""Standard normal numbers of a member of a family: pace, onset, scatter, motion, and two of its course."""

_STRAIGHT = -0.5  # p of a preload that falls on a straight line
_STEEPEST = 1.5  # p of the steepest law
_MOST_GROWTH = 8.0  # k s: three thousand times the first pace
_STEADY = 0.7  # steady pace, over the initial excess of running-in
_MOST_REMAINING = 2.0  # x of the largest reading that noise makes
_LAST = 0.05  # x from which on the load alone wears: a hundredth of the preload


@dataclass(frozen=True, slots=True)
class FamilyPrior:
    """Prior of the parameters: medians, and standard deviations of logarithms.

    Parameters
    ----------
    rate, rate_spread : float
        b, part of δ₀ a day when new.
    onset : float
        Days within which wear begins with a probability of one half; the distribution has a long tail.
    noise, noise_spread : float
        True scatter of a run over its stated uncertainty.
    walk, walk_spread : float
        Brownian motion of z over the whole record, over the stated uncertainty of a run.
    growth, growth_spread : float
        k times the duty of wear so far.
    factor, factor_spread : float
        c; s_c is uniform over the duty of wear so far.
    hazard : float
        Rate of one more change of pace of wear that has begun, ahead, while its duty grows e-fold.
    later, later_spread : float
        Factor of that change; below 1 wear slows down.
    relaxation, relaxation_spread : float
        −k of running-in, times the duty of wear so far.
    """

    rate: float = 1e-3
    rate_spread: float = 1.8
    onset: float = 20.0
    noise: float = 0.7
    noise_spread: float = 0.5
    walk: float = 0.3
    walk_spread: float = 1.5
    growth: float = 1.2
    growth_spread: float = 0.9
    factor: float = 2.5
    factor_spread: float = 0.7
    hazard: float = 0.45
    later: float = 2.5
    later_spread: float = 1.8
    relaxation: float = 5.0
    relaxation_spread: float = 1.5

    def onset_probability(self, duty: Array) -> Array:
        """Probability of an onset before a duty, days."""
        return duty / (self.onset + duty)

    def onset_at(self, probability: Array) -> Array:
        """Duty before which wear has begun with a probability below 1, days."""
        return self.onset * probability / (1 - probability)


@dataclass(frozen=True, slots=True, eq=False)
class Cloud:
    """m members of a family, each array of shape (m,); symbols as in :class:`FamilyPrior`."""

    rate: Array
    onset: Array
    noise: Array
    walk: Array
    exponent: Array
    growth: Array
    change: Array
    factor: Array

    def part(self, selected: NDArray[np.intp]) -> Cloud:
        """Select members."""
        return Cloud(*(getattr(self, name)[selected] for name in self.__slots__))

    def since(self, duty: Array) -> Array:
        """Duty since the onset, shape (m, n), from the duty of shape (n,)."""
        return np.asarray(np.maximum(duty - self.onset[:, None], 0.0))

    def course(self, duty: Array) -> Array:
        """g, shape (m, n), of the duty, shape (n,)."""
        since = self.since(duty)
        k = self.growth[:, None]
        turns = np.minimum(k * since, _MOST_GROWTH)
        grown = np.where(k == 0, since, np.expm1(turns) / np.where(k == 0, 1.0, k))
        later = np.maximum(since - self.change[:, None], 0.0)
        return np.asarray(grown + (self.factor[:, None] - 1) * later)


@dataclass(frozen=True, slots=True)
class Family:
    """A family: which of the parameters it leaves free.

    Parameters
    ----------
    name : str
        As printed.
    by_law, runs_in, grows, changes : bool
        Whether p, k < 0, k > 0, and c with s_c are free; with none, the preload falls on a straight line.
    by_travel : bool
        Whether the duty is travel; otherwise it is time.
    by_hours : bool
        Whether the duty is hours of operation.
    weight : float
        Before the first reading, relative to the other families.
    """

    name: str
    by_law: bool = False
    runs_in: bool = False
    grows: bool = False
    changes: bool = False
    by_travel: bool = False
    by_hours: bool = False
    weight: float = 1.0

    @property
    def free(self) -> tuple[int, ...]:
        """Numbers of a member that the family uses."""
        course = 0
        if self.runs_in or self.changes:
            course = 2
        elif self.by_law or self.grows:
            course = 1
        return tuple(range(N_PARAMETERS - 2 + course))

    def cloud(self, z: Array, prior: FamilyPrior, span: float) -> Cloud:
        """Members of the family.

        Parameters
        ----------
        z : ndarray, shape (m, 6)
            Standard normal before anything is observed.
        prior : FamilyPrior
            The prior.
        span : float
            Duty up to now: growth and change are in proportion to the duty since the onset.

        Returns
        -------
        Cloud
            One member per row of ``z``.
        """
        m = len(z)
        onset = prior.onset_at(np.minimum(ndtr(z[:, 1]), 1 - 1e-12))
        worn = np.maximum(span - onset, max(0.1 * span, 1.0))
        exponent, growth = np.full(m, _STRAIGHT), np.zeros(m)
        change, factor = np.full(m, 1e9), np.ones(m)
        rate = np.exp(math.log(prior.rate) + prior.rate_spread * z[:, 0])
        if self.by_law:
            exponent = _STEEPEST * ndtr(z[:, 4])
        if self.runs_in:
            growth = -np.exp(math.log(prior.relaxation) + prior.relaxation_spread * z[:, 5]) / worn
            change, factor = np.zeros(m), np.full(m, 1 + _STEADY)
            rate = rate / factor
        if self.grows:
            growth = np.exp(math.log(prior.growth) + prior.growth_spread * z[:, 4]) / worn
        if self.changes:
            change = worn * ndtr(z[:, 4])
            factor = np.exp(math.log(prior.factor) + prior.factor_spread * z[:, 5])
        return Cloud(
            rate=rate,
            onset=onset,
            noise=np.exp(math.log(prior.noise) + prior.noise_spread * z[:, 2]),
            walk=np.exp(math.log(prior.walk) + prior.walk_spread * z[:, 3]) / math.sqrt(max(span, 1.0)),
            exponent=exponent,
            growth=growth,
            change=change,
            factor=factor,
        )


FAMILIES = (
    Family("straight line", weight=0.05),
    Family("law of wear, by time", by_law=True, weight=0.2),
    Family("law of wear, by travel", by_law=True, by_travel=True, weight=0.2),
    Family("exponential", grows=True, weight=0.15),
    Family("change of regime", changes=True, weight=0.5),
    Family("law of wear, by hours", by_law=True, by_hours=True, weight=0.2),
    Family("running-in", by_law=True, runs_in=True, weight=0.1),
)
"""The families of the average."""


def wear_depth(remaining: Array, exponent: Array) -> Array:
    """Z of the remaining part x.

    Parameters
    ----------
    remaining : ndarray
        x; negative with backlash.
    exponent : ndarray
        p; shapes that broadcast.

    Returns
    -------
    ndarray
        0 at x = 1, rising as x falls.
    """
    q = _complement(exponent)
    above = np.maximum(remaining, _LAST)
    below = np.minimum(np.asarray(remaining) - _LAST, 0.0)
    return np.asarray(-np.expm1(q * np.log(above)) / q - below * _LAST ** (q - 1))


def remaining_part(depth: Array, exponent: Array) -> Array:
    """Remaining part x, the inverse of :func:`wear_depth`."""
    q = _complement(exponent)
    last = -np.expm1(q * math.log(_LAST)) / q
    base = np.maximum(1 - q * np.minimum(depth, last), 1e-12)
    above = np.exp(np.minimum(np.log(base) / q, math.log(_MOST_REMAINING)))
    return np.asarray(np.where(depth < last, above, _LAST - (depth - last) * _LAST ** (1 - q)))


def _complement(exponent: Array) -> Array:
    """1 − p, not quite 0: there z is a logarithm."""
    q = 1 - np.asarray(exponent, dtype=np.float64)
    return np.asarray(np.where(np.abs(q) < 1e-5, 1e-5, q))


def named_laws(exponent: Array, weight: Array) -> dict[str, float]:
    """Probability of each named law, by the law nearest to each member's exponent.

    Parameters
    ----------
    exponent, weight : ndarray, shape (m,)
        p of members, and their weights.

    Returns
    -------
    dict
        Name to probability, in the order of p; empty without members.
    """
    if not len(exponent):
        return {}
    nearest = np.argmin(np.abs(exponent[:, None] - list(LAW_EXPONENTS.values())), axis=1)
    total = np.bincount(nearest, weights=weight, minlength=len(LAW_EXPONENTS)) / np.sum(weight)
    return dict(zip(LAW_EXPONENTS, total.tolist(), strict=True))
