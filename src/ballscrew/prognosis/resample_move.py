"""Resample-move particle filter for constant parameters: weight, resample, move.

The state of a life follows from its parameters by a law; the filter is of the parameters. A filter that only
resampled them would soon retain a few copies, and artificial noise would widen the posterior. So after each
resampling every particle is moved by Markov steps that leave the posterior invariant (Gilks and Berzuini,
*Following a moving target*, J. R. Stat. Soc. B 63, 2001, DOI 10.1111/1467-9868.00280; Chopin, *A sequential
particle filter method for static models*, Biometrika 89, 2002, DOI 10.1093/biomet/89.3.539). A run that is
too informative for the particles is introduced in parts, as powers of its likelihood.

The steps leave the Gaussian of the particles themselves invariant (preconditioned Crank-Nicolson: Cotter,
Roberts, Stuart and White, Statist. Sci. 28, 2013, DOI 10.1214/13-STS421): where the posterior is nearly that,
a step may be as long as the posterior is wide.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from ballscrew.base.arrays import Array
from ballscrew.base.resampling import systematic

Likelihood = Callable[[Array, int, int], Array]
Density = Callable[[Array], Array]
_LEAST_EFFECTIVE = 0.5  # effective part of the particles below which they are resampled
_LEAST_POWER = 1e-3  # of the likelihood, by which tempering proceeds at least
_LENGTHS = np.array([0.95, 0.8, 0.5])  # of a step: 1 is independent of where it began
_REFIT = 4  # steps after which the particles' Gaussian is estimated again
_ENOUGH = 0.5  # accepted steps per particle, in the mean, before moving ends
_LONGER = 4  # times the requested moves, at most
_SETTLING = 5  # times the requested moves, before particles are returned
_SETTLED = 2.0  # accepted steps per particle by then, in the mean


def filtered(
    likelihood: Likelihood,
    dimensions: int,
    marks: Sequence[int],
    particles: int,
    moves: int,
    seed: int,
) -> Iterator[Array]:
    """Posterior from run to run; before the first run every number is standard normal.

    Parameters
    ----------
    likelihood : callable
        From particles (m, dimensions) and runs i to j to log-likelihoods (m, j − i).
    dimensions : int
        Number of parameters of a particle.
    marks : sequence of int
        Numbers of runs after which the particles are returned, ascending.
    particles, moves : int
        Number of particles, and of Markov steps after each resampling.
    seed : int
        The same seed gives the same numbers.

    Yields
    ------
    ndarray, shape (particles, dimensions)
        One set per mark, all equally probable.
    """
    random = np.random.default_rng(seed)
    z = random.standard_normal((particles, dimensions))
    weight = np.zeros(particles)  # logarithms
    done, power = 0, 0.0  # runs that are fully included, and the power of the next one's likelihood
    for mark in marks:
        while done < mark:
            gains = likelihood(z, done, mark)
            gains[:, 0] *= 1 - power
            weights = weight[:, None] + np.cumsum(gains, axis=1)
            enough = _effective(weights) >= _LEAST_EFFECTIVE * particles
            steps = int(np.argmin(np.append(enough, False)))
            if steps:
                weight, done, power = weights[:, steps - 1], done + steps, 0.0
            if done == mark:
                break
            # The next run is too informative: include the power of it that leaves half of the particles.
            gain = gains[:, steps]
            added = _largest_power(weight, gain)
            power += added * (1 - power)
            weight = weight + added * gain
            if power > 1 - 1e-9:
                done, power = done + 1, 0.0
            z = z[systematic(_normalised(weight), random.uniform())]
            weight = np.zeros(particles)
            z = _move(z, _posterior(likelihood, done, power), moves, random)
        # The result must not depend on the path: the particles settle before they are returned.
        z, weight = z[systematic(_normalised(weight), random.uniform())], np.zeros(particles)
        z = _move(z, _posterior(likelihood, done, power), _SETTLING * moves, random, _SETTLED)
        yield z


def tempered(
    likelihood: Likelihood, dimensions: int, runs: int, particles: int, moves: int, seed: int
) -> Array:
    """Posterior from all runs at once, by tempering: the power of their likelihood grows from 0 to 1.

    A filter from run to run retains few particles where the posterior was small for long; tempering starts
    from the whole prior (Del Moral, Doucet and Jasra, *Sequential Monte Carlo samplers*, J. R. Stat. Soc. B
    68, 2006, DOI 10.1111/j.1467-9868.2006.00553.x).

    Parameters
    ----------
    likelihood, dimensions, particles, moves, seed
        As of :func:`filtered`.
    runs : int
        Number of runs.

    Returns
    -------
    ndarray, shape (particles, dimensions)
        As :func:`filtered` yields them.
    """
    random = np.random.default_rng(seed)
    z = random.standard_normal((particles, dimensions))
    power = 0.0
    while power < 1:
        gain = likelihood(z, 0, runs).sum(axis=1)
        before = power
        largest = _largest_power(np.zeros(particles), (1 - power) * gain)
        power += (1 - power) * max(largest, _LEAST_POWER)
        if power > 1 - _LEAST_POWER:
            power = 1.0
        z = z[systematic(_normalised((power - before) * gain), random.uniform())]
        z = _move(z, _tempered_posterior(likelihood, runs, power), moves, random)
    return _move(z, _posterior(likelihood, runs, 0.0), _SETTLING * moves, random, _SETTLED)


def _posterior(likelihood: Likelihood, runs: int, power: float) -> Density:
    """Log posterior of some runs, and of a power of the likelihood of the next one."""
    partial = power > 0

    def density(points: Array) -> Array:
        gains = likelihood(points, 0, runs + partial)
        if partial:
            gains[:, -1] *= power
        return np.asarray(gains.sum(axis=1) - 0.5 * (points**2).sum(axis=1))

    return density


def _tempered_posterior(likelihood: Likelihood, runs: int, power: float) -> Density:
    """Log posterior of all runs with a power of their likelihood."""

    def density(points: Array) -> Array:
        gains = power * likelihood(points, 0, runs)
        return np.asarray(gains.sum(axis=1) - 0.5 * (points**2).sum(axis=1))

    return density


def _normalised(logarithms: Array) -> Array:
    weight = np.exp(logarithms - logarithms.max())
    return np.asarray(weight / weight.sum())


def _effective(logarithms: Array) -> Array:
    """Effective number of particles of each column of log-weights."""
    weight = np.exp(logarithms - logarithms.max(axis=0))
    return np.asarray(weight.sum(axis=0) ** 2 / (weight**2).sum(axis=0))


def _largest_power(weight: Array, gain: Array) -> float:
    """Largest power of a likelihood that leaves half of the particles effective, by bisection."""
    least = _LEAST_EFFECTIVE * len(weight)
    if _effective((weight + gain)[:, None])[0] >= least:
        return 1.0
    low, high = 0.0, 1.0
    for _ in range(30):
        middle = (low + high) / 2
        if _effective((weight + middle * gain)[:, None])[0] >= least:
            low = middle
        else:
            high = middle
    return max(low, 1e-6)


def _move(
    z: Array, density: Density, moves: int, random: np.random.Generator, enough: float = _ENOUGH
) -> Array:
    """Metropolis steps about the particles' own Gaussian, until enough of them are accepted."""
    now = density(z)
    accepted = 0.0
    for step in range(_LONGER * moves):
        if step >= moves and accepted >= enough:
            break
        if step % _REFIT == 0:
            mean, root = z.mean(axis=0), _root(z)
            inverse = np.linalg.inv(root)
        length = _LENGTHS[random.integers(len(_LENGTHS), size=(len(z), 1))]
        old = z - mean
        new = np.sqrt(1 - length**2) * old + length * (random.standard_normal(z.shape) @ root)
        then = density(mean + new)
        # The step leaves the Gaussian invariant: only the density relative to it decides.
        gaussian = 0.5 * (((new @ inverse) ** 2).sum(axis=1) - ((old @ inverse) ** 2).sum(axis=1))
        accept = np.log(random.uniform(size=len(z))) < then - now + gaussian
        z, now = np.where(accept[:, None], mean + new, z), np.where(accept, then, now)
        accepted += float(accept.mean())
    return z


def _root(z: Array) -> Array:
    """Matrix root of the particles' covariance."""
    size, axes = np.linalg.eigh(np.cov(z.T) + 1e-8 * np.eye(z.shape[1]))
    return np.asarray((axes * np.sqrt(np.maximum(size, 1e-12))).T)
