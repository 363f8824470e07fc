"""A store answers as the files that were added to it, whatever their order, on both databases."""

from __future__ import annotations

import json
import os
from contextlib import AbstractContextManager
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import zstandard
from sqlalchemy import select
from tests.monitoring.histories import at
from tests.store.conftest import NewStore
from tests.store.stored import EVENTS, MODEL, RUNS, count, fill, text_of

import ballscrew
from ballscrew.base.errors import InputError
from ballscrew.base.provenance import digest
from ballscrew.calibration.modelfile import model_json
from ballscrew.modal.amend import amend
from ballscrew.monitoring.epochs import Event
from ballscrew.store import assessing
from ballscrew.store.adding import add_events, add_model, add_run
from ballscrew.store.alarms import state_by
from ballscrew.store.assessment_rows import _alarms
from ballscrew.store.folder import DataFolder
from ballscrew.store.histories import read_stored_history
from ballscrew.store.reading import relative_stiffness
from ballscrew.store.rows import pack, unpack
from ballscrew.store.service_tables import AlarmAction
from ballscrew.store.store import Store
from ballscrew.store.tables import (
    AlarmRow,
    Assessment,
    Audit,
    Conflict,
    Correction,
    EventRow,
    RunRow,
    StateRow,
)


def test_monitor_of_a_store_is_that_of_its_files(store: Store) -> None:
    fill(store, seed=1)
    stored = store.monitor("bench").monitored
    assert text_of(stored) == text_of(ballscrew.monitor(RUNS, MODEL, events=EVENTS))


def test_the_trend_that_is_read_is_that_of_monitor(filled: Store) -> None:
    states = {run.reading.run: run for run in filled.monitor("bench").monitored.state.runs}
    shown = filled.show("bench")
    assert [run["run"] for run in shown["runs"]] == [run.id for run in RUNS]
    for run in shown["runs"]:
        stiffness = states[run["run"]].stiffness
        assert run["state"] == states[run["run"]].state
        assert run["stiffness"] == pytest.approx([stiffness.value, *stiffness.interval], rel=1e-9)
    (axis,) = filled.list()["axes"]
    assert axis["state"] == shown["state"] == "alarm"
    assert axis["runs"] == len(RUNS)
    assert axis["rul_days"].keys() == {"0.05", "0.1", "0.25", "0.5", "0.75", "0.9", "0.95"}


def test_the_same_content_any_number_of_times_is_added_once(filled: Store) -> None:
    rows = count(filled, RunRow), count(filled, Audit)
    assert not add_run(filled, RUNS[0]).is_new
    assert not add_model(filled, MODEL).is_new
    assert not add_events(filled, EVENTS, "bench").is_new
    renamed = replace(RUNS[1], files=(replace(RUNS[1].files[0], name="b.h5"),))
    assert not add_run(filled, renamed).is_new
    filled.monitor("bench")
    audits = count(filled, Audit)
    filled.monitor("bench")
    assert (count(filled, RunRow), count(filled, AlarmRow)) == (rows[0], 1)
    assert count(filled, Audit) == audits


def test_the_same_run_with_other_content_is_refused_and_stored_aside(filled: Store) -> None:
    cell = replace(RUNS[0].cells[0], frequency_Hz=RUNS[0].cells[0].frequency_Hz * 1.001)
    other = replace(RUNS[0], cells=(cell, *RUNS[0].cells[1:]))
    for _ in range(2):
        with pytest.raises(InputError, match="another result of the run"):
            add_run(filled, other)
    assert count(filled, Conflict) == 1
    with filled.read() as session:
        assert read_stored_history(session, "bench").runs[0] == RUNS[0]


