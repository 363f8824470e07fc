"""The lines of Python in the pages run."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.docs.pages import blocks, first_column, load, page

import ballscrew
from ballscrew.base.jsonfile import SCHEMA
from ballscrew.base.tables import FREQUENCY_RESPONSE
from ballscrew.recording.readers import Reader


def test_every_public_name_is_in_the_reference() -> None:
    text = page("docs/reference/python.md")
    missing = [name for name in ballscrew.__all__ if f"`{name} <" not in text and f"``{name}``" not in text]
    assert missing == []


@pytest.fixture
def bench_folder(bench: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The bench's first state with its TOML files, in a folder that can be written to."""
    for path in [*bench.glob("*.toml"), *bench.glob("preload-4-percent-trip*.h5")]:
        shutil.copy(path, tmp_path)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def run_python(source: str, space: dict[str, Any]) -> None:
    exec(compile(source, "docs", "exec"), space)  # noqa: S102  the pages' own lines


@pytest.mark.usefixtures("bench_folder", "fitted_once")
def test_the_readmes_lines_run(capsys: pytest.CaptureFixture[str]) -> None:
    (block,) = [block for block in blocks(page("README.md")) if block.language == "python"]
    assert len(block.body.splitlines()) <= 10
    space: dict[str, Any] = {}
    run_python(block.body, space)
    printed = capsys.readouterr().out.splitlines()
    assert printed[0] == "good"
    assert len(printed) == 2 + 40
    assert space["response"].sizes["cell"] == 40
    assert space["document"]["schema"] == SCHEMA


@pytest.mark.usefixtures("bench_folder", "fitted_once")
def test_the_python_page_runs(capsys: pytest.CaptureFixture[str]) -> None:
    space: dict[str, Any] = {}
    for block in blocks(page("docs/howto/python.md")):
        if block.language == "python":
            run_python(block.body, space)
    printed = capsys.readouterr().out
    assert "no-such-file.h5: cannot be read" in printed
    assert "acceleration:nut-1:x" in printed
    assert 160 < float(space["peak"]) < 180
    assert space["other"].id == space["run"].id
    assert space["estimate"].relative_to_baseline.value == pytest.approx(1.0, abs=1e-6)


def test_the_reader_page_makes_a_reader(tmp_path: Path) -> None:
    text = page("docs/howto/reader.md")
    source = next(block for block in blocks(text) if block.options.get("caption") == "our_logger.py")
    (tmp_path / "our_logger.py").write_text(source.body, encoding="utf-8")
    reader = load(tmp_path / "our_logger.py").LoggerReader()
    assert isinstance(reader, Reader)
    rows = np.arange(30, dtype="<f4").reshape(10, 3)
    path = tmp_path / "a.log"
    path.write_bytes(b"OURLOG01" + np.array(12800.0, "<f8").tobytes() + rows.tobytes())
    assert reader.can_open(path, path.read_bytes()[:4096])
    assert not reader.can_open(path, b"CSV;1;2")
    header = reader.read_header(path)
    assert (header.sample_rate, header.channels[0].size, header.channels[2].unit) == (12800.0, 10, "g")
    np.testing.assert_array_equal(reader.read(path, ["position"])["position"], rows[:, 1])


def test_the_spectra_page_names_every_column() -> None:
    documented = set(first_column(page("docs/howto/spectra.md")))
    assert documented == set(FREQUENCY_RESPONSE.variables) | set(FREQUENCY_RESPONSE.coords)
