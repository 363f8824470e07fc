"""Reasons as a code and parameters, by which a sentence can be shown in another language.

Verdicts, doubts and alarms are reported as English sentences. ``reasons.toml`` has the template of each, from
which code and parameters follow: documents of every age have them, and documents do not change. On a page
some have another template, which names no command.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from functools import cache, lru_cache
from importlib import resources
from itertools import islice
from typing import Any

_LONGEST = 4000  # characters of a text that is compared; a longer one is no reason
_MOST_BREAKS = 20  # semicolons of a text at which one reason may end and the next begin
_MOST_REASONS = 50  # of a text that are translated
_MOST_NESTED = 20  # parts of sentences inside each other that are translated
_PLACEHOLDER = re.compile(r"\{(\w+)\}")
_NUMBER = re.compile(r"[±+−-]?(?:\d[\d.,]*(?:e[+-]?\d+)?|nan|inf)(?: %)?", re.IGNORECASE)
_FILE = re.compile(r"[^:]*[^:\s]\.\w{1,8}")
_GIVEN_NAMES = frozenset(
    {"name", "names", "other", "file", "sheet", "field"}
)  # of channels, files and fields


@dataclass(frozen=True, slots=True)
class CodedReason:
    """A sentence with its code.

    Parameters
    ----------
    code : str
        Equal for equal sentences, apart from the parameters.
    text : str
        The sentence.
    parameters : mapping of str to str
        Numbers and names, as the sentence has them.
    """

    code: str
    text: str
    parameters: Mapping[str, str]

    def to_json(self) -> dict[str, Any]:
        """JSON form: ``{"code": …, "text": …, "parameters": {…}}``."""
        return asdict(self)


@dataclass(frozen=True, slots=True)
class _Template:
    code: str
    text: str
    literals: tuple[str, ...]
    names: tuple[str, ...]

    @classmethod
    def of(cls, code: str, text: str) -> _Template:
        pieces = _PLACEHOLDER.split(text)
        return cls(code, text, tuple(pieces[::2]), tuple(pieces[1::2]))

    def values(self, text: str, numbers: frozenset[str]) -> dict[str, str] | None:
        """Parameters of a text; None where it is not of this template. Takes time linear in the text."""
        values = self._parameters(text)
        for name in numbers & (values or {}).keys():
            if values is not None and not _NUMBER.fullmatch(values[name]):
                return None
        return values

    def _parameters(self, text: str) -> dict[str, str] | None:
        """What is between the literals of the template, each at its first place."""
        first, last = self.literals[0], self.literals[-1]
        if not self.names:
            return {} if text == first else None
        end = len(text) - len(last)
        if not text.startswith(first) or not text.endswith(last) or end < len(first):
            return None
        values, at = dict[str, str](), len(first)
        for name, literal in zip(self.names[:-1], self.literals[1:-1], strict=True):
            place = text.find(literal, at, end)
            if place < 0:
                return None
            values[name] = text[at:place]
            at = place + len(literal)
        return values | {self.names[-1]: text[at:end]}


@dataclass(frozen=True, slots=True)
class _Catalogue:
    reasons: tuple[_Template, ...]
    parts: tuple[_Template, ...]
    prefixes: tuple[_Template, ...]
    numbers: frozenset[str]
    pages: Mapping[str, str]

    def divide(self, text: str) -> tuple[_Template, str, dict[str, str]] | None:
        """The words that name the file of a reason, the reason, and the names; None without a file."""
        for prefix in self.prefixes:
            values = prefix.values(text, self.numbers)
            if values is not None and _FILE.fullmatch(values["file"]):
                return prefix, values.pop("reason"), values
        return None

    def find(self, text: str, *, part: bool = False) -> tuple[_Template, dict[str, str]] | None:
        """The longest template of a text, and its parameters."""
        if len(text) > _LONGEST:
            return None
        templates = self.reasons
        if part:
            templates = (*self.reasons, *self.parts)
        for template in templates:
            values = template.values(text, self.numbers)
            if values is not None:
                return template, values
        return None


@cache
def _catalogue() -> _Catalogue:
    text = resources.files("ballscrew.base").joinpath("reasons.toml").read_text(encoding="utf-8")
    document = tomllib.loads(text)

    def templates(table: str) -> tuple[_Template, ...]:
        found = [_Template.of(code, text) for code, text in document[table].items()]
        return tuple(sorted(found, key=lambda template: -sum(map(len, template.literals))))

    numbers = frozenset(document["numbers"])
    pages = {document["reasons"][code]: template for code, template in document["pages"].items()}
    return _Catalogue(templates("reasons"), templates("parts"), templates("prefixes"), numbers, pages)


@lru_cache(maxsize=1024)
def coded_reason(text: str) -> CodedReason | None:
    """Code and parameters of a sentence.

    Parameters
    ----------
    text : str
        A reason, a note or the text of an alarm, with or without the name of its file.

    Returns
    -------
    CodedReason or None
        None where the sentence is none of the catalogue.
    """
    catalogue = _catalogue()
    divided, sentence, names = catalogue.divide(text), text, dict[str, str]()
    if divided is not None:
        _, sentence, names = divided
    found = catalogue.find(sentence)
    if found is None:
        return None
    return CodedReason(found[0].code, text, names | found[1])


def coded(text: str) -> dict[str, Any]:
    """JSON form of a sentence, or a part of one, with its code, which is empty where it has none."""
    reason = coded_reason(text)
    if reason is not None:
        return reason.to_json()
    template, values = _catalogue().find(text, part=True) or (_Template.of("", text), {})
    return CodedReason(template.code, text, values).to_json()


@dataclass(frozen=True, slots=True)
class ReaderLanguage:
    """How a sentence is shown to its reader.

    Parameters
    ----------
    gettext : callable
        Returns the translation of a template, as :meth:`gettext.GNUTranslations.gettext`.
    show : callable
        Returns a number or a time as the reader's language has it; by default as the sentence has it.
    """

    gettext: Callable[[str], str]
    show: Callable[[str], str] = str


def page_template(template: str) -> str:
    """Template of a sentence on a page: without commands, which a page has no use for."""
    return _catalogue().pages.get(template, template)


def translated(text: str, reader: ReaderLanguage, *, part: bool = False) -> str:
    """A sentence in another language.

    Parameters
    ----------
    text : str
        A reason, a note or the text of an alarm; or several, with semicolons between them.
    reader : Reader
        Language, and form of the numbers.
    part : bool
        Whether the text may be a part of a sentence, as the name of a cause.

    Returns
    -------
    str
        With the same numbers and names; in English where the sentence is none of the catalogue.
    """
    if part:
        return _translated_part(text, reader, _MOST_NESTED)
    return _translated(text, reader, _MOST_NESTED)


def _translated(text: str, reader: ReaderLanguage, depth: int) -> str:
    """Translation of reasons with semicolons between them, the first ones of very many."""
    found: list[str] = []
    for _ in range(_MOST_REASONS):
        whole = _translated_reason(text, reader, depth)
        if whole is not None:
            return "; ".join([*found, whole])
        first, rest = _divided(text)
        if first is None:
            break
        found.append(_translated_reason(first, reader, depth) or first)
        text = rest
    return "; ".join([*found, text])


def _divided(text: str) -> tuple[str | None, str]:
    """The first of several reasons, and the others; None where the text does not begin with one."""
    for match in islice(re.finditer("; ", text[:_LONGEST]), _MOST_BREAKS):
        if coded_reason(text[: match.start()]) is not None:
            return text[: match.start()], text[match.end() :]
    return None, text


def _translated_reason(text: str, reader: ReaderLanguage, depth: int) -> str | None:
    """Translation of one reason; None where the text is none of the catalogue."""
    catalogue = _catalogue()
    divided = catalogue.divide(text)
    if divided is not None and catalogue.find(divided[1]) is not None:
        prefix, sentence, names = divided
        return _filled(prefix, names | {"reason": sentence}, reader, depth)
    found = catalogue.find(text)
    if found is None:
        return None
    return _filled(*found, reader, depth)


def _filled(template: _Template, values: Mapping[str, str], reader: ReaderLanguage, depth: int) -> str:
    """Translation of a template with its parameters, each translated if it is a part of a sentence."""
    filled = {}
    for name, value in values.items():
        if name in _GIVEN_NAMES:
            filled[name] = value
        else:
            filled[name] = reader.show(_translated_part(value, reader, depth))
    return _PLACEHOLDER.sub(lambda match: filled.get(match[1], match[0]), reader.gettext(template.text))


def _translated_part(value: str, reader: ReaderLanguage, depth: int) -> str:
    """Translation of a parameter that is a part of a sentence, not too deep inside it."""
    if depth == 0:
        return value
    found = _catalogue().find(value, part=True)
    if found is not None:
        return _filled(*found, reader, depth - 1)
    sentences = _translated(value, reader, depth - 1)
    if sentences != value or ", " not in value:
        return sentences
    return ", ".join(_translated_part(each, reader, depth - 1) for each in value.split(", "))
