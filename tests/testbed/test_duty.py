from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ballscrew.base.errors import InputError
from ballscrew.testbed.duty import Duty, Stroke, jitter, phases, production
from ballscrew.testbed.example import AXIS

POSITIONS = [0.0, 0.1, 0.3, 0.45]


def test_a_production_cycle_goes_back_to_its_first_position():
    strokes = production(POSITIONS, 0.2, 2.0, 100.0, {0.0: 0.25, 80.0: 0.75})
    assert len(strokes) == 8
    assert Duty(strokes).travel_per_day == pytest.approx(100 * 2 * 0.45)
    assert {(s.load, s.per_day) for s in strokes} == {(0.0, 25.0), (80.0, 75.0)}
    assert [(s.start, s.stop) for s in strokes[:4]] == [(0, 0.1), (0.1, 0.3), (0.3, 0.45), (0.45, 0)]


def test_jittering_goes_to_and_fro_about_its_places():
    strokes = jitter([0.1, 0.3], 0.02, 0.1, 2.0, 1000.0, load=50.0)
    assert Duty(strokes).travel_per_day == pytest.approx(1000 * 2 * 0.02)
    assert {round((s.start + s.stop) / 2, 9) for s in strokes} == {0.1, 0.3}


def test_times_of_a_long_and_of_a_short_stroke():
    long = Stroke(0.0, 0.5, 0.2, 2.0, 1.0)
    assert long.ramp == pytest.approx(0.01)
    assert long.time == pytest.approx(0.5 / 0.2 + 0.2 / 2.0)
    short = Stroke(0.0, 0.01, 0.2, 2.0, 1.0)  # 0.141 m/s at its middle
    assert short.ramp == pytest.approx(0.005)
    assert short.time == pytest.approx(2 * (0.01 / 2.0) ** 0.5)
    assert Duty((Stroke(0.5, 0.0, 0.2, 2.0, 3600 / 2.6),)).hours_per_day == pytest.approx(1.0)


def test_nut_loads_of_a_stroke():
    duty = Duty((Stroke(0.4, 0.0, 0.2, 2.0, 10.0, load=50.0, force=300.0),))
    mass, friction = AXIS.table.mass + 50.0, AXIS.guide.friction
    first, middle, last = phases(duty, AXIS)
    assert (first.low, first.high) == (pytest.approx(0.39), 0.4)
    assert (last.low, last.high) == (0.0, pytest.approx(0.01))
    assert first.nut_load == pytest.approx(mass * 2 + friction)
    assert middle.nut_load == friction + 300
    assert last.nut_load == pytest.approx(mass * 2 - friction)


@given(
    start=st.floats(-1, 1),
    length=st.floats(1e-3, 1),
    speed=st.floats(1e-3, 2),
    acceleration=st.floats(0.1, 20),
)
def test_the_phases_of_a_stroke_are_its_whole_way(start, length, speed, acceleration):
    duty = Duty((Stroke(start, start - length, speed, acceleration, 5.0),))
    found = phases(duty, AXIS)
    assert sum((p.high - p.low) * p.per_day for p in found) == pytest.approx(duty.travel_per_day, rel=1e-9)
    assert all(p.low < p.high and p.nut_load >= 0 for p in found)


@pytest.mark.parametrize(
    "change",
    [
        {"stop": 0.0},
        {"speed": 0.0},
        {"speed": float("nan")},
        {"acceleration": -1.0},
        {"per_day": -1.0},
        {"load": -1.0},
        {"force": float("inf")},
        {"start": "here"},
    ],
)
def test_strokes_that_cannot_be(change):
    values = {"start": 0.0, "stop": 0.1, "speed": 0.1, "acceleration": 1.0, "per_day": 1.0} | change
    with pytest.raises(InputError):
        Stroke(**values)


def test_duties_that_cannot_be():
    with pytest.raises(InputError, match="no strokes"):
        Duty(())
    with pytest.raises(InputError, match="24 or less"):
        Duty((Stroke(0.0, 0.1, 0.1, 1.0, 90_000.0),))
    with pytest.raises(InputError, match="shares"):
        production(POSITIONS, 0.2, 2.0, 1.0, {0.0: 0.5})
    with pytest.raises(InputError, match="2 or more"):
        production([0.1], 0.2, 2.0, 1.0, {0.0: 1.0})
    with pytest.raises(InputError, match="somewhere"):
        production([0.1, 0.2, 0.1], 0.2, 2.0, 1.0, {0.0: 1.0})
    with pytest.raises(InputError, match="no place"):
        jitter([], 0.01, 0.1, 1.0, 1.0)
    with pytest.raises(InputError, match="stroke"):
        jitter([0.1], 0.0, 0.1, 1.0, 1.0)
