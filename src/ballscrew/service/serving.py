"""What all parts of the service share: the store with its one writer, settings, refusals, what changed."""

from __future__ import annotations

import logging
import shutil
import threading
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, cast

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from sqlalchemy.orm import Session
from starlette.exceptions import HTTPException

from ballscrew.base.errors import BallscrewError, InputError, printable
from ballscrew.service.logs import short_path
from ballscrew.service.settings import ServerSettings
from ballscrew.store.database import translated
from ballscrew.store.opened import BY_SERVER, OpenStore

_log = logging.getLogger("ballscrew.service")

TOO_LARGE, UNPROCESSABLE, TOO_MANY, UNAVAILABLE, FULL = 413, 422, 429, 503, 507
_LATER = {"Retry-After": "60"}


class RefusedError(BallscrewError):
    """A request that is refused.

    Parameters
    ----------
    status : int
        HTTP status.
    message : str
        A sentence.
    headers : mapping, optional
        Of the answer.
    document : mapping, optional
        Further keys of the answer.
    """

    def __init__(
        self,
        status: int,
        message: str,
        headers: Mapping[str, str] | None = None,
        document: Mapping[str, Any] | None = None,
    ) -> None:
        super().__init__(message)
        self.status = status
        self.headers = dict(headers or {})
        self.document = dict(document or {})


class UnknownAxisError(RefusedError):
    """There is no axis of a name.

    Parameters
    ----------
    axis : str
        The name.
    message : str
        A sentence.
    """

    def __init__(self, axis: str, message: str) -> None:
        super().__init__(404, message)
        self.axis = axis


class ServedStore(OpenStore):
    """A store whose lock this process holds for as long as it serves: its threads write in turn."""

    pooled = True

    def __init__(self, path: str | Path) -> None:
        super().__init__(path)
        self._turn = threading.RLock()

    @contextmanager
    def read(self) -> Iterator[Session]:
        """As :meth:`OpenStore.read`; what is wrong with the database is a refusal."""
        with _available(), super().read() as session:
            yield session

    @contextmanager
    def write(self, purpose: str, *, beside_server: bool = False) -> Iterator[Session]:  # noqa: ARG002  the lock is held
        """As :meth:`OpenStore.write`, among the threads of this process."""
        self.check_writable()
        with (
            self._turn,
            _available(),
            translated(self.path),
            Session(self.engine(writing=True), info={BY_SERVER: True}) as session,
            session.begin(),
        ):
            yield session

    def check_writable(self) -> None:
        """Refuse to write to a damaged store."""
        try:
            self.folder.check_writable()
        except InputError as error:
            sentence = str(error).removeprefix(f"{self.path}: ")  # which no caller needs
            raise RefusedError(UNAVAILABLE, sentence, _LATER) from None


@contextmanager
def _available() -> Iterator[None]:
    """Refuse a request after an error of the database; the sender may repeat it."""
    try:
        yield
    except InputError as error:
        if error.__cause__ is None:  # what was sent is wrong
            raise
        status = FULL if "full" in str(error) else UNAVAILABLE
        raise RefusedError(status, str(error), _LATER) from error


@dataclass
class Service:
    """A service that runs.

    Parameters
    ----------
    store : ServedStore
        The store.
    settings : ServerSettings
        Settings.
    origins : mapping of str to str, optional
        Where each setting comes from.
    """

    store: ServedStore
    settings: ServerSettings
    origins: Mapping[str, str] = field(default_factory=dict)
    changes: int = 0
    stopping: threading.Event = field(default_factory=threading.Event)
    work: threading.Condition = field(default_factory=threading.Condition)
    refusals: Counter[int] = field(default_factory=Counter)
    heartbeats: Counter[str] = field(default_factory=Counter)
    turn: threading.Lock = field(default_factory=threading.Lock)
    token_uses: dict[int, str] = field(default_factory=dict)

    @contextmanager
    def computing(self, what: str) -> Iterator[None]:
        """Compute something in the thread of a request; 503 while another request does."""
        if not self.turn.acquire(blocking=False):
            message = f"{what} cannot be computed while another request computes; try again."
            raise RefusedError(UNAVAILABLE, message, {"Retry-After": "10"})
        try:
            yield
        finally:
            self.turn.release()

    @property
    def partial(self) -> Path:
        """Folder of files that are received."""
        return self.store.path / "partial"

    @property
    def scratch(self) -> Path:
        """Folder of the temporary files of workers."""
        return self.store.path / "scratch"

    def announce(self) -> None:
        """Wake those that wait for work or for changes."""
        with self.work:
            self.changes += 1
            self.work.notify_all()

    def free_bytes(self) -> int:
        """Free space of the disk of the raw files."""
        return shutil.disk_usage(self.store.folder.files).free


def service_of(request: Request) -> Service:
    """The service of a request."""
    found: Service = request.app.state.service
    return found


def answer_errors(app: FastAPI) -> None:
    """Answer every refusal, wrong input and unexpected error with a sentence."""
    app.add_exception_handler(BallscrewError, _refuse)
    app.add_exception_handler(RequestValidationError, _refuse_invalid)
    app.add_exception_handler(HTTPException, _refuse_http)
    app.add_exception_handler(Exception, _report)


def answer_refusal(error: BallscrewError) -> JSONResponse:
    """Answer to a request that is refused, or whose content is wrong."""
    if isinstance(error, RefusedError):
        return JSONResponse({"detail": str(error), **error.document}, error.status, error.headers)
    return JSONResponse({"detail": str(error)}, UNPROCESSABLE)


def _refuse(request: Request, error: Exception) -> JSONResponse:  # noqa: ARG001  as Starlette calls it
    return answer_refusal(cast("BallscrewError", error))


def _refuse_invalid(request: Request, error: Exception) -> JSONResponse:  # noqa: ARG001
    """Sentence about a parameter or a body that is not valid."""
    first = cast("RequestValidationError", error).errors()[0]
    place = ".".join(map(str, first["loc"]))
    reason = first["msg"].removeprefix("Value error, ")
    return JSONResponse({"detail": printable(f"{place}: {reason}.")}, UNPROCESSABLE)


def _refuse_http(request: Request, error: Exception) -> JSONResponse:  # noqa: ARG001
    found = cast("HTTPException", error)
    return JSONResponse({"detail": f"{found.detail}."}, found.status_code, found.headers)


def _report(request: Request, error: Exception) -> JSONResponse:
    """Answer after an unexpected error."""
    _log.error("%s %s", request.method, short_path(request.url.path), exc_info=error)
    return JSONResponse({"detail": "unexpected error: this is a bug; see the server's log."}, 500)
