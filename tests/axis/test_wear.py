from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.optimize import curve_fit

from ballscrew.axis import wear
from ballscrew.axis.compliance import nut_kappa
from ballscrew.axis.hertz import nut_rigidity_under_load, preload_deflection
from ballscrew.base.errors import InputError

KAPPA = nut_kappa(450e6, 17e3, 0.1)
PRELOAD = 680.0
HALF = 300.0
PRESSED = float(preload_deflection(PRELOAD, KAPPA))

# What the rate of wear is in proportion to, as a power of P; and the power of P that is linear in travel.
LAWS = {"contact-pressure": 1 / 3, "preload": 1.0, "exponential": 2 / 3, "external-load": 0.0}
LINEAR = {"contact-pressure": np.cbrt, "preload": lambda p: 1 / np.cbrt(p), "exponential": np.log}
LINEAR |= {"external-load": lambda p: np.cbrt(p) ** 2}


def test_every_law_is_tested():
    assert set(LAWS) == set(wear.WEAR_LAWS)
    with pytest.raises(TypeError):
        wear.WEAR_LAWS["mine"] = wear.preload_law


def test_wear_takes_the_preload_and_then_makes_backlash():
    worn = np.array([0.0, 0.5, 1.0, 1.5]) * PRESSED
    np.testing.assert_allclose(
        wear.preload_after_wear(worn, PRELOAD, KAPPA), PRELOAD * np.array([1, 0.5**1.5, 0, 0]), atol=1e-9
    )
    np.testing.assert_allclose(
        wear.backlash_after_wear(worn, PRELOAD, KAPPA), np.array([0, 0, 0, 1.0]) * PRESSED, atol=1e-18
    )
    assert float(wear.backlash_after_wear(1e-6, 0.0, KAPPA)) == 2e-6


@given(part=st.floats(0, 0.999))
def test_what_is_left_is_the_hertz_nut_of_that_preload(part):
    left = wear.preload_after_wear(part * PRESSED, PRELOAD, KAPPA)
    assert float(preload_deflection(left, KAPPA)) == pytest.approx((1 - part) * PRESSED, rel=1e-9)
    new, old = nut_rigidity_under_load(0.0, np.array([PRELOAD, float(left)]), KAPPA)
    assert np.sqrt(1 - part) == pytest.approx(old / new, rel=1e-9)


@pytest.mark.parametrize("law", LAWS)
def test_half_of_the_preload_at_half_travel(law):
    got = wear.WEAR_LAWS[law](np.array([0.0, HALF]), PRELOAD, HALF)
    np.testing.assert_allclose(got, [PRELOAD, PRELOAD / 2], rtol=1e-12)


@pytest.mark.parametrize("law", LAWS)
def test_each_law_follows_from_its_rate_of_wear(law):
    """dw/dN = k Pⁿ is integrated; k is scaled so that half of the preload is gone at the half travel."""
    power = LAWS[law]

    def rate(_, w, k):
        left = np.maximum(1 - w, 0.0)  # w in parts of δ₀, P in parts of P₀
        return k * left ** (1.5 * power)

    half_worn = 1 - 0.5 ** (2 / 3)
    once = solve_ivp(rate, (0, 5), [0.0], args=(1.0,), rtol=1e-10, atol=1e-12, dense_output=True,
                     events=lambda _, w, __: w[0] - half_worn)  # fmt: skip
    k = once.t_events[0][0] / HALF
    travel = np.linspace(0, 1.3 * HALF, 40)
    run = solve_ivp(rate, (0, travel[-1]), [0.0], args=(k,), t_eval=travel, rtol=1e-10, atol=1e-12)
    integrated = wear.preload_after_wear(run.y[0] * PRESSED, PRELOAD, KAPPA)
    np.testing.assert_allclose(wear.WEAR_LAWS[law](travel, PRELOAD, HALF), integrated, rtol=1e-6)


