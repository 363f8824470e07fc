"""Assessments from stored checkpoints give what all runs together give, whatever happened in between."""

from __future__ import annotations

import random
from collections import Counter
from types import SimpleNamespace
from typing import Any

import pytest
from sqlalchemy import event, select
from tests.monitoring.histories import at
from tests.store.conftest import NewStore
from tests.store.stored import EVENTS, MODEL, RUNS, count, text_of

from ballscrew.base.errors import InputError
from ballscrew.monitoring.detection.settings import MonitorSettings
from ballscrew.monitoring.epochs import Event
from ballscrew.prognosis.monitor import monitor
from ballscrew.store.adding import add_events, add_model, add_run
from ballscrew.store.assessment_rows import _state_rows
from ballscrew.store.histories import _prefixes, read_stored_history, settings_of
from ballscrew.store.store import Store
from ballscrew.store.tables import CheckpointRow, EpochRow, StateRow


def check(store: Store) -> int:
    """Compare an assessment with that of all runs; number of runs that were judged for it."""
    with store.read() as session:
        history = read_stored_history(session, "bench")
    assessed = store.monitor("bench")
    assert text_of(assessed.monitored) == text_of(monitor(history.runs, history.model, events=history.events))
    state = assessed.monitored.state
    expected = {row["run_id"]: row for row in _state_rows(state, history.axis.id, history.rows)}
    with store.read() as session:
        stored = session.scalars(select(StateRow)).all()
        assert {row.run_id for row in stored} == expected.keys()
        for row in stored:
            assert {name: getattr(row, name) for name in expected[row.run_id]} == expected[row.run_id]
        assert len(session.scalars(select(EpochRow)).all()) == len(state.epochs)
    return assessed.new_runs


def filled(new_store: NewStore, number: int) -> Store:
    store = new_store()
    add_model(store, MODEL)
    for run in RUNS[:number]:
        add_run(store, run)
    return store


def test_only_the_newest_run_is_judged(new_store: NewStore) -> None:
    store = filled(new_store, 4)
    assert check(store) == 4
    for run in RUNS[4:9]:
        add_run(store, run)
        assert check(store) == 1


def test_a_late_run_is_judged_from_a_checkpoint_before_it(new_store: NewStore) -> None:
    store = filled(new_store, 3)
    for run in RUNS[3:9] + RUNS[10:14]:
        add_run(store, run)
        check(store)
    add_run(store, RUNS[9])
    assert 5 <= check(store) < 14
    assert check(store) == 0


@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (1, 2))])
def test_any_change_between_assessments_gives_the_answer_of_all_runs(new_store: NewStore, seed: int) -> None:
    store, draw = filled(new_store, 2), random.Random(seed)  # noqa: S311
    missing = RUNS[2:]
    for step in range(8):
        change = draw.choice(["add", "add", "add", "correct", "exclude", "include", "event"])
        run = RUNS[draw.randrange(2, 14)]
        try:
            if change == "add" and missing:
                add_run(store, missing.pop(draw.randrange(len(missing))))
            elif change == "correct":
                store.correct(run.id, measured_at=at(20.0 + step), reason="clock")
            elif change == "event":
                add_events(store, EVENTS, "bench")
            elif change != "add":
                store.exclude(run.id, reason="sensor", undo=change == "include")
        except InputError:  # such as a run that the store does not contain yet
            continue
        check(store)


@pytest.mark.slow
def test_few_checkpoints_are_stored_for_many_runs(new_store: NewStore) -> None:
    store = filled(new_store, 1)
    for run in RUNS[1:]:
        add_run(store, run)
        store.monitor("bench")
    assert count(store, CheckpointRow) <= 5
    with store.read() as session:
        runs = sorted(session.scalars(select(CheckpointRow.runs)))
    assert runs[-1] == 14
    assert runs[0] < 10


def test_a_checkpoint_by_other_settings_is_not_used(new_store: NewStore) -> None:
    store = filled(new_store, 5)
    check(store)
    add_run(store, RUNS[5])
    settings = MonitorSettings(false_alarms_per_year=0.5)
    assert store.monitor("bench", settings=settings).new_runs == 6


def test_settings_that_alternate_use_their_own_checkpoints(new_store: NewStore) -> None:
    store = filled(new_store, 5)
    settings = (MonitorSettings(), MonitorSettings(false_alarms_per_year=0.5))
    for each in settings:
        assert store.monitor("bench", settings=each).new_runs == 5
    for run in RUNS[5:8]:
        add_run(store, run)
        for each in settings:
            assert store.monitor("bench", settings=each).new_runs == 1
    with store.read() as session:
        of = Counter(settings_of(key) for key in session.scalars(select(CheckpointRow.key)))
    assert min(of.values()) == 1  # of the settings that were not used last


def test_an_assessment_writes_the_states_that_changed_alone(new_store: NewStore) -> None:
    store = filled(new_store, 13)
    store.monitor("bench")
    with store.read() as session:
        before = set(session.execute(select(StateRow.run_id, StateRow.checksum)).all())
    add_run(store, RUNS[13])
    written: list[int] = []

    @event.listens_for(store.engine(writing=True), "before_cursor_execute")
    def _count(*arguments: Any) -> None:
        if str(arguments[2]).startswith("INSERT INTO states"):
            written.append(len(arguments[3]) if arguments[5] else 1)

    store.monitor("bench")
    with store.read() as session:
        after = set(session.execute(select(StateRow.run_id, StateRow.checksum)).all())
    assert sum(written) == len(after - before) < 4


def test_keys_of_a_history_take_time_by_its_runs_and_not_by_their_product_with_events() -> None:
    parsed: list[str] = []

    class Counted(Event):
        @property
        def when(self) -> Any:
            parsed.append(self.at)
            return super().when

    rows = [SimpleNamespace(id=day, run=str(day), time=86400.0 * (20_000 + day)) for day in range(30)]
    events = [Counted(f"2024-10-{4 + day:02d}T12:00Z", "note") for day in range(20)]
    results: Any = {row.id: SimpleNamespace(checksum=row.id) for row in rows}
    keys = _prefixes(rows, results, events, "model", MonitorSettings())
    assert len(parsed) == len(events)
    fewer = _prefixes(rows, results, events[:10], "model", MonitorSettings())
    assert [key == other for key, other in zip(keys, fewer, strict=True)] == [True] * 11 + [False] * 19


def test_a_damaged_checkpoint_is_made_again(new_store: NewStore) -> None:
    store = filled(new_store, 4)
    check(store)
    with store.write("test") as session:
        for row in session.scalars(select(CheckpointRow)):
            row.document = row.document[:-9]
    add_run(store, RUNS[4])
    assert check(store) == 5
    add_run(store, RUNS[5])
    assert check(store) == 1
