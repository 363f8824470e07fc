"""An open store: its folder, its database, and transactions of readers and of the one writer."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from contextvars import ContextVar
from pathlib import Path
from typing import Any

from sqlalchemy import Engine, select
from sqlalchemy.orm import Session

from ballscrew.base.errors import InputError
from ballscrew.store.database import check_schema, make_engine, sqlite_url, translated, undisturbed
from ballscrew.store.folder import DataFolder, actor, now
from ballscrew.store.tables import Audit

SERVER, COMMAND_LINE = "server", "command line"
"""Places from which something is requested, besides the addresses of clients."""

BY_SERVER = "by server"
"""Key of the information of a session whose process serves the store."""


class OpenStore:
    """A store that is open.

    Parameters
    ----------
    path : path-like
        Data folder of the store.

    Raises
    ------
    InputError
        If the folder contains no store, or one of another schema.
    """

    pooled = False  # whether connections are used again: in a process that serves requests

    def __init__(self, path: str | Path) -> None:
        self.folder = DataFolder(Path(path))
        self.url = self.folder.database_url() or sqlite_url(self.folder.sqlite)
        self._engines: dict[bool, Engine] = {}
        with translated(self.folder.path), self.engine(writing=False).connect() as connection:
            check_schema(connection, self.folder.path)

    @property
    def path(self) -> Path:
        """Data folder."""
        return self.folder.path

    def engine(self, *, writing: bool) -> Engine:
        """Engine of the database."""
        if writing not in self._engines:
            self._engines[writing] = make_engine(self.url, writing=writing, pooled=self.pooled)
        return self._engines[writing]

    @contextmanager
    def read(self) -> Iterator[Session]:
        """Read one consistent state.

        Yields
        ------
        Session
            Closed with the block: no reader stays open.
        """
        with (
            translated(self.path),
            undisturbed(self.folder.sqlite),
            Session(self.engine(writing=False)) as session,
        ):
            yield session

    @contextmanager
    def write(self, purpose: str, *, beside_server: bool = False) -> Iterator[Session]:
        """Write in one transaction, which is durable when the block ends without an error.

        Parameters
        ----------
        purpose : str
            For those that wait for it.
        beside_server : bool
            Whether it is also written while a server holds the lock: rows alone, which the server reads anew
            for each request. The database lets transactions write in turn.

        Yields
        ------
        Session
            Rolled back after an error.

        Raises
        ------
        InputError
            If the store is damaged, in use, or cannot be written.
        """
        self.folder.check_writable()
        lock: AbstractContextManager[None] = self.folder.locked(purpose)
        if beside_server and self.folder.is_served():
            lock = nullcontext()
        with (
            translated(self.path),
            lock,
            Session(self.engine(writing=True)) as session,
            session.begin(),
        ):
            yield session


def why_read_only(store: OpenStore, purpose: str) -> str | None:
    """Sentence why a store cannot be written now; None if it can."""
    try:
        with store.write(purpose) as session:
            session.connection()  # begins the transaction
    except InputError as error:
        return str(error)
    return None


Requester = Callable[[], tuple[str | None, str]]

_requester: ContextVar[Requester | None] = ContextVar("requester", default=None)


@contextmanager
def requested_by(requester: Requester) -> Iterator[None]:
    """State in the audit who wants what is written in the block.

    Parameters
    ----------
    requester : callable
        Gives the name, None where it is not known yet, and the place, such as the address of a client.
    """
    token = _requester.set(requester)
    try:
        yield
    finally:
        _requester.reset(token)


def record(session: Session, action: str, subject: str, **detail: Any) -> None:
    """Add a row to the audit.

    It contains the checksum of the row before it, so that ``verify`` finds one that is missing, who requested
    it, and from where: the address of a client, ``server`` for what the server does by itself, or
    ``command line``.

    Parameters
    ----------
    session : Session
        Writing.
    action, subject : str
        What is done to what.
    **detail
        More; ``axis`` is the name of the axis, and ``changed`` has the value before and after by its name.
    """
    requester = _requester.get()
    if requester is not None:
        name, place = requester()
    elif session.info.get(BY_SERVER):
        name, place = SERVER, SERVER
    else:
        name, place = None, COMMAND_LINE
    detail.setdefault("by", name or actor())
    detail["from"] = place
    newest = select(Audit.checksum).order_by(Audit.id.desc()).limit(1)
    detail["after"] = session.scalar(newest)  # which flushes those before
    session.add(Audit(at=now(), actor=actor(), action=action, subject=subject, detail=detail))
