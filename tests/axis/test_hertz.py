from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad

from ballscrew.axis import hertz
from ballscrew.axis.compliance import nut_kappa, nut_rigidity
from ballscrew.axis.frequency import axial_natural_frequency
from ballscrew.base.errors import InputError

KAPPA = nut_kappa(450e6, 17e3, 0.1)  # of the M axis
PRELOAD = 680.0

loads = st.floats(-12, 12).map(lambda q: q * PRELOAD)


@pytest.mark.parametrize(
    ("q", "printed"),
    [
        (0.0, "1.000"), (0.5, "0.996"), (1.0, "0.985"), (1.5, "0.965"), (2.0, "0.931"), (2.5, "0.866"),
        (hertz.RELEASE, "0.707"), (4.0, "0.794"), (6.0, "0.909"), (8.0, "1.000"),
    ],
)  # fmt: skip
def test_the_table_of_tangent_ratios(q, printed):
    assert f"{float(hertz.tangent_ratio(q * PRELOAD, PRELOAD)):.3f}" == printed
    assert float(hertz.tangent_ratio(-q, 1.0)) == float(hertz.tangent_ratio(q, 1.0))


def test_release_is_where_the_makers_print_it():
    assert f"{float(hertz.release_load(1.0)):.2f}" == "2.83"
    at_release = hertz.nut_deflection(hertz.release_load(PRELOAD), PRELOAD, KAPPA)
    assert float(at_release) == pytest.approx(float(hertz.preload_deflection(PRELOAD, KAPPA)), rel=1e-12)


@pytest.mark.parametrize(
    ("q", "read_as"), [(1.0, "0.957"), (1.5, "0.899"), (2.0, "0.806"), (hertz.RELEASE, "0.354")]
)
def test_read_without_correction(q, read_as):
    assert f"{float(hertz.apparent_preload(q * PRELOAD, PRELOAD)) / PRELOAD:.3f}" == read_as


def test_beyond_release_nothing_is_left_of_the_preload():
    force = np.array([3000.0, 5440.0, 1e5])
    for preload in (1e-300, 1.0, 300.0, 1000.0):
        np.testing.assert_allclose(hertz.apparent_preload(force, preload), force / 8, rtol=1e-14)
        np.testing.assert_allclose(
            hertz.nut_rigidity_under_load(force, preload, KAPPA),
            1.5 * hertz.hertz_constant(KAPPA) ** (2 / 3) * np.cbrt(force),
            rtol=1e-12,
        )
    np.testing.assert_allclose(hertz.apparent_preload(force, 0.0), force / 8)


def test_at_rest_it_is_the_makers_law():
    preload = np.array([1.0, 68.0, 680.0, 3000.0])
    expected = nut_rigidity(preload, 450e6, 17e3, 0.1)
    np.testing.assert_allclose(hertz.nut_rigidity_under_load(0.0, preload, KAPPA), expected, rtol=1e-12)
    delta = 1e-6 * hertz.preload_deflection(preload, KAPPA)
    np.testing.assert_allclose(hertz.nut_force(delta, preload, KAPPA) / delta, expected, rtol=1e-9)
    np.testing.assert_allclose(hertz.preload_deflection(preload, KAPPA), 3 * preload / expected, rtol=1e-12)


def test_preload_deflections_of_the_three_axes(axes):
    got = []
    for sheet in axes.values():
        s = sheet.screw
        kappa = nut_kappa(s.rigidity, s.dynamic_load_rating, s.rigidity_preload_ratio)
        got.append(float(hertz.preload_deflection(sheet.nominal_preload, kappa)) * 1e6)
    np.testing.assert_allclose(got, [7.97, 7.69, 10.18], atol=0.005)


@given(force=loads)
def test_force_and_deflection_are_inverse(force):
    delta = hertz.nut_deflection(force, PRELOAD, KAPPA)
    assert float(hertz.nut_force(delta, PRELOAD, KAPPA)) == pytest.approx(force, rel=1e-9, abs=1e-300)


@given(xi=st.floats(-5, 5), preload=st.floats(0.1, 1e5))
def test_deflection_and_force_are_inverse(xi, preload):
    delta = xi * float(hertz.preload_deflection(preload, KAPPA))
    back = hertz.nut_deflection(hertz.nut_force(delta, preload, KAPPA), preload, KAPPA)
    assert float(back) == pytest.approx(delta, rel=1e-9, abs=1e-300)


@given(force=loads, preload=st.floats(1.0, 1e4))
def test_the_force_is_that_of_two_flanks(force, preload):
    """The definition itself, which the closed form never computes."""
    delta = float(hertz.nut_deflection(force, preload, KAPPA))
    pressed = float(hertz.preload_deflection(preload, KAPPA))
    flanks = max(pressed + delta, 0) ** 1.5 - max(pressed - delta, 0) ** 1.5
    assert float(hertz.hertz_constant(KAPPA)) * flanks == pytest.approx(force, rel=1e-9, abs=1e-9 * preload)


