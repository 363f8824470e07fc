from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ballscrew.recording.stops import cluster, nearest


def test_stops_that_scatter():
    rng = np.random.default_rng(0)
    true = np.array([0.0, 0.045, 0.09, 0.45])
    seen = np.concatenate([t + 2e-4 * rng.standard_normal(7) for t in true])
    rng.shuffle(seen)
    np.testing.assert_allclose(cluster(seen), true, rtol=0, atol=3e-4)


def test_one_stop_and_none():
    assert cluster([]).size == 0
    assert cluster([0.3]).tolist() == [0.3]
    assert cluster([0.3, 0.3004, 0.3002]).tolist() == [0.3002]


def test_a_gap_is_a_two_hundredth_of_the_travel_or_half_a_millimetre():
    assert len(cluster([0.0, 0.0045, 1.0])) == 2
    assert len(cluster([0.0, 0.0055, 1.0])) == 3
    assert len(cluster([i / 100 for i in range(61)])) == 61, "a fine grid of stops is no single one"
    assert len(cluster([0.0, 0.0004, 0.001])) == 2
    assert len(cluster([0.0, 0.0006, 0.0012])) == 3


def test_the_median_resists_one_that_went_astray():
    assert cluster([0.0, 0.0, 0.0, 0.004, 0.5])[0] == 0.0


@given(
    st.lists(st.integers(-20, 20), min_size=1, max_size=12, unique=True),
    st.integers(0, 2**31),
)
def test_any_stops_of_sufficient_distance(stops, seed):
    rng = np.random.default_rng(seed)
    true = np.sort(np.array(stops)) * 0.05
    seen = np.repeat(true, 3) + rng.uniform(-2e-4, 2e-4, 3 * len(true))
    rng.shuffle(seen)
    found = cluster(seen)
    assert len(found) == len(true)
    assert np.abs(found - true).max() <= 2e-4
    assert np.all(np.diff(found) > 0)
    assert nearest(seen, true).tolist() == [int(np.argmin(np.abs(true - x))) for x in seen]


def test_the_nearest_of_a_plan():
    stops = (0.0, 0.1, 0.3)
    assert nearest([-5.0, 0.049, 0.051, 0.21, 9.0], stops).tolist() == [0, 0, 1, 2, 2]
    assert nearest([], stops).shape == (0,)
    with pytest.raises(ValueError, match="empty"):
        nearest([0.1], [])