@pytest.mark.parametrize("law", LAWS)
def test_what_is_linear_in_travel(law):
    travel = np.linspace(0, 1.5 * HALF, 7)
    line = LINEAR[law](wear.WEAR_LAWS[law](travel, PRELOAD, HALF))
    np.testing.assert_allclose(np.diff(line, 2), 0, atol=1e-9 * abs(line).max())
    assert np.ptp(line) > 0.1 * abs(line[0]) or law == "exponential"


@pytest.mark.parametrize("law", LAWS)
def test_every_law_slows_down(law):
    end = min(float(wear.end_of_preload(law, HALF)), 10 * HALF)
    falls = np.diff(wear.WEAR_LAWS[law](np.linspace(0, end, 200), PRELOAD, HALF))
    assert np.all(falls < 0)
    assert np.all(np.diff(falls) > 0)


def test_where_the_laws_end():
    ends = {law: float(wear.end_of_preload(law, HALF)) / HALF for law in LAWS}
    assert ends["contact-pressure"] == pytest.approx(4.847, abs=5e-4)
    assert ends["external-load"] == pytest.approx(2.702, abs=5e-4)
    assert ends["preload"] == ends["exponential"] == np.inf
    for law in ("contact-pressure", "external-load"):
        function = wear.WEAR_LAWS[law]
        end = ends[law] * HALF
        assert float(function(0.999 * end, PRELOAD, HALF)) > 0
        np.testing.assert_allclose(function(np.array([1.0, 1.5]) * end, PRELOAD, HALF), 0, atol=1e-12)
    np.testing.assert_array_equal(wear.end_of_preload("preload", [1.0, 2.0]), np.inf)


@pytest.mark.parametrize("law", LAWS)
def test_shapes_follow_numpy(law):
    got = wear.WEAR_LAWS[law](np.zeros((5, 1)), np.array([500.0, 700.0]), HALF)
    assert got.shape == (5, 2)
    np.testing.assert_array_equal(got[0], [500.0, 700.0])


def test_a_single_real_series_does_not_distinguish_the_laws(data):
    """Friction torque over 1015 h: all laws fit it within what a reading scatters, 3 %."""
    series = data / "xjtu" / "friction_torque_upper.csv"
    if not series.is_file():
        pytest.skip(f"no {series}")
    hours, torque = np.loadtxt(series, delimiter=",", skiprows=1).T
    assert 1 - torque[-1] / torque[0] == pytest.approx(0.38, abs=0.005)
    assert np.sum(np.diff(torque) > 0) == 9
    left = []
    for function in wear.WEAR_LAWS.values():
        fit, _ = curve_fit(
            lambda t, new, half, law=function: law(t, new, half), hours, torque, p0=(0.4, 1500)
        )
        left.append(np.std(torque - function(hours, *fit)) / torque.mean())
    np.testing.assert_allclose(left, 0.031, atol=0.001)
    assert max(left) / min(left) < 1.03


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: wear.preload_after_wear(-1e-6, PRELOAD, KAPPA), "a wear of -1e-06 was given"),
        (
            lambda: wear.preload_after_wear(0.0, 0.0, KAPPA),
            "a preload of 0 was given; it must be more than 0 N",
        ),
        (lambda: wear.preload_after_wear(np.nan, PRELOAD, KAPPA), "a wear of nan was given"),
        (lambda: wear.backlash_after_wear(0.0, -1.0, KAPPA), "a preload of -1 was given"),
        (lambda: wear.preload_law(-1.0, PRELOAD, HALF), "a travel of -1 was given"),
        (lambda: wear.exponential_law(1.0, np.inf, HALF), "a preload of inf was given"),
        (
            lambda: wear.contact_pressure_law(1.0, PRELOAD, 0.0),
            "a travel to half of the preload of 0 was given",
        ),
        (lambda: wear.external_load_law([1.0, np.nan], PRELOAD, HALF), "a travel of nan was given"),
        (lambda: wear.end_of_preload("preload", -1.0), "a travel to half of the preload of -1 was given"),
        (
            lambda: wear.end_of_preload("archard", HALF),
            "the wear law is 'archard'; it must be one of contact-p",
        ),
    ],
)
def test_impossible_values(call, message):
    with pytest.raises(InputError, match=message):
        call()