@given(force=loads, preload=st.floats(0, 1e4))
def test_it_is_odd_and_its_rigidity_even(force, preload):
    delta = hertz.nut_deflection(force, preload, KAPPA)
    assert float(hertz.nut_deflection(-force, preload, KAPPA)) == -float(delta)
    assert float(hertz.nut_force(-delta, preload, KAPPA)) == -float(hertz.nut_force(delta, preload, KAPPA))
    stiff = hertz.nut_rigidity_under_load(np.array([force, -force]), preload, KAPPA)
    assert stiff[0] == stiff[1]


@pytest.mark.parametrize("preload", [0.0, 10.0, 680.0])
def test_the_tangent_is_the_derivative_of_the_force(preload):
    force = np.array([-3000.0, -1000.0, -300.0, 20.0, 300.0, 1500.0, 1900.0, 2000.0, 5000.0])
    delta, h = hertz.nut_deflection(force, preload, KAPPA), 1e-11
    slope = (hertz.nut_force(delta + h, preload, KAPPA) - hertz.nut_force(delta - h, preload, KAPPA)) / (
        2 * h
    )
    np.testing.assert_allclose(hertz.nut_rigidity_under_load(force, preload, KAPPA), slope, rtol=2e-5)
    if preload:
        ratio = hertz.tangent_ratio(force, preload) * hertz.nut_rigidity_under_load(0.0, preload, KAPPA)
        np.testing.assert_allclose(hertz.nut_rigidity_under_load(force, preload, KAPPA), ratio, rtol=1e-12)


@pytest.mark.parametrize("xi", [0.3, 1.0, 2.5])
def test_the_work_done_is_the_energy_stored(xi):
    pressed = float(hertz.preload_deflection(PRELOAD, KAPPA))
    delta = xi * pressed
    work, _ = quad(
        lambda d: float(hertz.nut_force(d, PRELOAD, KAPPA)), 0, delta, points=[min(pressed, delta)]
    )
    stored = max(pressed + delta, 0) ** 2.5 + max(pressed - delta, 0) ** 2.5 - 2 * pressed**2.5
    assert work == pytest.approx(float(hertz.hertz_constant(KAPPA)) * 0.4 * stored, rel=1e-8)


def test_it_is_continuous_at_release():
    near = hertz.RELEASE * PRELOAD * (1 + np.array([-1e-12, 0.0, 1e-12]))
    assert np.ptp(hertz.nut_deflection(near, PRELOAD, KAPPA)) < 1e-16
    # From inside the rigidity falls like a square root: 1e-12 of load is 1e-6 of rigidity.
    np.testing.assert_allclose(hertz.tangent_ratio(near, PRELOAD), np.sqrt(0.5), rtol=2e-6)


def test_without_preload_one_flank_carries():
    delta = np.array([-2e-6, 0.0, 3e-6])
    force = np.sign(delta) * hertz.hertz_constant(KAPPA) * np.abs(delta) ** 1.5
    np.testing.assert_allclose(hertz.nut_force(delta, 0.0, KAPPA), force, rtol=1e-12)
    np.testing.assert_allclose(hertz.nut_deflection(force, 0.0, KAPPA), delta, rtol=1e-12)
    assert float(hertz.nut_rigidity_under_load(0.0, 0.0, KAPPA)) == 0.0


def test_the_frequency_under_a_nut_load(axes):
    """Two acceleration levels, F/P of 0.5 and 1.5, move the frequency by about half a per cent."""
    sheet = axes["M"]
    apparent = hertz.apparent_preload(np.array([0.5, 1.5]) * PRELOAD, PRELOAD)
    low, high = axial_natural_frequency(sheet, 0.0, 0.0, apparent, "held")
    assert high / low - 1 == pytest.approx(-0.0056, abs=5e-4)


def test_shapes_follow_numpy():
    force, preload = np.zeros((3, 1)), np.full(4, PRELOAD)
    assert hertz.nut_deflection(force, preload, KAPPA).shape == (3, 4)
    assert hertz.nut_force(force, preload, KAPPA).shape == (3, 4)
    assert hertz.nut_rigidity_under_load(force, preload, KAPPA).shape == (3, 4)
    assert hertz.tangent_ratio(force, preload).shape == (3, 4)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: hertz.nut_deflection(1.0, -1.0, KAPPA), "a preload of -1 was given"),
        (lambda: hertz.nut_deflection(np.nan, 1.0, KAPPA), "a nut load of nan was given"),
        (lambda: hertz.nut_force(np.inf, 1.0, KAPPA), "a deflection of inf was given"),
        (lambda: hertz.nut_force(0.0, np.nan, KAPPA), "a preload of nan was given"),
        (lambda: hertz.nut_force(0.0, 1.0, 0.0), "a kappa of 0 was given"),
        (lambda: hertz.tangent_ratio(1.0, 0.0), "a preload of 0 was given; it must be more than 0 N"),
        (lambda: hertz.apparent_preload(1.0, [1.0, -2.0]), "a preload of -2 was given"),
        (lambda: hertz.release_load(-1.0), "a preload of -1 was given; it must be 0 N or more"),
        (lambda: hertz.hertz_constant("stiff"), "a kappa of 'stiff' was given"),
    ],
)
def test_impossible_values(call, message):
    with pytest.raises(InputError, match=message):
        call()
