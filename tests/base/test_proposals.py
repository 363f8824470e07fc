"""Proposals of importance sampling: maxima of known densities, adapted clouds, tails."""

from __future__ import annotations

import math

import numpy as np
import pytest

from ballscrew.base.proposals import (
    Proposal,
    effective_number,
    log_sum,
    proposal_nearby,
    proposals_at_maxima,
)

MEAN = np.array([0.7, -1.2, 0.3])
COVARIANCE = np.array([[0.5, 0.3, 0.0], [0.3, 0.4, 0.0], [0.0, 0.0, 1e-4]])


def log_normal(points: np.ndarray) -> np.ndarray:
    off = points - MEAN
    return np.asarray(-0.5 * np.einsum("mi,ij,mj->m", off, np.linalg.inv(COVARIANCE), off))


def test_the_maximum_of_a_normal_density_has_its_covariance() -> None:
    """Standard deviations of 0.01 and 0.7, of which nothing is known at the start."""
    starts = np.array([[0.0, 0.0, 0.0], [2.0, 1.0, -1.0]])
    found = proposals_at_maxima(log_normal, starts, 8, steps=8)
    assert [proposal.each for proposal in found] == [8, 8]
    for proposal in found:
        assert proposal.places[0] == pytest.approx(MEAN, abs=1e-3)
        assert proposal.root @ proposal.root.T == pytest.approx(1.5 * COVARIANCE, rel=1e-3, abs=1e-6)


def test_each_start_leads_to_its_own_maximum() -> None:
    def two(points: np.ndarray) -> np.ndarray:
        return np.asarray(-np.abs(points[:, 0] ** 2 - 4) * 3 - 0.5 * points[:, 1] ** 2)

    found = proposals_at_maxima(two, np.array([[1.5, 1.0], [-3.0, 0.0]]), 4, steps=12)
    assert found[0].places[0] == pytest.approx([2.0, 0.0], abs=0.02)
    assert found[1].places[0] == pytest.approx([-2.0, 0.0], abs=0.02)


@pytest.mark.parametrize("power", [0.0, 1.0, -1.0])
def test_a_density_without_a_maximum_still_gives_a_covariance(power: float) -> None:
    """Flat, a slope, and one that curves upwards."""

    def odd(points: np.ndarray) -> np.ndarray:
        return np.asarray(power * points[:, 0] + 0.1 * power**2 * points[:, 1] ** 2)

    (found,) = proposals_at_maxima(odd, np.zeros((1, 2)), 4, steps=5)
    assert np.isfinite(found.places).all()
    assert (np.linalg.eigvalsh(found.root @ found.root.T) > 0).all()


def test_weights_of_a_mixture_give_an_integral() -> None:
    """Of a normal density, from two proposals of which neither is at its place."""
    random = np.random.default_rng(1)
    proposals = [
        Proposal(np.zeros((1, 3)), np.eye(3), 3000),
        Proposal(np.stack([MEAN + 0.3, MEAN - 0.5]), 0.5 * np.eye(3), 500),
    ]
    points = np.vstack([proposal.points(random) for proposal in proposals])
    mixture = log_sum(np.stack([proposal.log_density(points) for proposal in proposals]))
    wide = -0.5 * ((points - MEAN) ** 2).sum(axis=1) / 0.36
    integral = math.exp(log_sum(wide - mixture))
    nu = 5.0
    of_t = math.gamma((nu + 3) / 2) / math.gamma(nu / 2) / (nu * math.pi) ** 1.5
    assert integral / of_t == pytest.approx((2 * math.pi * 0.36) ** 1.5, rel=0.05)


def test_points_nearby_have_mean_and_spread_of_the_weights() -> None:
    points = np.random.default_rng(2).standard_normal((4000, 3))
    nearby = proposal_nearby(points, 2.0 * points[:, 0], 64, effective=30.0)
    assert nearby.places.shape == (16, 3)
    assert nearby.each == 4
    assert nearby.places.mean(axis=0) == pytest.approx([2.0, 0.0, 0.0], abs=0.7)
    assert nearby.root @ nearby.root.T == pytest.approx(0.4 * np.eye(3), abs=0.2)


def test_where_few_points_count_their_weights_are_made_more_even() -> None:
    points = np.random.default_rng(3).standard_normal((500, 2))
    log_weight = -500.0 * ((points - 1.0) ** 2).sum(axis=1)
    assert effective_number(log_weight) < 3
    nearby = proposal_nearby(points, log_weight, 5, effective=30.0)
    assert nearby.each == 1
    assert nearby.places.mean(axis=0) == pytest.approx([1.0, 1.0], abs=0.2)
    assert len(np.unique(nearby.places, axis=0)) > 8


def test_the_effective_number_of_equal_weights_is_their_number() -> None:
    assert effective_number(np.zeros((40, 2))) == pytest.approx([40.0, 40.0])
    assert effective_number(np.array([0.0, -1e3])) == pytest.approx(1.0)
