"""Switches to another revision of the method where raw files of runs are gone; the difference is known."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from sqlalchemy import select
from tests.estimation.made_runs import run_of
from tests.monitoring.histories import BEGIN, at
from tests.store.conftest import CopyStore
from tests.store.stored import MODEL, count, text_of, write_recordings

import ballscrew
from ballscrew.base.errors import InputError
from ballscrew.base.provenance import FileRef, Made, hash_file
from ballscrew.modal.analyze import Analysis, AnalysisOptions
from ballscrew.modal.job import Job
from ballscrew.modal.run import Run
from ballscrew.monitoring.epochs import METHOD_CHANGED, Event, moment, read_events
from ballscrew.store import adding
from ballscrew.store.adding import add_events, add_model
from ballscrew.store.rows import checksum_of
from ballscrew.store.store import Store
from ballscrew.store.switching import switch_axis
from ballscrew.store.tables import Audit, MethodChange

DIFFERENCE = 3e-3  # of the frequencies by revision 2
Switch = Callable[[int], None]
on_sqlite = pytest.mark.parametrize("new_url", ["sqlite"], indirect=True)


def simulate(patched: pytest.MonkeyPatch) -> Switch:
    """Replace the analysis by simulated revisions; a function that chooses the revision."""
    revision = [1]

    def examine(job: Job, options: AnalysisOptions, **_: Any) -> Analysis:
        files = tuple(FileRef(Path(str(file)).name, hash_file(file)) for file in job.files)  # type: ignore[arg-type]
        day = round((moment(job.measured_at, "") - BEGIN).total_seconds() / 86400)
        level = 1e-4 * np.random.default_rng([day, 1]).standard_normal()
        scatter = 5e-5 * np.random.default_rng([day, revision[0]]).standard_normal()
        run = run_of(1.0, level=level + scatter + (revision[0] - 1) * DIFFERENCE, seed=day)
        run = replace(
            run, id=job.identity(files, job.measured_at), axis="bench", mass_kg=job.mass, files=files,
            measured_at=job.measured_at, temperature_C=job.temperature,
            made=Made(options.to_settings(), inputs=job.inputs()),
        )  # fmt: skip
        return Analysis(run, (), None)

    patched.setattr("ballscrew.modal.analyze.examine", examine)
    patched.setattr("ballscrew.store.analysing.examine", examine)

    def choose(number: int) -> None:
        revision[0] = number
        patched.setattr(adding, "METHOD_REVISION", number)

    return choose


def add_day(store: Store, folder: Path, day: int) -> str:
    path = write_recordings(folder / f"run{day}", float(day), f"{day}".encode(), files=1)
    return store.add(path).subject


@pytest.fixture
def choose(monkeypatch: pytest.MonkeyPatch) -> Switch:
    """Chooses the revision of a simulated analysis."""
    return simulate(monkeypatch)


def add_ten(store: Store) -> None:
    """Add ten runs by revision 1, of which the newest five have raw files."""
    add_model(store, MODEL)
    for day in range(10):
        add_day(store, store.path.parent, day)
    store.archive("bench", store.path.parent / "archive", newest=5)


@pytest.fixture
def archived(copy_store: CopyStore, choose: Switch) -> Store:  # noqa: ARG001  it replaces the analysis
    """A store of :func:`add_ten`."""
    return copy_store(add_ten)


def changes(store: Store) -> list[dict[str, Any]]:
    return [event for event in store.show("bench")["events"] if event["kind"] == METHOD_CHANGED]


def raw_days(store: Store) -> list[int]:
    """Days of the runs whose raw files are in the store."""
    days = []
    for day, run in enumerate(store.show("bench")["runs"]):
        if all(file["stored"] for file in store.show(run["run"])["recordings"]):
            days.append(day)
    return days


def test_runs_without_raw_files_keep_their_results_and_an_event_states_the_step(
    archived: Store, choose: Switch
) -> None:
    kept = raw_days(archived)
    before = archived.monitor("bench").monitored
    choose(2)
    (axis,) = archived.reprocess()["axes"]
    assert (axis["missing"], axis["without_files"], axis["switched"]) == (10 - len(kept),) * 2 + (False,)
    assert axis["step"]["runs"] == len(kept)
    assert axis["step"]["value"] == pytest.approx(
        -0.0247, abs=3 * axis["step"]["standard_uncertainty"] + 5e-4
    )
    assert text_of(archived.monitor("bench").monitored) == text_of(before)
    assert changes(archived) == []

    (axis,) = archived.reprocess(["bench"], switch=True)["axes"]
    assert axis["switched"]
    assert archived.show("bench")["method"] == {"name": "joint", "revision": 2}
    stated = [(event["at"], round(event["step"] / axis["step"]["value"])) for event in changes(archived)]
    ends = [day for day in range(1, 10) if (day in kept) != (day - 1 in kept)]
    expected = [(at(float(day)), 1 if day in kept else -1) for day in ends]
    assert stated == expected
    assert "revision 2 after 1: as +7." in changes(archived)[-1]["text"]
    with archived.read() as session:
        (row,) = session.scalars(select(Audit).where(Audit.action == "switch"))
    assert row.detail["step"] == axis["step"]
    assert archived.verify(archived.path).faults == ()

    after = archived.monitor("bench").monitored.state
    assert [run.reading.run for run in after.runs] == [run.reading.run for run in before.state.runs]
    assert after.alarm_at is None
    levels = [[run.reading.level for run in state.runs] for state in (after, before.state)]
    assert np.subtract(*levels) == pytest.approx(0, abs=2e-3)
    assert len(after.epochs) == 1
    assert archived.monitor("bench").notes == ()


@on_sqlite
def test_without_the_step_the_same_runs_would_raise_an_alarm(
    archived: Store, choose: Switch, tmp_path: Path
) -> None:
    choose(2)
    archived.reprocess(switch=True)
    for day in range(10, 14):
        add_day(archived, tmp_path, day)
    state = archived.monitor("bench").monitored.state
    assert state.alarm_at is None
    folder = archived.export("bench", tmp_path / "exported")
    runs = [Run.read(path) for path in sorted(folder.glob("runs/*.json"))]
    events = read_events(folder / "events.toml")
    assert {event.kind for event in events} == {METHOD_CHANGED}
    assert text_of(ballscrew.monitor(runs, MODEL, events=events).state) == text_of(state)
    without = ballscrew.monitor(runs, MODEL).state
    assert max(abs(run.reading.level) for run in without.runs) > 0.015
    assert max(abs(run.reading.level) for run in state.runs) < 0.005


@on_sqlite
def test_a_late_run_is_between_two_changes(archived: Store, choose: Switch, tmp_path: Path) -> None:
    """It is analysed by the newer revision, and the runs around it were not."""
    choose(2)
    archived.reprocess(switch=True)
    gone = sorted(set(range(10)) - set(raw_days(archived)))
    first = next(day for day in gone if day + 1 in gone)
    before = changes(archived)
    path = write_recordings(tmp_path / "late", first + 0.5, b"late", files=1)
    archived.add(path)
    added = [event for event in changes(archived) if event not in before]
    assert [(event["at"], event["step"] < 0) for event in added] == [
        (at(first + 0.5), True),
        (at(first + 1.0), False),
    ]
    state = archived.monitor("bench").monitored.state
    assert max(abs(run.reading.level) for run in state.runs) < 0.005


@on_sqlite
def test_three_revisions_follow_each_other(archived: Store, choose: Switch, tmp_path: Path) -> None:
    choose(2)
    archived.reprocess(switch=True)
    for day in range(10, 13):
        add_day(archived, tmp_path, day)
    archived.archive("bench", tmp_path / "more", newest=4)
    choose(3)
    assert archived.reprocess(switch=True)["axes"][0]["switched"]
    state = archived.monitor("bench").monitored.state
    assert len(state.runs) == 13
    assert max(abs(run.reading.level) for run in state.runs) < 0.006
    assert archived.verify(archived.path).faults == ()
    assert archived.reprocess()["failures"] == []
    assert count(archived, MethodChange) == 2


@on_sqlite
def test_an_axis_is_switched_back_and_forth(archived: Store, choose: Switch, tmp_path: Path) -> None:
    for number in (2, 1):
        choose(number)
        assert archived.reprocess(switch=True)["axes"][0]["switched"]
    assert changes(archived) == []
    for day in range(10, 13):
        add_day(archived, tmp_path, day)
    choose(2)
    (axis,) = archived.reprocess(switch=True)["axes"]
    assert axis["switched"]
    assert count(archived, MethodChange) == 1
    with archived.read() as session:
        change = session.scalars(select(MethodChange)).one()
        assert (change.step, change.runs) == (axis["step"]["value"], axis["step"]["runs"])
        assert change.checksum == checksum_of(change)
    assert "revision 2 after 1" in changes(archived)[-1]["text"]
    assert len(archived.monitor("bench").monitored.state.runs) == 13
    assert archived.verify(archived.path).faults == ()


@on_sqlite
def test_a_method_is_not_reached_from_two_others(archived: Store, choose: Switch) -> None:
    """Runs without raw files have no result of it, and the steps to it would be two."""
    for number in (2, 3):
        choose(number)
        archived.reprocess(switch=True)
    choose(2)
    with pytest.raises(InputError, match="switched before, from revision 1 and not 3"):
        archived.reprocess(switch=True)
    assert archived.show("bench")["method"]["revision"] == 3
    assert count(archived, MethodChange) == 2
    choose(1)
    assert archived.reprocess(switch=True)["axes"][0]["switched"]


@on_sqlite
def test_a_switch_that_cannot_be_estimated_is_refused_and_shown(
    store: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    choose = simulate(monkeypatch)
    for day in range(4):
        add_day(store, tmp_path, day)
    store.archive("bench", tmp_path / "archive", newest=0)
    for day in (4, 5, 6):
        add_day(store, tmp_path, day)
    choose(2)
    (axis,) = store.reprocess()["axes"]
    assert (axis["without_files"], axis["step"]) == (4, None)  # no model
    with pytest.raises(InputError, match="4 runs have no new result and no raw files, and the step"):
        store.reprocess(switch=True)
    assert store.show("bench")["method"]["revision"] == 1
    assert count(store, MethodChange) == 0
    add_model(store, MODEL)
    store.exclude(store.show("bench")["runs"][5]["run"], reason="two are too few")
    with pytest.raises(InputError, match="cannot be estimated"):
        store.reprocess(switch=True)


@on_sqlite
def test_an_event_of_a_change_is_not_added_by_hand(store: Store) -> None:
    with pytest.raises(InputError, match="'reprocess --switch' makes it"):
        add_events(store, (Event(at(1.0), METHOD_CHANGED, "", 0.01, 0.001),), "bench")
    with pytest.raises(InputError, match="an event's kind is 'method changed'"):
        Event(at(1.0), METHOD_CHANGED)


@on_sqlite
def test_an_axis_is_switched_once_and_only_to_results_that_all_runs_with_raw_files_have(
    store: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    choose = simulate(monkeypatch)
    for day in range(3):
        add_day(store, tmp_path, day)
    paper = AnalysisOptions(method="paper")
    with pytest.raises(InputError, match="the axis 'bench' is not switched: its runs have no new result"):
        switch_axis(store, "bench", paper)
    choose(2)
    add_day(store, tmp_path, 3)
    with pytest.raises(InputError, match="is not switched: 3 runs have no new result; 'store exclude' them"):
        switch_axis(store, "bench", AnalysisOptions())
    assert store.show("bench")["method"]["revision"] == 1
    store.reprocess(switch=True)
    for _ in range(2):
        switch_axis(store, "bench", AnalysisOptions())
    with store.read() as session:
        assert len(session.scalars(select(Audit).where(Audit.action == "switch")).all()) == 1
    assert store.show("bench")["method"]["revision"] == 2
