"""Calibration of an axis by stored runs, in a process of its own: one at a time, bounded in time."""

from __future__ import annotations

import multiprocessing
import threading
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from multiprocessing.connection import Connection
from typing import Annotated, Any

from fastapi import APIRouter, Depends, Request
from pydantic import BaseModel, ConfigDict, Field
from sqlalchemy import select

from ballscrew.base.errors import BallscrewError, InputError, shown
from ballscrew.base.jsonfile import SCHEMA
from ballscrew.base.quantity import Quantity
from ballscrew.service.access import AdminCaller, RunningService, ViewerCaller, find_sent_axis
from ballscrew.service.runs import setup_texts
from ballscrew.service.serving import UNAVAILABLE, RefusedError, Service
from ballscrew.store.methods import used_results
from ballscrew.store.opened import OpenStore
from ballscrew.store.raw_files import text_files
from ballscrew.store.reading import find_axis
from ballscrew.store.rows import unpack
from ballscrew.store.tables import RunRow

router = APIRouter(prefix="/api/v1/axes/{axis}/calibration")

RUNNING, DONE, REFUSED, FAILED = "running", "done", "refused", "failed"
MOST_RUNS = 100
"""Runs of one calibration, at most."""

_TICK = 0.2  # s between looks at whether the service stops
_STOP = 5.0  # s that the process has to end


class CalibrationRequest(BaseModel):
    """Runs to calibrate an axis by."""

    model_config = ConfigDict(extra="forbid")
    runs: list[str] = Field(min_length=1, max_length=MOST_RUNS, description="Ids; the first is the reference")
    known_preloads: dict[str, str] = Field(
        default_factory=dict, description='Known preload of a run by its id: "600 N", "600 N ± 10 N".'
    )


@dataclass(frozen=True, slots=True)
class CalibrationTask:
    """A calibration, as plain data for a process.

    Parameters
    ----------
    store : str
        Data folder of the store, which is only read.
    axis : str
        Name of the axis.
    runs : tuple of str
        Ids of the runs.
    known : dict of str to str
        Known preload of a run by its id.
    """

    store: str
    axis: str
    runs: tuple[str, ...]
    known: dict[str, str]


def calibrate_stored(task: CalibrationTask) -> dict[str, Any]:
    """Calibrate an axis by runs of the store, without storing the model.

    Parameters
    ----------
    task : CalibrationTask
        The axis and the runs.

    Returns
    -------
    dict
        MODEL.json.

    Raises
    ------
    InputError
        If a run is not one of the axis, the axis has no data sheet, or as :func:`ballscrew.calibrate` raises.
    """
    from ballscrew.axis.sheet_file import read_axis
    from ballscrew.calibration.calibration import calibrate
    from ballscrew.calibration.modelfile import model_json
    from ballscrew.modal.run import Run
    from ballscrew.store.histories import result_documents

    with OpenStore(task.store).read() as session:
        axis = find_axis(session, task.axis)
        results = used_results(session, axis)
        found = select(RunRow.run, RunRow.id).where(RunRow.axis_id == axis.id, RunRow.run.in_(task.runs))
        numbers = {run: number for run, number in session.execute(found)}  # noqa: C416  rows are no pairs to mypy
        rows = {run: results[number].row for run, number in numbers.items() if number in results}
        documents = result_documents(session, list(rows.values()))
        texts = setup_texts(session, axis.id)
    runs = []
    for run in task.runs:
        if rows.get(run) not in documents:
            raise InputError(f"the axis {shown(task.axis)} has no result of a run {shown(run)}.")
        runs.append(Run.from_json(unpack(documents[rows[run]]), f"run {run[:12]}"))
    if "axis" not in texts:
        raise InputError(f"the axis {shown(task.axis)} has no data sheet: set it up first.")
    with text_files({"axis": texts["axis"]}) as paths:
        sheet = read_axis(paths["axis"])
    return model_json(calibrate(runs, sheet, known=known_quantities(task.known)))


def known_quantities(texts: Mapping[str, str]) -> dict[str, Quantity]:
    """Known preloads by run id."""
    from ballscrew.calibration.anchors import known_preload

    return {run: known_preload(text) for run, text in texts.items()}


def work(pipe: Connection, task: CalibrationTask) -> None:
    """Main function of the process: send the status, and MODEL.json or a sentence."""
    answer: tuple[str, Any]
    try:
        answer = DONE, calibrate_stored(task)
    except BallscrewError as error:
        answer = REFUSED, str(error)
    except Exception as error:  # noqa: BLE001  of whatever kind, it is reported
        answer = FAILED, f"unexpected error ({type(error).__name__}: {error})"
    with suppress(OSError):
        pipe.send(answer)


