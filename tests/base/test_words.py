from __future__ import annotations

import pytest

from ballscrew.base.words import duration, interval_words, percent, plural, without_repeats


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


@pytest.mark.parametrize(
    ("numbers", "words"),
    [
        (None, "–"),
        ((0.876, 0.831, 0.94), "88 (83 to 94) %"),
        ((0.9962, 0.9915, 1.0007), "99.6 (99.2 to 100.1) %"),
        ((1.0, 0.99, 1.0101), "100 (99 to 101) %"),
        ((0.3, 0.0, 0.55), "below 55 %"),
    ],
)
def test_an_interval_has_tenths_of_a_percent_where_they_count(
    numbers: tuple[float, ...] | None, words: str
) -> None:
    assert interval_words(numbers) == words


def test_a_number_has_its_noun_in_the_singular_or_plural() -> None:
    assert (plural(1, "cell"), plural(0, "cell"), plural(3, "cell")) == ("1 cell", "0 cells", "3 cells")


def test_a_duration_is_in_seconds_minutes_or_hours() -> None:
    assert list(map(duration, (90, 150, 9000))) == ["90.0 s", "2.5 min", "2.5 h"]


def test_the_end_of_a_sentence_is_printed_once_whatever_its_numbers() -> None:
    question = "as of its own weight; is this axis vertical or inclined? State orientation in the data sheet"
    sentences = [
        f"the measurement is suspect: a constant force of 264 N, {question}",
        f"run 58d is suspect: a constant force of 181.5 N, {question}.",
        "no load explains it; is this axis inclined, since no other cause explains so large a force?",
        "the baseline is suspect: a short reason",
        "the run is suspect: a short reason",
    ]
    first, second, *others = without_repeats(sentences)
    assert (first, second) == (sentences[0], "run 58d is suspect: as above")
    assert others == sentences[2:]
