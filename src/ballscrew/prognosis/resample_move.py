"""A particle filter for numbers that do not change: weigh, resample, move.

The state of a life follows from its numbers by a law; what is filtered are the numbers. A filter that only
resampled them would soon have a few copies left, and one that jitters them forgets what it knew. So after
each resampling every particle is moved by Markov steps that leave its posterior as it is (Gilks and Berzuini,
*Following a moving target*, J. R. Stat. Soc. B 63, 2001, DOI 10.1111/1467-9868.00280; Chopin, *A sequential
particle filter method for static models*, Biometrika 89, 2002, DOI 10.1093/biomet/89.3.539). A run that says
too much at once is let in by parts.

The steps hold on to the Gaussian of the particles themselves (preconditioned Crank-Nicolson: Cotter, Roberts,
Stuart and White, Statist. Sci. 28, 2013, DOI 10.1214/13-STS421): where the posterior is nearly that, a step
may be as long as the posterior is wide.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from ballscrew.base.arrays import Array
from ballscrew.base.resampling import systematic

__all__ = ["filtered", "tempered"]

Likelihood = Callable[[Array, int, int], Array]
_KEPT = 0.5  # of the particles, in effect, below which they are resampled
_LEAST_PART = 1e-3  # of what is still to be let in
_LENGTHS = (0.95, 0.8, 0.5)  # of a step: 1 forgets where it began
_ANEW = 4  # steps after which the particles' Gaussian is told anew
_ENOUGH = 0.5  # steps that a particle has taken, in the mean, before moving ends
_LONGER = 4  # times the moves asked for, at most
_SETTLING = 5  # times the moves asked for, before particles are given out
_SETTLED = 2.0  # steps that a particle has taken by then, in the mean


def filtered(
    likelihood: Likelihood,
    dimensions: int,
    marks: Sequence[int],
    particles: int,
    moves: int,
    seed: int,
) -> Iterator[Array]:
    """Follow a posterior from run to run; before the first run every number is standard normal.

    Parameters
    ----------
    likelihood : callable
        Of particles (m, dimensions) and runs from i to j: logarithms, shape (m, j − i).
    dimensions : int
        Numbers of a particle.
    marks : sequence of int
        Numbers of runs after which the particles are given out, ascending.
    particles, moves : int
        How many, and how many Markov steps after each resampling.
    seed : int
        The same seed gives the same numbers.

    Yields
    ------
    ndarray, shape (particles, dimensions)
        One set a mark, all equally probable.
    """
    random = np.random.default_rng(seed)
    z = random.standard_normal((particles, dimensions))
    weight = np.zeros(particles)  # logarithms
    done, part = 0, 0.0  # runs that are wholly in, and how much of the next is
    for mark in marks:
        while done < mark:
            gains = likelihood(z, done, mark)
            gains[:, 0] *= 1 - part
            paths = weight[:, None] + np.cumsum(gains, axis=1)
            good = _effective(paths) >= _KEPT * particles
            steps = mark - done if good.all() else int(np.argmin(good))
            if steps:
                weight, done, part = paths[:, steps - 1], done + steps, 0.0
            if done == mark:
                break
            # The next run says too much at once: let in what leaves half of the particles.
            said = gains[:, steps]
            added = _share(weight, said, particles)
            part += added * (1 - part)
            weight = weight + added * said
            if part > 1 - 1e-9:
                done, part = done + 1, 0.0
            z = z[systematic(_normed(weight), random.uniform())]
            weight = np.zeros(particles)
            z = _moved(z, likelihood, done, part, moves, random)
        # All filters of these runs should tell the same: what happened on the way must be forgotten.
        z, weight = z[systematic(_normed(weight), random.uniform())], np.zeros(particles)
        z = _moved(z, likelihood, done, part, _SETTLING * moves, random, _SETTLED)
        yield z


def tempered(
    likelihood: Likelihood, dimensions: int, runs: int, particles: int, moves: int, seed: int
) -> Array:
    """Find a posterior from all runs at once: let them in together, a little more at a time.

    A filter that goes from run to run has few particles left near what it thought improbable for long. From
    the prior on, all of it is still there (Del Moral, Doucet and Jasra, *Sequential Monte Carlo samplers*, J.
    R. Stat. Soc. B 68, 2006, DOI 10.1111/j.1467-9868.2006.00553.x).

    Parameters
    ----------
    likelihood, dimensions, particles, moves, seed
        As of :func:`filtered`.
    runs : int
        How many there are.

    Returns
    -------
    ndarray, shape (particles, dimensions)
        As :func:`filtered` yields them.
    """
    random = np.random.default_rng(seed)
    z = random.standard_normal((particles, dimensions))
    part = 0.0
    while part < 1:
        said = likelihood(z, 0, runs).sum(axis=1)
        rest = (1 - part) * said
        before = part
        part += (1 - part) * max(_share(np.zeros(particles), rest, particles), _LEAST_PART)
        part = 1.0 if part > 1 - _LEAST_PART else part
        z = z[systematic(_normed((part - before) * said), random.uniform())]
        z = _moved(z, _softened(likelihood, part), runs, 0.0, moves, random)
    return _moved(z, likelihood, runs, 0.0, _SETTLING * moves, random, _SETTLED)


def _softened(likelihood: Likelihood, part: float) -> Likelihood:
    return lambda points, start, stop: part * likelihood(points, start, stop)


def _normed(logarithms: Array) -> Array:
    weight = np.exp(logarithms - logarithms.max())
    return np.asarray(weight / weight.sum())


def _effective(paths: Array) -> Array:
    weight = np.exp(paths - paths.max(axis=0))
    return np.asarray(weight.sum(axis=0) ** 2 / (weight**2).sum(axis=0))


def _share(weight: Array, said: Array, particles: int) -> float:
    """The part of a run's logarithm that leaves half of the particles in effect."""
    low, high = 0.0, 1.0
    if _effective((weight + said)[:, None])[0] >= _KEPT * particles:
        return 1.0
    for _ in range(30):
        middle = (low + high) / 2
        enough = _effective((weight + middle * said)[:, None])[0] >= _KEPT * particles
        low, high = (middle, high) if enough else (low, middle)
    return max(low, 1e-6)


