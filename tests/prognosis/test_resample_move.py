"""Posteriors of the resample-move filter beside their closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from ballscrew.prognosis.resample_move import filtered, tempered

Array = NDArray[np.float64]


def posterior(observed: Array, spread: Array, marks: list[int], seed: int = 1) -> list[tuple[float, float]]:
    """Mean and standard deviation of z[0], observed with noise; z[1] is not observed."""

    def likelihood(z: Array, start: int, stop: int) -> Array:
        error = (observed[start:stop] - z[:, :1]) / spread[start:stop]
        return -0.5 * error**2

    out = []
    for z in filtered(likelihood, 2, marks, 4000, 8, seed):
        mean = z.mean(axis=0)
        assert mean[1] == pytest.approx(0, abs=0.1)
        assert np.mean(z[:, 1] ** 2) == pytest.approx(1, abs=0.15)
        out.append((float(mean[0]), float(z[:, 0].std())))
    return out


def test_closed_form_at_every_mark() -> None:
    random = np.random.default_rng(4)
    observed, spread = 1.3 + 0.5 * random.standard_normal(60), np.full(60, 0.5)
    marks = [0, 1, 7, 60]
    for mark, (mean, deviation) in zip(marks, posterior(observed, spread, marks), strict=True):
        precision = 1 + mark / 0.25
        assert deviation == pytest.approx(precision**-0.5, rel=0.1)
        assert mean == pytest.approx(
            observed[:mark].sum() / 0.25 / precision, abs=0.15 * precision**-0.5 + 0.01
        )


def test_a_too_informative_run_is_introduced_in_parts() -> None:
    ((mean, deviation),) = posterior(np.array([2.5]), np.array([0.001]), [1])
    assert mean == pytest.approx(2.5, abs=5e-4)
    assert deviation == pytest.approx(0.001, rel=0.2)


def test_the_same_seed_gives_the_same_numbers() -> None:
    observed = np.array([0.4, 0.6, 0.5])
    assert posterior(observed, observed, [3]) == posterior(observed, observed, [3])


def test_all_runs_at_once_agree_with_the_closed_form() -> None:
    random = np.random.default_rng(4)
    observed, spread = 1.3 + 0.05 * random.standard_normal(60), 0.05

    def likelihood(z: Array, start: int, stop: int) -> Array:
        return -0.5 * ((observed[start:stop] - z[:, :1]) / spread) ** 2

    z = tempered(likelihood, 2, 60, 4000, 8, 1)
    precision = 1 + 60 / spread**2
    mean = float(z[:, 0].mean())
    assert mean == pytest.approx(observed.sum() / spread**2 / precision, abs=0.15 * precision**-0.5)
    assert float(z[:, 0].std()) == pytest.approx(precision**-0.5, rel=0.1)
    assert float(np.sqrt(np.mean(z[:, 1] ** 2))) == pytest.approx(1, rel=0.1)


def test_particles_move_in_a_narrow_posterior() -> None:
    """A narrow curved posterior, in which steps as long as its spread are hardly ever accepted."""

    def likelihood(z: Array, start: int, stop: int) -> Array:
        return -0.5 * ((z[:, :1] ** 2 + z[:, 1:] - 1) / 0.003) ** 2 * np.ones(stop - start)

    (z,) = filtered(likelihood, 2, [1], 2000, 8, 1)
    assert float(np.mean(np.abs(z[:, 0] ** 2 + z[:, 1] - 1))) < 0.006
    assert len(np.unique(z[:, 0])) > 1200  # with a random walk of one length, 630
