from __future__ import annotations

import pytest

from ballscrew.base.errors import BallscrewError, InputError, MeasurementError, field_error, shown


def test_exit_statuses():
    assert (BallscrewError("").exit_status, InputError("").exit_status) == (2, 2)
    assert MeasurementError("").exit_status == 1
    assert issubclass(InputError, BallscrewError)
    assert issubclass(MeasurementError, BallscrewError)


def test_a_field_error_says_what_where_given_and_allowed():
    error = field_error("axis.toml", "screw.lead", -3, "more than 0")
    assert isinstance(error, InputError)
    assert str(error) == "axis.toml: screw.lead is -3; it must be more than 0."


def test_a_missing_field():
    assert str(field_error("a.toml", "name", None, "a text")) == "a.toml: name is missing; it must be a text."


@pytest.mark.parametrize("given", ["x" * 10**6, 10**5000, [0] * 10**5], ids=["text", "whole", "list"])
def test_a_huge_value_does_not_fill_the_screen(given):
    assert len(shown(given)) <= 80
