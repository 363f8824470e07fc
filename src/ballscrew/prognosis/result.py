"""A prognosis as it is printed and kept."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from itertools import pairwise
from typing import Any

from ballscrew.base.errors import InputError, shown
from ballscrew.base.jsonfile import SCHEMA, plain
from ballscrew.base.provenance import Made

__all__ = ["QUANTILES", "Fan", "Prognosis"]

QUANTILES = (0.05, 0.1, 0.25, 0.5, 0.75, 0.9, 0.95)
_MODES = ("preload", "load", "backlash")
_LONGEST = 100_000


@dataclass(frozen=True, slots=True)
class Fan:
    """P/P₀ ahead.

    Parameters
    ----------
    days : tuple of float
        From the day of the prognosis on.
    probabilities : tuple of float
        Of the quantiles.
    ratio : tuple of tuple of float
        One row a day, one entry a probability.
    """

    days: tuple[float, ...] = ()
    probabilities: tuple[float, ...] = ()
    ratio: tuple[tuple[float, ...], ...] = ()


@dataclass(frozen=True)
class Prognosis:
    """How long an axis will last.

    Parameters
    ----------
    at_day : float
        Day of the epoch on which it is made.
    rul_days, rul_travel_m : mapping of float to float or None
        Probability to quantile of the remaining life; None where it is open. The travel is empty where no
        duty is stated.
    failure_mode : str
        preload, load or backlash.
    failure : str
        When it has failed, in words.
    reach_days : float
        Beyond which nothing is told.
    begun : float or None
        Probability that wear has begun.
    laws : mapping of str to float
        Wear law to probability.
    statement : tuple of str
        Sentences; the first says it all.
    assumptions : tuple of str
        What it rests on.
    would_change : tuple of str
        What would change it.
    confidence : str
        How much is known, in words.
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
    made: Made = field(default_factory=Made)

    def to_json(self) -> dict[str, Any]:
        """The document; open quantiles are null."""
        document = {
            "schema": SCHEMA,
            "at_day": self.at_day,
            "rul_days": {"quantiles": _named(self.rul_days)},
            "rul_travel_m": {"quantiles": _named(self.rul_travel_m)},
            "failure": {"mode": self.failure_mode, "text": self.failure},
            "reach_days": self.reach_days,
            "begun": self.begun,
            "laws": dict(self.laws),
            "confidence": self.confidence,
            "statement": list(self.statement),
            "assumptions": list(self.assumptions),
            "would_change": list(self.would_change),
            "fan": asdict(self.fan),
            "duty_m_per_day": self.duty_m_per_day,
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
            As :meth:`to_json` makes it; keys that a later version added are passed over.
        source : str
            Its name, for messages.

        Returns
        -------
        Prognosis
            The same.

        Raises
        ------
        InputError
            If a key is missing or of another kind, or a number cannot be.
        """
        try:
            return _read(document)
        except KeyError as error:
            raise InputError(f"{source}: is not a prognosis of ballscrew: {error} is missing.") from None
        except (TypeError, AttributeError, ValueError, OverflowError, RecursionError) as error:
            raise InputError(
                f"{source}: is not a prognosis of ballscrew: {shown(str(error))} is of another kind."
            ) from None


def _read(document: Mapping[str, Any]) -> Prognosis:
    mode = document["failure"]["mode"]
    if mode not in _MODES:
        raise ValueError("failure.mode")
    made = document["made"]
    return Prognosis(
        at_day=_number(document["at_day"], "at_day"),
        rul_days=_quantiles(document["rul_days"]["quantiles"]),
        rul_travel_m=_quantiles(document["rul_travel_m"]["quantiles"]),
        failure_mode=mode,
        failure=_text(document["failure"]["text"]),
        reach_days=_number(document["reach_days"], "reach_days", 0.0),
        begun=_maybe(document["begun"], "begun", 0.0, 1.0),
        laws={_text(name): _number(part, "laws", 0.0, 1.0) for name, part in document["laws"].items()},
        statement=_texts(document["statement"]),
        assumptions=_texts(document["assumptions"]),
        would_change=_texts(document["would_change"]),
        confidence=_text(document["confidence"]),
        fan=_fan(document["fan"]),
        duty_m_per_day=_maybe(document["duty_m_per_day"], "duty_m_per_day", 0.0),
        method=_text(document["method"]),
        made=Made(
            **{key: value for key, value in _mapping(made).items() if key in Made.__dataclass_fields__}
        ),
    )


def _named(quantiles: Mapping[float, float | None]) -> dict[str, float | None]:
    return {f"{p:g}": value for p, value in quantiles.items()}


def _quantiles(row: Any) -> dict[float, float | None]:
    found: dict[float, float | None] = {}
    for name, value in _mapping(row).items():
        found[_number(float(name), "quantiles", 0.0, 1.0)] = _maybe(value, "quantiles", 0.0)
    ends = ((p, found[p]) for p in sorted(found))
    lasting = [math.inf if end is None else end for _, end in ends]
    if any(later < sooner for sooner, later in pairwise(lasting)):
        raise ValueError("quantiles")
    return {p: found[p] for p in sorted(found)}


def _fan(row: Any) -> Fan:
    days = tuple(_number(day, "fan.days", 0.0) for day in _sequence(row["days"]))
    chances = tuple(_number(p, "fan.probabilities", 0.0, 1.0) for p in _sequence(row["probabilities"]))
    ratio = tuple(
        tuple(_number(one, "fan.ratio", 0.0) for one in _sequence(line)) for line in _sequence(row["ratio"])
    )
    if len(ratio) != len(days) or any(len(line) != len(chances) for line in ratio):
        raise ValueError("fan")
    return Fan(days, chances, ratio)


def _number(value: Any, name: str, least: float = -math.inf, most: float = math.inf) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
        raise ValueError(name)
    if not least <= value <= most:
        raise ValueError(name)
    return float(value)


def _maybe(value: Any, name: str, least: float = -math.inf, most: float = math.inf) -> float | None:
    return None if value is None else _number(value, name, least, most)


def _mapping(value: Any) -> Mapping[str, Any]:
    if not isinstance(value, Mapping):
        raise TypeError(shown(value))
    return value


def _sequence(value: Any) -> list[Any]:
    if not isinstance(value, (list, tuple)) or len(value) > _LONGEST:
        raise TypeError(shown(value))
    return list(value)


def _text(value: Any) -> str:
    if not isinstance(value, str):
        raise TypeError(shown(value))
    return value


def _texts(value: Any) -> tuple[str, ...]:
    return tuple(_text(one) for one in _sequence(value))
