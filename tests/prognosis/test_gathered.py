"""Many runs as fewer say the same."""

from __future__ import annotations

import numpy as np
import pytest

from ballscrew.prognosis.course import course
from ballscrew.prognosis.gathered import MOST, gathered


def test_few_runs_stay_as_they_are() -> None:
    one = course(np.arange(float(MOST)), 0.0, 0.01)
    few, last = gathered(one)
    assert few is one
    assert last is one.days


def test_medians_of_neighbours_and_what_they_are_worth() -> None:
    random = np.random.default_rng(1)
    n = 9 * MOST
    level = 0.1 + 0.01 * random.standard_normal(n)
    level[::50] = 5.0
    few, last = gathered(course(np.arange(float(n)), level, 0.01, temperature=np.nan))
    assert len(few) == MOST
    assert last[:2].tolist() == [8, 17]
    assert few.days[:2].tolist() == [4, 13]
    assert float(np.median(few.level)) == pytest.approx(0.1, abs=1e-3)
    assert few.level.max() < 0.2
    assert float(np.std(few.level)) == pytest.approx(float(few.random[0]), rel=0.15)
    assert np.isnan(few.temperature).all()


def test_gaps_stay_gaps() -> None:
    n = 2 * MOST
    level = np.full(n, np.nan)
    level[:10] = 0.1
    few, _ = gathered(course(np.arange(float(n)), level, 0.01))
    assert np.isfinite(few.level).sum() == 5
