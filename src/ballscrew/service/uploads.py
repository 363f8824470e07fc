"""Files of runs over HTTP: streamed to the disk, resumable, stored durably before they are confirmed."""

from __future__ import annotations

import asyncio
import errno
import os
import re
import time
from collections.abc import AsyncIterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from fastapi import APIRouter, Depends, Request, Response
from fastapi import Path as InPath
from sqlalchemy import select
from sqlalchemy.orm import Session
from starlette.concurrency import run_in_threadpool
from starlette.requests import ClientDisconnect

from ballscrew.base.errors import InputError, shown
from ballscrew.service.access import RunningService, SendingCaller, find_sent_axis
from ballscrew.service.serving import FULL, TOO_LARGE, UNAVAILABLE, UNPROCESSABLE, RefusedError, Service
from ballscrew.store.folder import now
from ballscrew.store.opened import record
from ballscrew.store.raw_files import INCOMING, ChangedFileError, path_of, put_file
from ballscrew.store.service_tables import Upload
from ballscrew.store.tables import RawFile, RecordingRow, Source

router = APIRouter(prefix="/api/v1/axes/{axis}/runs/{run}")

_BLOCK = 1 << 20
_DAY = 24 * 3600.0  # s
_FULL_DISK = (errno.ENOSPC, getattr(errno, "EDQUOT", errno.ENOSPC))
_RANGE = re.compile(r"bytes (\d{1,15})-(\d{1,15})/(\d{1,15})")
COMPLETE, OFFSET = "Upload-Complete", "Upload-Offset"

Sha256 = Annotated[str, InPath(pattern="^[0-9a-f]{64}$", description="SHA-256 of the content of the file.")]
RunKey = Annotated[
    str,
    InPath(
        min_length=1, max_length=200, pattern=r"^[^\x00-\x1f\x7f]+$", description="Sender's name of the run."
    ),
]


@dataclass(frozen=True, slots=True)
class Part:
    """Bytes ``start`` to ``stop``, exclusive, of a file of ``total`` bytes; None where it is not stated."""

    start: int
    stop: int | None
    total: int | None


def may_send(axis: str, caller: SendingCaller, service: RunningService) -> None:
    """Refuse an axis that does not exist, or is not of the caller's machine."""
    with service.store.read() as session:
        find_sent_axis(session, axis, caller)


@router.head("/files/{sha256}", dependencies=[Depends(may_send)], status_code=204)
def show_file(run: RunKey, sha256: Sha256, service: RunningService) -> Response:  # noqa: ARG001
    """How much of a file is stored: 200 with ``Upload-Complete: ?1``, or 204, both with ``Upload-Offset``."""
    size = stored_size(service, sha256)
    if size is not None:
        return Response(status_code=200, headers={OFFSET: str(size), COMPLETE: "?1"})
    return Response(status_code=204, headers={OFFSET: str(_offset(service, sha256)), COMPLETE: "?0"})


@router.put("/files/{sha256}", dependencies=[Depends(may_send)], status_code=201)
async def receive_file(request: Request, run: RunKey, sha256: Sha256, service: RunningService) -> Response:  # noqa: ARG001
    """Receive a file, or with ``Content-Range`` a part of it, and store it durably."""
    part = _part(request)
    if await run_in_threadpool(stored_size, service, sha256) is not None:
        async for _ in _blocks(request, service):
            pass
        return Response(status_code=200, headers={COMPLETE: "?1"})
    _check_space(service, part)
    receiving = request.app.state.receiving
    offset = _offset(service, sha256)
    if sha256 in receiving:
        raise _wrong_offset("the file is being received from another sender.", offset)
    if part.stop is not None and part.start != offset:
        raise _wrong_offset(f"the part begins at {part.start}; {offset} bytes are there.", offset)
    receiving.add(sha256)
    try:
        size = await _write(request, service, service.partial / sha256, part)
        if part.total is not None and size < part.total:
            return Response(status_code=202, headers={OFFSET: str(size), COMPLETE: "?0"})
        await run_in_threadpool(store_file, service, service.partial / sha256, sha256)
    finally:
        receiving.discard(sha256)
    return Response(status_code=201, headers={COMPLETE: "?1"})


