"""The main question of every Monday: whether the axis is well, since when not, and how long it will last."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ballscrew.calibration.calibrated_axis import CalibratedAxis
from ballscrew.estimation.preload import preload
from ballscrew.modal.run import Run
from ballscrew.monitoring.detection.chart import Chart
from ballscrew.monitoring.detection.settings import MonitorSettings
from ballscrew.monitoring.epochs import Event
from ballscrew.monitoring.state import HealthState, RunState, health_state
from ballscrew.prognosis.course import Course, course
from ballscrew.prognosis.failure import Failure
from ballscrew.prognosis.forecast import LifeModel
from ballscrew.prognosis.particle_filter import ParticleFilter
from ballscrew.prognosis.result import Prognosis
from ballscrew.prognosis.statement import prognosis_of

__all__ = ["Monitored", "course_of", "end_of_life", "monitor"]

_FEWEST = 3  # good runs before anything is foretold
_LEAST = 1e-5  # of a level's standard uncertainty, as the chart has it
_LEAST_LEFT = 0.05  # of (P/P₀)^(1/3): below it nothing was measured
_OIL = 0.03  # of the friction from run to run, by oil and warmth: what the fits tell of it is much less
_LOOKED_AT = 150  # runs one by one: a forecast of seconds
_RESOLUTION = 3.0  # standard uncertainties of a backlash that can be seen


@dataclass(frozen=True, eq=False)
class Monitored:
    """An axis' state and its remaining life.

    Parameters
    ----------
    state : HealthState
        Baseline, alarm, stage, causes.
    prognosis : Prognosis or None
        None before there are three good runs in the newest epoch, and where its newest runs are stiffer than
        its baseline, which no law of wear makes.
    """

    state: HealthState
    prognosis: Prognosis | None

    def to_json(self) -> dict[str, Any]:
        """The document that ``monitor --json`` prints."""
        nothing: dict[str, Any] = {"quantiles": {}}
        told = None if self.prognosis is None else self.prognosis.to_json()
        return {
            **self.state.to_json(),
            "rul_days": nothing if told is None else told["rul_days"],
            "rul_travel_m": nothing if told is None else told["rul_travel_m"],
            "prognosis": told,
        }


def monitor(
    runs: Sequence[Run],
    model: CalibratedAxis,
    *,
    events: Sequence[Event] = (),
    settings: MonitorSettings | None = None,
    failure: Failure | None = None,
    largest_load: float | None = None,
    duty: float | None = None,
    life: LifeModel | None = None,
) -> Monitored:
    """Watch an axis over its runs.

    Parameters
    ----------
    runs : sequence of Run
        Of one axis, by one plan and method, each with its time; in any order.
    model : CalibratedAxis
        Of the axis, as ``calibrate`` made it.
    events : sequence of Event
        What was done to the axis, see :func:`~ballscrew.monitoring.epochs.read_events`.
    settings : MonitorSettings, optional
        How often a healthy axis may alarm, and what is believed beforehand.
    failure : Failure, optional
        What counts as the end of life; by default half of the preload.
    largest_load : float, optional
        Largest load of the duty, N: another end, where it lifts one flank of the nut.
    duty : float, optional
        Travel of a day, m: the remaining life is told in travel too.
    life : LifeModel, optional
        How the end is foretold; by default the particle filter over the laws of wear.

    Returns
    -------
    Monitored
        The same for the same runs in whatever order.

    Raises
    ------
    InputError
        If the runs do not belong together, one tells no time, or a number cannot be.

    Examples
    --------
    >>> import ballscrew  # doctest: +SKIP
    >>> runs = [ballscrew.Run.read(path) for path in sorted(folder.glob("*.json"))]  # doctest: +SKIP
    >>> told = ballscrew.monitor(runs, ballscrew.read_model("MODEL.json"))  # doctest: +SKIP
    >>> told.state.alarm_at, told.prognosis.rul_days[0.5]  # doctest: +SKIP
    """
    state = health_state(runs, model, events=events, settings=settings)
    history = course_of(state, model)
    end = end_of_life(state, runs, model, failure, largest_load)
    if history is None or state.stiffer:
        return Monitored(state, None)
    forecast = (life or ParticleFilter(most=_LOOKED_AT)).forecast(history, end)
    return Monitored(state, prognosis_of(forecast, history, duty=duty, made=state.made))


def course_of(state: HealthState, model: CalibratedAxis) -> Course | None:
    """The newest epoch as a life model sees it.

    Parameters
    ----------
    state : HealthState
        Of the axis.
    model : CalibratedAxis
        Of the axis.

    Returns
    -------
    Course or None
        Of its good runs, steps by grease or a remounted sensor taken out; None where they are too few.
    """
    newest, drawn = state.epochs[-1], state.charts[-1]
    good = [one for one in state.runs if one.reading.epoch == newest.number and _charted(one)]
    if drawn is None or len(good) < _FEWEST:
        return None
    of = [one.reading for one in good]
    warm = np.array([one.temperature for one in of])
    spread = np.array([one.backlash_uncertainty for one in of])
    rubbed = np.array([one.friction_uncertainty for one in of])
    seen, rubs = spread > 0, rubbed > 0
    friction = np.array([one.friction for one in of])
    axial = model.model
    return course(
        np.array([one.day for one in of]) - of[0].day,
        _without_steps(np.array([one.level for one in of]), drawn),
        np.maximum([one.random for one in of], _LEAST),
        temperature=warm - (warm[np.isfinite(warm)][0] if np.isfinite(warm).any() else 0.0),
        scale=state.scale_uncertainty,
        backlash=np.where(seen, [one.backlash for one in of], np.nan),
        backlash_uncertainty=np.where(seen, spread, np.nan),
        resolution=_RESOLUTION * float(np.median(spread[seen])) if seen.any() else 0.0,
        friction=np.where(rubs, friction, np.nan),
        friction_uncertainty=np.where(rubs, np.hypot(rubbed, _OIL * friction), np.nan),
        # Two flanks of F = κ δ^1.5: the nut's rigidity is 3 P / δ₀.
        pressed=3 * axial.preload * axial.share * axial.compliance,
    )


def end_of_life(
    state: HealthState,
    runs: Sequence[Run],
    model: CalibratedAxis,
    failure: Failure | None,
    largest_load: float | None,
) -> Failure:
    """What counts as the end; a largest load takes the preload of the newest epoch's reference.

    Parameters
    ----------
    state, runs, model, failure, largest_load
        As in :func:`monitor`.

    Returns
    -------
    Failure
        By default half of the preload.
    """
    end = failure or Failure()
    if largest_load is None:
        return end
    newest = state.epochs[-1].reference
    reference = next((run for run in runs if run.id == newest), None)
    told = None if reference is None else preload(reference, model).preload_N
    force = model.model.preload if told is None else told.value
    return Failure(end.preload_ratio, largest_load, force, end.backlash)


def _charted(one: RunState) -> bool:
    return one.reading.verdict == "good" and math.isfinite(one.reading.level)


def _without_steps(level: NDArray[np.float64], drawn: Chart) -> NDArray[np.float64]:
    """Levels without what known events made of them; the chart tells it of 1 − (P/P₀)^(1/3)."""
    of = drawn.design
    plain = 3 if of.warm else 1  # columns of the baseline, and of the temperature and its square
    stepped = of.columns[:, plain:] @ drawn.coefficients[plain:]
    return np.asarray(1 / np.maximum(1 / (1 + level) + stepped, _LEAST_LEFT) - 1)
