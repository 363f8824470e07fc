"""A family of wear given the readings: weights of its members, its past forecasts, and paths ahead.

Given its parameters a member is a Gaussian process: an amplitude above 0 times a course, Brownian motion, and
noise. One Cholesky factor L of its covariance gives all: with the innovations e = L⁻¹ z, reading j given the
first i of them has the mean Σ_{l ≤ i} L_jl e_l and the variance Σ_{i < l ≤ j} L_jl². Members are weighted by
their likelihood, on a cloud that is adapted to it in rounds (Cappé, Guillin, Marin and Robert, *Population
Monte Carlo*, J. Comput. Graph. Stat. 13, 2004, DOI 10.1198/106186004X12803).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import log_ndtr, ndtr, ndtri

from ballscrew.base.arrays import Array
from ballscrew.base.proposals import (
    Proposal,
    effective_number,
    log_sum,
    proposal_nearby,
    proposals_at_maxima,
)
from ballscrew.base.resampling import systematic
from ballscrew.prognosis.families import (
    NUMBERS,
    Cloud,
    Family,
    FamilyPrior,
    OnsetScale,
    remaining_part,
    wear_depth,
)
from ballscrew.prognosis.readings import Readings

AHEAD = (1, 2, 4, 8)
"""Readings ahead by which a family is scored."""

_FIRST = 4  # clouds' worth of members of the prior
_STARTS, _DISTANCE = 4, 1.0  # of them at most, and so far from each other, from which a maximum is sought
_STEPS = 8  # towards it
_MOST_ROUNDS = 16  # adapted clouds
_ENOUGH = 20.0  # effective number of members for any number of readings at which no more are added
_NEWEST = 5.0  # the same for all readings, over that
_EFFECTIVE = 30.0  # members that count, at least, by which the next cloud is adapted
_ONSET = 1  # number of the onset
_LEAST_REMAINING = 0.05  # of x, for dz/dx
_FEWEST_GAPS = 5  # between readings, before the innovations show how uneven the motion is
_DISTINCT = 192  # members of a family's paths
_JITTER = 1e-9  # of a variance, for the factor's sake
_ANY = 1e30  # variance of a row that is transformed only


@dataclass(frozen=True, slots=True, eq=False)
class FamilyFit:
    """Members of a family and their weights, which sum to 1.

    Parameters
    ----------
    family : Family
        The family.
    cloud : Cloud
        m members.
    weight : ndarray, shape (m,)
        Posterior probabilities.
    excess : ndarray, shape (m,)
        Excess kurtosis of the innovations.
    score, below : ndarray, shape (n, 4)
        Logarithm of the density of each reading as forecast :data:`AHEAD` readings before, and probability
        below it; NaN where there was no reading yet.
    """

    family: Family
    cloud: Cloud
    weight: Array
    excess: Array
    score: Array
    below: Array


@dataclass(frozen=True, slots=True, eq=False)
class Paths:
    """Equally probable paths: x, shape (m, k), and each member's exponent, onset and noise, shape (m,)."""

    remaining: Array
    exponent: Array
    onset: Array
    noise: Array


def fit_family(
    family: Family, prior: FamilyPrior, duty: Array, readings: Readings, *, members: int, seed: int
) -> FamilyFit:
    """Fit a family to the readings.

    Parameters
    ----------
    family : Family
        The family.
    prior : FamilyPrior
        Of its parameters.
    duty : ndarray, shape (n,)
        Duty at each reading, days.
    readings : Readings
        n of them.
    members : int
        Of each adapted cloud; the first has four times as many.
    seed : int
        The same seed gives the same members.

    Returns
    -------
    FamilyFit
        With at most twenty-one times as many members.
    """
    random = np.random.default_rng([seed, 1])
    target = _Target(family, prior, duty, readings, OnsetScale.of(duty, prior))
    sample = _sampled(target, members, random)
    factor, innovation, slope = map(np.concatenate, zip(*sample.evidence, strict=True))
    score, below = _past_forecasts(sample.log_weight, factor, innovation, slope)
    last = sample.log_weight[:, -1]
    moments = np.mean(innovation**4, axis=1) / np.maximum(np.mean(innovation**2, axis=1) ** 2, 1e-12)
    cloud = family.cloud(target.numbers(sample.points)[0], prior, float(duty[-1]))
    return FamilyFit(family, cloud, np.exp(last - log_sum(last)), moments - 3, score, below)


