"""``ballscrew serve --demo``: a store of the simulated plant, made through the functions of the service."""

from __future__ import annotations

import multiprocessing
import os
import shutil
import signal
import tempfile
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from functools import partial
from pathlib import Path
from queue import SimpleQueue

import numpy as np
from sqlalchemy import select

from ballscrew.axis.sheet_file import axis_toml
from ballscrew.base.errors import InputError
from ballscrew.base.files import Progress, ignore_progress
from ballscrew.base.provenance import hash_file
from ballscrew.calibration.modelfile import model_json
from ballscrew.fcft.conditions import Condition
from ballscrew.fcft.planfile import plan_toml
from ballscrew.modal.cell import TransientRow
from ballscrew.modal.joint.blocks import make_block, project
from ballscrew.modal.joint.mode import AxialMode, compliance_of
from ballscrew.modal.joint.signals import TripSignals
from ballscrew.modal.joint.windows import average_windows
from ballscrew.modal.run import Run
from ballscrew.monitoring.detection.design import design_of
from ballscrew.monitoring.detection.limits import compute_limits
from ballscrew.monitoring.detection.settings import MonitorSettings
from ballscrew.monitoring.epochs import moment
from ballscrew.reproduction.plant import CHANNELS, PLANT, SITE, PlantAxis
from ballscrew.reproduction.plant_runs import AxisHistory, Template, make_history, record_tests
from ballscrew.service.access import Caller
from ballscrew.service.alarms import Action, act, watch_for_silence
from ballscrew.service.axes import AxisSetup, NewEvent, Schedule, add_axis_events, add_axis_model, set_up_axis
from ballscrew.service.jobs import ANALYSE, ASSESS, Lease
from ballscrew.service.runs import QUEUED, Completion, SentFile, complete_run, store_result
from ballscrew.service.serving import ServedStore, Service
from ballscrew.service.settings import read_settings
from ballscrew.service.uploads import store_file
from ballscrew.service.working import AssessmentTask, do_task, finish
from ballscrew.store.adding import reader_of
from ballscrew.store.alarms import alarm_documents
from ballscrew.store.findings import CONFIRMED
from ballscrew.store.folder import DataFolder, at_time, now
from ballscrew.store.migrating import create_store
from ballscrew.store.opened import OpenStore
from ballscrew.store.reading import find_axis
from ballscrew.store.service_tables import JobRow, Upload
from ballscrew.store.tables import AlarmRow

_CALLER = Caller(SITE, None, "admin")
_PERIOD, _GRACE = timedelta(days=7), timedelta(days=2)
_RECEIVED = timedelta(minutes=12)  # after the beginning of a test
_MODEL_AFTER = timedelta(days=13)  # the first test
_PROCESSES = 2

Deed = tuple[datetime, Callable[[], object]]


@contextmanager
def demo_store(data: Path | None, progress: Progress = ignore_progress) -> Iterator[Path]:
    """Data folder of the simulated plant, made if it does not exist.

    Parameters
    ----------
    data : Path or None
        The folder: new, empty, or of an earlier call; None for a temporary one, which is removed afterwards.
    progress : callable
        As for :func:`make_plant`.

    Yields
    ------
    Path
        The folder.

    Raises
    ------
    InputError
        If the folder contains something else.
    """
    if data is None:
        with tempfile.TemporaryDirectory(prefix="ballscrew-demo-", ignore_cleanup_errors=True) as name:
            folder = Path(name) / SITE
            make_plant(folder, progress=progress)
            yield folder
        return
    if not _is_plant(data):
        with _new_folder(data) as name:
            make_plant(name / "store", progress=progress)
            if data.is_dir():
                data.rmdir()  # it is empty
            (name / "store").rename(data)
    yield data


def _is_plant(data: Path) -> bool:
    """Whether a folder contains a simulated plant; False if there is nothing in it."""
    folder = DataFolder(data)
    if folder.exists():
        if not folder.is_simulated():
            raise InputError(f"{data}: contains another store; --demo needs a new folder.")
        try:
            OpenStore(data)
        except InputError as error:  # such as an older schema
            raise InputError(f"{str(error).rstrip('.')}, or give --demo a new folder.") from None
        return True
    if data.exists() and (not data.is_dir() or any(data.iterdir())):
        raise InputError(f"{data}: contains other files; --demo needs a new folder.")
    return False


