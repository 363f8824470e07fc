"""The health of an axis from its runs: baseline, chart, stage, and what else may have done it.

The same runs and events give the same state in whatever order they come, and a later run changes no earlier
state once the first three good runs of an epoch have chosen its reference. What is told relative to the
baseline uses the baseline as it is known at the end.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from ballscrew.base.provenance import Made
from ballscrew.base.quantity import NORMAL_95, Quantity
from ballscrew.calibration.calibrated_axis import CalibratedAxis
from ballscrew.estimation.samples import share_uncertainty
from ballscrew.modal.run import Run
from ballscrew.monitoring.detection.chart import Chart, chart
from ballscrew.monitoring.detection.design import Step
from ballscrew.monitoring.detection.repeat import SAME_DAY, repeat_asked
from ballscrew.monitoring.detection.settings import MonitorSettings
from ballscrew.monitoring.epochs import STEPS, Epoch, Event, moment
from ballscrew.monitoring.history import History, read_history
from ballscrew.monitoring.history_causes import HistoryCause, history_causes
from ballscrew.monitoring.judged import Judged
from ballscrew.monitoring.reading import Reading
from ballscrew.monitoring.stage import Stage, stage

__all__ = ["HealthState", "RunState", "health_state", "relative_preload"]

_LEAST_U = 0.2  # P/P₀ of 125: nothing was measured


@dataclass(frozen=True, slots=True, eq=False)
class RunState:
    """One run in its history.

    Parameters
    ----------
    reading : Reading
        What it told.
    state : str
        learning, normal, watch, alarm or suspect.
    relative : Quantity or None
        P/P₀ against the epoch's baseline at the reference's temperature.
    ramp, ramp_limit, odds, odds_limit : float
        The two statistics and their limits of alarm; nan for a run that is not charted, infinite limits
        while it learns.
    relative_random : float
        Part of the standard uncertainty that another run would draw anew.
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
    """The health of an axis.

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
        Of the newest good run under watch or alarm; None while it learns, is normal or is stiffer than its
        baseline, where no preload is being lost.
    causes : tuple of HistoryCause
        What may have made the change; empty where nothing has changed.
    scale_uncertainty : float
        Relative standard deviation of all levels together, from the nut's share of the compliance.
    made : Made
        Version, settings, inputs.
    repeat_asked : bool
        Whether the newest run is to be made again on the same day: one run cannot tell an odd run from wear.
    notes : tuple of str
        What else must be known, a sentence each.
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
        drawn = self.charts[-1] if self.charts else None
        return _stiffer(drawn)

    def to_json(self) -> dict[str, Any]:
        """What ``monitor --json`` prints of the state."""
        from ballscrew.monitoring.statefile import state_to_json

        return state_to_json(self)

    @classmethod
    def from_json(cls, document: Mapping[str, Any], source: str = "MONITOR.json") -> HealthState:
        """Read it back, see :func:`ballscrew.monitoring.statefile.state_from_json`."""
        from ballscrew.monitoring.statefile import state_from_json

        return state_from_json(document, source)


def health_state(
    runs: Sequence[Run],
    model: CalibratedAxis,
    *,
    events: Sequence[Event] = (),
    settings: MonitorSettings | None = None,
) -> HealthState:
    """Tell the health of an axis from its runs.

    Parameters
    ----------
    runs : sequence of Run
        Of one axis by one method and plan, in any order; each tells its time.
    model : CalibratedAxis
        Of the axis.
    events : sequence of Event
        What was done to it, see :func:`ballscrew.monitoring.epochs.read_events`.
    settings : MonitorSettings, optional
        The rate of false alarms above all.

    Returns
    -------
    HealthState
        The same for the same runs in whatever order.

    Raises
    ------
    InputError
        If there is no run, or they do not belong together.
    """
    kept = settings or MonitorSettings()
    history = read_history(runs, model, events, kept)
    scale = share_uncertainty(model, kept.assumptions)
    found: dict[str, RunState] = {}
    epochs, charts = [], []
    for epoch in history.epochs:
        inside = [one for one in history.runs if one.reading.epoch == epoch.number]
        good = [one for one in inside if one.reading.verdict == "good"]
        drawn = None if not good else _chart(good, epoch, history, kept)
        states = {} if drawn is None else _states(good, drawn, scale)
        found |= {one.run.id: states.get(one.run.id, RunState(one.reading, "suspect")) for one in inside}
        epochs.append(replace(epoch, alarm_at=_alarm_at(tuple(states.values()))))
        charts.append(drawn)
    ordered = tuple(found[one.run.id] for one in history.runs)
    newest, drawn = epochs[-1], charts[-1]
    good = [
        one for one in history.runs if one.reading.epoch == newest.number and one.reading.verdict == "good"
    ]
    last = found[good[-1].run.id] if good else None
    causes: tuple[HistoryCause, ...] = ()
    reference = history.references[-1]
    if last is not None and drawn is not None and reference is not None and last.state in ("watch", "alarm"):
        causes = history_causes(good, reference, drawn, model, kept)
    told = None
    losing = last is not None and last.state in ("watch", "alarm") and not _stiffer(drawn)
    if losing and last is not None and drawn is not None:
        readings = [one.reading for one in good]
        since = [one.reading for one in history.runs if one.reading.day > readings[-1].day]
        told = stage(last.relative, readings, [readings[i] for i in drawn.baseline], since)
    return HealthState(
        axis=model.axis or runs[0].axis,
        runs=ordered,
        epochs=tuple(epochs),
        state="learning" if last is None else last.state,
        alarm_at=newest.alarm_at,
        stage=told,
        causes=causes,
        scale_uncertainty=scale,
        made=Made(
            settings=asdict(kept),
            inputs={f"run {i + 1}": one.reading.run for i, one in enumerate(ordered)},
        ),
        repeat_asked=(
            last is not None
            and drawn is not None
            and ordered[-1].reading.day - last.reading.day < SAME_DAY  # what came since was no good run
            and repeat_asked(drawn)
        ),
        notes=_notes(newest, history, drawn),
        charts=tuple(charts),
    )


def _alarm_at(states: Sequence[RunState]) -> str | None:
    begun = [
        one.reading.measured_at
        for before, one in zip((None, *states), states, strict=False)
        if one.state == "alarm" and (before is None or before.state != "alarm")
    ]
    return begun[-1] if begun else None


def _stiffer(drawn: Chart | None) -> bool:
    return drawn is not None and len(drawn.stiffer) > 0 and bool(drawn.stiffer[-1])


def _notes(newest: Epoch, history: History, drawn: Chart | None) -> tuple[str, ...]:
    last = max(moment(one.run.measured_at, "a run: measured_at") for one in history.runs)
    notes = [
        f"{event.kind} at {event.at} is later than the newest run: it counts once a run follows."
        for event in newest.events
        if event.kind != "note" and event.when > last
    ]
    if _stiffer(drawn):
        notes.append(
            "The newest runs are stiffer than the baseline, which wear does not do: was something done to "
            "the axis? Tell it in EVENTS.toml."
        )
    return tuple(notes)


def _chart(good: Sequence[Judged], epoch: Epoch, history: History, settings: MonitorSettings) -> Chart:
    sizes = {"greased": settings.greased, "sensor remounted": settings.remounted}
    steps = [
        Step((event.when - history.begin).total_seconds() / 86400.0, sizes[event.kind])
        for event in epoch.events
        if event.kind in STEPS
    ]
    days, level, told, warm = (
        np.array([getattr(one.reading, name) for one in good])
        for name in ("day", "level", "random", "temperature")
    )
    return chart(days, level, told, warm, steps, settings)


def _states(good: Sequence[Judged], drawn: Chart, scale: float) -> dict[str, RunState]:
    found = {}
    for k, one in enumerate(good):
        relative, random = relative_preload(drawn, k, one.reading.level, scale, one.reading.systematic)
        found[one.run.id] = RunState(
            one.reading,
            drawn.states[k],
            relative,
            float(drawn.ramp[k]),
            float(drawn.limits.ramp[k]),
            float(drawn.odds[k]),
            float(drawn.limits.odds[k]),
            random,
        )
    return found


def relative_preload(
    drawn: Chart, k: int, level: float, scale: float, systematic: float
) -> tuple[Quantity | None, float]:
    """P/P₀ of a run against its epoch's baseline, temperature and steps taken out.

    Parameters
    ----------
    drawn : Chart
        Of the epoch.
    k : int
        Which of its runs.
    level : float
        As read.
    scale : float
        Relative standard deviation of the change, from the nut's share.
    systematic : float
        Standard uncertainty of the level that does not pass from run to run.

    Returns
    -------
    Quantity or None
        None where the level lies beyond what any nut can be.
    float
        Random part of its standard uncertainty: of the run and of what the baseline taught.
    """
    of = drawn.design
    x, u = of.columns[k], 1 + level
    if not u > _LEAST_U:
        return None, math.nan
    part = (1 / u + float(x[1:] @ drawn.coefficients[1:])) / (1 - float(drawn.coefficients[0]))
    noise = (float(drawn.scale[-1]) * of.told[k]) ** 2 + of.loose[k] ** 2
    random = math.sqrt(noise + float(x @ drawn.covariance @ x))
    by_share = scale * part * abs(1 - part)
    whole = math.sqrt(random**2 + by_share**2 + (systematic / u**2) ** 2)
    low, high = (max(part + sign * NORMAL_95 * whole, 0.0) ** 3 for sign in (-1, 1))
    if not part > 0:
        return None, math.nan
    return Quantity(part**3, 3 * part**2 * whole, "", (low, high)), 3 * part**2 * random
