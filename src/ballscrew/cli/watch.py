"""``ballscrew watch``: analyse the runs that are new in a folder, and monitor the axis."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from ballscrew.base.errors import DONE, WRONG_INPUT, InputError
from ballscrew.base.files import check_folder, regular_target, write_text
from ballscrew.base.jsonfile import SCHEMA, write_json
from ballscrew.base.tomlfile import read_toml
from ballscrew.calibration.calibrated_axis import CalibratedAxis
from ballscrew.calibration.modelfile import read_model
from ballscrew.cli.monitor import health_status, parse_duty, print_headline, report_newest
from ballscrew.cli.output import check_outputs, console, print_json, progress_bar
from ballscrew.estimation.estimate import PreloadEstimate
from ballscrew.estimation.preload import preload
from ballscrew.modal.amend import SUPERSEDES
from ballscrew.modal.analyze import analyze
from ballscrew.modal.job import Job
from ballscrew.modal.run import Run
from ballscrew.monitoring.detection.settings import MonitorSettings
from ballscrew.monitoring.epochs import read_events
from ballscrew.prognosis.duty import DutyRecord
from ballscrew.prognosis.monitor import Monitored, monitor
from ballscrew.report.axis_page import axis_page

_PAGES = (".html", ".htm")
_SAME = 1e-6  # relative: RUN.json has nine digits


@dataclass(frozen=True, eq=False)
class WatchedAxis:
    """Result of :func:`watch`.

    Parameters
    ----------
    monitored : Monitored
        Health state and remaining life.
    runs : tuple of Run
        Runs of the history.
    analyzed : tuple of Path
        RUN.toml of each run that was new or had changed.
    failures : tuple of str
        Sentence for each run that is not part of the history, or has no preload.
    page : Path
        HTML page of the axis.
    """

    monitored: Monitored
    runs: tuple[Run, ...]
    analyzed: tuple[Path, ...]
    failures: tuple[str, ...]
    page: Path

    def to_json(self) -> dict[str, Any]:
        """Document that ``watch --json`` prints."""
        return {
            "schema": SCHEMA,
            "analyzed": [str(path) for path in self.analyzed],
            "failures": list(self.failures),
            "page": str(self.page),
            "monitor": self.monitored.to_json(),
        }


def watch(
    folder: str | Path,
    model: str | Path,
    *,
    events: str | Path | None = None,
    settings: MonitorSettings | None = None,
    duty: float | DutyRecord | None = None,
    accept: Sequence[str] = (),
    page: str | Path | None = None,
    analyze_run: Callable[[Path], Run] = analyze,
) -> WatchedAxis:
    """Analyse the runs that are new in a folder, monitor the axis, and write its HTML page.

    Beside each RUN.toml it writes the run (``run.json``) and its preload (``run.preload.json``). Every file
    is written whole, and nothing is written where nothing has changed.

    Parameters
    ----------
    folder : path-like
        Contains the runs, each a RUN.toml, at any depth.
    model : path-like
        MODEL.json of the axis.
    events : path-like, optional
        Events on the axis.
    settings : MonitorSettings, optional
        As for :func:`ballscrew.monitor`.
    duty : float or DutyRecord, optional
        As for :func:`ballscrew.monitor`.
    accept : sequence of str
        Names of reasons to doubt the calibration that were checked and are accepted.
    page : path-like, optional
        HTML file to write; by default ``axis.html`` in the folder.
    analyze_run : callable, optional
        Analyses a RUN.toml.

    Returns
    -------
    WatchedAxis
        A run that cannot be used is left out and reported in ``failures``.

    Raises
    ------
    InputError
        If the folder contains no usable run, model or events are wrong, or a file cannot be written.
    """
    folder = Path(folder)
    target = folder / "axis.html" if page is None else Path(page)
    _check_places(folder, target)
    axis = read_model(model)
    known_events = () if events is None else read_events(events)
    settings = settings or MonitorSettings()
    failures: list[str] = []
    runs: dict[Path, Run] = {}
    analyzed = []
    for source in _run_files(folder, failures):
        try:
            run, is_new = _current_run(source, folder, analyze_run)
        except InputError as error:
            failures.append(str(error))
            continue
        if is_new:
            analyzed.append(source)
        runs[source] = run
    history = _usable(runs, axis, failures)
    if not history:
        reason = f" {failures[0]}" if failures else ""
        raise InputError(f"{folder}: contains no run to monitor (a RUN.toml beside its recordings).{reason}")
    monitored = monitor(
        tuple(history.values()), axis, events=known_events, settings=settings, duty=duty, accept=accept
    )
    _write_preloads(history, monitored, axis, Path(model), settings, accept, failures)
    names = {run.id: source.relative_to(folder).as_posix() for source, run in history.items()}
    _write_changed(target, axis_page(monitored, names, failures))
    return WatchedAxis(monitored, tuple(history.values()), tuple(analyzed), tuple(failures), target)


def _check_places(folder: Path, page: Path) -> None:
    if not folder.is_dir():
        raise InputError(f"{folder}: is not a folder; give the one that contains the runs.")
    if page.suffix.lower() not in _PAGES:
        raise InputError(f"{page}: the name of the page must end in {' or '.join(_PAGES)}.")
    check_folder(page)


def _run_files(folder: Path, failures: list[str]) -> list[Path]:
    """RUN.toml files at any depth: those that name recordings or a channel map."""
    found = []
    for path in sorted(folder.rglob("*.toml")):
        if any(part.startswith(".") for part in path.relative_to(folder).parts):
            continue
        try:
            fields = read_toml(path)
        except InputError as error:
            failures.append(str(error))
            continue
        if "files" in fields or "channels" in fields:  # one alone is reported when the run is read
            found.append(path)
    return found


def _current_run(source: Path, folder: Path, analyze_run: Callable[[Path], Run]) -> tuple[Run, bool]:
    """Run of a RUN.toml, and whether it had to be analysed."""
    target = source.with_suffix(".json")
    job = Job.read(source)
    _check_links(job, folder)
    if target.exists():
        run = Run.read(target)  # raises where the file is something else, which is not overwritten
        if _agrees(run, job) and not _newer_recordings(job, target):
            return run, False
    before = _versions(job)
    run = analyze_run(source)
    if _versions(job) != before:
        raise InputError(f"{source}: its recordings changed during the analysis; it is analysed next time.")
    write_text(target, write_json(run.to_json()) + "\n")
    return Run.read(target), True


def _check_links(job: Job, folder: Path) -> None:
    """Check that no link leads out of the folder: who adds a run may read less than this program."""
    for file in job.files:
        if isinstance(file, Path) and file.is_symlink():
            target = regular_target(file)
            if not target.is_relative_to(folder.resolve()):
                raise InputError(f"{file}: is a link out of the folder; give the path of its target instead.")


def _agrees(run: Run, job: Job) -> bool:
    """Whether a run is of these documents, circumstances and file names; its recordings are not read."""
    stated = (job.mass, job.temperature)
    for value, known in zip(stated, (run.mass_kg, run.temperature_C), strict=True):
        if value is not None and (known is None or not math.isclose(value, known, rel_tol=_SAME)):
            return False
    if job.measured_at not in (None, run.measured_at):
        return False
    names = sorted(Path(str(file)).name for file in job.files)
    inputs = {name: of for name, of in run.made.inputs.items() if name != SUPERSEDES}
    return inputs == job.inputs() and names == sorted(file.name for file in run.files)


def _versions(job: Job) -> list[tuple[int, int]]:
    """Time and size of each recording that exists."""
    states = [file.stat() for file in job.files if isinstance(file, Path) and file.exists()]
    return [(state.st_mtime_ns, state.st_size) for state in states]


def _newer_recordings(job: Job, result: Path) -> bool:
    """Whether a recording was written after the result; recordings may be deleted once analysed."""
    analysed_at = result.stat().st_mtime_ns
    return any(written > analysed_at for written, _ in _versions(job))


def _usable(runs: dict[Path, Run], axis: CalibratedAxis, failures: list[str]) -> dict[Path, Run]:
    """Runs with a time, of the model's axis, whose recordings are those of no other run."""
    usable: dict[Path, Run] = {}
    source_of: dict[str, Path] = {}
    for source, run in runs.items():
        other = next((source_of[file.sha256] for file in run.files if file.sha256 in source_of), None)
        if run.measured_at is None:
            failures.append(f"{source}: has no time; add measured_at = 2026-01-31T08:00:00Z.")
        elif run.axis is not None and axis.axis and run.axis != axis.axis:
            failures.append(f"{source}: is of the axis {run.axis!r}, the model of {axis.axis!r}.")
        elif other is not None:
            failures.append(f"{source}: has a recording of {other}, which counts once.")
        else:
            usable[source] = run
            source_of |= {file.sha256: source for file in run.files}
    return usable


