"""``ballscrew serve --demo``: a store of the simulated plant, made through the functions of the service."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from functools import partial
from pathlib import Path

from sqlalchemy import select

from ballscrew.axis.sheet_file import axis_toml
from ballscrew.base.errors import InputError
from ballscrew.base.files import Progress, ignore_progress
from ballscrew.base.provenance import hash_file
from ballscrew.calibration.modelfile import model_json
from ballscrew.fcft.planfile import plan_toml
from ballscrew.modal.run import Run
from ballscrew.monitoring.epochs import moment
from ballscrew.reproduction.plant import CHANNELS, PLANT, SITE, PlantAxis
from ballscrew.reproduction.plant_histories import make_histories
from ballscrew.reproduction.plant_runs import AxisHistory
from ballscrew.service.access import Caller
from ballscrew.service.alarms import Action, act, watch_for_silence
from ballscrew.service.axes import AxisSetup, NewEvent, Schedule, add_axis_events, add_axis_model, set_up_axis
from ballscrew.service.demo_processes import shut_down
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

Deed = tuple[datetime, Callable[[], object]]


@contextmanager
def demo_store(data: Path | None, pool: Executor, progress: Progress = ignore_progress) -> Iterator[Path]:
    """Data folder of the simulated plant, made if it does not exist.

    Parameters
    ----------
    data : Path or None
        The folder: new, empty, or of an earlier call; None for a temporary one, which is removed afterwards.
    pool : Executor
        As for :func:`make_plant`.
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
            make_plant(folder, pool, progress=progress)
            yield folder
        return
    if not _is_plant(data):
        with _new_folder(data) as name:
            make_plant(name / "store", pool, progress=progress)
            if data.is_dir():
                data.rmdir()  # it is empty
            (name / "store").rename(data)
    yield data


def _is_plant(data: Path) -> bool:
    """Whether a folder contains a simulated plant; False if there is nothing in it."""
    folder = DataFolder(data)
    try:
        exists = folder.exists()
        is_empty = not data.exists()
        if data.is_dir():
            is_empty = not any(data.iterdir())
    except OSError as error:  # such as a name that is too long
        raise InputError(f"{data}: cannot be read ({error.strerror or error}).") from None
    if exists:
        if not folder.is_simulated():
            raise InputError(f"{data}: contains another store; --demo needs a new folder.")
        try:
            OpenStore(data)
        except InputError as error:  # such as an older schema
            raise InputError(f"{str(error).rstrip('.')}, or give --demo a new folder.") from None
        return True
    if not is_empty:
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
    pool: Executor,
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
    pool : Executor
        Processes that simulate, analyse and assess: those of :func:`~.demo_processes.demo_processes`. They
        are shut down at the end.
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
        shut_down(pool),  # before what the processes write is removed
    ):
        service = Service(ServedStore(folder), read_settings(folder, None, {}))
        service.partial.mkdir()
        plant = _Plant(service, present)
        histories, assessments = [], []
        for history in make_histories(pool, axes, present, seed, Path(recordings)):
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
