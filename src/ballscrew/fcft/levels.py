"""Other motions for a plan: two acceleration levels for the preload in newtons; a gentler one for wear."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from ballscrew.axis.frequency import predicted_frequency, predicted_modes
from ballscrew.axis.model import guide_friction, moving_mass, weight_on_nut
from ballscrew.axis.rigidity import release_ratio
from ballscrew.axis.sheet import DataSheet
from ballscrew.base.errors import InputError
from ballscrew.fcft.conditions import Condition
from ballscrew.fcft.excitation import torque_spectrum
from ballscrew.fcft.expected import executed
from ballscrew.fcft.limits import check_limits, required_torque
from ballscrew.fcft.nutload import hardest, nut_load
from ballscrew.fcft.plan import Motion, Plan

LOW, HIGH = 0.5, 1.5
"""F/P of the two levels: between them the frequency falls by about half a per cent."""

GENTLER = 3.0
"""Preload at which the plan's motion unloads the nut, over that of the gentler motion."""

_WORN = 0.4  # of the preload: the gentler motion measures below it in any case

_PERIODS = 6.0  # of the lowest expected frequency, between the two blows
_RISE = (0.05, 0.5)  # jerk time in periods of the highest: a shorter one excites no more, a longer one less
_DEPARTURES = (Condition.PA, Condition.NA)
_NO_TORQUE = 1e-30  # N m s
_ROOM = 0.95  # of the gap between two stops that acceleration and deceleration may take


@dataclass(frozen=True, slots=True)
class Levels:
    """Two motions that differ in their nut load and in nothing else that shapes the torque's spectrum.

    Parameters
    ----------
    motions : tuple of Motion
        Low and high; empty if there are none.
    shift : float
        Difference of the frequency between them at the first stop, mean of PA and NA, Hz; negative.
    reason : str
        Why there are none; else empty.
    nut_load_ratio : tuple of mapping
        Nut load over the nominal preload of each motion in PA and NA, with sign: positive where the screw
        pushes the nut in the positive direction.
    """

    motions: tuple[Motion, ...]
    shift: float
    reason: str
    nut_load_ratio: tuple[Mapping[Condition, float], ...] = ()


def two_levels(plan: Plan, sheet: DataSheet) -> Levels:
    """Two motions whose largest nut loads at departures are 0.5 and 1.5 times the nominal preload.

    Where a weight acts on the nut, only one direction reaches them: in the other it counts against inertia.

    Both have the same T_a and T_j, so their blows have the same spectrum but for the size, and the errors of
    a window or a method are the same for both. T_a is six periods of the lowest expected frequency. T_j,
    dwell and spreads are those of the plan's first motion, T_j within 1/20 and 1/2 of a period of the highest
    expected frequency.

    Parameters
    ----------
    plan : Plan
        Stops, loads and dwell; the heaviest load is decisive.
    sheet : DataSheet
        The axis, with its limits if stated.

    Returns
    -------
    Levels
        With a reason if the axis cannot do it.
    """
    if release_ratio(sheet.screw) < HIGH:
        return _none(f"a spring preloads the nut, which loses contact at a load of P, below {HIGH:g} P")
    heaviest = max(plan.masses)
    moving = sheet.table.mass + heaviest
    preload, friction = sheet.nominal_preload, float(guide_friction(sheet, heaviest))
    weight = abs(float(weight_on_nut(sheet, heaviest)))
    low = (LOW * preload - friction - weight) / moving
    high = (HIGH * preload - friction - weight) / moving
    if low <= 0:
        constant = f"the guides' friction of {friction:.3g} N"
        if weight:
            constant = f"the weight of {weight:.0f} N with {constant}"
        return _none(f"{constant} alone reaches {LOW:g} P ({LOW * preload:.0f} N)")
    frequencies = predicted_frequency(sheet, np.array(plan.positions)[:, None], np.array(plan.masses))
    first = plan.motions[0]
    highest = float(frequencies.max())
    rise = min(max(first.jerk_time, _RISE[0] / highest), _RISE[1] / highest)
    hold = _PERIODS / float(frequencies.min())
    softest = rise * (1 + first.jerk_spread)
    if high * hold * (hold + softest) > _ROOM * plan.smallest_gap:
        return _none(
            f"stops {plan.smallest_gap * 1e3:g} mm apart are too close to accelerate at {high:.2g} m/s^2 for "
            f"{hold * 1e3:.0f} ms ({_PERIODS:g} periods) and to stop again"
        )
    fastest = high * hold
    if sheet.limits.speed is not None and fastest > sheet.limits.speed:
        return _none(f"it would take {fastest:.2g} m/s, and the axis may do {sheet.limits.speed:g} m/s")
    rest = (first.dwell, first.jerk_spread, first.start_spread)
    motions = (Motion(low * hold, low, low / rise, *rest), Motion(high * hold, high, high / rise, *rest))
    reason = _limit_broken(plan, sheet, motions)
    if reason:
        return _none(reason)
    loads = [
        [nut_load(sheet, motion, heaviest, departure) for departure in _DEPARTURES] for motion in motions
    ]
    modes = predicted_modes(sheet, plan.positions[0], heaviest, nut_load=np.array(loads))
    under = modes.nearest(modes.frequency[0, 0])
    shift = float(np.mean(under[1] - under[0]))
    ratios = [dict(zip(_DEPARTURES, np.divide(row, preload).tolist(), strict=True)) for row in loads]
    return Levels(motions, shift, "", tuple(ratios))


