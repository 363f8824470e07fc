from __future__ import annotations

import ast
import gettext
import json
import re
import sqlite3
import tomllib
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests import translations
from tests.code_counts import PACKAGE, ROOT, modules, tree

from ballscrew.base.reasons import ReaderLanguage, coded_reason, translated

CATALOGUE = tomllib.loads((PACKAGE / "base" / "reasons.toml").read_text(encoding="utf-8"))
TEMPLATES = CATALOGUE["prefixes"] | CATALOGUE["reasons"] | CATALOGUE["parts"]
PAGES = CATALOGUE["pages"]
GERMAN = PACKAGE / "locale" / "de" / "LC_MESSAGES" / "ballscrew.po"
EXAMPLES = tomllib.loads((Path(__file__).parent / "german_reasons.toml").read_text(encoding="utf-8"))[
    "reason"
]
PLACEHOLDER = re.compile(r"\{\w+\}")
MAKERS = {"Finding", "Reason", "Doubt"}
"""Classes of reasons: a module that makes one is searched."""

FURTHER_MODULES = {
    *("calibration.conventions", "calibration.frequency_table", "calibration.temperature"),
    *("calibration.preload_groups", "calibration.tolerances"),
    *("estimation.causes", "estimation.local_wear", "estimation.mass_check", "estimation.nut"),
    *("estimation.preload", "estimation.support", "estimation.temperature", "estimation.verdict"),
    *("modal.joint.verdicts", "modal.paper.judge", "monitoring.assessment", "monitoring.health"),
    *(
        "monitoring.history_causes",
        "monitoring.state",
        "recording.quality.clock",
        "recording.drive_input",
        "recording.quality.finding",
        "recording.quantities",
    ),
    *("monitoring.epochs", "service.alarms", "store.alarms", "store.assessing"),
}
"""Modules that make sentences on which such a reason depends, or that of an alarm."""

OF_ERRORS = {"store.inserting", "store.reading"}
"""Modules with errors that a page shows."""

OF_PARTS = {"prognosis.failure", "report.monitor_words", "report.what_to_do", "service.reading"}
"""Modules that make actions, headlines and parts of sentences."""

NO_REASONS = (
    *("compliance in the middle", "its slope along", "its curve along", "mass that moves", "rotor and bed"),
    *("the nut's share of", "data and sheet", "the nut's own compliance", "only the sheet", " (by the sheet"),
    *(" times as precise", "preload of group ", "nut or bearing", "the load in kg", "the frequency in Hz"),
    *("the position in m", "load on a worn nut: ", " % of the preload", "temperature (not recorded)"),
    *(
        "a run: measured_at",
        "the sample rates are",
        " Hz, which differ by more than",
        "input and responses are",
    ),
    *(
        "; they must be the same.",
        "\\A",
        "\\1",
        "With shelve: ",
        "With close",
        "Which other cause.",
        "Kind of an event",
        "finding, cause and maintenance",
        "cause needs a",
        "a finding is that",
        "Finding; close",
        "an event: at",
        "the far",
        "until is",
    ),
    "a mode along the axis explains only 0 %",  # as other percentages
)
"""Beginnings of other texts in these modules: errors, names of quantities, sources of information."""


@cache
def german() -> gettext.NullTranslations:
    return gettext.translation("ballscrew", PACKAGE / "locale", ["de"])


def german_of(text: str) -> str:
    return translated(text, ReaderLanguage(german().gettext))


def literals(name: str, *, with_errors: bool = False) -> Iterator[str]:
    """Literal pieces of the texts of a module, without docstrings, and without errors that are raised."""
    root = tree(modules()[f"ballscrew.{name}"])
    omitted = set()
    for node in ast.walk(root):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            omitted.add(node.value)
        if isinstance(node, ast.Raise) and not with_errors:
            omitted |= set(ast.walk(node))
    for node in ast.walk(root):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and node not in omitted:
            yield from re.split(r"\{[^}]*\}", node.value)  # also of str.format


