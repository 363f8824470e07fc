from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from ballscrew.axis.model import kappa
from ballscrew.axis.wear import WEAR_LAWS, backlash_after_wear, end_of_preload, preload_after_wear
from ballscrew.base.errors import InputError
from ballscrew.testbed.duty import Duty, jitter, production
from ballscrew.testbed.example import AXIS
from ballscrew.testbed.experiments import run_to_failure_life
from ballscrew.testbed.exposure import exposure, uniform_exposure
from ballscrew.testbed.machine import Machine
from ballscrew.testbed.pace import Pace
from ballscrew.testbed.wear_life import (
    EXPONENTS,
    Life,
    UnitSpread,
    another_unit,
    calibrated,
    day_of_backlash,
    wear_on,
    wear_states,
)
from ballscrew.testbed.wear_state import worn_machine

EDGES = np.linspace(0, 0.45, 10)
EVEN = Pace(running_in=0.0, dry=0.0)
PRELOAD = AXIS.nominal_preload
KAPPA = kappa(AXIS)


def even(law: str, load: float = 0.0, rate: float = 4e-10) -> Life:
    seen = uniform_exposure(EDGES, 300.0, load)
    return Life(AXIS, seen, PRELOAD, rate=rate, law=law, pace=EVEN, load_weight=0.0)


def half_travel(law: str, life: Life) -> float:
    """From dw/dN at N = 0, which is the rate: P' / P₀ = −1.5 rate/δ₀."""
    slope = {
        "contact-pressure": 3 * (1 - 2 ** (-1 / 3)),
        "preload": 3 * (2 ** (1 / 3) - 1),
        "exponential": np.log(2),
        "external-load": 1.5 * (1 - 2 ** (-2 / 3)),
    }[law]
    return slope / (1.5 * life.rate / life.pressed)


def test_every_law_is_known():
    assert set(EXPONENTS) == set(WEAR_LAWS)


@pytest.mark.parametrize("law", WEAR_LAWS)
def test_even_wear_is_the_closed_law(law):
    life = even(law)
    days = np.linspace(0, 200, 101)
    got = preload_after_wear(wear_on(life, days), PRELOAD, KAPPA)
    wanted = WEAR_LAWS[law](days * 300.0, PRELOAD, half_travel(law, life))
    assert wanted[-1] < 0.2 * PRELOAD
    np.testing.assert_allclose(got, np.repeat(wanted[:, None], 9, axis=1), rtol=1e-6, atol=1e-6 * PRELOAD)


@pytest.mark.parametrize("law", ["contact-pressure", "external-load"])
def test_a_law_that_ends_ends_when_it_should(law):
    life = even(law)
    wanted = float(end_of_preload(law, half_travel(law, life))) / 300.0
    assert day_of_backlash(life) == pytest.approx(wanted, rel=1e-6)


@pytest.mark.parametrize("law", WEAR_LAWS)
@pytest.mark.parametrize("load", [5.0, 150.0, 6000.0])
def test_with_a_nut_load_it_is_the_rates_integral(law, load):
    life = even(law, load)
    n = EXPONENTS[law]

    def slope(_: float, w: np.ndarray) -> np.ndarray:
        preload = PRELOAD * np.maximum(1 - w / life.pressed, 0) ** 1.5
        floor = 0.5 * load**n if n else 0.0
        return life.rate * 300.0 * np.maximum(preload**n, floor) / PRELOAD**n

    days = np.linspace(0, 200, 41)
    wanted = solve_ivp(slope, (0, 200), [0.0], t_eval=days, max_step=0.2, rtol=1e-8, atol=1e-15).y[0]
    got = wear_on(life, days)[:, 0]
    np.testing.assert_allclose(got, wanted, atol=2e-4 * life.pressed)
    assert np.all(np.diff(got) > 0)
    assert got[-1] > life.pressed or load < 6000


def test_local_wear_is_the_most_where_it_jitters():
    duty = Duty(
        production([0.0, 0.45], 0.2, 2.0, 1000.0, {50.0: 1.0}) + jitter([0.3], 0.02, 0.1, 2.0, 3e4, 50.0)
    )
    seen = exposure(duty, AXIS, np.linspace(0, 0.45, 46))
    life = calibrated(Life(AXIS, seen, PRELOAD, screw_share=0.5), 80.0)
    state = wear_states(life, [60.0])[0]
    assert state.x[np.argmax(state.wear)] == pytest.approx(0.3, abs=0.006)
    assert float(state.preload(0.3)) < 0.5 * float(state.preload(0.1))
    nut_only = wear_on(replace(life, screw_share=0.0), [60.0])[0]
    np.testing.assert_allclose(nut_only, nut_only[0])


