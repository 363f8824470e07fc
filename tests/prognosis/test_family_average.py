"""Average over families: coverage, weights, width, open ends, outliers and other hard histories."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from tests.prognosis.lives import QUICK, end, healthy, made, remaining

from ballscrew.base.errors import InputError
from ballscrew.prognosis.failure import Failure
from ballscrew.prognosis.families import FAMILIES, N_PARAMETERS, FamilyPrior
from ballscrew.prognosis.family_average import FamilyAverage, first_below, weigh_families
from ballscrew.prognosis.family_process import AHEAD, FamilyFit
from ballscrew.prognosis.forecast import FAN
from ballscrew.prognosis.preload_history import PreloadHistory, preload_history

HALF = Failure()


def loss(course: np.ndarray, seed: int = 1, noise: float = 0.002) -> PreloadHistory:
    """A run a day of a preload that has lost a course."""
    random = np.random.default_rng(seed)
    level = (1 - course) ** (-1 / 3) - 1 + noise * random.standard_normal(len(course))
    return preload_history(np.arange(float(len(course))), level, noise, scale=0.05)


def test_the_end_lies_in_the_interval_which_narrows() -> None:
    width = []
    for day in (60, 80, 88):
        forecast = QUICK.forecast(made(90), HALF, at=day)
        low, high = forecast.quantile([0.025, 0.9]).tolist()
        assert low <= end() - day <= high
        width.append(high - low)
    assert width[-1] < width[0]
    assert forecast.begun == 1


def test_later_runs_are_ignored() -> None:
    whole, part = made(120), made(120).until(60)
    assert (
        QUICK.forecast(whole, HALF, at=60).rul_days.tolist() == QUICK.forecast(part, HALF).rul_days.tolist()
    )


def test_wear_that_speeds_up_is_not_excluded_before_it_does() -> None:
    """Twice as fast from now on: the earliest day comes before it."""
    days = np.arange(60.0)
    forecast = QUICK.forecast(loss(0.002 * np.maximum(days - 10, 0)), HALF)
    assert forecast.quantile(0.05) < 200 / 2


def test_a_path_that_speeds_up_reaches_an_end_that_was_out_of_reach() -> None:
    """At the steady pace half of the preload is lost after 1000 days, beyond the reach of 600."""
    history = loss(0.0005 * np.arange(61.0))
    steady, faster = (
        replace(QUICK, families=FAMILIES[:1], prior=FamilyPrior(hazard=hazard, later=10.0, later_spread=0.0))
        for hazard in (0.0, 1e6)
    )
    assert steady.forecast(history, HALF).quantile(0.5) == math.inf
    assert faster.forecast(history, HALF).quantile(0.5) == pytest.approx((1000 - 60) / 10, rel=0.15)


def test_a_path_that_speeds_up_wears_in_travel_only() -> None:
    """The axis stands still from day 60 to 160: no path ends then."""

    def travel(days: np.ndarray) -> np.ndarray:
        return np.asarray(np.minimum(days, 60.0) + np.maximum(days - 160.0, 0.0))

    by_travel = replace(
        QUICK,
        families=FAMILIES[2:3],
        travel=travel,
        prior=FamilyPrior(hazard=1e6, later=20.0, later_spread=0.0),
    )
    result = by_travel.forecast(loss(0.005 * np.arange(61.0)), HALF)
    assert 100 < result.quantile(0.01) < result.quantile(0.5) < 110


@pytest.mark.parametrize("days", [[], [60.0], [62.0, 62.0], [63.0, 62.0], [61.0, math.nan]])
def test_days_of_a_friction_ahead_ascend_from_the_last_run(days: list[float]) -> None:
    history = preload_history(np.arange(61.0), friction=np.full(61, 100.0), friction_uncertainty=1.0)
    with pytest.raises(InputError, match=r"^the days of a forecast must be finite, ascend"):
        QUICK.friction_ahead(history, np.array(days))


def test_no_pace_changes_before_wear_begins() -> None:
    plain, changing = (
        replace(QUICK, prior=FamilyPrior(hazard=hazard)).forecast(healthy(60), HALF) for hazard in (0.0, 1e6)
    )
    assert plain.begun < 0.5
    assert changing.quantile(0.5) == math.inf
    assert changing.quantile(0.05) > 10


def test_an_exponential_is_followed() -> None:
    course = 0.01 * np.expm1(np.maximum(np.arange(58.0) - 10, 0) / 15)
    forecast = QUICK.forecast(loss(course), HALF)
    assert max(forecast.families, key=lambda name: forecast.families[name]) == "exponential"
    true = 10 + 15 * math.log(51) - 57
    low, middle, high = forecast.quantile([0.05, 0.5, 0.95]).tolist()
    assert low <= true <= high
    assert middle < 2 * true


def scored(score: float, below: float, family: int) -> FamilyFit:
    scores, transforms = np.full((40, 4), score), np.full((40, 4), below)
    cloud = FAMILIES[family].cloud(np.zeros((1, N_PARAMETERS)), FamilyPrior(), 1.0)
    fit = FamilyFit(FAMILIES[family], cloud, np.ones(1), np.zeros(1), scores, transforms)
    for column, k in enumerate(AHEAD):
        fit.score[:k, column] = np.nan
    return fit


def test_families_are_weighed_by_their_past_forecasts_above_a_floor() -> None:
    weight, width = weigh_families([scored(1.0, 0.5, 0), scored(0.0, 0.5, 3)])
    assert weight.tolist() == pytest.approx([0.997, 0.003], abs=1e-5)
    assert width == 1
    assert weigh_families([scored(0.0, 0.5, 0), scored(1.0, 0.5, 3)])[0][0] == pytest.approx(0.003, abs=1e-5)


def test_past_forecasts_that_were_too_narrow_widen_the_next() -> None:
    """All past readings at the 0.5 % quantile, 2.6 standard deviations off."""
    assert weigh_families([scored(0.0, 0.005, 0)])[1] == pytest.approx(2.44, abs=0.05)


def test_a_healthy_history_has_an_open_end() -> None:
    result = QUICK.forecast(healthy(30), HALF)
    assert not result.has_median
    assert result.quantile(0.95) == math.inf
    assert "open" in result.text or "No end is in sight" in result.text
    assert result.begun < 0.7


def test_a_single_run_gives_no_forecast() -> None:
    assert not QUICK.forecast(preload_history([0.0], [0.0], [0.005]), HALF).has_median


def test_wear_of_few_precise_runs_is_no_outlier() -> None:
    """The second run with wear, twice as far down as the first, shows it; the first may be an outlier."""
    days = np.arange(0.0, 21.0, 3.0)
    level = np.maximum(1 - np.maximum(days - 12, 0) / 80, 0) ** -0.5 - 1
    lost = preload_history(days, level, 0.001)
    first, second = (QUICK.forecast(lost, HALF, at=day) for day in (15.0, 18.0))
    assert first.begun < 0.5
    assert second.begun > 0.9
    low, high = second.quantile([0.05, 0.95])
    assert low < 12 + 80 * (1 - 0.5 ** (2 / 3)) - 18 < high


def test_during_an_alarm_the_end_is_that_of_an_axis_whose_wear_has_begun() -> None:
    """One low run may be an outlier; if an alarm excludes that, its loss is taken as wear."""
    level = np.append(np.zeros(6), 0.02)
    low_run = preload_history(np.arange(7.0), level, 0.001)
    plain, alarmed = (replace(QUICK, alarm=alarm).forecast(low_run, HALF) for alarm in (False, True))
    assert 0.1 < alarmed.begun == plain.begun < 0.5
    assert not plain.shows_wear
    assert alarmed.shows_wear
    assert math.isfinite(alarmed.quantile(0.05))
    assert alarmed.quantile(0.1) < plain.quantile(0.1)


def test_during_an_alarm_of_a_healthy_axis_the_end_is_far_and_open() -> None:
    result = replace(QUICK, alarm=True).forecast(healthy(60), HALF)
    assert result.quantile(0.05) > 10
    assert result.quantile(0.95) == math.inf


def test_an_outlier_does_not_shorten_a_life() -> None:
    plain = made(80)
    level = plain.level.copy()
    level[-1] += 0.1
    usual, odd = (QUICK.forecast(c, HALF).quantile(0.5) for c in (plain, replace(plain, level=level)))
    assert odd == pytest.approx(usual, rel=0.12)


def test_the_effect_of_temperature_is_estimated() -> None:
    history = made(90)
    warmer = 8 * np.sin(np.arange(91) / 9)
    warm = replace(history, level=history.level + 0.004 * warmer, temperature=warmer)
    known, unknown = (
        QUICK.forecast(each, HALF) for each in (warm, replace(warm, temperature=np.full(91, np.nan)))
    )
    low, high = known.quantile([0.05, 0.95]).tolist()
    assert low <= end() - 90 <= high
    true = remaining(np.array(90.0)) ** 1.5
    off, off_unknown = (abs(each.parameters["ratio_median"] - true) for each in (known, unknown))
    assert off < 0.02
    assert off < off_unknown


def test_a_life_from_friction_alone() -> None:
    days = np.arange(0.0, 100)
    random = np.random.default_rng(3)
    force = 200 * remaining(days) ** 1.5 + 4 * random.standard_normal(len(days))
    history = preload_history(days, friction=force, friction_uncertainty=4.0)
    low, high = QUICK.forecast(history, HALF).quantile([0.05, 0.95]).tolist()
    assert low <= max(end() - 99, 0) <= high
    ahead = QUICK.friction_ahead(history, np.array([100.0, 110.0]))
    assert np.median(ahead, axis=0) == pytest.approx(
        200 * remaining(np.array([100.0, 110.0])) ** 1.5, rel=0.1
    )
    assert 3 < ahead[:, 0].std() < 8


def test_duty_in_travel_and_in_time() -> None:
    """Wear by the travel, which doubles on day 60: only a family by travel foresees it."""

    def travel(days: np.ndarray) -> np.ndarray:
        return np.asarray(days + np.maximum(days - 60, 0.0))

    days = np.arange(0.0, 61)
    x = np.maximum(1 - 0.002 * travel(days), 0.1) ** 2
    level = x**-0.5 - 1 + 0.001 * np.random.default_rng(1).standard_normal(61)
    history = preload_history(days, level, 0.001, scale=0.02)
    by_travel = FamilyAverage(families=FAMILIES[2:3], travel=travel, members=30, samples=500)
    true = (1 - 0.5 ** (1 / 3)) / 0.002
    assert by_travel.forecast(history, HALF).quantile(0.5) == pytest.approx((true - 60) / 2, rel=0.15)
    assert "law of wear, by travel" in replace(QUICK, travel=travel).forecast(history, HALF).families
    assert "law of wear, by travel" not in QUICK.forecast(history, HALF).families


def test_backlash_is_the_end_where_that_is_asked() -> None:
    random = np.random.default_rng(5)
    days = np.arange(0.0, 161, 4)
    x = 1 - 0.008 * days
    level = np.minimum(np.maximum(x, 1e-3) ** -0.5 - 1, 1.5) + 0.005 * random.standard_normal(len(days))
    play = 2e-5 * np.maximum(-x, 0) + 1e-7 * random.standard_normal(len(days))
    history = preload_history(
        days, level, 0.005, backlash=play, backlash_uncertainty=1e-7, resolution=3e-7, approach=1e-5
    )
    result = QUICK.forecast(history, Failure(None, backlash=8e-6))
    low, high = result.quantile([0.05, 0.95]).tolist()
    assert low <= (1.4 / 0.008 - 160) <= high
    assert result.mode == "backlash"


def test_an_axis_that_has_failed_has_no_remaining_life() -> None:
    result = QUICK.forecast(made(end() + 40), HALF)
    assert result.quantile(0.95) == 0
    assert "reached" in result.text


def test_the_fan_falls_and_reaches_the_threshold_in_the_median() -> None:
    result = QUICK.forecast(made(80), HALF)
    middle = result.ratio[:, FAN.index(0.5)]
    assert (np.diff(middle) < 0).all()
    assert (np.diff(result.ratio, axis=1) >= 0).all()
    at = float(np.interp(-0.5, -middle, result.days))
    assert at == pytest.approx(float(result.quantile(0.5)), rel=0.1)


def test_the_common_scale_widens_the_interval() -> None:
    sure, unsure = (
        QUICK.forecast(replace(made(85), scale=scale), HALF).quantile([0.05, 0.75]) for scale in (0.0, 0.3)
    )
    assert np.diff(unsure) > 1.2 * np.diff(sure)


def test_the_same_seed_gives_the_same_forecast_and_another_nearly_the_same() -> None:
    first, second = (QUICK.forecast(made(80), HALF) for _ in range(2))
    assert first.rul_days.tolist() == second.rul_days.tolist()
    other = replace(QUICK, seed=9).forecast(made(80), HALF)
    assert other.quantile(0.5) == pytest.approx(first.quantile(0.5), rel=0.15)


def two_years(weeks: int, *, late_run: bool = False) -> PreloadHistory:
    """A run a week, with wear since week 96; and perhaps a healthy run of the first year that came late."""
    random = np.random.default_rng(0)
    days = 7 * np.arange(104.0)
    level = np.maximum(1 - np.maximum(days / 7 - 96, 0) / 45, 0.05) ** -0.5 - 1
    level = level + 0.002 * random.standard_normal(104)
    history = preload_history(days[:weeks], level[:weeks], 0.003)
    if not late_run:
        return history
    days, level = (
        np.insert(values, 52, new) for values, new in ((history.days, 360.0), (history.level, 0.001))
    )
    return preload_history(days, level, 0.003)


@pytest.mark.parametrize("weeks", [101, 103])
def test_one_old_healthy_run_hardly_changes_a_forecast_and_another_seed_neither(weeks: int) -> None:
    model = FamilyAverage(alarm=True)
    usual = model.forecast(two_years(weeks), HALF).quantile([0.05, 0.5])
    late = model.forecast(two_years(weeks, late_run=True), HALF).quantile([0.05, 0.5])
    seed = replace(model, seed=5).forecast(two_years(weeks), HALF).quantile([0.05, 0.5])
    for other in (late, seed):
        assert np.abs(np.log(other / usual)) == pytest.approx([0.0, 0.0], abs=math.log(1.35))


def test_first_passages_are_linear_between_the_days() -> None:
    x = np.array([[1.0, 0.8, 0.4], [1.0, 1.0, 1.0], [0.5, 0.4, 0.3]])
    assert first_below(x, np.full(3, 0.6), np.array([0.0, 2.0, 4.0])).tolist() == [3.0, math.inf, 0.0]


@pytest.mark.parametrize("gap", [400.0, 2_912_443.0])
def test_a_run_with_a_wrong_clock_ends_no_healthy_axis(gap: float) -> None:
    random = np.random.default_rng(0)
    days = np.append(np.arange(13.0), gap)
    result = QUICK.forecast(preload_history(days, 1e-3 * random.standard_normal(14), 0.0018), HALF)
    assert result.quantile(0.95) == math.inf
    assert result.begun < 0.5 or result.quantile(0.05) > 30


def test_impossible_requests_are_refused() -> None:
    with pytest.raises(InputError, match="no run"):
        QUICK.forecast(preload_history([]), HALF)
    with pytest.raises(InputError, match="no run shows"):
        QUICK.forecast(preload_history([1.0]), HALF)
    with pytest.raises(InputError, match="members"):
        FamilyAverage(members=3)
    with pytest.raises(InputError, match="finite"):
        QUICK.forecast(made(30), HALF, at=math.nan)
    with pytest.raises(InputError, match="probability"):
        QUICK.forecast(made(10), HALF).quantile(1.5)