def _write_preloads(
    history: dict[Path, Run],
    monitored: Monitored,
    axis: CalibratedAxis,
    model: Path,
    settings: MonitorSettings,
    accept: Sequence[str],
    failures: list[str],
) -> None:
    """Write the preload of each run relative to the reference of its epoch, where it is not current."""
    by_id = {run.id: run for run in history.values()}
    epoch_of = {state.reading.run: state.reading.epoch for state in monitored.state.runs}
    for source, run in history.items():
        reference = monitored.state.epochs[epoch_of[run.id]].reference
        baseline = None
        if reference is not None and reference != run.id:
            baseline = by_id[reference]
        target = source.with_suffix(".preload.json")
        made_settings = asdict(settings.assumptions) | {"accept": sorted(set(accept))}
        try:
            is_current = _is_current(target, run, baseline, model, made_settings)
        except InputError as error:  # which names the file by its path or its name
            text = str(error).removeprefix(f"{target}: ").removeprefix(f"{target.name}: ")
            failures.append(f"{target}: {text}")
            continue
        if is_current:
            continue
        try:
            estimate = preload(run, axis, baseline, assumptions=settings.assumptions, accept=accept)
        except InputError as error:
            failures.append(f"{target}: {error}")
            continue
        write_text(target, write_json(estimate.to_json()) + "\n")


