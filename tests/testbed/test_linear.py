"""Natural frequencies beside the formulas, which the testbed itself never uses."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from tests.testbed.rigs import AXES, at, coupled, lossless, machine, plain, run

from ballscrew.axis.frequency import axial_natural_frequency
from ballscrew.axis.model import kappa
from ballscrew.axis.rod import rod_frequency
from ballscrew.base.errors import InputError
from ballscrew.testbed.forces import spring_forces
from ballscrew.testbed.linear import (
    compliance,
    least_steps,
    natural_frequencies,
    standing,
    structural_damping,
    true_frequency,
)
from ballscrew.testbed.machine import Constants, Machine, constants

PLACES = (0.0, 0.225, 0.45)
CASES = [(x, p) for x in PLACES for p in (0.04, 0.01)]


def _on_rock(name: str, place: float, ratio: float, coupling: float | None) -> Constants:
    sheet = coupled(AXES[name], coupling)
    preload = ratio * sheet.screw.dynamic_load_rating
    return constants(Machine(sheet, preload, bed_mass=1e8, bed_frequency=0.1), 0.0, place)


@pytest.mark.parametrize("name", ["S", "M"])
@pytest.mark.parametrize("torsion", [False, True])
@pytest.mark.parametrize(("place", "ratio"), CASES)
def test_free_frequency_is_the_formulas_within_three_per_cent(name, torsion, place, ratio):
    c = _on_rock(name, place, ratio, None)
    preload = ratio * AXES[name].screw.dynamic_load_rating
    formula = axial_natural_frequency(AXES[name], place, 0.0, preload, "free", torsion=torsion)
    assert true_frequency(c, place) == pytest.approx(float(formula), rel=0.03)


@pytest.mark.parametrize("name", AXES)
@pytest.mark.parametrize("coupling", [None, 5000.0])
@pytest.mark.parametrize("rotor", ["free", "held"])
@pytest.mark.parametrize(("place", "ratio"), CASES)
def test_frequency_is_that_of_the_distributed_rod(name, coupling, rotor, place, ratio):
    c = _on_rock(name, place, ratio, coupling)
    sheet = coupled(AXES[name], coupling)
    preload = ratio * sheet.screw.dynamic_load_rating
    reference = rod_frequency(sheet, place, 0.0, preload, rotor)
    found = true_frequency(c, place, rotor_fixed=rotor == "held")
    assert found == pytest.approx(float(reference), rel=0.015)


def test_bed_lifts_the_frequency_as_a_free_body_does():
    """The bed's mass swings against the table: 1/m + 1/m_bed."""
    rock, light = _on_rock("M", 0.0, 0.04, None), constants(machine(), 0.0, 0.0)
    ratio = true_frequency(light, 0.0, rotor_fixed=True) / true_frequency(rock, 0.0, rotor_fixed=True)
    assert ratio == pytest.approx(math.sqrt(1 + 101.5 / 1500), rel=0.01)


@pytest.mark.parametrize("ratio", [0.7, 1.0, 1.2, 3.0])
@pytest.mark.parametrize("rotor_fixed", [False, True])
def test_a_bed_near_the_axial_mode_does_not_move_the_frequency_that_is_called_true(ratio, rotor_fixed):
    rock = constants(machine(bed_mass=1e12, bed_frequency=1e-3), 0.0, 0.2)
    blocked = true_frequency(rock, 0.2, rotor_fixed=rotor_fixed)
    c = constants(machine(bed_mass=800.0, bed_frequency=ratio * blocked), 0.0, 0.2)
    assert true_frequency(c, 0.2, rotor_fixed=rotor_fixed) == pytest.approx(blocked, rel=1e-6)
    coupled, _ = natural_frequencies(c, 0.2, rotor_fixed=rotor_fixed)
    assert np.all(np.abs(coupled / blocked - 1) > 0.01 / ratio**2)
    assert structural_damping(c, 0.2, 0.03) == pytest.approx(structural_damping(rock, 0.2, 0.03), rel=1e-6)


