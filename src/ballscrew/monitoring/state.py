"""Health state of an axis as a result: states of runs, stage and causes; written as JSON and read back."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from types import MappingProxyType
from typing import Any

from ballscrew.base import json_fields
from ballscrew.base.errors import InputError
from ballscrew.base.jsonfile import SCHEMA, plain
from ballscrew.base.provenance import Made
from ballscrew.base.quantity import Quantity
from ballscrew.monitoring.detection.chart import Chart
from ballscrew.monitoring.epochs import Epoch, Event
from ballscrew.monitoring.history_causes import HistoryCause
from ballscrew.monitoring.reading import Reading
from ballscrew.monitoring.stage import Stage


@dataclass(frozen=True, slots=True, eq=False)
class RunState:
    """State of one run in its history.

    Parameters
    ----------
    reading : Reading
        Its quantities.
    state : str
        learning, normal, watch, alarm or suspect.
    relative : Quantity or None
        P/P₀ relative to the epoch's baseline, at the reference's temperature.
    ramp, ramp_limit, odds, odds_limit : float
        The two statistics and their limits of alarm; nan for a run that is not charted, infinite limits
        while learning.
    relative_random : float
        Random part of the standard uncertainty.
    """

    reading: Reading
    state: str
    relative: Quantity | None = None
    ramp: float = math.nan
    ramp_limit: float = math.nan
    odds: float = math.nan
    odds_limit: float = math.nan
    relative_random: float = math.nan


@dataclass(frozen=True, eq=False)
class HealthState:
    """Health state of an axis.

    Parameters
    ----------
    axis : str or None
        Its name.
    runs : tuple of RunState
        In time order.
    epochs : tuple of Epoch
        Each with the time at which its newest alarm began.
    state : str
        Of the newest good run of the newest epoch; learning where there is none.
    alarm_at : str or None
        Time at which the newest epoch's newest alarm began; it may be over.
    stage : Stage or None
        Of the newest good run under watch or alarm; None while learning, normal or stiffer than the baseline,
        where no preload is being lost.
    causes : tuple of HistoryCause
        Possible causes of the change; empty where nothing has changed.
    scale_uncertainty : float
        Relative standard deviation of all levels together, from the nut's share of the compliance.
    made : Made
        Version, settings, inputs.
    repeat_asked : bool
        Whether the newest run is to be repeated on the same day: one run cannot separate outlier and wear.
    notes : tuple of str
        Notes, a sentence each.
    charts : tuple of Chart or None
        Of each epoch; not part of the JSON.
    """

    axis: str | None
    runs: tuple[RunState, ...]
    epochs: tuple[Epoch, ...]
    state: str
    alarm_at: str | None
    stage: Stage | None
    causes: tuple[HistoryCause, ...]
    scale_uncertainty: float
    made: Made
    repeat_asked: bool = False
    notes: tuple[str, ...] = ()
    charts: tuple[Chart | None, ...] = ()

    @property
    def stiffer(self) -> bool:
        """Whether the newest runs are stiffer than the baseline: no wear does that."""
        if not self.charts or self.charts[-1] is None:
            return False
        return self.charts[-1].newest_stiffer

    def to_json(self) -> dict[str, Any]:
        """Document of the state, as ``monitor --json`` prints it; nan and infinity are null."""
        document = {
            "schema": SCHEMA,
            "axis": self.axis,
            "state": self.state,
            "runs": [_run_document(run) for run in self.runs],
            "epochs": [asdict(epoch) for epoch in self.epochs],
            "alarm_at": self.alarm_at,
            "stage": None,
            "causes": [asdict(cause) for cause in self.causes],
            "repeat_asked": self.repeat_asked,
            "notes": list(self.notes),
            "scale_uncertainty": self.scale_uncertainty,
            "made": asdict(self.made),
        }
        if self.stage is not None:
            document["stage"] = asdict(self.stage)
        result: dict[str, Any] = plain(document)
        return result

    @classmethod
    def from_json(cls, document: Mapping[str, Any], source: str = "MONITOR.json") -> HealthState:
        """Read the document back.

        Parameters
        ----------
        document : mapping
            As :meth:`to_json` makes it; keys that a later version added are ignored.
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
            return cls(**json_fields.fields(_FIELDS, document, "", required=_REQUIRED))
        except InputError as error:
            raise InputError(f"{source}: is not a health state of ballscrew: {error}") from None


def _run_document(run: RunState) -> dict[str, Any]:
    relative = None
    if run.relative is not None:
        relative = run.relative.to_json()
    reading = {field.name: getattr(run.reading, field.name) for field in fields(Reading)}
    reading["features"] = dict(run.reading.features)
    return {
        "run": run.reading.run,
        "measured_at": run.reading.measured_at,
        "epoch": run.reading.epoch,
        "state": run.state,
        "relative_to_baseline": relative,
        "relative_random": run.relative_random,
        "ramp": {"value": run.ramp, "limit": run.ramp_limit},
        "odds": {"value": run.odds, "limit": run.odds_limit},
        "reading": reading,
    }