def sample_paths(
    fit: FamilyFit,
    readings: Readings,
    duty: Array,
    days: Array,
    ahead: Array,
    *,
    width: float,
    count: int,
    seed: int,
) -> Paths:
    """Paths ahead of a family.

    Parameters
    ----------
    fit : FamilyFit
        The family.
    readings : Readings
        Those of the fit.
    duty : ndarray, shape (n,)
        Duty at each reading.
    days, ahead : ndarray, shape (k,)
        Days from the last reading on, and the duty up to each.
    width : float
        Factor of the standard deviations ahead.
    count : int
        Number of paths.
    seed : int
        The same seed gives the same paths.

    Returns
    -------
    Paths
        Of ``count`` paths. Where the innovations have been uneven so is the motion ahead: a Poisson process
        of the same variance, of as many events a reading as explain their kurtosis.
    """
    random = np.random.default_rng([seed, 3])
    distinct = systematic(fit.weight, float(random.uniform()), _DISTINCT)
    member = np.resize(random.permutation(distinct), count)
    some, which = np.unique(member, return_inverse=True)
    cloud = fit.cloud.part(some)
    mean, root = _ahead(cloud, duty, ahead, readings)
    mean, root = mean[which], root[which]
    root = width * root
    e = random.standard_normal(mean.shape)
    e[:, 0] = _above(-mean[:, 0] / root[:, 0, 0], random.uniform(size=count))
    if len(readings.days) > _FEWEST_GAPS:
        gap = float(np.median(np.diff(readings.days)))
        events = np.diff(days) / max(gap, 1e-3) / np.maximum(fit.excess[member], 1e-3)[:, None]
        e[:, 2:] = (random.poisson(events) - events) / np.sqrt(events)
    depth = (mean + np.einsum("mij,mj->mi", root, e))[:, 1:]
    chosen = fit.cloud.part(member)
    x = remaining_part(depth, chosen.exponent[:, None])
    return Paths(x, chosen.exponent, chosen.onset, chosen.noise)


@dataclass(frozen=True, slots=True, eq=False)
class _Target:
    """Posterior of a family's members, in the numbers that it uses, with the onset by its scale."""

    family: Family
    prior: FamilyPrior
    duty: Array
    readings: Readings
    onsets: OnsetScale

    def numbers(self, points: Array) -> tuple[Array, Array]:
        """Numbers of members, shape (m, 6), and the logarithm of the density of the prior."""
        z = np.zeros((len(points), NUMBERS))
        z[:, self.family.free] = points
        z[:, _ONSET], log_ratio = self.onsets.to_prior(points[:, _ONSET])
        return z, log_ratio - 0.5 * (points**2).sum(axis=1)

    def evidence(self, points: Array) -> tuple[Array, tuple[Array, ...]]:
        """Logarithm of the posterior density after each number of readings, and :func:`_evidence`."""
        z, log_prior = self.numbers(points)
        cloud = self.family.cloud(z, self.prior, float(self.duty[-1]))
        gains, positive, *others = _evidence(cloud, self.duty, self.readings)
        log_density = np.hstack([log_prior[:, None], gains]).cumsum(axis=1)
        log_density[:, -1] += positive
        return log_density, tuple(others)

    def log_density(self, points: Array) -> Array:
        """Logarithm of the posterior density, shape (m,)."""
        return np.asarray(self.evidence(points)[0][:, -1])


