"""Experiments on the testbed: simulated run by run, and, where asked for, analysed and deleted at once."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from ballscrew.base.errors import InputError
from ballscrew.base.files import Progress, sweep, write_text
from ballscrew.base.jsonfile import write_json
from ballscrew.modal.analyze import analyze
from ballscrew.modal.run import Run
from ballscrew.testbed.experiments import PlannedRun, recorded
from ballscrew.testbed.run import RunFiles, simulate_run, truth


@dataclass(frozen=True, slots=True)
class Measured:
    """One run of an experiment with its result.

    Parameters
    ----------
    planned : PlannedRun
        The run as planned, with the state of the machine.
    run : Run
        Result of ``analyze`` on its recordings.
    truth : dict
        True values of that day, as in ``truth.json``.
    """

    planned: PlannedRun
    run: Run
    truth: dict[str, object]


def check_space(planned: Sequence[PlannedRun], folder: Path, *, keep: bool) -> str:
    """Size of an experiment's recordings in words, after a check that the disk has space for them.

    Parameters
    ----------
    planned : sequence of PlannedRun
        The experiment.
    folder : path-like
        Folder of the recordings; made if absent.
    keep : bool
        Whether all recordings stay, rather than each run's until it is analysed.

    Returns
    -------
    str
        A sentence: number of recordings, their size, and whether they stay.

    Raises
    ------
    InputError
        If the folder cannot be written to, or has too little free space.
    """
    files, size = recorded(planned)
    needed = size if keep else max(recorded([run])[1] for run in planned)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        free = shutil.disk_usage(folder).free
    except OSError as error:
        raise InputError(f"{folder}: cannot be written ({error.strerror or error}).") from None
    if free < needed:
        raise InputError(
            f"{folder}: {_bytes(needed)} are needed and {_bytes(free)} are free; choose another --out."
        )
    fate = "stay" if keep else "are deleted as they are analysed"
    return f"{files} recording{'s' if files > 1 else ''}, {_bytes(size)}: they {fate}."


def simulated_runs(
    planned: Sequence[PlannedRun], folder: Path, progress: Progress
) -> Iterator[tuple[PlannedRun, RunFiles]]:
    """Simulate one run after the other, each into a folder of its own name."""
    total = recorded(planned)[0]
    done = 0
    for run in planned:
        report = _run_progress(progress, run.name, done, total)
        files = simulate_run(
            run.rig,
            run.plan,
            run.load,
            folder / run.name,
            seed=run.seed,
            measured_at=run.measured_at,
            progress=report,
        )
        done += len(files.recordings)
        yield run, files


def _run_progress(progress: Progress, name: str, before: int, total: int) -> Progress:
    """Progress of the experiment from the progress of one of its runs."""

    def report(done: int, _: int, file: str) -> None:
        progress(before + done, total, f"{name}/{file}")

    return report


def measured_runs(
    planned: Sequence[PlannedRun],
    out: Path,
    progress: Progress,
    *,
    keep: bool = False,
    inspect: Callable[[PlannedRun, RunFiles, Run], None] | None = None,
) -> Iterator[Measured]:
    """Simulate and analyse one run after the other; each RUN.json stays in ``out/runs``.

    Parameters
    ----------
    planned : sequence of PlannedRun
        The experiment.
    out : path-like
        Its folder. Recordings lie in a temporary folder inside it, or in ``out/recordings``.
    progress : callable
        Called with how many recordings are done, how many there are, and the last one's name.
    keep : bool
        Whether recordings stay.
    inspect : callable, optional
        Called with each run while its recordings exist.

    Yields
    ------
    Measured
        In the same order.

    Raises
    ------
    InputError
        If recordings are to stay where some exist already.
    """
    results = out / "runs"
    results.mkdir(parents=True, exist_ok=True)
    with _recordings_folder(out, keep=keep) as recordings:
        for planned_run, files in simulated_runs(planned, recordings, progress):
            run = analyze(files.run)
            if inspect is not None:
                inspect(planned_run, files, run)
            if not keep:
                shutil.rmtree(files.run.parent)
            write_text(results / f"{planned_run.name}.json", write_json(run.to_json()) + "\n")
            yield Measured(planned_run, run, truth(planned_run.rig, planned_run.plan, planned_run.load))


@contextmanager
def _recordings_folder(out: Path, *, keep: bool) -> Iterator[Path]:
    """A new folder for recordings: files that lay in ``out`` before are never touched."""
    if keep:
        folder = out / "recordings"
        try:
            folder.mkdir()
        except FileExistsError:
            raise InputError(f"{folder}: exists already; move it, or choose another --out.") from None
        yield folder
        return
    sweep(out, "recordings-????????")
    with tempfile.TemporaryDirectory(prefix="recordings-", dir=out, ignore_cleanup_errors=True) as name:
        yield Path(name)


def _bytes(size: int) -> str:
    return f"{size / 1e9:.1f} GB" if size >= 1e8 else f"{size / 1e6:.0f} MB"
