from __future__ import annotations

import pytest

from ballscrew.base.words import duration, percent, plural


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


def test_a_number_has_its_noun_in_the_singular_or_plural() -> None:
    assert (plural(1, "cell"), plural(0, "cell"), plural(3, "cell")) == ("1 cell", "0 cells", "3 cells")


def test_a_duration_is_in_seconds_minutes_or_hours() -> None:
    assert list(map(duration, (90, 150, 9000))) == ["90.0 s", "2.5 min", "2.5 h"]
