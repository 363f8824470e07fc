"""A forecast in words, in the manner of ISO 13381-1: failure mode, time to it, confidence, assumptions."""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

from ballscrew.axis.given import positive
from ballscrew.base.provenance import Made
from ballscrew.prognosis.duty import EpochDuty
from ballscrew.prognosis.forecast import FAN, Forecast
from ballscrew.prognosis.preload_history import PreloadHistory
from ballscrew.prognosis.result import QUANTILES, Fan, Prognosis

_BEGUN = 0.9  # probability from which on wear is taken to have begun
_HIGH, _FAIR = 2.0, 5.0  # largest ratio of the 95 % to the 5 % quantile for high and fair confidence
_SOON = 7.0  # days: a nearer end counts as this in that ratio
_NOTABLE = 0.1  # probability from which on a law is named, or that the end has been reached


def prognosis_of(
    forecast: Forecast,
    history: PreloadHistory,
    *,
    duty: float | None = None,
    counters: Mapping[str, EpochDuty] = MappingProxyType({}),
    made: Made | None = None,
) -> Prognosis:
    """Prognosis with quantiles and sentences from a forecast.

    Parameters
    ----------
    forecast : Forecast
        Forecast of a life model.
    history : PreloadHistory
        The runs from which it was made.
    duty : float, optional
        Travel of a day, m, which continues.
    counters : mapping of str to EpochDuty, optional
        Duty by its counters, see :class:`~ballscrew.prognosis.duty.DutyRecord`.
    made : Made, optional
        Provenance.

    Returns
    -------
    Prognosis
        Quantiles in days and by the duty, and sentences. Where wear has probably not begun, all
        quantiles are open.

    Raises
    ------
    InputError
        If the duty is not above 0.
    """
    travel = None
    if duty is not None:
        travel = float(positive("travel of a day", duty, "m"))
    begun = None
    if not math.isnan(forecast.begun):
        begun = forecast.begun
    days, travel_quantiles = _quantiles(forecast, travel)
    by_counter = {name: _by_counter(days, forecast.at, counter) for name, counter in counters.items()}
    return Prognosis(
        at_day=forecast.at,
        rul_days=days,
        rul_travel_m=travel_quantiles,
        failure_mode=forecast.mode,
        failure=forecast.end,
        reach_days=forecast.reach,
        begun=begun,
        families=dict(forecast.families),
        laws=dict(forecast.laws),
        statement=_statement(forecast, days, travel, by_counter),
        assumptions=_assumptions(forecast, history, travel, counters),
        would_change=_would_change(forecast, history),
        confidence=_confidence(days),
        fan=_fan(forecast),
        duty_m_per_day=travel,
        method=forecast.method,
        rul_revolutions=by_counter.get("revolutions", {}),
        rul_hours=by_counter.get("hours", {}),
        duty_per_day={name: counter.ahead_per_day for name, counter in counters.items()},
        made=made or Made(),
    )


def _quantiles(
    forecast: Forecast, travel: float | None
) -> tuple[dict[float, float | None], dict[float, float | None]]:
    """Quantiles of the remaining days and travel by probability; None where the end is open."""
    days: dict[float, float | None] = dict.fromkeys(QUANTILES)
    if forecast.shows_wear:
        for p in QUANTILES:
            quantile = float(forecast.quantile(p))
            if math.isfinite(quantile):
                days[p] = quantile
    travel_quantiles: dict[float, float | None] = {}
    if travel is not None:
        travel_quantiles = dict.fromkeys(QUANTILES)
        travel_quantiles.update((p, d * travel) for p, d in days.items() if d is not None)
    return days, travel_quantiles


def _by_counter(days: dict[float, float | None], at: float, counter: EpochDuty) -> dict[float, float | None]:
    """Quantiles in a counter of the machine: as many as the days, since it never falls."""
    quantiles: dict[float, float | None] = {}
    for p, ahead in days.items():
        quantiles[p] = None if ahead is None else counter.remaining(at, ahead)
    return quantiles


def _statement(
    forecast: Forecast,
    days: dict[float, float | None],
    travel: float | None,
    by_counter: Mapping[str, dict[float, float | None]],
) -> tuple[str, ...]:
    mode = f"Failure mode: {forecast.end}."
    if not forecast.rul_days.any():
        return (mode, "The axis has reached it.")
    if not forecast.shows_wear:
        return (mode, f"Time to failure: open. {_why_open(forecast)}")
    sentences = [mode, "Time to failure: " + forecast.text[0].lower() + forecast.text[1:]]
    reached = float(np.mean(forecast.rul_days == 0))
    if reached >= _NOTABLE:
        sentences.append(f"It has been reached already with a probability of {100 * reached:.0f} %.")
    if travel is not None:
        sentences += _travel(days, travel)
    for name, quantiles in by_counter.items():
        sentences += _in_counter(name, quantiles)
    if forecast.families:
        sentences.append(_followed(forecast))
    if forecast.begun < _BEGUN:
        sentences.append(_little_wear(forecast))
    return tuple(sentences)


def _why_open(forecast: Forecast) -> str:
    """Why no end is forecast."""
    begun = f"wear has begun with a probability of {_percent(forecast.begun)}"
    if forecast.alarm:
        return f"The alarm still stands, but over all runs {begun}: they do not show its rate."
    return f"{begun[0].upper()}{begun[1:]}; until it has, the runs do not show how fast it will be."


