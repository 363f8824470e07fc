"""Agreement of lives with the newest runs, of which one may be an outlier."""

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


def fits(history: PreloadHistory) -> bool:
    return fits_newest_runs(NEW, fill_temperature(history, PRIOR), PRIOR, float(history.days[-1]))


def sound(last: float = 0.0, before: float = 0.0) -> PreloadHistory:
    level = 0.004 * np.random.default_rng(2).standard_normal(30)
    level[-5:] += before
    level[-1] += last
    return preload_history(np.arange(30.0), level, 0.005)


def test_lives_near_the_runs_fit() -> None:
    assert fits(sound())
    assert fits(preload_history([0.0], friction=[40.0], friction_uncertainty=[1.0]))


def test_lives_far_from_the_runs_do_not_fit() -> None:
    assert not fits(made(90))
    assert not fits(sound(before=0.04))


@pytest.mark.parametrize("size", [-0.1, 0.1])
def test_one_outlier_does_not_count(size: float) -> None:
    assert fits(sound(last=size))


def test_a_last_run_that_agrees_with_those_before_counts() -> None:
    history = sound()
    late = replace(history, days=np.append(history.days[:-1], 400.0))
    worn = lives_from_normal(np.zeros((50, NUMBERS)), replace(PRIOR, rate=1e-3, onset=60.0), 0.1, 0.0, 1.0)
    assert fits_newest_runs(worn, fill_temperature(history, PRIOR), PRIOR, 400.0)
    assert not fits_newest_runs(worn, fill_temperature(late, PRIOR), PRIOR, 400.0)
