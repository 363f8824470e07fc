"""The newest runs decide whether a forecast is valid; one outlier among them does not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.prognosis.lives import made

from ballscrew.prognosis.life_prior import NUMBERS, LifePrior, lives_from_normal
from ballscrew.prognosis.likelihood import fill_temperature, fits_newest_runs
from ballscrew.prognosis.preload_history import PreloadHistory, preload_history

PRIOR = replace(LifePrior(), wander=0.0)
NEW = lives_from_normal(np.zeros((50, NUMBERS)), replace(PRIOR, rate=1e-9), 0.1, 0.0, 1.0)  # that never wear


def believed(seen: PreloadHistory) -> bool:
    return fits_newest_runs(NEW, fill_temperature(seen, PRIOR), PRIOR, float(seen.days[-1]))


def sound(last: float = 0.0, before: float = 0.0) -> PreloadHistory:
    level = 0.004 * np.random.default_rng(2).standard_normal(30)
    level[-5:] += before
    level[-1] += last
    return preload_history(np.arange(30.0), level, 0.005)


def test_lives_that_are_where_the_runs_are() -> None:
    assert believed(sound())
    assert believed(preload_history([0.0], friction=[40.0], friction_uncertainty=[1.0]))


def test_lives_that_are_elsewhere() -> None:
    assert not believed(made(90))
    assert not believed(sound(before=0.04))


@pytest.mark.parametrize("size", [-0.1, 0.1])
def test_one_odd_run_does_not_count(size: float) -> None:
    assert believed(sound(last=size))


def test_a_last_run_like_those_before_counts_where_only_the_lives_are_elsewhere() -> None:
    seen = sound()
    late = replace(seen, days=np.append(seen.days[:-1], 400.0))
    worn = lives_from_normal(np.zeros((50, NUMBERS)), replace(PRIOR, rate=1e-3, onset=60.0), 0.1, 0.0, 1.0)
    assert fits_newest_runs(worn, fill_temperature(seen, PRIOR), PRIOR, 400.0)
    assert not fits_newest_runs(worn, fill_temperature(late, PRIOR), PRIOR, 400.0)