def test_an_alarm_that_no_longer_follows_is_retracted_and_not_deleted(filled: Store) -> None:
    assert filled.monitor("bench").monitored.state.state == "alarm"
    for run in RUNS[5:]:
        filled.exclude(run.id, reason="test")
    assert filled.monitor("bench").monitored.state.state == "normal"
    (alarm,) = filled.show("bench")["alarms"]
    assert alarm["retracted_at"] is not None
    for run in RUNS[5:]:
        filled.exclude(run.id, undo=True)
    assert filled.monitor("bench").monitored.state.state == "alarm"
    (alarm,) = filled.show("bench")["alarms"]
    assert alarm["retracted_at"] is None


def test_an_excluded_run_does_not_count_and_an_event_neither(filled: Store) -> None:
    filled.exclude(RUNS[3].id, reason="the table was loaded")
    event = filled.show("bench")["events"][1]["digest"]
    filled.exclude(event[:10], reason="it was another axis")
    found = filled.monitor("bench").monitored
    others = [run for run in RUNS if run is not RUNS[3]]
    assert text_of(found) == text_of(ballscrew.monitor(others, MODEL, events=EVENTS[:1]))
    assert [row["reason"] for row in filled.show("bench")["exclusions"]] == [
        "the table was loaded", "it was another axis"
    ]  # fmt: skip
    with pytest.raises(InputError, match="needs a reason"):
        filled.exclude(RUNS[4].id)


def test_a_corrected_run_counts_with_its_new_time_and_the_old_one_stays(filled: Store) -> None:
    new = filled.correct(RUNS[5].id, measured_at=at(15.5), reason="wrong clock")
    assert filled.correct(RUNS[5].id, measured_at=at(15.5)) == new
    expected = [*RUNS[:5], *RUNS[6:], amend(RUNS[5], measured_at=at(15.5))]
    assert text_of(filled.monitor("bench").monitored) == text_of(
        ballscrew.monitor(expected, MODEL, events=EVENTS)
    )
    assert count(filled, Correction) == 1
    with pytest.raises(InputError, match="was corrected already"):
        filled.correct(RUNS[5].id, measured_at=at(16.0))
    filled.exclude(RUNS[5].id, reason="the old version")
    assert new not in {run.reading.run for run in filled.monitor("bench").monitored.state.runs}


def test_of_two_corrections_as_files_the_one_added_last_counts(filled: Store) -> None:
    one, other = (amend(RUNS[5], measured_at=at(day)) for day in (15.5, 16.5))
    assert add_run(filled, one).notes == ()
    assert "was corrected before" in add_run(filled, other).notes[0]
    expected = [*RUNS[:5], *RUNS[6:], other]
    assert text_of(filled.monitor("bench").monitored) == text_of(
        ballscrew.monitor(expected, MODEL, events=EVENTS)
    )
    counting = {run["run"]: run["counts"] for run in filled.show("bench")["runs"]}
    assert [counting[run.id] for run in (RUNS[5], one, other)] == [False, False, True]
    with pytest.raises(InputError, match=f"correct the run '{other.id[:12]}'"):
        filled.correct(one.id, measured_at=at(17.5))
    third = filled.correct(other.id, measured_at=at(15.5), reason="the first was right")
    assert third in {run.reading.run for run in filled.monitor("bench").monitored.state.runs}


def test_a_run_of_the_recordings_of_another_is_refused_with_what_to_do(filled: Store) -> None:
    corrected = filled.correct(RUNS[5].id, measured_at=at(15.5), reason="wrong clock")
    again = replace(RUNS[5], id="again", measured_at=at(50.0))
    match = f"'.*' belongs to the run '{corrected[:12]}' .*correct that run .*'ballscrew store exclude'"
    with pytest.raises(InputError, match=match):
        add_run(filled, again)
    unlinked = amend(amend(RUNS[5], measured_at=at(51.0)), measured_at=at(52.0))
    with pytest.raises(InputError, match=match):
        add_run(filled, unlinked)  # the correction in between is not in the store
    for run in (RUNS[5], RUNS[4]):
        assert not add_run(filled, run).is_new
    assert count(filled, RunRow) == len(RUNS) + 1
    filled.exclude(corrected, reason="wrong clock")
    assert add_run(filled, again).is_new