def producers() -> set[str]:
    found = set(FURTHER_MODULES)
    for name, path in modules().items():
        for node in ast.walk(tree(path)):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in MAKERS:
                found.add(name.removeprefix("ballscrew."))
    return found


@cache
def pieces() -> tuple[str, ...]:
    """Literal pieces of the catalogue."""
    found = []
    for template in TEMPLATES.values():
        found += PLACEHOLDER.split(template)
    return tuple(found)


def test_no_sentence_of_a_module_is_without_a_template() -> None:
    missing = []
    for name in sorted(producers()):
        for text in literals(name):
            if len(text.split()) < 3 or text.startswith(NO_REASONS):
                continue
            if not any(text.strip(" ,;:.") in piece for piece in pieces()):
                missing.append((name, text))
    assert missing == []


def test_no_template_is_without_a_sentence() -> None:
    """A sentence that was changed in the code is to be changed in the catalogue."""
    source = {text for name in producers() | OF_PARTS for text in literals(name)}
    source |= {text for name in OF_ERRORS for text in literals(name, with_errors=True)}
    joined = "\0" + "\0".join(sorted(source)) + "\0"

    def ends(piece: str) -> bool:
        """Whether it is one literal or several, of which the last may go on."""
        whole = [cut for cut in range(1, len(piece)) if piece[:cut] in source]
        return f"\0{piece}" in joined or any(ends(piece[cut:]) for cut in whole)

    def occurs(piece: str) -> bool:
        """Whether it is part of a literal, or of several put together."""
        begun = [cut for cut in range(1, len(piece)) if f"{piece[:cut]}\0" in joined]
        return piece in joined or any(ends(piece[cut:]) for cut in begun)

    missing = []
    for code, template in TEMPLATES.items():
        missing += [(code, piece) for piece in PLACEHOLDER.split(template) if not occurs(piece)]
    assert missing == []


def test_every_template_is_in_the_german_catalogue() -> None:
    messages = translations.read_po(GERMAN)
    templates = [*TEMPLATES.values(), *PAGES.values()]
    assert [template for template in templates if not messages.get(template)] == []


def test_the_compiled_catalogue_is_that_of_its_source() -> None:
    """Else: ``python tests/translations.py``."""
    for path in sorted(translations.LOCALE.rglob("*.po")):
        compiled = path.with_suffix(".mo").read_bytes()
        assert compiled == translations.compile_mo(translations.read_po(path)), path.name


def test_a_translation_has_the_numbers_and_parameters_of_its_template() -> None:
    for template in (*TEMPLATES.values(), *PAGES.values()):
        german_text = german().gettext(template)
        assert sorted(PLACEHOLDER.findall(german_text)) == sorted(PLACEHOLDER.findall(template)), template
        literal, german_literal = (PLACEHOLDER.sub("", text) for text in (template, german_text))
        numbers = [re.findall(r"\d[\d.]*\d|\d", text) for text in (literal, german_literal)]
        if template not in (CATALOGUE["parts"]["cells-with-one"], CATALOGUE["parts"]["cell-with-one"]):
            assert sorted(numbers[0]) == sorted(numbers[1]), template


def test_no_sentence_of_a_page_names_a_command() -> None:
    """Each that does has another template for pages, with the same parameters or fewer."""
    command = re.compile(r" --\w|'?ballscrew [a-z]|analyze |EVENTS\.toml")
    shown = CATALOGUE["reasons"] | PAGES
    assert {code: text for code, text in shown.items() if command.search(text)} == {}
    for code, template in PAGES.items():
        assert set(PLACEHOLDER.findall(template)) <= set(PLACEHOLDER.findall(TEMPLATES[code])), code


def filled(template: str) -> str:
    """A template with other parameters, all different."""
    values = iter(range(11, 99))
    return PLACEHOLDER.sub(lambda _: str(next(values)), template)


