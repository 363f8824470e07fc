"""Constants of a machine from its data sheet."""

from __future__ import annotations

import csv
import math
from dataclasses import replace

import numpy as np
import pytest
from tests.testbed.rigs import AXES, NO_WAVES, RATE, at, constant_speed, lossless, machine

from ballscrew.axis.compliance import nut_kappa, screw_inertia, transmission_ratio
from ballscrew.axis.drag import preload_torque
from ballscrew.axis.hertz import preload_deflection
from ballscrew.axis.model import rotor_mass, screw_part
from ballscrew.base.errors import InputError
from ballscrew.testbed.integrator import integrate
from ballscrew.testbed.machine import Machine, constants
from ballscrew.testbed.servo import Servo, loop


@pytest.mark.parametrize("name", AXES)
@pytest.mark.parametrize("middle", [0.0, 0.225, 0.45])
def test_inertia_is_that_of_the_data_sheet_wherever_it_is_parted(name, middle):
    sheet = AXES[name]
    c = constants(machine(name), 7.0, middle)
    assert c.motor + c.screw == pytest.approx(float(rotor_mass(sheet)), rel=1e-12)
    assert c.rod == pytest.approx(float(screw_part(sheet)), rel=1e-12)
    assert c.table == sheet.table.mass + 7.0
    own = screw_inertia(sheet.screw.nominal_diameter, sheet.screw.length, sheet.screw.density)
    assert c.motor > sheet.drive.rotor_inertia / transmission_ratio(sheet.screw.lead) ** 2
    assert 0 < c.screw < own / transmission_ratio(sheet.screw.lead) ** 2


def test_preload_presses_the_flanks():
    screw = AXES["M"].screw
    kappa = nut_kappa(screw.rigidity, screw.dynamic_load_rating, screw.rigidity_preload_ratio)
    assert constants(machine(), 0.0, 0.0).pressed == pytest.approx(float(preload_deflection(680.0, kappa)))


def test_backlash_is_parted_between_the_flanks():
    assert constants(Machine(AXES["M"], 0.0, 4e-6), 0.0, 0.0).pressed == -2e-6


def test_bed_stands_on_its_mounts():
    c = constants(machine(bed_mass=900.0, bed_frequency=30.0, bed_damping=0.1), 0.0, 0.0)
    w = 2 * math.pi * 30
    assert (c.bed, c.bed_stiffness, c.bed_viscous) == pytest.approx((900, 900 * w**2, 2 * 0.1 * w * 900))


def test_axis_without_friction_has_no_bristle():
    sheet = replace(AXES["M"], guide=replace(AXES["M"].guide, friction=0.0))
    assert constants(Machine(sheet, 680.0), 0.0, 0.0).bristle == 0.0


def test_drag_is_the_jis_form():
    screw = AXES["M"].screw
    c = constants(machine(), 0.0, 0.0)
    torque = c.drag * transmission_ratio(screw.lead)
    assert torque == pytest.approx(float(preload_torque(680.0, screw.lead, screw.nominal_diameter)))
    assert constants(machine(drag_ratio=0.7), 0.0, 0.0).drag == pytest.approx(0.7 * c.drag)


def test_drag_of_a_running_screw_is_the_first_reading_of_a_real_one(data):
    """Lead 8 mm, 1500 N, 300 r/min; the diameter is not stated."""
    path = data / "xjtu" / "friction_torque_upper.csv"
    if not path.is_file():
        pytest.skip(f"no {path}")
    with path.open(encoding="utf-8") as file:
        new = float(next(csv.DictReader(file))["friction_torque_Nm"])
    sheet = AXES["M"]
    for diameter in (0.040, 0.045):
        screw = replace(sheet.screw, lead=0.008, nominal_diameter=diameter, root_diameter=diameter - 0.005)
        real = Machine(replace(sheet, screw=screw), 1500.0)
        c = constants(real, 0.0, 0.2)
        c = lossless(c)._replace(drag=c.drag, structural=5e-5)
        wanted = constant_speed(6400, 0.2, 300 / 60 * 0.008)
        records, _ = integrate(
            c, loop(Servo(), real, c), wanted, np.zeros((6400, 2)), NO_WAVES, 4, RATE, at(0.2, wanted[0, 1])
        )
        torque = records[3200:, 0].mean() * transmission_ratio(0.008)
        assert torque == pytest.approx(new, rel=0.06)


