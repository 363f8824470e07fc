"""Fit of a family of wear to the readings: a weighted sample of its members, and its past forecasts.

Members are weighted by importance, on a mixture of proposals: the prior, the maxima of the posterior, and the
neighbourhoods of members that count (Cappé, Guillin, Marin and Robert, *Population Monte Carlo*, J. Comput.
Graph. Stat. 13, 2004, DOI 10.1198/106186004X12803).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr, ndtri

from ballscrew.base.arrays import Array
from ballscrew.base.proposals import (
    Proposal,
    effective_number,
    log_sum,
    proposal_nearby,
    proposals_at_maxima,
)
from ballscrew.prognosis.families import N_PARAMETERS, Cloud, Family, FamilyPrior
from ballscrew.prognosis.family_process import AHEAD, FamilyFit, MemberEvidence, evidence_of
from ballscrew.prognosis.readings import Readings

_FIRST = 4  # clouds' worth of members of the prior
_STARTS, _DISTANCE = 4, 1.0  # of them at most, and so far from each other, from which a maximum is sought
_STEPS = 8  # towards it
_MOST_ROUNDS = 16  # clouds near members that count
_ENOUGH = 20.0  # effective number of members after any number of readings, from which on no more are added
_NEWEST = 5.0  # that after all readings, over it
_EFFECTIVE = 30.0  # members that count, at least, near which the next cloud is
_ONSET = 1  # number of the onset
_FARTHEST = 8.0  # number of a member, beyond which it is the same


@dataclass(frozen=True, slots=True, eq=False)
class OnsetScale:
    """Scale of the onset that resolves the readings: half of its probability is alike for each interval.

    The prior alone has hardly any members whose wear begins in a certain week of the second year.

    Parameters
    ----------
    by_prior, by_scale : ndarray, shape (k,)
        Probabilities of an onset before each of k readings at different duties, from 0 on.
    """

    by_prior: Array
    by_scale: Array

    @classmethod
    def of(cls, duty: Array, prior: FamilyPrior) -> OnsetScale:
        """Scale for readings.

        Parameters
        ----------
        duty : ndarray, shape (n,)
            Duty at each reading.
        prior : FamilyPrior
            Of the onset.

        Returns
        -------
        OnsetScale
            Beyond the last reading it is the prior.
        """
        before = np.unique(np.append(0.0, np.maximum(duty, 0.0)))
        by_prior = prior.onset_probability(before)
        return cls(by_prior, 0.5 * by_prior + 0.5 * np.linspace(0.0, by_prior[-1], len(before)))

    def to_prior(self, number: Array) -> tuple[Array, Array]:
        """Standard normal numbers by the prior, from those of the scale.

        Parameters
        ----------
        number : ndarray, shape (m,)
            Standard normal where the onset has the probabilities of the scale.

        Returns
        -------
        by_prior : ndarray, shape (m,)
            Numbers of the same onsets that are standard normal before anything is observed.
        log_ratio : ndarray, shape (m,)
            Logarithm of the density of the prior over that of the scale.
        """
        below = np.clip(ndtr(number), 1e-12, 1 - 1e-12)
        beyond = below >= self.by_scale[-1]
        prior_below = np.where(beyond, below, np.interp(below, self.by_scale, self.by_prior))
        ratio = np.append(np.diff(self.by_prior) / np.diff(self.by_scale), 1.0)
        interval = np.searchsorted(self.by_scale, below, side="right") - 1
        log_ratio = np.log(np.maximum(ratio, 1e-300))[interval]
        return ndtri(np.clip(prior_below, 1e-300, 1 - 1e-12)), log_ratio


def fit_family(
    family: Family, prior: FamilyPrior, duty: Array, readings: Readings, *, members: int, seed: int
) -> FamilyFit:
    """Fit a family to the readings.

    Parameters
    ----------
    family : Family
        The family.
    prior : FamilyPrior
        Of its parameters.
    duty : ndarray, shape (n,)
        Duty at each reading, days.
    readings : Readings
        n of them.
    members : int
        Of a cloud; that of the prior has four times as many.
    seed : int
        The same seed gives the same members.

    Returns
    -------
    FamilyFit
        With five to twenty-one times as many members.
    """
    random = np.random.default_rng([seed, 1])
    target = _Target(family, prior, duty, readings, OnsetScale.of(duty, prior))
    sample = _sampled(target, members, random)
    innovation = np.vstack([each.innovation for each in sample.evidence])
    score, below = _past_forecasts(sample.log_weight, sample.evidence)
    last = sample.log_weight[:, -1]
    moments = np.mean(innovation**4, axis=1) / np.maximum(np.mean(innovation**2, axis=1) ** 2, 1e-12)
    cloud, _ = target.cloud(sample.points)
    return FamilyFit(family, cloud, np.exp(last - log_sum(last)), moments - 3, score, below)


@dataclass(frozen=True, slots=True, eq=False)
class _Target:
    """Posterior of a family's members, in the numbers that it uses, with the onset by its scale."""

    family: Family
    prior: FamilyPrior
    duty: Array
    readings: Readings
    onsets: OnsetScale

    def cloud(self, points: Array) -> tuple[Cloud, Array]:
        """Members, and the logarithm of the density of the prior."""
        z = np.zeros((len(points), N_PARAMETERS))
        z[:, self.family.free] = points
        z[:, _ONSET], log_ratio = self.onsets.to_prior(points[:, _ONSET])
        cloud = self.family.cloud(np.clip(z, -_FARTHEST, _FARTHEST), self.prior, float(self.duty[-1]))
        return cloud, log_ratio - 0.5 * (points**2).sum(axis=1)

    def evidence(self, points: Array) -> tuple[Array, MemberEvidence]:
        """Logarithm of the posterior density after each number of readings, and the evidence."""
        cloud, log_prior = self.cloud(points)
        evidence = evidence_of(cloud, self.duty, self.readings)
        log_density = np.hstack([log_prior[:, None], evidence.gains]).cumsum(axis=1)
        log_density[:, -1] += evidence.positive
        return log_density, evidence

    def log_density(self, points: Array) -> Array:
        """Logarithm of the posterior density, shape (m,)."""
        return np.asarray(self.evidence(points)[0][:, -1])


