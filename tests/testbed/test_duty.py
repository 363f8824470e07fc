from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ballscrew.base.errors import InputError
from ballscrew.testbed.duty import Stroke, exposure, jitter, phases, production
from ballscrew.testbed.example import AXIS

POSITIONS = [0.0, 0.1, 0.3, 0.45]
EDGES = np.linspace(0, 0.45, 46)
DUTY = production([0.0, 0.2, 0.45], 0.2, 2.0, 500.0, 40.0) + jitter([0.3], 0.02, 0.1, 2.0, 4e4, 40.0)


def travel(strokes):
    return sum(stroke.length * stroke.per_day for stroke in strokes)


def test_a_production_cycle_goes_back_to_its_first_position():
    strokes = production(POSITIONS, 0.2, 2.0, 100.0, 80.0)
    assert travel(strokes) == pytest.approx(100 * 2 * 0.45)
    assert {(s.load, s.per_day) for s in strokes} == {(80.0, 100.0)}
    assert [(s.start, s.stop) for s in strokes] == [(0, 0.1), (0.1, 0.3), (0.3, 0.45), (0.45, 0)]


def test_jittering_goes_to_and_fro_about_its_places():
    strokes = jitter([0.1, 0.3], 0.02, 0.1, 2.0, 1000.0, load=50.0)
    assert travel(strokes) == pytest.approx(1000 * 2 * 0.02)
    assert {round((s.start + s.stop) / 2, 9) for s in strokes} == {0.1, 0.3}


def test_ramps_of_a_long_and_of_a_short_stroke():
    long = Stroke(0.0, 0.5, 0.2, 2.0, 1.0)
    assert long.ramp == pytest.approx(0.01)
    short = Stroke(0.0, 0.01, 0.2, 2.0, 1.0)  # 0.141 m/s at its middle
    assert short.ramp == pytest.approx(0.005)


def test_nut_loads_of_a_stroke():
    duty = (Stroke(0.4, 0.0, 0.2, 2.0, 10.0, load=50.0),)
    mass, friction = AXIS.table.mass + 50.0, AXIS.guide.friction
    first, middle, last = phases(duty, AXIS)
    assert (first.low, first.high) == (pytest.approx(0.39), 0.4)
    assert (last.low, last.high) == (0.0, pytest.approx(0.01))
    assert first.nut_load == pytest.approx(mass * 2 + friction)
    assert middle.nut_load == friction
    assert last.nut_load == pytest.approx(mass * 2 - friction)


@pytest.mark.parametrize("positive", ["up", "down"])
def test_nut_loads_of_a_vertical_axis_carry_the_weight(positive):
    sheet = replace(AXIS, orientation="vertical", inclination=math.pi / 2, positive=positive)
    mass, friction = AXIS.table.mass + 50.0, AXIS.guide.friction
    weight, inertia = 9.80665 * mass, 2 * mass
    low_to_high, high_to_low = Stroke(0.0, 0.4, 0.2, 2.0, 10.0, 50.0), Stroke(0.4, 0.0, 0.2, 2.0, 10.0, 50.0)
    raised, lowered = (low_to_high, high_to_low) if positive == "up" else (high_to_low, low_to_high)
    upward = [phase.nut_load for phase in phases((raised,), sheet)]
    assert upward == pytest.approx(
        [weight + inertia + friction, weight + friction, weight - inertia + friction]
    )
    downward = [phase.nut_load for phase in phases((lowered,), sheet)]
    assert downward == pytest.approx(
        [weight - inertia - friction, weight - friction, weight + inertia - friction]
    )


@given(
    start=st.floats(-1, 1),
    length=st.floats(1e-3, 1),
    speed=st.floats(1e-3, 2),
    acceleration=st.floats(0.1, 20),
)
def test_the_phases_of_a_stroke_are_its_whole_way(start, length, speed, acceleration):
    duty = (Stroke(start, start - length, speed, acceleration, 5.0),)
    found = phases(duty, AXIS)
    assert sum((p.high - p.low) * p.per_day for p in found) == pytest.approx(travel(duty), rel=1e-9)
    assert all(p.low < p.high and p.nut_load >= 0 for p in found)


def test_a_plain_histogram_counts_every_pass():
    duty = (Stroke(0.1, 0.205, 0.2, 2.0, 7.0),)
    found = exposure(duty, AXIS, [0.0, 0.1, 0.15, 0.2, 0.3], nut_length=0.0)
    np.testing.assert_allclose(found.travel, [0, 0.35, 0.35, 0.035], atol=1e-12)
    friction, inertia = AXIS.guide.friction, 2.0 * AXIS.table.mass
    first = (0.01 * (inertia + friction) + 0.04 * friction) / 0.05
    np.testing.assert_allclose(found.nut_load[:2], [0, first])
    assert found.nut_load[3] == pytest.approx(inertia - friction)


@given(nut=st.floats(0.001, 0.2), place=st.floats(-0.5, 0.5), stroke=st.floats(1e-3, 0.3))
def test_no_travel_is_lost_on_a_grid_that_covers_it(nut, place, stroke):
    duty = jitter([place], stroke, 0.1, 2.0, 100.0, 0.0)
    found = exposure(duty, AXIS, np.linspace(-1, 1, 101), nut)
    assert found.travel.sum() == pytest.approx(travel(duty), rel=1e-6)
    assert found.travel.min() >= 0
    assert (found.travel * found.x).sum() / found.travel.sum() == pytest.approx(place, abs=0.01)
    assert found.mean_nut_load == pytest.approx(
        (found.travel * found.nut_load).sum() / found.travel.sum(), rel=1e-6
    )


def test_the_exposure_is_what_sampling_finds():
    nut, marks = 0.06, np.linspace(-0.2, 0.7, 91)
    fine = np.linspace(-0.3, 0.8, 11_001)
    box = np.ones(601) / 601
    passes = np.zeros_like(fine)
    for phase in phases(DUTY, AXIS):
        passes += phase.per_day * ((fine > phase.low) & (fine < phase.high))
    spread = np.convolve(np.convolve(passes, box, "same"), box, "same")
    sampled = np.histogram(fine, marks, weights=spread * 1e-4)[0]
    np.testing.assert_allclose(exposure(DUTY, AXIS, marks, nut).travel, sampled, rtol=0.03, atol=0.5)


def test_travel_by_jittering_is_local():
    found = exposure(DUTY, AXIS, EDGES)
    assert found.x[np.argmax(found.density)] == pytest.approx(0.3, abs=0.006)
    assert found.density.max() > 3 * np.median(found.density)
    assert found.travel_per_day == travel(DUTY)


@pytest.mark.parametrize(
    "edges", [[0.0], [], [0.1, 0.1], [0.2, 0.1], [[0, 1], [2, 3]], [0, float("nan")], "x"]
)
def test_a_grid_that_does_not_ascend_is_refused(edges):
    with pytest.raises(InputError):
        exposure(DUTY, AXIS, edges)


def test_a_nut_of_negative_length_is_refused():
    with pytest.raises(InputError, match="length of the nut"):
        exposure(DUTY, AXIS, EDGES, -0.1)
