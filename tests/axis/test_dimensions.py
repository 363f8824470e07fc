"""Each equation has the dimension that it claims, and why that does not prove it.

A formula that is right in its dimensions gives the same quantity in any coherent system of units. So each is
called with SI numbers, and again with the numbers of a made-up system, whose metre, kilogram and second are
other ones; pint says by which power of each a unit is to be scaled.
"""

from __future__ import annotations

from functools import partial

import numpy as np
import pint
import pytest

from ballscrew.axis import compliance, drag, equations, hertz, wear
from ballscrew.axis.equations import (
    Theta,
    frequency_from_preload,
    limit_frequency,
    oscillating_mass,
    preload_at_frequency,
)
from ballscrew.axis.printed import preload_as_printed

UNITS = pint.UnitRegistry()
OTHER = {"[length]": 7.3, "[mass]": 0.31, "[time]": 19.0}  # how many of its units are one of SI's

SHAFT = {"diameter": (0.0214, "m"), "youngs_modulus": (206e9, "Pa")}
TWIST = {"lead": (0.01, "m"), "diameter": (0.0214, "m"), "shear_modulus": (80e9, "Pa")}
NUT = {"rigidity": (450e6, "N/m"), "load_rating": (17e3, "N")}
KAPPA = {"kappa": (3.016e7, "N**(2/3)/m")}
LOADED = {"preload": (680.0, "N"), **KAPPA}
THETA = {
    "a": (-0.4071, "N**(-1/3)/m"),
    "b": (-0.2164, "N**(-1/3)"),
    "c": (7.641e5, "N**(2/3)/m"),
    "d": (2.35, "kg"),
}
PLACE = {"x_t": (0.2, "m"), "m_t": (100.0, "kg"), "rotor_mass": (170.0, "kg")}


def with_theta(function, **arguments):
    axis = Theta(**{name: arguments.pop(name) for name in "abcd" if name in arguments})
    return function(theta=axis, **arguments)


def fixed_fixed(**arguments):
    return compliance.support_compliance(support="fixed-fixed", **arguments)


F, P = partial(with_theta, frequency_from_preload), {"preload": (680.0, "N")}
CASES = {
    "transmission ratio": (compliance.transmission_ratio, {"lead": (0.01, "m")}, "m"),
    "shaft": (partial(compliance.shaft_compliance, support="fixed-free"), {"x": (0.3, "m"), **SHAFT}, "m/N"),
    "shaft held at both ends": (
        partial(compliance.shaft_compliance, support="fixed-fixed"),
        {"x": (0.3, "m"), "length": (0.9, "m"), **SHAFT},
        "m/N",
    ),
    "shaft and bearings": (
        fixed_fixed,
        {"x": (0.3, "m"), "length": (0.9, "m"), "bearing_stiffness": (180e6, "N/m"), **SHAFT},
        "m/N",
    ),
    "twist": (compliance.torsion_compliance, {"length": (0.3, "m"), **TWIST}, "m/N"),
    "coupling": (compliance.coupling_compliance, {"lead": (0.01, "m"), "stiffness": (5e3, "N*m")}, "m/N"),
    "bearing": (compliance.bearing_compliance, {"stiffness": (180e6, "N/m")}, "m/N"),
    "kappa": (partial(compliance.nut_kappa, ratio=0.1), NUT, "N**(2/3)/m"),
    "nut": (partial(compliance.nut_rigidity, ratio=0.1), {**NUT, "preload": (680.0, "N")}, "N/m"),
    "screw's mass": (
        compliance.screw_mass,
        {"diameter": (0.0214, "m"), "length": (0.9, "m"), "density": (7850.0, "kg/m**3")},
        "kg",
    ),
    "screw's inertia": (
        compliance.screw_inertia,
        {"nominal_diameter": (0.025, "m"), "length": (0.9, "m"), "density": (7850.0, "kg/m**3")},
        "kg*m**2",
    ),
    "rotor": (compliance.rotor_equivalent_mass, {"inertia": (3e-4, "kg*m**2"), "lead": (0.01, "m")}, "kg"),
    "Eq. (2)": (partial(with_theta, preload_at_frequency), {**PLACE, **THETA, "f_a": (150.0, "Hz")}, "N"),
    "Eq. (3)": (F, {**PLACE, **THETA, **P}, "Hz"),
    "its limit": (partial(with_theta, limit_frequency), {**PLACE, **THETA}, "Hz"),
    "its mass": (
        partial(with_theta, oscillating_mass),
        {**{name: PLACE[name] for name in ("m_t", "rotor_mass")}, **THETA},
        "kg",
    ),
    "P/P₀": (
        partial(equations.preload_change, nut_share=0.3),
        {"frequency": (149.0, "Hz"), "reference_frequency": (150.0, "Hz")},
        "",
    ),
    "K_h": (hertz.hertz_constant, KAPPA, "N/m**1.5"),
    "δ₀": (hertz.preload_deflection, LOADED, "m"),
    "F(δ)": (hertz.nut_force, {"deflection": (3e-6, "m"), **LOADED}, "N"),
    "F(δ) released": (hertz.nut_force, {"deflection": (3e-5, "m"), **LOADED}, "N"),
    "δ(F)": (hertz.nut_deflection, {"force": (700.0, "N"), **LOADED}, "m"),
    "k(F)/k(0)": (hertz.tangent_ratio, {"nut_load": (700.0, "N"), "preload": (680.0, "N")}, ""),
    "k(F)": (hertz.nut_rigidity_under_load, {"nut_load": (700.0, "N"), **LOADED}, "N/m"),
    "apparent preload": (hertz.apparent_preload, {"nut_load": (700.0, "N"), "preload": (680.0, "N")}, "N"),
    "P(w)": (wear.preload_after_wear, {"wear": (2e-6, "m"), **LOADED}, "N"),
    "B(w)": (wear.backlash_after_wear, {"wear": (2e-5, "m"), **LOADED}, "m"),
    **{
        f"P(N), {name}": (law, {**P, "travel": (9e3, "m"), "half_travel": (2e4, "m")}, "N")
        for name, law in wear.WEAR_LAWS.items()
    },
    "drag": (
        drag.preload_torque,
        {"preload": (680.0, "N"), "lead": (0.01, "m"), "pitch_diameter": (0.025, "m")},
        "N*m",
    ),
}


