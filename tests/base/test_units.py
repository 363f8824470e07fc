from __future__ import annotations

import contextlib
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ballscrew.base import units
from ballscrew.base.errors import InputError
from ballscrew.base.units import COMMON, conversion, conversion_by_pint, parse


@pytest.mark.parametrize(
    ("text", "to", "value"),
    [
        ("10 mm", "m", 0.01),
        ("10mm", "m", 0.01),
        (" -2.5e1  mm ", "m", -0.025),
        ("45", "m", 45.0),
        (".5 m", "m", 0.5),
        ("5 nm", "m", 5e-9),
        ("18.6 nm/N", "m/N", 18.6e-9),
        ("6000 rpm", "Hz", 100.0),
        ("6000 1/min", "Hz", 100.0),
        ("628.3185307179587 rad/s", "Hz", 100.0),
        ("36000 deg/s", "Hz", 100.0),
        ("7 µm", "m", 7e-6),  # micro sign
        ("7 μm", "m", 7e-6),  # Greek mu
        ("480 N/um", "N/m", 480e6),
        ("480 N/µm", "N/m", 480e6),
        ("480 N / um", "N/m", 480e6),
        ("5 Nm", "N m", 5.0),
        ("5 N m", "N m", 5.0),
        ("5 N·m", "N m", 5.0),
        ("5 Ncm", "N m", 0.05),
        ("5 kNm/rad", "N m/rad", 5000.0),
        ("50 mNm/A", "N m/A", 0.05),
        ("0.5 N m/A", "N m/A", 0.5),
        ("4.2e-4 kg m^2", "kg m^2", 4.2e-4),
        ("4 kg cm²", "kg m^2", 4e-4),
        ("4 kg*m**2", "kg m^2", 4.0),
        ("1500 m/s^3", "m/s^3", 1500.0),
        ("1500 m/s³", "m/s^3", 1500.0),
        ("2 m s^-2", "m/s^2", 2.0),
        ("12.8 kHz", "Hz", 12800.0),
        ("350 ms", "s", 0.35),
        ("206 GPa", "Pa", 206e9),
        ("20 %", "", 0.2),
        ("0.2", "", 0.2),
        ("3 mN", "N", 0.003),
        ("1 mV", "V", 0.001),
        ("1 g_n", "m/s^2", 9.80665),
        ("2 g0", "m/s^2", 2 * 9.80665),
        ("3000 rpm", "rad/s", 100 * math.pi),
        ("3000 r/min", "rad/s", 100 * math.pi),
        ("20 °C", "degC", 20.0),
        ("20 degC", "degC", 20.0),
        ("293.15 K", "degC", 20.0),
        (0.01, "m", 0.01),
        (3, "m", 3.0),
    ],
)
def test_what_people_write(text, to, value):
    assert parse(text, to) == pytest.approx(value, rel=1e-12)


def test_rpm_is_read_as_an_angle_per_time():
    assert parse("60 rpm", "rad/s") == pytest.approx(2 * math.pi)


@pytest.mark.parametrize(
    ("text", "to"),
    [
        ("10 kg", "m"),
        ("10 mm", ""),
        ("5 N", "N m"),
        ("5 m m", "m"),
        ("1 g", "m/s^2"),
        ("1 kHz", "s"),
        ("1 N/m", "N m"),
    ],
)
def test_a_unit_of_the_wrong_kind(text, to):
    with pytest.raises(InputError, match="is not one that can be turned into"):
        parse(text, to)


@pytest.mark.parametrize("text", ["10 foo", "10 m2", "10 mm*(", "10 mm garbage", "1,5 mm", "10 ;import os"])
def test_a_unit_that_nobody_knows(text):
    with pytest.raises(InputError, match=r"^the unit .* is not known"):
        parse(text, "m")


@pytest.mark.parametrize(
    "text", ["", "mm", "ten mm", "TODO", "nan", "nan mm", "inf m", "-inf", "--5 m", "e5 m"]
)
def test_a_text_that_is_no_number(text):
    with pytest.raises(InputError, match="is not a number with a unit"):
        parse(text, "m")


@pytest.mark.parametrize("value", [True, False, None, [], {}, [1.0], b"1 m", 1j])
def test_another_type(value):
    with pytest.raises(InputError, match="is not a number with a unit"):
        parse(value, "m")


@pytest.mark.parametrize("value", [1e300, "-1e31 m", "1e28 km"])
def test_a_number_that_no_machine_has(value):
    with pytest.raises(InputError, match="is too large"):
        parse(value, "m")


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, "1e400 m", "1e400", 10**400, "9" * 5000])
def test_a_number_that_is_not_finite(value):
    with pytest.raises(InputError, match="is not a finite number") as error:
        parse(value, "m")
    assert len(str(error.value)) < 200


@pytest.mark.parametrize(
    "unit", ["m^9^9^9^9", "m**9**9**9", "9**9**9**9 m", "m**(9**9**9)", "(m^9)^9", "m^99", "m" * 100_000]
)
def test_a_unit_made_to_keep_the_program_busy(unit):
    with pytest.raises(InputError, match="is not known") as error:
        parse(f"1 {unit}", "m")
    assert len(str(error.value)) < 200


LENGTHS = {"m": 1.0, "mm": 1e-3, "um": 1e-6, "cm": 1e-2, "km": 1e3, "inch": 0.0254}


@given(
    value=st.floats(-1e12, 1e12).filter(lambda v: v == 0 or abs(v) > 1e-12),
    unit=st.sampled_from(sorted(LENGTHS)),
)
def test_a_length_survives_the_way_out_and_in(value, unit):
    there, zero = conversion(unit, "m")
    assert (there, zero) == (pytest.approx(LENGTHS[unit]), 0.0)
    assert parse(f"{value / LENGTHS[unit]!r} {unit}", "m") == pytest.approx(value, rel=1e-12)


@given(st.floats(-1e30, 1e30))
def test_a_bare_number_is_si_to_the_bit(value):
    assert parse(value, "m") == value
    assert parse(repr(value), "m") == value


@given(celsius=st.floats(-200, 200))
def test_temperatures_have_an_offset(celsius):
    assert parse(f"{celsius + 273.15!r} K", "degC") == pytest.approx(celsius, abs=1e-9)


@given(st.text(max_size=30))
def test_any_text_is_a_finite_number_or_one_clear_error(text):
    with contextlib.suppress(InputError):
        assert math.isfinite(parse(text, "m"))


@pytest.mark.parametrize(("unit", "to"), [*COMMON, ("N m", "N m"), ("degC", "degC")])
def test_common_units_are_converted_as_by_pint(unit, to):
    assert conversion(unit, to) == conversion_by_pint(unit, to)


def test_numbers_of_numpy_and_mat_files_are_numbers() -> None:
    for rate in (np.int64(12800), np.float32(12800), np.array([[12800.0]])):
        assert parse(rate, "Hz") == 12800
    with pytest.raises(InputError, match="not a number with a unit"):
        parse(np.array([1.0, 2.0]), "Hz")


@pytest.mark.parametrize("error", [OSError, ImportError])
def test_without_the_definitions_of_pint_an_uncommon_unit_is_refused_as_such(monkeypatch, error):
    def fail():
        raise error

    monkeypatch.setattr(units, "_registry", fail)
    assert parse("1 mm", "m") == 1e-3
    with pytest.raises(
        units.NoDefinitionsError, match="the unit 'furlong' needs pint, which cannot be loaded"
    ):
        parse("1 furlong", "m")
