"""A course holds one entry a run, and refuses what cannot be."""

from __future__ import annotations

import numpy as np
import pytest

from ballscrew.base.errors import InputError
from ballscrew.prognosis.course import Course, course

DAYS = np.arange(5.0)


def test_what_is_not_given_is_nan() -> None:
    one = course(DAYS, 0.01 * DAYS, 0.005)
    assert len(one) == 5
    assert np.isnan(one.backlash).all()
    assert np.isnan(one.temperature).all()
    assert one.random.tolist() == [0.005] * 5


def test_until_knows_nothing_of_later_runs() -> None:
    one = course(DAYS, 0.01 * DAYS, 0.005, friction=100.0, friction_uncertainty=1.0).until(2.5)
    assert one.days.tolist() == [0, 1, 2]
    assert len(one.level) == len(one.friction) == 3


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"level": [0.0, 0.1]}, "one a run"),
        ({"level": "text"}, "must be numbers"),
        ({"level": np.zeros((5, 2))}, "dimensions"),
        ({"level": [0.0, np.inf, 0, 0, 0]}, "infinite"),
        ({"level": [0.0, -1.0, 0, 0, 0]}, "more than -1"),
        ({"random": 0.0}, "standard uncertainty above 0"),
        ({"random": np.nan}, "standard uncertainty above 0"),
        ({"temperature": [np.inf, 0, 0, 0, 0]}, "temperature"),
        ({"scale": -0.1}, "scale"),
        ({"scale": np.nan}, "scale"),
        ({"pressed": 0.0}, "pressed"),
        ({"friction": 100.0}, "friction_uncertainty"),
        ({"backlash": 1e-6, "backlash_uncertainty": -1.0}, "backlash_uncertainty"),
    ],
)
def test_what_cannot_be_is_refused(changed: dict[str, object], words: str) -> None:
    given = {"level": 0.01 * DAYS, "random": 0.005} | changed
    with pytest.raises(InputError, match=words):
        course(DAYS, **given)  # type: ignore[arg-type]


@pytest.mark.parametrize("days", [[1.0, 0.0], [0.0, np.nan], [0.0, np.inf]])
def test_days_ascend(days: list[float]) -> None:
    with pytest.raises(InputError, match="ascend"):
        course(days)


def test_a_hundred_thousand_runs_are_enough() -> None:
    with pytest.raises(InputError, match="or fewer"):
        course(np.zeros(100_001))


def test_an_empty_course_is_one() -> None:
    assert isinstance(course([]), Course)