@dataclass(frozen=True, slots=True, eq=False)
class _Sample:
    """M members of all proposals.

    ``mixture`` is the logarithm of the density of all proposals, and column i of ``log_density`` that of the
    posterior after i readings.
    """

    proposals: list[Proposal]
    points: Array
    mixture: Array
    log_density: Array
    evidence: list[MemberEvidence]

    @classmethod
    def of(cls, proposal: Proposal, target: _Target, random: np.random.Generator) -> _Sample:
        """Members of one proposal."""
        points = proposal.points(random)
        log_density, evidence = target.evidence(points)
        return cls([proposal], points, proposal.log_density(points), log_density, [evidence])

    def added(self, proposal: Proposal, target: _Target, random: np.random.Generator) -> _Sample:
        """With those of one more proposal."""
        new = _Sample.of(proposal, target, random)
        before = log_sum(np.stack([each.log_density(new.points) for each in self.proposals]))
        of_before = np.logaddexp(self.mixture, proposal.log_density(self.points))
        return _Sample(
            [*self.proposals, proposal],
            np.vstack([self.points, new.points]),
            np.append(of_before, np.logaddexp(before, new.mixture)),
            np.vstack([self.log_density, new.log_density]),
            self.evidence + new.evidence,
        )

    @property
    def log_weight(self) -> Array:
        """Logarithm of the weights after each number of readings, shape (m, n + 1)."""
        return np.asarray(self.log_density - self.mixture[:, None])


def _sampled(target: _Target, members: int, random: np.random.Generator) -> _Sample:
    """Members of the prior, at maxima of the posterior, and near those that count, until enough of them do.

    Past forecasts need the posterior after each number of readings.
    """
    d = len(target.family.free)
    sample = _Sample.of(Proposal(np.zeros((1, d)), np.eye(d), _FIRST * members), target, random)
    starts = _starts(sample.points, sample.log_density[:, -1])
    each = max(members // len(starts), 1)
    for proposal in proposals_at_maxima(target.log_density, starts, each, steps=_STEPS):
        sample = sample.added(proposal, target, random)
    for turn in range(_MOST_ROUNDS):
        log_weight = sample.log_weight
        effective = effective_number(log_weight)
        effective[-1] /= _NEWEST
        readings = int(np.argmin(effective))
        if effective[readings] > _ENOUGH:
            break
        if turn % 2 == 0 and effective[-1] < _ENOUGH:
            readings = -1
        nearby = proposal_nearby(sample.points, log_weight[:, readings], members, effective=_EFFECTIVE)
        sample = sample.added(nearby, target, random)
    return sample


def _starts(points: Array, log_density: Array) -> Array:
    """The most probable points at a distance of each other."""
    starts = points[:0]
    for point in points[np.argsort(-log_density)]:
        if (np.linalg.norm(starts - point, axis=1) > _DISTANCE).all():
            starts = np.vstack([starts, point])
        if len(starts) == _STARTS:
            break
    return starts


def _past_forecasts(so_far: Array, evidence: Sequence[MemberEvidence]) -> tuple[Array, Array]:
    """Score and probability below of each reading, as forecast by the members' weights before it."""
    error = np.concatenate([each.error for each in evidence])
    density = np.concatenate([each.density for each in evidence])
    score, below = np.full((2, *error.shape[1:]), np.nan)
    for column, ahead in enumerate(AHEAD):
        target = np.arange(ahead, len(score))
        log_weight = so_far[:, target - ahead + 1]
        log_weight = log_weight - log_sum(log_weight)
        score[target, column] = log_sum(log_weight + density[:, target, column])
        below[target, column] = np.sum(np.exp(log_weight) * ndtr(error[:, target, column]), axis=0)
    return score, below