@dataclass(frozen=True, slots=True, eq=False)
class _Sample:
    """M members of all proposals.

    ``mixture`` is the logarithm of the density of all proposals, and column i of ``log_density`` that of the
    posterior after i readings.
    """

    proposals: list[Proposal]
    points: Array
    mixture: Array
    log_density: Array
    evidence: list[tuple[Array, ...]]

    @classmethod
    def of(cls, proposal: Proposal, target: _Target, random: np.random.Generator) -> _Sample:
        """Members of one proposal."""
        points = proposal.points(random)
        log_density, evidence = target.evidence(points)
        return cls([proposal], points, proposal.log_density(points), log_density, [evidence])

    def added(self, proposal: Proposal, target: _Target, random: np.random.Generator) -> _Sample:
        """With those of one more proposal."""
        new = _Sample.of(proposal, target, random)
        before = log_sum(np.stack([each.log_density(new.points) for each in self.proposals]))
        of_before = np.logaddexp(self.mixture, proposal.log_density(self.points))
        return _Sample(
            [*self.proposals, proposal],
            np.vstack([self.points, new.points]),
            np.append(of_before, np.logaddexp(before, new.mixture)),
            np.vstack([self.log_density, new.log_density]),
            self.evidence + new.evidence,
        )

    @property
    def log_weight(self) -> Array:
        """Logarithm of the weights after each number of readings, shape (m, n + 1)."""
        return np.asarray(self.log_density - self.mixture[:, None])


