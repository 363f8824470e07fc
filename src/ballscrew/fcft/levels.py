"""Two acceleration levels: the same stops under a small and a large nut load tie the preload to newtons."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from ballscrew.axis.frequency import predicted_frequency
from ballscrew.axis.sheet import DataSheet
from ballscrew.base.errors import InputError
from ballscrew.fcft.limits import check_limits, required_torque
from ballscrew.fcft.plan import Motion, Plan

__all__ = ["HIGH", "LOW", "Levels", "two_levels"]

LOW, HIGH = 0.5, 1.5
"""F/P of the two levels: between them the frequency falls by about half a per cent."""

_PERIODS = 6.0  # of the lowest expected frequency, between the two blows
_RISE = (0.05, 0.5)  # jerk time in periods of the highest: a shorter one excites no more, a longer one less
_ROOM = 0.95  # of the gap between two stops that acceleration and deceleration may take


@dataclass(frozen=True, slots=True)
class Levels:
    """Two motions that differ in their nut load and in nothing else that shapes the torque's spectrum.

    Parameters
    ----------
    motions : tuple of Motion
        Low and high; empty where there is none to offer.
    shift : float
        By how much the frequency differs between them at the first stop, Hz; negative.
    reason : str
        Why there is none; empty where there is.
    """

    motions: tuple[Motion, ...]
    shift: float
    reason: str


def two_levels(plan: Plan, sheet: DataSheet) -> Levels:
    """Offer two motions whose nut loads at departures are 0.5 and 1.5 times the nominal preload.

    Both have the same T_a and T_j, so their blows have one spectrum and differ in size alone: what a window
    or a method does wrong, it does alike to both. T_a is six periods of the lowest expected frequency. T_j,
    dwell and spreads are those of the plan's first motion, T_j within 1/20 and 1/2 of a period of the highest
    expected frequency.

    Parameters
    ----------
    plan : Plan
        Gives stops, loads and the dwell; the heaviest load decides.
    sheet : DataSheet
        The axis, with its limits where it states them.

    Returns
    -------
    Levels
        With a reason where the axis cannot do it.
    """
    heaviest = max(plan.masses)
    moving = sheet.table.mass + heaviest
    preload, friction = sheet.nominal_preload, sheet.guide.friction
    low, high = ((ratio * preload - friction) / moving for ratio in (LOW, HIGH))
    if low <= 0:
        return _none(
            f"the guides' friction of {friction:g} N alone reaches {LOW:g} P ({LOW * preload:.0f} N)"
        )
    frequencies = predicted_frequency(sheet, np.array(plan.positions)[:, None], np.array(plan.masses))
    first = plan.motions[0]
    shortest, longest = (part / float(frequencies.max()) for part in _RISE)
    rise = min(max(first.jerk_time, shortest), longest)
    hold = _PERIODS / float(frequencies.min())
    gap = min(b - a for a, b in pairwise(plan.positions))
    softest = rise * (1 + first.jerk_spread)
    if high * hold * (hold + softest) > _ROOM * gap:
        return _none(
            f"stops {gap * 1e3:g} mm apart leave no room to accelerate at {high:.2g} m/s^2 for "
            f"{hold * 1e3:.0f} ms ({_PERIODS:g} periods) and to stop again"
        )
    fastest = high * hold
    if sheet.limits.speed is not None and fastest > sheet.limits.speed:
        return _none(f"it would take {fastest:.2g} m/s, and the axis may do {sheet.limits.speed:g} m/s")
    motions = tuple(
        Motion(a * hold, a, a / rise, first.dwell, first.jerk_spread, first.start_spread) for a in (low, high)
    )
    torque = required_torque(sheet, motions[1], heaviest)
    if sheet.limits.torque is not None and torque > sheet.limits.torque:
        return _none(f"it would take {torque:.3g} N m, and the motor may give {sheet.limits.torque:g} N m")
    try:
        broken = check_limits(replace(plan, motions=motions), sheet).broken
    except InputError:
        return _none(f"twice the round trips are more than can be run ({plan.repetitions} repetitions)")
    if broken:
        return _none(broken[0].removesuffix("."))
    loads = preload * np.array([LOW, HIGH])
    under = predicted_frequency(sheet, plan.positions[0], heaviest, nut_load=loads)
    return Levels(motions, float(under[1] - under[0]), "")


def _none(reason: str) -> Levels:
    return Levels((), 0.0, reason)
