"""Slopes of Eq. (3) against differences of it; what θ's four parameters leave in the data."""

from __future__ import annotations

import math
from dataclasses import astuple, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ballscrew.axis.derivatives import derivatives, sensitivity, theta_jacobian, theta_rank
from ballscrew.axis.equations import Theta, frequency_from_preload
from ballscrew.axis.frequency import nut_share, rotor_mass, theta

M = Theta(a=-0.4071, b=-0.2164, c=7.641e5, d=2.35)
POINT = {"x_t": st.floats(0.01, 0.5), "preload": st.floats(20, 2e3), "m_t": st.floats(20, 300)}
ROTOR = st.one_of(st.just(math.inf), st.floats(20, 1000))


def difference(function, at, rel=1e-6):
    return (function(at * (1 + rel)) - function(at * (1 - rel))) / (2 * rel * at)


@given(rotor=ROTOR, **POINT)
def test_every_slope_is_that_of_a_difference(x_t, preload, m_t, rotor):
    def f(**changes):
        point = {"x_t": x_t, "preload": preload, "m_t": m_t, "theta": M} | changes
        return float(frequency_from_preload(**point, rotor_mass=rotor))

    got = derivatives(x_t, preload, m_t, M, rotor_mass=rotor)
    for name, value in (("x_t", x_t), ("preload", preload), ("m_t", m_t)):
        expected = difference(lambda v, name=name: f(**{name: v}), value)
        assert float(getattr(got, name)) == pytest.approx(expected, rel=1e-5)
    for name in "abcd":
        expected = difference(lambda v, name=name: f(theta=replace(M, **{name: v})), getattr(M, name))
        assert float(getattr(got, name)) == pytest.approx(expected, rel=1e-5, abs=1e-9)


@given(x=st.floats(0, 0.5), preload=st.floats(1, 5e3))
def test_the_sensitivity_is_a_sixth_of_the_nuts_share(x, preload):
    nut = preload ** (-1 / 3)
    share = nut / (nut - M.a * x - M.b)
    assert float(sensitivity(x, preload, M)) == pytest.approx(share / 6, rel=1e-12)
    assert 0 < float(sensitivity(x, preload, M)) < 1 / 6


def test_the_sensitivity_of_the_three_axes(axes):
    # physics.md: 0.03 to 0.08.
    for name, far in (("S", 0.45), ("M", 0.45), ("L", 0.7)):
        sheet = axes[name]
        got = sensitivity(np.array([0.0, far]), sheet.nominal_preload, theta(sheet))
        assert np.all((got > 0.03) & (got < 0.08))
        shares = nut_share(sheet, np.array([0.0, far]), torsion=False)
        np.testing.assert_allclose(got, shares / 6, rtol=1e-12)


def test_a_tenth_of_a_per_cent(axes):
    # 0.1 % of f is 1.2 to 3.5 % of P.
    percent = [0.1 / float(sensitivity(x, a.nominal_preload, theta(a)))
               for a, x in ((axes["S"], 0.0), (axes["M"], 0.45), (axes["L"], 0.7))]  # fmt: skip
    assert min(percent) > 1.2
    assert max(percent) < 3.5


@pytest.mark.parametrize("rotor", ["held", "free"])
def test_one_preload_tells_three_of_four_and_a_second_all(axes, rotor):
    for sheet in axes.values():
        x, mass = np.linspace(0, 0.45, 11)[:, None], sheet.table.mass + np.array([0.0, 20.0, 50.0])
        m_r = rotor_mass(sheet) if rotor == "free" else math.inf
        one = sheet.nominal_preload
        assert theta_rank(x, one, mass, theta(sheet), rotor_mass=m_r) == 3
        two = np.array([one, one / 2])[:, None, None]
        assert theta_rank(x, two, mass, theta(sheet), rotor_mass=m_r) == 4


def test_what_one_preload_cannot_tell_leaves_every_frequency_as_it_was():
    # a, c and P^(−1/3) − b by one factor.
    preload, factor = 680.0, 1.3
    nut = preload ** (-1 / 3)
    other = Theta(a=factor * M.a, b=nut - factor * (nut - M.b), c=factor * M.c, d=M.d)
    x, mass = np.linspace(0, 0.45, 7)[:, None], np.array([50.0, 100.0, 150.0])
    np.testing.assert_allclose(
        frequency_from_preload(x, preload, mass, M),
        frequency_from_preload(x, preload, mass, other),
        rtol=1e-13,
    )
    assert abs(float(frequency_from_preload(0, 340, 100, M) - frequency_from_preload(0, 340, 100, other))) > 1


def test_one_mass_or_one_position_tells_less():
    x, mass = np.linspace(0, 0.45, 11), np.array([100.0, 120.0])
    assert theta_rank(x, 680.0, 100.0, M) == 2
    assert theta_rank(0.1, 680.0, mass, M) == 2
    assert theta_rank(0.1, 680.0, 100.0, M) == 1


def test_the_jacobian_has_a_row_a_point():
    jacobian = theta_jacobian(np.zeros((3, 1)), 680.0, np.full(2, 100.0), M)
    assert jacobian.shape == (6, 4)
    np.testing.assert_array_equal(jacobian[:, 0], 0)  # a does nothing at x = 0
    np.testing.assert_allclose(jacobian[:, 2], 0.5)


def test_slopes_have_the_shape_of_the_points():
    got = derivatives(np.zeros((3, 1)), 680.0, np.full(2, 100.0), M)
    assert {np.shape(part) for part in (got.x_t, got.preload, got.m_t, got.a, got.b, got.c, got.d)} == {
        (3, 2)
    }
    assert len(astuple(M)) == 4