@dataclass(frozen=True, slots=True)
class StartedCalibration:
    """A calibration with its status and result, which are replaced together.

    Parameters
    ----------
    task : CalibrationTask
        The axis and the runs.
    begun : float
        Its begin, s.
    status : str
        Running, done, refused or failed.
    result : object
        MODEL.json of one that is done, or a sentence.
    ended : float or None
        Its end, s.
    """

    task: CalibrationTask
    begun: float
    status: str = RUNNING
    result: Any = None
    ended: float | None = None


class Calibrator:
    """The calibration that runs, or the newest that has ended.

    Parameters
    ----------
    service : Service
        The service.
    target : callable
        Main function of the process.
    """

    def __init__(self, service: Service, target: Any = work) -> None:
        self.service = service
        self.target = target
        self._newest: StartedCalibration | None = None
        self._turn = threading.Lock()

    def start(self, task: CalibrationTask) -> None:
        """Begin a calibration.

        Raises
        ------
        RefusedError
            503 while another one runs.
        """
        with self._turn:
            newest = self._newest
            if newest is not None and newest.status == RUNNING:
                message = f"a calibration of the axis {shown(newest.task.axis)} is running; wait for its end."
                raise RefusedError(UNAVAILABLE, message, {"Retry-After": "10"})
            self._newest = started = StartedCalibration(task, time.monotonic())
        threading.Thread(target=self._run, args=(started,), name="calibration", daemon=True).start()

    def document(self, axis: str) -> dict[str, Any] | None:
        """Status and result of the newest calibration, if it is one of this axis."""
        newest = self._newest
        if newest is None or newest.task.axis != axis:
            return None
        ended = time.monotonic() if newest.ended is None else newest.ended
        is_done = newest.status == DONE
        return {
            "status": newest.status,
            "runs": list(newest.task.runs),
            "seconds": round(ended - newest.begun, 1),
            "model": newest.result if is_done else None,
            "error": None if is_done else newest.result,
        }

    def _run(self, started: StartedCalibration) -> None:
        """Run the process until its result, its time limit, or the stop of the service."""
        context = multiprocessing.get_context("spawn")
        pipe, other = context.Pipe(duplex=False)
        process = context.Process(
            target=self.target, args=(other, started.task), name="ballscrew calibration"
        )
        try:
            process.start()
            other.close()
            status, result = self._receive(pipe, started.begun)
        except Exception as error:  # noqa: BLE001  whatever it is, another calibration can begin
            status, result = FAILED, f"the calibration failed: {error}."
        finally:
            if process.pid is not None:
                process.kill()
                process.join(_STOP)
            pipe.close()
        self._newest = replace(started, status=status, result=result, ended=time.monotonic())
        self.service.announce()

    def _receive(self, pipe: Connection, begun: float) -> tuple[str, Any]:
        limit = self.service.settings.lease_s
        while not pipe.poll(_TICK):
            if self.service.stopping.is_set():
                return FAILED, "the server stops."
            if time.monotonic() > begun + limit:
                return FAILED, f"the calibration took longer than {limit:g} s and was ended."
        try:
            answer: tuple[str, Any] = pipe.recv()
        except EOFError:
            return FAILED, "the process of the calibration ended without a result."
        return answer


def calibrator_of(request: Request) -> Calibrator:
    """The calibrator of the service of a request."""
    found: Calibrator = request.app.state.calibrator
    return found


RunningCalibrator = Annotated[Calibrator, Depends(calibrator_of)]


@router.post("", status_code=202)
def start_calibration(
    axis: str,
    body: CalibrationRequest,
    caller: AdminCaller,
    service: RunningService,
    calibrator: RunningCalibrator,
) -> dict[str, Any]:
    """Begin a calibration by stored runs; one at a time."""
    with service.store.read() as session:
        find_sent_axis(session, axis, caller)
    runs = tuple(dict.fromkeys(body.runs))
    foreign = sorted(set(body.known_preloads) - set(runs))
    if foreign:
        raise InputError(f"a preload is given for {shown(foreign[0])}, which is no run of the calibration.")
    known_quantities(body.known_preloads)  # refuses what is no force
    calibrator.start(CalibrationTask(str(service.store.path), axis, runs, body.known_preloads))
    return show_calibration(axis, caller, service, calibrator)


@router.get("")
def show_calibration(
    axis: str, caller: ViewerCaller, service: RunningService, calibrator: RunningCalibrator
) -> dict[str, Any]:
    """Status of the newest calibration of an axis, and its MODEL.json; it is not stored until it is PUT."""
    with service.store.read() as session:
        find_sent_axis(session, axis, caller)
    return {"schema": SCHEMA, "axis": axis, "calibration": calibrator.document(axis)}