@dataclass(frozen=True, slots=True)
class GentleMotion:
    """A motion whose load unloads a nut later than the plan's own motions do.

    Parameters
    ----------
    motion : Motion or None
        None where there is none.
    unloads_below, own_unloads_below : float
        P/P₀ below which the load of the gentler motion, and that of the plan, unloads the nut.
    excitation : float
        Torque at the mode over that of the plan's first motion, the least of all cells.
    reason : str
        Why there is none; else empty.
    """

    motion: Motion | None
    unloads_below: float
    own_unloads_below: float
    excitation: float
    reason: str

    @property
    def repetitions(self) -> float:
        """Repetitions for the same noise, over the plan's."""
        return self.excitation**-2 if self.excitation > 0 else math.inf


def gentle_motion(plan: Plan, sheet: DataSheet) -> GentleMotion:
    """Motion with a lower acceleration, which still measures a worn nut.

    Its load unloads the nut at a third of the preload at which the plan's does, and at 40 % at most. T_a,
    T_j, dwell and spreads are those of the plan's first motion: the spectrum of a blow is the same but for
    its size, and forces that repeat with every turn have lower frequencies.

    Parameters
    ----------
    plan : Plan
        Stops, loads and motions; the heaviest load is decisive.
    sheet : DataSheet
        The axis.

    Returns
    -------
    GentleMotion
        With a reason if the axis cannot do it.
    """
    heaviest, first = max(plan.masses), plan.motions[0]
    release = release_ratio(sheet.screw) * sheet.nominal_preload
    motions = [hardest(executed(plan, index)) for index in range(len(plan.motions))]
    loads = [abs(nut_load(sheet, motion, heaviest, c)) for motion in motions for c in Condition]
    own = max(loads) / release
    ratio = min(_WORN, own / GENTLER)
    constant = float(guide_friction(sheet, heaviest)) + abs(float(weight_on_nut(sheet, heaviest)))
    acceleration = (ratio * release - constant) / float(moving_mass(sheet, heaviest))
    if not acceleration > 0:
        least = constant / release
        reason = f"friction and weight alone ({constant:.0f} N) unload the nut at {least:.0%} of its preload"
        return GentleMotion(None, ratio, own, 0.0, reason)
    rest = (first.dwell, first.jerk_spread, first.start_spread)
    speed = first.speed * acceleration / first.acceleration
    motion = Motion(speed, acceleration, acceleration / first.jerk_time, *rest)
    frequencies = predicted_frequency(sheet, np.array(plan.positions)[:, None], np.array(plan.masses))
    gentle = torque_spectrum(sheet, executed(replace(plan, motions=(motion,)), 0), heaviest, frequencies)
    usual = torque_spectrum(sheet, executed(plan, 0), heaviest, frequencies)
    return GentleMotion(motion, ratio, own, float(np.min(gentle / np.maximum(usual, _NO_TORQUE))), "")


def _limit_broken(plan: Plan, sheet: DataSheet, motions: tuple[Motion, Motion]) -> str:
    """Limit of the machine that the two motions break, in words; empty if none."""
    torque = required_torque(sheet, motions[1], max(plan.masses))
    if sheet.limits.torque is not None and torque > sheet.limits.torque:
        return f"it would take {torque:.3g} N m, and the motor may give {sheet.limits.torque:g} N m"
    try:
        broken = check_limits(replace(plan, motions=motions), sheet).broken
    except InputError:
        return f"twice the round trips are more than can be run ({plan.repetitions} repetitions)"
    return broken[0].removesuffix(".") if broken else ""


def _none(reason: str) -> Levels:
    return Levels((), 0.0, reason)
