"""Stores on both databases; PostgreSQL is a real server, started as a user of its own."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from itertools import count
from pathlib import Path

import pytest
from tests.store.servers import PostgreSQL, find_postgresql

from ballscrew.store.store import Store

NewStore = Callable[[], Store]
_NUMBERS = count()


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


@pytest.fixture(params=["sqlite", "postgresql"])
def new_url(request: pytest.FixtureRequest) -> Callable[[], str | None]:
    """URLs of new databases, of each kind; None for SQLite."""
    if request.param == "sqlite":
        return lambda: None
    server: PostgreSQL = request.getfixturevalue("postgresql")
    return server.new_database


@pytest.fixture
def new_store(new_url: Callable[[], str | None], tmp_path: Path) -> NewStore:
    """Makes empty stores."""

    def make() -> Store:
        path = tmp_path / f"store{next(_NUMBERS)}"
        Store.init(path, database=new_url())
        return Store(path)

    return make


@pytest.fixture
def store(new_store: NewStore) -> Store:
    """An empty store."""
    return new_store()
