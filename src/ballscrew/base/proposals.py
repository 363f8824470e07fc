"""Proposals of importance sampling, by the maxima of a density and by weighted points of it.

They are Student's t distributions: with normal ones a member in the tail has a weight above that of all
others together.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ballscrew.base.arrays import Array
from ballscrew.base.resampling import systematic

_FREEDOM = 5.0  # degrees of freedom
_PLACES, _NEARBY = 16, 0.4  # of a proposal, and variance at each over that of the points
_WIDER = 1.5  # variance of a proposal over that by the curvature
_FIRST_PRECISION = 4.0  # in each direction
_LEAST_PRECISION = 0.5  # of a normal distribution in its widest direction
_DIFFERENCE = 0.4  # of a standard deviation
_LONGEST = 1.5  # step
_PARTS = np.array([2.0, 1.0, 0.5, 0.2, 0.05])  # of a step that are tried
_LEAST_VARIANCE = 1e-5  # of an adapted distribution
_LEAST_POWER = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class Proposal:
    """Mixture of Student's t distributions of one covariance, of each of which some points are taken.

    Parameters
    ----------
    places : ndarray, shape (k, d)
        Their means.
    root : ndarray, shape (d, d)
        Cholesky factor of the covariance of their core.
    each : int
        Number of points of each.
    """

    places: Array
    root: Array
    each: int

    def points(self, random: np.random.Generator) -> Array:
        """Points, shape (k each, d)."""
        count = self.each * len(self.places)
        normal = random.standard_normal((count, self.places.shape[1]))
        spread = np.sqrt(_FREEDOM / random.chisquare(_FREEDOM, count))
        return np.asarray(np.repeat(self.places, self.each, axis=0) + spread[:, None] * normal @ self.root.T)

    def log_density(self, points: Array) -> Array:
        """Logarithm of their densities times numbers at points of shape (m, d), without a common factor."""
        d = points.shape[1]
        off = points[None, :, :] - self.places[:, None, :]
        e = off @ np.linalg.inv(self.root).T
        tails = 0.5 * (_FREEDOM + d) * np.log1p((e**2).sum(axis=2) / _FREEDOM)
        return np.asarray(np.log(self.each) + log_sum(-tails) - np.log(np.diag(self.root)).sum())


def log_sum(values: Array, axis: int = 0) -> Array:
    """Logarithm of the sum of exponentials."""
    most = values.max(axis=axis, keepdims=True)
    total = np.log(np.exp(values - most).sum(axis=axis, keepdims=True)) + most
    return np.asarray(total.squeeze(axis))


def effective_number(log_weight: Array) -> Array:
    """Number of points of equal weight that are as precise as m weighted ones, shape (m,) or (m, k)."""
    weight = np.exp(log_weight - log_sum(log_weight))
    return np.asarray(1 / (weight**2).sum(axis=0))


def proposal_nearby(points: Array, log_weight: Array, count: int, *, effective: float) -> Proposal:
    """Proposal that follows weighted points, also where they lie on a curve.

    Parameters
    ----------
    points : ndarray, shape (m, d)
        The points.
    log_weight : ndarray, shape (m,)
        Logarithm of their weights, to any constant; it is reduced in proportion until enough points count.
    count : int
        Number of new points; it is rounded down to a multiple of sixteen.
    effective : float
        Points that count, at least.

    Returns
    -------
    Proposal
        At sixteen of the points, with part of their covariance.
    """
    power = 1.0
    while power > _LEAST_POWER and effective_number(power * log_weight) < effective:
        power *= 0.8
    weight = np.exp(power * log_weight - log_sum(power * log_weight))
    off = points - weight @ points
    covariance = _NEARBY * (weight[:, None] * off).T @ off + _LEAST_VARIANCE * np.eye(off.shape[1])
    chosen = points[systematic(weight, 0.5, _PLACES)]
    root = np.asarray(np.linalg.cholesky(covariance), dtype=np.float64)
    return Proposal(chosen, root, max(count // _PLACES, 1))


def proposals_at_maxima(
    log_density: Callable[[Array], Array], starts: Array, each: int, *, steps: int
) -> list[Proposal]:
    """Proposals with the curvature of a density at its maxima (Laplace's approximation), by Newton's method.

    Derivatives are differences over a part of the standard deviation in each direction, so the density may
    have kinks that are small relative to it. All starts are followed at once.

    Parameters
    ----------
    log_density : callable
        Logarithm of the density at points of shape (m, d), to any constant; in coordinates in which no
        standard deviation is much above 1.
    starts : ndarray, shape (k, d)
        Points from which a maximum is sought; several may lead to the same.
    each : int
        Number of points of each proposal.
    steps : int
        Steps of Newton's method.

    Returns
    -------
    list of Proposal
        At k places.
    """
    place, height = starts, log_density(starts)
    k, d = starts.shape
    precision = np.tile(_FIRST_PRECISION * np.eye(d), (k, 1, 1))
    for _ in range(steps):
        size = _DIFFERENCE / np.sqrt(np.maximum(np.diagonal(precision, axis1=1, axis2=2), 1.0))
        moves = _moves(size)
        value = _values(log_density, place[:, None] + moves)
        slope, precision = _derivatives(height, value, size)
        step = np.einsum("kij,kj->ki", np.linalg.inv(precision), slope)
        step *= np.minimum(1.0, _LONGEST / np.maximum(np.linalg.norm(step, axis=1, keepdims=True), 1e-9))
        tried = _PARTS[:, None] * step[:, None]
        value = np.hstack([height[:, None], value, _values(log_density, place[:, None] + tried)])
        moves = np.concatenate([np.zeros((k, 1, d)), moves, tried], axis=1)
        rows, best = np.arange(k), np.argmax(value, axis=1)
        place, height = place + moves[rows, best], value[rows, best]
    roots = np.linalg.cholesky(_WIDER * np.linalg.inv(precision))
    return [Proposal(mean[None], root, each) for mean, root in zip(place, roots, strict=True)]


def _moves(size: Array) -> Array:
    """Up and down in each of d directions, and up in each pair, shape (k, 2 d + pairs, d)."""
    shift = size[:, :, None] * np.eye(size.shape[1])
    first, second = np.triu_indices(size.shape[1], 1)
    return np.concatenate([shift, -shift, shift[:, first] + shift[:, second]], axis=1)


def _derivatives(height: Array, value: Array, size: Array) -> tuple[Array, Array]:
    """Slope, and second derivatives with the sign of a precision; positive definite also in a saddle."""
    k, d = size.shape
    first, second = np.triu_indices(d, 1)
    up, down, both = value[:, :d], value[:, d : 2 * d], value[:, 2 * d :]
    bent = np.zeros((k, d, d))
    bent[:, np.arange(d), np.arange(d)] = (2 * height[:, None] - up - down) / size**2
    mixed = (up[:, first] + up[:, second] - both - height[:, None]) / size[:, first] / size[:, second]
    bent[:, first, second] = bent[:, second, first] = mixed
    curvature, axes = np.linalg.eigh(bent)
    curvature = np.maximum(np.abs(curvature), _LEAST_PRECISION)
    return (up - down) / 2 / size, axes * curvature[:, None, :] @ axes.transpose(0, 2, 1)


def _values(log_density: Callable[[Array], Array], points: Array) -> Array:
    """Logarithm of a density at points of shape (k, n, d)."""
    k, n, d = points.shape
    return np.asarray(log_density(points.reshape(k * n, d)).reshape(k, n))