@pytest.mark.parametrize(
    ("changes", "word"),
    [
        ({"preload": -1.0}, "preload"),
        ({"preload": math.nan}, "preload"),
        ({"preload": math.inf}, "preload"),
        ({"preload": 0.0, "backlash": -1e-6}, "backlash"),
        ({"preload": 10.0, "backlash": 1e-6}, "backlash only where"),
        ({"damping_ratio": -0.01}, "damping_ratio"),
        ({"bed_mass": 0.0}, "bed_mass"),
        ({"bed_frequency": math.nan}, "bed_frequency"),
        ({"presliding": 0.0}, "presliding"),
        ({"stribeck_speed": 0.0}, "stribeck_speed"),
        ({"static_ratio": 0.9}, "static_ratio"),
        ({"static_ratio": math.nan}, "static_ratio"),
        ({"viscous": "much"}, "viscous"),
    ],
)
def test_what_no_machine_is_is_refused(changes, word):
    with pytest.raises(InputError, match=word):
        Machine(**{"sheet": AXES["M"], "preload": 680.0, **changes})


@pytest.mark.parametrize(
    ("load", "middle", "word"),
    [
        (-1.0, 0.0, "load"),
        (math.nan, 0.0, "load"),
        (0.0, 0.79, "position"),
        (0.0, -0.2, "position"),
        (0.0, math.nan, "position"),
    ],
)
def test_load_and_position_that_cannot_be_are_refused(load, middle, word):
    with pytest.raises(InputError, match=word):
        constants(machine(), load, middle)


def _vertical(positive, counterbalance=0.0):
    sheet = AXES["M"]
    table = replace(sheet.table, counterbalance=counterbalance)
    return replace(sheet, orientation="vertical", inclination=math.pi / 2, positive=positive, table=table)


@pytest.mark.parametrize(("positive", "sign"), [("up", -1), ("down", 1)])
def test_weight_pulls_down_and_is_carried_by_the_counterbalance(positive, sign):
    weight = 9.80665 * 111.5
    c = constants(Machine(_vertical(positive, 300.0), 680.0), 10.0, 0.0)
    assert c.gravity == pytest.approx(sign * (weight - 300.0))
    inclined = replace(_vertical(positive), orientation="inclined", inclination=math.pi / 6)
    assert constants(Machine(inclined, 680.0), 10.0, 0.0).gravity == pytest.approx(sign * weight / 2)
    assert constants(machine(), 10.0, 0.0).gravity == 0


def test_a_transmission_multiplies_inertia_and_divides_torque():
    sheet = AXES["M"]
    drive = replace(sheet.drive, ratio=2.0, rotor_inertia=sheet.drive.rotor_inertia / 4)
    fast = Machine(replace(sheet, drive=drive), 680.0)
    assert constants(fast, 0.0, 0.0).motor == pytest.approx(constants(machine(), 0.0, 0.0).motor)
    assert fast.motor_ratio == pytest.approx(machine().motor_ratio / 2)


def test_belt_and_coupling_are_springs_in_series():
    drive = replace(AXES["M"].drive, coupling_stiffness=5000.0, belt_stiffness=2000.0)
    c = constants(Machine(replace(AXES["M"], drive=drive), 680.0), 0.0, 0.0)
    assert c.coupling == pytest.approx(transmission_ratio(0.01) ** 2 * (1 / 5000 + 1 / 2000))


def test_stiffness_of_the_bearing_follows_the_cube_root_of_its_preload():
    sheet = replace(AXES["M"], support="fixed-fixed", bearing=replace(AXES["M"].bearing, far_stiffness=9e7))
    c = constants(Machine(sheet, 680.0, bearing_preload=1000.0, bearing_preload_ratio=0.9), 0.0, 0.0)
    assert 1 / c.bearing == pytest.approx(sheet.bearing.stiffness * 0.9 ** (1 / 3))
    assert 1 / c.far_bearing == pytest.approx(9e7 * 0.9 ** (1 / 3))
    assert c.bearing_preload == pytest.approx(900.0)


@pytest.mark.parametrize(
    ("changes", "word"),
    [
        ({"bearing_preload": 0.0}, "bearing_preload"),
        ({"bearing_preload": math.nan}, "bearing_preload"),
        ({"bearing_preload_ratio": 0.0}, "bearing_preload_ratio"),
        ({"pretension": -1.0}, "pretension"),
        ({"pretension": 100.0}, "fixed-free"),
        ({"oil_film": -1e-7}, "oil_film"),
        ({"pitch_share": 1.0}, "pitch_share"),
    ],
)
def test_bearing_film_and_pitching_that_cannot_be_are_refused(changes, word):
    with pytest.raises(InputError, match=word):
        machine(**changes)


def test_a_nut_that_rotates_is_refused():
    sheet = replace(AXES["M"], drive=replace(AXES["M"].drive, rotating="nut"))
    with pytest.raises(InputError, match="rotate"):
        constants(Machine(sheet, 680.0), 0.0, 0.0)
