from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from ballscrew.axis.frequency import predicted_frequency
from ballscrew.axis.hertz import RELEASE
from ballscrew.axis.sheet import Guide, Limits
from ballscrew.fcft.conditions import Condition
from ballscrew.fcft.excitation import blow_spectrum
from ballscrew.fcft.levels import GENTLER, HIGH, LOW, gentle_motion, two_levels
from ballscrew.fcft.limits import check_limits, required_torque
from ballscrew.fcft.nutload import nut_load
from ballscrew.fcft.plan import Motion, Plan, read_plan, validate_plan
from ballscrew.fcft.planfile import plan_toml

BENCH = Motion(0.15, 2.5, 1500.0, 0.35, 0.2, 0.05)
PLAN = Plan(tuple(0.045 * index for index in range(11)), 3, (0.0, 100.0), (BENCH,))


def test_the_two_levels_of_the_bench(sheet):
    found = two_levels(PLAN, sheet)
    low, high = found.motions
    assert found.reason == ""
    for motion, ratio in ((low, LOW), (high, HIGH)):
        force = nut_load(sheet, motion, 100.0, Condition.PA)
        assert force / sheet.nominal_preload == pytest.approx(ratio, rel=1e-12)
        assert motion.reaches_acceleration
        assert (motion.dwell, motion.jerk_spread, motion.start_spread) == (0.35, 0.2, 0.05)
    assert high.jerk_time == pytest.approx(low.jerk_time)
    assert high.acceleration_time == pytest.approx(low.acceleration_time)


def test_their_spectra_differ_in_size_alone(sheet):
    low, high = two_levels(PLAN, sheet).motions
    for frequency in (50.0, 121.8, 168.0, 280.0):
        assert blow_spectrum(frequency, low) == pytest.approx(blow_spectrum(frequency, high))
    assert low.speed / low.peak_acceleration == pytest.approx(high.speed / high.peak_acceleration)


def test_the_shift_is_about_half_a_per_cent_and_downwards(sheet):
    found = two_levels(PLAN, sheet)
    low, high = predicted_frequency(sheet, 0.0, 100.0, nut_load=[300.0, 900.0])
    assert found.shift == pytest.approx(high - low)
    assert -0.01 < found.shift / low < -0.003


def test_on_a_vertical_axis_one_direction_has_the_loads_and_the_shift_is_the_mean_of_both(sheet):
    light = replace(sheet.table, mass=5.0)
    vertical = replace(sheet, table=light, orientation="vertical", inclination=math.pi / 2)
    found = two_levels(replace(PLAN, masses=(5.0,)), vertical)
    up, down = (
        [row[condition] for row in found.nut_load_ratio] for condition in (Condition.PA, Condition.NA)
    )
    weight = 10.0 * 9.80665 / sheet.nominal_preload
    assert up == pytest.approx([LOW, HIGH])
    assert down == pytest.approx([2 * weight - LOW, 2 * weight - HIGH])
    under = predicted_frequency(vertical, 0.0, 5.0, nut_load=600.0 * np.array([up, down]))
    assert found.shift == pytest.approx(np.diff(under).mean())
    assert abs(found.shift) < abs(np.diff(under[0]).item())


def test_a_soft_jerk_is_hardened_until_it_excites(sheet):
    soft = replace(PLAN, motions=(replace(BENCH, jerk=375.0),))
    highest = float(predicted_frequency(sheet, 0.0, 0.0))
    assert all(m.jerk_time == pytest.approx(0.5 / highest) for m in two_levels(soft, sheet).motions)
    hard = replace(PLAN, motions=(replace(BENCH, jerk=1e9),))
    assert all(m.jerk_time == pytest.approx(0.05 / highest) for m in two_levels(hard, sheet).motions)
    assert all(m.jerk < 1e6 for m in two_levels(hard, sheet).motions), "and no drive is asked for the absurd"


def test_what_is_written_is_what_was_offered(sheet, tmp_path):
    plan = replace(PLAN, motions=two_levels(PLAN, sheet).motions)
    (tmp_path / "levels.toml").write_text(plan_toml(plan), encoding="utf-8")
    back = read_plan(tmp_path / "levels.toml")
    for a, b in zip(plan.motions, back.motions, strict=True):
        assert a.jerk_time == pytest.approx(b.jerk_time, rel=1e-7)
        assert a.peak_acceleration == pytest.approx(b.peak_acceleration, rel=1e-7)


