"""The example of the page on the drive's own signals runs, and its table is that of the benchmark."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from benchmarks.drive_signals import FORMATS, HEAD, record_of
from scipy.signal import lfilter
from tests.docs.pages import blocks, page

import ballscrew

PAGE = page("docs/howto/drive-signals.md")


@pytest.mark.slow
def test_the_example_runs(bench: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    form = FORMATS["TwinCAT Scope with speed"]
    for number in (1, 2, 3):
        record = record_of(bench / f"preload-4-percent-trip{number}.h5", 4000.0, form)
        form.write(tmp_path / f"trip{number}.csv", record)
    for name in ("axis.toml", "plan.toml"):
        (tmp_path / name).write_bytes((bench / name).read_bytes())
    found = {block.language: block.body for block in blocks(PAGE)}
    (tmp_path / "channels.toml").write_text(found["toml"], encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    space: dict[str, object] = {}
    exec(compile(found["python"], "docs", "exec"), space)  # noqa: S102  the page's own lines
    run = space["run"]
    assert repr(run).startswith("<Run> ")
    assert [cell.verdict for cell in run.cells] == ["good"] * 40  # type: ignore[attr-defined]
    assert (tmp_path / "run.csv").read_text(encoding="utf-8").count("\n") == 41


@pytest.mark.slow
def test_a_speed_that_is_smoothed_without_a_word_makes_cells_suspect(bench: Path, tmp_path: Path) -> None:
    """By a first-order filter of 1 ms, which shifts the frequencies by 0.7 to 1 Hz."""
    form = FORMATS["TwinCAT Scope with speed"]
    paths = []
    for number in (1, 2, 3):
        record = record_of(bench / f"preload-4-percent-trip{number}.h5", 4000.0, form)
        lag = math.exp(-0.25)
        paths.append(tmp_path / f"trip{number}.csv")
        speed = np.round(lfilter([1 - lag], [1, -lag], record.speed), 5)
        form.write(paths[-1], replace(record, speed=speed))
    (toml,) = (block.body for block in blocks(PAGE) if block.language == "toml")
    (tmp_path / "channels.toml").write_text(toml, encoding="utf-8")
    files = {name: bench / f"{name}.toml" for name in ("axis", "plan")}
    run = ballscrew.analyze(paths, channels=tmp_path / "channels.toml", mass="100 kg", **files)
    assert {cell.verdict for cell in run.cells} == {"suspect"}
    assert "filtered_by" in run.cells[0].reasons[-1]


def test_the_table_is_that_of_the_benchmark() -> None:
    assert HEAD.splitlines()[0] in PAGE
    names = set(re.findall(r"^\| ([^|]+?) \| \d+ \|", PAGE, re.MULTILINE))
    assert names == {*FORMATS, "10 simulated: bench", "10 simulated: random axes"}
