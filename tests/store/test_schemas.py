"""Stores of every schema are migrated, and give the answers that they gave."""

from __future__ import annotations

import json
import shutil
import sqlite3
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import select

from ballscrew.store.calendars import EVERY_DAY, calendar_of
from ballscrew.store.opened import OpenStore
from ballscrew.store.rows import checksum_of_values
from ballscrew.store.service_tables import Setup
from ballscrew.store.store import Store
from ballscrew.store.tables import SCHEMA, Audit

SCHEMAS = sorted(Path(__file__).parent.glob("schema-*"))


def test_there_is_a_store_of_this_schema() -> None:
    assert SCHEMAS[-1].name == f"schema-{SCHEMA}"


def assert_contains(found: Any, expected: Any) -> None:
    """Every value of an earlier version is there; a later one may add keys."""
    if isinstance(expected, dict):
        for key, value in expected.items():
            if key == "newest_at":  # of the newest assessed run, as it was
                key = "assessed_until"
            assert_contains(found[key], value)
    elif isinstance(expected, list):
        assert len(found) == len(expected)
        for each, value in zip(found, expected, strict=True):
            assert_contains(each, value)
    else:
        assert found == expected


@pytest.mark.parametrize("folder", SCHEMAS, ids=lambda path: path.name)
def test_a_store_of_an_earlier_schema_gives_its_answers(folder: Path, tmp_path: Path) -> None:
    shutil.copytree(folder, tmp_path / "store")
    expected = json.loads((folder / "answers.json").read_text(encoding="utf-8"))
    assert Store.migrate(tmp_path / "store") == folder.name.removeprefix("schema-")
    store = Store(tmp_path / "store")
    assert store.verify(store.path).faults == ()
    assert_contains([store.show("bench"), store.list()], expected)
    assert store.monitor("bench").monitored.state.axis == "bench"
    with OpenStore(store.path).read() as session:
        migrated = session.scalars(select(Audit).where(Audit.action == "migrate")).all()
    schemas = [[folder.name.removeprefix("schema-"), SCHEMA]]
    assert [row.detail["changed"]["schema"] for row in migrated] == [
        each for each in schemas if each[0] != SCHEMA
    ]


@pytest.mark.parametrize("damage", [0, 1])
def test_a_schedule_of_schema_0005_is_that_of_the_server_after_the_migration(
    tmp_path: Path, damage: int
) -> None:
    path = tmp_path / "store"
    shutil.copytree(Path(__file__).parent / "schema-0005", path)
    row = {"axis_id": 1, "sheet": None, "plan": None, "channels": None, "period_s": 3600.0, "grace_s": 60.0}
    row["set_up_at"] = "2026-01-01T00:00:00+00:00"
    with closing(sqlite3.connect(path / "store.sqlite")) as database, database:
        database.execute(
            "INSERT INTO setups VALUES (?, ?, ?, ?, ?, ?, ?, ?)",
            (*row.values(), checksum_of_values(row) + damage),
        )
    Store.migrate(path)
    assert len(Store(path).verify(path).faults) == damage
    with OpenStore(path).read() as session:
        setup = session.get_one(Setup, 1)
    assert (setup.period_s, setup.grace_s, setup.calendar) == (3600.0, 60.0, None)
    assert calendar_of(setup, EVERY_DAY) is EVERY_DAY
