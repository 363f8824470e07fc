"""Stores of every schema are migrated, and give the answers that they gave."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import select

from ballscrew.store.opened import OpenStore
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
