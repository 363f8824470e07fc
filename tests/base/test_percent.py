from __future__ import annotations

import pytest

from ballscrew.base.percent import percent


@pytest.mark.parametrize(
    ("part", "words"),
    [
        (0.00123, "0.12 %"),
        (0.05, "5 %"),
        (0.996, "100 %"),
        (1.234, "120 %"),
        (0.0, "0 %"),
        (-0.052, "-5.2 %"),
    ],
)
def test_two_digits_and_no_power_of_ten(part: float, words: str) -> None:
    assert percent(part) == words
