from __future__ import annotations

import math
from dataclasses import replace

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from ballscrew.axis.hertz import RELEASE, apparent_preload
from ballscrew.axis.sheet import Guide
from ballscrew.fcft.conditions import Condition
from ballscrew.fcft.expected import executed
from ballscrew.fcft.nutload import ADVISED, hardest, nut_load, ringing_load
from ballscrew.fcft.plan import Motion, Plan

BENCH = Motion(0.15, 2.5, 1500.0, 0.35)


def test_the_four_conditions_of_the_bench(sheet):
    # M a = 132 kg · 2.5 m/s² = 330 N, F_f = 25 N.
    wanted = {Condition.PA: 355.0, Condition.PD: -305.0, Condition.NA: -355.0, Condition.ND: 305.0}
    assert {c: nut_load(sheet, BENCH, 100.0, c) for c in Condition} == pytest.approx(wanted)


def test_friction_stands_against_the_way_and_mass_against_the_acceleration(sheet):
    without = replace(sheet, guide=Guide(0.0))
    for condition in Condition:
        friction = nut_load(sheet, BENCH, 0.0, condition) - nut_load(without, BENCH, 0.0, condition)
        assert friction == pytest.approx(25.0 * condition.direction)
    accelerating = {c for c in Condition if nut_load(without, BENCH, 0.0, c) > 0}
    assert accelerating == {Condition.PA, Condition.ND}, "where the acceleration points upwards"


@pytest.mark.parametrize("sign", [1, -1])
def test_the_weight_of_a_vertical_axis_is_the_same_in_all_conditions(sheet, sign):
    vertical = replace(
        sheet, orientation="vertical", inclination=math.pi / 2, positive="up" if sign > 0 else "down"
    )
    weight = sign * 132.0 * 9.80665
    for condition in Condition:
        for load_on_nut in (nut_load, ringing_load):
            more = load_on_nut(vertical, BENCH, 100.0, condition) - load_on_nut(
                sheet, BENCH, 100.0, condition
            )
            assert more == pytest.approx(weight)


def test_what_counts_is_the_acceleration_that_is_reached(sheet):
    triangle = Motion(0.05, 10.0, 500.0, 0.2)  # reaches 5 m/s²
    assert nut_load(sheet, triangle, 8.0, Condition.PA) == pytest.approx(40 * 5.0 + 25)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    acceleration=st.floats(0.01, 50.0), load=st.floats(0.0, 1e4), friction=st.floats(0.0, 1e4),
    condition=st.sampled_from(Condition),
)  # fmt: skip
def test_the_way_back_is_the_mirror_of_the_way_there(sheet, acceleration, load, friction, condition):
    sheet = replace(sheet, guide=Guide(friction))
    motion = Motion(0.5, acceleration, 1e6, 0.1)
    mirror = {"PA": "NA", "NA": "PA", "PD": "ND", "ND": "PD"}[condition]
    force = nut_load(sheet, motion, load, condition)
    assert force == -nut_load(sheet, motion, load, Condition(mirror))
    assert abs(force) <= nut_load(sheet, motion, load, Condition.PA)


def test_what_the_limits_mean():
    assert apparent_preload(ADVISED, 1.0) == pytest.approx(0.90, abs=0.005)
    assert apparent_preload(RELEASE * 1.0001, 1.0) == pytest.approx(apparent_preload(RELEASE, 0.9), rel=1e-3)


def test_a_mode_rings_under_the_acceleration_only_after_a_departure(sheet):
    for condition in Condition:
        ringing = ringing_load(sheet, BENCH, 100.0, condition)
        if condition.accelerating:
            assert ringing == nut_load(sheet, BENCH, 100.0, condition)
        else:
            assert ringing == 25.0 * condition.direction


def test_the_hardest_repetition_is_not_the_nominal_one():
    triangle = Motion(0.05, 10.0, 500.0, 0.2, jerk_spread=1.0)  # reaches √(v j)
    plan = Plan((0.0, 0.1), 4, (0.0,), (triangle,))
    runs = executed(plan, 0)
    assert hardest(runs).peak_acceleration == max(one.peak_acceleration for one in runs)
    assert hardest(runs).peak_acceleration > 1.1 * triangle.peak_acceleration
