"""Numbers of settings: what is accepted, and what an error says."""

from __future__ import annotations

import numpy as np
import pytest

from ballscrew.base.errors import InputError
from ballscrew.base.settings import check_setting, check_whole


@pytest.mark.parametrize("value", [0, 2, 2.5, np.int64(3), np.float32(2.5)])
def test_numbers_of_any_kind(value):
    check_setting("width", value, least=0.0, most=3.0)


@pytest.mark.parametrize("value", [-1, 4.0, float("nan"), float("inf"), True, np.True_, 1j, "2", None])
def test_what_is_no_number_in_the_range(value):
    with pytest.raises(InputError, match=r"width is .*; it must be a number, 0 or more and 3 or less"):
        check_setting("width", value, least=0.0, most=3.0)


@pytest.mark.parametrize("value", [1, 3, np.int32(2)])
def test_whole_numbers_of_any_kind(value):
    check_whole("runs", value, 1, 3)


@pytest.mark.parametrize("value", [0, 4, 2.0, True, "2", None])
def test_what_is_no_whole_number_in_the_range(value):
    with pytest.raises(InputError, match=r"runs is .*; it must be a whole number, 1 or more and 3 or less"):
        check_whole("runs", value, 1, 3)
