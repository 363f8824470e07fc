"""Limits on the code itself: size of functions, imports without circles, names, words."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from graphlib import TopologicalSorter
from pathlib import Path

import pytest
from tests import code_counts
from tests.code_counts import PACKAGE, ROOT, tree

MOST_COMPLEX = 15
"""Highest cyclomatic complexity, by radon, of any function; at most 50 may exceed 10."""

NOT_NAMES = {
    *("tell", "tells", "told", "foretell", "foretold", "seen", "held", "kept", "drawn", "judged", "apart"),
    *("between", "widened", "worth", "said", "left", "one", "wound"),
}
"""Words that are no names: a reader would have to look up what they stand for."""

NEVER_NAMES = {"told", "foretold", "seen", "kept", "drawn", "judged", "apart", "said"}
"""Those of them that no name has, also beside the package."""

ALLOWED_NAMES = {"fill_between", "get_one"}
"""Names of other libraries."""

ALLOWED_TERMS = ("rotor_held", "leave_one_out")
"""Terms of the field: the frequency with the rotor held; a method of statistics."""

NOT_ENGLISH = re.compile(
    r"\b(tells?|telling|told|foretells?|foretold)\b|\b(speaks?|spoke) against|\bholds? the truth"
    r'|^\s*"*Of it\.',
    re.IGNORECASE | re.MULTILINE,
)
"""Expressions that read as translated: a method estimates, a program reports, an interval contains."""

PAGES = sorted(
    path for path in (*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")) if "_build" not in path.parts
)


MODULES = sorted(PACKAGE.rglob("*.py"))


def short_name(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


def identifiers(path: Path) -> Iterator[str]:
    """Names of modules, functions, classes, parameters, variables and attributes."""
    yield path.stem
    for node in ast.walk(tree(path)):
        match node:
            case ast.FunctionDef(name=name) | ast.ClassDef(name=name) | ast.arg(arg=name):
                yield name
            case ast.Attribute(attr=name) | ast.Name(id=name, ctx=ast.Store()):
                yield name


def test_no_function_is_too_complex() -> None:
    found = list(code_counts.complexities())
    assert [place for value, place in found if value > MOST_COMPLEX] == []
    assert sum(value > 10 for value, _ in found) <= 50


def test_statements_are_read_once() -> None:
    """Comprehensions and conditional expressions: at most five per hundred statements."""
    assert code_counts.packed_per_100_statements() <= 5


def test_imports_have_no_circle() -> None:
    graph = {name: others - {"ballscrew"} for name, others in code_counts.imports().items()}
    TopologicalSorter(graph).prepare()  # raises CycleError with the modules of a circle


def test_few_modules_serve_a_single_neighbour() -> None:
    assert len(code_counts.single_importer_modules()) <= 52


def test_no_class_name_is_used_twice() -> None:
    assert code_counts.repeated_class_names() == []


@pytest.mark.parametrize(
    "path", sorted(PACKAGE.rglob("*.py")), ids=lambda p: p.relative_to(PACKAGE).as_posix()
)
def test_names_are_words_of_the_field(path: Path) -> None:
    found = set()
    names = set(identifiers(path)) - ALLOWED_NAMES
    if "right" in names:
        names.discard("left")  # sides, not a remainder
    for name in names:
        words = name.lower()
        for term in ALLOWED_TERMS:
            words = words.replace(term, "")
        if NOT_NAMES & set(words.split("_")):
            found.add(name)
    assert found == set()


@pytest.mark.parametrize("folder", ["benchmarks", "docs"])
def test_names_beside_the_package_are_words_of_the_field(folder: str) -> None:
    """The worst of them only."""
    found = set()
    for path in sorted((PACKAGE.parents[1] / folder).rglob("*.py")):
        for name in identifiers(path):
            if NEVER_NAMES & set(name.lower().split("_")):
                found.add(f"{path.name}: {name}")
    assert found == set()


@pytest.mark.parametrize(
    "path", sorted(PACKAGE.rglob("*.py")), ids=lambda p: p.relative_to(PACKAGE).as_posix()
)
def test_texts_of_the_code_are_plain_english(path: Path) -> None:
    assert NOT_ENGLISH.findall(path.read_text(encoding="utf-8")) == []


@pytest.mark.parametrize("path", PAGES, ids=short_name)
def test_pages_are_plain_english(path: Path) -> None:
    assert NOT_ENGLISH.findall(path.read_text(encoding="utf-8")) == []


def test_the_documentation_stays_short() -> None:
    assert code_counts.prose_words() <= 31_420
