"""Every command and option is documented, and what is documented exists."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
import typer
from tests.docs.pages import DOCS, ROOT, blocks, first_column, page, section

import ballscrew
from ballscrew.cli.app import app


def _flat(group: Any, before: str = "") -> dict[str, Any]:
    """Name to command; those of a group by both names."""
    found: dict[str, Any] = {}
    for name, command in group.commands.items():
        inner = hasattr(command, "commands")
        found |= _flat(command, f"{before}{name} ") if inner else {before + name: command}
    return found


COMMANDS = _flat(typer.main.get_command(app))


def options_of(command: Any) -> set[str]:
    given = {name for param in command.params for name in param.opts if name.startswith("-")}
    return given - {"--help", "-h"}


def test_every_command_is_a_public_function() -> None:
    names = {name.split()[0] for name in COMMANDS} - {"store", "token", "user", "report"}
    assert sorted(names - set(ballscrew.__all__)) == []
    assert all(callable(getattr(ballscrew, name)) for name in names)


def test_every_command_of_the_store_is_a_method() -> None:
    names = {name.split()[1].replace("-", "_") for name in COMMANDS if name.startswith("store ")}
    assert len(names) > 10
    assert all(callable(getattr(ballscrew.Store, name)) for name in names | {"report"})


def test_every_command_has_a_section_and_every_section_a_command() -> None:
    headings = re.findall(r"^## `ballscrew ([\w -]+)`$", page("docs/reference/cli.md"), re.M)
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
                name = words[1] if words[1] in COMMANDS else " ".join(words[1:3])
                assert name in COMMANDS, line
                assert set(re.findall(r"(?<=\s)--[\w-]+", line)) <= options_of(COMMANDS[name]), line
