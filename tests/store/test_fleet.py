"""Simulated fleets of axes."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.store.stored import count

from ballscrew.base.errors import InputError
from ballscrew.store import fleet
from ballscrew.store.fleet import simulate_fleet
from ballscrew.store.store import Store
from ballscrew.store.tables import CellRow, RunRow


def test_rows_that_are_written_in_parts_are_those_of_one_part(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    numbers = []
    for name, batch in (("a", 20_000), ("b", 20)):
        monkeypatch.setattr(fleet, "_BATCH", batch)
        store = Store.init(tmp_path / name)
        simulate_fleet(store, axes=1, years=0.2, cells=8)
        numbers.append((count(store, RunRow), count(store, CellRow)))
    assert numbers[0] == numbers[1]
    assert numbers[0][1] == 8 * numbers[0][0] > 20


def test_a_fleet_is_added_once(tmp_path: Path) -> None:
    store = Store.init(tmp_path / "a")
    simulate_fleet(store, axes=1, years=0.1, cells=8)
    number = count(store, RunRow)
    with pytest.raises(InputError, match="already; give another seed"):
        simulate_fleet(store, axes=1, years=0.1, cells=8)
    assert count(store, RunRow) == number
