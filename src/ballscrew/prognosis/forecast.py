"""A forecast: samples of the remaining life, the fan of the preload, and what is behind them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError
from ballscrew.prognosis.course import Course
from ballscrew.prognosis.failure import Failure

__all__ = ["FAN", "Forecast", "LifeModel", "ahead", "reach_of"]

FAN = (0.025, 0.05, 0.1, 0.25, 0.5, 0.75, 0.9, 0.95, 0.975)
_STEPS = 40
_REACH, _LEAST, _MOST = 10.0, 60.0, 7300.0  # times the history; days


@dataclass(frozen=True, eq=False)
class Forecast:
    """What a life model says on a day.

    Parameters
    ----------
    at : float
        Day of the epoch.
    rul_days : ndarray, shape (m,)
        Equally probable remaining lives, ascending, days; infinite beyond the reach.
    reach : float
        Days ahead beyond which nothing is told: the history is too short for more.
    mode, end : str
        Failure mode, and when it is reached, in words.
    days : ndarray, shape (k,)
        Ahead, of the fan.
    ratio : ndarray, shape (k, len(FAN))
        Quantiles of P/P₀; NaN where a model tells none.
    method : str
        Name of the model.
    begun : float
        Probability that wear has begun; NaN where the model does not ask.
    laws : mapping
        Name of the wear law to its probability; empty where the model has one law only.
    told : mapping
        Further numbers of the model, by name.
    fits : bool
        Whether the model's preload today is the one that the last runs tell; else nothing is foretold.
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
    laws: Mapping[str, float] = field(default_factory=dict)
    told: Mapping[str, float] = field(default_factory=dict)
    fits: bool = True

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
            If it is no probability.
        """
        p = np.asarray(probability, dtype=np.float64)
        if not ((p >= 0) & (p <= 1)).all():
            raise InputError(f"a probability of {p.flat[0]:g} was given; it must be from 0 to 1.")
        return np.asarray(np.quantile(self.rul_days, p, method="inverted_cdf"))

    def cdf(self, days: ArrayLike) -> Array:
        """Probability that life ends within so many days."""
        count = np.searchsorted(self.rul_days, np.asarray(days, dtype=np.float64), side="right")
        return np.asarray(count / len(self.rul_days))

    @property
    def known(self) -> bool:
        """Whether the median lies within reach: else the forecast hardly knows more than before."""
        return bool(np.isfinite(self.quantile(0.5)))

    @property
    def text(self) -> str:
        """One sentence."""
        if not self.fits:
            return "Not told: the forecast does not fit the runs."
        low, middle, high = self.quantile([0.05, 0.5, 0.95]).tolist()
        if high == 0:
            return "None: the end has been reached."
        if not math.isfinite(low):
            return f"No end is in sight: nothing is told beyond {self.reach:.0f} days."
        if not math.isfinite(middle):
            return (
                f"More than {low:.0f} days with a probability of 95 %; how long is open, since too little "
                f"wear is seen to tell (nothing is told beyond {self.reach:.0f} days)."
            )
        upper = f"{high:.0f}" if math.isfinite(high) else "an open number of"
        return f"{middle:.0f} days, between {low:.0f} and {upper} days with a probability of 90 %."


class LifeModel(Protocol):
    """What every model of this room can do."""

    def forecast(self, course: Course, failure: Failure, *, at: float | None = None) -> Forecast:
        """The remaining life as known at the end of a day, by default that of the last run."""
        ...


def reach_of(history: float) -> float:
    """How far ahead a history of so many days can be carried on: ten times, two months at least.

    Parameters
    ----------
    history : float
        Days.

    Returns
    -------
    float
        Days; twenty years at most.
    """
    return min(max(_REACH * history, _LEAST), _MOST)


def ahead(lives: Array, reach: float) -> Array:
    """Days of a fan: past the end of most lives, and not beyond reach.

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
