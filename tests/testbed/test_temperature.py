"""The machine at other temperatures."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ballscrew.axis.imitation import warm_screw
from ballscrew.base.errors import InputError
from ballscrew.testbed.example import AXIS
from ballscrew.testbed.machine import Machine
from ballscrew.testbed.temperature import pressed_more, warmed


@pytest.mark.parametrize("difference", [-3.0, 0.0, 5.0])
def test_a_warm_screw_presses_as_the_formula_has_it(difference):
    new = Machine(AXIS, AXIS.nominal_preload)
    ratio = 1 + warm_screw(AXIS, difference, AXIS.screw.nominal_diameter / 2)
    assert float(warmed(new, difference).local_preload(0.1)) == pytest.approx(new.preload * float(ratio))
    # physics of the page "What imitates a loss of preload": some 14 % for 5 K on a 25 mm screw.
    growth = float(warmed(new, 5.0).pressed(0.1) - new.pressed(0.1))
    assert growth == pytest.approx(11.5e-6 * 5 * 0.0125, rel=1e-9)
    assert float(warmed(new, 5.0).local_preload(0.2)) / new.preload == pytest.approx(1.14, abs=0.02)
    assert float(pressed_more(warmed(new, 5.0), -growth).local_preload(0.0)) == pytest.approx(new.preload)


def test_a_difference_of_temperature_must_be_finite():
    with pytest.raises(InputError, match="difference"):
        warmed(Machine(AXIS, 100.0), float("nan"))


def test_warmth_takes_backlash_first():
    played = Machine(AXIS, 0.0, 1e-6)
    assert float(pressed_more(played, 0.2e-6).local_backlash(0.1)) == pytest.approx(0.6e-6)
    assert float(pressed_more(played, 0.6e-6).local_preload(0.1)) > 0


def test_a_gradient_presses_each_place_as_its_own_difference_does():
    new = Machine(AXIS, AXIS.nominal_preload)
    places = np.array([0.0, 0.2, 0.45])
    expected = [float(warmed(new, 2.0 + 10.0 * place).local_preload(place)) for place in places]
    assert warmed(new, 2.0, 10.0).local_preload(places) == pytest.approx(expected, rel=1e-9)


def test_a_gradient_adds_to_the_wear():
    worn = Machine(AXIS, AXIS.nominal_preload, lost=((0.1, 0.0), (0.2, 1e-6)))
    warm = warmed(worn, 0.0, 10.0)
    growth = warmed(replace(worn, lost=()), 0.0, 10.0).pressed(0.2) - worn.pressed(0.0)
    assert float(warm.pressed(0.2)) == pytest.approx(float(worn.pressed(0.2)) + growth, rel=1e-9)


def test_a_gradient_softens_the_shaft_by_its_mean():
    warm = warmed(Machine(AXIS, AXIS.nominal_preload), 0.0, 10.0).sheet.screw
    mean = 10.0 * (AXIS.travel_limit - AXIS.screw.bearing_to_zero) / 2
    assert warm.youngs_modulus / AXIS.screw.youngs_modulus == pytest.approx(1 - 3e-4 * mean)
    assert warm.shear_modulus / AXIS.screw.shear_modulus == pytest.approx(1 - 3e-4 * mean)
