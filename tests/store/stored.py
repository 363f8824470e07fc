"""Runs, model and events that the tests add to a store, and recordings that a stand-in analyses."""

from __future__ import annotations

import random
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import func, select
from tests.estimation.made_runs import calibrated, run_of
from tests.monitoring.histories import at, history, worn

from ballscrew.base.jsonfile import write_json
from ballscrew.base.provenance import FileRef, Made, hash_file
from ballscrew.modal.analyze import Analysis, AnalysisOptions
from ballscrew.modal.job import Job
from ballscrew.modal.run import Run
from ballscrew.monitoring.epochs import Event
from ballscrew.store.adding import add_events, add_model, add_run
from ballscrew.store.opened import OpenStore

RUNS = [Run.from_json(run.to_json()) for run in history([3.0 * day for day in range(14)], worn(15, 100))]
MODEL = calibrated()
EVENTS = (Event(at(2.0), "note", "a note"), Event(at(4.5), "greased", "weekly"))


def fill(store: OpenStore, runs: list[Run] | None = None, *, seed: int | None = None) -> None:
    """Add runs, model and events, in an order by the seed."""
    actions = [lambda run=run: add_run(store, run) for run in runs or RUNS]
    actions += [lambda: add_model(store, MODEL), lambda: add_events(store, EVENTS, "bench")]
    if seed is not None:
        random.Random(seed).shuffle(actions)  # noqa: S311
    for action in actions:
        action()


def count(store: OpenStore, table: type) -> int:
    with store.read() as session:
        return int(session.scalar(select(func.count()).select_from(table)) or 0)


def text_of(result: Any) -> str:
    return write_json(result.to_json())


def write_recordings(folder: Path, day: float, content: bytes = b"trip ", files: int = 2) -> Path:
    """RUN.toml with recordings for :func:`imitate_analysis`."""
    folder.mkdir(parents=True)
    names = []
    for number in range(files):
        names.append(f"trip{number}.bin")
        (folder / names[-1]).write_bytes(content * (1000 + number) + f"{day} {number}".encode())
    (folder / "channels.toml").write_text('[[channel]]\nsource = "a"\nquantity = "torque"\nunit = "N m"\n')
    (folder / "run.toml").write_text(
        f'channels = "channels.toml"\nload = "100 kg"\nmeasured_at = {at(day)}\nfiles = {names}\n'
    )
    return folder / "run.toml"


def imitate_analysis(patched: pytest.MonkeyPatch, scale: float = 1.0) -> list[Job]:
    """Replace the analysis by one that takes no time; the jobs that it was called with."""
    jobs: list[Job] = []

    def examine(job: Job, options: AnalysisOptions, **_: Any) -> Analysis:
        jobs.append(job)
        files = tuple(FileRef(Path(str(file)).name, hash_file(file)) for file in job.files)  # type: ignore[arg-type]
        run = run_of(1.0, level=1e-4 * (scale - 1))
        run = replace(
            run, id=job.identity(files, job.measured_at), axis="bench", mass_kg=job.mass, files=files,
            measured_at=job.measured_at, temperature_C=job.temperature,
            made=Made(options.to_settings(), inputs=job.inputs()),
        )  # fmt: skip
        return Analysis(run, (), None)

    patched.setattr("ballscrew.modal.analyze.examine", examine)
    patched.setattr("ballscrew.store.analysing.examine", examine)
    return jobs
