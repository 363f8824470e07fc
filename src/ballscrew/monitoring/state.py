"""Health state of an axis as a result: states of runs, stage and causes; written as JSON and read back."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

from ballscrew.base import json_fields
from ballscrew.base.errors import InputError
from ballscrew.base.jsonfile import SCHEMA, plain
from ballscrew.base.provenance import Made
from ballscrew.base.quantity import Quantity, quantity_json
from ballscrew.base.words import percent
from ballscrew.monitoring.detection.chart import Chart
from ballscrew.monitoring.epochs import Epoch, Event
from ballscrew.monitoring.history_causes import HistoryCause
from ballscrew.monitoring.reading import Reading
from ballscrew.monitoring.stage import Stage

LEAST_GOOD = 3
"""Good runs that make a baseline."""


@dataclass(frozen=True, slots=True, eq=False)
class RunState:
    """State of one run in its history.

    Parameters
    ----------
    reading : Reading
        Its measured quantities.
    state : str
        learning, normal, watch or alarm; unloaded where the test's own load unloads the nut, so that its
        preload has an upper limit alone; else suspect.
    stiffness : Quantity or None
        Axial stiffness as P/P₀ relative to the epoch's baseline, at the reference's temperature.
    relative : Quantity or None
        P/P₀ of the nut, uncertain by the support bearing; None also where it has no upper end.
    ramp, ramp_limit, odds, odds_limit : float
        The two statistics and their limits of alarm; nan for a run that is not charted, infinite limits
        while learning.
    relative_random : float
        Random part of the standard uncertainty of ``stiffness``.
    """

    reading: Reading
    state: str
    stiffness: Quantity | None = None
    relative: Quantity | None = None
    ramp: float = math.nan
    ramp_limit: float = math.nan
    odds: float = math.nan
    odds_limit: float = math.nan
    relative_random: float = math.nan

    @property
    def preload_below(self) -> float | None:
        """P/P₀ below which the nut's preload is, where that is all that is known; one-sided, 95 %."""
        if self.relative is None or self.relative.interval[0] > 0:
            return None
        return self.relative.interval[1]


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
        State of the newest run of the newest epoch that is good or whose own load unloads the nut; learning
        if there is none.
    alarm_at : str or None
        Time at which the newest epoch's newest alarm began; it may be over.
    stage : Stage or None
        Stage at that run; None unless the state is watch or alarm, and None if it is stiffer than the
        baseline.
    causes : tuple of HistoryCause
        Possible causes of the change; empty where nothing has changed.
    scale_uncertainty : float
        Relative standard deviation of all levels together, from the nut's share of the compliance.
    made : Made
        Version, settings, inputs.
    repeat_asked : bool
        True if the newest run should be repeated on the same day: one run cannot distinguish an outlier from
        wear.
    reasons : tuple of str
        Reasons to doubt the calibration, by which all preloads are suspect; a change since the baseline, and
        with it the alarm, depends on it less.
    nut_reasons : tuple of str
        Reasons to doubt that the nut's preload has changed as the axial stiffness has.
    notes : tuple of str
        Notes, a sentence each.
    charts : tuple of Chart or None
        Chart of each epoch; not part of the JSON.
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
    reasons: tuple[str, ...] = ()
    nut_reasons: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    charts: tuple[Chart | None, ...] = ()

    @property
    def verdict(self) -> str:
        """Of the axial stiffness: ``"good"``, or ``"suspect"`` where there are reasons."""
        return "suspect" if self.reasons else "good"

    @property
    def nut_verdict(self) -> str:
        """Of the nut's preload: ``"good"``, or ``"suspect"`` where there are reasons of its own or others."""
        return "suspect" if self.reasons or self.nut_reasons else "good"

    @property
    def stiffer(self) -> bool:
        """True if the newest runs are stiffer than the baseline, which wear does not cause."""
        if not self.charts or self.charts[-1] is None:
            return False
        return self.charts[-1].newest_stiffer

    @property
    def epoch_runs(self) -> tuple[RunState, ...]:
        """Runs of the newest epoch, in time order."""
        newest = self.epochs[-1].number
        return tuple(run for run in self.runs if run.reading.epoch == newest)

    @property
    def assessed(self) -> RunState | None:
        """Run that the state is of; None where no run of the newest epoch is good."""
        return next((run for run in reversed(self.epoch_runs) if run.state != "suspect"), None)

    @property
    def set_aside(self) -> tuple[RunState, ...]:
        """Runs of the newest epoch after the one that the state is of."""
        newer: list[RunState] = []
        for run in reversed(self.epoch_runs):
            if run.state != "suspect":
                break
            newer.append(run)
        return tuple(reversed(newer))

    @property
    def loss_while_learning(self) -> float | None:
        """Loss of P/P₀, by the axial stiffness, from the first to the newest run of an unfinished baseline.

        None where the 95 % intervals of the two overlap, or the axis is not learning.
        """
        if self.state != "learning":
            return None
        found = [run.stiffness for run in self.epoch_runs if run.state == "learning" and run.stiffness]
        if not found or found[-1].interval[1] >= found[0].interval[0]:
            return None
        return 1 - found[-1].value / found[0].value

    @property
    def visits(self) -> int:
        """Good runs of the newest epoch; those of a day count once where it has a chart."""
        chart = self.charts[-1] if self.charts else None
        if chart is not None:
            return len(chart.visits.first)
        return sum(run.reading.verdict == "good" for run in self.epoch_runs)

    @property
    def why_unassessed(self) -> str:
        """Why the axis is not assessed as of its newest run, without full stop; empty where it is."""
        parts = []
        if self.state == "learning":
            good = sum(run.state == "learning" for run in self.epoch_runs)
            learnt = f"{good} of {LEAST_GOOD} good runs"
            if good >= LEAST_GOOD:
                learnt = f"a baseline takes {LEAST_GOOD} good runs on different days"
            if self.visits >= LEAST_GOOD:
                learnt = "the baseline is complete: the next good run will be assessed"
            parts.append(f"learning, {learnt}")
            if self.loss_while_learning is not None:
                loss = percent(self.loss_while_learning)
                parts.append(
                    f"the axis already softened in these runs, as by a loss of {loss} of the preload"
                )
        if self.set_aside:
            reasons = self.set_aside[-1].reading.reasons
            reason = reasons[0] if reasons else "it gives no preload"
            which = "the newest run does"
            if len(self.set_aside) > 1:
                which = f"the newest {len(self.set_aside)} runs do"
            parts.append(f"{which} not count ({reason})")
        return "; ".join(parts)

    @property
    def urgency(self) -> str:
        """What is due: nothing, another test (repeat), a repair to be planned (plan), a repair (now).

        ``"unknown"`` where the axis is not assessed and its last state asks for nothing.
        """
        if self.state == "alarm":
            gone = self.assessed is not None and self.assessed.preload_below is not None
            return "now" if gone else "plan"
        if self.state == "watch":
            return "repeat"
        return "unknown" if self.why_unassessed else "none"

    def to_json(self) -> dict[str, Any]:
        """Document of the state, as ``monitor --json`` prints it; nan and infinity are null."""
        document = {
            "schema": SCHEMA,
            "axis": self.axis,
            "state": self.state,
            "state_at": None if self.assessed is None else self.assessed.reading.measured_at,
            "preload_below": None if self.assessed is None else self.assessed.preload_below,
            "urgency": self.urgency,
            "not_judged": self.why_unassessed or None,
            "set_aside": [run.reading.run for run in self.set_aside],
            "verdict": self.verdict,
            "reasons": list(self.reasons),
            "nut_verdict": self.nut_verdict,
            "nut_reasons": list(self.nut_reasons),
            "runs": [_run_document(run) for run in self.runs],
            "epochs": [_epoch_document(epoch) for epoch in self.epochs],
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
            return cls(**_DOCUMENT(document, ""))
        except InputError as error:
            raise InputError(f"{source}: is not a health state of ballscrew: {error}") from None


def _run_document(run: RunState) -> dict[str, Any]:
    return {
        "run": run.reading.run,
        "measured_at": run.reading.measured_at,
        "epoch": run.reading.epoch,
        "state": run.state,
        "stiffness_relative_to_baseline": quantity_json(run.stiffness),
        "relative_to_baseline": quantity_json(run.relative),
        "preload_below": run.preload_below,
        "relative_random": run.relative_random,
        "ramp": {"value": run.ramp, "limit": run.ramp_limit},
        "odds": {"value": run.odds, "limit": run.odds_limit},
        "reading": asdict(run.reading),
    }


def _statistic(row: Any, where: str) -> tuple[float, float]:
    """Value and limit: the limit is infinite while learning; a run that is not charted has neither."""
    numbers = _STATISTIC(row, where)
    if math.isnan(numbers["limit"]) and not math.isnan(numbers["value"]):
        return numbers["value"], math.inf
    return numbers["value"], numbers["limit"]


def _run_state(row: Any, where: str) -> RunState:
    values = _RUN(row, where)
    ramp, ramp_limit = values["ramp"]
    odds, odds_limit = values["odds"]
    return RunState(
        reading=values["reading"],
        state=values["state"],
        stiffness=values["stiffness_relative_to_baseline"],
        relative=values["relative_to_baseline"],
        ramp=ramp,
        ramp_limit=ramp_limit,
        odds=odds,
        odds_limit=odds_limit,
        relative_random=values["relative_random"],
    )


def _epoch_document(epoch: Epoch) -> dict[str, Any]:
    return asdict(epoch) | {"events": [event.to_json() for event in epoch.events]}


_STATE = json_fields.choice("learning", "normal", "watch", "alarm", "unloaded", "suspect")
_TEXT_OR_NULL, _PROBABILITY = json_fields.text(optional=True), json_fields.number(0.0, 1.0)
_STATISTIC = json_fields.record({"value": json_fields.number_or_nan, "limit": json_fields.number_or_nan})
_RUN = json_fields.record(
    {
        "reading": json_fields.instance(Reading, features=json_fields.mapping(json_fields.number_or_nan)),
        "state": _STATE,
        "stiffness_relative_to_baseline": json_fields.quantity(0.0),
        "relative_to_baseline": json_fields.quantity(0.0),
        "relative_random": json_fields.number_or_nan,
        "ramp": _statistic,
        "odds": _statistic,
    }
)
_EVENT: dict[str, json_fields.Field] = {
    "at": json_fields.text(),
    "kind": json_fields.text(),
    "text": json_fields.text(),
    "step": json_fields.number(),
    "step_uncertainty": json_fields.number(0.0),
}


def _event(row: Any, where: str) -> Event:
    return Event(**json_fields.fields(_EVENT, row, where, required=("at", "kind", "text")))


_EPOCH = json_fields.instance(Epoch, events=json_fields.listed(_event))
_STAGE = json_fields.instance(Stage, I=_PROBABILITY, II=_PROBABILITY)
_DOCUMENT = json_fields.record(
    {
        "axis": _TEXT_OR_NULL,
        "runs": json_fields.listed(_run_state),
        "epochs": json_fields.listed(_EPOCH),
        "state": _STATE,
        "alarm_at": _TEXT_OR_NULL,
        "stage": json_fields.optional(_STAGE),
        "causes": json_fields.listed(json_fields.instance(HistoryCause, probability=_PROBABILITY)),
        "scale_uncertainty": json_fields.number(0.0),
        "made": json_fields.instance(Made),
        "repeat_asked": json_fields.flag,
        "reasons": json_fields.listed(json_fields.text()),
        "nut_reasons": json_fields.listed(json_fields.text()),
        "notes": json_fields.listed(json_fields.text()),
    }
)