def test_every_reason_is_found_by_its_own_code() -> None:
    found = {}
    for code, template in CATALOGUE["reasons"].items():
        reason = coded_reason(filled(template))
        found[code] = None if reason is None else reason.code
    assert {code: other for code, other in found.items() if other != code} == {}


def test_a_reason_has_its_numbers_and_names_as_the_sentence_has_them() -> None:
    text = "trip2.h5: torque is clipped at 1.20 N m: 12 samples lie there, 3.1 % of all above half that limit"
    reason = coded_reason(text)
    assert reason is not None
    assert reason.to_json() == {
        "code": "clipped",
        "text": text,
        "parameters": {
            "file": "trip2.h5",
            "name": "torque",
            "limits": "1.20",
            "unit": "N m",
            "count": "12",
            "percent": "3.1 %",
        },
    }


@pytest.mark.parametrize("case", EXAMPLES, ids=lambda case: case["code"] or "unknown")
def test_a_reason_is_shown_in_german(case: dict[str, str]) -> None:
    """Numbers, channels and files as they are; several reasons each on its own, an unknown one in English."""
    reason = coded_reason(case["text"])
    assert (reason.code if reason else "") == case["code"]
    assert german_of(case["text"]) == case["german"]


@given(st.text(max_size=300))
def test_no_text_is_changed_without_a_template(text: str) -> None:
    if coded_reason(text) is None and "; " not in text:
        assert german_of(text) == text


def test_a_hostile_text_has_a_translation_in_finite_time() -> None:
    """A search through all divisions of these would not end."""
    for text in (
        "the calibration is suspect (a): " * 120,
        "it is suspect; " * 260,
        "a; " * 1300,
        "the measurement is bad: " + "a, " * 1300,
        "x" * 10_000_000,
    ):
        assert isinstance(german_of(text), str)


def test_many_reasons_have_a_translation() -> None:
    reason = "torque is clipped at 1.20 N m: 12 samples lie there, 3.1 % of all above half that limit"
    text = german_of("; ".join([reason] * 1200))
    assert text.count("; ") == 1199
    assert text.startswith(f"{german_of(reason)}; {german_of(reason)}; ")
    assert text.endswith(reason)
    nested = german_of("the calibration is suspect (a): " + "1 and " * 600 + "1")
    assert nested.count("1") == 601


def recorded(value: object) -> Iterator[str]:
    """Sentences of reasons and notes in a JSON document."""
    if isinstance(value, dict):
        for name, item in value.items():
            if name in ("reasons", "nut_reasons", "notes"):
                yield from sentences(item)
            yield from recorded(item)
    elif isinstance(value, list):
        for item in value:
            yield from recorded(item)


def sentences(value: object) -> Iterator[str]:
    for row in value if isinstance(value, list) else []:
        if isinstance(row, str):
            yield row
        elif isinstance(row, list):
            yield row[-1]  # a kind and a sentence
        elif isinstance(row, dict):
            yield row["text"]


def test_recorded_reasons_have_codes() -> None:
    found = set(recorded(json.loads((ROOT / "docs/reference/run.json").read_text(encoding="utf-8"))))
    for path in sorted((ROOT / "tests" / "store").glob("schema-*/store.sqlite")):
        with sqlite3.connect(f"{path.as_uri()}?mode=ro&immutable=1", uri=True) as database:
            for (table,) in database.execute(
                "SELECT name FROM sqlite_master WHERE type = 'table'"
            ).fetchall():
                columns = [row[1] for row in database.execute(f"PRAGMA table_info({table})")]
                if "reasons" in columns:
                    for (text,) in database.execute(f"SELECT reasons FROM {table}"):  # noqa: S608
                        found |= set(sentences(json.loads(text or "[]")))
    assert [text for text in sorted(found) if coded_reason(text) is None] == []