def _little_wear(forecast: Forecast) -> str:
    """Sentence on a forecast that typical axes determine rather than these runs."""
    typical = "the shortest times are of typical axes, not of these runs"
    if forecast.alarm:
        return f"The forecast is that of an axis whose wear has begun, as the alarm states; {typical}."
    begun = f"Wear has begun with a probability of {_percent(forecast.begun)}"
    return f"{begun}. Until it has, the runs do not show how fast it will be: {typical}."


def _followed(forecast: Forecast) -> str:
    """Families that the forecast follows, the first with its weight."""
    ranked = sorted(forecast.families.items(), key=lambda item: -item[1])
    named = [f"{name} {100 * weight:.0f} %" for name, weight in ranked if weight >= _NOTABLE]
    return "Wear families, weighted by past forecasts: " + ", ".join(named) + "."


def _travel(days: dict[float, float | None], travel: float) -> list[str]:
    low, middle, high = days[0.05], days[0.5], days[0.95]
    if middle is None or low is None:
        return []
    earliest = f"In travel, at {travel:g} m a day: not before {_km(low * travel)} km"
    if high is None:
        return [f"{earliest}, {_km(middle * travel)} km in the median; the latest end is open."]
    return [f"{earliest}, {_km(middle * travel)} km in the median, {_km(high * travel)} km at the latest."]


def _in_counter(name: str, quantiles: Mapping[float, float | None]) -> list[str]:
    low, middle, high = quantiles[0.05], quantiles[0.5], quantiles[0.95]
    if middle is None or low is None:
        return []
    where = "revolutions of the screw" if name == "revolutions" else "hours of operation"
    earliest = f"In {where}: not before {_count(low)}, {_count(middle)} in the median"
    if high is None:
        return [f"{earliest}; the latest end is open."]
    return [f"{earliest}, {_count(high)} at the latest."]


def _count(value: float) -> str:
    """Number with three digits, and without an exponent."""
    digits = 3 - len(f"{value:.0f}")
    return f"{round(value, digits):,.0f}".replace(",", " ")


def _confidence(days: dict[float, float | None]) -> str:
    low, middle, high = days[0.05], days[0.5], days[0.95]
    if middle is None or low is None:
        return "none: too little wear to estimate an end"
    if high is None:
        return "low: the latest end is open"
    if high == 0:
        return "high: nine in ten such axes have reached their end"
    ratio = high / max(low, _SOON)
    confidence = "low"
    if ratio <= _HIGH:
        confidence = "high"
    elif ratio <= _FAIR:
        confidence = "fair"
    return f"{confidence}: nine in ten such axes end between {low:.0f} and {high:.0f} days"


def _assumptions(
    forecast: Forecast, history: PreloadHistory, travel: float | None, counters: Mapping[str, EpochDuty]
) -> tuple[str, ...]:
    count = len(history.until(forecast.at))
    duty = "the duty continues as before"
    if travel is not None:
        duty += f", {travel:g} m a day"
    if counters:
        rates = (f"{counter.ahead_per_day:.3g} {name}" for name, counter in counters.items())
        duty = f"the duty continues as in its file, then with {' and '.join(rates)} a day"
    runs = f"{count} runs"
    if count == 1:
        runs = "one run"
    sentences = [
        f"{duty}, with the same loads, grease and temperature",
        f"only the epoch's {runs} {_within(forecast.at - float(history.days[0]))} are used",
        "preload is from the axial stiffness: bearing wear counts as nut wear",
        _law(forecast),
        f"the nut's share of the compliance is known to {100 * history.scale:.0f} %, and the loss no better",
    ]
    if not np.isfinite(history.temperature).any():
        sentences.append("temperatures are not known: a warm axis may look worn or new")
    return tuple(sentences)


def _law(forecast: Forecast) -> str:
    if not forecast.laws:
        return f"the law of wear is that of the model: {forecast.method}"
    if forecast.begun < _BEGUN:
        return "the law of wear is not known, and no run shows it yet: all laws are averaged"
    notable = []
    for name, probability in forecast.laws.items():
        if probability >= _NOTABLE:
            notable.append(f"{name} {100 * probability:.0f} %")
    return "the law of wear is not known; by the runs so far: " + ", ".join(notable)


def _would_change(forecast: Forecast, history: PreloadHistory) -> tuple[str, ...]:
    sentences = [
        "another duty, load or grease: it changes the time in days, and to a lesser extent that in travel",
        "a bearing that has softened looks like wear, and would make the axis seem shorter-lived than it is",
        "maintenance of nut or bearing begins a new epoch and ends this forecast",
    ]
    if forecast.has_median and forecast.shows_wear:
        sentences.append("more runs: the interval narrows as wear goes on")
    else:
        sentences.append("measurable wear: until then the end is open")
    if not np.isfinite(history.backlash).any():
        sentences.append(
            "a measurement of backlash: there is none, and it would show that the preload is gone"
        )
    return tuple(sentences)


def _fan(forecast: Forecast) -> Fan:
    if not forecast.shows_wear or not np.isfinite(forecast.ratio).all():
        return Fan()
    rows = map(tuple, forecast.ratio.tolist())
    return Fan(tuple(forecast.days.tolist()), FAN, tuple(rows))


def _percent(probability: float) -> str:
    if probability < 0.01:
        return "less than 1 %"
    return f"{100 * probability:.0f} %"


def _within(days: float) -> str:
    whole = round(days)
    if whole < 1:
        return "within a day"
    if whole == 1:
        return "in one day"
    return f"in {whole} days"


def _km(metres: float) -> str:
    return f"{metres / 1000:.3g}"