def _moved(
    z: Array,
    likelihood: Likelihood,
    done: int,
    part: float,
    moves: int,
    random: np.random.Generator,
    enough: float = _ENOUGH,
) -> Array:
    """Metropolis steps that hold on to the particles' own Gaussian; they go on until enough are taken."""
    last = done + (1 if part > 0 else 0)

    def target(points: Array) -> Array:
        each = likelihood(points, 0, last)
        if part > 0:
            each[:, -1] *= part
        return np.asarray(each.sum(axis=1) - 0.5 * (points**2).sum(axis=1))

    now = target(z)
    went = 0.0
    for step in range(_LONGER * moves):
        if step >= moves and went >= enough:
            break
        if step % _ANEW == 0:
            middle, root = z.mean(axis=0), _root(z)
            back = np.linalg.inv(root)
        length = np.asarray(_LENGTHS)[random.integers(len(_LENGTHS), size=(len(z), 1))]
        off = z - middle
        tried = np.sqrt(1 - length**2) * off + length * (random.standard_normal(z.shape) @ root)
        then = target(middle + tried)
        # By itself the step would leave the Gaussian as it is: only what the target is beside it decides.
        beside = 0.5 * (((tried @ back) ** 2).sum(axis=1) - ((off @ back) ** 2).sum(axis=1))
        taken = np.log(random.uniform(size=len(z))) < then - now + beside
        z, now = np.where(taken[:, None], middle + tried, z), np.where(taken, then, now)
        went += float(taken.mean())
    return z


def _root(z: Array) -> Array:
    size, axes = np.linalg.eigh(np.cov(z.T) + 1e-8 * np.eye(z.shape[1]))
    return np.asarray((axes * np.sqrt(np.maximum(size, 1e-12))).T)
