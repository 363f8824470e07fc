from __future__ import annotations

import dataclasses
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ballscrew.base.errors import InputError
from ballscrew.base.quantity import Quantity


def test_it_prints_as_the_interfaces_say():
    assert Quantity(0.52, 0.02).to_json() == {
        "value": 0.52,
        "standard_uncertainty": 0.02,
        "interval95": pytest.approx([0.4808, 0.5592], abs=1e-4),
    }


def test_a_skew_interval_is_kept():
    assert Quantity(0.52, 0.02, "", (0.4, 0.54)).to_json()["interval95"] == [0.4, 0.54]


@pytest.mark.parametrize(
    ("quantity", "text"),
    [
        (Quantity(171.5234, 0.234, "Hz"), "171.52 ± 0.23 Hz"),
        (Quantity(600.0, 12.3, "N"), "600 ± 12 N"),
        (Quantity(600.0, 123.0, "N"), "600 ± 123 N"),
        (Quantity(0.52, 0.0), "0.52"),
        (Quantity(0.5, 0.02), "0.500 ± 0.020"),
    ],
)
def test_as_people_read_it(quantity, text):
    assert str(quantity) == text


@pytest.mark.parametrize(("value", "u"), [(math.nan, 1.0), (1.0, math.nan), (math.inf, 1.0), (1.0, math.inf)])
def test_what_is_not_finite_is_refused(value, u):
    with pytest.raises(InputError, match="must be finite"):
        Quantity(value, u)


def test_a_negative_uncertainty_is_refused():
    with pytest.raises(InputError, match="cannot be negative"):
        Quantity(1.0, -0.1)


@pytest.mark.parametrize("interval", [(2.0, 1.0), (math.nan, 2.0), (1.0, math.inf)])
def test_an_impossible_interval_is_refused(interval):
    with pytest.raises(InputError, match="interval"):
        Quantity(1.5, 0.1, "", interval)


def test_it_cannot_be_changed():
    with pytest.raises(dataclasses.FrozenInstanceError):
        Quantity(1.0, 0.1).value = 2.0  # type: ignore[misc]


@given(st.floats(-1e9, 1e9), st.floats(0, 1e9))
def test_the_value_lies_in_the_middle_of_its_interval(value, u):
    low, high = Quantity(value, u).interval
    assert low <= value <= high
    assert (low + high) / 2 == pytest.approx(value, abs=1e-6 + 1e-9 * u)