def scale(unit: str) -> float:
    """Number of the other system's units in a unit of this one."""
    dimension = (1 * UNITS.parse_units(unit or "dimensionless")).dimensionality
    return float(np.prod([OTHER[base] ** float(power) for base, power in dimension.items()]))


def holds(function, arguments, unit):
    here = function(**{name: value for name, (value, _) in arguments.items()})
    there = function(**{name: value * scale(of) for name, (value, of) in arguments.items()})
    return bool(np.isclose(float(there), float(here) * scale(unit), rtol=1e-9, atol=0))


@pytest.mark.parametrize("name", CASES)
def test_the_dimension_is_right(name):
    assert holds(*CASES[name])


@pytest.mark.parametrize("name", CASES)
def test_the_check_sees_a_wrong_dimension(name):
    function, arguments, unit = CASES[name]
    assert not holds(function, arguments, f"({unit or 'dimensionless'})*m**0.5")
    first = next(iter(arguments))
    wrong = {**arguments, first: (arguments[first][0], f"({arguments[first][1]})*kg**0.5")}
    assert not holds(function, wrong, unit)


def test_why_it_cannot_see_the_missing_cube():
    """0.8 K times the bracket has no dimension, so any power of it gives newtons; only numbers tell."""
    bracket = {"bracket": (4e-9, "m/N"), **NUT}

    def to_the_power(power, bracket, rigidity, load_rating):
        return 0.1 * load_rating / (0.8 * rigidity * bracket) ** power

    for power in (1, 3, -2, 0.5):
        assert holds(partial(to_the_power, power), bracket, "N")
    assert holds(preload_as_printed, bracket, "N")
    # What does: a nut of known preload. The cube gives it back, the printed form does not.
    preload = 680.0
    left = 1 / float(compliance.nut_rigidity(preload, 450e6, 17e3, 0.1))
    known = {"bracket": left, "rigidity": 450e6, "load_rating": 17e3}
    assert to_the_power(3, **known) == pytest.approx(preload)
    assert float(preload_as_printed(**known)) == pytest.approx(1253, abs=1)
