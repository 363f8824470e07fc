"""A family of wear as a Gaussian process: evidence of its members by the readings, and paths ahead.

Given its parameters a member is a Gaussian process: an amplitude above 0 times a course, Brownian motion, and
noise. Amplitude, motion, start and effect of the temperature are the state of a Kalman filter. It gives the
density of each reading and the forecasts of it (Särkkä, *Bayesian Filtering and Smoothing*, 2013, section
4.3, DOI 10.1017/CBO9781139344203). Paths ahead are by a Cholesky factor L of the covariance: with the
innovations e = L⁻¹ z of the readings, later ones have the mean L e, and the rest of L as root of their
covariance.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_ndtr, ndtr, ndtri

from ballscrew.base.arrays import Array
from ballscrew.base.compilation import compiled
from ballscrew.base.resampling import systematic
from ballscrew.prognosis.families import Cloud, Family, remaining_part, wear_depth
from ballscrew.prognosis.readings import Readings

AHEAD = (1, 2, 4, 8)
"""Readings ahead by which a family is scored."""

_LEAST_REMAINING = 0.05  # of x, for dz/dx
_FEWEST_GAPS = 5  # between readings, before the innovations show how uneven the motion is
_DISTINCT = 192  # members of a family's paths
_JITTER = 1e-9  # of a variance, so that the Cholesky factor exists
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
        Days from that of the forecast on, and the duty up to each.
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
class MemberEvidence:
    """Evidence of m members by n readings.

    Parameters
    ----------
    gains : ndarray, shape (m, n)
        Logarithm of the density of each reading given those before.
    positive : ndarray, shape (m,)
        Logarithm of the probability of an amplitude above 0.
    innovation : ndarray, shape (m, n)
        Error of each reading as forecast from all before, over its standard deviation.
    error, density : ndarray, shape (m, n, 4)
        The same of forecasts :data:`AHEAD` readings before, and the logarithm of the density of each reading
        by them; NaN where there was no reading yet.
    """

    gains: Array
    positive: Array
    innovation: Array
    error: Array
    density: Array


def evidence_of(cloud: Cloud, duty: Array, readings: Readings) -> MemberEvidence:
    """Evidence of members by readings.

    Parameters
    ----------
    cloud : Cloud
        m members.
    duty : ndarray, shape (n,)
        Duty at each reading, days; it never falls.
    readings : Readings
        The readings.

    Returns
    -------
    MemberEvidence
        Of each member.
    """
    z, slope = _depth(cloud, readings)
    since = cloud.since(duty)
    effects = np.empty((*z.shape, 4))  # of amplitude, motion, start and temperature
    effects[:, :, 0] = cloud.rate[:, None] * cloud.course(duty)
    effects[:, :, 1], effects[:, :, 2] = 1.0, readings.start_deviation
    effects[:, :, 3] = readings.kelvin_deviation * readings.temperature * slope
    pace = (cloud.walk * readings.typical) ** 2
    motionless = effects[:, :, [0, 2, 3]]
    variance = np.sum(motionless**2, axis=2) + pace[:, None] * since
    noise = (cloud.noise[:, None] * readings.uncertainty * slope) ** 2 + _JITTER * variance
    ahead = np.array([0, *AHEAD])
    errors, deviations = np.full((2, *z.shape, len(ahead)), np.nan)
    amplitude = np.empty((2, len(z)))
    _filter(z, effects, pace[:, None] * since, noise, ahead, errors, deviations, amplitude)
    density = -0.5 * errors**2 - np.log(deviations / slope[:, :, None])
    positive = log_ndtr(amplitude[0] / np.sqrt(np.maximum(amplitude[1], 1e-9)))
    return MemberEvidence(density[:, :, 0], positive, errors[:, :, 0], errors[:, :, 1:], density[:, :, 1:])


@compiled()
def _filter(
    z: Array,
    effects: Array,
    motion: Array,
    noise: Array,
    ahead: NDArray[np.int_],
    errors: Array,
    deviations: Array,
    amplitude: Array,
) -> None:
    """Kalman filter of m members.

    Parameters
    ----------
    z, motion, noise : ndarray, shape (m, n)
        Readings, variance of the Brownian motion up to each, and of the noise.
    effects : ndarray, shape (m, n, 4)
        Of the state on each reading: of the second, the motion, 1. The others have a variance of 1 before.
    ahead : ndarray of int, shape (k,)
        Numbers of readings ahead that are forecast: first 0, each reading from those before.
    errors, deviations : ndarray, shape (m, n, k)
        Error of each forecast over its standard deviation, and that deviation; filled where there is one.
    amplitude : ndarray, shape (2, m)
        Mean and variance of the first of the state, given all readings; filled.
    """
    mean, gain, covariance = np.empty(4), np.empty(4), np.empty((4, 4))
    for member in range(z.shape[0]):
        mean[:] = 0.0
        covariance[:] = 0.0  # by a scalar: assignment of a matrix takes seconds to compile
        covariance[0, 0] = covariance[2, 2] = covariance[3, 3] = 1.0
        moved = 0.0
        for i in range(z.shape[1]):
            covariance[1, 1] += motion[member, i] - moved
            moved = motion[member, i]
            for k in range(ahead.shape[0]):
                j = i + ahead[k]
                if j >= z.shape[1]:
                    break
                expected, variance = _forecast(effects[member, j], mean, covariance, gain)
                error = z[member, j] - expected
                variance += noise[member, j] + motion[member, j] - moved
                deviation = math.sqrt(variance)
                errors[member, j, k], deviations[member, j, k] = error / deviation, deviation
                if k == 0:
                    for a in range(4):
                        mean[a] += gain[a] * error / variance
                        for b in range(4):
                            covariance[a, b] -= gain[a] * gain[b] / variance
        amplitude[0, member], amplitude[1, member] = mean[0], covariance[0, 0]


@compiled()
def _forecast(effect: Array, mean: Array, covariance: Array, gain: Array) -> tuple[float, float]:
    """Mean and variance of a reading by the state alone; ``gain`` is filled with its covariance with it."""
    expected, variance = 0.0, 0.0
    for a in range(4):
        gain[a] = 0.0
        for b in range(4):
            gain[a] += covariance[a, b] * effect[b]
        expected += effect[a] * mean[a]
        variance += effect[a] * gain[a]
    return expected, variance


def _depth(cloud: Cloud, readings: Readings) -> tuple[Array, Array]:
    """Z of each reading and −dz/dx, shape (m, n)."""
    p = cloud.exponent[:, None]
    slope = np.maximum(readings.smoothed, _LEAST_REMAINING) ** -p
    return wear_depth(readings.remaining, p), slope


def _covariance(cloud: Cloud, duty: Array, readings: Readings, slope: Array) -> Array:
    """Of the readings in z, shape (m, n, n)."""
    k = _course_covariance(cloud, duty, readings)
    k += readings.start_deviation**2
    if readings.temperature.any():
        warm = readings.kelvin_deviation * readings.temperature * slope
        k += warm[:, :, None] * warm[:, None, :]
    spread = cloud.noise[:, None] * readings.uncertainty * slope
    diagonal = np.arange(len(duty))
    k[:, diagonal, diagonal] += spread**2 + _JITTER * k[:, diagonal, diagonal]
    return np.asarray(k)


def _course_covariance(cloud: Cloud, duty: Array, readings: Readings) -> Array:
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
    whole = _course_covariance(cloud, both, readings)
    whole[:, n, :] = whole[:, :, n] = cloud.rate[:, None] * cloud.course(both)
    whole[:, n, n] = 1.0
    if not readings.known_start:
        whole[:, :n, n + 1 :] += readings.start_deviation**2
        whole[:, n + 1 :, :n] += readings.start_deviation**2
        whole[:, n + 1 :, n + 1 :] += readings.start_deviation**2
    whole[:, :n, :n] = _covariance(cloud, duty, readings, slope)
    later = np.arange(n, whole.shape[1])
    whole[:, later, later] *= 1 + _JITTER
    whole[:, later, later] += (0.01 * readings.typical) ** 2
    factor, innovation = _factored(whole, np.hstack([z, np.zeros((len(z), len(later)))]))
    mean = np.einsum("mfi,mi->mf", factor[:, n:, :n], innovation[:, :n])
    return mean, factor[:, n:, n:]


def _factored(covariance: Array, row: Array) -> tuple[Array, Array]:
    """Cholesky factor L of m covariances, and L⁻¹ v of a row v of each, shape (m, n)."""
    m, n, _ = covariance.shape
    whole = np.zeros((m, n + 1, n + 1))
    whole[:, :n, :n] = covariance
    whole[:, n, :n] = row  # the lower triangle alone is read
    whole[:, n, n] = _ANY
    factor = np.linalg.cholesky(whole)
    return factor[:, :n, :n], factor[:, n, :n]


def _above(least: Array, uniform: Array) -> Array:
    """Standard normal numbers above a bound, by the inverse of their distribution."""
    tail = np.clip(ndtr(-least) * uniform, 1e-300, 1 - 1e-12)
    return np.asarray(np.maximum(-ndtri(tail), least))