def test_coupled_modes_are_those_of_two_bodies():
    """Rotor fixed: λ² − λ((1 + μ) w² + w_b²) + w² w_b² = 0, μ the mass on the nut over the bed's."""
    rock = constants(machine(bed_mass=1e12, bed_frequency=1e-3), 0.0, 0.2)
    blocked = true_frequency(rock, 0.2, rotor_fixed=True)
    c = constants(machine(bed_mass=800.0, bed_frequency=1.1 * blocked), 0.0, 0.2)
    coupled, _ = natural_frequencies(c, 0.2, rotor_fixed=True)
    middle = 1 + (c.table + c.rod) / c.bed + 1.1**2
    expected = np.sqrt(middle / 2 + np.array([-1, 1]) * math.sqrt(middle**2 / 4 - 1.1**2))
    assert coupled[:2] / blocked == pytest.approx(expected, rel=0.005)


def test_machine_as_a_whole_moves_freely_and_the_bed_rocks():
    frequencies, share = natural_frequencies(constants(machine(), 0.0, 0.2), 0.2)
    assert frequencies[0] == pytest.approx(0.0, abs=0.1)
    assert 20 < frequencies[1] < 30
    assert np.all(np.diff(frequencies) > 0)
    assert np.all((share >= 0) & (share <= 1.2))


def test_fixed_fixed_is_softest_near_the_middle_of_the_screw():
    sheet = replace(AXES["M"], support="fixed-fixed")
    places = np.linspace(0.0, 0.7, 71)
    found = [
        true_frequency(constants(Machine(sheet, 680.0, bed_mass=1e8, bed_frequency=0.1), 0.0, x), x)
        for x in places
    ]
    formula = axial_natural_frequency(sheet, places, 0.0, 680.0, "free", torsion=True)
    assert np.max(np.abs(found / formula - 1)) < 0.03
    assert 0.28 < places[np.argmin(found)] < 0.50


def test_integrator_rings_at_the_frequency_that_is_called_true():
    c = plain()
    kicked = at(0.2)
    kicked[8] = 1e-4
    still, _ = run(c, at(0.2), 12800, 16)
    rung, _ = run(c, kicked, 12800, 16)
    y = (rung - still)[:, 1]
    spectrum = np.abs(np.fft.rfft(y * np.hanning(len(y)), 16 * len(y)))
    f = np.fft.rfftfreq(16 * len(y), 1 / 12800)
    near = (f > 100) & (f < 250)
    assert f[near][np.argmax(spectrum[near])] == pytest.approx(true_frequency(c, 0.2), rel=1e-3)


@pytest.mark.parametrize("name", AXES)
@pytest.mark.parametrize("ratio", [0.015, 0.05])
def test_structural_damping_makes_the_pole_that_was_asked_for(name, ratio):
    """From the poles of the damped machine, its stiffness taken from the forces by differences."""
    heavy = machine(name, viscous=200.0, motor_viscous=400.0, bed_damping=0.1)
    c = constants(replace(heavy, sheet=coupled(AXES[name], 5000.0)), 0.0, 0.2)
    rest = np.array([0.2, 0.2, 0.0, 0.2, 0.0])
    stiffness = np.empty((5, 5))
    for column, step in enumerate(1e-9 * np.eye(5)):
        up, down = (np.array(spring_forces(c, *(rest + way))[:5]) for way in (step, -step))
        stiffness[:, column] = -(up - down) / 2e-9
    damping = structural_damping(c, 0.2, ratio) * stiffness
    damping[4, 4] += c.bed_viscous
    damping[0, 0] += c.motor_viscous
    damping[3:, 3:] += c.viscous * np.array([[1, -1], [-1, 1]])
    inverse = np.diag(1 / np.array([c.motor, c.screw, c.rod, c.table, c.bed]))
    poles = np.linalg.eigvals(
        np.block([[np.zeros((5, 5)), np.eye(5)], [-inverse @ stiffness, -inverse @ damping]])
    )
    pole = poles[np.argmin(np.abs(poles - 2j * math.pi * true_frequency(c, 0.2)))]
    assert -pole.real / abs(pole) == pytest.approx(ratio, rel=0.005)


def test_a_mode_that_others_damp_already_needs_nothing_of_its_springs():
    assert structural_damping(constants(machine(viscous=1e5), 0.0, 0.2), 0.2, 0.03) == 0.0


@pytest.mark.parametrize("name", AXES)
@pytest.mark.parametrize(("ratio", "steps"), [(0.03, 4), (0.05, 8)])
def test_few_steps_are_enough_for_usual_axes(name, ratio, steps):
    c = constants(machine(name), 0.0, 0.2)
    damped = c._replace(structural=2 * ratio / (2 * math.pi * true_frequency(c, 0.2)))
    assert least_steps(damped, PLACES, 12800.0) <= steps


