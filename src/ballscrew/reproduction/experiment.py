"""Experiments of the testbed: simulated run by run, and, where asked for, analysed and deleted at once."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from ballscrew.base.errors import InputError
from ballscrew.base.files import Progress, write_text
from ballscrew.base.jsonfile import write_json
from ballscrew.modal.analyze import analyze
from ballscrew.modal.run import Run
from ballscrew.testbed.experiments import PlannedRun, recorded
from ballscrew.testbed.run import RunFiles, simulate_run, truth

__all__ = ["Measured", "check_space", "measured_runs", "simulated_runs"]


@dataclass(frozen=True, slots=True)
class Measured:
    """One run of an experiment: what it was, and what its recordings say.

    Parameters
    ----------
    planned : PlannedRun
        With the machine as it was.
    run : Run
        What ``analyze`` made of the recordings.
    truth : dict
        Of that day, as in ``truth.json``.
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
        Where the recordings go; made if absent.
    keep : bool
        Whether all recordings stay, rather than each run's until it is analysed.

    Returns
    -------
    str
        A sentence: number of recordings, their size, and whether they stay.

    Raises
    ------
    InputError
        If there is less free space than the recordings take that are there at once.
    """
    files, size = recorded(planned)
    most = size if keep else max(recorded([run])[1] for run in planned)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        free = shutil.disk_usage(folder).free
    except OSError as error:
        raise InputError(f"{folder}: cannot be written ({error.strerror or error}).") from None
    if free < most:
        raise InputError(
            f"{folder}: {_bytes(most)} are needed and {_bytes(free)} are free; choose another --out."
        )
    fate = "stay" if keep else "are deleted as they are analysed"
    return f"{files} recording{'s' if files > 1 else ''}, {_bytes(size)}: they {fate}."


def simulated_runs(
    planned: Sequence[PlannedRun], folder: Path, report: Progress
) -> Iterator[tuple[PlannedRun, RunFiles]]:
    """Simulate one run after the other, each into a folder of its own name."""
    total, done = recorded(planned)[0], 0
    for one in planned:
        before = done

        def step(count: int, _: int, file: str, *, before: int = before, name: str = one.name) -> None:
            report(before + count, total, f"{name}/{file}")

        files = simulate_run(
            one.rig,
            one.plan,
            one.load,
            folder / one.name,
            seed=one.seed,
            measured_at=one.measured_at,
            progress=step,
        )
        done += len(files.recordings)
        yield one, files


def measured_runs(
    planned: Sequence[PlannedRun],
    out: Path,
    report: Progress,
    *,
    keep: bool = False,
    look: Callable[[PlannedRun, RunFiles, Run], None] | None = None,
) -> Iterator[Measured]:
    """Simulate and analyse one run after the other; what ``analyze`` says stays in ``out/runs``.

    Parameters
    ----------
    planned : sequence of PlannedRun
        The experiment.
    out : path-like
        Its folder; recordings lie in a new folder in it while they are needed, or in ``out/recordings``.
    report : callable
        Called with how many recordings are done, how many there are, and the last one's name.
    keep : bool
        Whether recordings stay.
    look : callable, optional
        Called with each run while its recordings are there.

    Yields
    ------
    Measured
        In the same order.

    Raises
    ------
    InputError
        If recordings shall stay where some are already.
    """
    results = out / "runs"
    results.mkdir(parents=True, exist_ok=True)
    with _recordings(out, keep=keep) as raw:
        for one, files in simulated_runs(planned, raw, report):
            run = analyze(files.run)
            if look is not None:
                look(one, files, run)
            if not keep:
                shutil.rmtree(files.run.parent)
            text = write_json(run.to_json()) + "\n"
            write_text(results / f"{one.name}.json", text)
            yield Measured(one, run, truth(one.rig, one.plan, one.load))


@contextmanager
def _recordings(out: Path, *, keep: bool) -> Iterator[Path]:
    """A folder of our own for recordings: nothing that lay in ``out`` before is ever touched."""
    if keep:
        kept = out / "recordings"
        try:
            kept.mkdir()
        except FileExistsError:
            raise InputError(f"{kept}: is there already; move it, or say another --out.") from None
        yield kept
        return
    with tempfile.TemporaryDirectory(prefix="recordings-", dir=out, ignore_cleanup_errors=True) as folder:
        yield Path(folder)


def _bytes(size: int) -> str:
    return f"{size / 1e9:.1f} GB" if size >= 1e8 else f"{size / 1e6:.0f} MB"
