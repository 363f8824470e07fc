"""One potential, its gradient, the nut and the guide."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from benchmarks.testbed import potential
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from tests.testbed.rigs import AXES, machine, plain

from ballscrew.axis import hertz
from ballscrew.axis.compliance import nut_kappa, support_compliance, torsion_compliance
from ballscrew.testbed.forces import (
    end_force,
    guide_friction,
    nut_force,
    spring_forces,
    stiffnesses,
    support_force,
)
from ballscrew.testbed.machine import Machine, constants

M = AXES["M"]
KAPPA = nut_kappa(M.screw.rigidity, M.screw.dynamic_load_rating, M.screw.rigidity_preload_ratio)
P = 680.0
NUT = constants(machine(), 0.0, 0.0)
WAY = st.floats(-3e-5, 3e-5)


def _rigidity_at(load: float, preload: float = P) -> float:
    """Tangent of the kernel's nut where it carries a load, found by halving."""
    c = constants(Machine(M, preload), 0.0, 0.0)
    low, high = 0.0, 1e-3
    for _ in range(80):
        middle = (low + high) / 2
        low, high = (middle, high) if nut_force(middle, c.flank, c.pressed)[0] < load else (low, middle)
    return float(nut_force(low, c.flank, c.pressed)[1])


@settings(max_examples=150, deadline=None)
@given(
    support=st.sampled_from(["fixed-free", "fixed-supported", "fixed-fixed"]),
    preload=st.sampled_from([680.0, 60.0, 0.0]),
    place=st.floats(0.0, 0.6),
    ways=st.tuples(WAY, WAY, WAY, WAY),
)
def test_forces_are_minus_the_gradient_of_the_potential(support, preload, place, ways):
    sheet = replace(M, support=support, drive=replace(M.drive, coupling_stiffness=5000.0))
    c = constants(Machine(sheet, preload, 0.0 if preload else 4e-6), 10.0, 0.2)
    # The bed far enough that place and bed are told apart.
    where = np.array([place + ways[0], place + ways[1], ways[2], place, ways[3]])
    forces = spring_forces(c, *where)[:5]
    step = 1e-8
    for index, force in enumerate(forces):
        up, down = where.copy(), where.copy()
        up[index] += step
        down[index] -= step
        slope = (potential(c, *up) - potential(c, *down)) / (up[index] - down[index])
        assert force == pytest.approx(-slope, rel=1e-4, abs=0.05)


@given(place=st.floats(0.0, 0.6), ways=st.tuples(WAY, WAY, WAY, WAY))
def test_no_force_comes_from_nowhere(place, ways):
    """Axial forces add up to what holds the bed; those about the screw to the nut's force."""
    c = plain()
    motor, turn, rod, table, bed, *_ = spring_forces(
        c, place + ways[0], place + ways[1], ways[2], place, ways[3]
    )
    assert rod + table + bed == pytest.approx(-c.bed_stiffness * ways[3], abs=1e-5)
    force, _ = nut_force(place + ways[1] + ways[2] - place, c.flank, c.pressed)
    assert motor + turn == pytest.approx(-force, abs=1e-5)


def test_nut_is_that_of_the_theory():
    delta = np.linspace(-3e-5, 3e-5, 301)
    ours = [nut_force(d, NUT.flank, NUT.pressed)[0] for d in delta]
    assert ours == pytest.approx(hertz.nut_force(delta, P, KAPPA), rel=1e-9, abs=1e-6)
    assert nut_force(0.0, NUT.flank, NUT.pressed)[1] == pytest.approx(KAPPA * P ** (1 / 3), rel=1e-12)


@pytest.mark.parametrize("ratio", [0.5, 1, 1.5, 2, 2.5, 2.8, 2.9, 4, 6, 8, 12])
def test_static_sweep_of_the_nut_follows_the_theory(ratio):
    expected = hertz.nut_rigidity_under_load(ratio * P, P, KAPPA)
    assert _rigidity_at(ratio * P) == pytest.approx(float(expected), rel=1e-8)


