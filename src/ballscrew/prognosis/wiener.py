"""A Wiener process in P^(1/3), whose first passage is inverse Gaussian: a reference model.

P^(1/3) falls linearly where contact pressure wears. Here it is a straight line plus Brownian motion, observed
with noise; line, diffusion and noise are maximum-likelihood estimates (Whitmore, *Estimating
degradation by a Wiener diffusion process subject to measurement error*, Lifetime Data Anal. 1, 1995,
DOI 10.1007/BF00985762). With drift v and diffusion σ the time to cross a distance d is inverse Gaussian with
mean d/v and shape d²/σ² (Chhikara and Folks, *The inverse Gaussian distribution as a lifetime model*,
Technometrics 19, 1977, 461–468). The uncertainties of the estimated drift and of the
position are propagated.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.optimize import Bounds, minimize

from ballscrew.base.arrays import Array
from ballscrew.prognosis.failure import Failure
from ballscrew.prognosis.forecast import FAN, Forecast, fan_days, reach_of
from ballscrew.prognosis.preload_history import PreloadHistory, preload_cube_root

# Of the logarithms of diffusion over noise, and of noise over stated uncertainty.
_BOUNDS = Bounds([-7.0, -3.0], [5.0, 4.0])
_MOST_RUNS = 400  # beyond it runs are thinned: the covariance is full


@dataclass(frozen=True, slots=True)
class WienerProcess:
    """Straight line plus Brownian motion in P^(1/3).

    Parameters
    ----------
    samples : int
        Number of samples of the first passage.
    seed : int
        The same seed gives the same forecast.
    """

    samples: int = 2000
    seed: int = 1

    def forecast(self, history: PreloadHistory, failure: Failure, *, at: float | None = None) -> Forecast:
        """Remaining life; parameters, result and errors as of every life model."""
        day = history.last_day if at is None else at
        t, value, spread, warmer = _thinned(*preload_cube_root(history.until(day)))
        place, covariance, diffusion = _fit(t, 1 - value, spread, warmer, day)
        random = np.random.default_rng(self.seed)
        now, drift = random.multivariate_normal(place, covariance, self.samples).T
        end = 1 - max(failure.remaining(history.approach), 0.0) ** 0.5
        lives = first_passages(end - now, drift, diffusion, random)
        reach = reach_of(day - float(history.days[0]))
        lives = np.sort(np.where(lives > reach, np.inf, lives))
        days = fan_days(lives, reach)
        walk = diffusion * random.standard_normal(self.samples)
        paths = 1 - (now + drift * days[:, None] + np.sqrt(days)[:, None] * walk)
        mode, text = failure.mode(history.approach)
        ratio = np.quantile(np.maximum(paths, 0.0) ** 3, FAN, axis=1).T
        return Forecast(day, lives, reach, mode, text, days, ratio, "Wiener process in the cube root of P")


def _thinned(*columns: Array) -> tuple[Array, ...]:
    step = math.ceil(len(columns[0]) / _MOST_RUNS)
    return tuple(column[::-1][::step][::-1] for column in columns)


def _fit(t: Array, loss: Array, spread: Array, warmer: Array, day: float) -> tuple[Array, Array, float]:
    """Position and drift on a day, their covariance, and the diffusion, by maximum likelihood."""
    columns = [np.ones_like(t), t - day]
    with_warmth = np.column_stack([*columns, warmer])
    # A temperature that only drifts in time is not separable from the wear.
    if len(t) > with_warmth.shape[1] and np.linalg.matrix_rank(with_warmth) == with_warmth.shape[1]:
        columns.append(warmer)
    design = np.column_stack(columns)
    common = np.minimum(t[:, None], t[None, :]) - t[0]
    size = float(np.median(spread))
    span = max(float(np.ptp(t)), 1.0)

    def solve(logs: Array) -> tuple[float, Array, Array, Array]:
        diffusion, noise = np.exp(2 * logs)
        whole = diffusion * size**2 / span * common + np.diag(noise * spread**2)
        root = np.linalg.cholesky(whole)
        a, b = np.linalg.solve(root, design), np.linalg.solve(root, loss)
        information = a.T @ a
        beta = np.linalg.solve(information, a.T @ b)
        residual = b - a @ beta
        value = 0.5 * residual @ residual + np.log(np.diag(root)).sum()
        return float(value), beta, np.linalg.inv(information), root

    def cost(logs: Array) -> float:
        return solve(logs)[0]

    starts = np.array([[-1.0, 0.0], [2.0, -0.5]])
    fits = [minimize(cost, start, method="L-BFGS-B", bounds=_BOUNDS) for start in starts]
    best = min(fits, key=lambda fit: float(fit.fun))
    _, beta, covariance, root = solve(best.x)
    diffusion = math.exp(best.x[0]) * size / math.sqrt(span)
    # Position of the motion on that day: the line, plus the motion's expectation given the residuals.
    shared = diffusion**2 * (np.minimum(t, day) - t[0])
    weight = np.linalg.solve(root.T, np.linalg.solve(root, shared))
    place = beta[0] + weight @ (loss - design @ beta)
    unknown = max(diffusion**2 * (day - t[0]) - weight @ shared, 0.0)
    jacobian = np.zeros((2, len(beta)))
    jacobian[0] = -(weight @ design)
    jacobian[0, 0] += 1.0
    jacobian[1, 1] = 1.0
    both = jacobian @ covariance @ jacobian.T
    both[0, 0] += unknown
    return np.array([place, beta[1]]), both, diffusion


def first_passages(distance: Array, drift: Array, diffusion: float, random: np.random.Generator) -> Array:
    """Times to cross a distance, inverse Gaussian; infinite where the drift leads away.

    Parameters
    ----------
    distance, drift : ndarray, shape (m,)
        Distance, and drift in a day; a distance of 0 or less has been crossed.
    diffusion : float
        Standard deviation after a day.
    random : Generator
        Source of the samples.

    Returns
    -------
    ndarray, shape (m,)
        Days.
    """
    towards = (drift > 0) & (distance > 0)
    lives = np.where(distance > 0, np.inf, 0.0)
    mean = distance[towards] / drift[towards]
    lives[towards] = random.wald(mean, (distance[towards] / diffusion) ** 2)
    return lives
