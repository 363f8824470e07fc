"""Stores on both databases; PostgreSQL is a real server, started as a user of its own."""

from __future__ import annotations

import os
import shutil
import sqlite3
from collections.abc import Callable, Iterator
from itertools import count
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import Dialect, Engine, event
from sqlalchemy.pool import Pool
from tests.store.servers import PostgreSQL, find_postgresql
from tests.store.stored import fill

from ballscrew.store.folder import DataFolder
from ballscrew.store.store import Store

NewStore = Callable[[], Store]
CopyStore = Callable[[Callable[[Store], object]], Store]
_TEMPLATES: dict[tuple[object, object], Store] = {}
_NUMBERS = count()


@event.listens_for(Pool, "connect")
def without_fsync(connection: Any, _: object) -> None:
    """A process that is killed leaves the same rows with and without."""
    if isinstance(connection, sqlite3.Connection):
        connection.execute("PRAGMA synchronous = OFF")


@event.listens_for(Engine, "do_connect")
def without_encryption(
    dialect: Dialect, _record: object, _arguments: object, options: dict[str, Any]
) -> None:
    """A server that refuses to encrypt is not asked: the certificates that would be loaded take 40 ms."""
    if dialect.driver == "pg8000":
        options.setdefault("ssl_context", False)


@pytest.fixture
def with_fsync() -> Iterator[None]:
    """Connections as users have them."""
    event.remove(Pool, "connect", without_fsync)
    yield
    event.listen(Pool, "connect", without_fsync)


@pytest.fixture(scope="module", autouse=True)
def _few_members(few_members: None) -> None:
    """A store does the same with the forecast of any number of members."""


@pytest.fixture(scope="session")
def postgresql() -> Iterator[PostgreSQL]:
    """A server; skipped where it is not installed, unless BALLSCREW_REQUIRE_POSTGRESQL is set."""
    reason = find_postgresql()
    if isinstance(reason, str):
        if os.environ.get("BALLSCREW_REQUIRE_POSTGRESQL") == "1":
            pytest.fail(reason)
        pytest.skip(reason)
    server = PostgreSQL(reason)
    server.start()
    yield server
    server.remove()


def _sqlite(template: str | None = None) -> None:
    """SQLite has no URL."""


@pytest.fixture(params=["sqlite", "postgresql"])
def new_url(request: pytest.FixtureRequest) -> Callable[..., str | None]:
    """URLs of new databases, of each kind; None for SQLite."""
    if request.param == "sqlite":
        return _sqlite
    server: PostgreSQL = request.getfixturevalue("postgresql")
    return server.new_database


def _leave_empty(store: Store) -> None:
    """What a new store contains."""


class PooledStore(Store):
    """As in a server: to connect to PostgreSQL for each transaction takes most of the time of these tests."""

    pooled = True


@pytest.fixture
def copy_store(
    new_url: Callable[..., str | None], tmp_path: Path, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[CopyStore]:
    """Makes stores with what a function adds to them: once for each database, and then copies."""
    made: list[Store] = []

    def copy(add: Callable[[Store], object]) -> Store:
        template = _TEMPLATES.get((add, new_url))
        if template is None:
            path = tmp_path_factory.mktemp("template") / "store"
            Store.init(path, database=new_url())
            template = Store(path)
            add(template)
            _TEMPLATES[add, new_url] = template
        path = tmp_path / f"store{next(_NUMBERS)}"
        shutil.copytree(template.path, path)
        url = template.folder.database_url()
        if url is not None:
            DataFolder(path).create(new_url(template=url))
        made.append(PooledStore(path))
        return made[-1]

    yield copy
    for each in made:
        for engine in each._engines.values():
            engine.dispose()


@pytest.fixture
def new_store(copy_store: CopyStore) -> NewStore:
    """Makes empty stores."""
    return lambda: copy_store(_leave_empty)


@pytest.fixture
def store(new_store: NewStore) -> Store:
    """An empty store."""
    return new_store()


@pytest.fixture
def filled(copy_store: CopyStore) -> Store:
    """A store of an axis that wears: runs, model and events."""
    return copy_store(fill)
