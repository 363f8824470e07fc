"""Life of an axis: wear under a duty, with preload and backlash along the axis.

The rate of wear is dw/dN = k h(t) A(x) max(P^(1/3), F^(1/3)/2): the law ``"contact-pressure"`` of
:mod:`ballscrew.axis.wear`. With w(x) also P(x) is local. h is the pace (:mod:`~ballscrew.testbed.pace`); A is
1 where a duty is spread evenly and loads nothing. Without preload one flank carries the nut load F and the
other nothing, each half of the time: hence F^(1/3)/2, from which on backlash grows at a constant rate. It is
the preload of F/8 at which the nut's rigidity ends too.

With u = 1 − w/δ₀, −du/dS = max(√u, ε), where S = ∫ k P₀^(1/3) h A dN / δ₀ and ε = (F/P₀)^(1/3)/2. Both parts
have a closed form, so days are computed all at once and in any order. The support bearing wears by the same
law under its own preload: its stiffness, proportional to P_b^(1/3), decreases linearly with the travel.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike

from ballscrew.axis.given import not_negative, positive
from ballscrew.axis.hertz import preload_deflection
from ballscrew.axis.model import kappa
from ballscrew.axis.sheet import DataSheet
from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError
from ballscrew.testbed.duty import Exposure
from ballscrew.testbed.machine import Machine
from ballscrew.testbed.pace import Pace, worn_days

_LEAST_STIFFNESS = (
    0.3  # of a worn bearing over its new one: its balls carry the load of the axis without preload
)
_LOAD_WEIGHT = 0.5  # part by which the rate grows where the nut load is as large as the new preload


@dataclass(frozen=True, slots=True)
class Life:
    """Wear of an axis over time.

    Parameters
    ----------
    sheet : DataSheet
        Data sheet with the true values.
    exposure : Exposure
        Exposure of the axis to its duty.
    preload : float
        P₀, when new, N; more than 0.
    rate : float
        k P₀^(1/3): depth of wear per metre of travel when new, m/m.
    pace : Pace
        Running-in, grease and chance.
    screw_share : float
        Part of the wear that is the screw's and follows the travel at each place; nut and balls wear the same
        everywhere.
    bearing_travel : float
        Travel after which the support bearing has lost its preload, m; its stiffness decreases linearly.
        Infinite for a bearing that does not wear.
    """

    sheet: DataSheet
    exposure: Exposure
    preload: float
    rate: float = 1e-10
    pace: Pace = field(default_factory=Pace)
    screw_share: float = 0.5
    bearing_travel: float = math.inf

    def __post_init__(self) -> None:
        """Refuse impossible values."""
        positive("preload", self.preload, "N")
        positive("rate of wear", self.rate, "m/m")
        if not self.bearing_travel > 0:
            raise InputError(f"a bearing_travel of {self.bearing_travel:g} m was given; it must be above 0.")
        if not float(not_negative("share of the screw", self.screw_share)) <= 1:
            raise InputError(f"a share of the screw of {self.screw_share:g} was given; it must be 1 or less.")

    @property
    def pressed(self) -> float:
        """δ₀: approach of each flank by the preload when new, m."""
        return float(preload_deflection(self.preload, kappa(self.sheet)))

    @property
    def local(self) -> Array:
        """A: local rate over that of an even duty without nut load, shape (n,)."""
        weight = _LOAD_WEIGHT / self.preload
        nut = 1 + weight * self.exposure.mean_nut_load
        screw = self.exposure.density * (1 + weight * self.exposure.nut_load)
        return np.asarray((1 - self.screw_share) * nut + self.screw_share * screw)


def wear_on(life: Life, days: ArrayLike) -> Array:
    """Depth of wear over days and places.

    Parameters
    ----------
    life : Life
        Wear of the axis.
    days : array_like, shape (m,)
        Days since new.

    Returns
    -------
    ndarray, shape (m, n)
        w, m; n places of the duty's exposure.

    Raises
    ------
    InputError
        If a day is negative or not finite.
    """
    gone = np.ravel(worn_days(life.pace, days))
    scale = life.rate * life.exposure.travel_per_day / life.pressed
    remaining = _remaining(scale * gone[:, None] * life.local, _least_rate(life))
    return np.asarray(life.pressed * (1 - remaining))


def worn_machines(machine: Machine, life: Life, days: ArrayLike) -> list[Machine]:
    """Machine on days of its life, with the preload and backlash that wear has left along its axis.

    Parameters
    ----------
    machine : Machine
        New machine, with the same preload everywhere.
    life : Life
        Wear of its axis.
    days : array_like, shape (m,)
        Days since new.

    Returns
    -------
    list of Machine
        A machine for each day, with the ``preload`` of the new one and the approach lost at each place.

    Raises
    ------
    InputError
        If a day is negative or not finite.
    """
    x = life.exposure.x
    travel = life.exposure.travel_per_day * np.ravel(days)
    stiffness = np.maximum(1 - travel / life.bearing_travel, _LEAST_STIFFNESS)
    worn = []
    for wear, bearing in zip(wear_on(life, days), machine.bearing_preload_ratio * stiffness**3, strict=True):
        lost = machine.pressed(x) - (life.pressed - wear)
        places = tuple(zip(x.tolist(), lost.tolist(), strict=True))
        worn.append(replace(machine, lost=places, bearing_preload_ratio=float(bearing)))
    return worn


def calibrated(life: Life, days: float) -> Life:
    """Life with the rate of wear at which the first place loses its preload after a number of days.

    Parameters
    ----------
    life : Life
        Wear of the axis; its rate is replaced.
    days : float
        Number of days, more than 0.

    Returns
    -------
    Life
        Life with the calibrated rate.
    """
    gone = float(worn_days(life.pace, positive("number of days", days, "d")))
    least = _least_rate(life)
    last, needed = _switch(least)
    if last > 0:
        needed += last / least
    return replace(
        life, rate=needed * life.pressed / (life.local.max() * gone * life.exposure.travel_per_day)
    )


def _least_rate(life: Life) -> float:
    """ε: rate under the nut load alone, over that of the new preload."""
    return 0.5 * math.pow(life.exposure.mean_nut_load / life.preload, 1 / 3)


def _switch(least: float) -> tuple[float, float]:
    """U below which the nut load alone causes wear, and S there."""
    last = min(1.0, least**2)
    return last, 2 * (1 - math.sqrt(last))


def _remaining(spent: Array, least: float) -> Array:
    """U after S; negative for backlash."""
    last, end = _switch(least)
    s = np.minimum(spent, end)
    return np.asarray(np.where(spent < end, (1 - 0.5 * s) ** 2, last - least * (spent - s)))
