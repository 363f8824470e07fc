"""Sentences of a prognosis, and its JSON."""

from __future__ import annotations

import contextlib
import copy
import json
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.prognosis.lives import QUICK, healthy, made

from ballscrew.base.errors import InputError
from ballscrew.prognosis.duty import EpochDuty
from ballscrew.prognosis.failure import Failure
from ballscrew.prognosis.forecast import Forecast
from ballscrew.prognosis.result import Prognosis
from ballscrew.prognosis.statement import prognosis_of

WORN, NEW = made(90), healthy(20)
WORN_RESULT = prognosis_of(QUICK.forecast(WORN, Failure()), WORN, duty=4000.0)
OPEN = prognosis_of(QUICK.forecast(NEW, Failure()), NEW)
DOCUMENT: dict[str, Any] = WORN_RESULT.to_json()


@pytest.mark.parametrize("result", [WORN_RESULT, OPEN])
def test_to_json_and_back(result: Prognosis) -> None:
    text = json.dumps(result.to_json(), allow_nan=False)
    assert Prognosis.from_json(json.loads(text)).to_json() == result.to_json()


def test_the_stable_keys() -> None:
    days, travel = (DOCUMENT[name]["quantiles"] for name in ("rul_days", "rul_travel_m"))
    assert days["0.05"] < days["0.5"] < days["0.95"]
    assert travel["0.5"] == pytest.approx(4000 * days["0.5"])


def test_an_open_quantile_is_null_with_its_reason() -> None:
    assert OPEN.to_json()["rul_days"]["quantiles"]["0.95"] is None
    assert OPEN.rul_travel_m == {}
    assert OPEN.confidence.startswith("none")
    assert set(OPEN.rul_days.values()) == {None}
    assert OPEN.fan.days == ()
    assert any("Wear has begun with a probability of" in line for line in OPEN.statement)
    assert any("no run shows it yet" in line for line in OPEN.assumptions)


def test_sentences_of_small_numbers() -> None:
    days = np.linspace(0.0, 2.0, 100)
    soon = Forecast(0.2, days, 60.0, "preload", "x", np.zeros(1), np.full((1, 9), 0.5), "made", begun=1.0)
    prognosis = prognosis_of(soon, NEW)
    assert prognosis.confidence.startswith("high: nine in ten")
    assert "within a day" in prognosis.assumptions[1]
    gone = prognosis_of(replace(soon, rul_days=np.zeros(100)), NEW)
    assert gone.confidence == "high: nine in ten such axes have reached their end"
    maybe = prognosis_of(replace(soon, rul_days=np.sort(np.where(days < 1, 0.0, 20.0))), NEW)
    assert "It has been reached already with a probability of 50 %." in maybe.statement
    never = prognosis_of(replace(soon, begun=0.004), NEW)
    assert "less than 1 %" in never.statement[1]
    over = prognosis_of(replace(soon, begun=0.004, alarm=True), NEW)
    assert "The alarm still stands, but" in over.statement[1]
    assert over.rul_days[0.05] is None
    likely = prognosis_of(replace(soon, begun=0.4, alarm=True), NEW)
    assert "as the alarm states" in likely.statement[-1]
    assert likely.rul_days[0.05] is not None
    assert not any("probability of 40 %" in line for line in likely.statement)


def test_the_statement_follows_the_standard() -> None:
    assert WORN_RESULT.statement[0].startswith("Failure mode: the preload falls below 50 %")
    assert WORN_RESULT.statement[1].startswith("Time to failure: not before ")
    assert "not before" in WORN_RESULT.statement[2]
    assert "km" in WORN_RESULT.statement[2]
    assert WORN_RESULT.statement[3].startswith("Wear families, weighted by past forecasts: ")
    assert WORN_RESULT.assumptions
    assert WORN_RESULT.would_change


def test_a_duty_of_zero_is_refused() -> None:
    with pytest.raises(InputError, match="travel of a day"):
        prognosis_of(QUICK.forecast(NEW, Failure()), NEW, duty=0.0)


ADDED = {"rul_revolutions", "rul_hours", "duty_per_day"}  # keys that an earlier version lacks


