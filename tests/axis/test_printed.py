"""Eq. (1) as printed, what is wrong with it in numbers, and corrected."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ballscrew.axis import compliance
from ballscrew.axis.frequency import predicted_frequency, rotor_mass
from ballscrew.axis.printed import (
    equation_1_as_printed,
    equation_1_corrected,
    preload_as_printed,
    torsion_as_printed,
)
from ballscrew.base.errors import InputError

RIGIDITY, LOAD_RATING = 450e6, 17e3
M = {
    "rigidity": RIGIDITY, "load_rating": LOAD_RATING, "diameter": 0.0214, "shear_modulus": 80e9,
    "youngs_modulus": 206e9, "lead": 0.01, "nut_mass": 1.5, "bearing_stiffness": 180e6,
    "screw_mass": math.pi * 0.0214**2 / 4 * 0.9 * 7850,
}  # fmt: skip


def test_the_printed_twist_is_thirteen_times_the_right_one():
    screw = {"lead": 0.01, "diameter": 0.0214, "shear_modulus": 80e9}
    printed = torsion_as_printed(length=0.9, **screw)
    assert printed == pytest.approx(18.6e-9, abs=0.05e-9)
    right = float(compliance.torsion_compliance(0.9, **screw))
    assert printed / right == pytest.approx(0.0214 / compliance.transmission_ratio(0.01))
    assert printed / right == pytest.approx(13.4, abs=0.05)


@pytest.mark.parametrize("percent", [8, 4, 1])
def test_the_printed_preload_lacks_a_cube(percent):
    preload = percent / 100 * LOAD_RATING
    bracket = 1 / float(compliance.nut_rigidity(preload, RIGIDITY, LOAD_RATING, 0.1))
    unit = 0.1 * LOAD_RATING
    printed = preload_as_printed(bracket, rigidity=RIGIDITY, load_rating=LOAD_RATING)
    assert unit * (printed / unit) ** 3 == pytest.approx(preload)
    assert printed > preload


def test_each_printed_term_by_hand():
    bracket = (
        -4 * 0.2 / (math.pi * 0.0214**2 * 206e9)
        - 32 * (0.01 / (2 * math.pi)) * 0.9 / (math.pi * 0.0214**3 * 80e9)
        - 1 / 180e6
        + 1 / ((2 * math.pi * 60.0) ** 2 * (100 + M["screw_mass"] + 1.5))
    )
    got = equation_1_as_printed(0.2, 60.0, 100.0, length=0.9, **M)
    assert float(got) == pytest.approx(0.1 * LOAD_RATING / (0.8 * RIGIDITY * bracket))


def test_the_printed_twist_alone_is_more_than_the_whole_compliance_of_an_axis():
    # 18.6 nm/N, where x = 0 has 10.95 in all: at the frequency of a new axis Eq. (1) gives no preload.
    assert float(equation_1_as_printed(0.0, 150.37, 100.0, length=0.9, **M)) < 0


@pytest.mark.parametrize("rotor", ["free", "held"])
@given(x=st.floats(0, 0.45), load=st.floats(0, 100), preload=st.floats(5, 2000))
def test_corrected_it_inverts_the_frequency(axes, rotor, x, load, preload):
    sheet = axes["M"]
    f = predicted_frequency(sheet, x, load, preload, rotor)
    got = equation_1_corrected(
        x, f, 100.0 + load, rigidity_preload_ratio=0.1, bearing_to_zero=0.12,
        rotor_mass=rotor_mass(sheet) if rotor == "free" else math.inf, **M,
    )  # fmt: skip
    assert float(got) == pytest.approx(preload, rel=1e-9)


def test_a_softer_coupling_leaves_less_for_the_nut():
    stiff, soft = (
        float(
            equation_1_corrected(
                0.2, 125.0, 100.0, rigidity_preload_ratio=0.1, bearing_to_zero=0.12, coupling_stiffness=k, **M
            )
        )
        for k in (1e6, 1e4)
    )
    assert soft > stiff


def test_a_frequency_that_no_preload_explains():
    with pytest.raises(InputError, match="a frequency of 300 Hz was given; it is above"):
        equation_1_corrected(
            0.2, np.array([125.0, 300.0]), 100.0, rigidity_preload_ratio=0.1, bearing_to_zero=0.12, **M
        )


@pytest.mark.parametrize(
    ("x", "f", "mass"), [(0.2, 0.0, 100.0), (0.2, -150.0, 100.0), (-0.5, 120.0, 100.0), (0.2, 120.0, -100.0)]
)
def test_numbers_that_cannot_be(x, f, mass):
    with pytest.raises(InputError, match="was given; it must be"):
        equation_1_corrected(x, f, mass, rigidity_preload_ratio=0.1, bearing_to_zero=0.12, **M)
