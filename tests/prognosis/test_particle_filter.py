"""Forecasts of the particle filter: coverage, open ends, outliers and other hard histories."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from tests.prognosis.lives import QUICK, end, healthy, made, remaining

from ballscrew.base.errors import InputError
from ballscrew.prognosis.failure import Failure
from ballscrew.prognosis.forecast import FAN, Forecast
from ballscrew.prognosis.life_prior import LifePrior
from ballscrew.prognosis.particle_filter import ParticleFilter
from ballscrew.prognosis.preload_history import preload_history
from ballscrew.prognosis.statement import prognosis_of
from ballscrew.prognosis.wear_path import remaining_after, travel_until

HALF = Failure()


@cache
def forecast_on(day: int) -> Forecast:
    """Forecast of the made life, as several tests need it."""
    return QUICK.forecast(made(day), HALF)


def test_the_end_lies_in_the_interval_which_narrows() -> None:
    result = list(QUICK.forecasts(made(130), HALF, [40, 70, 100, 130]))
    width = []
    for forecast in result:
        low, high = forecast.quantile([0.025, 0.975]).tolist()
        assert low <= end() - forecast.at <= high
        width.append(high - low)
    assert width[-1] < width[0] / 2
    assert result[-1].begun == 1


def test_later_runs_are_ignored() -> None:
    whole, part = made(120), made(120).until(60)
    assert (
        QUICK.forecast(whole, HALF, at=60).rul_days.tolist() == QUICK.forecast(part, HALF).rul_days.tolist()
    )


def test_each_of_several_forecasts_is_that_of_its_own_day() -> None:
    first, _ = QUICK.forecasts(made(120), HALF, [60, 120])
    assert first.rul_days.tolist() == QUICK.forecast(made(120).until(60), HALF).rul_days.tolist()


def test_a_healthy_history_has_an_open_end() -> None:
    result = QUICK.forecast(healthy(30), HALF)
    assert not result.known
    assert result.quantile([0.5, 0.95]).tolist() == [math.inf, math.inf]
    assert "open" in result.text or "No end is in sight" in result.text
    assert result.begun < 0.6


def test_a_single_run_gives_no_forecast() -> None:
    result = QUICK.forecast(preload_history([0.0], [0.0], [0.005]), HALF)
    assert not result.known


def test_an_outlier_does_not_shorten_a_life() -> None:
    plain = made(80)
    level = plain.level.copy()
    level[-1] += 0.1
    usual, odd = (QUICK.forecast(c, HALF).quantile(0.5) for c in (plain, replace(plain, level=level)))
    assert odd == pytest.approx(usual, rel=0.12)


def test_temperature_is_learned_and_may_be_missing() -> None:
    history = made(90)
    warmer = 8 * np.sin(np.arange(91) / 9)
    warm = replace(history, level=history.level + 0.004 * warmer, temperature=warmer)
    result = QUICK.forecast(warm, HALF)
    assert result.parameters["temperature"] == pytest.approx(0.004, abs=5e-4)
    gaps = np.where(np.arange(91) % 3 == 0, np.nan, warmer)
    other = QUICK.forecast(replace(warm, temperature=gaps), HALF)
    assert other.quantile(0.5) == pytest.approx(result.quantile(0.5), rel=0.25)


def test_a_life_from_friction_alone() -> None:
    days = np.arange(0.0, 110)
    random = np.random.default_rng(3)
    force = 200 * (0.3 + 0.7 * np.maximum(remaining(days), 0) ** 1.5) + 2 * random.standard_normal(len(days))
    result = QUICK.forecast(preload_history(days, friction=force, friction_uncertainty=2.0), HALF)
    low, high = result.quantile([0.025, 0.975]).tolist()
    assert low <= end() - 109 <= high


def test_backlash_narrows_the_interval_also_below_its_resolution() -> None:
    random = np.random.default_rng(5)
    days = np.arange(0.0, 261, 2)
    x = remaining_after(0.01 * days, np.array(0.5), np.array(0.1))
    level = np.minimum(np.maximum(x, 1e-3) ** -0.5 - 1, 1.5) + 0.01 * random.standard_normal(len(days))
    play = 2e-5 * np.maximum(-x, 0) + 1e-7 * random.standard_normal(len(days))
    fails = Failure(None, backlash=8e-6)
    result = {"backlash": play, "backlash_uncertainty": 1e-7, "resolution": 3e-7, "approach": 1e-5}
    observed = QUICK.forecast(preload_history(days, level, 0.01, **result), fails)
    blind = QUICK.forecast(preload_history(days, level, 0.01), fails)
    true = float(travel_until(-0.4, np.array(0.5), np.array(0.1))) / 0.01 - 260
    low, high = observed.quantile([0.025, 0.975]).tolist()
    assert low <= true <= high
    assert high - low < float(np.diff(blind.quantile([0.025, 0.975]))[0])
    assert observed.mode == "backlash"
    early = QUICK.forecast(
        preload_history(days[:60], **{k: v[:60] if k == "backlash" else v for k, v in result.items()}), HALF
    )
    assert early.parameters["ratio_median"] > 0


def test_an_axis_that_has_failed_has_no_remaining_life() -> None:
    result = QUICK.forecast(made(end() + 40), HALF)
    assert result.quantile(0.95) == 0
    assert "reached" in result.text


def test_the_fan_falls_and_reaches_the_threshold_in_the_median() -> None:
    result = forecast_on(90)
    middle = result.ratio[:, FAN.index(0.5)]
    assert (np.diff(middle) < 0).all()
    assert (np.diff(result.ratio, axis=1) >= 0).all()
    at = float(np.interp(-0.5, -middle, result.days))
    assert at == pytest.approx(float(result.quantile(0.5)), rel=0.03)


def test_the_common_scale_widens_the_interval() -> None:
    sure, unsure = (
        QUICK.forecast(replace(made(100), scale=scale), HALF).quantile([0.05, 0.95]) for scale in (0.0, 0.2)
    )
    assert np.diff(unsure) > 1.2 * np.diff(sure)


def test_the_same_seed_gives_the_same_forecast_and_another_nearly_the_same() -> None:
    first, second = forecast_on(90), QUICK.forecast(made(90), HALF)
    assert first.rul_days.tolist() == second.rul_days.tolist()
    other = replace(QUICK, seed=9).forecast(made(90), HALF)
    assert other.quantile(0.5) == pytest.approx(first.quantile(0.5), rel=0.1)


def test_impossible_requests_are_refused() -> None:
    with pytest.raises(InputError, match="no run"):
        QUICK.forecast(preload_history([]), HALF)
    with pytest.raises(InputError, match="particles"):
        ParticleFilter(particles=3)
    with pytest.raises(InputError, match="ascend"):
        list(QUICK.forecasts(made(30), HALF, [20, 10]))
    with pytest.raises(InputError, match="finite"):
        QUICK.forecast(made(30), HALF, at=math.nan)
    with pytest.raises(InputError, match="probability"):
        QUICK.forecast(made(10), HALF).quantile(1.5)


@pytest.mark.parametrize(
    "given",
    [
        {"rate": 0.0},
        {"rate_spread": -1.0},
        {"noise": math.nan},
        {"friction_share": (0.9, 0.1)},
        {"wander": -1},
    ],
)
def test_a_prior_out_of_range_is_refused(given: dict[str, object]) -> None:
    with pytest.raises(InputError, match="prior"):
        LifePrior(**given)  # type: ignore[arg-type]


def test_a_filter_that_lost_the_posterior_is_replaced_by_tempering(monkeypatch: pytest.MonkeyPatch) -> None:
    def lost(_likelihood, dimensions, marks, particles, *_):
        for _mark in marks:
            yield np.full((particles, dimensions), 3.0)

    right = forecast_on(100)
    monkeypatch.setattr("ballscrew.prognosis.particle_filter.filtered", lost)
    result = QUICK.forecast(made(100), HALF)
    assert result.begun == pytest.approx(1, abs=0.01)
    assert float(result.quantile(0.5)) == pytest.approx(float(right.quantile(0.5)), rel=0.3)


@pytest.mark.parametrize("seed", [1, 2])
def test_precise_runs_with_little_scatter_of_friction_are_followed(seed: int) -> None:
    random = np.random.default_rng(seed)
    days = np.arange(0.0, 300)
    x = (
        remaining_after(np.maximum(days - 100, 0) / 900, np.array(0.0), np.array(0.1)) ** 2
    )  # contact pressure
    ratio = x**1.5
    level = ratio ** (-1 / 3) - 1 + 1e-4 * random.standard_normal(len(days))
    force = 45 * (0.6 + 0.4 * ratio) * (1 + 0.002 * random.standard_normal(len(days)))
    sharp = preload_history(days, level, 0.0018, scale=0.118, friction=force, friction_uncertainty=1.35)
    for count in (200, 300):
        result = replace(QUICK, most=150).forecast(sharp.until(count - 1), HALF)
        assert result.fits
        assert result.parameters["ratio_median"] == pytest.approx(ratio[count - 1], rel=0.06)
        low, high = result.quantile([0.025, 0.975]).tolist()
        assert low <= max(100 + 900 * (1 - 0.5 ** (1 / 3)) - result.at, 0) <= high
        assert low < 0.95 * high or high < 30


def test_a_run_with_a_wrong_clock_ends_no_healthy_axis() -> None:
    random = np.random.default_rng(0)
    for gap in (400.0, 4000.0, 2_912_443.0):
        days = np.append(np.arange(13.0), gap)
        odd = preload_history(days, 1e-3 * random.standard_normal(14), 0.0018)
        result = QUICK.forecast(odd, HALF)
        assert result.quantile(0.95) == math.inf
        assert not result.fits or result.begun < 0.5 or result.quantile(0.05) > 30


def test_lives_that_do_not_fit_the_newest_runs_give_no_forecast(monkeypatch: pytest.MonkeyPatch) -> None:
    def lost(_likelihood, dimensions, runs, particles, *_):
        z = np.full((particles, dimensions), 3.0)
        return (z for _ in runs) if isinstance(runs, list) else z

    for name in ("filtered", "tempered"):
        monkeypatch.setattr(f"ballscrew.prognosis.particle_filter.{name}", lost)
    result = QUICK.forecast(made(100), HALF)
    assert not result.fits
    assert result.quantile(0.05) == math.inf
    assert "does not fit" in result.text
    prognosis = prognosis_of(result, made(100))
    assert prognosis.confidence == "none: the forecast does not fit the runs"
    assert set(prognosis.rul_days.values()) == {None}
    assert prognosis.fan.days == ()
    assert "is not known" in prognosis.statement[1]


def test_two_precise_steps_give_the_same_forecast_for_every_seed() -> None:
    """Seven runs of a repaired axis, whose median once varied from 10 to 19 days with the seed."""
    level = [0.0, 3e-5, 1.6e-4, 1.5e-4, 4e-5, 0.0362, 0.07185]
    history = preload_history(3.0 * np.arange(7), level, np.full(7, 0.00125), scale=0.12)
    result = [ParticleFilter(seed=seed).forecast(history, HALF).quantile([0.5])[0] for seed in range(6)]
    assert np.std(np.log(result), ddof=1) < 0.08
