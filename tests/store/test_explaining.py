"""Explanations are those of the newest assessment, and of no other."""

from __future__ import annotations

from typing import Any

import pytest
from tests.monitoring.histories import at
from tests.store.stored import EVENTS, MODEL, RUNS, count, fill

import ballscrew
from ballscrew.monitoring.epochs import Event
from ballscrew.report.monitor_words import advice, headline, lamp
from ballscrew.store.adding import add_events, add_run
from ballscrew.store.explaining import find_explanation
from ballscrew.store.reading import find_axis
from ballscrew.store.store import Store
from ballscrew.store.tables import Explanation


def stored_explanation(store: Store) -> dict[str, Any] | None:
    with store.read() as session:
        return find_explanation(session, find_axis(session, "bench"))


def test_an_explanation_is_that_of_monitor(filled: Store) -> None:
    assert stored_explanation(filled) is None
    filled.monitor("bench")
    found = stored_explanation(filled)
    monitored = ballscrew.monitor(RUNS, MODEL, events=EVENTS)
    assert found is not None
    assert (found["headline"], found["lamp"]) == (headline(monitored), lamp(monitored))
    assert found["actions"] == list(advice(monitored))
    assert found["state"]["causes"] == monitored.state.to_json()["causes"]
    assert "runs" not in found["state"]
    prognosis, ahead = monitored.prognosis, found["ahead"]
    assert prognosis is not None
    assert found["prognosis"]["rul_days"] == prognosis.to_json()["rul_days"]
    assert ahead["begins"] == RUNS[-1].measured_at == monitored.forecast_at.isoformat()
    assert ahead["days"][0] == pytest.approx(prognosis.fan.days[0])
    assert len(ahead["days"]) == len(ahead["ratio"]) <= 120


def test_an_outdated_explanation_is_not_given_and_then_replaced(store: Store) -> None:
    fill(store, RUNS[:8])
    store.monitor("bench")
    before = stored_explanation(store)
    add_run(store, RUNS[8])
    assert stored_explanation(store) is None
    store.monitor("bench")
    assert stored_explanation(store) not in (None, before)
    assert count(store, Explanation) == 1
    add_events(store, (Event(at(50.0), "greased", ""),), "bench")
    assert stored_explanation(store) is None
