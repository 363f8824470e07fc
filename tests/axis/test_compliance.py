from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ballscrew.axis import compliance
from ballscrew.base.errors import InputError

SHAFT = {"diameter": 0.0214, "youngs_modulus": 206e9}
POSITION = st.floats(0, 0.9)


def test_a_shaft_fixed_at_one_end():
    area = math.pi * 0.0214**2 / 4
    assert compliance.shaft_compliance(0.12, **SHAFT, support="fixed-free") == pytest.approx(
        0.12 / (206e9 * area)
    )


@given(POSITION)
def test_a_supported_end_carries_nothing_along_the_axis(x):
    free = compliance.shaft_compliance(x, **SHAFT, support="fixed-free")
    assert free == compliance.shaft_compliance(x, **SHAFT, support="fixed-supported")


@given(POSITION)
def test_a_shaft_fixed_at_both_ends_is_two_springs_side_by_side(x):
    def one(length: float) -> float:
        return float(compliance.shaft_compliance(length, **SHAFT, support="fixed-free"))

    both = float(compliance.shaft_compliance(x, **SHAFT, support="fixed-fixed", length=0.9))
    left, right = one(x), one(0.9 - x)
    assert both == pytest.approx(left * right / (left + right), abs=1e-18)
    assert both <= min(left, right) + 1e-18


def test_a_shaft_fixed_at_both_ends_is_softest_in_the_middle():
    x = np.linspace(0, 0.9, 91)
    both = compliance.shaft_compliance(x, **SHAFT, support="fixed-fixed", length=0.9)
    assert np.argmax(both) == 45
    assert both[0] == pytest.approx(0, abs=1e-20)
    assert both[-1] == pytest.approx(0, abs=1e-20)


def test_a_shaft_fixed_at_both_ends_needs_its_length():
    with pytest.raises(InputError, match="needs its length"):
        compliance.shaft_compliance(0.1, **SHAFT, support="fixed-fixed")


@given(POSITION, st.floats(1e7, 1e10))
def test_carried_at_one_end_shaft_and_bearing_add_up(x, stiffness):
    got = compliance.support_compliance(x, **SHAFT, bearing_stiffness=stiffness, support="fixed-free")
    shaft = compliance.shaft_compliance(x, **SHAFT, support="fixed-free")
    assert float(got) == pytest.approx(float(shaft) + 1 / stiffness)


@given(POSITION, st.floats(1e7, 1e10))
def test_carried_at_both_ends_both_bearings_carry(x, stiffness):
    # By statics: the two ends' forces add up to 1 N, and both ways to the nut are the same.
    area = math.pi * 0.0214**2 / 4 * 206e9
    near, far = x / area + 1 / stiffness, (0.9 - x) / area + 1 / stiffness
    matrix = np.array([[1.0, 1.0], [near * 1e9, -far * 1e9]])
    force = np.linalg.solve(matrix, [1.0, 0.0])[0]
    got = compliance.support_compliance(
        x, **SHAFT, bearing_stiffness=stiffness, support="fixed-fixed", length=0.9
    )
    assert float(got) == pytest.approx(near * force, rel=1e-9)


def test_rigid_bearings_leave_the_shaft():
    x = np.linspace(0, 0.9, 7)
    rigid = compliance.support_compliance(
        x, **SHAFT, bearing_stiffness=1e20, support="fixed-fixed", length=0.9
    )
    shaft = compliance.shaft_compliance(x, **SHAFT, support="fixed-fixed", length=0.9)
    np.testing.assert_allclose(rigid, shaft, atol=1e-19)


def test_shaft_and_bearings_at_both_ends_need_the_length():
    with pytest.raises(InputError, match="needs its length"):
        compliance.support_compliance(0.1, **SHAFT, bearing_stiffness=1e8, support="fixed-fixed")


def test_an_unknown_support():
    with pytest.raises(InputError, match="the support is 'loose'; it must be one of fixed-free"):
        compliance.shaft_compliance(0.1, **SHAFT, support="loose")


@given(force=st.floats(1, 1e4), length=st.floats(0.01, 2), lead=st.floats(0.002, 0.05))
def test_the_energy_of_the_twist_is_that_of_its_axial_compliance(force, length, lead):
    # An independent way to 32 β² l / (π d⁴ G): the twist's energy, integrated over the round section.
    diameter, modulus = 0.02, 80e9
    torque = force * lead / (2 * math.pi)
    r = (np.arange(4000) + 0.5) * diameter / 2 / 4000
    polar = np.sum(2 * math.pi * r**3) * diameter / 2 / 4000
    energy = torque**2 * length / (2 * modulus * polar)
    compliant = compliance.torsion_compliance(length, lead=lead, diameter=diameter, shear_modulus=modulus)
    assert compliant * force**2 / 2 == pytest.approx(energy, rel=1e-6)


