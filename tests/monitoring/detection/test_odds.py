"""Odds of wear that began lately: against explicit likelihoods, and the bounded effect of a single run."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.stats import multivariate_normal

from ballscrew.monitoring.detection import odds as module
from ballscrew.monitoring.detection.chart import chart_of
from ballscrew.monitoring.detection.design import Design, LevelStep, design_of
from ballscrew.monitoring.detection.healthy_axes import simulate_healthy
from ballscrew.monitoring.detection.limits import compute_limits
from ballscrew.monitoring.detection.settings import MonitorSettings
from ballscrew.monitoring.detection.statistics import BEGIN, statistics

Array = NDArray[np.float64]
UNCERTAINTY = 0.003
SCATTER = 0.45 * UNCERTAINTY
FEW = MonitorSettings(draws=4000)


def epoch(days: Array, chosen: MonitorSettings = FEW, steps: tuple[LevelStep, ...] = ()) -> Design:
    return design_of(days, np.full(len(days), UNCERTAINTY), np.full(len(days), np.nan), steps, chosen)


def odds(design: Design, levels: Array, again: Array | None = None) -> Array:
    """Log odds after each visit; every repeat counts."""
    return statistics(design, levels, again).odds


def noise(count: int, seed: int) -> Array:
    return SCATTER * np.random.default_rng(seed).standard_normal(count)


@pytest.mark.parametrize("slope", [0.0, 0.001])
def test_without_outliers_they_are_the_ratio_of_normal_densities(slope: float) -> None:
    days = np.array([0.0, 1.0, 2.0, 3.5, 4.0, 7.0, 8.0])
    y = 0.5 * noise(7, 3) + slope * np.maximum(days - 4, 0)
    design = epoch(days, MonitorSettings(odd=0.0, scale=0.45))
    worn, sound = 0.0, 0.0
    for scale in module._SCALES:
        covariance = (scale * SCATTER) ** 2 * np.eye(7) + module._LEVEL**2
        believed = np.exp(-0.5 * (np.log(scale) / module._SCALE_SPREAD) ** 2)
        sound += believed * multivariate_normal.pdf(y, np.zeros(7), covariance)
        for k in range(BEGIN, 7):  # four onsets: fewer than are stored
            gap = days[k] - days[k - 1]
            for rate in module._RATES:
                lost = rate * np.maximum(days - days[k] + gap / 2, 0)
                lost[:k] = 0
                worn += believed * gap / 3 * multivariate_normal.pdf(y, lost, covariance)
    assert odds(design, y[:, None])[-1, 0] == pytest.approx(np.log1p(worn / sound), rel=0.01)


def test_clear_wear_has_large_odds_and_none_has_small() -> None:
    days = np.arange(40.0)
    design = epoch(days)
    worn = odds(design, (noise(40, 1) + 0.006 * np.maximum(days - 29.5, 0))[:, None])[:, 0]
    assert worn[33] > 15
    assert worn[BEGIN:30].max() < 6
    assert (worn[:BEGIN] == 0).all()
    stiffer = -0.006 * np.maximum(days - 29.5, 0)
    assert odds(design, stiffer[:, None]).max() < 3


@given(seed=st.integers(0, 2**31), count=st.integers(2, 24), slope=st.floats(-0.01, 0.01))
@settings(max_examples=25, deadline=None)
def test_later_runs_change_nothing(seed: int, count: int, slope: float) -> None:
    days = np.arange(25.0)
    y = (noise(25, seed) + slope * np.maximum(days - 12, 0))[:, None]
    steps = (LevelStep(8.5, 0.01), LevelStep(20.5, 0.02))
    whole = odds(epoch(days, steps=steps), y)
    part = odds(epoch(days[:count], steps=steps), y[:count])
    np.testing.assert_allclose(part, whole[:count], rtol=1e-4, atol=1e-4)


def test_a_history_alone_is_the_same_as_among_others() -> None:
    design = epoch(np.arange(20.0))
    levels = simulate_healthy(design, 50, (3,))[0]
    np.testing.assert_allclose(odds(design, levels[:, 7:8]), odds(design, levels)[:, 7:8], rtol=1e-3)


@pytest.mark.parametrize("size", [0.012, 0.1, 1.0, 1e6])
@pytest.mark.parametrize("where", [5, 20, 29])
def test_a_single_outlier_does_not_alarm_however_far_off(size: float, where: int) -> None:
    for sign in (1, -1) if size < 1 else (1,):
        level = noise(40, 5)
        level[where] += sign * size
        uncertainty, warm = np.full(40, UNCERTAINTY), np.full(40, np.nan)
        assert "alarm" not in chart_of(np.arange(40.0), level, uncertainty, warm, (), FEW).states


def test_a_repeat_has_the_same_effect_however_far_off_the_first_run_was() -> None:
    design = epoch(np.arange(12.0))
    found = []
    for size in (1e2, 1e6, 1e30):
        level, again = noise(12, 4), np.full(12, np.nan)
        level[8], again[8] = size, 0.3 * SCATTER
        found.append(odds(design, level[:, None], again[:, None])[8:, 0])
    np.testing.assert_allclose(found[1:], [found[0]] * 2, rtol=1e-5)


def test_a_history_alone_is_exactly_as_among_others() -> None:
    design = epoch(np.arange(20.0))
    levels, again = simulate_healthy(design, 37, (3,))
    whole = odds(design, levels, again)
    for k in (0, 7, 36):
        assert (odds(design, levels[:, k : k + 1], again[:, k : k + 1])[:, 0] == whole[:, k]).all()


def test_two_runs_far_off_in_a_row_alarm() -> None:
    level = noise(22, 5)
    level[20:] += (0.012, 0.024)
    found = chart_of(np.arange(22.0), level, np.full(22, UNCERTAINTY), np.full(22, np.nan), (), FEW).states
    assert found[-2:] != ("alarm", "alarm")
    assert found[-1] == "alarm"


def test_runs_on_one_day_have_finite_odds_and_spend_no_false_alarms() -> None:
    design = epoch(np.repeat(np.arange(8.0), 2))
    assert np.isfinite(odds(design, simulate_healthy(design, 20, (1,))[0])).all()
    assert (compute_limits(design).spent[5::2] == 0).all()


def test_enormous_evidence_stays_finite() -> None:
    days = np.arange(30.0)
    found = odds(epoch(days), np.where(days > 20, 1e6, 0.0)[:, None])
    assert np.isfinite(found).all()