def _is_current(path: Path, run: Run, baseline: Run | None, model: Path, settings: dict[str, Any]) -> bool:
    """Whether a preload is of this run, baseline, model and settings."""
    if not path.exists():
        return False
    estimate = PreloadEstimate.read(path)  # raises where the file is something else
    inputs = {"run": run.id}
    if baseline is not None:
        inputs["baseline"] = baseline.id
    of_these = estimate.made.inputs == inputs and estimate.made.settings == settings
    return of_these and path.stat().st_mtime_ns >= model.stat().st_mtime_ns


def _write_changed(path: Path, text: str) -> None:
    if not path.exists() or path.read_bytes() != text.encode():
        write_text(path, text)


def watch_command(
    folder: Path,
    *,
    model: Path,
    events: Path | None,
    settings: MonitorSettings,
    duty: str | None,
    accept: Sequence[str],
    page: Path | None,
    as_json: bool,
    exit_code: bool,
) -> int:
    """Watch an axis, print the result, and return the exit status."""

    def analyze_run(source: Path) -> Run:
        with progress_bar(source.relative_to(folder).as_posix()) as progress:
            return analyze(source, progress=progress)

    stated = parse_duty(duty)
    check_outputs((page,), (model, events, Path(duty or "")))
    watched = watch(
        folder, model, events=events, settings=settings, duty=stated, accept=accept, page=page,
        analyze_run=analyze_run,
    )  # fmt: skip
    if as_json:
        print_json(watched.to_json())
    else:
        _print(watched)
    for failure in watched.failures:
        sys.stderr.write(f"ballscrew: {failure}\n")
    status = report_newest(watched.monitored.state, watched.runs)
    if watched.failures and status == DONE:
        status = WRONG_INPUT
    return health_status(watched.monitored.state, status) if exit_code else status


def _print(watched: WatchedAxis) -> None:
    print_headline(watched.monitored)
    screen = console()
    for source in watched.analyzed:
        screen.print(f"Analysed: {source}", markup=False, soft_wrap=True)
    screen.print(f"Page: {watched.page}", markup=False, soft_wrap=True)