@contextmanager
def _new_folder(data: Path) -> Iterator[Path]:
    """A temporary folder beside a folder: what is made in it is moved whole, or not at all."""
    try:
        data.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(
            prefix=".ballscrew-demo-", dir=data.parent, ignore_cleanup_errors=True
        ) as name:
            yield Path(name)
    except OSError as error:
        raise InputError(f"{data}: cannot be created ({error.strerror or error}).") from None


def make_plant(
    folder: Path,
    *,
    axes: Sequence[PlantAxis] = PLANT,
    seed: int = 0,
    present: datetime | None = None,
    progress: Progress = ignore_progress,
) -> None:
    """Make a store of a simulated plant.

    Recordings that are not analysed are in its queue: the server analyses them.

    Parameters
    ----------
    folder : Path
        Data folder, which must not exist.
    axes : sequence of PlantAxis
        The plant.
    seed : int
        The same seed gives the same numbers.
    present : datetime, optional
        Time at which the history ends; by default the present.
    progress : callable
        Called with the number of axes that are made, the number of all, and what is done.
    """
    create_store(folder)
    data = DataFolder(folder)
    present = present or datetime.now(UTC)
    with (
        data.locked("serve --demo", serving=True),
        tempfile.TemporaryDirectory(prefix="recordings-", dir=folder) as recordings,
        _pool() as pool,
    ):
        service = Service(ServedStore(folder), read_settings(folder, None, {}))
        service.partial.mkdir()
        plant = _Plant(service, present)
        histories, assessments = [], []
        for history in _make_histories(pool, axes, present, seed, Path(recordings)):
            plant.replay(history)
            histories.append(history)
            if history.axis.calibrated:
                lease, task = plant.lease_assessment(history.axis)
                assessments.append((lease, pool.submit(do_task, task)))
            progress(len(histories), len(axes), history.axis.name)
        plant.send_others(histories)  # while the processes assess
        plant.watch(histories)
        for lease, future in assessments:
            progress(len(axes), len(axes), f"assessing {lease.argument}")
            finish(service, lease, *future.result())
        plant.date_alarms()
        for writing in (False, True):
            service.store.engine(writing=writing).dispose()
    data.create(None, simulated=True)


def _make_histories(
    pool: Executor, axes: Sequence[PlantAxis], present: datetime, seed: int, folder: Path
) -> Iterator[AxisHistory]:
    """Histories of the axes, as they come.

    In a new installation the loops of simulation, analysis and detection are compiled at first, each by another
    process. Other axes are analysed after the first.
    """
    followers: dict[str, list[PlantAxis]] = {axis.name: [] for axis in axes}
    own = []
    for axis in axes:
        if axis.like in followers:
            followers[axis.like].append(axis)
        else:
            own.append(replace(axis, like=None))
    # Those first that others wait for, and those with the most analyses, so that both processes end together.
    first, *rest = sorted(own, key=lambda axis: (-len(followers[axis.name]), -axis.effort))
    followers[first.name] += rest
    recorded: dict[str, Future[dict[int, Path]]] = {}
    finished: SimpleQueue[Future[AxisHistory]] = SimpleQueue()

    def record(axis: PlantAxis) -> None:
        recorded[axis.name] = pool.submit(record_tests, axis, present, seed, folder / axis.name)

    def analyse(axis: PlantAxis, template: Template | None, recordings: Future[dict[int, Path]]) -> None:
        try:
            future = pool.submit(make_history, axis, present, seed, recordings.result(), template)
        except Exception as error:  # noqa: BLE001  the main process waits for a result of each axis
            future = Future()
            future.set_exception(error)
        future.add_done_callback(partial(complete, axis))

    def complete(axis: PlantAxis, future: Future[AxisHistory]) -> None:
        finished.put(future)
        if not future.cancelled() and future.exception() is None:
            for other in followers[axis.name]:
                template = future.result().template if other.like else None
                recorded[other.name].add_done_callback(partial(analyse, other, template))

    record(first)
    compiled = pool.submit(_compile_analysis)
    for axis in rest:
        record(axis)
    _compile_detection()
    compiled.result()
    history = pool.submit(make_history, first, present, seed, recorded[first.name].result())
    for followed in followers.values():
        for axis in followed:
            if axis.name not in recorded:
                record(axis)
    history.add_done_callback(partial(complete, first))
    for _ in axes:
        yield finished.get().result()


