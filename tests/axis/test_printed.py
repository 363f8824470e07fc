"""Eq. (1) as printed, and what is wrong with it in numbers."""

from __future__ import annotations

import math

import pytest

from ballscrew.axis import compliance
from ballscrew.axis.printed import preload_as_printed

RIGIDITY, LOAD_RATING = 450e6, 17e3


def test_the_printed_twist_is_thirteen_times_the_right_one():
    screw = {"lead": 0.01, "diameter": 0.0214, "shear_modulus": 80e9}
    beta = compliance.transmission_ratio(0.01)
    printed = 32 * beta * 0.9 / (math.pi * 0.0214**3 * 80e9)
    assert printed == pytest.approx(18.6e-9, abs=0.05e-9)
    right = float(compliance.torsion_compliance(0.9, **screw))
    assert printed / right == pytest.approx(0.0214 / beta)
    assert printed / right == pytest.approx(13.4, abs=0.05)


@pytest.mark.parametrize("percent", [8, 4, 1])
def test_the_printed_preload_lacks_a_cube(percent):
    preload = percent / 100 * LOAD_RATING
    bracket = 1 / float(compliance.nut_rigidity(preload, RIGIDITY, LOAD_RATING, 0.1))
    unit = 0.1 * LOAD_RATING
    printed = preload_as_printed(bracket, rigidity=RIGIDITY, load_rating=LOAD_RATING)
    assert unit * (printed / unit) ** 3 == pytest.approx(preload)
    assert printed > preload