def _float(value: Any, where: str) -> float:
    """Number, or nan for null."""
    number = _NUMBER_OR_NULL(value, where)
    return math.nan if number is None else float(number)


def _object(kind: type[Any], kinds: Mapping[str, json_fields.Field]) -> json_fields.Field:
    """Object of a class with all of these fields."""

    def read(row: Any, where: str) -> Any:
        return kind(**json_fields.fields(kinds, row, where, required=tuple(kinds)))

    return read


def _optional(field: json_fields.Field) -> json_fields.Field:
    """Field that may be null."""

    def read(value: Any, where: str) -> Any:
        return None if value is None else field(value, where)

    return read


def _statistic(row: Any, where: str) -> tuple[float, float]:
    """Value and limit: the limit is infinite while learning; a run that is not charted has neither."""
    kinds = {"value": _float, "limit": _float}
    numbers = json_fields.fields(kinds, row, where, required=("value", "limit"))
    if math.isnan(numbers["limit"]) and not math.isnan(numbers["value"]):
        return numbers["value"], math.inf
    return numbers["value"], numbers["limit"]


def _run_state(row: Any, where: str) -> RunState:
    kinds: dict[str, json_fields.Field] = {
        "reading": _object(Reading, _READING),
        "state": json_fields.choice(*_STATES),
        "relative_to_baseline": json_fields.quantity(0.0, _LARGEST),
        "relative_random": _float,
        "ramp": _statistic,
        "odds": _statistic,
    }
    values = json_fields.fields(kinds, row, where, required=tuple(kinds))
    relative = None
    if values["relative_to_baseline"] is not None:
        quantity = values["relative_to_baseline"]
        relative = Quantity(quantity["value"], quantity["standard_uncertainty"], "", quantity["interval95"])
    ramp, ramp_limit = values["ramp"]
    odds, odds_limit = values["odds"]
    return RunState(
        reading=values["reading"],
        state=values["state"],
        relative=relative,
        ramp=ramp,
        ramp_limit=ramp_limit,
        odds=odds,
        odds_limit=odds_limit,
        relative_random=values["relative_random"],
    )


def _features(value: Any, where: str) -> Mapping[str, float]:
    return MappingProxyType(json_fields.mapping(_float)(value, where))


_LARGEST = 1e300  # of a number in a document
_NUMBER_OR_NULL = json_fields.number(-_LARGEST, _LARGEST, optional=True)
_STATES = ("learning", "normal", "watch", "alarm", "suspect")
_TEXT, _TEXT_OR_NULL = json_fields.text(), json_fields.text(optional=True)
_PROBABILITY = json_fields.number(0.0, 1.0)
_NUMBERS = (
    "day",
    "temperature",
    "level",
    "random",
    "equivalent_mass",
    "friction",
    "friction_uncertainty",
    "backlash",
    "backlash_uncertainty",
    "systematic",
    "mass_over_preload",
    "mass_over_preload_uncertainty",
)
_READING: dict[str, json_fields.Field] = {
    "run": _TEXT,
    "measured_at": _TEXT,
    "epoch": json_fields.whole(1_000_000),
    "verdict": _TEXT,
    "reasons": json_fields.listed(_TEXT),
    "features": _features,
    **dict.fromkeys(_NUMBERS, _float),
}
_EVENT = _object(Event, {"at": _TEXT, "kind": _TEXT, "text": _TEXT})
_EPOCH: dict[str, json_fields.Field] = {
    "number": json_fields.whole(1_000_000),
    "begins": _TEXT_OR_NULL,
    "ends": _TEXT_OR_NULL,
    "cause": _TEXT,
    "events": json_fields.listed(_EVENT),
    "reference": _TEXT_OR_NULL,
    "reference_at": _TEXT_OR_NULL,
    "alarm_at": _TEXT_OR_NULL,
}
_MADE: dict[str, json_fields.Field] = {
    "settings": json_fields.mapping(json_fields.anything),
    "version": _TEXT,
    "inputs": json_fields.mapping(json_fields.anything),
}
_FIELDS: dict[str, json_fields.Field] = {
    "axis": _TEXT_OR_NULL,
    "runs": json_fields.listed(_run_state),
    "epochs": json_fields.listed(_object(Epoch, _EPOCH)),
    "state": json_fields.choice(*_STATES),
    "alarm_at": _TEXT_OR_NULL,
    "stage": _optional(_object(Stage, {"I": _PROBABILITY, "II": _PROBABILITY, "how": _TEXT})),
    "causes": json_fields.listed(
        _object(HistoryCause, {"cause": _TEXT, "probability": _PROBABILITY, "evidence": _TEXT})
    ),
    "scale_uncertainty": json_fields.number(0.0, _LARGEST),
    "made": _object(Made, _MADE),
    "repeat_asked": json_fields.flag,
    "notes": json_fields.listed(_TEXT),
}
_REQUIRED = tuple(_FIELDS)