@pytest.mark.parametrize(
    ("diameter", "lead", "percent"), [(0.0132, 0.005, 7.5), (0.0214, 0.01, 11.4), (0.0344, 0.02, 17.6)]
)
def test_what_the_twist_adds_to_the_slope(diameter, lead, percent):
    twist = compliance.torsion_compliance(1.0, lead=lead, diameter=diameter, shear_modulus=80e9)
    axial = compliance.shaft_compliance(1.0, diameter=diameter, youngs_modulus=206e9, support="fixed-free")
    assert 100 * twist / axial == pytest.approx(percent, abs=0.05)


def test_a_rigid_coupling_gives_nothing():
    assert compliance.coupling_compliance(0.01, None) == 0
    assert compliance.coupling_compliance(0.01, 5000) == pytest.approx((0.01 / (2 * math.pi)) ** 2 / 5000)


@given(st.floats(1, 1e5))
def test_the_nut_has_its_stated_rigidity_at_its_stated_preload(load_rating):
    assert compliance.nut_rigidity(0.1 * load_rating, 4.5e8, load_rating, 0.1) == pytest.approx(0.8 * 4.5e8)


@given(st.floats(1e-3, 1e5))
def test_eight_times_the_preload_is_twice_the_rigidity(preload):
    one, eight = compliance.nut_rigidity(np.array([preload, 8 * preload]), 4.5e8, 17e3, 0.1)
    assert eight == pytest.approx(2 * one)


def test_an_axis_without_preload_has_no_rigidity():
    assert compliance.nut_rigidity(0.0, 4.5e8, 17e3, 0.1) == 0


def test_a_cylinder():
    mass = compliance.screw_mass(0.025, 0.9, 7850)
    assert mass == pytest.approx(3.468, abs=1e-3)
    assert compliance.screw_inertia(0.025, 0.9, 7850) == pytest.approx(mass * 0.025**2 / 8)
    assert compliance.moving_screw_mass(0.025, 0.9, 7850) == pytest.approx(mass / 3)


def test_a_rotor_referred_to_the_table():
    # Kinetic energy of the rotor is that of its equivalent mass at v = β ω.
    lead, inertia, omega = 0.01, 3e-4, 100.0
    speed = omega * lead / (2 * math.pi)
    mass = compliance.rotor_equivalent_mass(inertia, lead)
    assert mass * speed**2 / 2 == pytest.approx(inertia * omega**2 / 2)


def test_a_bearing():
    assert compliance.bearing_compliance(160e6) == pytest.approx(6.25e-9)


def test_a_nut_at_the_end_of_the_shaft_but_for_rounding():
    at_end = np.nextafter(0.9, 1.0)
    shaft = compliance.shaft_compliance(at_end, **SHAFT, support="fixed-fixed", length=0.9)
    both = compliance.support_compliance(
        at_end, **SHAFT, support="fixed-fixed", length=0.9, bearing_stiffness=1e8, far_stiffness=1e30
    )
    assert shaft == 0
    assert both == pytest.approx(0, abs=1e-20)


@pytest.mark.parametrize("support", ["fixed-free", "fixed-fixed"])
def test_a_nut_beyond_an_end(support):
    for function, more in (
        (compliance.shaft_compliance, {}),
        (compliance.support_compliance, {"bearing_stiffness": 1e8}),
    ):
        with pytest.raises(InputError, match=r"a distance from the bearing of -0\.1 was given"):
            function(-0.1, **SHAFT, **more, support=support, length=0.9)
        if support == "fixed-fixed":
            with pytest.raises(
                InputError, match=r"a distance of 1 m from the bearing was given; the shaft is 0\.9"
            ):
                function([0.1, 1.0], **SHAFT, **more, support=support, length=0.9)


def test_the_equivalent_preload_ratio_is_the_nuts_where_only_the_nut_changes() -> None:
    ratios = np.array([1.3, 1.0, 0.85, 0.3])
    before = 1 / compliance.nut_rigidity(700.0, 450e6, 17e3, 0.1)
    after = 1 / compliance.nut_rigidity(700.0 * ratios, 450e6, 17e3, 0.1)
    np.testing.assert_allclose(compliance.equivalent_preload_ratio(after - before, before), ratios)


def test_a_bearing_with_a_tenth_less_preload_is_a_nut_with_a_seventh_less() -> None:
    """The M axis: k_b 180 N/µm and a nut of 263 N/µm at 4 % of Ca."""
    nut = 1 / float(compliance.nut_rigidity(0.04 * 17e3, 450e6, 17e3, 0.1))
    softer = (0.9 ** (-1 / 3) - 1) / 180e6
    assert float(compliance.equivalent_preload_ratio(softer, nut)) == pytest.approx(0.853, abs=0.01)


def test_a_change_beyond_an_infinitely_stiff_nut_has_no_preload() -> None:
    assert np.isinf(compliance.equivalent_preload_ratio([-1.0, -1.1], 1.0)).all()
