"""Write ``tests/store/schema-NNNN``: a small store, from which every later version must migrate.

``python -m tests.store.make_schema_fixture`` after a change of the schema, once, before its release; never
again afterwards.
"""

from __future__ import annotations

import json
import tempfile
from dataclasses import replace
from pathlib import Path

import pytest
from tests.store.stored import RUNS, fill, imitate_analysis, write_recordings

from ballscrew.modal.analyze import AnalysisOptions
from ballscrew.store import adding
from ballscrew.store.migrating import settle
from ballscrew.store.store import Store
from ballscrew.store.tables import SCHEMA


def main() -> None:
    folder = Path(__file__).parent / f"schema-{SCHEMA}"
    with tempfile.TemporaryDirectory() as temporary, pytest.MonkeyPatch.context() as patched:
        imitate_analysis(patched)
        Store.init(Path(temporary) / "store")
        store = Store(Path(temporary) / "store")
        settings = AnalysisOptions().to_settings()
        fill(store, [replace(run, made=replace(run.made, settings=settings)) for run in RUNS[:6]])
        for day in (50.0, 51.0, 52.0):
            store.add(write_recordings(Path(temporary) / f"run{day:g}", day, files=1))
        store.correct(RUNS[2].id, measured_at="2026-01-07T09:00Z", reason="wrong clock")
        store.exclude(RUNS[3].id, reason="loose sensor")
        imitate_analysis(patched, scale=3.0)
        patched.setattr(adding, "METHOD_REVISION", 2)
        store.reprocess(switch=True)
        store.monitor("bench")
        store.backup(folder)
        settle(folder / "store.sqlite")
        (folder / "answers.json").write_text(
            json.dumps([store.show("bench"), store.list()], indent=1, sort_keys=True) + "\n", encoding="utf-8"
        )


if __name__ == "__main__":
    main()
