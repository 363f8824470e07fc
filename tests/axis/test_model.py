"""Weight, transmission, rotating nut and two bearings in the parts of the axial model."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from ballscrew.axis import compliance
from ballscrew.axis.frequency import predicted_frequency
from ballscrew.axis.model import (
    drive_compliance,
    motor_travel,
    pretension_reserve,
    rotor_mass,
    structure_compliance,
    weight_on_nut,
)
from ballscrew.axis.rod import rod_frequency

G = 9.80665


def changed(sheet, **fields):
    """Copy of a sheet: ``drive__ratio=2``."""
    for path, value in fields.items():
        part, _, name = path.partition("__")
        sheet = replace(sheet, **{part: replace(getattr(sheet, part), **{name: value}) if name else value})
    return sheet


def massless(sheet, **fields):
    """An axis whose screw has no mass, so that the lumped model is exact."""
    return changed(sheet, screw__density=1e-6, **fields)


def test_the_nut_carries_the_weight_of_a_vertical_axis(axes):
    vertical = replace(axes["M"], orientation="vertical", inclination=math.pi / 2)
    assert weight_on_nut(vertical, 20.0) == pytest.approx(121.5 * G)
    assert weight_on_nut(replace(vertical, positive="down"), 20.0) == pytest.approx(-121.5 * G)
    assert weight_on_nut(axes["M"], 20.0) == 0


def test_an_inclination_takes_its_sine_and_a_counterbalance_its_force(axes):
    inclined = replace(axes["M"], orientation="inclined", inclination=math.radians(30))
    assert weight_on_nut(inclined, 0.0) == pytest.approx(101.5 * G / 2)
    balanced = changed(inclined, table__counterbalance=600.0)
    assert weight_on_nut(balanced, 0.0) == pytest.approx(101.5 * G / 2 - 600)


def test_a_transmission_is_a_motor_of_the_squared_ratio_in_inertia(axes):
    geared = changed(axes["M"], drive__ratio=2.0)
    direct = changed(axes["M"], drive__rotor_inertia=4 * axes["M"].drive.rotor_inertia)
    assert rotor_mass(geared) == pytest.approx(rotor_mass(direct))
    assert predicted_frequency(geared, 0.2, 10.0) == pytest.approx(predicted_frequency(direct, 0.2, 10.0))
    assert rod_frequency(geared, 0.2, 10.0) == pytest.approx(rod_frequency(direct, 0.2, 10.0), rel=1e-9)
    assert motor_travel(geared) == motor_travel(axes["M"]) / 2


def test_belt_and_coupling_are_in_series(axes):
    one = changed(axes["M"], drive__coupling_stiffness=4000.0, drive__belt_stiffness=6000.0)
    other = changed(axes["M"], drive__coupling_stiffness=2400.0)
    assert drive_compliance(one) == pytest.approx(drive_compliance(other))
    assert rod_frequency(one, 0.2, 0.0) == pytest.approx(rod_frequency(other, 0.2, 0.0), rel=1e-9)


@pytest.mark.parametrize("support", ["fixed-free", "fixed-fixed"])
def test_a_rotating_nut_is_alike_in_the_lumped_and_the_distributed_model(axes, support):
    sheet = massless(axes["M"], support=support, drive__rotating="nut", drive__belt_stiffness=5000.0)
    for rotor in ("free", "held"):
        lumped = predicted_frequency(sheet, 0.3, 20.0, rotor=rotor)
        assert rod_frequency(sheet, 0.3, 20.0, rotor=rotor) == pytest.approx(float(lumped), rel=1e-5)


def test_a_screw_that_stands_still_has_no_inertia_to_turn_and_its_bearing_moves_with_the_nut(axes):
    nut = changed(axes["M"], drive__rotating="nut", support="fixed-fixed")
    beta = compliance.transmission_ratio(0.010)
    assert rotor_mass(nut) == pytest.approx(3.0e-4 / beta**2)
    ends = np.array([-0.12, 0.78])
    assert structure_compliance(nut, ends, torsion=True) == pytest.approx(1 / 180e6)


def test_two_bearings_are_alike_in_the_lumped_and_the_distributed_model(axes):
    sheet = massless(axes["M"], support="fixed-fixed", bearing__far_stiffness=60e6)
    lumped = predicted_frequency(sheet, 0.5, 20.0, rotor="held")
    assert rod_frequency(sheet, 0.5, 20.0, rotor="held") == pytest.approx(float(lumped), rel=1e-5)


def test_pretension_is_used_up_by_the_load_of_the_closed_form_and_by_warmth(axes):
    sheet = changed(axes["M"], support="fixed-fixed", bearing__pretension=2000.0)
    section = 206e9 * math.pi * 0.0214**2 / 4
    whole = 0.9 / section + 2 / 180e6
    # In the middle both sides are alike, and each takes half of a load.
    load, warmer = pretension_reserve(sheet, 0.45 - 0.12)
    assert load == pytest.approx(4000.0)
    # A screw longer by α ΔT L has lost all tension where this is the whole elongation 2000 N · C.
    assert 11.5e-6 * warmer * 0.9 == pytest.approx(2000.0 * whole)
    assert pretension_reserve(sheet, [0.0, 0.33])[0] < load
    assert pretension_reserve(axes["M"], 0.0) is None


def test_the_ends_of_a_screw_that_stands_still_do_not_yield(axes):
    sheet = changed(axes["M"], support="fixed-fixed", bearing__pretension=2000.0, drive__rotating="nut")
    _, warmer = pretension_reserve(sheet, 0.0)
    assert 11.5e-6 * warmer == pytest.approx(2000.0 / (206e9 * math.pi * 0.0214**2 / 4))


def test_the_softer_bearing_softens_its_own_end(axes):
    sheet = changed(axes["M"], support="fixed-fixed", bearing__far_stiffness=60e6)
    near, far = structure_compliance(sheet, np.array([-0.12, 0.78]), torsion=False)
    shaft = 0.9 / (206e9 * math.pi * 0.0214**2 / 4)
    assert 1 / near == pytest.approx(180e6 + 1 / (shaft + 1 / 60e6))
    assert 1 / far == pytest.approx(60e6 + 1 / (shaft + 1 / 180e6))
