"""Metrics of forecasts of the remaining life, once the end is known."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError

__all__ = [
    "asymmetric_score",
    "coverage",
    "crps",
    "mass_within",
    "meets_alpha_lambda",
    "pit",
    "prognostic_horizon",
    "relative_accuracy",
    "uniformity",
]


def crps(samples: ArrayLike, truth: float, limit: float | None = None) -> float:
    """Continuous ranked probability score, ``E|X − y| − E|X − X′|/2``.

    Gneiting and Raftery, *Strictly proper scoring rules, prediction, and estimation*, J. Am. Stat. Assoc.
    102, 2007, Eq. (21), DOI 10.1198/016214506000001437. In the unit of what is forecast; for a forecast that
    is one number it is the absolute error.

    Parameters
    ----------
    samples : array_like, shape (m,)
        Equally probable; infinite ones only with a limit.
    truth : float
        What it was.
    limit : float, optional
        From which on all is one: samples and truth are cut there, so that an open forecast has a score.

    Returns
    -------
    float
        0 at best.

    Raises
    ------
    InputError
        If there is no sample, or one is no number.
    """
    x = np.sort(_samples(samples))
    y = float(truth)
    if limit is not None:
        x, y = np.minimum(x, limit), min(y, limit)
    if not (np.isfinite(x).all() and math.isfinite(y)):
        raise InputError("the score of a forecast without an end needs a limit.")
    m = len(x)
    # Σ|x_i − x_j| of ascending numbers, in one pass.
    spread = 2 * float(np.sum((2 * np.arange(1, m + 1) - m - 1) * x)) / m**2
    return float(np.mean(np.abs(x - y))) - spread / 2


def pit(samples: ArrayLike, truth: float) -> float:
    """Probability integral transform: the part of the forecast that lies below the truth.

    Dawid, *Statistical theory: the prequential approach*, J. R. Stat. Soc. A 147, 1984, DOI 10.2307/2981683.
    Even between 0 and 1 over many forecasts that are right.

    Parameters
    ----------
    samples : array_like, shape (m,)
        Equally probable; may be infinite.
    truth : float
        What it was.

    Returns
    -------
    float
        From 0 to 1; samples equal to the truth count half.

    Raises
    ------
    InputError
        If there is no sample, or one is no number.
    """
    x = _samples(samples)
    return float(np.mean(x < truth) + 0.5 * np.mean(x == truth))


def coverage(transforms: ArrayLike, level: float) -> float:
    """Part of the forecasts whose central interval of a level contains the true value.

    Parameters
    ----------
    transforms : array_like, shape (n,)
        Of :func:`pit`, one a forecast.
    level : float
        Above 0 and below 1: 0.9 for the interval from the 5 % to the 95 % quantile.

    Returns
    -------
    float
        From 0 to 1; right is the level.

    Raises
    ------
    InputError
        If there is none, or the level is no such number.
    """
    z = _samples(transforms)
    if not 0 < level < 1:
        raise InputError(f"a level of {level:g} was given; it must be above 0 and below 1.")
    return float(np.mean(np.abs(z - 0.5) <= level / 2))


def uniformity(transforms: ArrayLike) -> float:
    """The largest distance of the transforms' distribution from the even one (Kolmogorov).

    Parameters
    ----------
    transforms : array_like, shape (n,)
        Of :func:`pit`.

    Returns
    -------
    float
        From 1/2n to 1; of forecasts that are right it exceeds 1.36/√n once in twenty.

    Raises
    ------
    InputError
        If there is none.
    """
    z = np.sort(_samples(transforms))
    steps = np.arange(len(z) + 1) / len(z)
    return float(max(np.max(steps[1:] - z), np.max(z - steps[:-1])))


def mass_within(samples: ArrayLike, low: float, high: float) -> float:
    """Probability between two ends.

    Parameters
    ----------
    samples : array_like, shape (m,)
        Equally probable.
    low, high : float
        Ends, both counted in.

    Returns
    -------
    float
        From 0 to 1.

    Raises
    ------
    InputError
        If there is no sample.
    """
    x = _samples(samples)
    return float(np.mean((x >= low) & (x <= high)))


def meets_alpha_lambda(samples: ArrayLike, truth: float, alpha: float = 0.2, beta: float = 0.5) -> bool:
    """α–λ accuracy: whether at least β of the forecast lies within the true life times 1 ± α.

    Saxena, Celaya, Saha, Saha and Goebel, *Metrics for offline evaluation of prognostic performance*,
    Int. J. Progn. Health Manag. 1, 2010, DOI 10.36001/ijphm.2010.v1i1.1336. The cone narrows towards the end;
    λ, the part of the life at which it is asked, is the caller's.

    Parameters
    ----------
    samples : array_like, shape (m,)
        Remaining life, equally probable.
    truth : float
        The true remaining life.
    alpha, beta : float
        Half width of the cone, and the probability asked for.

    Returns
    -------
    bool
        Whether it does.

    Raises
    ------
    InputError
        If there is no sample.
    """
    return mass_within(samples, (1 - alpha) * truth, (1 + alpha) * truth) >= beta


def prognostic_horizon(
    days: Sequence[float],
    forecasts: Sequence[ArrayLike],
    end: float,
    alpha: float = 0.1,
    beta: float = 0.5,
) -> float:
    """How long before the end the forecast became right and stayed so.

    Saxena et al. (as :func:`meets_alpha_lambda`): right is at least β within ± α of the whole life, a band
    that does not narrow. A forecast that was right once and went wrong again does not count.

    Parameters
    ----------
    days : sequence of float
        Of the forecasts, ascending, since the life's begin.
    forecasts : sequence of array_like
        Samples of the remaining life, one set a day.
    end : float
        Day of the end.
    alpha, beta : float
        Half width as a part of the life, and the probability asked for.

    Returns
    -------
    float
        Days before the end; 0 where the last forecast was wrong.

    Raises
    ------
    InputError
        If days and forecasts differ in number.
    """
    if len(days) != len(forecasts):
        raise InputError(
            f"{len(forecasts)} forecasts were given for {len(days)} days; there must be one a day."
        )
    horizon = 0.0
    for day, samples in zip(reversed(days), reversed(forecasts), strict=True):
        remaining = end - day
        if mass_within(samples, remaining - alpha * end, remaining + alpha * end) < beta:
            break
        horizon = remaining
    return horizon


def relative_accuracy(forecast: float, truth: float) -> float:
    """Relative accuracy ``1 − |forecast − truth| / truth`` (Saxena et al., as :func:`meets_alpha_lambda`).

    Parameters
    ----------
    forecast : float
        Forecast remaining life; may be infinite.
    truth : float
        As it was; more than 0.

    Returns
    -------
    float
        1 at best; may be below 0.

    Raises
    ------
    InputError
        If the truth is not above 0.
    """
    if not truth > 0:
        raise InputError(f"a true remaining life of {truth:g} was given; it must be more than 0.")
    return 1 - abs(forecast - truth) / truth


def asymmetric_score(forecast: float, truth: float) -> float:
    """The score of the PHM 2008 challenge: late costs more than early.

    e^(−d/13) − 1 for d < 0, e^(d/10) − 1 else, d = forecast − truth. Saxena, Goebel, Simon and Eklund,
    *Damage propagation modeling for aircraft engine run-to-failure simulation*, PHM 2008,
    DOI 10.1109/PHM.2008.4711414. Made for lives of some hundred cycles; here the unit is the day.

    Parameters
    ----------
    forecast, truth : float
        Remaining life, days; ``forecast`` may be infinite.

    Returns
    -------
    float
        0 at best; infinite where a late forecast is too late for numbers.
    """
    late = forecast - truth
    exponent = late / 10 if late >= 0 else -late / 13
    return math.expm1(exponent) if exponent < 700 else math.inf


def _samples(values: ArrayLike) -> Array:
    x = np.ravel(np.asarray(values, dtype=np.float64))
    if not len(x) or np.isnan(x).any():
        raise InputError("a forecast has no samples, or one that is no number.")
    return x