@pytest.mark.parametrize("channels", [None, "another"])
def test_a_recording_of_another_axis_is_refused_unless_the_channels_differ(
    store: Store, channels: str | None
) -> None:
    """Two axes may be recorded in one file."""
    run = replace(RUNS[0], made=replace(RUNS[0].made, inputs=RUNS[0].made.inputs | {"channels": "one"}))
    add_run(store, run)
    inputs = run.made.inputs | {"channels": channels or "one"}
    other = replace(run, id="other", axis="Y axis", made=replace(run.made, inputs=inputs))
    if channels is not None:
        assert add_run(store, other).is_new
        return
    with pytest.raises(
        InputError, match="of the axis 'bench' already: send the recordings of the axis 'Y axis'"
    ):
        add_run(store, other)


def test_runs_that_share_a_recording_are_listed_with_what_to_do(filled: Store) -> None:
    """Of a store of an earlier version, or by a person who includes a run again."""
    filled.exclude(RUNS[5].id, reason="a copy")
    another = replace(RUNS[5], id="another", measured_at=at(50.0))
    add_run(filled, another)
    filled.exclude(RUNS[5].id, undo=True)
    with pytest.raises(InputError, match=r"the same recording, .*\('ballscrew store exclude'\)"):
        filled.monitor("bench")
    (pair,) = filled.show("bench")["shared_recordings"]
    assert pair == {"runs": [RUNS[5].id, "another"], "recording": RUNS[5].files[0].name}
    filled.exclude("another", reason="the recordings of another run")
    assert RUNS[5].id in {run.reading.run for run in filled.monitor("bench").monitored.state.runs}
    assert filled.show("bench")["shared_recordings"] == []


def test_conflicts_and_corrections_are_shown(filled: Store) -> None:
    for other in (replace(RUNS[0], cells=RUNS[0].cells[1:]), replace(RUNS[1], mass_kg=50.0)):
        with pytest.raises(InputError, match="'ballscrew store show' lists"):
            add_run(filled, other)
    new = filled.correct(RUNS[5].id, measured_at=at(15.5), reason="wrong clock")
    as_file = amend(RUNS[6], measured_at=at(18.5))
    add_run(filled, as_file)
    shown = filled.show("bench")
    assert [(row["run"], row["differs"]) for row in shown["conflicts"]] == [
        (RUNS[0].id, ["result"]), (RUNS[1].id, ["mass_kg"])
    ]  # fmt: skip
    corrections = [
        [row[key] for key in ("run", "supersedes", "old", "reason")] for row in shown["corrections"]
    ]
    assert corrections == [
        [new, RUNS[5].id, RUNS[5].measured_at, "wrong clock"],
        [as_file.id, RUNS[6].id, RUNS[6].measured_at, ""],
    ]  # fmt: skip


def test_a_run_is_shown_with_what_its_numbers_come_from(filled: Store) -> None:
    new = filled.correct(RUNS[5].id, measured_at=at(15.5), reason="wrong clock")
    filled.monitor("bench")
    document = filled.show(new[:12])
    (result,) = document["results"]
    assert (document["run"], document["supersedes"], document["counts"]) == (new, RUNS[5].id, True)
    assert [file["sha256"] for file in document["recordings"]] == [file.sha256 for file in RUNS[5].files]
    assert (result["method"], result["revision"], result["version"]) == ("joint", 1, RUNS[5].made.version)
    assert result["settings"] == RUNS[5].made.settings
    assert result["history"] is True
    assert document["state"]["reference"] == RUNS[0].id
    assert document["state"]["model_digest"] == digest(model_json(MODEL))
    assert filled.show(RUNS[5].id)["corrected_as"] == [new]


@pytest.mark.skipif(os.name == "nt", reason="Windows has other permissions")
def test_others_cannot_read_the_url_of_a_database(tmp_path: Path) -> None:
    DataFolder(tmp_path).create("postgresql://db/plant?user=u&password=secret")
    assert (tmp_path / "store.toml").stat().st_mode & 0o777 == 0o600


