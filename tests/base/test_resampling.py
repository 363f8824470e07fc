"""Systematic resampling."""

from __future__ import annotations

import numpy as np
import pytest

from ballscrew.base.resampling import systematic


def test_systematic_resampling_takes_each_by_its_weight() -> None:
    count = np.bincount(systematic(np.array([0.5, 0.25, 0.25, 0.0]), 0.3, 8), minlength=4)
    assert count.tolist() == [4, 2, 2, 0]


@pytest.mark.parametrize("size", [1, 7, 500, 1000])
def test_equal_weights_are_taken_evenly(size: int) -> None:
    chosen = systematic(np.full(1000, 1e-3), 0.5, size)
    np.testing.assert_allclose(chosen, (np.arange(size) + 0.5) * 1000 / size, atol=1.0)


def test_a_weight_on_one_is_all_its_own() -> None:
    assert set(systematic(np.eye(5)[3], 0.2).tolist()) == {3}
