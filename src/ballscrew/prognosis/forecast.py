"""A forecast: samples of the remaining life, and the quantiles of the preload ahead."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError
from ballscrew.prognosis.failure import Failure
from ballscrew.prognosis.preload_history import PreloadHistory

FAN = (0.025, 0.05, 0.1, 0.25, 0.5, 0.75, 0.9, 0.95, 0.975)
"""Probabilities of the quantiles of the preload ahead."""

_LEAST_BEGUN = 0.5  # probability of wear below which no end is forecast: it would be that of the prior
_LEAST_WITH_ALARM = 0.1  # the same during an alarm: fewer paths with wear than that are too few to forecast
_STEPS = 40
_REACH = 10.0  # reach over the length of the history
_LEAST_REACH, _MOST_REACH = 60.0, 7300.0  # days


@dataclass(frozen=True, eq=False)
class Forecast:
    """Forecast of a life model on a day.

    Parameters
    ----------
    at : float
        Day of the epoch.
    rul_days : ndarray, shape (m,)
        Equally probable remaining lives, ascending, days; infinite beyond the reach.
    reach : float
        Days ahead beyond which nothing is forecast: the history is too short for more.
    mode, end : str
        Failure mode, and when it is reached, in words.
    days : ndarray, shape (k,)
        Ahead, of the fan.
    ratio : ndarray, shape (k, len(FAN))
        Quantiles of P/P₀; NaN where there are none.
    method : str
        Name of the model.
    begun : float
        Probability that wear has begun, by these runs; NaN where the model does not estimate it.
    alarm : bool
        Whether an alarm stands, so that the end is that of an axis whose wear has begun.
    families : mapping
        Name of the family of wear to its weight; empty where the model is of one family.
    laws : mapping
        Name of the wear law to its probability; empty where the model has one law only.
    parameters : mapping
        Further estimates of the model, by name.
    """

    at: float
    rul_days: Array
    reach: float
    mode: str
    end: str
    days: Array
    ratio: Array
    method: str
    begun: float = math.nan
    alarm: bool = False
    families: Mapping[str, float] = field(default_factory=dict)
    laws: Mapping[str, float] = field(default_factory=dict)
    parameters: Mapping[str, float] = field(default_factory=dict)

    def quantile(self, probability: ArrayLike) -> Array:
        """Quantiles of the remaining life.

        Parameters
        ----------
        probability : array_like
            From 0 to 1.

        Returns
        -------
        ndarray
            Days; infinite where it lies beyond the reach.

        Raises
        ------
        InputError
            If a probability is out of range.
        """
        p = np.asarray(probability, dtype=np.float64)
        if not ((p >= 0) & (p <= 1)).all():
            raise InputError(f"a probability of {p.flat[0]:g} was given; it must be from 0 to 1.")
        return np.asarray(np.quantile(self.rul_days, p, method="inverted_cdf"))

    @property
    def shows_wear(self) -> bool:
        """False where wear has probably not begun, so that the runs do not show when life ends."""
        return math.isnan(self.begun) or self.begun >= least_begun(self.alarm)

    @property
    def has_median(self) -> bool:
        """True if the median lies within reach."""
        return bool(np.isfinite(self.quantile(0.5)))

    @property
    def text(self) -> str:
        """The forecast in one sentence."""
        low, middle, high = self.quantile([0.05, 0.5, 0.95]).tolist()
        if high == 0:
            return "None: the end has been reached."
        if not math.isfinite(low):
            return f"No end is in sight: the forecast reaches {self.reach:.0f} days."
        earliest = f"Not before {low:.0f} days with a probability of 95 %"
        if not math.isfinite(middle):
            return (
                f"{earliest}; the end is open, since there is too little wear to estimate it (the forecast "
                f"reaches {self.reach:.0f} days)."
            )
        if not math.isfinite(high):
            return f"{earliest}; {middle:.0f} days in the median; the latest end is open."
        return f"{earliest}; {middle:.0f} days in the median, {high:.0f} days at the latest (95 %)."


def least_begun(alarm: bool) -> float:
    """Probability of wear from which on an end is forecast.

    Parameters
    ----------
    alarm : bool
        Whether an alarm stands.

    Returns
    -------
    float
        One half; less during an alarm, whose evidence is the stronger one.
    """
    return _LEAST_WITH_ALARM if alarm else _LEAST_BEGUN


class LifeModel(Protocol):
    """Interface of every life model."""

    def forecast(self, history: PreloadHistory, failure: Failure, *, at: float | None = None) -> Forecast:
        """Remaining life as known at the end of a day, by default that of the last run."""
        ...


def reach_of(history: float) -> float:
    """Longest forecast from a history: ten times its length, two months at least.

    Parameters
    ----------
    history : float
        Days.

    Returns
    -------
    float
        Days; twenty years at most.
    """
    return min(max(_REACH * history, _LEAST_REACH), _MOST_REACH)


def fan_days(lives: Array, reach: float) -> Array:
    """Days ahead of a fan: past the end of most lives, and not beyond reach.

    Parameters
    ----------
    lives : ndarray, shape (m,)
        Remaining, ascending, days.
    reach : float
        Days.

    Returns
    -------
    ndarray, shape (41,)
        From 0 on.
    """
    late = float(np.quantile(lives, 0.95, method="inverted_cdf"))
    return np.linspace(0.0, min(max(1.2 * late, 1.0), reach), _STEPS + 1)
