from __future__ import annotations

import math
from dataclasses import replace

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from ballscrew.axis.sheet import Drive, Limits
from ballscrew.axis.sheet_file import read_axis
from ballscrew.base.errors import InputError
from ballscrew.fcft.limits import check_limits, require_safe, required_torque
from ballscrew.fcft.plan import Motion, read_plan

BENCH = Motion(0.15, 2.5, 1500.0, 0.35)


def test_the_torque_of_the_bench_by_hand(sheet):
    # Screw: pi 0.0176^4 0.65 7850 / 32 = 4.807e-5 kg m^2; with 4.2e-4 over (0.01/2pi)^2 = 184.8 kg.
    beta = 0.01 / (2 * math.pi)
    rotor = (4.2e-4 + math.pi * 0.0176**4 * 0.65 * 7850 / 32) / beta**2
    drag = 0.05 / math.sqrt(0.01 / (math.pi * 0.0176)) * 600 * beta
    wanted = beta * ((32 + 100 + rotor) * 2.5 + 25) + drag
    assert required_torque(sheet, BENCH, 100.0) == pytest.approx(wanted, rel=1e-12)
    assert wanted == pytest.approx(1.412, abs=0.001)


def test_the_bench_takes_what_was_measured_on_it(bench):
    # Another program wrote the recording; its servo's noise and friction at speed lie on top.
    h5py = pytest.importorskip("h5py")
    plan, sheet = read_plan(bench / "plan.toml"), read_axis(bench / "axis.toml")
    with h5py.File(bench / "preload-4-percent-trip1.h5") as file:
        names = []
        file.visit(names.append)
        torque = abs(file[next(name for name in names if name.endswith("torque"))][()]).max()
    needed = required_torque(sheet, plan.motions[0], plan.masses[0])
    assert 0.7 * torque < needed < 1.4 * torque


def test_the_torque_of_a_triangle_is_that_of_what_it_reaches(sheet):
    triangle = Motion(0.1, 10.0, 100.0, 0.0)
    assert required_torque(sheet, triangle, 0.0) == pytest.approx(
        required_torque(sheet, replace(triangle, acceleration=triangle.peak_acceleration), 0.0)
    )
    assert required_torque(sheet, triangle, 0.0) < required_torque(sheet, replace(triangle, jerk=1e5), 0.0)


def test_preload_load_and_rotor_cost_torque(sheet):
    least = required_torque(sheet, BENCH, 0.0, 0.0)
    assert required_torque(sheet, BENCH, 0.0) > least
    assert required_torque(sheet, BENCH, 10.0, 0.0) > least
    heavy = replace(sheet, drive=Drive(1e-3))
    assert required_torque(heavy, BENCH, 0.0, 0.0) > least
    assert required_torque(sheet, BENCH, 0.0) == required_torque(sheet, BENCH, 0.0, 600.0)


def test_a_transmission_divides_the_torque_and_a_vertical_axis_needs_more(sheet):
    motion = Motion(0.15, 2.5, 1500.0, 0.35)
    direct = required_torque(sheet, motion, 50.0)
    # Twice the ratio: four times the motor's inertia at the screw, and half of the torque at the motor.
    geared = replace(sheet, drive=Drive(sheet.drive.rotor_inertia / 4, ratio=2.0))
    assert required_torque(geared, motion, 50.0) == pytest.approx(direct / 2)
    vertical = replace(sheet, orientation="vertical", inclination=math.pi / 2)
    more = required_torque(vertical, motion, 50.0) - direct
    assert more == pytest.approx(82 * 9.80665 * 0.01 / (2 * math.pi))


@pytest.mark.parametrize("preload", [-1.0, math.nan, math.inf])
def test_an_impossible_preload(sheet, preload):
    with pytest.raises(InputError, match="preload"):
        required_torque(sheet, BENCH, 0.0, preload)


def test_what_is_not_stated_is_said(read, sheet):
    check = require_safe(read(), sheet)
    assert check.broken == ()
    assert [line.split(",")[0] for line in check.unchecked] == [
        f"axis.toml does not state limits.{name}"
        for name in ("lowest_position", "highest_position", "speed", "torque")
    ]
    stated = Limits(lowest_position=0.0, highest_position=0.45, speed=0.15, torque=1.5)
    assert check_limits(read(), replace(sheet, limits=stated)) == type(check)((), ())


