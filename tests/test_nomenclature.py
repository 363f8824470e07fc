"""The page *Nomenclature* is the single source of symbols and names: it is compared with the code."""

from __future__ import annotations

import ast
import dataclasses
import importlib
import pkgutil
import re
from collections import Counter
from functools import cache
from pathlib import Path

import pytest

import ballscrew

ROOT = Path(__file__).parent.parent
PAGE = ROOT / "docs" / "explanation" / "nomenclature.md"
NONE = "—"
NO_TERMS = {"GcodeDialect"}  # the spelling of a controller's language
WORDS = [
    "axis",
    "plan",
    "run",
    "trip",
    "recording",
    "transient",
    "condition",
    "motion",
    "repetition",
    "cell",
    "spectra",
    "frequency response (FRF)",
    "coherence",
    "axial natural frequency (ANF)",
    "damping ratio",
    "preload",
    "preload ratio",
    "compliance",
    "rigidity",
    "nut load",
    "load",
    "moving mass",
    "equivalent mass",
    "baseline",
    "epoch",
    "stage",
    "backlash",
    "alarm",
    "remaining useful life (RUL)",
]


@cache
def rows() -> list[tuple[str, str, str, str]]:
    found = []
    for line in PAGE.read_text(encoding="utf-8").splitlines():
        if line.startswith("|") and not re.match(r"\|[-|]+\|$|\| Symbol ", line):
            cells = [cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]]
            assert len(cells) == 4, line
            found.append(tuple(cells))
    return found


def code_names() -> list[str]:
    return [name.strip("`") for _, name, _, _ in rows() if name != NONE]


@cache
def names_in_the_package() -> frozenset[str]:
    """Functions, classes, parameters, fields, and texts that look like a key; not what comments say."""
    names: set[str] = set()
    for path in (ROOT / "src" / "ballscrew").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            match node:
                case ast.FunctionDef(name=name) | ast.ClassDef(name=name) | ast.arg(arg=name):
                    names.add(name)
                case ast.AnnAssign(target=ast.Name(id=name)):
                    names.add(name)
                case ast.Constant(value=str(text)) if text.isidentifier():
                    names.add(text)
    return frozenset(names)


def public_dataclasses() -> dict[str, type]:
    modules = [
        importlib.import_module(f"ballscrew.{subpackage}.{module.name}")
        for subpackage in ("axis", "fcft")
        for module in pkgutil.iter_modules([str(Path(ballscrew.__path__[0]) / subpackage)])
    ]
    items = [(module, *item) for module in modules for item in vars(module).items()]
    classes = {
        name: item for module, name, item in items if getattr(item, "__module__", "") == module.__name__
    }
    return {
        name: item
        for name, item in classes.items()
        if isinstance(item, type)
        and dataclasses.is_dataclass(item)
        and not name.startswith("_")
        and name not in NO_TERMS
    }


def test_the_table_is_read():
    assert len(rows()) > 100
    assert len(code_names()) > 90


@pytest.mark.parametrize("name", sorted(set(code_names())))
def test_every_code_name_exists(name):
    owner, _, field = name.rpartition(".")
    assert field in names_in_the_package()
    if owner:
        assert field in {f.name for f in dataclasses.fields(public_dataclasses()[owner])}


def test_every_public_field_of_axis_and_fcft_is_listed():
    listed = set(code_names())
    classes = public_dataclasses()
    assert {"Screw", "DataSheet", "Theta", "Motion", "Plan", "Cell"} <= classes.keys()
    fields = {f"{name}.{f.name}" for name, kind in classes.items() for f in dataclasses.fields(kind)}
    assert not {field for field in fields if field not in listed and field.split(".")[1] not in listed}


def test_nothing_is_listed_twice():
    symbols = Counter(symbol for symbol, _, _, _ in rows() if symbol != NONE)
    names = Counter(code_names())
    assert [item for item, count in (symbols + names).items() if max(symbols[item], names[item]) > 1] == []


def test_every_row_has_a_unit_and_a_definition_that_ends():
    for symbol, name, unit, definition in rows():
        assert unit, (symbol, name)
        assert definition.endswith("."), (symbol, name)


@pytest.mark.parametrize("word", WORDS)
def test_every_word_of_the_field_is_explained_once(word):
    bold = [text.rstrip(".").lower() for row in rows() for text in re.findall(r"\*\*(.+?)\*\*", row[3])]
    assert bold.count(word.lower()) == 1
