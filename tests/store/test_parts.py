"""Runs of which one has all recordings of another: one counts, also after other results."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from tests.store.stored import MODEL, RUNS, write_recordings

from ballscrew.base.provenance import FileRef, Made, hash_file
from ballscrew.modal.analyze import Analysis, AnalysisOptions
from ballscrew.modal.job import Job
from ballscrew.modal.run import Run
from ballscrew.store import adding
from ballscrew.store.adding import add_model
from ballscrew.store.reading import current_rows, find_axis
from ballscrew.store.store import Store

TRIPS = tuple(FileRef(f"trip{number}.h5", f"{number:064x}") for number in range(3))
BAD = replace(RUNS[0].quality, verdict="bad", reasons=("the sensor is loose.",))
PART = replace(RUNS[0], id="part", files=TRIPS[:2])
WHOLE = replace(RUNS[0], id="whole", files=TRIPS)


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


@pytest.mark.parametrize("order", [(PART, WHOLE), (WHOLE, PART)])
def test_the_more_complete_run_counts(store: Store, tmp_path: Path, order: tuple[Run, ...]) -> None:
    folder = tmp_path / "runs"
    folder.mkdir()
    for run in order:
        add(store, folder, run)
    assert counting(store) == {"whole"}


def test_a_part_counts_as_long_as_the_newest_result_of_the_whole_is_bad_and_its_own_is_not(
    store: Store, tmp_path: Path
) -> None:
    folder = tmp_path / "runs"
    folder.mkdir()
    for run in (PART, WHOLE):
        add(store, folder, run)
    add(store, folder, another(WHOLE))
    assert counting(store) == {"part"}
    add(store, folder, another(PART))
    assert counting(store) == {"whole"}


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
    assert store.verify(store.path).faults == ()


@pytest.mark.parametrize("reason", ["a test", "part", "its recordings are a part of those of the run x"])
def test_what_a_person_excluded_stays_so(store: Store, tmp_path: Path, reason: str) -> None:
    folder = tmp_path / "runs"
    folder.mkdir()
    add(store, folder, PART)
    store.exclude("part", reason=reason)
    add(store, folder, WHOLE)
    add(store, folder, another(WHOLE))
    assert counting(store) == {"whole"}