@pytest.mark.parametrize("name", ["", " ", "\u2003", "X\naxis", "X\x1b[2J", "X\udcff", "X\0axis"])
def test_a_blank_name_and_control_characters_are_refused(store: Store, name: str) -> None:
    with pytest.raises(InputError, match=r"must not be blank|control characters|names no axis"):
        add_run(store, replace(RUNS[0], axis=name))
    with pytest.raises(InputError, match=r"must not be blank|control characters|is not valid Unicode"):
        add_events(store, EVENTS, name)
    with pytest.raises(InputError, match=r"must not be blank|control characters"):
        add_run(store, replace(RUNS[0], id=name))
    assert store.list()["axes"] == []


@pytest.mark.parametrize("name", ["X axis ", " X axis", "X  axis", "X\u200b axis", "X\u2003axis"])
def test_a_name_that_looks_like_another_is_refused(store: Store, name: str) -> None:
    with pytest.raises(InputError, match=r"blanks, or have two in a row|invisible characters"):
        add_run(store, replace(RUNS[0], axis=name))
    assert store.list()["axes"] == []


def test_an_event_in_the_future_is_refused(filled: Store) -> None:
    with pytest.raises(InputError, match="nut replaced at 2090-01-01T00:00Z lies in the future"):
        add_events(filled, (Event("2090-01-01T00:00Z", "nut replaced", "a"),), "bench")


def test_a_correction_that_changes_nothing_is_refused(filled: Store) -> None:
    with pytest.raises(InputError, match="has this time and load already"):
        filled.correct(RUNS[0].id, measured_at=RUNS[0].measured_at, reason="a test")


@pytest.mark.parametrize("text", ["with \0", "with \udcff"])
def test_a_text_that_a_database_cannot_store_is_refused(store: Store, text: str) -> None:
    fill(store, RUNS[:1])
    for action in (
        lambda: store.exclude(RUNS[0].id, reason=text),
        lambda: store.correct(RUNS[0].id, measured_at=at(1.0), reason=text),
        lambda: store.choose_model("bench", "a", reason=text),
        lambda: add_events(store, (Event(at(1.0), "note", text),), "bench"),
    ):
        with pytest.raises(InputError, match="must be valid Unicode without NUL"):
            action()
    with pytest.raises(InputError, match=r"the text .*udcff.* is not valid Unicode"):
        store.show("with \udcff")


def test_a_store_that_can_only_be_read_is_assessed_and_nothing_is_stored(filled: Store) -> None:
    filled.folder.mark_damaged(["test"])
    found = filled.monitor("bench")
    assert text_of(found.monitored) == text_of(ballscrew.monitor(RUNS, MODEL, events=EVENTS))
    assert "The result is not stored: " in found.notes[0]
    assert "damaged and only read" in found.notes[0]
    assert count(filled, StateRow) == 0
    filled.folder.mark_damaged([])
    with filled.folder.locked("ballscrew serve", serving=True):
        assert "in use by ballscrew serve" in filled.monitor("bench").notes[0]
    assert filled.monitor("bench").notes == ()


def test_a_second_model_is_used_once_it_is_chosen(filled: Store) -> None:
    other = replace(MODEL, chi2=41.0)
    key = add_model(filled, other).subject
    with pytest.raises(InputError, match="has 2 models of the axis 'bench'"):
        filled.monitor("bench")
    assert filled.choose_model("bench", key[:12], reason="calibrated again") == key
    assert filled.monitor("bench").monitored.state.axis == "bench"


def test_any_order_of_addition_gives_the_same_answers(new_store: NewStore) -> None:
    answers = set()
    for seed in range(3):
        store = new_store()
        fill(store, RUNS[:6], seed=seed)
        document = store.monitor("bench").monitored.to_json()
        shown = store.show("bench")
        fields = ("runs", "state", "stiffness", "rul_days", "urgency", "method")
        answers.add(json.dumps([document, *(shown[name] for name in fields)], sort_keys=True))
    assert len(answers) == 1


