from __future__ import annotations

import numpy as np
import pytest

from ballscrew.axis.given import finite, not_negative, positive
from ballscrew.base.errors import InputError


@pytest.mark.parametrize("take", [finite, not_negative, positive])
def test_numbers_come_back_as_they_are(take):
    got = take("preload", [[1, 2], [3, 4]], "N")
    assert got.dtype == np.float64
    np.testing.assert_array_equal(got, [[1, 2], [3, 4]])
    assert take("ratio", np.float32(0.5)) == 0.5
    assert take("preload", [], "N").shape == (0,)


@pytest.mark.parametrize(
    ("take", "value", "message"),
    [
        (finite, np.nan, "a preload of nan was given; it must be a finite number of N."),
        (finite, [1.0, -np.inf], "a preload of -inf was given"),
        (not_negative, [3.0, -1.0], "a preload of -1 was given; it must be 0 N or more, and finite."),
        (not_negative, np.inf, "a preload of inf was given"),
        (positive, 0, "a preload of 0 was given; it must be more than 0 N, and finite."),
        (positive, np.nan, "a preload of nan was given"),
        (positive, "5", "a preload of '5' was given; it must be a number of N, or an array of them."),
        (positive, None, "a preload of None was given"),
        (positive, True, "a preload of True was given"),
        (positive, 1j, "a preload of 1j was given"),
        (positive, [[1.0], [1.0, 2.0]], "it must be a number of N, or an array of them"),
        (positive, 10**400, "it must be a number of N, or an array of them"),
        (positive, ["x" * 10**6], "it must be a number of N, or an array of them"),
    ],
)
def test_what_cannot_be(take, value, message):
    with pytest.raises(InputError) as error:
        take("preload", value, "N")
    assert message in str(error.value)
    assert len(str(error.value)) < 200


def test_a_ratio_has_no_unit():
    with pytest.raises(InputError, match=r"a share of -1 was given; it must be more than 0, and finite\."):
        positive("share", -1)
