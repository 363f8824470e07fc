"""Findings of the quality gate and the verdict that follows from them."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, cast

from ballscrew.base.errors import InputError, printable, shown
from ballscrew.base.result import PlottedResult

if TYPE_CHECKING:
    import pandas as pd

Severity = Literal["bad", "suspect"]
Verdict = Literal["good", "suspect", "bad"]

_ORDER: Mapping[str, int] = {"bad": 0, "suspect": 1}
# Causes are reported before their consequences: an inverted polarity makes repetitions missing, for example.
# Codes that are not listed here come between causes and effects.
_CAUSES: tuple[tuple[str, ...], ...] = (
    ("exchanged",),
    ("nan", "flat", "short", "time"),
    ("wrapped",),
    ("clipped", "spike"),
    ("dropped",),
    ("copies", "stuck", "dead-band"),
    ("rate",),
    ("speed", "acceleration"),
    ("polarity",),
    ("delay-changes",),
)
_EFFECTS: tuple[tuple[str, ...], ...] = (
    ("offset", "places", "stops"),
    ("repetitions", "no-motion"),
    ("pause", "set-aside"),
)
_RANK: dict[str, int] = {}
for _rank, _codes in enumerate(_CAUSES, start=-len(_CAUSES)):
    _RANK.update(dict.fromkeys(_codes, _rank))
for _rank, _codes in enumerate(_EFFECTS, start=1):
    _RANK.update(dict.fromkeys(_codes, _rank))
_FILE = re.compile(r"\A(?P<file>[^:]*[^:\s]\.\w{1,8}): (?P<rest>.*)\Z", re.DOTALL)
# A number on its own: the 1 of "nut-1" is part of a name.
_NUMBER = re.compile(r"(?<![\w.:-])[±+−-]?\d[\d.]*(?:e[+-]?\d+)?", re.IGNORECASE)
_MOST_NAMED = 4


@dataclass(frozen=True, slots=True)
class Finding:
    """One fault of a measurement.

    Parameters
    ----------
    severity : {"bad", "suspect"}
        Bad: the measurement cannot be used. Suspect: results may be wrong.
    code : str
        The kind of fault, in kebab case: ``"clipped"``.
    message : str
        One clause with numbers, which names the file and the channel where it applies:
        ``"trip2.h5: torque is clipped at 1.20 N m in 3.1 % of the samples"``.
    """

    severity: Severity
    code: str
    message: str

    def __post_init__(self) -> None:
        """Escape control characters in names of files and channels."""
        object.__setattr__(self, "message", printable(self.message))


def severity(*, bad: bool) -> Severity:
    """``"bad"`` or, else, ``"suspect"``."""
    return "bad" if bad else "suspect"


def in_order(findings: Iterable[Finding]) -> list[Finding]:
    """Findings in the order of a report: causes first, then the worst; duplicates removed."""

    def rank(finding: Finding) -> tuple[int, int]:
        return _RANK.get(finding.code, 0), _ORDER[finding.severity]

    return sorted(dict.fromkeys(findings), key=rank)


@dataclass(frozen=True, slots=True, repr=False)
class Quality(PlottedResult):
    """The verdict on a recording or a run.

    Parameters
    ----------
    verdict : {"good", "suspect", "bad"}
        Severity of the worst finding.
    reasons : tuple of str
        Reasons, causes before their consequences; empty for a good measurement.
    notes : tuple of str
        What was assumed or found in the files, without effect on the verdict.
    """

    verdict: Verdict
    reasons: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()

    _drawing = "planning_figure:draw_quality"

    def _lines(self) -> list[str]:
        return [f"the measurement is {self.verdict}", *self.reasons, *self.notes]

    def to_dataframe(self) -> pd.DataFrame:
        """Table of the reasons."""
        import pandas as pd

        return pd.DataFrame({"reason": list(self.reasons)})

    @classmethod
    def of(cls, findings: Iterable[Finding], notes: Iterable[str] = ()) -> Quality:
        """Verdict on all findings together.

        Equal messages are merged; the same fault in several files becomes one sentence with the numbers of
        the first file.

        Parameters
        ----------
        findings : iterable of Finding
            Of all files of a run.
        notes : iterable of str
            Of all files of a run; equal ones are merged.

        Returns
        -------
        Quality
            Causes before their consequences, among these bad ones before suspect ones, else in the order
            given.
        """
        ordered = in_order(findings)
        groups: dict[tuple[str, ...], list[Finding]] = {}
        verdict: Verdict = "good"
        for finding in ordered:
            kind = finding.message
            match = _FILE.match(kind)
            if match is not None:
                kind = _NUMBER.sub("#", match["rest"])
            groups.setdefault((finding.severity, finding.code, kind), []).append(finding)
            if verdict != "bad":
                verdict = finding.severity
        reasons = tuple(dict.fromkeys(map(_sentence, groups.values())))
        return cls(verdict, reasons, tuple(dict.fromkeys(map(printable, notes))))

    def to_json(self) -> dict[str, Any]:
        """JSON form: ``{"verdict": "good", "reasons": [], "notes": []}``."""
        return {"verdict": self.verdict, "reasons": list(self.reasons), "notes": list(self.notes)}

    @classmethod
    def from_json(cls, document: Mapping[str, Any]) -> Quality:
        """Read the JSON form of :meth:`to_json`.

        Raises
        ------
        InputError
            If the verdict is not known, or reasons or notes are no list of texts.
        """
        verdict = document.get("verdict")
        if verdict not in ("good", "suspect", "bad"):
            raise InputError(f"quality.verdict is {shown(verdict)}; it must be good, suspect or bad.")
        sentences = []
        for name, texts in (("reasons", document.get("reasons")), ("notes", document.get("notes", []))):
            if not isinstance(texts, list) or not all(isinstance(text, str) for text in texts):
                raise InputError(f"quality.{name} is {shown(texts)}; it must be a list of texts.")
            sentences.append(tuple(map(printable, texts)))
        return cls(cast("Verdict", verdict), *sentences)


def _sentence(group: list[Finding]) -> str:
    """Sentence for a fault that several files share."""
    rest = ""
    files: list[str] = []
    for finding in reversed(group):
        match = _FILE.match(finding.message)
        if match is not None:
            rest = match["rest"]
            files.insert(0, match["file"])
    files = list(dict.fromkeys(files))
    if len(files) < 2:
        return group[0].message
    others = ", ".join(files[1:_MOST_NAMED])
    if len(files) > _MOST_NAMED:
        others += f" and {len(files) - _MOST_NAMED} more"
    return f"{files[0]} (likewise {others}): {rest}"