@pytest.mark.parametrize(("changes", "words"), [
    ({"guide": Guide(300.0)}, "guides' friction of 300 N alone reaches 0.5 P (300 N)"),
    ({"orientation": "vertical", "inclination": 1.57}, "the weight of 1294 N with the guides' friction"),
    ({"limits": Limits(speed=0.2)}, "it would take 0.33 m/s, and the axis may do 0.2 m/s"),
    ({"limits": Limits(torque=2.0)}, "and the motor may give 2 N m"),
    ({"limits": Limits(lowest_position=0.01)}, "limits.lowest_position"),
])  # fmt: skip
def test_why_there_is_none(sheet, changes, words):
    found = two_levels(PLAN, replace(sheet, **changes))
    assert found.motions == ()
    assert found.shift == 0.0
    assert words in found.reason
    assert not found.reason.endswith("."), "it goes into a sentence"


def test_limits_that_are_just_enough(sheet):
    _, high = two_levels(PLAN, sheet).motions
    torque = required_torque(sheet, high, 100.0)
    enough = replace(sheet, limits=Limits(0.0, 0.45, high.speed, torque))
    assert two_levels(PLAN, enough).motions == two_levels(PLAN, sheet).motions
    for limits in (Limits(speed=0.999 * high.speed), Limits(torque=0.999 * torque)):
        assert two_levels(PLAN, replace(sheet, limits=limits)).motions == ()


def test_close_stops_leave_no_room(sheet):
    close = replace(PLAN, positions=(0.0, 0.015, 0.45))
    assert "stops 15 mm apart are too close" in two_levels(close, sheet).reason


def test_a_jerk_that_varies_needs_room_for_its_softest(sheet):
    wide = replace(PLAN, repetitions=50, motions=(replace(BENCH, jerk=375.0, jerk_spread=1.0),))
    offered = two_levels(replace(wide, positions=(0.0, 0.45)), sheet).motions
    way = 2 * offered[1].acceleration_distance
    tight = replace(wide, positions=(0.0, way / 0.95, 0.45))  # enough for the nominal jerk
    assert "too close" in two_levels(tight, sheet).reason
    same = replace(tight, motions=(replace(tight.motions[0], jerk_spread=0.0),))
    assert two_levels(same, sheet).reason == ""


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    gap=st.floats(0.005, 0.5), loads=st.lists(st.floats(0, 1000), min_size=1, max_size=3, unique=True),
    friction=st.floats(0, 400), jerk=st.floats(10, 1e7), spread=st.floats(0, 1), speed=st.floats(0.01, 2),
    torque=st.floats(0.5, 50),
)  # fmt: skip
def test_what_is_offered_can_be_done(sheet, gap, loads, friction, jerk, spread, speed, torque):
    sheet = replace(sheet, guide=Guide(friction), limits=Limits(0.0, 0.57, speed, torque))
    motion = Motion(0.01, 0.5, jerk, 0.3, spread)
    plan = Plan((0.0, gap), 20, tuple(loads), (motion,))
    found = two_levels(plan, sheet)
    assert bool(found.motions) != bool(found.reason)
    assume(found.motions)
    offered = replace(plan, motions=found.motions)
    validate_plan(offered, sheet)
    assert check_limits(offered, sheet).broken == ()
    ratios = [nut_load(sheet, m, max(loads), Condition.PA) / 600 for m in found.motions]
    assert ratios == pytest.approx([LOW, HIGH])


def test_the_gentler_motion_unloads_the_nut_at_a_third_of_the_preload(sheet):
    plain = replace(PLAN, motions=(Motion(0.15, 2.5, 1500.0, 0.35),))
    found = gentle_motion(plain, sheet)
    motion = found.motion
    assert motion is not None
    force = nut_load(sheet, motion, 100.0, Condition.PA)
    assert force / RELEASE / sheet.nominal_preload == pytest.approx(found.unloads_below)
    hardest = nut_load(sheet, plain.motions[0], 100.0, Condition.PA)
    assert hardest / RELEASE / sheet.nominal_preload == pytest.approx(found.own_unloads_below)
    assert found.unloads_below == pytest.approx(found.own_unloads_below / GENTLER)
    assert motion.jerk_time == pytest.approx(plain.motions[0].jerk_time)
    assert motion.acceleration_time == pytest.approx(plain.motions[0].acceleration_time)
    assert found.excitation == pytest.approx(motion.acceleration / 2.5)
    assert found.repetitions == pytest.approx(found.excitation**-2)
    validate_plan(replace(plain, motions=(motion,)), sheet)
    assert check_limits(replace(plain, motions=(motion,)), sheet).broken == ()


def test_no_motion_is_gentle_enough_for_a_guide_that_unloads_the_nut_alone(sheet):
    stiff = replace(sheet, guide=Guide(5000.0))
    found = gentle_motion(PLAN, stiff)
    assert found.motion is None
    assert "friction and weight alone (5000 N)" in found.reason