def test_a_run_without_a_time_is_stored_and_part_of_no_history(filled: Store) -> None:
    untimed = replace(RUNS[0], id="without", measured_at=None, files=())
    assert "has no time" in add_run(filled, untimed).notes[0]
    assert filled.monitor("bench").notes == ("1 of the runs have no time and are no part of the history.",)


def test_what_is_wrong_is_a_sentence(store: Store, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="is not a store; 'ballscrew store init"):
        Store(tmp_path / "nothing")
    with pytest.raises(InputError, match="has no axis 'bench'; it has none"):
        store.show("bench")
    with pytest.raises(InputError, match="names no axis"):
        add_run(store, replace(RUNS[0], axis=None))
    with pytest.raises(InputError, match="a year from 1970 to 2100"):
        add_run(store, replace(RUNS[0], measured_at="0001-01-01T00:00Z"))
    with pytest.raises(InputError, match="has 3000 characters"):
        add_run(store, replace(RUNS[0], id="x" * 3000))
    add_model(store, MODEL)
    with pytest.raises(InputError, match="has no axis 'nothing'; it has 'bench'"):
        store.show("nothing")
    with pytest.raises(InputError, match="no run of the axis 'bench'"):
        store.monitor("bench")
    with pytest.raises(InputError, match="has no run"):
        store.exclude("run", reason="test")
    assert count(store, RunRow) == 0


def test_a_state_is_unknown_after_a_change_of_the_history(store: Store) -> None:
    def state() -> tuple[str, str]:
        (row,) = store.list()["axes"]
        assert store.show("bench")["state"] == row["state"]
        return row["state"], row["last_state"]

    fill(store, RUNS[:6])
    known = store.monitor("bench").monitored.state.state
    assert state() == (known, known)
    for change in (
        lambda: add_run(store, RUNS[6]),
        lambda: store.exclude(RUNS[6].id, reason="loose sensor"),
        lambda: store.exclude(RUNS[6].id, undo=True),
        lambda: store.correct(RUNS[1].id, measured_at=at(40.0), reason="clock"),
        lambda: add_events(store, (Event(at(30.0), "greased"),), "bench"),
    ):
        change()
        assert state() == ("unknown", known)
        known = store.monitor("bench").monitored.state.state
        assert state() == (known, known)


def test_a_refused_run_creates_no_axis(filled: Store) -> None:
    with pytest.raises(InputError, match="another result"):
        add_run(filled, replace(RUNS[0], axis="other"))
    assert [row["axis"] for row in filled.list()["axes"]] == ["bench"]


def test_an_id_that_a_run_and_an_event_begin_with_is_refused(filled: Store) -> None:
    (event,) = [row["digest"] for row in filled.show("bench")["events"] if row["kind"] == "greased"]
    add_run(filled, replace(RUNS[0], id=f"{event[:3]}run", measured_at=at(60.0), files=()))
    with pytest.raises(InputError, match="give more of the id"):
        filled.exclude(event[:3], reason="test")
    assert filled.exclude(event, reason="test") == event


