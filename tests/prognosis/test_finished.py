"""Finished lives narrow the prior of the next one, as far as so few can."""

from __future__ import annotations

import math

import numpy as np
import pytest
from tests.prognosis.lives import EXPONENT, QUICK, RATE, end, made

from ballscrew.base.errors import InputError
from ballscrew.prognosis.failure import Failure
from ballscrew.prognosis.finished import FinishedLife, prior_from
from ballscrew.prognosis.life_prior import LifePrior
from ballscrew.prognosis.particle_filter import ParticleFilter

LIKE = [FinishedLife(rate, 0.5) for rate in (0.002, 0.003, 0.0045)]


def test_a_whole_course_tells_rate_and_law() -> None:
    one = FinishedLife.of(made(end() + 60), QUICK)
    assert one.rate == pytest.approx(RATE, rel=0.35)
    assert one.exponent == pytest.approx(float(EXPONENT), abs=0.35)


def test_the_prior_lies_where_the_lives_lie_and_is_wider_than_they() -> None:
    prior = prior_from(LIKE)
    assert prior.rate == pytest.approx(0.003)
    assert float(np.std(np.log([one.rate for one in LIKE]), ddof=1)) < prior.rate_spread < 1
    assert prior.exponent == 0.5
    assert prior_from(LIKE * 5).rate_spread < prior.rate_spread


def test_it_is_never_wider_than_before() -> None:
    wild = [FinishedLife(1e-6, 0.0), FinishedLife(1.0, 1.5)]
    assert prior_from(wild).rate_spread == LifePrior().rate_spread


def test_it_narrows_an_early_forecast() -> None:
    early = made(28)
    usual = ParticleFilter().forecast(early, Failure()).quantile([0.05, 0.95])
    taught = ParticleFilter(prior_from(LIKE)).forecast(early, Failure())
    low, high = taught.quantile([0.05, 0.95]).tolist()
    assert low <= end() - 28 <= high
    assert high - low < float(np.diff(usual)[0])


def test_what_cannot_be_is_refused() -> None:
    with pytest.raises(InputError, match="at least"):
        prior_from(LIKE[:1])
    for rate, exponent in ((0.0, 0.5), (math.nan, 0.5), (0.1, -1.0), (0.1, math.nan)):
        with pytest.raises(InputError, match="finished life"):
            FinishedLife(rate, exponent)
