"""The second simulator agrees with the prediction of its data sheet."""

from __future__ import annotations

import numpy as np
import pytest
from benchmarks.axis_sampling import random_axis
from benchmarks.distributed_screw import Machine, pair

from ballscrew.axis.frequency import predicted_frequency


@pytest.mark.parametrize("seed", [1, 2])
def test_on_a_heavy_base_its_frequency_is_the_predicted_one(
    seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Machine, "base", (1e9, 1.0))
    axis = random_axis(seed)
    machine = Machine(axis.rig.machine.sheet, axis.load, seed)
    for place in (axis.plan.positions[0], axis.plan.positions[-1]):
        expected = float(predicted_frequency(machine.sheet, place, axis.load))
        assert machine.frequency(place) == pytest.approx(expected, rel=5e-3)


def test_two_contacts_carry_until_one_is_released() -> None:
    stiffness, approach = 1e10, 8e-6
    preload = stiffness * approach**1.5
    step = 1e-9
    slope = (pair(step, stiffness, approach) - pair(-step, stiffness, approach)) / (2 * step)
    assert slope == pytest.approx(3 * preload / approach, rel=1e-4)
    assert pair(approach, stiffness, approach) == pytest.approx(2 * np.sqrt(2) * preload)
