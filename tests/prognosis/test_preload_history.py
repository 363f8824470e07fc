"""Histories of an epoch: checks, selection and pooling of runs."""

from __future__ import annotations

import numpy as np
import pytest

from ballscrew.base.errors import InputError
from ballscrew.prognosis.preload_history import PreloadHistory, pool_runs, preload_history

DAYS = np.arange(5.0)
MOST_RUNS = 400


def test_quantities_that_are_not_given_are_nan() -> None:
    history = preload_history(DAYS, 0.01 * DAYS, 0.005)
    assert len(history) == 5
    assert np.isnan(history.backlash).all()
    assert np.isnan(history.temperature).all()
    assert history.level_uncertainty.tolist() == [0.005] * 5


def test_until_excludes_later_runs() -> None:
    history = preload_history(DAYS, 0.01 * DAYS, 0.005, friction=100.0, friction_uncertainty=1.0).until(2.5)
    assert history.days.tolist() == [0, 1, 2]
    assert len(history.level) == len(history.friction) == 3


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"level": [0.0, 0.1]}, "one a run"),
        ({"level": "text"}, "must be numbers"),
        ({"level": np.zeros((5, 2))}, "dimensions"),
        ({"level": [0.0, np.inf, 0, 0, 0]}, "infinite"),
        ({"level": [0.0, -1.0, 0, 0, 0]}, "more than -1"),
        ({"level_uncertainty": 0.0}, "standard uncertainty above 0"),
        ({"level_uncertainty": np.nan}, "standard uncertainty above 0"),
        ({"temperature": [np.inf, 0, 0, 0, 0]}, "temperature"),
        ({"scale": -0.1}, "scale"),
        ({"scale": np.nan}, "scale"),
        ({"approach": 0.0}, "approach"),
        ({"friction": 100.0}, "friction_uncertainty"),
        ({"backlash": 1e-6, "backlash_uncertainty": -1.0}, "backlash_uncertainty"),
    ],
)
def test_numbers_out_of_range_are_refused(changed: dict[str, object], words: str) -> None:
    given = {"level": 0.01 * DAYS, "level_uncertainty": 0.005} | changed
    with pytest.raises(InputError, match=words):
        preload_history(DAYS, **given)  # type: ignore[arg-type]


@pytest.mark.parametrize("days", [[1.0, 0.0], [0.0, np.nan], [0.0, np.inf]])
def test_days_ascend(days: list[float]) -> None:
    with pytest.raises(InputError, match="ascend"):
        preload_history(days)


def test_more_than_a_hundred_thousand_runs_are_refused() -> None:
    with pytest.raises(InputError, match="or fewer"):
        preload_history(np.zeros(100_001))


def test_a_history_may_be_empty() -> None:
    assert isinstance(preload_history([]), PreloadHistory)


def test_few_runs_are_not_pooled() -> None:
    history = preload_history(np.arange(float(MOST_RUNS)), 0.0, 0.01)
    assert pool_runs(history, MOST_RUNS) is history


def test_many_runs_are_pooled_by_medians() -> None:
    random = np.random.default_rng(1)
    n = 9 * MOST_RUNS
    level = 0.1 + 0.01 * random.standard_normal(n)
    level[::50] = 5.0
    pooled = pool_runs(preload_history(np.arange(float(n)), level, 0.01, temperature=np.nan), MOST_RUNS)
    assert len(pooled) < MOST_RUNS
    assert pooled.days[:2].tolist() == [191.5, 479.5]
    single = 3 * MOST_RUNS // 5
    older, spread = pooled.level[:-single], pooled.level_uncertainty[:-single]
    assert float(np.median(older)) == pytest.approx(0.1, abs=1e-3)
    assert older.max() < 0.2
    assert float(np.std((older - 0.1) / spread)) == pytest.approx(1.0, rel=0.15)
    assert pooled.days[-single:].tolist() == list(range(n - single, n))
    assert np.isnan(pooled.temperature).all()


def test_runs_without_a_level_have_none_after_pooling() -> None:
    n = 2 * MOST_RUNS
    level = np.full(n, np.nan)
    level[:10] = 0.1
    pooled = pool_runs(preload_history(np.arange(float(n)), level, 0.01), MOST_RUNS)
    assert np.isfinite(pooled.level).sum() == 1
