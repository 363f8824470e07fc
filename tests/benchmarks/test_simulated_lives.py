"""The simulated lives end where they say, and are worn as the laws say."""

from __future__ import annotations

import numpy as np
import pytest
from benchmarks.simulated_lives import LIFE, live


@pytest.mark.parametrize("seed", [90001, 90002, 90003])
def test_a_life_ends_where_it_says(seed: int) -> None:
    one = live(seed)
    assert LIFE[0] - 1 <= one.end - one.onset <= LIFE[1] + 1
    assert one.end - 5 <= one.history.days[-1] <= one.end + 1
    late = one.history.days > one.end - 15
    # The last runs tell about half of the preload: the scale is known to 10 %.
    assert float(np.median((1 + one.history.level[late]) ** -3)) == pytest.approx(0.52, abs=0.12)


def test_it_is_healthy_at_first() -> None:
    one = live(90001)
    before = one.history.days < one.onset
    assert abs(float(np.median(one.history.level[before]))) < 0.06


def test_the_same_seed_the_same_life() -> None:
    assert live(90004).history.level.tolist() == live(90004).history.level.tolist()
