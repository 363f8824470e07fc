"""Completion of a run over HTTP: what was sent becomes a run and a job, durably, and is then confirmed."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fastapi import APIRouter, Depends
from fastapi.responses import JSONResponse
from pydantic import BaseModel, ConfigDict, Field
from sqlalchemy import select
from sqlalchemy.orm import Session

from ballscrew.base.errors import InputError, shown
from ballscrew.base.jsonfile import read_json
from ballscrew.base.provenance import digest
from ballscrew.base.settings import timestamp
from ballscrew.modal.job import Job, RunFile, read_run
from ballscrew.modal.run import Run
from ballscrew.monitoring.epochs import moment
from ballscrew.service.access import Caller, RunningService, SendingCaller, find_sent_axis
from ballscrew.service.alarms import report_bad_measurement
from ballscrew.service.counting import check_sent, doubts_of, exclude_as_needed
from ballscrew.service.jobs import ANALYSE, enqueue, request_assessment, waiting_runs
from ballscrew.service.serving import TOO_MANY, RefusedError, Service
from ballscrew.service.uploads import RunKey, may_send, raw_file
from ballscrew.store.adding import METHOD_REVISION, insert_document, insert_source
from ballscrew.store.folder import now
from ballscrew.store.inserting import insert_run
from ballscrew.store.opened import record
from ballscrew.store.raw_files import copy_out, path_of, text_files
from ballscrew.store.same_recordings import SameRecordingError, is_same_recording
from ballscrew.store.service_tables import Setup, Upload
from ballscrew.store.tables import Axis, Document, RawFile, RunRow, Source

router = APIRouter(prefix="/api/v1/axes/{axis}/runs/{run}")

QUEUED, DONE, REFUSED, SET_ASIDE, CONFLICT = "queued", "done", "refused", "set aside", "conflict"
_DOCUMENT_BYTES = 1 << 20
_RUN_JSON_BYTES = 1 << 24  # of a RUN.json, which is read in the memory of the server
_NAME = r"^\.*[^\x00-\x1f\x7f/\\.][^\x00-\x1f\x7f/\\]*$"  # more than dots
_SHA256 = "^[0-9a-f]{64}$"


class SentFile(BaseModel):
    """A file of a run."""

    model_config = ConfigDict(extra="forbid")
    name: str = Field(min_length=1, max_length=200, pattern=_NAME)
    sha256: str = Field(pattern=_SHA256)


class Completion(BaseModel):
    """Request that makes files a run."""

    model_config = ConfigDict(extra="forbid")
    files: list[SentFile] = Field(max_length=1000)
    run_toml: str | None = Field(None, max_length=_DOCUMENT_BYTES, description="Text of RUN.toml.")
    run_json: str | None = Field(None, pattern=_SHA256, description="SHA-256 of RUN.json, a file of the run.")
    measured_at: str | None = Field(None, max_length=64, description="ISO 8601, if RUN.toml states none.")


@dataclass(frozen=True)
class Sent:
    """What was sent, as it is analysed.

    Parameters
    ----------
    sent : str
        Digest of what was sent.
    content : str
        Digest of what is analysed: recordings, documents and circumstances.
    stated : dict
        Content of RUN.toml, as in ``sources``.
    files : list of dict
        Name and hash of each recording.
    texts : dict of str to str
        Text of each document by its kind.
    run : Run or None
        The run itself, if it was analysed at the machine.
    """

    sent: str
    content: str
    stated: dict[str, Any]
    files: list[dict[str, str]]
    texts: dict[str, str]
    run: Run | None = None


def setup_texts(session: Session, axis: int) -> dict[str, str]:
    """Text of each document of an axis that is set up."""
    row, texts = session.get(Setup, axis), {}
    if row is not None:
        for kind, key in (("axis", row.sheet), ("plan", row.plan), ("channels", row.channels)):
            if key is not None:
                texts[kind] = session.get_one(Document, key).text
    return texts


@router.post("/complete", dependencies=[Depends(may_send)], status_code=202)
def complete_run(
    axis: str, run: RunKey, body: Completion, caller: SendingCaller, service: RunningService
) -> JSONResponse:
    """Make files a run and queue its analysis: 202, or 200 if the same content is already there."""
    service.store.check_writable()
    with service.store.read() as session:
        row = find_sent_axis(session, axis, caller)
        texts = setup_texts(session, row.id)
        stored = _stored_files(session, service, body)
    sent = _read_sent(axis, body, stored, texts)
    with service.store.write("complete") as session:
        _stored_files(session, service, body)  # one may have been removed as unused meanwhile
        status, document = _accept(session, service, session.get_one(Axis, row.id), run, sent, caller)
    service.announce()
    return JSONResponse(document, status)


def _stored_files(session: Session, service: Service, body: Completion) -> dict[str, tuple[Path, RawFile]]:
    """Path and row of each file by its hash.

    Raises
    ------
    InputError
        If one was not sent, or two have one name.
    """
    hashes = [file.sha256 for file in body.files]
    if len({file.name for file in body.files}) < len(hashes):
        raise InputError("two files of the run have the same name.")
    if not hashes and body.run_json is None:
        raise InputError("the run has no file.")
    if body.run_json is not None:
        hashes.append(body.run_json)
    found = {}
    for sha256 in hashes:
        row = raw_file(session, sha256)
        if row is None:
            raise InputError(f"the file with the SHA-256 {sha256} is missing: send it first.")
        found[sha256] = path_of(service.store.folder.files, sha256, row.compression), row
    return found


def _read_sent(
    axis: str,
    body: Completion,
    stored: Mapping[str, tuple[Path, RawFile]],
    texts: dict[str, str],
) -> Sent:
    """Read what was sent, without its recordings."""
    sent = digest(body.model_dump())
    if body.run_json is not None:
        run = _read_run_json(axis, *stored[body.run_json])
        names = [file.model_dump() for file in body.files]
        return Sent(sent, digest(run.to_json()), {"run_json": body.run_json}, names, {}, run)
    hashes = {file.name: file.sha256 for file in body.files}
    stated = RunFile(tuple(Path(name) for name in hashes))
    if body.run_toml is not None:
        with text_files({"RUN": body.run_toml}) as paths:
            stated = read_run(paths["RUN"])
    documents = {"axis": stated.axis, "plan": stated.plan, "channels": stated.channels}
    for kind, path in documents.items():
        if path is not None and _base(path) in hashes:  # sent with the run: it counts
            texts[kind] = _read_text(_base(path), *stored[hashes[_base(path)]])
    files = _recordings(stated, hashes)
    content = _content(axis, stated, body.measured_at, texts, files)
    return Sent(sent, digest(content), content, files, texts)


def _recordings(stated: RunFile, hashes: Mapping[str, str]) -> list[dict[str, str]]:
    """Name and hash of each recording, in the order of RUN.toml."""
    files = []
    for path in stated.files:
        name = _base(Path(str(path)))
        if name not in hashes:
            raise InputError(f"RUN.toml names the file {shown(name)}, which was not sent.")
        files.append({"name": name, "sha256": hashes[name]})
    return files


def _base(path: Path) -> str:
    """Name of a file without its folder, which may be written as on Windows."""
    return re.split(r"[\\/]", str(path))[-1]


def _content(
    axis: str, stated: RunFile, measured_at: str | None, texts: dict[str, str], files: list[dict[str, str]]
) -> dict[str, Any]:
    """What is analysed, as :func:`ballscrew.store.adding.add_recordings` states it."""
    for kind, name in (("axis", "data sheet"), ("channels", "channel map")):
        if kind not in texts:
            raise RefusedError(404, f"the axis has no {name}: PUT it with the axis, or send it with the run.")
    with text_files(texts) as paths:
        names = [Path(file["name"]) for file in files]
        job = Job.read(
            names, channels=paths["channels"], axis=paths["axis"], plan=paths.get("plan"), mass=stated.load
        )
    if job.sheet is not None and job.sheet.name != axis:
        raise InputError(f"the data sheet is that of the axis {shown(job.sheet.name)}, not of {shown(axis)}.")
    time = stated.measured_at
    if time is None and measured_at is not None:
        time = timestamp(measured_at, "measured_at")
    if time is not None:
        moment(time, "measured_at")
    return {
        "documents": job.inputs(),
        "mass_kg": job.mass,
        "measured_at": time,
        "temperature_C": stated.temperature,
        "files": [file["sha256"] for file in files],
    }


def _read_text(name: str, path: Path, row: RawFile) -> str:
    """Text of a document that was sent as a file."""
    if row.size > _DOCUMENT_BYTES:
        raise InputError(f"{name}: has {row.size} bytes; a document has {_DOCUMENT_BYTES} at most.")
    with tempfile.TemporaryDirectory(prefix="ballscrew-") as folder:
        target = Path(folder) / "document"
        copy_out(path, row.compression, target, row.sha256)
        try:
            return target.read_text(encoding="utf-8-sig")
        except UnicodeDecodeError:
            raise InputError(f"{name}: is not a text file in UTF-8.") from None


def _read_run_json(axis: str, path: Path, row: RawFile) -> Run:
    if row.size > _RUN_JSON_BYTES:
        raise InputError(f"RUN.json: has {row.size} bytes; it has {_RUN_JSON_BYTES} at most.")
    with tempfile.TemporaryDirectory(prefix="ballscrew-") as folder:
        target = Path(folder) / "RUN.json"
        copy_out(path, row.compression, target, row.sha256)
        try:
            run = Run.from_json(read_json(target), "RUN.json")
        except InputError as error:
            raise InputError(str(error).replace(str(target), "RUN.json")) from None
    if run.axis != axis:
        raise InputError(f"RUN.json is of the axis {shown(run.axis)}, not of {shown(axis)}.")
    return run


def _accept(
    session: Session, service: Service, axis: Axis, key: str, sent: Sent, caller: Caller
) -> tuple[int, dict[str, Any]]:
    """Rows of a run that was sent, and the answer."""
    same_key = session.scalars(select(Upload).where(Upload.axis_id == axis.id, Upload.key == key)).all()
    if any(row.status == CONFLICT and row.sent == sent.sent for row in same_key):
        return 409, _conflict_document(key, sent)
    for row in same_key:
        if row.status != CONFLICT:
            return _accept_again(session, service, axis, row, sent, caller)
    row = _new_row(axis, key, sent, caller)
    is_known = _take_known(session, axis, row)
    session.add(row)
    if is_known:
        return 200, upload_document(session, row)
    return _queue(session, service, axis, row, sent)


def _accept_again(
    session: Session, service: Service, axis: Axis, row: Upload, sent: Sent, caller: Caller
) -> tuple[int, dict[str, Any]]:
    """Answer to a key that has a run."""
    if sent.sent != row.sent and sent.content != row.content:
        _set_conflict_aside(session, axis, row.key, sent, caller)
        return 409, _conflict_document(row.key, sent)
    is_new = sent.content != row.content  # the axis was set up anew
    if row.status in (REFUSED, SET_ASIDE) and (is_new or is_same_recording(row.error)):
        row.content, row.stated, row.files = sent.content, sent.stated, sent.files
        return _queue(session, service, axis, row, sent)
    return 200, upload_document(session, row)


def _take_known(session: Session, axis: Axis, row: Upload) -> bool:
    """Whether the content is there under another key, or by ``store add``; the row then has its result."""
    same = (Upload.axis_id == axis.id, Upload.content == row.content, Upload.status != CONFLICT)
    twin = session.scalar(select(Upload).where(*same))
    if twin is not None:
        for name in ("status", "run", "verdict", "error", "finished_at"):
            setattr(row, name, getattr(twin, name))
        return True
    source = session.get(Source, row.content)
    if source is None:
        return False
    row.status, row.run = DONE, session.get_one(RunRow, source.run_id).run
    return True


def _new_row(axis: Axis, key: str, sent: Sent, caller: Caller) -> Upload:
    return Upload(
        axis_id=axis.id,
        key=key,
        sent=sent.sent,
        content=sent.content,
        status=QUEUED,
        stated=sent.stated,
        files=sent.files,
        sender=caller.name,
        received_at=now(),
    )


def _queue(
    session: Session, service: Service, axis: Axis, row: Upload, sent: Sent
) -> tuple[int, dict[str, Any]]:
    """Job of a run that is new, and the answer; a run that was analysed at the machine needs no job."""
    try:
        check_sent(session, axis, row, sent.run)
    except SameRecordingError as error:
        raise RefusedError(409, str(error)) from None
    if sent.run is not None:
        store_result(session, axis, [row], sent.run)
        if row.status == CONFLICT:
            return 409, _conflict_document(row.key, sent)
        return 202, upload_document(session, row)
    if waiting_runs(session) >= service.settings.max_queue:
        raise RefusedError(TOO_MANY, "too many runs wait for their analysis.", {"Retry-After": "60"})
    for kind, key in sent.stated["documents"].items():
        insert_document(session, kind, key, sent.texts[kind], axis.id if kind == "axis" else None)
    row.status, row.error = QUEUED, None
    enqueue(session, ANALYSE, sent.content)
    record(session, "receive", f"run {row.key}", axis=axis.name, content=sent.content, by=row.sender)
    return 202, upload_document(session, row)


def _set_conflict_aside(session: Session, axis: Axis, key: str, sent: Sent, caller: Caller) -> None:
    row = _new_row(axis, key, sent, caller)
    row.status, row.error = CONFLICT, "the key has other content already."
    session.add(row)
    record(session, "set aside", f"run {key}", axis=axis.name, content=sent.content, by=caller.name)


def _conflict_document(key: str, sent: Sent) -> dict[str, Any]:
    detail = f"the run {shown(key)} has other content, which stays; this one is set aside."
    return {"detail": detail, "run": key, "id": sent.content, "status": CONFLICT}


def store_result(
    session: Session, axis: Axis, rows: list[Upload], run: Run, readers: Sequence[str | None] = ()
) -> None:
    """Add the run of an analysis, the trouble with its measurement, and the job that assesses its axis.

    Parameters
    ----------
    session : Session
        Writing.
    axis : Axis
        Its axis.
    rows : list of Upload
        What was sent, under each of its keys.
    run : Run
        Analysed.
    readers : sequence of str or None
        Reader of each recording, with its version.
    """
    added = insert_run(session, run, METHOD_REVISION)
    for row in rows:
        row.status, row.finished_at, row.error = DONE, now(), None
        row.run, row.verdict = run.id, run.quality.verdict
        if added.conflict:
            row.status, row.error = CONFLICT, "the store has another result of this run, which stays."
    if added.conflict:
        return
    content, stated = rows[0].content, rows[0].stated
    if "documents" in stated:
        insert_source(session, run.id, content, {**stated, "readers": list(readers)}, {})
    doubt = exclude_as_needed(session, axis, rows[0], is_new=added.is_new)
    reasons = list(run.quality.reasons) if run.quality.verdict == "bad" else []
    if doubt is None:
        report_bad_measurement(session, axis, run.measured_at or rows[0].received_at, reasons)
    elif reasons:
        report_bad_measurement(session, axis, rows[0].received_at, reasons, is_dated=False)
    request_assessment(session, axis)


def document_texts(session: Session, stated: dict[str, Any]) -> dict[str, str]:
    """Text of each document of a run that was sent."""
    return {kind: session.get_one(Document, key).text for kind, key in stated["documents"].items()}


def upload_document(session: Session, row: Upload) -> dict[str, Any]:
    """What became of a run that was sent."""
    return upload_documents(session, [row])[0]


def upload_documents(session: Session, rows: Sequence[Upload]) -> list[dict[str, Any]]:
    """What became of runs that were sent."""
    found = []
    for row, doubt in zip(rows, doubts_of(session, rows), strict=True):
        found.append(
            {
                "run": row.key,
                "id": row.content,
                "status": row.status,
                "result": row.run,
                "verdict": row.verdict,
                "doubt": doubt,
                "error": row.error,
                "received_at": row.received_at,
                "finished_at": row.finished_at,
            }
        )
    return found
