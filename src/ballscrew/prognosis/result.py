"""Prognosis as a result: printed, written as JSON and read back."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from ballscrew.base import json_fields
from ballscrew.base.errors import InputError
from ballscrew.base.jsonfile import SCHEMA, plain
from ballscrew.base.provenance import Made

QUANTILES = (0.05, 0.1, 0.25, 0.5, 0.75, 0.9, 0.95)


@dataclass(frozen=True, slots=True)
class Fan:
    """Quantiles of P/P₀ ahead.

    Parameters
    ----------
    days : tuple of float
        From the day of the prognosis on.
    probabilities : tuple of float
        Probabilities of the quantiles.
    ratio : tuple of tuple of float
        One row per day, one entry per probability.
    """

    days: tuple[float, ...] = ()
    probabilities: tuple[float, ...] = ()
    ratio: tuple[tuple[float, ...], ...] = ()


@dataclass(frozen=True)
class Prognosis:
    """Remaining life of an axis.

    Parameters
    ----------
    at_day : float
        Day of the epoch on which it is made.
    rul_days, rul_travel_m : mapping of float to float or None
        Probability to quantile of the remaining life; None where it is open. The travel is empty where no
        duty is stated.
    rul_revolutions, rul_hours : mapping of float to float or None
        The same in counters of the machine; empty where no duty has them.
    duty_per_day : mapping of str to float
        Duty of a day ahead, by the name of the counter.
    failure_mode : str
        preload, load or backlash.
    failure : str
        End of life, in words.
    reach_days : float
        Days ahead beyond which nothing is forecast.
    begun : float or None
        Probability that wear has begun, by the runs without the alarm.
    families : mapping of str to float
        Family of wear to weight; empty where the model is of one family.
    laws : mapping of str to float
        Wear law to probability.
    statement : tuple of str
        Sentences; the first is the conclusion.
    assumptions : tuple of str
        Conditions of the prognosis.
    would_change : tuple of str
        Events and observations that would change it.
    confidence : str
        Confidence, in words.
    fan : Fan
        P/P₀ ahead.
    duty_m_per_day : float or None
        Travel of a day.
    method : str
        Life model.
    made : Made
        Version, settings, inputs.
    """

    at_day: float
    rul_days: Mapping[float, float | None]
    rul_travel_m: Mapping[float, float | None]
    failure_mode: str
    failure: str
    reach_days: float
    begun: float | None
    laws: Mapping[str, float]
    statement: tuple[str, ...]
    assumptions: tuple[str, ...]
    would_change: tuple[str, ...]
    confidence: str
    fan: Fan = field(default_factory=Fan)
    duty_m_per_day: float | None = None
    method: str = ""
    families: Mapping[str, float] = field(default_factory=dict)
    rul_revolutions: Mapping[float, float | None] = field(default_factory=dict)
    rul_hours: Mapping[float, float | None] = field(default_factory=dict)
    duty_per_day: Mapping[str, float] = field(default_factory=dict)
    made: Made = field(default_factory=Made)

    def to_json(self) -> dict[str, Any]:
        """Document with null for open quantiles."""
        document = {
            "schema": SCHEMA,
            "at_day": self.at_day,
            "rul_days": {"quantiles": _by_name(self.rul_days)},
            "rul_travel_m": {"quantiles": _by_name(self.rul_travel_m)},
            "rul_revolutions": {"quantiles": _by_name(self.rul_revolutions)},
            "rul_hours": {"quantiles": _by_name(self.rul_hours)},
            "failure": {"mode": self.failure_mode, "text": self.failure},
            "reach_days": self.reach_days,
            "begun": self.begun,
            "families": dict(self.families),
            "laws": dict(self.laws),
            "confidence": self.confidence,
            "statement": list(self.statement),
            "assumptions": list(self.assumptions),
            "would_change": list(self.would_change),
            "fan": asdict(self.fan),
            "duty_m_per_day": self.duty_m_per_day,
            "duty_per_day": dict(self.duty_per_day),
            "method": self.method,
            "made": asdict(self.made),
        }
        result: dict[str, Any] = plain(document)
        return result

    @classmethod
    def from_json(cls, document: Mapping[str, Any], source: str = "PROGNOSIS.json") -> Prognosis:
        """Read the document back.

        Parameters
        ----------
        document : mapping
            As :meth:`to_json` makes it; keys that a later version added are ignored.
        source : str
            Its name, for messages.

        Returns
        -------
        Prognosis
            The same.

        Raises
        ------
        InputError
            If a key is missing or of another kind, or a number is out of range.
        """
        if isinstance(document, Mapping):
            document = {**_ADDED, **document}
        try:
            values = _DOCUMENT(document, "")
        except InputError as error:
            raise InputError(f"{source}: is not a prognosis of ballscrew: {error}") from None
        failure = values.pop("failure")
        return cls(**values, failure_mode=failure["mode"], failure=failure["text"])


def _by_name(quantiles: Mapping[float, float | None]) -> dict[str, float | None]:
    return {f"{p:g}": value for p, value in quantiles.items()}


def _quantiles(row: Any, where: str) -> dict[float, float | None]:
    """Quantiles by ascending probability; they must ascend too, and the open ones come last."""
    named = _QUANTILES(row, where)["quantiles"]
    quantiles: dict[float, float | None] = {}
    for name in sorted(named, key=_probability):
        quantiles[_probability(name)] = named[name]
    ends = np.nan_to_num(np.array(list(quantiles.values()), dtype=float), nan=math.inf)
    if np.any(ends[1:] < ends[:-1]):
        raise json_fields.wrong(named, f"{where}.quantiles", "numbers that ascend with the probability")
    return quantiles


def _probability(name: str) -> float:
    try:
        value = float(name)
    except ValueError:
        value = math.nan
    if not 0 <= value <= 1:
        raise json_fields.wrong(name, "a quantile's name", "a probability from 0 to 1")
    return value


def _fan(row: Any, where: str) -> Fan:
    fan: Fan = _FAN(row, where)
    lengths = {len(line) for line in fan.ratio} - {len(fan.probabilities)}
    if lengths or len(fan.ratio) != len(fan.days):
        raise json_fields.wrong(row, where, "a row per day and a number per probability")
    return fan


_ADDED: dict[str, Any] = {
    "rul_revolutions": {"quantiles": {}},
    "rul_hours": {"quantiles": {}},
    "duty_per_day": {},
}
_NUMBERS, _TEXTS = json_fields.listed(json_fields.number(0.0)), json_fields.listed(json_fields.text())
_PROBABILITY = json_fields.number(0.0, 1.0)
_QUANTILES = json_fields.record({"quantiles": json_fields.mapping(json_fields.number(0.0, optional=True))})
_FAN = json_fields.instance(
    Fan,
    days=_NUMBERS,
    probabilities=json_fields.listed(_PROBABILITY),
    ratio=json_fields.listed(_NUMBERS),
)
_MODE = json_fields.choice("preload", "load", "backlash")
_DOCUMENT = json_fields.record(
    {
        "at_day": json_fields.number(),
        "rul_days": _quantiles,
        "rul_travel_m": _quantiles,
        "rul_revolutions": _quantiles,
        "rul_hours": _quantiles,
        "failure": json_fields.record({"mode": _MODE, "text": json_fields.text()}),
        "reach_days": json_fields.number(0.0),
        "begun": json_fields.number(0.0, 1.0, optional=True),
        "families": json_fields.mapping(_PROBABILITY),
        "laws": json_fields.mapping(_PROBABILITY),
        "statement": _TEXTS,
        "assumptions": _TEXTS,
        "would_change": _TEXTS,
        "confidence": json_fields.text(),
        "fan": _fan,
        "duty_m_per_day": json_fields.number(0.0, optional=True),
        "duty_per_day": json_fields.mapping(json_fields.number(0.0)),
        "method": json_fields.text(),
        "made": json_fields.instance(Made),
    }
)