def _compile_analysis() -> None:
    """Compile the loops of the fit, by a step of it on a window of noise."""
    random, at = np.random.default_rng(0), np.arange(400)
    trip = TripSignals(1000.0, random.standard_normal(400), 1e-3 * at, random.standard_normal((1, 400)))
    transient = TransientRow(0, 0.1, 0.2, 0.0, str(Condition.PA), 0, 1)
    windows = average_windows([trip], [transient], 1.0, 60.0, 300.0)
    assert windows is not None  # noqa: S101  there is one
    mode = AxialMode(compliance_of(150.0), 0.0, 0.0, 0.03, 0.01, 1.0, 0.0, 300.0, 0.03)
    project(make_block("torque-nut", windows), mode)


def _compile_detection() -> None:
    """Compile the loops of the detection, by the limits of a few visits."""
    days = np.arange(8.0)
    compute_limits(design_of(days, 0.003 + 0 * days, 20 + 0 * days, (), MonitorSettings(draws=1000)))


@contextmanager
def _pool() -> Iterator[ProcessPoolExecutor]:
    """Processes; after an interrupt, what they have not begun is not done."""
    pool = ProcessPoolExecutor(_PROCESSES, multiprocessing.get_context("spawn"), _begin_process)
    for _ in range(_PROCESSES):  # all begin now: each takes seconds to import what it needs
        pool.submit(os.getpid)
    try:
        yield pool
    finally:
        pool.shutdown(cancel_futures=True)


