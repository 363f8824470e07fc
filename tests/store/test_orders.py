"""Additions in any order, duplicates, corrections and exclusions give the same history: a state machine."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule, run_state_machine_as_test
from tests.monitoring.histories import at
from tests.store.conftest import NewStore
from tests.store.stored import EVENTS, MODEL, RUNS, count

from ballscrew.base.errors import InputError
from ballscrew.modal.amend import amend
from ballscrew.modal.run import Run
from ballscrew.store.adding import add_events, add_model, add_run
from ballscrew.store.histories import read_stored_history
from ballscrew.store.store import Store
from ballscrew.store.tables import Conflict, RunRow

NUMBERS = st.integers(0, 5)


class Orders(RuleBasedStateMachine):
    """A store beside a plain model of what it should contain."""

    new_store: NewStore

    def __init__(self) -> None:
        super().__init__()
        self.store: Store = self.new_store()
        self.runs: dict[int, Run] = {}
        self.corrected: dict[int, Run] = {}
        self.first: set[int] = set()
        self.others: set[int] = set()
        self.excluded: set[int] = set()
        self.events: set[int] = set()
        self.excluded_events: set[int] = set()
        self.conflicts: set[int] = set()

    @initialize()
    def add_the_model(self) -> None:
        add_model(self.store, MODEL)

    @rule(number=NUMBERS)
    def add(self, number: int) -> None:
        assert add_run(self.store, RUNS[number]).is_new == (number not in self.runs)
        self.runs[number] = RUNS[number]

    @rule(number=NUMBERS)
    def add_with_other_content(self, number: int) -> None:
        if number not in self.runs:
            return
        other = replace(RUNS[number], cells=RUNS[number].cells[1:])
        with pytest.raises(InputError, match="another result"):
            add_run(self.store, other)
        self.conflicts.add(number)

    @rule(number=NUMBERS)
    def correct(self, number: int) -> None:
        if number not in self.runs:
            return
        correction = amend(RUNS[number], measured_at=at(100.0 + number))
        if self.corrected.get(number, correction) != correction:
            with pytest.raises(InputError, match="was corrected already"):
                self.store.correct(RUNS[number].id, measured_at=at(100.0 + number))
            return
        self.corrected[number] = correction
        self.first.add(number)
        assert self.store.correct(RUNS[number].id, measured_at=at(100.0 + number)) == correction.id

    @rule(number=NUMBERS)
    def add_another_correction_as_a_file(self, number: int) -> None:
        other = amend(RUNS[number], measured_at=at(200.0 + number))
        if number not in self.runs or not add_run(self.store, other).is_new:
            return
        self.others.add(number)
        self.corrected[number] = other

    @rule(number=NUMBERS)
    def exclude(self, number: int) -> None:
        if number in self.runs:
            self.store.exclude(self.runs[number].id, reason="test")
            self.excluded.add(number)

    @rule(number=NUMBERS)
    def include(self, number: int) -> None:
        if number in self.runs:
            self.store.exclude(self.corrected.get(number, self.runs[number]).id, undo=True)
            self.excluded.discard(number)

    @rule(number=st.integers(0, 1))
    def add_event(self, number: int) -> None:
        add_events(self.store, EVENTS[number:], "bench")
        self.events |= set(range(number, 2))

    @rule(number=st.integers(0, 1), undo=st.booleans())
    def exclude_event(self, number: int, undo: bool) -> None:
        if number in self.events:
            rows = self.store.show("bench")["events"]
            (digest,) = [row["digest"] for row in rows if row["at"] == EVENTS[number].at]
            self.store.exclude(digest, reason="test", undo=undo)
            if undo:
                self.excluded_events.discard(number)
            else:
                self.excluded_events.add(number)

    @invariant()
    def the_history_is_that_of_the_model(self) -> None:
        current = self.runs | self.corrected
        expected = [current[number] for number in set(current) - self.excluded]
        expected.sort(key=lambda run: str(run.measured_at))
        try:
            with self.store.read() as session:
                history = read_stored_history(session, "bench")
        except InputError:
            assert not expected
            return
        assert list(history.runs) == expected
        events = [EVENTS[number] for number in sorted(self.events - self.excluded_events)]
        assert list(history.events) == events

    def teardown(self) -> None:
        assert count(self.store, RunRow) == len(self.runs) + len(self.first) + len(self.others)
        assert count(self.store, Conflict) == len(self.conflicts)
        assert self.store.verify(self.store.path).faults == ()
        for writing in (False, True):
            self.store.engine(writing=writing).dispose()  # a server of PostgreSQL has 100 connections


@pytest.mark.parametrize("orders", [12, pytest.param(200, marks=pytest.mark.slow)])
def test_any_order_of_changes_gives_the_same_history(new_store: NewStore, orders: int) -> None:
    class OfThisDatabase(Orders):
        pass

    OfThisDatabase.new_store = staticmethod(new_store)
    many = settings(
        max_examples=orders, stateful_step_count=14, deadline=None, suppress_health_check=list(HealthCheck)
    )
    run_state_machine_as_test(OfThisDatabase, settings=many)