def test_one_flank_lets_go_at_2_83_p():
    """The tangent falls to a sharp minimum, 0.707 of that at rest, and rises after it."""
    ratios = np.linspace(2.5, 3.2, 701)
    tangents = np.array([_rigidity_at(r * P) for r in ratios]) / _rigidity_at(0.0)
    assert ratios[np.argmin(tangents)] == pytest.approx(2 * math.sqrt(2), abs=1e-3)
    assert tangents.min() == pytest.approx(math.sqrt(0.5), abs=0.005)
    away = nut_force(NUT.pressed, NUT.flank, NUT.pressed)[0]
    assert away / P == pytest.approx(2 * math.sqrt(2), rel=1e-12)


@pytest.mark.parametrize("preload", [10.0, 100.0, 340.0])
def test_beyond_release_it_is_as_rigid_as_with_an_eighth_of_the_load_as_preload(preload):
    load = 1000.0
    assert _rigidity_at(load, preload) == pytest.approx(KAPPA * (load / 8) ** (1 / 3), rel=1e-8)


def test_clearance_is_that_of_the_theory():
    c = constants(Machine(M, 0.0, 4e-6), 0.0, 0.0)
    delta = np.linspace(-1e-5, 1e-5, 201)
    got = np.array([nut_force(d, c.flank, c.pressed) for d in delta])
    pressed = np.maximum(np.abs(delta) - 2e-6, 0.0)
    force = np.sign(delta) * hertz.hertz_constant(KAPPA) * pressed**1.5
    assert got[:, 0] == pytest.approx(force, rel=1e-9, abs=1e-9)
    loose = np.abs(delta) < 2e-6 - 1e-9
    assert not np.any(got[loose])
    assert np.all(got[np.abs(delta) > 2e-6 + 1e-9, 1] > 0)


@pytest.mark.parametrize("support", ["fixed-free", "fixed-supported", "fixed-fixed"])
def test_stiffnesses_follow_the_table_as_the_data_sheet_says(support):
    sheet = replace(M, support=support, drive=replace(M.drive, coupling_stiffness=5000.0))
    c = constants(Machine(sheet, P), 0.0, 0.2)
    screw, h = sheet.screw, 1e-5
    for place in (0.0, 0.2, 0.45, 0.7):
        x = place + screw.bearing_to_zero
        twist, axial, twist_slope, axial_slope = stiffnesses(c, place)
        soft = support_compliance(
            x,
            diameter=screw.root_diameter,
            youngs_modulus=screw.youngs_modulus,
            bearing_stiffness=sheet.bearing.stiffness,
            support=support,
            length=screw.length,
        )
        assert axial == pytest.approx(1 / float(soft), rel=1e-12)
        turned = torsion_compliance(
            x, lead=screw.lead, diameter=screw.root_diameter, shear_modulus=screw.shear_modulus
        )
        assert 1 / twist == pytest.approx(float(turned) + (screw.lead / (2 * math.pi)) ** 2 / 5000, rel=1e-12)
        up, down = stiffnesses(c, place + h), stiffnesses(c, place - h)
        assert twist_slope == pytest.approx((up[0] - down[0]) / (2 * h), rel=1e-6)
        assert axial_slope == pytest.approx((up[1] - down[1]) / (2 * h), rel=1e-5, abs=1e3)


# The ends of the screw.

FIXED = replace(M, support="fixed-fixed", bearing=replace(M.bearing, far_stiffness=1.2e8))


@pytest.mark.parametrize("force", [-900.0, -200.0, 50.0, 800.0, 3000.0])
def test_hertz_bearing_and_shaft_are_springs_in_series(force):
    c = constants(Machine(M, P, bearing_preload=1000.0, bearing_preload_ratio=0.8), 0.0, 0.0)
    kappa = M.bearing.stiffness / 1000.0 ** (1 / 3)
    soft = c.shaft * 0.3
    extension = float(hertz.nut_deflection(force, 800.0, kappa)) + soft * force
    found, rigidity, slope = end_force(c, 0.3, c.bearing, extension)
    assert found == pytest.approx(force, rel=1e-9)
    bearing = float(hertz.nut_rigidity_under_load(force, 800.0, kappa))
    assert rigidity == pytest.approx(1 / (soft + 1 / bearing), rel=1e-9)
    assert slope == pytest.approx(-0.5 * c.shaft * force**2, rel=1e-9)


