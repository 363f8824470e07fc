"""What the quality gate found, and the verdict that follows from it."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Literal, cast

from ballscrew.base.errors import InputError, shown

__all__ = ["Finding", "Quality", "Severity", "Verdict", "in_order"]

Severity = Literal["bad", "suspect"]
Verdict = Literal["good", "suspect", "bad"]

_ORDER: Mapping[str, int] = {"bad": 0, "suspect": 1}
# Causes before their consequences: a polarity that is inverted lets repetitions miss, an override sets trips
# aside. What is not named here stands in the middle.
_CAUSES: tuple[tuple[str, ...], ...] = (
    ("nan", "flat", "short", "time"),
    ("wrapped",),
    ("clipped", "spike"),
    ("dropped",),
    ("copies", "stuck"),
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
_RANK: Mapping[str, int] = {
    **{code: rank - len(_CAUSES) for rank, codes in enumerate(_CAUSES) for code in codes},
    **{code: rank + 1 for rank, codes in enumerate(_EFFECTS) for code in codes},
}
_FILE = re.compile(r"\A(?P<file>[^:]*[^:\s]\.\w{1,8}): (?P<rest>.*)\Z", re.DOTALL)
# A number that stands for itself: the 1 of "nut-1" is part of a name.
_NUMBER = re.compile(r"(?<![\w.:-])[±+−-]?\d[\d.]*(?:e[+-]?\d+)?", re.IGNORECASE)
_MOST_NAMED = 4


@dataclass(frozen=True, slots=True)
class Finding:
    """One fault of a measurement.

    Parameters
    ----------
    severity : {"bad", "suspect"}
        Bad: no number can be had from it. Suspect: the numbers may be off, or something else is wrong.
    code : str
        The kind of fault, in kebab case: ``"clipped"``.
    message : str
        One clause with numbers, which names the file and the channel where it applies:
        ``"trip2.h5: torque is clipped at 1.20 N m in 3.1 % of the samples"``.
    """

    severity: Severity
    code: str
    message: str


def in_order(findings: Iterable[Finding]) -> list[Finding]:
    """Findings as a verdict tells them: causes first, then the worst; each once."""
    return sorted(dict.fromkeys(findings), key=lambda one: (_RANK.get(one.code, 0), _ORDER[one.severity]))


@dataclass(frozen=True, slots=True)
class Quality:
    """The verdict on a recording or a run.

    Parameters
    ----------
    verdict : {"good", "suspect", "bad"}
        As bad as the worst finding.
    reasons : tuple of str
        Why, causes before their consequences; empty where it is good.
    """

    verdict: Verdict
    reasons: tuple[str, ...] = ()

    @classmethod
    def of(cls, findings: Iterable[Finding]) -> Quality:
        """Verdict on all findings together.

        The same message counts once; the same fault in several files becomes one sentence with the numbers
        of the first.

        Parameters
        ----------
        findings : iterable of Finding
            Of all files of a run.

        Returns
        -------
        Quality
            Causes before their consequences, among these bad ones before suspect ones, else in the order
            given.
        """
        ordered = in_order(findings)
        groups: dict[tuple[str, ...], list[Finding]] = {}
        for finding in ordered:
            found = _FILE.match(finding.message)
            kind = _NUMBER.sub("#", found["rest"]) if found else finding.message
            groups.setdefault((finding.severity, finding.code, kind), []).append(finding)
        reasons = tuple(dict.fromkeys(_sentence(group) for group in groups.values()))
        worst = min((finding.severity for finding in ordered), key=_ORDER.__getitem__, default=None)
        return cls(worst or "good", reasons)

    def to_json(self) -> dict[str, Any]:
        """As it stands in a result: ``{"verdict": "good", "reasons": []}``."""
        return {"verdict": self.verdict, "reasons": list(self.reasons)}

    @classmethod
    def from_json(cls, document: Mapping[str, Any]) -> Quality:
        """Read what :meth:`to_json` made.

        Raises
        ------
        InputError
            If the verdict is not known or the reasons are no list of texts.
        """
        verdict, reasons = document.get("verdict"), document.get("reasons")
        if verdict not in ("good", "suspect", "bad"):
            raise InputError(f"quality.verdict is {shown(verdict)}; it must be good, suspect or bad.")
        if not isinstance(reasons, list) or not all(isinstance(reason, str) for reason in reasons):
            raise InputError(f"quality.reasons is {shown(reasons)}; it must be a list of texts.")
        return cls(cast("Verdict", verdict), tuple(reasons))


def _sentence(group: list[Finding]) -> str:
    """One sentence for a fault that several files share."""
    files = [found["file"] for finding in group if (found := _FILE.match(finding.message))]
    files = list(dict.fromkeys(files))
    if len(files) < 2:
        return group[0].message
    first = _FILE.match(group[0].message)
    assert first is not None  # noqa: S101  the group has files, so its first message names one
    named = ", ".join(files[1:_MOST_NAMED]) + (
        f" and {len(files) - _MOST_NAMED} more" if len(files) > _MOST_NAMED else ""
    )
    return f"{first['file']} (likewise {named}): {first['rest']}"
