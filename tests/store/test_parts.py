"""Runs of which one has all recordings of another: one counts, also after other results."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import delete, select
from tests.store.conftest import NewStore
from tests.store.stored import MODEL, RUNS, write_recordings

from ballscrew.base.errors import InputError
from ballscrew.base.provenance import FileRef, Made, hash_file
from ballscrew.modal.analyze import Analysis, AnalysisOptions
from ballscrew.modal.job import Job
from ballscrew.modal.run import Run
from ballscrew.store import adding
from ballscrew.store.adding import add_model
from ballscrew.store.parts import _rank, recount_parts
from ballscrew.store.reading import current_rows, find_axis
from ballscrew.store.same_recordings import RecordedRun, SameRecordingError
from ballscrew.store.store import Store
from ballscrew.store.tables import CellRow, ResultRow, RunRow

TRIPS = tuple(FileRef(f"trip{number}.h5", f"{number:064x}") for number in range(4))
BAD = replace(RUNS[0].quality, verdict="bad", reasons=("the sensor is loose.",))
PART = replace(RUNS[0], id="part", files=TRIPS[:2])
WHOLE = replace(RUNS[0], id="whole", files=TRIPS[:3])
MORE = replace(RUNS[0], id="more", files=TRIPS)
BAD_PART, BAD_WHOLE = (replace(run, quality=BAD) for run in (PART, WHOLE))


def another(run: Run) -> Run:
    """A bad result of a run by other settings."""
    return replace(run, quality=BAD, made=replace(run.made, settings={**run.made.settings, "another": 1}))


def add(store: Store, folder: Path, run: Run) -> None:
    """Add RUN.json."""
    path = folder / f"{run.id}{len(list(folder.iterdir()))}.json"
    run.write(path)
    store.add(path)


def counting(store: Store) -> set[str]:
    """Ids of the runs that count."""
    with store.read() as session:
        return {row.run for row in current_rows(session, find_axis(session, "bench"))}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """An empty folder."""
    (tmp_path / "runs").mkdir()
    return tmp_path / "runs"


@pytest.mark.parametrize(
    ("runs", "expected"),
    [((PART, WHOLE), "whole"), ((PART, BAD_WHOLE), "part"), ((BAD_PART, BAD_WHOLE), "whole")],
)
def test_the_more_complete_run_counts_unless_it_alone_is_bad(
    new_store: NewStore, folder: Path, runs: tuple[Run, ...], expected: str
) -> None:
    for order in (runs, reversed(runs)):
        store = new_store()
        for run in order:
            add(store, folder, run)
        assert counting(store) == {expected}
        store.exclude(expected, reason="a test")
        assert counting(store) == {"part", "whole"} - {expected}


def test_a_result_by_other_settings_than_those_of_the_history_changes_nothing(
    store: Store, folder: Path
) -> None:
    for run in (PART, WHOLE, another(WHOLE)):
        add(store, folder, run)
    assert counting(store) == {"whole"}


def test_a_refused_result_changes_nothing(store: Store, folder: Path) -> None:
    for run in (PART, WHOLE):
        add(store, folder, run)
    store.exclude("part", undo=True)
    with pytest.raises(InputError, match="another result"):
        add(store, folder, replace(WHOLE, temperature_C=30.0))
    assert counting(store) == {"part", "whole"}


def test_a_person_excludes_what_was_excluded_as_a_part(store: Store, folder: Path) -> None:
    for run in (PART, WHOLE):
        add(store, folder, run)
    store.exclude("part", reason="a wrong load")
    store.exclude("whole", reason="a test")
    assert counting(store) == set()
    assert {row["reason"] for row in store.show("bench")["exclusions"] if row["ended_at"] is None} == {
        "a wrong load", "a test",
    }  # fmt: skip


def test_an_id_with_which_others_begin(store: Store, folder: Path) -> None:
    for name in ("trip10", "trip11", "trip1"):
        add(store, folder, replace(PART, id=name, files=(FileRef(name, f"{int(name[4:]):064x}"),)))
    assert counting(store) == {"trip10", "trip11", "trip1"}
    store.exclude("trip1", reason="a test")
    assert counting(store) == {"trip10", "trip11"}


@pytest.fixture
def choose(monkeypatch: pytest.MonkeyPatch) -> Callable[[int], None]:
    """Chooses the revision of a simulated analysis; by an odd one, runs of three recordings are bad."""
    revision = [1]

    def examine(job: Job, options: AnalysisOptions, **_: Any) -> Analysis:
        files = tuple(FileRef(Path(str(file)).name, hash_file(file)) for file in job.files)  # type: ignore[arg-type]
        is_bad = len(files) == 3 and revision[0] % 2 == 1
        run = replace(
            RUNS[0], id=job.identity(files, job.measured_at), axis="bench", mass_kg=job.mass, files=files,
            measured_at=job.measured_at, temperature_C=job.temperature,
            quality=BAD if is_bad else RUNS[0].quality, made=Made(options.to_settings(), inputs=job.inputs()),
        )  # fmt: skip
        return Analysis(run, (), None)

    monkeypatch.setattr("ballscrew.modal.analyze.examine", examine)
    monkeypatch.setattr("ballscrew.store.analysing.examine", examine)

    def chosen(number: int) -> None:
        revision[0] = number
        monkeypatch.setattr(adding, "METHOD_REVISION", number)

    return chosen


def test_a_switch_to_results_with_other_verdicts_changes_which_run_counts(
    store: Store, tmp_path: Path, choose: Callable[[int], None]
) -> None:
    add_model(store, MODEL)
    part = store.add(write_recordings(tmp_path / "part", 0.0, files=2)).subject
    whole = store.add(write_recordings(tmp_path / "whole", 0.0, files=3)).subject
    assert counting(store) == {part}
    choose(2)
    store.reprocess()
    assert counting(store) == {part}  # the new results are beside the old
    store.reprocess(switch=True)
    assert counting(store) == {whole}
    choose(3)
    store.reprocess(switch=True)
    assert counting(store) == {part}
    choose(4)
    store.reprocess(switch=True)
    assert counting(store) == {whole}
    assert store.verify(store.path).faults == ()


def test_a_part_that_a_person_includes_counts_after_a_switch_too(
    store: Store, tmp_path: Path, choose: Callable[[int], None]
) -> None:
    add_model(store, MODEL)
    part, more, whole = (
        store.add(write_recordings(tmp_path / str(files), 0.0, files=files)).subject for files in (1, 2, 3)
    )
    assert counting(store) == {more}
    store.exclude(part, undo=True)
    choose(2)
    store.reprocess(switch=True)
    assert counting(store) == {part, whole}


@pytest.mark.parametrize(("whole", "included"), [(WHOLE, "part"), (BAD_WHOLE, "whole")])
@pytest.mark.parametrize("newer", [PART, WHOLE])
def test_a_run_that_a_person_includes_counts_after_newer_results_too(
    store: Store, folder: Path, whole: Run, included: str, newer: Run
) -> None:
    for run in (PART, whole):
        add(store, folder, run)
    store.exclude(included, reason="the run of Monday does not count.", undo=True)
    add(store, folder, another(newer))
    assert counting(store) == {"part", "whole"}
    corrected = store.correct(newer.id, measured_at="2026-01-07T09:00Z", reason="wrong clock")
    assert counting(store) == {"part", "whole", corrected} - {newer.id}


def test_a_person_includes_a_part_beside_the_runs_of_that_time_not_later_ones(
    store: Store, folder: Path
) -> None:
    for run in (PART, WHOLE):
        add(store, folder, run)
    store.exclude("part", undo=True)
    add(store, folder, MORE)
    assert counting(store) == {"more"}
    store.exclude("more", reason="a test")
    assert counting(store) == {"part", "whole"}
    store.exclude("more", undo=True)
    assert counting(store) == {"more"}
    store.exclude("part", undo=True)
    for run in (WHOLE, MORE):
        add(store, folder, another(run))
    assert counting(store) == {"part", "more"}


def test_a_person_includes_a_part_beside_all_runs_of_that_time(store: Store, folder: Path) -> None:
    for run in (PART, WHOLE, MORE):  # the part is excluded for one that does not count either
        add(store, folder, run)
    store.exclude("part", undo=True)
    add(store, folder, another(MORE))
    assert counting(store) == {"part", "more"}


def test_a_part_that_was_included_as_such_is_excluded_as_a_bad_run(store: Store, folder: Path) -> None:
    add(store, folder, PART)
    store.exclude("part", reason="a test")
    for run in (BAD_WHOLE, replace(MORE, quality=BAD)):
        add(store, folder, run)
    store.exclude("whole", undo=True)
    assert counting(store) == {"whole", "more"}
    store.exclude("part", undo=True)
    assert counting(store) == {"part"}


def test_only_the_end_of_an_exclusion_by_a_person_who_includes_the_run_lasts(
    store: Store, folder: Path
) -> None:
    for run in (PART, WHOLE):
        add(store, folder, run)
    store.exclude("whole", reason="a test")
    assert counting(store) == {"part"}
    store.exclude("whole", undo=True)
    assert counting(store) == {"whole"}
    store.exclude("part", reason="a wrong load")
    store.exclude("part", undo=True)
    assert counting(store) == {"whole"}


@pytest.mark.parametrize("reason", ["a test", "part", "its recordings are a part of those of the run x"])
def test_what_a_person_excluded_stays_so(store: Store, folder: Path, reason: str) -> None:
    add(store, folder, PART)
    store.exclude("part", reason=reason)
    for run in (WHOLE, another(WHOLE)):
        add(store, folder, run)
    assert counting(store) == {"whole"}


@pytest.mark.parametrize(
    ("loads", "may"), [((None, None), True), ((100.0, None), False), ((None, 0.0), False), ((0.1, 0.1), True)]
)
def test_a_part_of_a_run_has_its_load_or_both_have_none(
    loads: tuple[float | None, float | None], may: bool
) -> None:
    part, whole = (
        RecordedRun.of(replace(run, mass_kg=mass), "bench")
        for run, mass in zip((PART, WHOLE), loads, strict=True)
    )
    if may:
        part.check(whole)
        return
    with pytest.raises(SameRecordingError, match="belongs to the run"):
        part.check(whole)


@pytest.mark.parametrize("new_url", ["sqlite"], indirect=True)
def test_only_the_exclusions_of_the_runs_that_are_concerned_are_counted_anew(
    store: Store, folder: Path
) -> None:
    """Another bad result makes the part count, once it is asked for."""
    for run in (PART, WHOLE):
        add(store, folder, run)
    assert counting(store) == {"whole"}
    with store.write("test") as session:
        axis = find_axis(session, "bench")
        (part,) = [row for row in session.scalars(select(RunRow)) if row.run == "part"]
        for row in session.scalars(select(ResultRow)):
            if row.run_id != part.id:
                row.verdict = "bad"
        recount_parts(session, axis, "test", [part.id + 100])
        assert {row.run for row in current_rows(session, axis)} == {"whole"}
        recount_parts(session, axis, "test", [part.id])
        assert {row.run for row in current_rows(session, axis)} == {"part"}


@pytest.mark.parametrize("new_url", ["sqlite"], indirect=True)
def test_a_run_without_a_result_is_the_least_of_two(store: Store, folder: Path) -> None:
    for run in (PART, BAD_WHOLE):
        add(store, folder, run)
    with store.write("test") as session:
        part, whole = session.scalars(select(RunRow).order_by(RunRow.id)).all()
        assert (_rank(session, part), _rank(session, whole)) == (2, 1)
        results = select(ResultRow.id).where(ResultRow.run_id == whole.id)
        session.execute(delete(CellRow).where(CellRow.result_id.in_(results)))
        session.execute(delete(ResultRow).where(ResultRow.run_id == whole.id))
        assert _rank(session, whole) == 0
        session.rollback()