@pytest.mark.parametrize("changes", [{"bearing_preload": 500.0}, {"pretension": 300.0}, {"pretension": 0.0}])
def test_a_support_that_is_not_linear_conserves_energy(changes):
    """Its force along the extension and its slope along the screw have one potential."""
    c = constants(Machine(FIXED, P, **changes), 0.0, 0.0)
    way, h = np.linspace(0.0, 2e-5, 2001), 1e-4

    def energy(place):
        return float(np.trapezoid([support_force(c, place, e)[0] for e in way], way))

    slope = support_force(c, 0.2, way[-1])[2]
    assert slope == pytest.approx((energy(0.2 + h) - energy(0.2 - h)) / (2 * h), rel=2e-3)


def test_an_end_that_has_lost_its_tension_carries_nothing():
    c, both = (constants(Machine(FIXED, P, pretension=t), 0.0, 0.0) for t in (300.0, math.inf))
    small, large = 1e-6, 2e-5
    assert support_force(c, 0.2, small)[:2] == pytest.approx(support_force(both, 0.2, small)[:2])
    near = 1 / (c.bearing + c.shaft * (0.2 + c.to_zero))
    assert support_force(c, 0.2, large)[:2] == pytest.approx((near * large + 300.0, near))
    far = 1 / (c.far_bearing + c.shaft * (c.length - 0.2 - c.to_zero))
    assert support_force(c, 0.2, -large)[:2] == pytest.approx((-far * large - 300.0, far))


# The guide.

GUIDE = NUT._replace(bristle_damping=0.0)
DT = 1 / 51200


def _steady(speed: float) -> float:
    z = force = 0.0
    for _ in range(400000 if abs(speed) < 1e-4 else 20000):
        force, z = guide_friction(GUIDE, speed, z, DT)
    return float(force)


def test_guide_is_a_spring_before_it_slides():
    z = 0.0
    for _ in range(1000):
        force, z = guide_friction(GUIDE, 1e-7 / (1000 * DT), z, DT)
    assert force == pytest.approx(GUIDE.bristle * 1e-7, rel=0.03)
    assert GUIDE.bristle == pytest.approx(25.0 / 4e-6)


@pytest.mark.parametrize("speed", [0.02, 0.15, -0.15, 1.0])
def test_guide_slides_with_coulomb_and_viscous_friction(speed):
    assert _steady(speed) == pytest.approx(math.copysign(25.0, speed) + 120 * speed, rel=1e-6)


@pytest.mark.parametrize("speed", [2e-5, 1e-3, 2e-3, 4e-3, -2e-3])
def test_guide_has_stribecks_curve(speed):
    level = 25.0 * (1 + 0.25 * math.exp(-((speed / 2e-3) ** 2)))
    assert _steady(speed) == pytest.approx(math.copysign(level, speed) + 120 * speed, rel=1e-4)


def test_guide_without_friction_is_viscous_alone():
    assert guide_friction(GUIDE._replace(bristle=0.0), 0.1, 0.0, DT) == (pytest.approx(12.0), 0.0)


def test_guide_pushes_with_the_mean_of_its_bristle_and_damps_it():
    damped = GUIDE._replace(bristle_damping=1e4)
    force, z = guide_friction(damped, 0.01, 1e-6, DT)
    assert z - 1e-6 > 1e-7
    expected = GUIDE.bristle * (z + 1e-6) / 2 + 1e4 * (z - 1e-6) / DT + 120 * 0.01
    assert force == pytest.approx(expected, rel=1e-12)


def test_guide_stands_still_without_a_force():
    assert guide_friction(GUIDE, 0.0, 0.0, DT) == (0.0, 0.0)


@pytest.mark.parametrize(("size", "frequency"), [(0.1, 5.0), (3e-3, 20.0), (2e-4, 30.0)])
def test_bristle_agrees_with_a_fine_reference(size, frequency):
    def speed(t):
        return size * math.sin(2 * math.pi * frequency * t)

    def rate(t, z):
        v = speed(t)
        level = 25.0 + 6.25 * math.exp(-((v / 2e-3) ** 2))
        return [v - GUIDE.bristle * abs(v) * z[0] / level]

    times = np.arange(1, 20001) * DT
    fine = solve_ivp(
        rate, (0, times[-1]), [0.0], method="LSODA", t_eval=times, rtol=1e-9, atol=1e-14, max_step=1e-4
    )
    z, ours = 0.0, []
    for t in times:
        _, z = guide_friction(GUIDE, speed(t - DT / 2), z, DT)
        ours.append(z)
    assert np.max(np.abs(np.array(ours) - fine.y[0])) * GUIDE.bristle < 0.01 * 25.0
