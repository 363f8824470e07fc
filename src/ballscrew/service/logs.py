"""Log of the service: a line for each request, as JSON in a file of the data folder; on stderr also as text.

A line has no body, no query, no header, and of a long part of a path its first characters alone: it contains
no token and no password.
"""

from __future__ import annotations

import json
import logging
import re
import secrets
import sys
import time
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from logging.handlers import RotatingFileHandler
from pathlib import Path
from typing import Any

from starlette.datastructures import MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from ballscrew.store.opened import requested_by

LOG_FILE = "server.log"
"""In the data folder, with three former ones of a megabyte each."""

_log = logging.getLogger("ballscrew.requests")

_BYTES, _FORMER = 1 << 20, 3
_LOGGERS = ("ballscrew", "uvicorn.error")
_LONG_PART = re.compile(r"[A-Za-z0-9_~.-]{24,}")  # of a path: an id, or a secret of a link


class RequestLog:
    """Log of each request with its number, caller, status and duration; who asks is stated in the audit.

    Parameters
    ----------
    app : ASGI application
        What answers.
    """

    def __init__(self, app: ASGIApp) -> None:
        self.app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on, and log its answer."""
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        number, begin, status = secrets.token_hex(6), time.monotonic(), 500

        async def answer(message: Message) -> None:
            nonlocal status
            if message["type"] == "http.response.start":
                status = message["status"]
                MutableHeaders(scope=message)["X-Request-Id"] = number
            await send(message)

        try:
            with requested_by(lambda: (_caller(scope), _address(scope))):
                await self.app(scope, receive, answer)
        finally:
            fields = {
                "request": number,
                "caller": _caller(scope),
                "address": _address(scope),
                "method": scope["method"],
                "path": short_path(scope["path"]),
                "route": _route(scope),
                "status": status,
                "ms": round(1000 * (time.monotonic() - begin), 1),
            }
            _log.info("request", extra={"fields": fields})


def short_path(path: str) -> str:
    """Path with the first characters alone of what may be the secret of a link."""
    return _LONG_PART.sub(lambda part: f"{part[0][:8]}…", path)


def _caller(scope: Scope) -> str | None:
    """Name of who asks; None before the caller is known."""
    caller = scope.get("state", {}).get("caller")
    return None if caller is None else str(caller.name)


def _address(scope: Scope) -> str:
    client = scope.get("client")
    return client[0] if client else "unknown address"


def _route(scope: Scope) -> str | None:
    """Path of the route with the names of its parameters in place of their values."""
    return getattr(scope.get("route"), "path", None)


class JsonLines(logging.Formatter):
    """Each record as one line of JSON."""

    def format(self, record: logging.LogRecord) -> str:
        """Line of a record: with its fields, or its text, its template and its error."""
        at = datetime.fromtimestamp(record.created, UTC).isoformat(timespec="milliseconds")
        line: dict[str, Any] = {"at": at, "level": record.levelname, "logger": record.name}
        line["event"] = str(record.msg)
        line |= getattr(record, "fields", {})
        if record.args:
            line["message"] = record.getMessage()
        if record.exc_info and record.exc_info[0] is not None:
            kind, error, trace = record.exc_info
            line["error"] = kind.__name__
            line["error_message"] = str(error)
            line["trace"] = [
                f"{Path(frame.filename).name}:{frame.lineno} {frame.name}"
                for frame in traceback.extract_tb(trace)
            ]
        return json.dumps(line, ensure_ascii=False, default=str)


class _QuietFile(RotatingFileHandler):
    """File that the service does without where it cannot be written, such as on a full disk."""

    def handleError(self, record: logging.LogRecord) -> None:  # noqa: ARG002, N802  as logging calls it
        return


@contextmanager
def logging_to(folder: Path, form: str) -> Iterator[None]:
    """Log to a file of the data folder and to stderr, as long as the block lasts.

    Parameters
    ----------
    folder : Path
        Data folder.
    form : {"text", "json"}
        On stderr: warnings as text, or every line as JSON.

    Yields
    ------
    None
        While it is logged.
    """
    file = _QuietFile(folder / LOG_FILE, maxBytes=_BYTES, backupCount=_FORMER, encoding="utf-8", delay=True)
    file.setFormatter(JsonLines())
    screen = logging.StreamHandler(sys.stderr)
    screen.setLevel(logging.WARNING)
    if form == "json":
        screen.setLevel(logging.INFO)
        screen.setFormatter(JsonLines())
    changed = []
    for name in _LOGGERS:
        logger = logging.getLogger(name)
        changed.append((logger, logger.level))
        logger.setLevel(logging.INFO)
        for handler in (file, screen):
            logger.addHandler(handler)
    try:
        yield
    finally:
        for logger, level in changed:
            logger.setLevel(level)
            for handler in (file, screen):
                logger.removeHandler(handler)
        file.close()


def read_log(folder: Path, most: int) -> list[dict[str, Any]]:
    """Last lines of the log, the oldest first; one that is cut is left out.

    Parameters
    ----------
    folder : Path
        Data folder.
    most : int
        How many.

    Returns
    -------
    list of dict
        Lines.
    """
    lines: list[str] = []
    for path in (folder / f"{LOG_FILE}.1", folder / LOG_FILE):
        if path.is_file():
            with path.open(encoding="utf-8", errors="replace") as stream:
                lines += stream
    found = []
    for line in lines[-most:]:
        try:
            document = json.loads(line)
        except ValueError:
            continue
        if isinstance(document, dict):
            found.append(document)
    return found