@pytest.mark.parametrize("law", WEAR_LAWS)
def test_the_papers_life(law):
    life = run_to_failure_life(AXIS, 80.0, law=law)
    assert day_of_backlash(life) == pytest.approx(80.0, rel=1e-6)
    assert 80.5 < day_of_backlash(life, 0.4e-6) < 90.0
    new, *_, old = states = wear_states(life, np.arange(0.0, 96.0, 3.0))
    assert new.least_preload == pytest.approx(PRELOAD)
    least = [state.least_preload for state in states]
    assert all(a > b or b == 0 for a, b in pairwise(least))
    assert [s.stage for s in states].count("II") == sum(s.day > 80 for s in states)
    assert old.most_backlash > 0.4e-6
    assert old.travel_m == pytest.approx(93 * life.exposure.travel_per_day)
    assert all((s.most_backlash == 0) == (s.least_preload > 0) for s in states)


def test_calibration_takes_pace_and_chance_into_account():
    pace = Pace(0.8, 4.0, 0.5, 20.0, (25.0, 60.0), 0.4, 11)
    life = calibrated(replace(even("contact-pressure", 50.0), pace=pace), 80.0)
    assert day_of_backlash(life) == pytest.approx(80.0, rel=1e-6)
    assert float(wear_on(life, 80.0).max()) == pytest.approx(life.pressed, rel=1e-9)


def test_a_law_that_never_ends_cannot_be_calibrated():
    for law in ("preload", "exponential"):
        with pytest.raises(InputError, match="never ends"):
            calibrated(even(law), 80.0)
        assert day_of_backlash(even(law)) == np.inf
    assert day_of_backlash(even("contact-pressure"), 1e-7) == np.inf  # nothing presses any more


@given(days=st.lists(st.floats(0, 300), min_size=1, max_size=5))
def test_days_can_be_asked_for_in_any_order(days):
    life = run_to_failure_life(AXIS)
    together = wear_on(life, days)
    assert together.shape == (len(days), 45)
    for day, row in zip(days, together, strict=True):
        np.testing.assert_array_equal(wear_on(life, day)[0], row)


def test_a_state_is_read_at_any_position():
    life = run_to_failure_life(AXIS)
    state = wear_states(life, 95.0)[0]
    at = state.x[[3, 20]]
    np.testing.assert_allclose(state.preload(at), preload_after_wear(state.wear[[3, 20]], PRELOAD, KAPPA))
    np.testing.assert_allclose(state.backlash(at), backlash_after_wear(state.wear[[3, 20]], PRELOAD, KAPPA))
    assert state.preload(-1.0) == state.preload(state.x[0])
    machine = worn_machine(Machine(AXIS, PRELOAD), state)
    np.testing.assert_allclose(machine.local_preload(at), state.preload(at), atol=1e-6)
    np.testing.assert_allclose(machine.local_backlash(at), state.backlash(at), atol=1e-12)
    assert state.backlash(at)[1] > 0


def test_units_differ_and_a_seed_is_one_unit():
    life = run_to_failure_life(AXIS)
    assert day_of_backlash(another_unit(life, 3)) == day_of_backlash(another_unit(life, 3))
    ends = np.array([day_of_backlash(another_unit(life, seed)) for seed in range(60)])
    assert len(set(ends)) == 60
    assert np.median(ends) == pytest.approx(80, rel=0.12)
    assert 0.15 < np.std(np.log(ends)) < 0.4
    same = another_unit(life, 1, UnitSpread(0.0, 0.0, 0.0, 0.0))
    assert day_of_backlash(same) == pytest.approx(80.0, rel=1e-6)


@pytest.mark.parametrize(
    "change",
    [
        {"preload": 0.0},
        {"rate": 0.0},
        {"rate": float("nan")},
        {"law": "mine"},
        {"law": ["preload"]},
        {"screw_share": 1.1},
        {"screw_share": -0.1},
        {"load_weight": -1.0},
    ],
)
def test_lives_that_cannot_be(change):
    with pytest.raises(InputError):
        replace(even("preload"), **change)


def test_questions_that_cannot_be_answered():
    life = run_to_failure_life(AXIS)
    with pytest.raises(InputError, match="day"):
        wear_on(life, [-1.0])
    with pytest.raises(InputError, match="days"):
        calibrated(life, 0.0)
    with pytest.raises(InputError, match="backlash"):
        day_of_backlash(life, -1e-6)
    with pytest.raises(InputError, match="2 differences of temperature were given for 3 days"):
        wear_states(life, [1.0, 2.0, 3.0], [1.0, 2.0])
