"""A process that is killed leaves no half of anything: ``benchmarks/store_kills.py``, a few times."""

from __future__ import annotations

import os
from collections.abc import Callable

import pytest

from ballscrew.modal import analyze
from ballscrew.store import analysing, database, migrating, tables
from benchmarks import store_kills

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")


@pytest.fixture(autouse=True)
def unchanged(monkeypatch: pytest.MonkeyPatch) -> None:
    """The benchmark replaces these."""
    for module in (analyze, analysing):
        monkeypatch.setattr(module, "examine", module.examine)


@pytest.mark.parametrize(
    "new_url", ["sqlite", pytest.param("postgresql", marks=pytest.mark.slow)], indirect=True
)
def test_nothing_acknowledged_is_lost_and_nothing_doubled(new_url: Callable[[], str | None]) -> None:
    outcomes = store_kills.kill_all(8, url=new_url(), seed=3)
    killed = {key: number for key, number in outcomes.items() if key[1] != "not killed"}
    assert sum(killed.values()) == 8
    assert migrating.SCHEMA == database.SCHEMA == tables.SCHEMA