def test_everything_that_is_broken_is_told_at_once(read, sheet):
    limits = Limits(lowest_position=0.001, highest_position=0.449, speed=0.149, torque=1.4)
    check = check_limits(read(), replace(sheet, limits=limits))
    position, far, speed, torque = check.broken
    assert position == (
        "plan.toml: positions has 0 m; limits.lowest_position of axis.toml allows 0.001 m or more."
    )
    assert far == (
        "plan.toml: positions has 0.45 m; limits.highest_position of axis.toml allows 0.449 m or less."
    )
    assert speed == "plan.toml: motion.speed is 0.15 m/s; limits.speed of axis.toml allows 0.149 m/s or less."
    assert torque == (
        "plan.toml: motion needs a torque of 1.41 N m with a load of 100 kg; limits.torque of axis.toml "
        "allows 1.4 N m or less."
    )
    with pytest.raises(InputError) as error:
        require_safe(read(), replace(sheet, limits=limits))
    assert str(error.value) == " ".join(check.broken)


def test_the_heaviest_load_counts(read, sheet):
    plan = replace(read(), masses=(0.0, 500.0, 20.0))
    limit = required_torque(sheet, plan.motions[0], 500.0)
    (broken,) = check_limits(plan, replace(sheet, limits=Limits(torque=limit * 0.999))).broken
    assert "with a load of 500 kg" in broken
    assert not check_limits(plan, replace(sheet, limits=Limits(torque=limit))).broken


def test_the_motion_that_is_too_much_is_named(read, sheet):
    plan = replace(read(), motions=(BENCH, replace(BENCH, speed=0.3), replace(BENCH, acceleration=5.0)))
    broken = check_limits(plan, replace(sheet, limits=Limits(speed=0.2, torque=2.0))).broken
    assert [line.split(": ")[1][:14] for line in broken] == ["motion[1].spee", "motion[2] need"]


def test_a_varied_jerk_counts(read, sheet):
    # 0.1 m/s at 100 m/s³ is a triangle: a higher jerk reaches a higher acceleration.
    triangle = Motion(0.1, 10.0, 100.0, 0.1, jerk_spread=1.0)
    plan = replace(read(), motions=(triangle,), repetitions=7)
    limit = required_torque(sheet, triangle, 100.0)
    assert check_limits(plan, replace(sheet, limits=Limits(torque=limit))).broken
    steady = replace(plan, motions=(replace(triangle, jerk_spread=0.0),))
    assert not check_limits(steady, replace(sheet, limits=Limits(torque=limit))).broken


def test_a_lower_jerk_needs_a_longer_way(read, sheet):
    triangle = Motion(0.1, 10.0, 100.0, 0.1, jerk_spread=1.0)
    way = 2 * triangle.acceleration_distance
    plan = replace(read(), positions=(0.0, way), motions=(triangle,), repetitions=7)
    with pytest.raises(
        InputError, match=r"motion\.jerk_spread is 1, which brings the jerk down to .* apart\."
    ):
        require_safe(plan, sheet)
    require_safe(replace(plan, repetitions=1), sheet)  # the first has the nominal jerk
    require_safe(replace(plan, motions=(replace(triangle, jerk_spread=0.0),)), sheet)


def test_the_screw_ends_where_no_limit_is_stated(read, sheet):
    with pytest.raises(InputError, match="not on the screw"):
        require_safe(replace(read(), positions=(0.0, 0.6)), sheet)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
@given(
    low=st.floats(-0.08, 0.6), high=st.floats(-0.08, 0.6), speed=st.floats(0.01, 1), torque=st.floats(0.1, 9)
)
def test_what_is_safe_keeps_to_every_limit(read, sheet, low, high, speed, torque):
    limits = Limits(low, high, speed, torque)
    plan = read()
    safe = not check_limits(plan, replace(sheet, limits=limits)).broken
    needed = required_torque(sheet, plan.motions[0], 100.0)
    assert safe == (low <= 1e-9 and high >= 0.45 - 1e-9 and speed > 0.15 - 1e-9 and torque > needed - 1e-8)


def test_limits_change_no_number(sheet):
    assert replace(sheet, limits=Limits(speed=1.0)).to_settings() == sheet.to_settings()
