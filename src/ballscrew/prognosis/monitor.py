"""Health state and remaining life of an axis from its runs: the main function of the package."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ballscrew.base.arrays import Array
from ballscrew.base.result import PlottedResult, first_sentences, with_interval
from ballscrew.base.threads import single_threaded
from ballscrew.calibration.calibrated_axis import CalibratedAxis
from ballscrew.calibration.modelfile import model_of
from ballscrew.estimation.preload import preload
from ballscrew.modal.run import Run
from ballscrew.monitoring.checkpoint import Checkpoint, make_checkpoint
from ballscrew.monitoring.detection.chart import Chart
from ballscrew.monitoring.detection.settings import MonitorSettings
from ballscrew.monitoring.epochs import Event, moment, read_events
from ballscrew.monitoring.health import health_of
from ballscrew.monitoring.history import read_history
from ballscrew.monitoring.reading import Reading
from ballscrew.monitoring.state import HealthState
from ballscrew.prognosis.duty import DutyRecord, EpochDuty
from ballscrew.prognosis.failure import Failure
from ballscrew.prognosis.family_average import FamilyAverage
from ballscrew.prognosis.forecast import LifeModel
from ballscrew.prognosis.preload_history import PreloadHistory, preload_history
from ballscrew.prognosis.result import Prognosis
from ballscrew.prognosis.statement import prognosis_of

if TYPE_CHECKING:
    import pandas as pd

_FEWEST = 3  # good runs before a forecast
_LEAST_UNCERTAINTY = 1e-5  # of a level, as in the chart
_LEAST_ROOT = 0.05  # of (P/P₀)^(1/3): less is no measurement
_OIL = 0.03  # relative scatter of the friction by oil and temperature; the fits' own uncertainty is much less
_RESOLUTION = 3.0  # standard uncertainties of the least observable backlash


@dataclass(frozen=True, eq=False, repr=False)
class Monitored(PlottedResult):
    """Health state of an axis and its remaining life.

    Parameters
    ----------
    state : HealthState
        Baseline, alarm, stage, causes.
    prognosis : Prognosis or None
        None before there are three good runs in the newest epoch, and where its newest runs are stiffer than
        its baseline, which no law of wear explains.
    checkpoint : Checkpoint or None
        Estimates from the runs, from which the next one can be assessed; not part of the JSON.
    """

    state: HealthState
    prognosis: Prognosis | None
    checkpoint: Checkpoint | None = None

    _drawing = "monitor_figure:draw_history"

    def _lines(self) -> list[str]:
        state = self.state
        lines = [f"{_title(state)}; stiffness {state.verdict}, preload of the nut {state.nut_verdict}"]
        if state.assessed is not None and state.assessed.stiffness is not None:
            lines.append(f"axial stiffness as P/P₀: {with_interval(state.assessed.stiffness)}")
        if state.why_unassessed:
            lines.append(f"not assessed as of the newest run: {state.why_unassessed}")
        if self.prognosis is not None:
            lines += self.prognosis.statement[:2]
        return lines + first_sentences(state.nut_reasons or state.reasons)

    @property
    def forecast_at(self) -> datetime | None:
        """Time from which on the forecast is made; None without one."""
        if self.prognosis is None:
            return None
        newest = self.state.epochs[-1].number
        for run in self.state.runs:
            if run.reading.epoch == newest and run.stiffness is not None:
                first = moment(run.reading.measured_at, "a run")
                return first + timedelta(days=self.prognosis.at_day)
        return moment(self.state.runs[-1].reading.measured_at, "a run")

    def to_dataframe(self) -> pd.DataFrame:
        """Table of the runs: state, and P/P₀ of stiffness and nut with their 95 % intervals."""
        import pandas as pd

        rows = []
        for run in self.state.runs:
            row: dict[str, Any] = {"measured_at": run.reading.measured_at, "state": run.state}
            for name, quantity in (("stiffness", run.stiffness), ("nut", run.relative)):
                low, high = (None, None) if quantity is None else quantity.interval
                row[name] = None if quantity is None else quantity.value
                row[f"{name}_low95"], row[f"{name}_high95"] = low, high
            rows.append(row)
        return pd.DataFrame(rows)

    def to_json(self) -> dict[str, Any]:
        """Document that ``monitor --json`` prints."""
        document = self.state.to_json()
        if self.prognosis is None:
            document.update(rul_days={"quantiles": {}}, rul_travel_m={"quantiles": {}}, prognosis=None)
            document.update(rul_revolutions={"quantiles": {}}, rul_hours={"quantiles": {}})
            return document
        prognosis = self.prognosis.to_json()
        for name in ("rul_days", "rul_travel_m", "rul_revolutions", "rul_hours"):
            document[name] = prognosis[name]
        document["prognosis"] = prognosis
        return document


@single_threaded
def monitor(
    runs: Run | str | Path | Iterable[Run | str | Path],
    model: CalibratedAxis | str | Path,
    *,
    events: Sequence[Event] | str | Path = (),
    settings: MonitorSettings | None = None,
    failure: Failure | None = None,
    largest_load: float | None = None,
    duty: float | DutyRecord | None = None,
    life: LifeModel | None = None,
    accept: Sequence[str] = (),
    checkpoint: Checkpoint | None = None,
) -> Monitored:
    """Health state and remaining life of an axis from its runs.

    Parameters
    ----------
    runs : Run or path-like, or iterable of these
        Runs of one axis by one plan and method, each with its time; in any order.
    model : CalibratedAxis or path-like
        Calibrated model of the axis, see :func:`ballscrew.calibrate`.
    events : sequence of Event or path-like
        Events on the axis, or their file, see :func:`~ballscrew.monitoring.epochs.read_events`.
    settings : MonitorSettings, optional
        Rate of false alarms, and priors of the detection.
    failure : Failure, optional
        End of life; by default half of the preload.
    largest_load : float, optional
        Largest load of the duty, N: life also ends where it unloads one flank of the nut.
    duty : float or DutyRecord, optional
        Travel of a day, m: the remaining life is given in travel too. Or the counters of the machine
        (:func:`ballscrew.read_duty`): it is given in revolutions and hours too, and laws of wear by these are
        part of the average.
    life : LifeModel, optional
        Life model; by default the average over families of wear.
    accept : sequence of str
        Names of reasons to doubt the calibration that were checked and are accepted; by the others the result
        is suspect.
    checkpoint : Checkpoint, optional
        Estimates from earlier runs, :attr:`Monitored.checkpoint`: only the runs after it need to be given,
        and those before it are not assessed again. ``events`` are still all events. For a late or corrected
        run or event, see :func:`~ballscrew.monitoring.checkpoint.checkpoint_before`.

    Returns
    -------
    Monitored
        It does not depend on the order of the runs. From a checkpoint it is, to the last bit on one machine,
        what all runs together give.

    Raises
    ------
    InputError
        If the runs are not of one axis and method, one has no time, a number is out of range, an accepted
        reason is none of the model's, the duty does not cover the runs, a run is not later than the
        checkpoint, or the checkpoint was made with another model, settings or past events.

    Examples
    --------
    >>> import ballscrew  # doctest: +SKIP
    >>> runs = [ballscrew.Run.read(path) for path in sorted(folder.glob("*.json"))]  # doctest: +SKIP
    >>> result = ballscrew.monitor(runs, ballscrew.read_model("MODEL.json"))  # doctest: +SKIP
    >>> result.state.alarm_at, result.prognosis.rul_days[0.5]  # doctest: +SKIP
    """
    settings, model = settings or MonitorSettings(), model_of(model)
    model.check_accepted(accept)
    known_events = read_events(events) if isinstance(events, str | Path) else events
    known = None
    if checkpoint is not None:
        checkpoint.check(model, settings, known_events)
        known = checkpoint.history
    past = read_history(_listed(runs), model, known_events, settings, known)
    state = health_of(past, model, known_events, settings, accept)
    after = make_checkpoint(past, model, settings, known_events)
    history = epoch_history(state, model)
    end = end_of_life(past.epochs[-1].reference, model, failure, largest_load)
    if history is None or state.stiffer:
        return Monitored(state, None, after)
    counters: dict[str, EpochDuty] = {}
    travel = None
    if isinstance(duty, DutyRecord):
        readings = _good_readings(state)
        first, last = (moment(each.measured_at, "a run's time") for each in (readings[0], readings[-1]))
        counters = duty.of_epoch(first, last)
    else:
        travel = duty
    forecast = (life or _family_average(counters, state)).forecast(history, end)
    prognosis = prognosis_of(forecast, history, duty=travel, counters=counters, made=state.made)
    return Monitored(state, prognosis, after)


def _listed(runs: Run | str | Path | Iterable[Run | str | Path]) -> list[Run]:
    """Runs that were given as such or as files."""
    if isinstance(runs, Run | str | Path):
        return [Run.of(runs)]
    return [Run.of(run) for run in runs]


def _title(state: HealthState) -> str:
    """Axis and state, and whether it is that of an earlier run."""
    title = f"{state.axis or 'axis without a name'}: {state.state}"
    if state.runs[-1].state == "suspect":
        return f"{title} before the newest run, which was set aside"
    if state.state == "alarm" and state.alarm_at:
        return f"{title} since {state.alarm_at}"
    return title


def _family_average(counters: Mapping[str, EpochDuty], state: HealthState) -> FamilyAverage:
    """Average with the laws of wear by the counters; during an alarm, of axes whose wear has begun."""
    duties = {name: counter.average_days for name, counter in counters.items()}
    return FamilyAverage(
        travel=duties.get("revolutions"), hours=duties.get("hours"), alarm=state.state == "alarm"
    )


def _good_readings(state: HealthState) -> list[Reading]:
    """Good readings of the newest epoch."""
    readings = (run.reading for run in state.runs)
    newest = state.epochs[-1].number
    return [
        reading
        for reading in readings
        if reading.epoch == newest and reading.verdict == "good" and math.isfinite(reading.level)
    ]


def epoch_history(state: HealthState, model: CalibratedAxis) -> PreloadHistory | None:
    """History of the newest epoch for a life model.

    Parameters
    ----------
    state : HealthState
        Health state of the axis.
    model : CalibratedAxis
        The axis.

    Returns
    -------
    PreloadHistory or None
        Good runs of the epoch, without the steps by grease or a remounted sensor; None if they are too few.
    """
    chart, readings = state.charts[-1], _good_readings(state)
    if chart is None or len(readings) < _FEWEST:
        return None
    level = _column(readings, "level")
    temperature = _column(readings, "temperature")
    known = temperature[np.isfinite(temperature)]
    if len(known):
        temperature = temperature - known[0]
    backlash, backlash_uncertainty = _observed(readings, "backlash")
    observed = backlash_uncertainty[np.isfinite(backlash_uncertainty)]
    resolution = 0.0
    if len(observed):
        resolution = _RESOLUTION * float(np.median(observed))
    friction, friction_uncertainty = _observed(readings, "friction")
    axial = model.model
    return preload_history(
        _column(readings, "day") - readings[0].day,
        _without_steps(level, chart),
        np.maximum(_column(readings, "random"), _LEAST_UNCERTAINTY),
        temperature=temperature,
        scale=state.scale_uncertainty,
        backlash=backlash,
        backlash_uncertainty=backlash_uncertainty,
        resolution=resolution,
        friction=friction,
        friction_uncertainty=np.hypot(friction_uncertainty, _OIL * friction),
        # Two flanks of F = κ δ^1.5: the nut's rigidity is 3 P / δ₀.
        approach=3 * axial.preload * axial.share * axial.compliance,
    )


def _column(readings: Sequence[Reading], name: str) -> Array:
    return np.array([getattr(reading, name) for reading in readings])


def _observed(readings: Sequence[Reading], name: str) -> tuple[Array, Array]:
    """Values and standard uncertainties of a quantity; NaN where a run has none."""
    values, uncertainty = _column(readings, name), _column(readings, f"{name}_uncertainty")
    known = uncertainty > 0
    return np.where(known, values, np.nan), np.where(known, uncertainty, np.nan)


def _without_steps(level: Array, chart: Chart) -> Array:
    """Levels without the steps by known events, which the chart estimates of 1 − (P/P₀)^(1/3)."""
    steps = chart.design.step_columns
    stepped = chart.design.columns[:, steps] @ chart.coefficients[steps]
    return np.asarray(1 / np.maximum(1 / (1 + level) + stepped, _LEAST_ROOT) - 1)


def end_of_life(
    reference: Run | None, model: CalibratedAxis, failure: Failure | None, largest_load: float | None
) -> Failure:
    """End of life; a largest load takes the preload of the newest epoch's reference.

    Parameters
    ----------
    reference : Run or None
        That run; None where there is none.
    model, failure, largest_load
        As in :func:`monitor`.

    Returns
    -------
    Failure
        By default half of the preload.
    """
    end = failure or Failure()
    if largest_load is None:
        return end
    force = model.model.preload
    if reference is not None:
        estimate = preload(reference, model).preload_N
        if estimate is not None:
            force = estimate.value
    return Failure(end.preload_ratio, largest_load, force, end.backlash)
