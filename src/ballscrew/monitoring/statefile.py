"""The health of an axis as a document, and back."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, fields
from types import MappingProxyType
from typing import Any

from ballscrew.base.errors import InputError
from ballscrew.base.jsonfile import SCHEMA, plain
from ballscrew.base.provenance import Made
from ballscrew.base.quantity import Quantity
from ballscrew.monitoring.epochs import Epoch, Event
from ballscrew.monitoring.history_causes import HistoryCause
from ballscrew.monitoring.reading import Reading
from ballscrew.monitoring.stage import Stage
from ballscrew.monitoring.state import HealthState, RunState

__all__ = ["state_from_json", "state_to_json"]

_TEXTS = ("run", "measured_at", "verdict")
_STATES = ("learning", "normal", "watch", "alarm", "suspect")


def state_to_json(state: HealthState) -> dict[str, Any]:
    """What ``monitor --json`` prints of the state.

    Parameters
    ----------
    state : HealthState
        Of an axis.

    Returns
    -------
    dict
        Plain; nan and infinity are null.
    """
    document = {
        "schema": SCHEMA,
        "axis": state.axis,
        "state": state.state,
        "runs": [_run(one) for one in state.runs],
        "epochs": [asdict(one) for one in state.epochs],
        "alarm_at": state.alarm_at,
        "stage": None if state.stage is None else asdict(state.stage),
        "causes": [asdict(one) for one in state.causes],
        "repeat_asked": state.repeat_asked,
        "notes": list(state.notes),
        "scale_uncertainty": state.scale_uncertainty,
        "made": asdict(state.made),
    }
    result: dict[str, Any] = plain(document)
    return result


def state_from_json(document: Mapping[str, Any], source: str = "MONITOR.json") -> HealthState:
    """Read the document back.

    Parameters
    ----------
    document : mapping
        As :func:`state_to_json` makes it; keys that a later version added are passed over.
    source : str
        Its name, for messages.

    Returns
    -------
    HealthState
        Without its charts.

    Raises
    ------
    InputError
        If a key is missing or of another kind.
    """
    try:
        return HealthState(
            axis=document["axis"],
            runs=tuple(_run_from(row) for row in document["runs"]),
            epochs=tuple(
                _known(Epoch, {**row, "events": tuple(_known(Event, one) for one in row["events"])})
                for row in document["epochs"]
            ),
            state=_word(document["state"]),
            alarm_at=document["alarm_at"],
            stage=None if document["stage"] is None else _known(Stage, document["stage"]),
            causes=tuple(_known(HistoryCause, row) for row in document["causes"]),
            scale_uncertainty=_number(document["scale_uncertainty"]),
            made=_known(Made, document["made"]),
            repeat_asked=document.get("repeat_asked", False) is True,
            notes=tuple(str(one) for one in document.get("notes", ())),
        )
    except (KeyError, TypeError, AttributeError, ValueError) as error:
        raise InputError(
            f"{source}: is not a health of ballscrew: {error!r} is missing or of another kind."
        ) from None


def _run(one: RunState) -> dict[str, Any]:
    reading = {field.name: getattr(one.reading, field.name) for field in fields(Reading)}
    return {
        "run": one.reading.run,
        "measured_at": one.reading.measured_at,
        "epoch": one.reading.epoch,
        "state": one.state,
        "relative_to_baseline": None if one.relative is None else one.relative.to_json(),
        "relative_random": one.relative_random,
        "ramp": {"value": one.ramp, "limit": one.ramp_limit},
        "odds": {"value": one.odds, "limit": one.odds_limit},
        "reading": reading | {"features": dict(one.reading.features)},
    }


def _run_from(row: Mapping[str, Any]) -> RunState:
    told, relative = row["reading"], row["relative_to_baseline"]
    values: dict[str, Any] = {}
    for field in fields(Reading):
        value = told[field.name]
        if field.name in _TEXTS:
            values[field.name] = str(value)
        elif field.name == "reasons":
            values[field.name] = tuple(str(one) for one in value)
        elif field.name == "features":
            features = {str(key): _number(number) for key, number in value.items()}
            values[field.name] = MappingProxyType(features)
        elif field.name == "epoch":
            values[field.name] = int(value)
        else:
            values[field.name] = _number(value)
    ramp, odds = row["ramp"], row["odds"]
    return RunState(
        Reading(**values),
        _word(row["state"]),
        None if relative is None else _quantity(relative),
        _number(ramp["value"]),
        _limit(ramp),
        _number(odds["value"]),
        _limit(odds),
        _number(row["relative_random"]),
    )


def _quantity(row: Mapping[str, Any]) -> Quantity:
    low, high = row["interval95"]
    return Quantity(_number(row["value"]), _number(row["standard_uncertainty"]), "", (low, high))


def _limit(row: Mapping[str, Any]) -> float:
    """Infinite while it learns; a run that is not charted has none."""
    if row["limit"] is None and row["value"] is not None:
        return math.inf
    return _number(row["limit"])


def _number(value: Any) -> float:
    if value is None:
        return math.nan
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise TypeError(f"a number, where {str(value)[:40]!r} stands")
    return float(value)


def _word(value: Any) -> str:
    if value not in _STATES:
        raise ValueError(f"state {str(value)[:40]!r}")
    return str(value)


def _known(kind: type[Any], row: Mapping[str, Any]) -> Any:
    return kind(**{key: value for key, value in row.items() if key in kind.__dataclass_fields__})
