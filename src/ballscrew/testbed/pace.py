"""Rate of wear from day to day: running-in, the state of the grease, and chance."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from ballscrew.axis.given import not_negative
from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError

_MOST_DAYS = 1e6  # a slip in the unit of time must not fill the memory


@dataclass(frozen=True, slots=True)
class Pace:
    """The rate of wear over time, as a factor of that of a run-in, freshly greased axis.

    (1 + r e^(−t/t_r)) · (1 + g (1 − e^(−s/t_g))) · chance, with t the days since new and s those since the
    last greasing.

    Parameters
    ----------
    running_in : float
        r, more wear at the start, as a part.
    running_in_days : float
        t_r; more than 0.
    dry : float
        g, more wear with spent grease, as a part.
    dry_days : float
        t_g, in which grease is spent; more than 0.
    greased : tuple of float
        Days on which the axis is greased, ascending; on day 0 it is.
    roughness : float
        Coefficient of variation of a day's wear, which is gamma distributed and so never negative.
    seed : int
        Of that chance.
    """

    running_in: float = 0.4
    running_in_days: float = 5.0
    dry: float = 0.3
    dry_days: float = 30.0
    greased: tuple[float, ...] = ()
    roughness: float = 0.0
    seed: int = 0

    def __post_init__(self) -> None:
        """Refuse what cannot be."""
        for name in ("running_in", "dry", "roughness"):
            not_negative(name.replace("_", " "), getattr(self, name))
        for name in ("running_in_days", "dry_days"):
            value = float(not_negative(name.replace("_", " "), getattr(self, name), "d"))
            if value == 0:
                raise InputError(f"{name} is 0; it must be more than 0 days.")
        if any(not b > a for a, b in pairwise((0.0, *self.greased))):
            raise InputError("the days of greasing must ascend from above 0.")


def worn_days(pace: Pace, days: ArrayLike) -> Array:
    """The rate's integral: after how many days of unit rate there were as much wear.

    Parameters
    ----------
    pace : Pace
        The rate.
    days : array_like
        Since new; 0 or more.

    Returns
    -------
    ndarray
        Days, in closed form but for chance; it never falls.

    Raises
    ------
    InputError
        If a day is negative, or above a million.
    """
    when = not_negative("day", days, "d")
    if when.size and when.max() > _MOST_DAYS:
        raise InputError(f"a day of {when.max():g} was given; it must be {_MOST_DAYS:g} or less.")
    smooth = _smooth(pace, when)
    if pace.roughness == 0 or not when.size:
        return smooth
    whole = np.floor(when).astype(int)
    marks = _smooth(pace, np.arange(whole.max() + 2, dtype=np.float64))
    shape = pace.roughness**-2
    # One stream of numbers a life: a day's chance does not depend on what days are asked for.
    chance = np.random.default_rng(pace.seed).standard_gamma(shape, len(marks) - 1) / shape
    summed = np.concatenate([[0.0], np.cumsum(chance * np.diff(marks))])
    return np.asarray(summed[whole] + chance[whole] * (smooth - marks[whole]))


def _smooth(pace: Pace, when: Array) -> Array:
    r, g, run, dry = pace.running_in, pace.dry, pace.running_in_days, pace.dry_days
    both = 1 / run + 1 / dry
    total = np.zeros_like(when)
    for start, stop in pairwise((0.0, *pace.greased, math.inf)):
        end = np.clip(when, start, stop)
        worked = end - start
        new = math.exp(-start / run)
        total += (1 + g) * worked - g * dry * -np.expm1(-worked / dry)
        total += r * new * ((1 + g) * run * -np.expm1(-worked / run) - g / both * -np.expm1(-worked * both))
    return total
