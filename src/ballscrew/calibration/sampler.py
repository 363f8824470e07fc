"""A sampler as a check on a calibration: whether the most probable point and its covariance are right."""

from __future__ import annotations

import importlib
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg import solve_triangular

from ballscrew.axis.axial import PARAMETERS
from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError
from ballscrew.calibration.fit import FULL, Fit, Problem

__all__ = ["SamplerCheck", "sample_posterior"]


_FAR = -1e300


@dataclass(frozen=True, slots=True)
class SamplerCheck:
    """What the sampler found, against the most probable point.

    Parameters
    ----------
    names : tuple of str
        Of the unknowns that are free.
    shift : tuple of float
        Sampled mean less the most probable value, in standard uncertainties of the calibration.
    ratio : tuple of float
        Sampled standard deviation over that of the calibration.
    samples : int
        Kept.
    acceptance : float
        Part of the steps taken.
    """

    names: tuple[str, ...]
    shift: tuple[float, ...]
    ratio: tuple[float, ...]
    samples: int
    acceptance: float

    @property
    def agrees(self) -> bool:
        """Whether no shift is above 0.3 and no ratio off by more than 25 %."""
        return all(abs(s) < 0.3 for s in self.shift) and all(0.8 < r < 1.25 for r in self.ratio)


def sample_posterior(problem: Problem, fit: Fit, *, steps: int = 1500, seed: int = 0) -> SamplerCheck:
    """Draw from the posterior with emcee's ensemble sampler, in units of the prior.

    D. Foreman-Mackey et al., DOI 10.1086/670067. Sampling θ = {a, b, c, d} as it stands would not come to
    rest; in units of the prior it does.

    Parameters
    ----------
    problem, fit
        What was fitted, and how.
    steps : int
        Of each walker; the first third is thrown away.
    seed : int
        The same seed gives the same samples.

    Returns
    -------
    SamplerCheck
        The comparison.

    Raises
    ------
    InputError
        If emcee is not installed.
    """
    try:
        emcee: Any = importlib.import_module("emcee")
    except ImportError:
        raise InputError(
            '--sample needs the package emcee, which is not installed: pip install "ballscrew[sample]", or '
            "leave it out; the model is the same."
        ) from None
    lower = np.linalg.cholesky(problem.covariance)
    fixed = ~np.isfinite(problem.mean)
    mean, half = np.where(fixed, 0.0, problem.mean), fit.directions

    def log_probability(z: Array) -> float:
        unknown = np.where(fixed, problem.mean, mean + half @ z)
        try:
            white = solve_triangular(lower, problem.told - problem.predicted(unknown), lower=True)
        except InputError:  # no such axis
            return _FAR
        return -0.5 * float(white @ white + z @ z)

    size = half.shape[1]
    random = np.random.default_rng(seed)
    best = np.linalg.lstsq(half, np.where(fixed, 0.0, fit.unknown) - mean, rcond=None)[0]
    spread = np.linalg.cholesky(np.linalg.inv(fit.information + np.eye(size)))
    walkers = max(4 * size, 32)
    start = best + (spread @ random.normal(size=(size, walkers))).T * 0.5
    sampler = emcee.EnsembleSampler(walkers, size, log_probability)
    sampler.random_state = np.random.RandomState(seed).get_state()
    sampler.run_mcmc(start, steps)
    drawn = sampler.get_chain(discard=steps // 3, flat=True) @ half.T + mean
    names = [*PARAMETERS, *(f"ln ratio of group {k + 1}" for k in range(len(mean) - FULL))]
    sd = np.sqrt(np.diag(fit.covariance))
    free = [k for k in range(len(mean)) if sd[k] > 0]
    return SamplerCheck(
        names=tuple(names[k] for k in free),
        shift=tuple(float((drawn[:, k].mean() - fit.unknown[k]) / sd[k]) for k in free),
        ratio=tuple(float(drawn[:, k].std() / sd[k]) for k in free),
        samples=len(drawn),
        acceptance=float(np.mean(sampler.acceptance_fraction)),
    )
