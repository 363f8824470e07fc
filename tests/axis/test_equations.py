"""Eqs. (2) and (3): round trip, limits, monotony; on the M axis and on any other."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ballscrew.axis.equations import (
    Theta,
    frequency_from_preload,
    limit_frequency,
    oscillating_mass,
    preload_at_frequency,
    preload_change,
)
from ballscrew.axis.frequency import axial_natural_frequency
from ballscrew.axis.model import rotor_mass, theta
from ballscrew.base.errors import InputError

M = Theta(a=-0.4071, b=-0.2164, c=7.641e5, d=2.35)

X = st.floats(0, 0.5)
P = st.floats(0.5, 5e3)
MASS = st.floats(5, 500)
ROTOR = st.one_of(st.just(math.inf), st.floats(5, 2000))
THETA = st.builds(
    Theta, a=st.floats(-1, -0.05), b=st.floats(-0.5, -0.02), c=st.floats(2e5, 3e6), d=st.floats(0, 10)
)


@given(x=X, preload=P, mass=MASS, rotor=ROTOR, axis=THETA)
def test_preload_to_frequency_and_back(x, preload, mass, rotor, axis):
    f = frequency_from_preload(x, preload, mass, axis, rotor_mass=rotor)
    assert preload_at_frequency(x, f, mass, axis, rotor_mass=rotor) == pytest.approx(preload, rel=1e-9)


@given(x=X, preload=P, mass=MASS, rotor=ROTOR, axis=THETA)
def test_it_falls_with_load_and_position_and_rises_with_preload(x, preload, mass, rotor, axis):
    def f(x, preload, mass):
        return float(frequency_from_preload(x, preload, mass, axis, rotor_mass=rotor))

    here = f(x, preload, mass)
    assert f(x, preload, mass * 1.01) < here
    assert f(x + 0.01, preload, mass) < here
    assert f(x, preload * 1.01, mass) > here


@given(x=X, mass=MASS, rotor=ROTOR, axis=THETA)
def test_no_preload_brings_it_to_the_limit(x, mass, rotor, axis):
    limit = float(limit_frequency(x, mass, axis, rotor_mass=rotor))
    assert float(frequency_from_preload(x, 1e6, mass, axis, rotor_mass=rotor)) < limit
    assert float(frequency_from_preload(x, 1e60, mass, axis, rotor_mass=rotor)) == pytest.approx(limit)


def test_the_closed_form_of_one_point():
    # No shaft, no bearing: two masses on the nut's spring, κ P^(1/3) = 4π² c P^(1/3).
    axis = Theta(a=0.0, b=0.0, c=1e6, d=0.0)
    spring = 4 * math.pi**2 * 1e6 * 27 ** (1 / 3)
    reduced = 1 / (1 / 100 + 1 / 300)
    expected = math.sqrt(spring / reduced) / (2 * math.pi)
    assert float(frequency_from_preload(0, 27, 100, axis, rotor_mass=300)) == pytest.approx(expected)


def test_it_is_what_the_data_sheet_predicts(axes):
    for sheet in axes.values():
        x, load = np.linspace(0, 0.4, 5)[:, None], np.array([0.0, 50.0])
        moving, rotor = sheet.table.mass + load, rotor_mass(sheet)
        for torsion in (False, True):
            axis = theta(sheet, torsion=torsion)
            held = frequency_from_preload(x, sheet.nominal_preload, moving, axis)
            free = frequency_from_preload(x, sheet.nominal_preload, moving, axis, rotor_mass=rotor)
            for got, name in ((held, "held"), (free, "free")):
                by_sheet = axial_natural_frequency(sheet, x, load, rotor=name, torsion=torsion)
                np.testing.assert_allclose(got, by_sheet, rtol=1e-12)


def test_a_free_pole_read_as_a_held_one_explodes():
    # docs/explanation/departures.md: 181.3 Hz into Eq. (3) is 835 kN, close to the limit of 185.7 Hz.
    f = frequency_from_preload(0, 680, 101.5, Theta(M.a, M.b, M.c, 0.85), rotor_mass=rotor_of_m())
    assert float(f) == pytest.approx(181.3, abs=0.2)
    assert float(preload_at_frequency(0, f, 101.5, Theta(M.a, M.b, M.c, 0.85))) > 5e5


def rotor_of_m():
    own = math.pi * 0.025**4 * 0.9 * 7850 / 32
    return (3e-4 + own) / (0.01 / (2 * math.pi)) ** 2


def test_a_frequency_that_no_preload_explains():
    limit = float(limit_frequency(0.0, 100.0, M))
    with pytest.raises(
        InputError, match=rf"a frequency of 200 Hz was given; it must lie below {limit:.6g} Hz"
    ):
        preload_at_frequency(0.0, [150.0, 200.0], 100.0, M)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((0.0, 0.0, 100.0), "a preload of 0 was given; it must be more than 0 N"),
        ((0.0, -1.0, 100.0), "a preload of -1 was given"),
        ((np.nan, 600.0, 100.0), "a position of nan was given; it must be a finite number of m"),
        ((0.0, 600.0, 0.0), "a moving mass of 0 was given; it must be more than 0 kg"),
        ((0.0, "much", 100.0), "a preload of 'much' was given; it must be a number"),
    ],
)
def test_impossible_arguments(arguments, message):
    with pytest.raises(InputError, match=message):
        frequency_from_preload(*arguments, M)


@given(mass=MASS, rotor=st.floats(1, 1e4))
def test_a_free_rotor_makes_the_mass_smaller(mass, rotor):
    assert float(oscillating_mass(mass, M, rotor)) < float(oscillating_mass(mass, M))
    assert float(oscillating_mass(mass, M, 1e12)) == pytest.approx(mass + M.d, rel=1e-6)


def test_shapes_follow_numpy():
    assert frequency_from_preload(np.zeros((3, 1)), 600.0, np.full(4, 100.0), M).shape == (3, 4)


@pytest.mark.parametrize("rotor", [0.0, -50.0, math.nan])
def test_an_impossible_rotor(rotor):
    with pytest.raises(InputError, match=r"a rotor mass of .* kg was given; it must be more than 0 kg"):
        frequency_from_preload(0.0, 600.0, 100.0, M, rotor_mass=rotor)


@pytest.mark.parametrize(
    "changes", [{"a": 0.1}, {"b": 0.1}, {"c": 0.0}, {"c": math.nan}, {"d": -1.0}, {"a": -math.inf}]
)
def test_an_impossible_theta(changes):
    with pytest.raises(InputError, match=r"of θ is .*; it must be"):
        replace(M, **changes)


def test_a_position_off_the_screw():
    with pytest.raises(InputError, match="at a position of -3 m"):
        frequency_from_preload(-3.0, 600.0, 100.0, M)


def test_shapes_that_do_not_go_together():
    with pytest.raises(InputError, match=r"position \(3,\), preload \(2,\)"):
        frequency_from_preload(np.zeros(3), np.full(2, 600.0), 100.0, M)


def nut_share(sheet, x, preload):
    t = theta(sheet)
    nut = preload ** (-1 / 3)
    return nut / (nut - t.a * x - t.b)


@pytest.mark.parametrize("rotor", ["held", "free"])
@given(x=st.floats(0, 0.45), load=st.floats(0, 200), ratio=st.floats(0.01, 2))
def test_it_is_equation_3_exactly(axes, rotor, x, load, ratio):
    sheet = axes["M"]
    start = sheet.nominal_preload
    f0, f = axial_natural_frequency(sheet, x, load, np.array([1.0, ratio]) * start, rotor)
    share = nut_share(sheet, x, start)
    assert float(preload_change(f, f0, share)) == pytest.approx(ratio, rel=1e-12)


def test_the_m_axis_from_new_to_a_quarter(axes):
    share = nut_share(axes["M"], 0.0, 680.0)
    assert share == pytest.approx(0.344, abs=5e-4)
    assert float(preload_change(137.14, 150.37, share)) == pytest.approx(0.25, abs=2e-4)


def test_an_error_of_the_share_scales_the_loss_and_keeps_its_sign():
    for f in (145.0, 155.0):
        change = preload_change(f, 150.0, np.array([0.25, 0.34, 0.45])) - 1
        assert np.all(np.sign(change) == np.sign(f - 150.0))
        assert np.all(np.diff(np.abs(change)) < 0)


def test_above_an_infinitely_stiff_nut_there_is_no_preload():
    limit = 150.0 / np.sqrt(1 - 0.34)
    assert float(preload_change(0.99 * limit, 150.0, 0.34)) > 1
    for f in (limit * (1 + 1e-9), 2 * limit):
        with pytest.raises(
            InputError, match=r"it must be below 184\.6372\d+ Hz, which this axis has with an inf"
        ):
            preload_change([150.0, f], 150.0, 0.34)


def test_a_nut_that_is_all_there_is_has_no_limit():
    assert float(preload_change(300.0, 150.0, 1.0)) == pytest.approx(2.0**6)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: preload_change(0.0, 150.0, 0.3), "a frequency of 0 was given"),
        (lambda: preload_change(150.0, np.nan, 0.3), "a reference frequency of nan was given"),
        (lambda: preload_change(150.0, 150.0, 0.0), "a nut's share of the compliance of 0 was given"),
        (lambda: preload_change(150.0, 150.0, 1.1), "of 1.1 was given; it must be more than 0, 1 at most"),
    ],
)
def test_impossible_values_of_a_change(call, message):
    with pytest.raises(InputError, match=message):
        call()
