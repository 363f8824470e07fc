"""Check of a calibration by a sampler: the most probable point and its covariance."""

from __future__ import annotations

import importlib
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg import solve_triangular

from ballscrew.axis.axial import PARAMETERS
from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError
from ballscrew.calibration.fit import SIZE, Fit

_IMPOSSIBLE = -1e300  # log probability of impossible parameters
_MOST_SHIFT = 0.3  # of a mean, in standard uncertainties
_RATIOS = (0.8, 1.25)  # of a standard deviation, least and most


@dataclass(frozen=True, slots=True)
class SamplerCheck:
    """Samples of the posterior compared with the most probable point and its covariance.

    Parameters
    ----------
    names : tuple of str
        Of the free unknowns.
    shift : tuple of float
        Mean of the samples less the most probable value, in standard uncertainties of the calibration.
    ratio : tuple of float
        Standard deviation of the samples over that of the calibration.
    samples : int
        Number used.
    acceptance : float
        Accepted part of the steps.
    """

    names: tuple[str, ...]
    shift: tuple[float, ...]
    ratio: tuple[float, ...]
    samples: int
    acceptance: float

    @property
    def agrees(self) -> bool:
        """Whether every shift is below 0.3 and every ratio between 0.8 and 1.25."""
        low, high = _RATIOS
        ratios_agree = low < min(self.ratio, default=1.0) and max(self.ratio, default=1.0) < high
        return ratios_agree and float(np.max(np.abs(self.shift), initial=0.0)) < _MOST_SHIFT


def sample_posterior(fit: Fit, *, steps: int = 1500, seed: int = 0) -> SamplerCheck:
    """Sample the posterior with emcee's ensemble sampler, in units of the prior.

    D. Foreman-Mackey et al., DOI 10.1086/670067. Sampling θ = {a, b, c, d} itself would not converge; in
    units of the prior it does.

    Parameters
    ----------
    fit : Fit
        The calibration.
    steps : int
        Of each walker; the first third is discarded.
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
    problem = fit.problem
    lower = np.linalg.cholesky(problem.covariance)
    root = fit.directions

    def log_probability(z: Array) -> float:
        try:
            residual = problem.observed - problem.predicted(problem.unknowns(root @ z))
        except InputError:  # impossible parameters
            return _IMPOSSIBLE
        white = solve_triangular(lower, residual, lower=True)
        return -0.5 * float(white @ white + z @ z)

    size = root.shape[1]
    random = np.random.default_rng(seed)
    best = np.linalg.lstsq(root, problem.deviation(fit.unknown), rcond=None)[0]
    spread = np.linalg.cholesky(np.linalg.inv(fit.information + np.eye(size)))
    walkers = max(4 * size, 32)
    start = best + (spread @ random.normal(size=(size, walkers))).T * 0.5  # half as far as the samples
    sampler = emcee.EnsembleSampler(walkers, size, log_probability)
    sampler.random_state = np.random.RandomState(seed).get_state()
    sampler.run_mcmc(start, steps)
    deviations = sampler.get_chain(discard=steps // 3, flat=True) @ root.T
    names = [*PARAMETERS, *(f"ln ratio of group {k + 1}" for k in range(len(problem.mean) - SIZE))]
    uncertainty = np.sqrt(np.diag(fit.covariance))
    free = np.flatnonzero(uncertainty > 0)
    shift = (deviations.mean(axis=0) - problem.deviation(fit.unknown))[free] / uncertainty[free]
    ratio = deviations.std(axis=0)[free] / uncertainty[free]
    return SamplerCheck(
        names=tuple(names[k] for k in free),
        shift=tuple(shift.tolist()),
        ratio=tuple(ratio.tolist()),
        samples=len(deviations),
        acceptance=float(np.mean(sampler.acceptance_fraction)),
    )