def _begin_process() -> None:
    """Ignore Ctrl-C, which the main process handles, and lower the priority: the main one has most to do."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if hasattr(os, "nice"):
        os.nice(5)


@dataclass(frozen=True)
class _Plant:
    """The plant as it sends its tests, and the people who read the results."""

    service: Service
    present: datetime

    def replay(self, history: AxisHistory) -> None:
        """Do what happened to an axis, in the order of time."""
        runs = []
        for week, run in history.runs.items():
            if week not in history.recordings:
                runs.append((self._received_at(history.axis, week), week, run))
        for at, deed in sorted(self._deeds(history), key=lambda each: each[0]):
            self._add_runs(history.axis, [each for each in runs if each[0] < at])
            runs = [each for each in runs if each[0] >= at]
            with at_time(at):
                deed()
        self._add_runs(history.axis, runs)

    def _deeds(self, history: AxisHistory) -> list[Deed]:
        """What happened to an axis, without its imitated tests."""
        axis = history.axis
        first = axis.measured_at(axis.first, self.present)
        deeds: list[Deed] = [(first - timedelta(hours=1), partial(self._set_up, axis))]
        for week, path in history.recordings.items():
            if week in history.runs:
                deed = partial(self._send, axis, week, path, history.runs[week])
                deeds.append((self._received_at(axis, week), deed))
        model = history.model
        if model is not None:
            at = first + _MODEL_AFTER
            deeds.append((at, partial(add_axis_model, axis.name, model_json(model), _CALLER, self.service)))
        if axis.raised is not None:
            at = self._received_at(axis, axis.raised) + timedelta(seconds=10)
            deeds.append((at, partial(self._assess, axis)))
        for weeks, kind, text in axis.story:
            at = axis.measured_at(0, self.present) + timedelta(weeks=weeks)
            deeds.append((at, partial(self._act, axis, kind, text, at)))
        return deeds

    def _received_at(self, axis: PlantAxis, week: int) -> datetime:
        return axis.measured_at(week, self.present) + _RECEIVED

    def _set_up(self, axis: PlantAxis) -> None:
        """Set up an axis with its documents and its schedule."""
        schedule = Schedule(period_s=_PERIOD.total_seconds(), grace_s=_GRACE.total_seconds())
        setup = AxisSetup(
            machine=axis.machine,
            site=f"{SITE}, {axis.hall}",
            sheet=axis_toml(axis.sheet),
            plan=plan_toml(axis.type.plan),
            channels=CHANNELS,
            schedule=schedule,
        )
        set_up_axis(axis.name, setup, _CALLER, self.service)

    def _act(self, axis: PlantAxis, kind: str, text: str, at: datetime) -> None:
        """Act on the newest alarm of an axis, if there is one, or record an event."""
        if kind not in ("acknowledge", "close"):
            event = NewEvent(at=at.isoformat(), kind=kind, text=text)
            add_axis_events(axis.name, [event], _CALLER, self.service)
            return
        with self.service.store.read() as session:
            found = [each for each in alarm_documents(session) if each["axis"] == axis.name]
        if found:
            finding = CONFIRMED if kind == "close" else None
            action = Action.model_validate({"action": kind, "text": text, "finding": finding})
            act(found[0]["id"], action, _CALLER, self.service)

    def _send(self, axis: PlantAxis, week: int, path: Path, run: Run | None = None) -> None:
        """Send the recordings of a test, store the result of their analysis if there is one; remove them."""
        text = path.read_text(encoding="utf-8")
        recordings = sorted(path.parent.glob("trip*.h5"))
        readers = len(recordings) * [reader_of(recordings[0])]  # of one format
        files = []
        for recording in recordings:
            sha256 = hash_file(recording)
            files.append(SentFile(name=recording.name, sha256=sha256))
            store_file(self.service, recording, sha256)
        body = Completion(files=files, run_toml=text, run_json=None, measured_at=None)
        complete_run(axis.name, f"week {week}", body, _CALLER, self.service)
        if run is not None:
            with self.service.store.read() as session:
                newest = select(Upload.content).order_by(Upload.id.desc()).limit(1)
                content = str(session.scalar(newest))
            finish(self.service, self._lease(ANALYSE, content), "done", (run.to_json(), readers))
        shutil.rmtree(path.parent, ignore_errors=True)  # else all are removed in the end

    def send_others(self, histories: Sequence[AxisHistory]) -> None:
        """Send the recordings that are not analysed, the oldest first."""
        others = []
        for history in histories:
            for week, path in history.recordings.items():
                if week not in history.runs:
                    others.append((self._received_at(history.axis, week), week, history.axis, path))
        for at, week, axis, path in sorted(others, key=lambda each: each[0]):
            with at_time(at):
                self._send(axis, week, path)

    def watch(self, histories: Sequence[AxisHistory]) -> None:
        """Raise what a server would have raised on axes whose tests ended."""
        for history in histories:
            silent = self._received_at(history.axis, history.axis.last) + _PERIOD + _GRACE
            silent += timedelta(minutes=1)
            if silent < self.present:
                with at_time(silent):
                    watch_for_silence(self.service, silent)

    def date_alarms(self) -> None:
        """Let each alarm be raised when its run was received, as by a server that was there."""
        with self.service.store.write("serve --demo") as session:
            for row in session.scalars(select(AlarmRow)):
                received = moment(row.began_at, "began_at") + _RECEIVED
                if moment(row.raised_at, "raised_at") > received + timedelta(days=1):
                    row.raised_at = received.isoformat(timespec="milliseconds")

    def _add_runs(self, axis: PlantAxis, runs: Sequence[tuple[datetime, int, Run]]) -> None:
        """Add imitated tests, as those that were analysed at the machine, in one transaction."""
        if not runs:
            return
        with self.service.store.write("serve --demo") as session:
            row = find_axis(session, axis.name)
            for at, week, run in runs:
                with at_time(at):
                    upload = Upload(
                        axis_id=row.id,
                        key=f"week {week}",
                        sent=run.id,
                        content=run.id,
                        status=QUEUED,
                        stated={},
                        files=[],
                        sender=_CALLER.name,
                        received_at=now(),
                    )
                    session.add(upload)
                    store_result(session, row, [upload], run)

    def _lease(self, kind: str, argument: str) -> Lease:
        """Lease a certain job."""
        with self.service.store.write("lease") as session:
            found = select(JobRow).where(JobRow.kind == kind, JobRow.argument == argument)
            row = session.scalars(found).all()[0]
            row.lease = "demo"
            return Lease(row.id, row.lease, kind, argument)

    def lease_assessment(self, axis: PlantAxis) -> tuple[Lease, AssessmentTask]:
        """Lease the job that assesses an axis."""
        return self._lease(ASSESS, axis.name), AssessmentTask(str(self.service.store.path), axis.name)

    def _assess(self, axis: PlantAxis) -> None:
        """Assess an axis in this process."""
        lease, task = self.lease_assessment(axis)
        finish(self.service, lease, *do_task(task))