def _wrong_offset(message: str, offset: int) -> RefusedError:
    return RefusedError(409, message, {OFFSET: str(offset), COMPLETE: "?0", "Retry-After": "1"})


def _part(request: Request) -> Part:
    """Which part of a file a request contains."""
    length = request.headers.get("content-length")
    given = request.headers.get("content-range")
    if given is None:
        return Part(0, None, int(length) if length else None)
    match = _RANGE.fullmatch(given)
    if match is None:
        raise RefusedError(
            UNPROCESSABLE, f"Content-Range is {shown(given)}; it must be bytes FIRST-LAST/TOTAL."
        )
    start, last, total = map(int, match.groups())
    if not start <= last < total:
        raise RefusedError(
            UNPROCESSABLE, f"Content-Range is {shown(given)}: FIRST, LAST and TOTAL do not fit."
        )
    if length is not None and int(length) != last + 1 - start:
        raise RefusedError(
            UNPROCESSABLE, f"the part has {length} bytes, Content-Range states {last + 1 - start}."
        )
    return Part(start, last + 1, total)


def _check_space(service: Service, part: Part) -> None:
    settings, size = service.settings, part.total or 0
    if size > settings.max_file_bytes:
        raise _too_large(service)
    service.store.check_writable()
    if service.free_bytes() - size < settings.min_free_bytes:
        raise RefusedError(FULL, "the disk is full.", {"Retry-After": "600"})


def _too_large(service: Service) -> RefusedError:
    most = service.settings.max_file_bytes
    return RefusedError(TOO_LARGE, f"the file is larger than {most} bytes (max_file_bytes).")


async def _blocks(request: Request, service: Service) -> AsyncIterator[bytes]:
    """Body of a request in blocks; refuses one that is too large or comes too slowly."""
    block, size = bytearray(), 0
    stream = request.stream().__aiter__()
    while True:
        try:
            async with asyncio.timeout(service.settings.upload_idle_s):
                chunk = await anext(stream, None)
        except TimeoutError:
            raise RefusedError(408, "no data arrived for too long.") from None
        if chunk is None:
            break
        size += len(chunk)
        if size > service.settings.max_file_bytes:
            raise _too_large(service)
        block += chunk
        if len(block) >= _BLOCK:
            yield bytes(block)
            block.clear()
    yield bytes(block)


async def _write(request: Request, service: Service, path: Path, part: Part) -> int:
    """Append a part to an incomplete file, or begin it anew, and return its size."""
    size = part.start
    mode = "r+b" if part.start else "wb"
    try:
        with path.open(mode) as stream:
            stream.seek(size)
            async for block in _blocks(request, service):
                size += len(block)
                if size > service.settings.max_file_bytes:
                    raise _too_large(service)
                if part.stop is not None and size > part.stop:
                    text = f"the part is longer than Content-Range states, which ends at {part.stop}."
                    raise RefusedError(UNPROCESSABLE, text)
                await run_in_threadpool(stream.write, block)
            await run_in_threadpool(stream.flush)
    except OSError as error:
        raise _no_disk(error) from None
    except ClientDisconnect:  # what has come stays, and can be resumed
        raise RefusedError(400, "the connection was closed.") from None
    if part.stop is not None and size != part.stop:
        raise RefusedError(UNPROCESSABLE, f"the part ends at {size}; Content-Range states {part.stop}.")
    return size


def _no_disk(error: BaseException) -> RefusedError:
    """Refusal after an error of the disk: 507 where it is full, else 503."""
    status, wait = UNAVAILABLE, "60"
    if isinstance(error, OSError) and error.errno in _FULL_DISK:
        status, wait = FULL, "600"
    reason = getattr(error, "strerror", None) or error
    return RefusedError(status, f"the file cannot be stored ({reason}).", {"Retry-After": wait})


