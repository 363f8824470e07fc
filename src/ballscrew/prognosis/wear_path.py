"""The laws of :mod:`ballscrew.axis.wear` with any exponent, in closed form, for many lives at once.

With x = 1 − w/δ₀ the remaining part of the flanks' approach, P = P₀ x^1.5, and wear after Archard

    −dx/dS = max(x^p, f),    p = 1.5 n,

where S is the travel in parts of δ₀ at the rate when new: p = 0 is a constant outer load, 0.5 the contact
pressure of the preload, 1 the exponential law, 1.5 the preload itself. f = (F/P₀)ⁿ / 2 is the wear under the
nut load F alone: from there on backlash grows evenly. The pace is that of a relaxing rate,

    dS/dt = r (1 + a e^(−t/τ)),

a > 0 for running-in, a < 0 for grease that is spent.
"""

from __future__ import annotations

import numpy as np

from ballscrew.base.arrays import Array

_LOGARITHMIC = 1e-5  # of |1 − p|: nearer to p = 1 the law is a logarithm
LAW_EXPONENTS = {"external-load": 0.0, "contact-pressure": 0.5, "exponential": 1.0, "preload": 1.5}
"""p of each law of travel."""


def worn_time(days: Array, relaxing: Array, relaxation: Array) -> Array:
    """∫ (1 + a e^(−t/τ)) dt from 0; 0 before.

    Parameters
    ----------
    days : ndarray
        t, since wear began.
    relaxing, relaxation : ndarray
        a, more than −1, and τ, days; shapes that broadcast.

    Returns
    -------
    ndarray
        Days of unit rate.
    """
    t = np.maximum(days, 0.0)
    return np.asarray(t - relaxing * relaxation * np.expm1(-t / relaxation))


def day_of(worn: Array, relaxing: Array, relaxation: Array) -> Array:
    """Inverse of :func:`worn_time`, by Newton's method with bisection.

    Parameters
    ----------
    worn : ndarray
        Days of unit rate, 0 or more; may be infinite.
    relaxing, relaxation : ndarray
        As in :func:`worn_time`.

    Returns
    -------
    ndarray
        Days since wear began.
    """
    finite = np.isfinite(worn)
    goal = np.where(finite, worn, 1.0)
    low, high = goal / (1 + np.maximum(relaxing, 0)), goal / (1 + np.minimum(relaxing, 0))
    t = np.clip(goal - relaxing * relaxation, low, high)
    for _ in range(30):
        error = worn_time(t, relaxing, relaxation) - goal
        low, high = np.where(error < 0, t, low), np.where(error > 0, t, high)
        step = t - error / (1 + relaxing * np.exp(-t / relaxation))
        t = np.where((step < low) | (step > high), (low + high) / 2, step)
    return np.asarray(np.where(finite, t, np.inf))


def remaining_after(travel: Array, exponent: Array, load: Array) -> Array:
    """Remaining part x of the flanks' approach after the travel S.

    Parameters
    ----------
    travel : ndarray
        S, 0 or more.
    exponent : ndarray
        p, 0 to 1.5 or so.
    load : ndarray
        F/P₀ of the duty's nut load, above 0.

    Returns
    -------
    ndarray
        1 when new, 0 where the preload is gone, below 0 where there is backlash −2 δ₀ x.
    """
    q = _complement(exponent)
    last, end, floor = _load_alone(exponent, q, load)
    s = np.minimum(travel, end)
    preloaded = np.exp(np.log(np.maximum(1 - q * s, 1e-300)) / q)
    return np.asarray(np.where(travel < end, preloaded, last - floor * (travel - s)))


def travel_until(remaining: Array | float, exponent: Array, load: Array) -> Array:
    """Travel S until x remains: the inverse of :func:`remaining_after`.

    Parameters
    ----------
    remaining : ndarray or float
        x, 1 or less.
    exponent, load : ndarray
        As in :func:`remaining_after`.

    Returns
    -------
    ndarray
        0 for a life that has failed when new.
    """
    q = _complement(exponent)
    last, end, floor = _load_alone(exponent, q, load)
    above = (1 - np.maximum(remaining, np.maximum(last, 1e-12)) ** q) / q
    return np.asarray(np.where(np.asarray(remaining) > last, above, end + (last - remaining) / floor))


def named_laws(exponent: Array) -> dict[str, float]:
    """Probability of each named law, by the law nearest to each life's exponent.

    Parameters
    ----------
    exponent : ndarray, shape (m,)
        p of equally probable lives.

    Returns
    -------
    dict
        Name to probability, in the order of p.
    """
    nearest = np.argmin(np.abs(exponent[:, None] - list(LAW_EXPONENTS.values())), axis=1)
    count = np.bincount(nearest, minlength=len(LAW_EXPONENTS)) / max(len(exponent), 1)
    return dict(zip(LAW_EXPONENTS, count.tolist(), strict=True))


def _complement(exponent: Array) -> Array:
    """1 − p, bounded away from 0: there the law is a logarithm, which this close to it is the same."""
    q = 1 - np.asarray(exponent, dtype=np.float64)
    return np.asarray(np.where(np.abs(q) < _LOGARITHMIC, _LOGARITHMIC, q))


def _load_alone(exponent: Array, q: Array, load: Array) -> tuple[Array, Array, Array]:
    """Remaining part x from which on the nut load alone wears, the travel S there, and the rate beyond it."""
    p = np.maximum(exponent, 0.0)
    floor = np.where(p > 0, 0.5 * load ** (p / 1.5), 1.0)
    last = np.where(p > 0, np.minimum(floor, 1.0) ** (1 / np.maximum(p, 1e-3)), 0.0)
    last = np.minimum(last, 1 - 1e-9)
    end = (1 - np.maximum(last, 1e-12) ** q) / q
    return last, end, floor