@pytest.mark.parametrize("key", sorted(DOCUMENT.keys() - {"schema"} - ADDED))
def test_a_missing_key_is_named(key: str) -> None:
    with pytest.raises(InputError, match=key):
        Prognosis.from_json({name: value for name, value in DOCUMENT.items() if name != key})


@pytest.mark.parametrize(
    ("path", "value"),
    [
        (("at_day",), "today"),
        (("at_day",), True),
        (("at_day",), math.nan),
        (("rul_days", "quantiles"), [1, 2]),
        (("rul_days", "quantiles"), {"0.5": -1}),
        (("rul_days", "quantiles"), {"1.5": 1}),
        (("rul_days", "quantiles"), {"x": 1}),
        (("rul_days", "quantiles"), {"0.05": 50, "0.5": 40}),
        (("rul_days", "quantiles"), {"0.05": None, "0.5": 40}),
        (("failure", "mode"), "fire"),
        (("begun",), 2),
        (("laws",), {"preload": "all"}),
        (("families",), {"exponential": 2}),
        (("laws",), 3),
        (("statement",), "text"),
        (("statement",), [3]),
        (("fan",), {"days": [1], "probabilities": [0.5], "ratio": []}),
        (("fan",), {"days": [1], "probabilities": [0.5], "ratio": [[1, 2]]}),
        (("made",), 7),
        (("duty_m_per_day",), 10**400),
    ],
)
def test_wrong_values_are_refused(path: tuple[str, ...], value: object) -> None:
    document = copy.deepcopy(DOCUMENT)
    inner = document
    for name in path[:-1]:
        inner = inner[name]
    inner[path[-1]] = value
    with pytest.raises(InputError, match="is not a prognosis"):
        Prognosis.from_json(document)


JSON = st.recursive(
    st.none() | st.booleans() | st.floats() | st.text(max_size=5) | st.integers(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=8,
)


@given(st.sampled_from(sorted(DOCUMENT)), JSON)
def test_hostile_documents_never_end_in_a_traceback(key: str, value: object) -> None:
    with contextlib.suppress(InputError):
        Prognosis.from_json(DOCUMENT | {key: value})


def test_a_list_is_refused() -> None:
    with pytest.raises(InputError, match="is not a prognosis"):
        Prognosis.from_json([])  # type: ignore[arg-type]


def counted(days: np.ndarray) -> Prognosis:
    """Prognosis with a travel of 4 km and 100 revolutions a day."""
    fan = np.zeros(1), np.full((1, 9), 0.5)
    forecast = Forecast(5.0, np.sort(days), 60.0, "preload", "x", *fan, "made", begun=1.0)
    counter = EpochDuty(np.array([0.0, 40.0]), np.array([0.0, 4000.0]), 20.0)
    return prognosis_of(forecast, NEW, duty=4000.0, counters={"revolutions": counter})


def test_an_open_end_is_open_in_travel_and_in_revolutions_too() -> None:
    days = np.linspace(10.0, 20.0, 100)
    ends = counted(days)
    assert any(line.startswith("In travel, at 4000 m a day: not before 4") for line in ends.statement)
    assert not any("open" in line for line in ends.statement[2:])
    half = counted(np.where(days > 17, math.inf, days))
    (travel,) = (line for line in half.statement if line.startswith("In travel"))
    (turns,) = (line for line in half.statement if line.startswith("In revolutions of the screw"))
    assert travel.endswith("km in the median; the latest end is open.")
    assert turns.endswith(" in the median; the latest end is open.")
    assert half.rul_days[0.95] is None
    rarely = counted(np.where(days > 12, math.inf, days))
    assert rarely.rul_days[0.05] is not None
    assert rarely.rul_days[0.5] is None
    for beginning in ("In travel", "In revolutions"):
        assert not any(line.startswith(beginning) for line in rarely.statement)


def test_runs_of_one_day_and_of_several_are_worded() -> None:
    for last, words in ((0.2, "within a day"), (1.0, "in one day"), (3.0, "in 3 days")):
        fan = np.zeros(1), np.full((1, 9), 0.5)
        forecast = Forecast(last, np.ones(100), 60.0, "preload", "x", *fan, "made", begun=1.0)
        assert f" {words} are used" in prognosis_of(forecast, NEW).assumptions[1]
