"""Generalised least squares in closed form, its misfit, and the propagation of errors."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from tests.estimation.made_runs import BEARING, MODEL, run_of

from ballscrew.calibration.assumptions import Assumptions
from ballscrew.calibration.covariance import joint_covariance, run_covariance
from ballscrew.calibration.frequency_table import frequency_table, paired_cells
from ballscrew.estimation.change import change_covariance
from ballscrew.estimation.compliance import change_from_model, change_since
from ballscrew.estimation.fusion import fuse, misfit
from ballscrew.estimation.samples import normal_samples, quantity_from_samples

BASE = frequency_table(run_of(name="base", uncertainty=1e-3))
NOTHING = Assumptions(
    bearing_drift=0, load=0, position=0, tilt=0, form=0, nut_load=0, nut_load_spread=0, floor=1e-9
)


def test_the_terms_are_the_joint_covariance_of_both_runs() -> None:
    run = frequency_table(run_of(0.6, uncertainty=1e-3, nut_load=5e-4, scatter=1e-3))
    base = frequency_table(run_of(name="base", uncertainty=8e-4, nut_load=4e-4))
    change = change_since(run, base, MODEL, BEARING, assumptions=NOTHING)
    rows, of_base = paired_cells(run, base)
    f, f0 = run.frequency[rows], base.frequency[of_base]
    part = 2 * (1 + change.y)
    slopes = np.zeros((len(rows), len(run.frequency) + len(base.frequency)))
    for row, (i, j) in enumerate(zip(rows, of_base, strict=True)):
        slopes[row, i] = -part[row] / f[row]
        slopes[row, len(run.frequency) + j] = part[row] / f0[row]
    expected = slopes @ joint_covariance([run, base]) @ slopes.T
    np.testing.assert_allclose(change_covariance(change, floor=False), expected, atol=1e-14)


@pytest.mark.parametrize(("ratio", "relative"), [(1.0, 0.0), (1.5, 2 * 0.5 * 4e-3)])
def test_what_the_dampers_shift_cancels_at_one_damping_ratio(ratio: float, relative: float) -> None:
    """Y changes by twice the difference of the shifts of both runs, and by nothing else of this error."""
    runs = [run_of(name=name, uncertainty=1e-3) for name in ("base", "later")]
    tables = [frequency_table(run) for run in runs]
    damped = [
        dataclasses.replace(
            table,
            shared=np.vstack([table.shared, size * table.frequency]),
            shared_names=(*table.shared_names, "damping"),
            repeats=np.append(table.repeats, True),
        )
        for table, size in zip(tables, (4e-3, ratio * 4e-3), strict=True)
    ]
    plain = change_since(tables[1], tables[0], MODEL, BEARING, assumptions=NOTHING)
    change = change_since(damped[1], damped[0], MODEL, BEARING, assumptions=NOTHING)
    added = change_covariance(change, floor=False) - change_covariance(plain, floor=False)
    np.testing.assert_allclose(added, relative**2, atol=1e-12)


def test_without_a_baseline_the_terms_are_the_runs_own_covariance() -> None:
    run = frequency_table(run_of(0.6, uncertainty=1e-3))
    change = change_from_model(run, MODEL, BEARING, NOTHING)
    part = 2 * (1 + change.y) / run.frequency
    np.testing.assert_allclose(
        change_covariance(change, floor=False), part[:, None] * run_covariance(run) * part, atol=1e-14
    )


def test_the_weights_determine_the_level_and_no_slope() -> None:
    change = change_since(frequency_table(run_of(0.6)), BASE, MODEL, BEARING)
    fused = fuse(change)
    assert fused.weights @ change.nut_share == pytest.approx(1.0)
    assert fused.level == pytest.approx(0.6 ** (-1 / 3) - 1, rel=1e-9)
    assert np.abs(fused.residual).max() < 1e-12


def test_a_bad_cell_among_forty_does_not_decide() -> None:
    base = run_of(name="base", uncertainty=1e-3)
    cells = list(run_of(0.8, uncertainty=1e-3).cells)
    cells[7] = dataclasses.replace(cells[7], frequency_Hz=0.93 * cells[7].frequency_Hz)
    run = dataclasses.replace(run_of(0.8, uncertainty=1e-3), cells=tuple(cells))
    fused = fuse(change_since(frequency_table(run), frequency_table(base), MODEL, BEARING))
    assert (1 + fused.level) ** -3 == pytest.approx(0.8, abs=0.03)
    assert fused.probability < 0.01


def test_chi2_is_distributed_as_stated() -> None:
    rng = np.random.default_rng(1)
    n = 30
    x = np.linspace(-1, 1, n)
    roots = np.stack([np.full(n, 1e-3), 7e-4 * x, 3e-4 * x**2])  # three numbers in thirty cells
    true, floor = roots.T @ roots, np.full(n, 2e-5)
    nut = (0.2 / (1.5 + x))[:, None]
    small, degrees = 0, []
    for _ in range(400):
        residual = rng.standard_normal(3) @ roots
        _, d, p = misfit(residual, nut, true, floor)
        small += p < 0.05
        degrees.append(d)
    assert 4 <= small <= 40  # 20 expected
    assert 1.5 < degrees[0] < 3


def test_a_column_that_is_a_multiple_of_another_changes_no_misfit() -> None:
    """As the signatures of nut and bearing: the second took a random direction with it."""
    rng, x = np.random.default_rng(0), np.linspace(-1, 1, 12)
    nut = (0.2 / (1.5 + x))[:, None]
    covariance, floor, residual = np.diag(1e-6 * (2 + x)), np.full(12, 2e-5), 1e-3 * rng.standard_normal(12)
    alone = misfit(residual, nut, covariance, floor)
    both = misfit(residual, np.hstack([nut, 0.3 * nut]), covariance, floor)
    np.testing.assert_allclose(both, alone, rtol=1e-9)
    other = np.hstack([nut, x[:, None]])
    small = misfit(residual, np.hstack([nut, 1e-10 * x[:, None]]), covariance, floor)
    np.testing.assert_allclose(small, misfit(residual, other, covariance, floor), rtol=1e-6)
    assert misfit(residual, nut[:, :0], covariance, floor)[1] > alone[1]


def test_nothing_free_is_no_misfit() -> None:
    assert misfit(np.zeros(1), np.ones((1, 1)), np.ones((1, 1)), np.ones(1)) == (0.0, 0.0, 1.0)


def test_samples_have_the_requested_covariance_and_mean() -> None:
    wanted = np.array([[1.0, 0.6, 0.0], [0.6, 1.0, 0.0], [0.0, 0.0, 0.0]])
    samples, beside = normal_samples(wanted, 2)
    np.testing.assert_allclose(np.cov(samples.T), wanted, atol=0.03)
    assert np.abs(samples.mean(axis=0)).max() < 1e-12
    assert beside.shape == (len(samples), 2)
    np.testing.assert_array_equal(normal_samples(wanted, 2)[0], samples)


def test_a_quantity_without_upper_end_is_none() -> None:
    assert quantity_from_samples(1.0, np.array([0.5] * 90 + [np.inf] * 10)) is None
    quantity = quantity_from_samples(1.0, np.linspace(0, 2, 2001))
    assert quantity is not None
    assert quantity.interval == pytest.approx((0.05, 1.95), abs=0.002)
