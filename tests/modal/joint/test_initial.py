"""Values expected from the data sheet before the fit."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from ballscrew.axis.frequency import predicted_frequency
from ballscrew.axis.model import kappa, moving_mass, rotor_mass, screw_part, structure_compliance
from ballscrew.axis.rod import rod_frequency
from ballscrew.modal.joint.initial import (
    expected_mass_over_preload,
    inertia_and_viscous_friction,
    initial_values,
    typical_form_curve,
)
from ballscrew.modal.joint.mode import TYPICAL_SCREW_SHIFT, mode_frequency
from ballscrew.modal.joint.signals import TripSignals
from ballscrew.testbed.example import AXIS, LOAD, PLAN, example_rig
from ballscrew.testbed.linear import natural_frequencies
from ballscrew.testbed.trip import prepared

POSITION = 0.2
NOMINAL = (float(moving_mass(AXIS, LOAD)) + screw_part(AXIS)) / AXIS.nominal_preload


def expected(ratio: float, error: float = 1.0) -> tuple[float, float]:
    """Preload over nominal, by a frequency of this preload times ``error``, and its deviation."""
    frequency = float(predicted_frequency(AXIS, POSITION, LOAD, ratio * AXIS.nominal_preload))
    value, deviation, _ = expected_mass_over_preload(AXIS, LOAD, POSITION, error * frequency)
    return NOMINAL / value, deviation


def test_a_frequency_as_predicted_is_that_of_a_sound_nut() -> None:
    preload, deviation = expected(1.0)
    assert abs(math.log(preload)) < 1.1 * deviation
    assert 0.2 < deviation < 0.45


@pytest.mark.parametrize("ratio", [0.1, 0.2, 0.5])
def test_the_interval_contains_a_worn_nut(ratio: float) -> None:
    preload, deviation = expected(ratio)
    assert preload < 1.0
    assert abs(math.log(preload / ratio)) < 2 * deviation


def test_the_lower_the_frequency_the_lower_the_preload() -> None:
    preloads = [expected(ratio)[0] for ratio in (2.0, 1.0, 0.7, 0.4, 0.2, 0.1, 0.05)]
    assert preloads == sorted(preloads, reverse=True)


@pytest.mark.parametrize("error", [0.7, 1.4])
def test_a_sheet_far_beyond_its_tolerances_determines_no_preload(error: float) -> None:
    value, deviation, _ = expected_mass_over_preload(
        AXIS, LOAD, POSITION, error * float(predicted_frequency(AXIS, POSITION, LOAD))
    )
    assert math.isfinite(value)
    assert deviation > 0.3


@pytest.mark.parametrize("scale", [1.0, -2e-3])  # newtons; ampere with the opposite sign
def test_inertia_and_viscous_friction_are_those_of_a_rigid_body(scale: float) -> None:
    inertia, coulomb, viscous, offset = 200.0, 25.0, 300.0, 4.0
    rate = 2000.0
    time = np.arange(0, 4, 1 / rate)
    position = 0.1 * np.cos(2 * math.pi * time) + 0.02 * np.cos(6 * math.pi * time)
    speed = np.gradient(position) * rate
    force = inertia * np.gradient(speed) * rate + coulomb * np.sign(speed) + viscous * speed + offset
    trip = TripSignals(rate, scale * force, position, np.empty((0, len(time))))
    found = inertia_and_viscous_friction([trip])
    assert found == pytest.approx((scale * inertia, viscous / inertia), rel=5e-3)


def test_viscous_friction_of_the_axis_is_that_over_the_moving_mass() -> None:
    """c/m of an axis of mass m and inertia M is M/m times c/M."""
    mass = float(moving_mass(AXIS, LOAD)) + screw_part(AXIS)
    per_inertia = 300.0 / (mass + rotor_mass(AXIS))
    initial = initial_values(AXIS, LOAD, 0.0, 0.3, per_inertia)
    assert initial.viscous == initial.mode(0).viscous == pytest.approx(300.0 / mass)
    assert initial_values(AXIS, LOAD, 0.0, 0.3, -1.0).viscous == 0


def test_with_a_form_of_1_the_mode_follows_the_finite_elements_of_the_screw() -> None:
    places = np.linspace(-0.2, 0.2, 9)
    exact = np.array([rod_frequency(AXIS, POSITION + place, LOAD) for place in places])
    expected_mode = initial_values(AXIS, LOAD, POSITION - 0.2, POSITION + 0.2).mode(0)

    def largest_error(form: float) -> float:
        """Of the frequency, relative, with the compliance and slope that fit best."""
        curve = form * expected_mode.form_curve
        powers = np.vander(places, 2) / exact[:, None] ** -2
        basis = np.column_stack([powers[:, 0], powers[:, 1] * (1 + curve * places**2)])
        slope, middle = np.linalg.lstsq(basis, np.ones(len(places)), rcond=None)[0]
        mode = replace(expected_mode, compliance=middle / (2 * np.pi) ** 2, slope=slope / middle, form=form)
        return float(np.abs(mode_frequency(mode, places) / exact - 1).max())

    assert largest_error(1.0) < 2e-4
    assert largest_error(0.0) > 5 * largest_error(1.0)


def test_a_screw_with_both_ends_fixed_has_a_free_curve_and_no_form() -> None:
    found = initial_values(replace(AXIS, support="fixed-fixed"), LOAD, 0.0, 0.4)
    assert found.curved
    assert found.form_curves == (0.0, 0.0)


def test_without_a_data_sheet_a_line_errs_by_two_thousandths_at_the_ends() -> None:
    half = 0.3
    places = np.linspace(-half, half, 201)
    compliance = 1 + typical_form_curve(0.0, 2 * half) * places**2
    line = np.polyval(np.polyfit(places, compliance, 1), places)
    error = np.sqrt(compliance / line)[-1] - 1  # of the line's frequency
    assert error == pytest.approx(2e-3, rel=0.05)


def test_a_screw_without_inertia_has_the_rotors_part_of_eq_3() -> None:
    light = replace(AXIS, screw=replace(AXIS.screw, density=1.0))
    assert initial_values(light, LOAD, 0.0, 0.4).rotor_correction == pytest.approx(1.0, abs=1e-4)
    assert initial_values(AXIS, LOAD, 0.0, 0.4).rotor_correction > 1.01


def test_the_rotors_part_is_the_ratio_of_the_tables_shares_of_the_kinetic_energy() -> None:
    """Of a screw in three lumps; with its mass along it the ratio differs by some thousandths."""
    rig, shares, frequencies = example_rig(), [], []
    still = replace(rig.machine, bed_mass=1e8, bed_frequency=0.1)
    constants = prepared(still, LOAD, PLAN)
    for rotor_fixed in (False, True):
        modes, share = natural_frequencies(constants, POSITION, rotor_fixed=rotor_fixed, bed_blocked=True)
        axial = int(np.argmax(share[1 - rotor_fixed :])) + 1 - rotor_fixed
        frequencies.append(modes[axial])
        shares.append(share[axial])
    expected_correction = shares[0] / shares[1] * (frequencies[0] / frequencies[1]) ** 2
    found = initial_values(AXIS, LOAD, 0.0, 2 * POSITION).rotor_correction
    assert found == pytest.approx(expected_correction, abs=0.01)
    assert found > 1.01


@pytest.mark.parametrize("frame_over_moving_mass", [4.0, 10.0])
def test_a_part_of_the_screw_moves_with_the_frame(frame_over_moving_mass: float) -> None:
    """A rod on a frame, its rotor held. The frame alone is at the zero of the table's motion.

    In the equations of :mod:`ballscrew.modal.joint.simulation` the product of both coupled frequencies is
    that of this zero and of the axial frequency with the frame blocked.
    """
    table, screw, count = float(moving_mass(AXIS, LOAD)), AXIS.screw, 400
    mass = 3 * screw_part(AXIS) * ((screw.nominal_diameter / screw.root_diameter) ** 2 + 1) / 2
    length = screw.length / count
    nut = round((POSITION + screw.bearing_to_zero) / length)  # its node; the table is the last but one
    twist = float(structure_compliance(AXIS, POSITION, torsion=True))
    twist -= float(structure_compliance(AXIS, POSITION, torsion=False))
    to_nut = 1 / (1 / (kappa(AXIS) * math.cbrt(AXIS.nominal_preload)) + twist)
    rod = screw.youngs_modulus * math.pi / 4 * screw.root_diameter**2 / length
    frame_mass = frame_over_moving_mass * table
    mounts = frame_mass * (2 * math.pi * 130.0) ** 2
    springs = [(i, i + 1, rod) for i in range(count)]
    springs += [(0, count + 2, AXIS.bearing.stiffness), (nut, count + 1, to_nut)]
    stiffness = np.zeros((count + 3, count + 3))
    for i, j, rigidity in springs:
        stiffness[np.ix_([i, j], [i, j])] += rigidity * np.array([[1, -1], [-1, 1]])
    stiffness[-1, -1] += mounts
    masses = np.full(count + 3, mass / count)
    masses[[0, count]] /= 2
    masses[-2:] = table, frame_mass
    root = np.sqrt(masses)
    scaled = stiffness / np.outer(root, root)
    coupled = np.sqrt(np.linalg.eigvalsh(scaled)[:2])
    blocked = math.sqrt(np.linalg.eigvalsh(scaled[:-1, :-1])[0])
    zero = math.sqrt(mounts / (frame_mass + mass))
    excess = coupled[0] * coupled[1] / (zero * blocked) - 1
    found = initial_values(AXIS, LOAD, 0.0, 2 * POSITION).screw_shift
    assert found * table / frame_mass == pytest.approx(excess, rel=0.05)


def test_where_table_and_screw_share_the_motion_the_screws_shift_is_a_typical_one() -> None:
    long = replace(AXIS, screw=replace(AXIS.screw, length=4.0))
    shifts = [initial_values(long, LOAD, 0.0, 2 * x).screw_shift for x in (0.2, 1.0, 1.6, 1.8)]
    assert TYPICAL_SCREW_SHIFT in shifts
    assert all(0 < shift < 0.2 for shift in shifts)


@pytest.mark.parametrize("rotating", ["screw", "nut"])
def test_the_rotors_part_of_other_drives_is_near_that_of_eq_3(rotating: str) -> None:
    other = replace(AXIS, drive=replace(AXIS.drive, rotating=rotating))
    assert 0.98 < initial_values(other, LOAD, 0.0, 0.4).rotor_correction < 1.1


def test_where_table_and_screw_share_the_motion_eq_3_is_not_corrected() -> None:
    """On a screw of 4 m either mode may be the axial one."""
    long = replace(AXIS, screw=replace(AXIS.screw, length=4.0))
    corrections = [initial_values(long, LOAD, 0.0, 2 * x).rotor_correction for x in (0.2, 1.0, 1.6, 1.8)]
    assert 1.0 in corrections
    assert all(0.9 < correction < 1.5 for correction in corrections)
