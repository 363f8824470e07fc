"""A forecast in words, in the manner of ISO 13381-1: mode, time to it, confidence, what it rests on."""

from __future__ import annotations

import math

import numpy as np

from ballscrew.axis.given import positive
from ballscrew.base.provenance import Made
from ballscrew.prognosis.course import Course
from ballscrew.prognosis.forecast import FAN, Forecast
from ballscrew.prognosis.result import QUANTILES, Fan, Prognosis

__all__ = ["prognosis_of"]

_BEGUN = 0.9  # from which on wear is said to have begun
_HARDLY = 0.5  # below which no end is told: what would be told is the prior
_SURE, _FAIR = 2.0, 5.0  # 95 % over 5 % quantile
_SOON = 7.0  # days: an end that is nearer is as good as known
_MANY = 0.1  # probability from which on a law is named, or that the end has been


def prognosis_of(
    forecast: Forecast,
    course: Course,
    *,
    duty: float | None = None,
    made: Made | None = None,
) -> Prognosis:
    """Say what a forecast means.

    Parameters
    ----------
    forecast : Forecast
        Of a life model.
    course : Course
        What it was made from.
    duty : float, optional
        Travel of a day, m, that goes on as it is.
    made : Made, optional
        How.

    Returns
    -------
    Prognosis
        Quantiles in days and travel, and sentences. Where wear has begun with a probability below one half,
        or the forecast does not fit the runs, all quantiles are open.

    Raises
    ------
    InputError
        If the duty is not above 0.
    """
    travel = None if duty is None else float(positive("travel of a day", duty, "m"))
    hardly = forecast.begun < _HARDLY
    days = {p: None if hardly else _open(float(forecast.quantile(p))) for p in QUANTILES}
    way = {} if travel is None else {p: None if d is None else d * travel for p, d in days.items()}
    return Prognosis(
        at_day=forecast.at,
        rul_days=days,
        rul_travel_m=way,
        failure_mode=forecast.mode,
        failure=forecast.end,
        reach_days=forecast.reach,
        begun=None if math.isnan(forecast.begun) else forecast.begun,
        laws=dict(forecast.laws),
        statement=_statement(forecast, days, travel),
        assumptions=_assumptions(forecast, course, travel),
        would_change=_changes(forecast, course),
        confidence=_confidence(forecast, days),
        fan=_fan(forecast),
        duty_m_per_day=travel,
        method=forecast.method,
        made=made or Made(),
    )


def _statement(forecast: Forecast, days: dict[float, float | None], travel: float | None) -> tuple[str, ...]:
    low, middle, high = days[0.05], days[0.5], days[0.95]
    first = f"Failure mode: {forecast.end}."
    if not forecast.fits:
        why = "a run whose time is wrong, or a repair that is not among the events, would do that"
        return (
            first,
            f"When that is cannot be told: no life that was tried fits the last runs; {why}.",
        )
    if not forecast.rul_days.any():
        return (first, "The axis has reached it.")
    if forecast.begun < _HARDLY:
        so_far = f"Wear has begun with a probability of {_part(forecast.begun)}"
        return (
            first,
            f"Time to it: open. {so_far}; as long as it has not, no run tells how fast it will be.",
        )
    said = [first, "Time to it: " + forecast.text[0].lower() + forecast.text[1:]]
    reached = float(np.mean(forecast.rul_days == 0))
    if reached >= _MANY:
        said.append(f"It has been reached already with a probability of {100 * reached:.0f} %.")
    if travel is not None and middle is not None and low is not None:
        upper = "an open number of" if high is None else f"{_km(high * travel)}"
        said.append(
            f"In travel, at {travel:g} m a day: {_km(middle * travel)} km, between {_km(low * travel)} and "
            f"{upper} km."
        )
    if not math.isnan(forecast.begun) and forecast.begun < _BEGUN:
        said.append(
            f"Wear has begun with a probability of {_part(forecast.begun)}. As long as it has not, "
            "no run tells how fast it will be: the shortest times are believed of such axes, not measured."
        )
    return tuple(said)


def _confidence(forecast: Forecast, days: dict[float, float | None]) -> str:
    if not forecast.fits:
        return "none: the forecast does not fit the runs"
    low, middle, high = days[0.05], days[0.5], days[0.95]
    if middle is None or low is None:
        return "none: too little wear is seen to tell an end"
    if high is None:
        return "low: the latest end is open"
    if high == 0:
        return "high: nine in ten such axes have reached their end"
    part = high / max(low, _SOON)
    words = "high" if part <= _SURE else "fair" if part <= _FAIR else "low"
    return f"{words}: nine in ten such axes end between {low:.0f} and {high:.0f} days"


def _assumptions(forecast: Forecast, course: Course, travel: float | None) -> tuple[str, ...]:
    duty = (
        "the duty goes on as it was" if travel is None else f"the duty goes on as it was, {travel:g} m a day"
    )
    count = len(course.until(forecast.at))
    runs = "one run" if count == 1 else f"{count} runs"
    said = [
        f"{duty}, with the same loads, grease and temperature",
        f"what the epoch's {runs} {_within(forecast.at - float(course.days[0]))} tell",
    ]
    if forecast.laws and forecast.begun < _BEGUN:
        said.append("the law of wear is not known, and no run tells it yet: all laws are averaged")
    elif forecast.laws:
        known = [f"{name} {100 * part:.0f} %" for name, part in forecast.laws.items() if part >= _MANY]
        said.append("the law of wear is not known; by the runs so far: " + ", ".join(known))
    else:
        said.append(f"the law of wear is that of the model: {forecast.method}")
    said.append(
        f"the nut's share of the compliance is known to {100 * course.scale:.0f} %, and the loss no better"
    )
    if not np.isfinite(course.temperature).any():
        said.append("temperatures are not known: a warm axis may look worn or new")
    return tuple(said)


def _changes(forecast: Forecast, course: Course) -> tuple[str, ...]:
    said = [
        "another duty, load or grease: say so, and the time in days is another, that in travel less so",
        "a bearing that has softened reads like wear, and would make the axis seem shorter-lived than it is",
        "maintenance of nut or bearing begins a new epoch, and this forecast ends",
    ]
    if forecast.known and not forecast.begun < _HARDLY:
        said.append("more runs: the interval narrows as wear goes on")
    else:
        said.append("wear that is seen: until then the end is open")
    if not np.isfinite(course.backlash).any():
        said.append("a measurement of backlash: none is known, and it would show a preload that is gone")
    return tuple(said)


def _fan(forecast: Forecast) -> Fan:
    if forecast.begun < _HARDLY or not np.isfinite(forecast.ratio).all():
        return Fan()
    return Fan(tuple(forecast.days.tolist()), FAN, tuple(tuple(line) for line in forecast.ratio.tolist()))


def _part(probability: float) -> str:
    return "less than 1 %" if probability < 0.01 else f"{100 * probability:.0f} %"


def _within(days: float) -> str:
    whole = round(days)
    return "within a day" if whole < 1 else "in one day" if whole == 1 else f"in {whole} days"


def _open(days: float) -> float | None:
    return days if math.isfinite(days) else None


def _km(metres: float) -> str:
    return f"{metres / 1000:.3g}"
