"""One cause of a change, and how it is said."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

__all__ = ["UNITS", "Cause", "possible_beside", "words"]


@dataclass(frozen=True, slots=True)
class Cause:
    """One cause, and what speaks for it.

    Parameters
    ----------
    name : str
        nut, bearing, load, torque, position, temperature or local.
    probability : float
        Among those compared, with their stated chances beforehand.
    chi2 : float
        What it leaves unexplained.
    amount, standard_uncertainty : float
        How large it would be.
    unit : str
        Of the amount.
    possible : bool
        Whether it explains the cells by itself, and the run about as well as the nut does, at a plausible
        size.
    text : str
        The same in words.
    fit : float
        Probability of a misfit of the cells as large as with it, where nothing else is wrong.
    """

    name: str
    probability: float
    chi2: float
    amount: float
    standard_uncertainty: float
    unit: str
    possible: bool
    text: str
    fit: float = 1.0

    def to_json(self) -> dict[str, Any]:
        """As ``preload --json`` prints it."""
        return {
            "cause": self.name,
            "probability": self.probability,
            "chi2": self.chi2,
            "amount": {
                "value": self.amount,
                "standard_uncertainty": self.standard_uncertainty,
                "unit": self.unit,
            },
            "fit": self.fit,
            "possible": self.possible,
            "text": self.text,
        }


UNITS: Mapping[str, str] = defaultdict(str, load="kg", position="m")
"""Of the amounts, by cause; none for parts."""


def words(name: str, amount: float) -> str:
    """Say a cause.

    Parameters
    ----------
    name : str
        Its name.
    amount : float
        Its size, in its unit.

    Returns
    -------
    str
        Half a sentence.
    """
    up = amount > 0
    part = f"{abs(100 * amount):.{1 if abs(amount) >= 1e-3 else 2}f} %"
    return {
        "nut": _nut(amount),
        "bearing": f"the thrust bearing, {part} {'stiffer' if up else 'softer'}",
        "load": f"a load {abs(amount):.2g} kg {'heavier' if up else 'lighter'} than declared",
        "torque": f"a torque that reads {part} too {'high' if up else 'low'}",
        "position": f"a zero that has moved by {1e3 * amount:+.1f} mm",
        "temperature": f"warmth, {part} of the preload",
        "local": "a change at some stops and not at others",
    }[name]


def _nut(softer: float) -> str:
    change = max(1 + softer, 0.1) ** -3 - 1
    return f"the nut, {abs(100 * change):.1f} % {'more' if change > 0 else 'less'} preload"


def possible_beside(found: Sequence[Cause]) -> tuple[Cause, ...]:
    """Causes other than the nut that explain a run about as well."""
    return tuple(cause for cause in found if cause.possible and cause.name != "nut")
