"""Fit of one family: its past forecasts by the closed form, and its paths."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.special import ndtr, ndtri
from scipy.stats import multivariate_normal
from tests.prognosis.lives import made

from ballscrew.prognosis.families import FAMILIES, Family, FamilyPrior
from ballscrew.prognosis.family_fit import OnsetScale, fit_family
from ballscrew.prognosis.family_process import sample_paths
from ballscrew.prognosis.preload_history import preload_history
from ballscrew.prognosis.readings import Readings, readings_of

# A family of one member: a straight line from the first day on, known noise, and motion.
ONE = FamilyPrior(
    rate=1e-3, rate_spread=0.0, onset=1e-6, noise=1.0, noise_spread=0.0, walk=1.0, walk_spread=0.0
)
LINE = Family("straight line")
READINGS = replace(readings_of(made(30), 50), temperature=np.zeros(31))
PRIOR = FamilyPrior()


def covariance() -> np.ndarray:
    days = READINGS.days
    walk = (READINGS.typical / math.sqrt(days[-1])) ** 2
    least = np.minimum(days[:, None], days[None, :])
    noise = np.diag((READINGS.uncertainty * READINGS.smoothed**0.5) ** 2)
    return 1e-6 * days[:, None] * days[None, :] + walk * least + READINGS.start_deviation**2 + noise


def test_past_forecasts_are_those_of_the_gaussian_process() -> None:
    fit = fit_family(LINE, ONE, READINGS.days, READINGS, members=20, seed=1)
    z = (1 - READINGS.remaining**1.5) / 1.5
    whole = covariance()
    for column, (reading, ahead) in enumerate(((20, 1), (20, 2), (30, 4), (15, 8))):
        known = slice(0, reading - ahead + 1)
        gain = np.linalg.solve(whole[known, known], whole[known, reading])
        mean, variance = gain @ z[known], whole[reading, reading] - gain @ whole[known, reading]
        exact = multivariate_normal(mean, variance).logpdf(z[reading]) - 0.5 * math.log(1 / 2 / math.pi)
        slope = READINGS.smoothed[reading] ** 0.5
        assert fit.score[reading, column] == pytest.approx(exact + math.log(slope), abs=1e-3)
    assert np.isnan(fit.score[7, 3])
    assert np.isfinite(fit.score[8, 3])


def test_paths_follow_the_readings_and_a_loss_never_heals() -> None:
    readings = readings_of(made(90), 50)
    ahead = np.linspace(90, 150, 13)
    for family in FAMILIES:
        fit = fit_family(family, FamilyPrior(), readings.days, readings, members=40, seed=1)
        paths = sample_paths(fit, readings, readings.days, ahead, ahead, width=1.0, count=500, seed=1)
        middle = np.median(paths.remaining, axis=0)
        assert middle[0] == pytest.approx(readings.remaining[-5:].mean(), abs=0.02)
        assert (np.diff(middle) < 0).all()


def late_wear() -> Readings:
    """A run a week for two years, worn by a straight line since week 96."""
    random = np.random.default_rng(4)
    weeks = np.arange(104.0)
    ratio = 1 - np.maximum(weeks - 96, 0) / 30
    level = ratio ** (-1 / 3) - 1 + 0.002 * random.standard_normal(104)
    return readings_of(preload_history(7 * weeks, level, 0.003), 50)


def test_many_members_count_also_where_wear_begins_after_two_years() -> None:
    readings = late_wear()
    for family in FAMILIES:
        for seed in (1, 2):
            fit = fit_family(family, FamilyPrior(), readings.days, readings, members=40, seed=seed)
            assert 1 / np.sum(fit.weight**2) > 20, family.name
            assert np.sum(fit.weight * fit.cloud.onset) == pytest.approx(7 * 96, abs=20), family.name


def test_the_posterior_of_the_onset_is_that_of_a_grid() -> None:
    """A straight line with known noise and motion: only the onset is free."""
    readings = late_wear()
    prior = FamilyPrior(rate=3e-3, rate_spread=0.0, noise_spread=0.0, walk_spread=0.0)
    duty, typical = readings.days, readings.typical
    z = (1 - readings.remaining**1.5) / 1.5
    noise = (prior.noise * readings.uncertainty * readings.smoothed**0.5) ** 2
    walk = (prior.walk * typical / math.sqrt(duty[-1])) ** 2
    grid = np.arange(500.0, 728.0, 0.5)
    log_density = []
    for onset in grid.tolist():
        since = np.maximum(duty - onset, 0.0)
        covariance = (prior.rate * since)[:, None] * (prior.rate * since) + readings.start_deviation**2
        covariance += walk * np.minimum(since[:, None], since) + np.diag(noise)
        log_density.append(multivariate_normal.logpdf(z, np.zeros(len(z)), covariance))
    log_density = np.array(log_density) - 2 * np.log(prior.onset + grid)
    weight = np.exp(log_density - log_density.max())
    weight /= weight.sum()
    mean = float(weight @ grid)
    deviation = math.sqrt(float(weight @ (grid - mean) ** 2))
    fit = fit_family(LINE, prior, duty, readings, members=40, seed=1)
    assert np.sum(fit.weight * fit.cloud.onset) == pytest.approx(mean, abs=0.2 * deviation)
    second = np.sum(fit.weight * (fit.cloud.onset - mean) ** 2)
    assert math.sqrt(second) == pytest.approx(deviation, rel=0.15)


def test_the_family_that_made_the_readings_scores_best() -> None:
    random = np.random.default_rng(2)
    base = readings_of(made(60), 80)
    ratio = 1 - 0.01 * np.expm1(np.maximum(base.days - 10, 0) / 14)
    x = ratio ** (2 / 3) + 0.002 * random.standard_normal(61)
    readings = replace(base, remaining=x, smoothed=x, uncertainty=np.full(61, 0.002))
    score = {}
    for family in FAMILIES:
        fit = fit_family(family, FamilyPrior(), readings.days, readings, members=40, seed=1)
        score[family.name] = float(np.nanmean(fit.score[20:]))
    assert max(score, key=lambda name: score[name]) == "exponential"


WEEKS = 7.0 * np.arange(104)
EVEN = ndtri((np.arange(20_000) + 0.5) / 20_000)  # of a standard normal distribution


def test_the_onset_scale_has_as_many_onsets_in_the_last_weeks_as_in_the_first_ones() -> None:
    """Half of them: by the prior alone, 0.2 % of all members begin to wear in the last eight weeks."""
    number, log_ratio = OnsetScale.of(WEEKS, PRIOR).to_prior(EVEN)
    begin = ndtr(number)
    onset = PRIOR.onset * begin / (1 - begin)
    late = (onset > WEEKS[-9]) & (onset < WEEKS[-1])
    assert late.mean() == pytest.approx(0.5 * 8 / 103, rel=0.1)
    by_prior = np.diff(WEEKS[[-9, -1]] / (PRIOR.onset + WEEKS[[-9, -1]]))
    assert np.mean(late * np.exp(log_ratio)) == pytest.approx(by_prior[0], rel=0.02)
    assert np.mean(np.exp(log_ratio)) == pytest.approx(1.0, rel=1e-3)


@pytest.mark.parametrize("duty", [WEEKS, np.zeros(1), np.zeros(4), np.array([0.0, 1e-3, 1e-3, 5000.0])])
def test_beyond_the_last_reading_the_onset_scale_is_the_prior(duty: np.ndarray) -> None:
    number, log_ratio = OnsetScale.of(duty, PRIOR).to_prior(EVEN)
    assert (np.diff(number) >= 0).all()
    beyond = ndtr(EVEN) > duty[-1] / (PRIOR.onset + duty[-1])
    assert number[beyond] == pytest.approx(EVEN[beyond], abs=1e-6)
    assert (log_ratio[beyond] == 0).all()