def store_file(service: Service, path: Path, sha256: str) -> None:
    """Move a complete file into the store, durably.

    Parameters
    ----------
    service : Service
        The service.
    path : Path
        The file; removed.
    sha256 : str
        Hash that its content must have.

    Raises
    ------
    RefusedError
        If it has another, or cannot be stored.
    """
    try:
        stored = put_file(service.store.folder.files, path, sha256)
    except ChangedFileError:
        path.unlink(missing_ok=True)
        raise RefusedError(UNPROCESSABLE, "the content of the file has another SHA-256.") from None
    except InputError as error:
        raise _no_disk(error.__cause__ or error) from None
    with service.store.write("receive") as session:
        row = session.get(RawFile, sha256)
        if row is None:
            row = RawFile(sha256=sha256, size=stored.size, added_at=now())
            session.add(row)
        row.stored_size, row.compression = stored.stored_size, stored.compression
        row.archived_to = row.deleted_at = None
        session.flush()
        if not _path(service, row).is_file():  # an older copy was removed as unused at this moment
            raise RefusedError(UNAVAILABLE, "the file must be sent again.", {"Retry-After": "1"})
    path.unlink(missing_ok=True)


def recover_uploads(service: Service) -> None:
    """Remove what a server that was killed left behind: files without a row, and incomplete copies.

    A file stays in ``partial`` until its row is written: no other file can lack one.
    """
    files = service.store.folder.files
    for path in files.glob(f"{INCOMING}*"):
        with suppress(PermissionError):  # of Windows, while another program reads it
            path.unlink(missing_ok=True)
    for path in service.partial.iterdir():
        if stored_size(service, path.name) is not None:
            with suppress(PermissionError):
                path.unlink()
            continue
        for compression in ("none", "zstd"):
            path_of(files, path.name, compression).unlink(missing_ok=True)


def remove_unused(service: Service) -> None:
    """Remove incomplete uploads, and complete files that no run refers to, that are old.

    Parameters
    ----------
    service : Service
        The service.
    """
    oldest = time.time() - service.settings.unused_days * _DAY
    for path in service.partial.iterdir():
        with suppress(OSError):  # it may just have been completed
            if path.stat().st_mtime < oldest:
                path.unlink()
    with service.store.read() as session:
        if not _unused_files(session, service, oldest):
            return
    with service.store.write("remove unused files") as session:
        removed = {row.sha256: _path(service, row) for row in _unused_files(session, service, oldest)}
        for sha256 in removed:
            session.delete(session.get_one(RawFile, sha256))
        record(session, "gc", "files", removed=sorted(removed))
    # A kill here leaves files without rows, which 'store gc' removes; rows without files would be damage.
    with service.store.write("remove unused files") as session:
        for sha256, path in removed.items():
            if session.get(RawFile, sha256) is None:  # else it has been sent again
                path.unlink(missing_ok=True)


def _unused_files(session: Session, service: Service, oldest: float) -> list[RawFile]:
    """Rows of the files that no run refers to and no sender has asked for since ``oldest``."""
    recordings = select(RecordingRow.run_id).where(RecordingRow.sha256 == RawFile.sha256)
    found = session.scalars(select(RawFile).where(RawFile.is_stored, ~recordings.exists()))
    rows = {row.sha256: row for row in found if _asked_at(service, row) < oldest}
    if rows:
        for files, stated in session.execute(select(Upload.files, Upload.stated)):
            rows.pop(stated.get("run_json"), None)
            for file in files or ():
                rows.pop(file["sha256"], None)
        for stated in session.scalars(select(Source.stated)):
            for sha256 in stated["files"]:
                rows.pop(sha256, None)
    return list(rows.values())


def _path(service: Service, row: RawFile) -> Path:
    return path_of(service.store.folder.files, row.sha256, row.compression)


def _asked_at(service: Service, row: RawFile) -> float:
    """Time at which a file was sent or last asked for, s; the present if it is missing."""
    with suppress(OSError):
        return _path(service, row).stat().st_mtime
    return time.time()


def stored_size(service: Service, sha256: str) -> int | None:
    """Size of a file that is in the store; None if it is not. The file counts as asked for."""
    with service.store.read() as session:
        row = raw_file(session, sha256)
        if row is None:
            return None
        with suppress(OSError):
            os.utime(_path(service, row))
        return row.size


def raw_file(session: Session, sha256: str) -> RawFile | None:
    """Row of a raw file whose content is in the store."""
    row = session.get(RawFile, sha256)
    if row is None or not row.is_stored:
        return None
    return row


def _offset(service: Service, sha256: str) -> int:
    """Bytes of a file that is incomplete."""
    path = service.partial / sha256
    return path.stat().st_size if path.is_file() else 0
