"""Data folder of a store: where its parts lie, who uses it, and whether it is damaged."""

from __future__ import annotations

import getpass
import json
import os
import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from datetime import UTC, datetime
from pathlib import Path
from typing import IO, Any

from ballscrew.base.errors import InputError
from ballscrew.base.files import write_text
from ballscrew.base.locks import try_lock, unlock
from ballscrew.base.tomlfile import read_toml

_PATIENCE = 60.0  # s; a command writes for less than a second, a large run for a few
_LAYOUT = 1
_CONFIG = "store.toml"


_simulated_time: ContextVar[datetime | None] = ContextVar("simulated_time", default=None)


def now() -> str:
    """Current time, ISO 8601; within :func:`at_time` that time."""
    return (_simulated_time.get() or datetime.now(UTC)).isoformat(timespec="milliseconds")


@contextmanager
def at_time(time: datetime) -> Iterator[None]:
    """Let rows that this thread adds in the block have a time of a simulated history."""
    token = _simulated_time.set(time)
    try:
        yield
    finally:
        _simulated_time.reset(token)


def actor() -> str:
    """Who runs this process: user and host."""
    user = "unknown"
    with suppress(KeyError, OSError, ImportError):  # a container may have no such user
        user = getpass.getuser()
    return f"{user}@{socket.gethostname()}"


def check_outside_stores(target: Path) -> None:
    """Check that a folder to write to is not in a store, whose files could be replaced or removed.

    Raises
    ------
    InputError
        If it is.
    """
    resolved = target.resolve()
    for folder in (resolved, *resolved.parents):
        if (folder / _CONFIG).is_file():
            raise InputError(f"{target}: is in the store {folder}; give a folder outside of it.")


class DataFolder:
    """Data folder of a store.

    Parameters
    ----------
    path : Path
        The folder.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.sqlite = path / "store.sqlite"
        self.files = path / "files"
        self._config = path / _CONFIG
        self._damage = path / "damaged.txt"
        self._lock = path / "store.lock"
        self._checks = path / "store.checks.json"

    def exists(self) -> bool:
        """Whether the folder contains a store."""
        return self._config.is_file()

    def create(self, url: str | None, *, simulated: bool = False) -> None:
        """Write store.toml, which makes a folder a store: the last step of its creation."""
        self.files.mkdir(parents=True, exist_ok=True)
        text = f"layout = {_LAYOUT}\n"
        if url is not None:
            text += f"database = {json.dumps(url)}\n"
        if simulated:
            text += "simulated = true\n"
        write_text(self._config, text)
        if url is not None:  # may contain a password
            self._config.chmod(0o600)

    def database_url(self) -> str | None:
        """URL of the database; None for SQLite in the folder."""
        if not self.exists():
            raise InputError(f"{self.path}: is not a store; 'ballscrew store init {self.path}' creates one.")
        fields = read_toml(self._config)
        fields.only(["layout", "database", "simulated"])
        layout = fields.table.get("layout")
        if layout is None:
            raise InputError(f"{self._config}: is empty or cut: restore it from a backup of the store.")
        if layout != _LAYOUT:
            raise InputError(
                f"{self.path}: the layout of the store is {layout!r}; this version reads {_LAYOUT}."
            )
        return fields.text("database", "") or None

    def is_simulated(self) -> bool:
        """Whether the store is that of a simulated plant."""
        return bool(read_toml(self._config).table.get("simulated", False))

    def mark_damaged(self, faults: list[str]) -> None:
        """Refuse to write until a verification finds no fault; without faults, permit it again."""
        if faults:
            write_text(self._damage, "\n".join(faults) + "\n")
        elif self._damage.exists():
            self._damage.unlink()

    def check_writable(self) -> None:
        """Refuse to write to a damaged store."""
        if self._damage.exists():
            first = self._damage.read_text(encoding="utf-8", errors="replace").split("\n")[0]
            raise InputError(
                f"{self.path}: the store is damaged and only read ({first}): restore a backup to another "
                "folder; after a repair, 'ballscrew store verify' permits writing again."
            )

    def note_check(self, kind: str, **result: Any) -> None:
        """Note that the store was verified or backed up, and with which result, where it can be written."""
        if not self.exists():
            return
        with suppress(OSError, InputError):
            write_text(self._checks, json.dumps(self.checks() | {kind: {"at": now(), **result}}) + "\n")

    def checks(self) -> dict[str, Any]:
        """Time and result of the last ``verification`` and ``backup``, where they are known."""
        with suppress(OSError, ValueError):
            found = json.loads(self._checks.read_text(encoding="utf-8"))
            if isinstance(found, dict):
                return found
        return {}

    @contextmanager
    def locked(self, purpose: str, *, serving: bool = False) -> Iterator[None]:
        """Hold the lock of the folder; one process at a time writes.

        Parameters
        ----------
        purpose : str
            What is done, for the messages of others.
        serving : bool
            Whether it is held for as long as the process runs: others do not wait for it.

        Yields
        ------
        None
            While it is held.

        Raises
        ------
        InputError
            If another process holds it for long or serves, or the folder cannot be written.
        """
        try:
            stream = self._lock.open("a+", encoding="utf-8")
        except OSError as error:
            raise InputError(f"{self.path}: cannot be written ({error.strerror or error}).") from None
        with stream:
            self._wait(stream)
            holder = {"purpose": purpose, "by": actor(), "process": os.getpid(), "since": now()}
            stream.truncate(0)
            stream.write(json.dumps(holder | {"serving": serving}))
            stream.flush()
            try:
                yield
            finally:
                stream.truncate(0)
                unlock(stream)

    def is_served(self) -> bool:
        """Whether a server holds the lock."""
        if not self._lock.is_file():
            return False
        try:
            with self._lock.open("a+", encoding="utf-8") as stream:
                if try_lock(stream):
                    unlock(stream)
                    return False
        except OSError as error:
            raise InputError(f"{self.path}: cannot be written ({error.strerror or error}).") from None
        return bool(self._holder().get("serving"))

    def _wait(self, stream: IO[str]) -> None:
        deadline = time.monotonic() + _PATIENCE
        while not try_lock(stream):
            holder = self._holder()
            if holder.get("serving") or time.monotonic() > deadline:
                words = "another process"
                if holder:
                    words = "{purpose}, process {process} of {by} since {since}".format_map(holder)
                raise InputError(f"{self.path}: the store is in use by {words}; it can be read meanwhile.")
            time.sleep(0.01)

    def _holder(self) -> dict[str, Any]:
        """Who holds the lock; empty where that is not known."""
        with suppress(OSError, ValueError):
            found = json.loads(self._lock.read_text(encoding="utf-8"))
            if isinstance(found, dict) and {"purpose", "process", "by", "since"} <= set(found):
                return found
        return {}
