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
from ballscrew.axis.imitation import warm_screw
from ballscrew.axis.model import rotor_mass, screw_part
from ballscrew.base.errors import InputError
from ballscrew.testbed.example import AXIS
from ballscrew.testbed.integrator import integrate
from ballscrew.testbed.machine import Machine, constants, pressed_more, warmed
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


@pytest.mark.parametrize("diameter", [0.040, 0.045])
def test_drag_of_a_running_screw_is_the_first_reading_of_a_real_one(data, diameter):
    """Lead 8 mm, 1500 N, 300 r/min; the diameter is not stated."""
    path = data / "xjtu" / "friction_torque_upper.csv"
    if not path.is_file():
        pytest.skip(f"no {path}")
    with path.open(encoding="utf-8") as file:
        new = float(next(csv.DictReader(file))["friction_torque_Nm"])
    sheet = AXES["M"]
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
