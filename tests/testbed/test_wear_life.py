"""Wear over a life: the closed law, local wear, calibration, machines as they wear."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from ballscrew.axis.model import kappa
from ballscrew.axis.wear import backlash_after_wear, contact_pressure_law, preload_after_wear
from ballscrew.base.errors import InputError
from ballscrew.testbed.duty import Exposure, exposure, jitter, production
from ballscrew.testbed.example import AXIS, PLAN
from ballscrew.testbed.experiments import run_to_failure_life
from ballscrew.testbed.machine import Machine
from ballscrew.testbed.pace import Pace
from ballscrew.testbed.wear_life import Life, calibrated, wear_on, worn_machines

EDGES = np.linspace(0, 0.45, 10)
EVEN = Pace(running_in=0.0, dry=0.0)
PRELOAD = AXIS.nominal_preload
KAPPA = kappa(AXIS)
NEW = Machine(AXIS, PRELOAD)


def even(load: float = 0.0, pace: Pace = EVEN) -> Life:
    """The same travel and nut load everywhere."""
    uniform = Exposure(EDGES, np.full(9, 300.0 / 9), np.full(9, load), 300.0, load)
    return Life(AXIS, uniform, PRELOAD, rate=4e-10, pace=pace)


def run_to_failure() -> Life:
    return run_to_failure_life(NEW, PLAN, 100.0, 80.0)


def test_even_wear_is_the_law_of_contact_pressure():
    life = even()
    days = np.linspace(0, 200, 101)
    # From dw/dN at N = 0, which is the rate: P' / P₀ = −1.5 rate/δ₀.
    half_travel = 3 * (1 - 2 ** (-1 / 3)) / (1.5 * life.rate / life.pressed)
    found = preload_after_wear(wear_on(life, days), PRELOAD, KAPPA)
    expected = contact_pressure_law(days * 300.0, PRELOAD, half_travel)
    assert expected[-1] < 0.2 * PRELOAD
    np.testing.assert_allclose(found, np.repeat(expected[:, None], 9, axis=1), rtol=1e-6, atol=1e-6 * PRELOAD)


@pytest.mark.parametrize("load", [5.0, 150.0, 6000.0])
def test_wear_under_a_nut_load_is_the_integral_of_the_rate(load):
    life = even(load)
    rate = life.rate * 300.0 * life.local[0]

    def slope(_: float, w: np.ndarray) -> np.ndarray:
        preload = PRELOAD * np.maximum(1 - w / life.pressed, 0) ** 1.5
        return rate * np.maximum(preload ** (1 / 3), 0.5 * load ** (1 / 3)) / PRELOAD ** (1 / 3)

    days = np.linspace(0, 200, 41)
    expected = solve_ivp(slope, (0, 200), [0.0], t_eval=days, max_step=0.2, rtol=1e-8, atol=1e-15).y[0]
    found = wear_on(life, days)[:, 0]
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=2e-4 * life.pressed)
    assert np.all(np.diff(found) > 0)
    assert found[-1] > life.pressed or load < 6000


def test_wear_is_deepest_where_the_axis_jitters():
    moves = production([0.0, 0.45], 0.2, 2.0, 1000.0, 50.0)
    duty = moves + jitter([0.3], 0.02, 0.1, 2.0, 3e4, 50.0)
    life = calibrated(Life(AXIS, exposure(duty, AXIS, np.linspace(0, 0.45, 46)), PRELOAD), 80.0)
    wear = wear_on(life, [60.0])[0]
    assert life.exposure.x[np.argmax(wear)] == pytest.approx(0.3, abs=0.006)
    (worn,) = worn_machines(NEW, life, [60.0])
    assert float(worn.local_preload(0.3)) < 0.5 * float(worn.local_preload(0.1))
    nut_only = wear_on(replace(life, screw_share=0.0), [60.0])[0]
    np.testing.assert_allclose(nut_only, nut_only[0])


def test_the_preload_of_the_run_to_failure_ends_when_it_should():
    life = run_to_failure()
    days = np.arange(0.0, 96.0, 3.0)
    machines = worn_machines(NEW, life, days)
    x = life.exposure.x
    preload = np.array([machine.local_preload(x).min() for machine in machines])
    backlash = np.array([machine.local_backlash(x).max() for machine in machines])
    assert preload[0] == pytest.approx(PRELOAD)
    assert np.all(np.diff(preload)[preload[1:] > 0] < 0)
    np.testing.assert_array_equal(backlash > 0, days > 80)
    np.testing.assert_array_equal(preload == 0, days > 80)
    assert backlash[-1] > 0.4e-6


def test_calibration_takes_pace_and_chance_into_account():
    life = calibrated(even(50.0, Pace(0.8, 4.0, 0.5, 20.0, (25.0, 60.0), 0.4, 11)), 80.0)
    assert float(wear_on(life, 80.0).max()) == pytest.approx(life.pressed, rel=1e-9)
    assert float(wear_on(life, 79.9).max()) < life.pressed < float(wear_on(life, 80.1).max())


def test_calibration_without_a_nut_load():
    life = calibrated(even(), 80.0)
    assert float(wear_on(life, 80.0).max()) == pytest.approx(life.pressed, rel=1e-9)
    assert float(wear_on(life, 90.0).max()) == pytest.approx(life.pressed)  # nothing presses any more


@given(days=st.lists(st.floats(0, 300), min_size=1, max_size=5))
def test_wear_does_not_depend_on_the_order_of_the_days(days):
    life = run_to_failure()
    together = wear_on(life, days)
    assert together.shape == (len(days), 45)
    for day, row in zip(days, together, strict=True):
        np.testing.assert_array_equal(wear_on(life, day)[0], row)


def test_a_worn_machine_has_the_preload_and_backlash_of_its_wear():
    life = run_to_failure()
    (worn,) = worn_machines(NEW, life, [95.0])
    cells = [3, 20]
    at, wear = life.exposure.x[cells], wear_on(life, [95.0])[0][cells]
    np.testing.assert_allclose(worn.local_preload(at), preload_after_wear(wear, PRELOAD, KAPPA), atol=1e-6)
    np.testing.assert_allclose(worn.local_backlash(at), backlash_after_wear(wear, PRELOAD, KAPPA), atol=1e-12)
    assert worn.local_backlash(at)[1] > 0
    assert worn.local_preload(-1.0) == worn.local_preload(life.exposure.x[0])
    assert worn.preload == PRELOAD


@pytest.mark.parametrize(
    "change",
    [{"preload": 0.0}, {"rate": 0.0}, {"rate": float("nan")}, {"screw_share": 1.1}, {"screw_share": -0.1}],
)
def test_impossible_lives_are_refused(change):
    with pytest.raises(InputError):
        replace(even(), **change)


def test_impossible_days_are_refused():
    life = run_to_failure()
    with pytest.raises(InputError, match="day"):
        wear_on(life, [-1.0])
    with pytest.raises(InputError, match="days"):
        calibrated(life, 0.0)


def test_a_bearing_that_wears_softens_linearly_beside_the_nut():
    days = [0.0, 50.0, 100.0, 400.0]
    machines = worn_machines(NEW, replace(even(), bearing_travel=60_000.0), days)
    softer = [machine.bearing_preload_ratio ** (1 / 3) for machine in machines]
    assert softer == pytest.approx([1.0, 0.75, 0.5, 0.3])
    assert [machine.lost for machine in machines] == [
        machine.lost for machine in worn_machines(NEW, even(), days)
    ]
    assert {machine.bearing_preload_ratio for machine in worn_machines(NEW, even(), days)} == {1.0}


def test_a_bearing_without_travel_is_refused():
    with pytest.raises(InputError, match="bearing_travel"):
        replace(even(), bearing_travel=0.0)
