from __future__ import annotations

import numpy as np
import pytest
from benchmarks.corruptions import CORRUPTIONS, table
from benchmarks.fault_injection import RecordedTrips, sensors

RATE = 12800.0


def run():
    random = np.random.default_rng(0)
    names = ("torque", "position", "acc1_x", "acc2_x")
    return RecordedTrips(
        tuple({name: random.standard_normal(4000) for name in names} for _ in range(3)), RATE
    )


# Loose sensors are tested with the catalogue of faults.
OWN = [key for key, c in CORRUPTIONS.items() if c.group == "own" and c.change and "loose" not in key]


@pytest.mark.parametrize("key", OWN)
def test_each_corruption_changes_the_trips(key):
    before = run()
    after = CORRUPTIONS[key].change(before, np.random.default_rng(1))
    same = after.rate == RATE and len(after.trips) == 3
    for one, other in zip(before.trips, after.trips, strict=False):
        same = same and all(np.array_equal(one[name], other[name]) for name in one)
    assert not same


def test_a_high_pass_removes_the_mean_and_a_low_pass_retains_it():
    x = np.full(4000, 2.0)
    assert np.allclose(sensors.high_pass(x, RATE, 1.0), 0.0, atol=1e-9)
    assert np.allclose(sensors.low_pass(x, RATE, 100.0), 2.0)


def test_the_table_counts_good_cells_outside_their_interval():
    key = "true rate +0.5 %"
    cells = [(0.1, 0.1, True, 150.0), (0.3, 0.1, True, 150.0), (0.3, 0.1, False, 150.0)]
    row = {"bench": "bench", "key": key, "group": "own", "verdict": "good", "cells": cells, "count": 4}
    assert table([row], ("own",))[-1] == f"| {key} | bench | good | 3 of 4 | 2 | 1 | 2 | 0.30 ± 0.20 |"
