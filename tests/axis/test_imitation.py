"""M axis, x = 0, 4 % of Ca: the rows of what imitates a loss of preload that need no measured signal."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ballscrew.axis import imitation
from ballscrew.axis.frequency import axial_natural_frequency
from ballscrew.axis.model import theta
from ballscrew.base.errors import InputError


@pytest.fixture
def m(axes):
    return axes["M"]


@pytest.mark.parametrize(("rotor", "percent"), [("held", -8.05), ("free", -5.61)])
def test_a_kilogram_that_nobody_knows_of(m, rotor, percent):
    assert 100 * float(imitation.wrong_load(m, 1.0, rotor=rotor)) == pytest.approx(percent, abs=0.005)


def test_a_millimetre_off(m):
    assert 100 * float(imitation.wrong_position(m, 1e-3)) == pytest.approx(-1.1, abs=0.05)


def test_a_softer_bearing(m):
    """k_b less a tenth; the same 36.5 % whatever mass and position, so that neither can tell it."""
    assert 100 * float(imitation.bearing_change(m, -0.1)) == pytest.approx(-36.55, abs=0.005)
    for rotor in ("held", "free"):
        apparent = imitation.bearing_change(
            m, -0.1, position=[0.0, 0.2, 0.45], load=[0.0, 50.0, 100.0], rotor=rotor
        )
        np.testing.assert_allclose(100 * apparent, -36.55, atol=0.005)


def test_both_bearings_of_a_fixed_fixed_screw_change(m):
    alike = replace(m, support="fixed-fixed")
    stated = replace(alike, bearing=replace(alike.bearing, far_stiffness=alike.bearing.stiffness))
    assert imitation.bearing_change(stated, -0.1) == pytest.approx(imitation.bearing_change(alike, -0.1))


def test_a_bearing_of_a_tenth_more_compliance(m):
    """1/k_b a tenth more is k_b a eleventh less: another figure, and not the same thing."""
    assert 100 * float(imitation.bearing_change(m, 1 / 1.1 - 1)) == pytest.approx(-33.8, abs=0.05)


def test_a_warm_screw(m):
    assert 100 * float(imitation.warm_screw(m, 5.0, 12.5e-3)) == pytest.approx(14, abs=0.5)
    assert float(imitation.warm_screw(m, 0.0, 12.5e-3)) == 0.0
    assert float(imitation.warm_screw(m, -5.0, 12.5e-3)) < -0.1
    assert float(imitation.warm_screw(m, -100.0, 12.5e-3)) == -1.0, "nothing is left"


def test_a_film_of_oil(m):
    assert 100 * float(imitation.oil_film(m, 0.3e-6)) == pytest.approx(17, abs=0.5)
    assert float(imitation.oil_film(m, 0.0)) == 0.0


def test_warmth_and_oil_tell_more_where_less_is_left(m):
    for apparent in (
        imitation.warm_screw(m, 5.0, 12.5e-3, preload=[680.0, 170.0]),
        imitation.oil_film(m, 0.3e-6, preload=[680.0, 170.0]),
    ):
        assert apparent[1] > 2 * apparent[0]


def test_a_rate_that_is_declared_wrong(m):
    """6.7 % of the frequency are nearly four times the preload."""
    assert float(imitation.wrong_sample_rate(m, 12e3, 12.8e3)) == pytest.approx(2.67, abs=0.005)
    assert float(imitation.wrong_sample_rate(m, 12.8e3, 12.8e3)) == 0.0
    assert float(imitation.wrong_sample_rate(m, 12.8e3, 12.0e3)) < -0.5


def test_beyond_a_stiff_nut_it_refuses(m):
    with pytest.raises(InputError, match="which this axis has with an infinitely stiff nut"):
        imitation.wrong_sample_rate(m, 10e3, 12.8e3)


@pytest.mark.parametrize("rotor", ["held", "free"])
def test_what_is_read_is_the_preload_that_equation_3_gives_that_frequency(m, rotor):
    """Back through the forward form: the axis with the preload that seems left rings as the faulty one."""
    apparent = (1 + imitation.wrong_load(m, 3.0, position=0.2, load=50.0, rotor=rotor)) * m.nominal_preload
    faulty = axial_natural_frequency(m, 0.2, 53.0, None, rotor)
    assert float(axial_natural_frequency(m, 0.2, 50.0, apparent, rotor)) == pytest.approx(
        float(faulty), rel=1e-12
    )


def test_held_is_the_printed_inverse(m):
    """P = (c / (f² (m_t + d)) + a x + b)⁻³, Eq. (2), by hand."""
    t = theta(m)
    f = axial_natural_frequency(m, 0.1, 21.0, None, "held")
    by_hand = (t.c / (f**2 * (m.table.mass + 20.0 + t.d)) + t.a * 0.1 + t.b) ** -3.0
    apparent = imitation.wrong_load(m, 1.0, position=0.1, load=20.0)
    assert float(1 + apparent) == pytest.approx(float(by_hand) / m.nominal_preload, rel=1e-10)


def test_nothing_wrong_reads_as_nothing(m):
    for fixed in (m, replace(m, support="fixed-fixed")):
        for apparent in (
            imitation.wrong_load(fixed, 0.0),
            imitation.wrong_position(fixed, 0.0),
            imitation.bearing_change(fixed, 0.0),
            imitation.wrong_sample_rate(fixed, 5e3, 5e3),
        ):
            assert float(apparent) == pytest.approx(0.0, abs=1e-12)


def test_a_wrong_position_matters_little_in_the_middle_of_a_screw_fixed_at_both_ends(m):
    fixed = replace(m, support="fixed-fixed")
    assert abs(float(imitation.wrong_position(fixed, 1e-3, position=0.33))) < 1e-4
    assert abs(float(imitation.wrong_position(fixed, 1e-3, position=-0.1))) > 1e-3


def test_shapes_follow_numpy(m):
    assert imitation.wrong_load(m, np.ones((3, 1)), position=np.zeros(4)).shape == (3, 4)
    assert imitation.warm_screw(m, [1.0, 2.0], 0.01).shape == (2,)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda m: imitation.wrong_load(m, np.nan), "a hidden load of nan was given"),
        (lambda m: imitation.wrong_load(m, -1.0), "a load of -1 was given; it must be a mass"),
        (lambda m: imitation.wrong_load(m, 1.0, load="heavy"), "a load of 'heavy' was given"),
        (lambda m: imitation.wrong_load(m, 1.0, preload=0.0), "a preload of 0 was given"),
        (lambda m: imitation.wrong_position(m, 1.0), "a position of 1 was given"),
        (lambda m: imitation.bearing_change(m, -1.0), "it must be one number above -1"),
        (lambda m: imitation.bearing_change(m, [0.1, 0.2]), "it must be one number above -1"),
        (lambda m: imitation.warm_screw(m, 5.0, 0.0), "a contact radius of 0 was given"),
        (lambda m: imitation.warm_screw(m, np.inf, 0.01), "a difference of temperature of inf was given"),
        (lambda m: imitation.oil_film(m, -1e-6), "a thickness of the oil film of -1e-06 was given"),
        (lambda m: imitation.wrong_sample_rate(m, 0.0, 1.0), "a true rate of 0 was given"),
    ],
)
def test_impossible_values(m, call, message):
    with pytest.raises(InputError, match=message):
        call(m)