@pytest.mark.parametrize(("ratio", "off"), [(0.015, 5e-5), (0.05, 2e-4)])
def test_the_integrator_rings_at_the_true_frequency(ratio, off):
    """With the damping half a step late it would ring high by ζωΔt/2: 1.5e-4 and 5e-4 here."""
    c = lossless(constants(replace(machine(), sheet=coupled(AXES["M"], 5000.0)), 0.0, 0.2))
    true = true_frequency(c, 0.2)
    c = c._replace(structural=2 * ratio / (2 * math.pi * true))
    kicked = at(0.2)
    kicked[5], kicked[8] = 1e-5, -1e-5 * c.motor / c.table
    records, _ = run(c, kicked, 3000, max(4, least_steps(c, (0.2,), 12800.0)))
    # Motor against table leaves out the rigid body and most of the bed's mode; then the poles, by a fit of
    # the samples to those before them.
    stretch = records[:, 2] - records[:, 1]
    order = 10
    past = np.stack([stretch[order - 1 - k : len(stretch) - 1 - k] for k in range(order)], axis=1)
    fitted = np.linalg.lstsq(past, stretch[order:], rcond=None)[0]
    poles = np.log(np.roots([1, *-fitted]).astype(complex)) * 12800.0
    frequencies = np.abs(poles[poles.imag > 0]) / (2 * math.pi)
    assert np.min(np.abs(frequencies / true - 1)) < off


@pytest.mark.parametrize("name", AXES)
def test_as_many_steps_as_it_says_are_stable_and_half_are_not(name):
    c = constants(replace(machine(name), sheet=coupled(AXES[name], 5000.0)), 0.0, 0.2)
    c = c._replace(structural=2 * 0.2 / (2 * math.pi * true_frequency(c, 0.2)))
    steps = least_steps(c, (0.2,), 12800.0)
    kicked = at(0.2)
    kicked[7] = 1e-6
    records, _ = run(c, kicked, 2000, steps)
    assert np.max(np.abs(records[:, 1])) < 1
    wild, _ = run(c, kicked, 2000, steps // 2)
    assert not np.max(np.abs(wild[:, 1])) < 1


def test_a_shaft_without_length_and_coupling_is_refused():
    sheet = replace(AXES["M"], screw=replace(AXES["M"].screw, bearing_to_zero=0.0))
    c = constants(Machine(sheet, 680.0), 0.0, 0.2)
    with pytest.raises(InputError, match="coupling"):
        least_steps(c, (0.0, 0.4), 12800.0)


@pytest.mark.parametrize("positive", ["up", "down"])
@pytest.mark.parametrize("changes", [{}, {"bearing_preload": 2000.0}])
def test_a_vertical_axis_stands_in_equilibrium(positive, changes):
    sheet = replace(AXES["M"], orientation="vertical", inclination=math.pi / 2, positive=positive)
    c = constants(Machine(sheet, 680.0, **changes), 10.0, 0.2)
    motor, turn, rod, table, bed = spring_forces(c, *standing(c, 0.2)[:5])[:5]
    assert motor == pytest.approx(c.gravity, rel=1e-3)
    assert table + c.gravity == pytest.approx(0.0, abs=0.1)  # its way under load moves it along the screw
    assert [turn, rod, bed] == pytest.approx([0.0, 0.0, 0.0], abs=0.1)


def test_compliance_is_the_sum_of_the_data_sheets_parts():
    sheet, x = coupled(AXES["M"], 5000.0), 0.3
    screw = sheet.screw
    beta, reach = screw.lead / (2 * math.pi), x + screw.bearing_to_zero
    nut = 1 / (float(kappa(sheet)) * 680.0 ** (1 / 3))
    shaft = reach / (math.pi / 4 * screw.root_diameter**2 * screw.youngs_modulus)
    twist = 32 * beta**2 * reach / (math.pi * screw.root_diameter**4 * screw.shear_modulus)
    expected = nut + shaft + 1 / sheet.bearing.stiffness + twist + beta**2 / 5000.0
    assert compliance(constants(Machine(sheet, 680.0), 0.0, x), x) == pytest.approx(expected, rel=1e-9)
    assert compliance(constants(Machine(sheet, 0.0), 0.0, x), x) == math.inf