def _sampled(target: _Target, members: int, random: np.random.Generator) -> _Sample:
    """Members of the prior, at maxima of the posterior, and near those that count, until enough of them do.

    Past forecasts need the posterior after each number of readings.
    """
    d = len(target.family.free)
    sample = _Sample.of(Proposal(np.zeros((1, d)), np.eye(d), _FIRST * members), target, random)
    starts = _starts(sample.points, sample.log_density[:, -1])
    each = max(members // len(starts), 1)
    for proposal in proposals_at_maxima(target.log_density, starts, each, steps=_STEPS):
        sample = sample.added(proposal, target, random)
    for turn in range(_MOST_ROUNDS):
        log_weight = sample.log_weight
        effective = effective_number(log_weight)
        effective[-1] /= _NEWEST
        readings = int(np.argmin(effective))
        if effective[readings] > _ENOUGH:
            break
        if turn % 2 == 0 and effective[-1] < _ENOUGH:
            readings = -1
        nearby = proposal_nearby(sample.points, log_weight[:, readings], members, effective=_EFFECTIVE)
        sample = sample.added(nearby, target, random)
    return sample


def _starts(points: Array, log_density: Array) -> Array:
    """The most probable points at a distance of each other."""
    starts = points[:0]
    for point in points[np.argsort(-log_density)]:
        if (np.linalg.norm(starts - point, axis=1) > _DISTANCE).all():
            starts = np.vstack([starts, point])
        if len(starts) == _STARTS:
            break
    return starts


def _evidence(cloud: Cloud, duty: Array, readings: Readings) -> tuple[Array, ...]:
    """Logarithms of the density of each reading given those before, and of an amplitude above 0.

    With the Cholesky factor, the innovations and dz/dx.
    """
    z, slope = _depth(cloud, readings)
    g = cloud.rate[:, None] * cloud.course(duty)
    covariance = _covariance(cloud, duty, readings, slope)
    factor, innovation, by_amplitude = _factored(covariance, z, g)
    size = np.diagonal(factor, axis1=1, axis2=2)
    gains = -0.5 * innovation**2 - np.log(size / slope)
    mean = np.sum(by_amplitude * innovation, axis=1)
    deviation = np.sqrt(np.maximum(1 - np.sum(by_amplitude**2, axis=1), 1e-9))
    return gains, log_ndtr(mean / deviation), factor, innovation, slope


def _depth(cloud: Cloud, readings: Readings) -> tuple[Array, Array]:
    """Z of each reading and −dz/dx, shape (m, n)."""
    p = cloud.exponent[:, None]
    slope = np.maximum(readings.smoothed, _LEAST_REMAINING) ** -p
    return wear_depth(readings.remaining, p), slope


def _covariance(cloud: Cloud, duty: Array, readings: Readings, slope: Array) -> Array:
    """Of the readings in z, shape (m, n, n)."""
    k = _of_course(cloud, duty, readings)
    k += readings.start**2
    if readings.warmer.any():
        warm = readings.by_kelvin * readings.warmer * slope
        k += warm[:, :, None] * warm[:, None, :]
    spread = cloud.noise[:, None] * readings.uncertainty * slope
    diagonal = np.arange(len(duty))
    k[:, diagonal, diagonal] += spread**2 + _JITTER * k[:, diagonal, diagonal]
    return np.asarray(k)


def _of_course(cloud: Cloud, duty: Array, readings: Readings) -> Array:
    """Covariance of z by amplitude and motion, shape (m, n, n)."""
    g, since = cloud.rate[:, None] * cloud.course(duty), cloud.since(duty)
    walk = ((cloud.walk * readings.typical) ** 2)[:, None, None]
    k = np.minimum(since[:, :, None], since[:, None, :])
    k *= walk
    k += g[:, :, None] * g[:, None, :]
    return np.asarray(k)


def _ahead(cloud: Cloud, duty: Array, ahead: Array, readings: Readings) -> tuple[Array, Array]:
    """Mean, and root of the covariance, of the amplitude and of z ahead, given the readings."""
    z, slope = _depth(cloud, readings)
    n, both = len(duty), np.concatenate([duty, [0.0], ahead])
    whole = _of_course(cloud, both, readings)
    whole[:, n, :] = whole[:, :, n] = cloud.rate[:, None] * cloud.course(both)
    whole[:, n, n] = 1.0
    if not readings.known_start:
        whole[:, :n, n + 1 :] += readings.start**2
        whole[:, n + 1 :, :n] += readings.start**2
        whole[:, n + 1 :, n + 1 :] += readings.start**2
    whole[:, :n, :n] = _covariance(cloud, duty, readings, slope)
    later = np.arange(n, whole.shape[1])
    whole[:, later, later] *= 1 + _JITTER
    whole[:, later, later] += (0.01 * readings.typical) ** 2
    factor, innovation = _factored(whole, np.hstack([z, np.zeros((len(z), len(later)))]))
    mean = np.einsum("mfi,mi->mf", factor[:, n:, :n], innovation[:, :n])
    return mean, factor[:, n:, n:]


def _factored(covariance: Array, *rows: Array) -> tuple[Array, ...]:
    """Cholesky factor L of m covariances, and L⁻¹ v of further rows v of shape (m, n)."""
    m, n, _ = covariance.shape
    whole = np.zeros((m, n + len(rows), n + len(rows)))
    whole[:, :n, :n] = covariance
    for k, row in enumerate(rows, start=n):
        whole[:, k, :n] = row  # the lower triangle alone is read
        whole[:, k, k] = _ANY
    factor = np.linalg.cholesky(whole)
    return factor[:, :n, :n], *(factor[:, n + k, :n] for k in range(len(rows)))


def _past_forecasts(so_far: Array, factor: Array, innovation: Array, slope: Array) -> tuple[Array, Array]:
    """Score and probability below of each reading, as forecast by the members' weights before it."""
    m, n = innovation.shape
    score, below = np.full((n, len(AHEAD)), np.nan), np.full((n, len(AHEAD)), np.nan)
    error, variance = np.zeros((m, n)), np.zeros((m, n))
    for back in range(AHEAD[-1]):
        row, known = np.arange(back, n), np.arange(n - back)
        error[:, row] += factor[:, row, known] * innovation[:, known]
        variance[:, row] += factor[:, row, known] ** 2
        if back + 1 in AHEAD:
            column, target = AHEAD.index(back + 1), np.arange(back + 1, n)
            deviation = np.sqrt(variance[:, target])
            e = error[:, target] / deviation
            log_weight = so_far[:, target - back] - log_sum(so_far[:, target - back])
            density = -0.5 * e**2 - np.log(deviation / slope[:, target])
            score[target, column] = log_sum(log_weight + density)
            below[target, column] = np.sum(np.exp(log_weight) * ndtr(e), axis=0)
    return score, below


def _above(least: Array, uniform: Array) -> Array:
    """Standard normal numbers above a bound, by the inverse of their distribution."""
    tail = np.clip(ndtr(-least) * uniform, 1e-300, 1 - 1e-12)
    return np.asarray(np.maximum(-ndtri(tail), least))
