from __future__ import annotations

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ballscrew.base.errors import InputError
from ballscrew.fcft.conditions import Condition, conditions_at

# Table 1 of the paper, by number; its text lists PD, PA, NA, ND.
PAPER = {"start": (2, 4), "end": (1, 3), "between": (1, 2, 3, 4)}


def test_numbers_follow_the_papers_text():
    assert [(c.value, c.number) for c in Condition] == [("PD", 1), ("PA", 2), ("NA", 3), ("ND", 4)]


@pytest.mark.parametrize(("index", "where"), [(0, "start"), (10, "end"), (1, "between"), (9, "between")])
def test_table_1(index, where):
    assert tuple(condition.number for condition in conditions_at(index, 11)) == PAPER[where]


@given(count=st.integers(2, 40), data=st.data())
def test_what_one_round_trip_really_does(count, data):
    # Not from the table: walk up and down once, and note how each stop is left and reached.
    trip = [*range(count), *range(count - 2, -1, -1)]
    found: dict[int, set[str]] = {index: set() for index in range(count)}
    for here, there in itertools.pairwise(trip):
        sign = "P" if there > here else "N"
        found[here].add(sign + "A")
        found[there].add(sign + "D")
    index = data.draw(st.integers(0, count - 1))
    assert found[index] == set(conditions_at(index, count))


def test_words():
    assert [c.words for c in Condition] == [
        "positive/deceleration",
        "positive/acceleration",
        "negative/acceleration",
        "negative/deceleration",
    ]
    assert [c.direction for c in Condition] == [1, 1, -1, -1]
    assert [c.accelerating for c in Condition] == [False, True, True, False]


def test_it_is_a_text():
    assert Condition("PA") == "PA"
    assert f"{Condition.PA}" == "PA"
    with pytest.raises(ValueError, match="AP"):
        Condition("AP")


@pytest.mark.parametrize(("index", "count"), [(-1, 5), (5, 5), (0, 1), (0, 0)])
def test_a_stop_that_is_not_there(index, count):
    with pytest.raises(InputError, match="there is no stop"):
        conditions_at(index, count)
