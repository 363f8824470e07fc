"""German of the pages: each text has a translation with the same placeholders."""

from __future__ import annotations

import gettext
import io
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from tests.translations import LOCALE, compile_mo, read_po

from ballscrew.service.pages.rendering import environment_of, page_sentence
from ballscrew.service.settings import ServerSettings

PATHS = sorted(LOCALE.rglob("*.po"))
PLACEHOLDER = re.compile(r"%\((\w+)\)[sd]|%%|\{(\w+)\}")


def texts() -> Iterator[tuple[str, str]]:
    """Place and key of every text of the pages, as read_po has it."""
    environment = environment_of("en")
    for name in environment.list_templates():
        source = environment.loader.get_source(environment, name)[0]  # type: ignore[union-attr]
        for line, _, message in environment.extract_translations(source):
            if message is None:  # of a variable
                continue
            parts = (message,) if isinstance(message, str) else message
            yield f"{name}:{line}", "\0".join(part for part in parts if isinstance(part, str))
    for name, field in ServerSettings.model_fields.items():
        yield f"setting {name}", str(field.description)


@pytest.mark.parametrize("path", PATHS, ids=lambda path: path.parts[-3])
def test_every_text_of_the_pages_is_translated(path: Path) -> None:
    messages = read_po(path)
    missing = [f"{place}: {key!r}" for place, key in texts() if not messages.get(key, "").strip("\0")]
    assert missing == []


@pytest.mark.parametrize("path", PATHS, ids=lambda path: path.parts[-3])
def test_a_translation_has_the_placeholders_of_its_text(path: Path) -> None:
    messages = read_po(path)
    wrong = []
    for _, key in texts():
        forms = key.split("\0")
        translated = messages.get(key, "").split("\0")
        if len(translated) != len(forms):
            wrong.append(key)
        for english, german in zip(forms, translated, strict=False):
            if sorted(PLACEHOLDER.findall(english)) != sorted(PLACEHOLDER.findall(german)):
                wrong.append(key)
    assert wrong == []


@pytest.mark.parametrize("path", PATHS, ids=lambda path: path.parts[-3])
def test_what_is_compiled_is_what_is_written(path: Path) -> None:
    """``python tests/translations.py`` compiles."""
    content = path.with_suffix(".mo").read_bytes()
    messages = read_po(path)
    assert content == compile_mo(messages)
    catalogue = gettext.GNUTranslations(io.BytesIO(content))
    for key, text in messages.items():
        if key and "\0" not in key and "\4" not in key and text:
            assert catalogue.gettext(key) == text


def test_times_in_a_sentence_are_those_of_the_language() -> None:
    text = "no run since 2026-11-07 15:46 UTC: overdue."
    assert page_sentence(text, "en") == "no run since 7 Nov 2026, 15:46 UTC: overdue."
    assert page_sentence(text, "de") == "keine Messung seit 07.11.2026, 15:46 UTC: überfällig."
