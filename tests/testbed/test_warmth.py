from __future__ import annotations

import numpy as np
import pytest

from ballscrew.axis.imitation import warm_screw
from ballscrew.axis.wear import preload_after_wear
from ballscrew.base.errors import InputError
from ballscrew.testbed.example import AXIS
from ballscrew.testbed.experiments import run_to_failure_duty
from ballscrew.testbed.exposure import uniform_exposure
from ballscrew.testbed.machine import Machine
from ballscrew.testbed.warmth import (
    ThermalModel,
    friction_power,
    pressed_more,
    temperature_difference,
    warm_growth,
    warmed,
)
from ballscrew.testbed.wear_life import Life, wear_states

WARMTH = ThermalModel(resistance=0.5, time_constant=0.75)


def test_drag_heats_in_proportion_to_the_preload():
    power = friction_power(run_to_failure_duty(), AXIS, np.array([0.0, 340.0, 680.0]))
    np.testing.assert_allclose(power[1:] / power[2], [0.5, 1])
    assert power[0] == 0
    assert 5 < power[2] < 30


def test_warmth_comes_and_goes_by_its_time_constant():
    got = temperature_difference(WARMTH, 10.0, np.array([0.0, 0.75, 50.0]))
    np.testing.assert_allclose(got, [0, 5 * (1 - np.exp(-1)), 5])
    assert temperature_difference(WARMTH, 10.0, 50.0, 0.75) == pytest.approx(5 * np.exp(-1))
    # In two parts or at once.
    half = temperature_difference(WARMTH, 10.0, 0.3)
    assert temperature_difference(WARMTH, 10.0, 0.5, before=half) == pytest.approx(
        float(temperature_difference(WARMTH, 10.0, 0.8))
    )


@pytest.mark.parametrize("difference", [-3.0, 0.0, 5.0])
def test_a_warm_screw_presses_as_the_imitation_has_it(difference):
    life = Life(AXIS, uniform_exposure([0.0, 0.2, 0.45], 100.0), AXIS.nominal_preload)
    state, cold = wear_states(life, [100.0, 100.0], [difference, 0.0])
    left = float(cold.preload(0.1))
    ratio = 1 + warm_screw(AXIS, difference, AXIS.screw.nominal_diameter / 2, preload=left)
    assert float(state.preload(0.1)) == pytest.approx(left * float(ratio), rel=1e-9)
    np.testing.assert_array_equal(state.wear, cold.wear)
    assert left == pytest.approx(float(preload_after_wear(cold.wear[0], life.preload, cold.kappa)))


def test_growth_is_that_of_the_radius():
    assert float(warm_growth(AXIS, 5.0)) == pytest.approx(11.5e-6 * 5 * 0.0125, rel=1e-9)


def test_numbers_that_cannot_be():
    with pytest.raises(InputError, match="time at work"):
        temperature_difference(WARMTH, 10.0, -1.0)
    with pytest.raises(InputError, match="friction power"):
        temperature_difference(WARMTH, -10.0, 1.0)
    with pytest.raises(InputError, match="difference"):
        warm_growth(AXIS, float("nan"))


def test_a_warmed_machine_rings_higher_as_the_law_says():
    new = Machine(AXIS, AXIS.nominal_preload)
    warm, cold = warmed(new, 5.0), warmed(new, -5.0)
    # physics of the page "What imitates a loss of preload": some 14 % for 5 K on a 25 mm screw.
    assert float(warm.local_preload(0.2)) / new.preload == pytest.approx(1.14, abs=0.02)
    assert float(cold.local_preload(0.2)) < new.preload
    assert float(pressed_more(warm, -float(warm_growth(AXIS, 5.0))).local_preload(0.0)) == pytest.approx(
        new.preload
    )


def test_warmth_takes_backlash_first():
    played = Machine(AXIS, 0.0, 1e-6)
    assert float(pressed_more(played, 0.2e-6).local_backlash(0.1)) == pytest.approx(0.6e-6)
    assert float(pressed_more(played, 0.6e-6).local_preload(0.1)) > 0
