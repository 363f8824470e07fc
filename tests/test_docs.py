"""The documentation says what is: its commands are run, its fields and keys compared with the code's."""

from __future__ import annotations

import ast
import importlib.util
import json
import re
import shutil
import sys
from dataclasses import fields
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
import typer

import ballscrew
from ballscrew.axis.sheet import Bearing, DataSheet, Drive, Guide, Screw, Table
from ballscrew.base.errors import InputError
from ballscrew.base.jsonfile import write_json
from ballscrew.base.provenance import FileRef, Made
from ballscrew.base.tables import FREQUENCY_RESPONSE
from ballscrew.cli.app import app
from ballscrew.fcft.plan import Motion
from ballscrew.modal.run import CellResult, RigidBodyResult, Run, TransientRow
from ballscrew.modal.runfile import read_run
from ballscrew.recording.channels import ChannelMap
from ballscrew.recording.quality.finding import Quality
from ballscrew.recording.readers import Reader

ROOT = Path(__file__).parent.parent
DOCS = ROOT / "docs"


def load(path: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[path.stem] = module  # dataclasses look there for their own module
    spec.loader.exec_module(module)
    return module


WALK = load(DOCS / "tutorial" / "walk.py")
blocks = WALK.blocks


def page(name: str) -> str:
    return (ROOT / name).read_text(encoding="utf-8")


def section(text: str, heading: str) -> str:
    """What stands under a heading of the second level."""
    found = re.search(rf"^## {re.escape(heading)}\n(.*?)(?=^## |\Z)", text, re.M | re.S)
    assert found, f"there is no section {heading!r}"
    return found[1]


def first_column(text: str) -> list[str]:
    """Every code word in the first cell of the rows of tables."""
    rows = re.findall(r"^\|([^|]*)\|", text, re.M)
    return [word for row in rows for word in re.findall(r"`([^`]+)`", row)]


# --- the command line ---------------------------------------------------------------------------------------

COMMANDS: dict[str, Any] = typer.main.get_command(app).commands  # type: ignore[attr-defined]


def options_of(command: Any) -> set[str]:
    given = {name for param in command.params for name in param.opts if name.startswith("-")}
    return given - {"--help", "-h"}


def test_every_command_has_a_section_and_every_section_a_command() -> None:
    headings = re.findall(r"^## `ballscrew (\w+)`$", page("docs/reference/cli.md"), re.M)
    assert sorted(headings) == sorted(COMMANDS)


@pytest.mark.parametrize("name", sorted(COMMANDS))
def test_every_option_is_documented_and_every_documented_option_exists(name: str) -> None:
    text = section(page("docs/reference/cli.md"), f"`ballscrew {name}`")
    documented = {word for word in first_column(text) if word.startswith("-")}
    assert documented == options_of(COMMANDS[name])
    usage = next(blocks(text)).body
    assert set(re.findall(r"--[\w-]+", usage)) == options_of(COMMANDS[name])


def test_the_options_of_the_program_itself() -> None:
    text = page("docs/reference/cli.md").split("\n## ")[0]
    own = {name for param in typer.main.get_command(app).params for name in param.opts}
    assert set(first_column(text)) == own | {"--help", "-h"}


@pytest.mark.parametrize("path", [*sorted(DOCS.rglob("*.md")), ROOT / "README.md"], ids=lambda p: p.name)
def test_every_command_line_in_the_pages_can_be_typed(path: Path) -> None:
    for block in blocks(path.read_text(encoding="utf-8")):
        if block.language not in ("sh", "console"):
            continue
        for line in block.body.replace("\\\n", " ").splitlines():
            words = line.removeprefix("$ ").split()
            if words[:1] == ["ballscrew"] and words[1:2] != ["--version"]:
                assert words[1] in COMMANDS, line
                assert set(re.findall(r"(?<=\s)--[\w-]+", line)) <= options_of(COMMANDS[words[1]]), line


# --- files --------------------------------------------------------------------------------------------------


def names(kind: Any) -> set[str]:
    return {field.name for field in fields(kind)}


def test_every_field_of_the_data_sheet() -> None:
    text = section(page("docs/reference/files.md"), "axis.toml")
    parts = {"screw": Screw, "bearing": Bearing, "table": Table, "drive": Drive, "guide": Guide}
    expected = {f"{part}.{name}" for part, kind in parts.items() for name in names(kind)}
    expected |= (names(DataSheet) - set(parts) - {"source", "tolerances"}) | {"tolerances.…"}
    assert set(re.findall(r"^\| `([^`]+)`", text, re.M)) == expected


def test_every_field_of_the_plan() -> None:
    text = section(page("docs/reference/files.md"), "plan.toml")
    expected = {"positions", "repetitions", "masses"} | {f"motion.{name}" for name in names(Motion)}
    assert set(re.findall(r"^\| `([^`]+)`", text, re.M)) == expected


def known(error: pytest.ExceptionInfo[InputError]) -> set[str]:
    """The fields that the refusal of an unknown one names."""
    return set(str(error.value).split("known are ")[1].rstrip(".").split(", "))


def test_every_field_of_the_channel_map() -> None:
    text = section(page("docs/reference/files.md"), "channels.toml")
    with pytest.raises(InputError) as top:
        ChannelMap.from_settings({"nonsense": 1})
    with pytest.raises(InputError) as row:
        ChannelMap.from_settings({"channel": [{"nonsense": 1}]})
    documented = re.findall(r"^\| `([^`]+)`", text, re.M)
    assert set(documented) == (known(top) | known(row)) - {"direction"}
    assert "`direction` is the same" in text


def test_every_field_of_the_run(tmp_path: Path) -> None:
    (tmp_path / "run.toml").write_text("nonsense = 1", encoding="utf-8")
    with pytest.raises(InputError) as error:
        read_run(tmp_path / "run.toml")
    text = section(page("docs/reference/files.md"), "run.toml")
    assert set(re.findall(r"^\| `([^`]+)`", text, re.M)) == known(error)


# --- the JSON of a run --------------------------------------------------------------------------------------

KEYS = {
    "rigid_body": names(RigidBodyResult),
    "transients": names(TransientRow),
    "cells": names(CellResult),
    "made": names(Made),
}


def a_run() -> Run:
    row = TransientRow(0, 0.0, 1.0, 0.0, "PA", 0, 1)
    cell = CellResult(0.0, "PA", 0, 3, None, None, None, "paper", "refused", ("a reason",))
    return Run("id", None, None, None, None, (FileRef("a.h5", "00"),), Quality("good"), RigidBodyResult(), (row,), (cell,), Made())  # fmt: skip  # noqa: E501


def test_every_key_of_a_run_is_documented_and_every_documented_key_exists() -> None:
    text = page("docs/reference/run-json.md")
    document = a_run().to_json()
    assert first_column(text.split("\n## ")[0]) == list(document)
    for key, expected in {**KEYS, "run": set(document["run"]), "quality": set(document["quality"])}.items():
        assert set(first_column(section(text, f"`{key}`"))) == expected, key


def test_the_example_of_a_run_is_one() -> None:
    document = json.loads(page("docs/reference/run.json"))
    run = Run.from_json(document)
    assert json.loads(write_json(run.to_json())) == document
    assert run.made.version == ballscrew.__version__


# --- what each reason means ---------------------------------------------------------------------------------


def codes_in_the_source() -> set[str]:
    found: set[str] = set()
    for path in (ROOT / "src" / "ballscrew" / "recording").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            is_finding = isinstance(node, ast.Call) and getattr(node.func, "id", "") == "Finding"
            if is_finding and isinstance(node.args[1], ast.Constant):  # type: ignore[attr-defined]
                found.add(str(node.args[1].value))  # type: ignore[attr-defined]
    return found


def test_every_finding_has_a_row_and_every_row_a_finding() -> None:
    text = page("docs/howto/quality.md").split("\n## Cells")[0]
    codes = re.findall(r"^\|[^|]*\(`([\w-]+)`\) \|", text, re.M)
    assert len(codes) == len(set(codes))
    assert set(codes) == codes_in_the_source()


def sentences() -> str:
    """Every text of the two rooms that give reasons, an ellipsis where a value stands."""
    found = []
    for room in ("recording", "modal"):
        for path in sorted((ROOT / "src" / "ballscrew" / room).rglob("*.py")):
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if isinstance(node, ast.JoinedStr):
                    parts = [p.value if isinstance(p, ast.Constant) else "…" for p in node.values]
                    found.append("".join(map(str, parts)))
                elif isinstance(node, ast.Constant) and isinstance(node.value, str):
                    found.append(node.value)
    return "\n".join(found)


def test_every_reason_is_quoted_as_it_is_said() -> None:
    said = sentences()
    rows = re.findall(r"^\| (?!-|the reason says|verdict|\*)([^|]*) \|", page("docs/howto/quality.md"), re.M)
    phrases = [p for row in rows for p in re.sub(r" \(`[\w-]+`\)$", "", row).split("; ")]
    assert len(phrases) > 40
    wrong = []
    for phrase in phrases:
        parts = [re.escape(part.strip()) for part in phrase.replace("`", "").split("…") if part.strip()]
        if not re.search("[^\n]*".join(parts), said):
            wrong.append(phrase)
    assert wrong == []


# --- Python -------------------------------------------------------------------------------------------------


def test_every_public_name_is_in_the_reference() -> None:
    text = page("docs/reference/python.md")
    missing = [name for name in ballscrew.__all__ if f"`{name} <" not in text and f"``{name}``" not in text]
    assert missing == []


@pytest.fixture
def bench_folder(bench: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The bench's first state with its TOML files, in a folder that can be written to."""
    for path in [*bench.glob("*.toml"), *bench.glob("preload-4-percent-trip*.h5")]:
        try:
            (tmp_path / path.name).symlink_to(path.resolve())
        except OSError:
            shutil.copy(path, tmp_path)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def run_python(source: str, space: dict[str, Any]) -> None:
    exec(compile(source, "docs", "exec"), space)  # noqa: S102  the pages' own lines


@pytest.mark.usefixtures("bench_folder")
def test_the_readmes_lines_run(capsys: pytest.CaptureFixture[str]) -> None:
    (block,) = [block for block in blocks(page("README.md")) if block.language == "python"]
    assert len(block.body.splitlines()) <= 10
    space: dict[str, Any] = {}
    run_python(block.body, space)
    said = capsys.readouterr().out.splitlines()
    assert said[0] == "good"
    assert len(said) == 2 + 40
    assert space["response"].sizes["cell"] == 40
    assert space["document"]["schema"] == 1


@pytest.mark.usefixtures("bench_folder")
def test_the_python_page_runs(capsys: pytest.CaptureFixture[str]) -> None:
    space: dict[str, Any] = {}
    for block in blocks(page("docs/howto/python.md")):
        if block.language == "python":
            run_python(block.body, space)
    said = capsys.readouterr().out
    assert "no-such-file.h5: cannot be read" in said
    assert "acceleration:nut-1:x" in said
    assert 160 < float(space["peak"]) < 180
    assert space["other"].id == space["run"].id


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


# --- numbers ------------------------------------------------------------------------------------------------

AGAIN = "run docs/bench_numbers.py"
NUMBERS = load(DOCS / "bench_numbers.py")


@pytest.fixture(scope="module")
def states(bench: Path) -> dict[str, Run]:
    runs: dict[str, Run] = NUMBERS.analyse(bench)
    return runs


def test_the_numbers_of_the_uncertainty_page(bench: Path, states: dict[str, Run]) -> None:
    text = page("docs/explanation/uncertainty.md")
    for name, values in NUMBERS.table(bench, states).items():
        row = re.search(rf"^\| {re.escape(name)} \|([^|]*)\|([^|]*)\|", text, re.M)
        assert row is not None, name
        for shown, value in zip(row.groups(), values, strict=True):
            assert alike(value.split(), shown.split()) == [], f"{name}: {AGAIN}"


def test_the_numbers_of_the_readme(states: dict[str, Run]) -> None:
    text = page("README.md")
    told = NUMBERS.readme_lines(states["4"])
    shown = next(block.body for block in blocks(text) if block.body.startswith("bench,"))
    assert alike(words("\n".join(told)), words(shown)) == [], AGAIN
    own = page("docs/explanation/uncertainty.md").replace("\xa0", " ")
    medians = re.search(r"absolute error \| ([\d.]+ Hz) \| ([\d.]+ Hz)", own)
    held = re.search(r"holds the truth \| \*\*(\d+) of 40\*\* \| \*\*(\d+) of 40", own)
    assert medians is not None
    assert held is not None
    assert f"{medians[1]} at 4 % preload and {medians[2]} at 2 %" in text
    assert f"{held[1]} and {held[2]} of 40 cells" in text


# --- the tutorial -------------------------------------------------------------------------------------------

TUTORIAL = "docs/tutorial/first-run.md"
_NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?\Z")
_FRAME = str.maketrans("", "", "┏━┳┓┡╇┩│└┴┘─┃•")


def words(text: str) -> list[str]:
    """The words of an output, without frames; a run's id is its own business."""
    return re.sub(r"run [0-9a-f]{12}", "run ID", text.translate(_FRAME)).split()


def alike(told: list[str], shown: list[str]) -> list[str]:
    """Words that differ; numbers may by 2 %, what stands behind ± by 20 %."""
    wrong = []
    for i, (one, other) in enumerate(zip(told, shown, strict=True)):
        if _NUMBER.match(one) and _NUMBER.match(other):
            part = 0.2 if told[i - 1] == "±" else 0.02
            if abs(float(one) - float(other)) <= max(0.05, part * abs(float(other))):
                continue
        if one != other:
            wrong.append(f"{one}, not {other}")
    return wrong


def test_the_tutorial_can_be_walked(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    text = page(TUTORIAL)
    for step in WALK.walk(text, tmp_path):
        assert step.status == (2 if step.shown.startswith("ballscrew: ") else 0), step.said
        told, expected = words(step.said), words(step.shown)
        assert len(told) == len(expected), f"run docs/tutorial/walk.py:\n{step.said}"
        assert alike(told, expected) == [], "run docs/tutorial/walk.py"
    for block in blocks(text):
        if block.language == "text":
            lines = (tmp_path / block.options["caption"]).read_text(encoding="utf-8").splitlines()
            assert lines[: len(block.body.splitlines())] == block.body.splitlines()
    assert (tmp_path / "run.png").stat().st_size > 10_000
    _compare_with_the_truth(load(DOCS / "tutorial" / "make_recording.py"), tmp_path)


def _compare_with_the_truth(maker: ModuleType, folder: Path) -> None:
    """The tutorial asks the reader to compare; so do we."""
    run = ballscrew.analyze(folder / "run.toml")
    pole = 1 / maker.TABLE + 1 / maker.ROTOR
    truth = {x: (maker.stiffness(x) * pole) ** 0.5 / (2 * np.pi) for x in maker.STOPS}
    claimed = "176.9, 167.3, 159.1 and 152.1 Hz"
    assert claimed in page(TUTORIAL)
    assert [f"{value:.1f}" for value in truth.values()] == re.findall(r"\d+\.\d", claimed)
    assert len(run.cells) == 12
    off = [
        abs(cell.frequency_Hz - truth[round(cell.position_m, 3)]) / cell.standard_uncertainty_Hz
        for cell in run.cells
        if cell.frequency_Hz is not None and cell.standard_uncertainty_Hz is not None
    ]
    assert sum(value <= 2 for value in off) >= 11


# --- around -------------------------------------------------------------------------------------------------


def test_no_line_is_lost() -> None:
    """A line that begins with a per cent sign is a comment in these pages, and silently left out."""
    lost = [
        f"{path.name}: {line}"
        for path in sorted(DOCS.rglob("*.md"))
        for line in path.read_text(encoding="utf-8").splitlines()
        if line.startswith("%")
    ]
    assert lost == []


@pytest.mark.parametrize("name", ["README.md", "CONTRIBUTING.md", "CHANGELOG.md"])
def test_links_lead_somewhere(name: str) -> None:
    links = re.findall(r"\]\(([^)#]+)[^)]*\)", page(name))
    missing = [link for link in links if "://" not in link and not (ROOT / link).exists()]
    assert missing == []


def test_the_citation_is_of_this_version() -> None:
    assert f"version: {ballscrew.__version__}\n" in page("CITATION.cff")
