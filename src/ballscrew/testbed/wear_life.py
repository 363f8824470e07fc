"""Life of an axis: wear under a duty, with preload and backlash along the axis.

The rate of wear is dw/dN = k h(t) A(x) max(Pⁿ, Fⁿ/2), with n the exponent of a law of
:mod:`ballscrew.axis.wear`. With w(x) also P(x) is local. h is the pace (:mod:`~ballscrew.testbed.pace`); A is
1 where a duty is spread evenly and loads nothing. Without preload one flank carries the nut load F and the
other nothing, each half of the time: hence Fⁿ/2, from which on backlash grows at a constant rate. For contact
pressure, n = 1/3, it is the preload of F/8 at which the nut's rigidity ends too.

With u = 1 − w/δ₀ and p = 1.5 n, −du/dS = max(u^p, ε), where S = ∫ k P₀ⁿ h A dN / δ₀ and ε = (F/P₀)ⁿ/2. Both
parts have a closed form, so days are computed all at once and in any order.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType

import numpy as np
from numpy.typing import ArrayLike

from ballscrew.axis.given import not_negative, positive
from ballscrew.axis.hertz import preload_deflection
from ballscrew.axis.model import kappa
from ballscrew.axis.sheet import DataSheet
from ballscrew.axis.wear import WEAR_LAWS
from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError, shown
from ballscrew.testbed.exposure import Exposure
from ballscrew.testbed.pace import Pace, worn_days
from ballscrew.testbed.warmth import warm_growth
from ballscrew.testbed.wear_state import WearState

EXPONENTS: Mapping[str, float] = MappingProxyType(
    {"contact-pressure": 1 / 3, "preload": 1.0, "exponential": 2 / 3, "external-load": 0.0}
)
"""n of each law in :data:`ballscrew.axis.wear.WEAR_LAWS`."""

_MOST_DAYS = 1e6


@dataclass(frozen=True, slots=True)
class Life:
    """How one axis wears.

    Parameters
    ----------
    sheet : DataSheet
        The axis as it really is.
    exposure : Exposure
        Of its duty.
    preload : float
        P₀, when new, N; more than 0.
    rate : float
        k P₀ⁿ: depth for each metre of travel when new, m/m.
    law : str
        A key of :data:`ballscrew.axis.wear.WEAR_LAWS`.
    pace : Pace
        Running-in, grease and chance.
    screw_share : float
        Part of the wear that is the screw's and follows the travel at each place; the nut and its balls are
        the same everywhere.
    load_weight : float
        By which part the rate grows where the nut load is as large as P₀.
    """

    sheet: DataSheet
    exposure: Exposure
    preload: float
    rate: float = 1e-10
    law: str = "contact-pressure"
    pace: Pace = field(default_factory=Pace)
    screw_share: float = 0.5
    load_weight: float = 0.5

    def __post_init__(self) -> None:
        """Refuse impossible values."""
        positive("preload", self.preload, "N")
        positive("rate of wear", self.rate, "m/m")
        not_negative("weight of the nut load", self.load_weight)
        if not float(not_negative("share of the screw", self.screw_share)) <= 1:
            raise InputError(f"a share of the screw of {self.screw_share:g} was given; it must be 1 or less.")
        if self.law not in list(WEAR_LAWS):
            raise InputError(f"the wear law is {shown(self.law)}; it must be one of {', '.join(WEAR_LAWS)}.")

    @property
    def pressed(self) -> float:
        """δ₀: by how much each flank is pressed together when new, m."""
        return float(preload_deflection(self.preload, kappa(self.sheet)))

    @property
    def local(self) -> Array:
        """A: the rate at each place over that of an even duty without nut load, shape (n,)."""
        weight = self.load_weight / self.preload
        nut = 1 + weight * self.exposure.mean_nut_load
        screw = self.exposure.density * (1 + weight * self.exposure.nut_load)
        return np.asarray((1 - self.screw_share) * nut + self.screw_share * screw)


@dataclass(frozen=True, slots=True)
class UnitSpread:
    """Spread of the units of one make: standard deviations, of the logarithm except for the preload.

    Parameters
    ----------
    rate, running_in, dry : float
        Of the rate of wear, of running-in and of spent grease.
    preload : float
        As a part of it; cut off at three times.
    """

    rate: float = 0.25
    running_in: float = 0.3
    dry: float = 0.3
    preload: float = 0.05


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
    remaining = _remaining(scale * gone[:, None] * life.local, EXPONENTS[life.law], _floor(life))
    return np.asarray(life.pressed * (1 - remaining))


def wear_states(life: Life, days: ArrayLike, difference: ArrayLike = 0.0) -> tuple[WearState, ...]:
    """States of the axis on days of its life.

    Parameters
    ----------
    life : Life
        Wear of the axis.
    days : array_like, shape (m,)
        Days since new.
    difference : array_like
        Temperature of the screw less that of the nut, K: one number, or one for each day. Wear does not
        depend on it.

    Returns
    -------
    tuple of WearState
        A state for each day.

    Raises
    ------
    InputError
        If a day is negative or not finite, or there are not as many differences as days.
    """
    when = np.ravel(not_negative("day", days, "d"))
    growth = np.ravel(warm_growth(life.sheet, difference))
    if growth.size not in (1, when.size):
        raise InputError(f"{growth.size} differences of temperature were given for {when.size} days.")
    spring, x = kappa(life.sheet), life.exposure.x
    return tuple(
        WearState(
            day=float(day),
            travel_m=float(day) * life.exposure.travel_per_day,
            x=x,
            wear=wear,
            pressed=life.pressed - wear + more,
            kappa=spring,
        )
        for day, wear, more in zip(
            when, wear_on(life, when), np.broadcast_to(growth, when.shape), strict=True
        )
    )


def calibrated(life: Life, days: float) -> Life:
    """Life with the rate of wear at which the first place loses its preload after a number of days.

    Parameters
    ----------
    life : Life
        Wear of the axis; its rate is replaced.
    days : float
        More than 0.

    Returns
    -------
    Life
        With another rate.

    Raises
    ------
    InputError
        If the law never ends, since nothing loads the nut.
    """
    gone = float(worn_days(life.pace, positive("number of days", days, "d")))
    needed = _needed(life, 0.0)
    if not math.isfinite(needed):
        raise InputError(
            f"by the wear law {shown(life.law)} the preload never ends while the duty makes no nut load; "
            f"it must make some, or the law be contact-pressure or external-load."
        )
    return replace(
        life, rate=needed * life.pressed / (life.local.max() * gone * life.exposure.travel_per_day)
    )


def day_of_backlash(life: Life, backlash: float = 0.0) -> float:
    """True end of a life: the day on which backlash first reaches a size.

    Parameters
    ----------
    life : Life
        Wear of the axis.
    backlash : float
        m; 0 for the end of the preload.

    Returns
    -------
    float
        Days since new; infinite where it takes more than a million.

    Raises
    ------
    InputError
        If the backlash is negative or not finite.
    """
    needed = _needed(life, float(not_negative("backlash", backlash, "m")))
    target = needed * life.pressed / (life.rate * life.exposure.travel_per_day * life.local.max())
    low, high = 0.0, 1.0
    while float(worn_days(life.pace, high)) < target:
        low, high = high, 2 * high
        if high > _MOST_DAYS:
            return math.inf
    while high - low > 1e-9 * high:
        middle = (low + high) / 2
        if float(worn_days(life.pace, middle)) >= target:
            high = middle
        else:
            low = middle
    return high


def another_unit(life: Life, seed: int, spread: UnitSpread | None = None) -> Life:
    """Another axis of the same make under the same duty.

    Parameters
    ----------
    life : Life
        The make.
    seed : int
        The same seed gives the same unit.
    spread : UnitSpread, optional
        How units differ.

    Returns
    -------
    Life
        With its own rate, preload, running-in, use of grease and chance.
    """
    sizes = spread or UnitSpread()
    random = np.random.default_rng(seed)
    rate, running_in, dry = np.exp([sizes.rate, sizes.running_in, sizes.dry] * random.standard_normal(3))
    tight = 1 + sizes.preload * np.clip(random.standard_normal(), -3, 3)
    pace = replace(
        life.pace,
        running_in=life.pace.running_in * float(running_in),
        dry=life.pace.dry * float(dry),
        seed=int(random.integers(2**31)),
    )
    preload = life.preload * float(tight)
    # The wear coefficient k is the unit's; what the new preload makes of it is the law's.
    changed = float(rate * tight ** EXPONENTS[life.law])
    return replace(life, preload=preload, rate=life.rate * changed, pace=pace)


def _floor(life: Life) -> float:
    """ε: the rate under the nut load alone, over that of the new preload."""
    n = EXPONENTS[life.law]
    load = life.exposure.mean_nut_load
    return 0.5 * (load / life.preload) ** n if load > 0 else 0.0


def _switch(n: float, floor: float) -> tuple[float, float]:
    """U below which the nut load alone causes wear, and S there."""
    p = 1.5 * n
    if p == 0:
        return 0.0, 1.0
    last = min(1.0, floor ** (1 / p))
    if p == 1:
        return last, -math.log(last) if last > 0 else math.inf
    if last == 0:
        return 0.0, 1 / (1 - p) if p < 1 else math.inf
    return last, (1 - last ** (1 - p)) / (1 - p)


def _remaining(spent: Array, n: float, floor: float) -> Array:
    """U after S; negative for backlash."""
    p = 1.5 * n
    last, end = _switch(n, floor)
    s = np.minimum(spent, end)
    pressed = np.exp(-s) if p == 1 else np.maximum(1 - (1 - p) * s, 0.0) ** (1 / (1 - p))
    slope = 1.0 if p == 0 else floor
    return np.asarray(np.where(spent < end, pressed, last - slope * (spent - s)))


def _needed(life: Life, backlash: float) -> float:
    """S at which a backlash is reached."""
    n = EXPONENTS[life.law]
    floor = _floor(life)
    last, end = _switch(n, floor)
    slope = 1.0 if n == 0 else floor
    more = last + backlash / 2 / life.pressed
    if more == 0 or not math.isfinite(end):
        return end
    return end + more / slope if slope > 0 else math.inf
