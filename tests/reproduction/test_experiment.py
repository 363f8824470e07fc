"""Experiments: what stays of the recordings, and when a run is inspected."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from tests.store.stored import RUNS

from ballscrew.base.errors import InputError
from ballscrew.reproduction import experiment
from ballscrew.reproduction.experiment import measured_runs

NAMES = ("first", "second")


@pytest.fixture(autouse=True)
def _quick_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    """Recordings and analyses that take no time."""

    def simulate(planned: Any, folder: Path, _progress: Any) -> Iterator[Any]:
        for run in planned:
            path = folder / run.name / "run.toml"
            path.parent.mkdir()
            path.write_text(run.name)
            yield run, SimpleNamespace(run=path)

    monkeypatch.setattr(experiment, "simulated_runs", simulate)
    monkeypatch.setattr(experiment, "analyze", lambda path: RUNS[NAMES.index(path.read_text())])
    monkeypatch.setattr(experiment, "truth", lambda *_: {})


def planned() -> list[Any]:
    return [SimpleNamespace(name=name, rig=None, plan=None, load=None) for name in NAMES]


@pytest.mark.parametrize("keep", [False, True])
def test_each_run_is_inspected_while_its_recordings_exist(tmp_path: Path, keep: bool) -> None:
    inspected = []

    def inspect(run: Any, files: Any, result: Any) -> None:
        inspected.append((run.name, files.run.is_file(), result.id))

    found = list(measured_runs(planned(), tmp_path, lambda *_: None, keep=keep, inspect=inspect))
    assert [each.run.id for each in found] == [RUNS[0].id, RUNS[1].id]
    assert inspected == [("first", True, RUNS[0].id), ("second", True, RUNS[1].id)]
    paths = sorted(str(path.relative_to(tmp_path)) for path in tmp_path.rglob("*") if path.is_file())
    results = [f"runs/{name}.json" for name in NAMES]
    assert paths == ([f"recordings/{name}/run.toml" for name in NAMES] if keep else []) + results
    assert [path.name for path in tmp_path.iterdir() if path.is_dir()].count("recordings") == int(keep)


def test_recordings_that_are_there_already_are_not_touched(tmp_path: Path) -> None:
    (tmp_path / "recordings").mkdir()
    (tmp_path / "recordings" / "mine").write_text("x")
    with pytest.raises(InputError, match="exists already; move it, or choose another --out"):
        list(measured_runs(planned(), tmp_path, lambda *_: None, keep=True))
    assert [path.name for path in (tmp_path / "recordings").iterdir()] == ["mine"]