def test_a_second_init_that_waits_for_the_first_leaves_its_store(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The first ends between the second's look at the folder and its lock."""
    locked = DataFolder.locked

    def locked_late(folder: DataFolder, purpose: str) -> AbstractContextManager[None]:
        monkeypatch.setattr(DataFolder, "locked", locked)
        add_events(Store.init(tmp_path / "store"), EVENTS, "bench")
        return locked(folder, purpose)

    monkeypatch.setattr(DataFolder, "locked", locked_late)
    with pytest.raises(InputError, match="is a store already"):
        Store.init(tmp_path / "store")
    assert count(Store(tmp_path / "store"), EventRow) == len(EVENTS)


@pytest.mark.parametrize("new_url", ["sqlite"], indirect=True)
def test_an_assessment_is_given_up_where_runs_are_added_all_the_time(
    filled: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(assessing, "_ATTEMPTS", 2)
    calls = []
    monkeypatch.setattr(assessing, "store_assessment", lambda *given: calls.append(given))
    with pytest.raises(InputError, match="runs of bench are added all the time; try again"):
        filled.monitor("bench")
    assert len(calls) == 2


@pytest.mark.parametrize("new_url", ["sqlite"], indirect=True)
def test_the_newest_assessment_is_made_again_unless_its_duty_is_unknown_or_a_run_came(
    filled: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    expected = filled.monitor("bench").monitored
    with filled.read() as session:
        row = session.scalars(select(Assessment)).one()
        inputs, stated = row.inputs, row.settings
    found = assessing.newest_assessment(filled, "bench", inputs, stated)
    assert found is not None
    assert text_of(found) == text_of(expected)
    assert assessing.newest_assessment(filled, "bench", "", stated) is None
    with monkeypatch.context() as patch:
        patch.setattr(assessing, "inputs_of", lambda *_: inputs)
        other = {**stated, "duty": "DutyCounters(…)"}
        assert assessing.newest_assessment(filled, "bench", inputs, other) is None
    compute = assessing.compute_assessment

    def add_and_compute(*given: Any, **options: Any) -> Any:
        filled.exclude(RUNS[-1].id, reason="a test")
        return compute(*given, **options)

    monkeypatch.setattr(assessing, "compute_assessment", add_and_compute)
    assert assessing.newest_assessment(filled, "bench", inputs, stated) is None


def test_an_alarm_of_the_newest_epoch_stands_also_where_its_run_is_suspect() -> None:
    def run(state: str, number: int) -> Any:
        reading = SimpleNamespace(epoch=0, measured_at=at(float(number)))
        return SimpleNamespace(state=state, reading=reading)

    def alarms(*states: str, alarm_at: str | None = None) -> list[tuple[int, str]]:
        epoch = SimpleNamespace(number=0, alarm_at=alarm_at)
        runs = [run(state, number) for number, state in enumerate(states)]
        state: Any = SimpleNamespace(runs=runs, epochs=[epoch])
        return _alarms(state)

    assert alarms("normal", "normal") == []
    assert alarms("normal", "alarm", "suspect", "alarm", alarm_at=at(1.0)) == [(0, at(1.0))]
    assert alarms("alarm", "normal", "alarm") == [(0, at(0.0)), (0, at(2.0))]
    assert alarms("normal", "suspect", alarm_at=at(1.0)) == [(0, at(1.0))]


def test_a_stiffness_that_is_not_positive_or_has_no_width_has_no_interval() -> None:
    epoch: Any = SimpleNamespace(coefficients=[0.0], covariance=[[1e-6]], scale=1.0, share_uncertainty=0.0)
    design = np.ones(1).tobytes()
    rows = [
        (level, random, 0.0, 0.0, design)
        for level, random in ((0.0, 1e-3), (-2.0, 1e-3), (0.0, np.inf), (0.0, np.nan))
    ]
    first, *others = relative_stiffness(rows, epoch)
    assert first == pytest.approx([1.0, 0.9917, 1.0083], abs=1e-3)
    assert others == [None, None, None]


def test_a_damaged_document_is_a_sentence() -> None:
    assert unpack(pack({"a": [1.5]})) == {"a": [1.5]}
    for content in (b"", b"x", pack({"a": 1})[:-1], zstandard.compress(b"{")):
        with pytest.raises(InputError, match="a document in the store cannot be read: the database is dam"):
            unpack(content)


@pytest.mark.parametrize(("until", "state"), [(at(1.0), "raised"), (at(2.0), "raised"), (at(2.1), "shelved")])
def test_an_alarm_that_was_shelved_is_raised_again_at_its_time(until: str, state: str) -> None:
    action = AlarmAction(action="shelved", until=until)
    time = datetime.fromisoformat(at(2.0))
    assert state_by(action, None, time) == state
    assert state_by(action, "ended", time) == "ended"
