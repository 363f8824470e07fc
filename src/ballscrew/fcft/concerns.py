"""What speaks against a plan on an axis, in words: what to change, and to what."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from ballscrew.axis.sheet import DataSheet
from ballscrew.fcft.expected import ExpectedCell, executed, least_excitation
from ballscrew.fcft.nutload import ADVISED, RELEASE
from ballscrew.fcft.plan import Motion, Plan

__all__ = ["EXCITED", "QUIET", "RINGING", "SHORTEST", "notes", "warnings"]

RINGING, QUIET = 12.0, 7.0
"""Periods of the mode that a window holds after a blow, and before it."""
SHORTEST = 4.0
"""Periods below which a window cannot tell a mode from its neighbour."""

EXCITED = 0.2
"""Of a jerk without duration; with less, the torque's power is more than 14 dB down: it has a null there."""

_ROUNDING = 1e-6  # relative, of values that a plan's file gives with nine digits
_SPREADS = (0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.6, 0.8, 1.0)


_NUT = 2.0  # nominal diameters: half the length of an ordinary nut


def warnings(plan: Plan, sheet: DataSheet, cells: Sequence[ExpectedCell]) -> tuple[str, ...]:
    """What would spoil the measurement.

    Parameters
    ----------
    plan : Plan
        The test.
    sheet : DataSheet
        The axis.
    cells : sequence of ExpectedCell
        Of :func:`~ballscrew.fcft.expected.expected_cells`.

    Returns
    -------
    tuple of str
        A sentence each: what, where, and what to do.
    """
    found = []
    gap = min(b - a for a, b in pairwise(plan.positions))
    for index, motion in enumerate(plan.motions):
        own = [cell for cell in cells if cell.motion == index]
        name = "the motion" if len(plan.motions) == 1 else f"motion {index}"
        found += [
            *_null(name, plan, index, own),
            *_unloaded(name, motion, sheet, own, gap),
            *_cut(name, motion, own, gap),
        ]
    return tuple(found)


def notes(plan: Plan, sheet: DataSheet, cells: Sequence[ExpectedCell]) -> tuple[str, ...]:
    """What is worth knowing, and spoils nothing.

    Parameters
    ----------
    plan, sheet, cells
        As in :func:`warnings`.

    Returns
    -------
    tuple of str
        A sentence each.
    """
    found = _release(sheet, max(cells, key=lambda cell: cell.nut_load_ratio))
    asked = (("warm-up (warm_up)", plan.warm_up), ("temperature (temperature)", plan.temperature))
    missing = " and no ".join(what for what, there in asked if not there)
    if missing:
        found.append(
            f"the plan asks for no {missing}: a screw some kelvins warmer than its nut reads as more "
            "preload, and a cold run after a warm one as a loss."
        )
    found += [*_near_the_ends(plan, sheet), *_not_reached(plan)]
    lowest = min(cell.frequency for cell in cells)
    for index, motion in enumerate(plan.motions):
        periods = motion.acceleration_time * lowest
        if SHORTEST <= periods < RINGING:
            found.append(
                f"between the two blows of motion {index} lie {periods:.1f} periods of the lowest expected "
                f"frequency; {RINGING:g} fill the window, {SHORTEST:g} are needed."
            )
    return tuple(found)


def _spread_that_helps(plan: Plan, motion: int, cells: Sequence[ExpectedCell]) -> float | None:
    """The least of a few jerk spreads that fills the nulls on the expected frequencies.

    Parameters
    ----------
    plan : Plan
        Gives the repetitions over which a spread is spread.
    motion : int
        Which of its motions, from 0.
    cells : sequence of ExpectedCell
        Those of that motion.

    Returns
    -------
    float or None
        None where the plan has one repetition, or no spread is enough that leaves room between the stops.
    """
    modes = np.array(sorted({(cell.frequency, cell.standard_uncertainty) for cell in cells}))
    gap = min(b - a for a, b in pairwise(plan.positions))
    own = plan.motions[motion]
    for spread in _SPREADS:
        varied = replace(own, jerk_spread=spread)
        motions = tuple(varied if index == motion else one for index, one in enumerate(plan.motions))
        runs = executed(replace(plan, motions=motions), motion)
        if max(2 * run.acceleration_distance for run in runs) > gap:
            break
        if least_excitation(modes[:, 0], modes[:, 1], runs).min() >= EXCITED:
            return spread
    return None


def _rounded(value: float, digits: int, *, up: bool) -> float:
    """A number with few digits that is on the safe side of the one given.

    Parameters
    ----------
    value : float
        Any; 0 and less stay as they are.
    digits : int
        How many.
    up : bool
        Whether the safe side is above.

    Returns
    -------
    float
        Next to ``value``.
    """
    if value <= 0:
        return value
    step = 10.0 ** (math.floor(math.log10(value)) - digits + 1)
    count = value / step
    slack = count * 1e-9
    whole = math.ceil(count - slack) if up else math.floor(count + slack)
    return float(f"{whole * step:.{digits + 1}g}")


def _release(sheet: DataSheet, hardest: ExpectedCell) -> list[str]:
    force, rating = abs(hardest.nut_load), sheet.screw.dynamic_load_rating
    if hardest.nut_load_ratio >= RELEASE:
        return []  # that it is so already is a warning
    advised, released = force / ADVISED, force / RELEASE
    first = f"reaches {ADVISED:g} P at {advised:.0f} N of preload ({advised / rating:.2%} of Ca) and "
    return [
        (
            f"as the preload falls, this plan's nut load of {force:.0f} N "
            f"{'' if _above(hardest) else first}unloads the nut ({RELEASE:.2f} P) at {released:.0f} N of "
            f"preload ({released / rating:.2%} of Ca); below that the frequency no longer tells the preload."
        )
    ]


def _above(cell: ExpectedCell) -> bool:
    return cell.nut_load_ratio > ADVISED * (1 + _ROUNDING)


def _null(name: str, plan: Plan, index: int, cells: Sequence[ExpectedCell]) -> list[str]:
    motion = plan.motions[index]
    weak = [cell for cell in cells if cell.least_excitation < EXCITED]
    if not weak:
        return []
    worst = min(weak, key=lambda cell: cell.least_excitation)
    order = max(1, round(worst.frequency * motion.jerk_time))
    highest = max(cell.frequency + 2 * cell.standard_uncertainty for cell in cells)
    jerk = _rounded(_jerk(motion, highest), 3, up=True)
    spread = _spread_that_helps(plan, index, cells)
    also = (
        f", and so does jerk_spread = {spread:g}, which moves the null between repetitions" if spread else ""
    )
    return [
        (
            f"{name}: the torque has a null at {order / motion.jerk_time:.1f} Hz (jerk time "
            f"{motion.jerk_time * 1e3:.3g} ms), on the expected natural frequency of {len(weak)} of "
            f"{len(cells)} cells or so near that they are hardly excited, such as {worst.frequency:.1f} ± "
            f"{worst.standard_uncertainty:.1f} Hz at {worst.position * 1e3:g} mm; a jerk of {jerk:g} m/s^3 "
            f"or more (jerk time {500 / highest:.3g} ms) excites all of them{also}."
        )
    ]


def _jerk(motion: Motion, highest: float) -> float:
    """Jerk at which the jerk time is half a period of the highest frequency."""
    full = 2 * highest * motion.acceleration
    return full if motion.speed >= motion.acceleration / (2 * highest) else 4 * highest**2 * motion.speed


def _unloaded(
    name: str, motion: Motion, sheet: DataSheet, cells: Sequence[ExpectedCell], gap: float
) -> list[str]:
    worst = max(cells, key=lambda cell: cell.nut_load_ratio)
    if not _above(worst):
        return []
    ratio, force = worst.nut_load_ratio, abs(worst.nut_load)
    moving = sheet.table.mass + worst.mass
    advised = _rounded((ADVISED * sheet.nominal_preload - sheet.guide.friction) / moving, 2, up=False)
    cure = (
        f"an acceleration of {advised:g} m/s^2 or less{_speed(motion, advised, gap)} keeps it below "
        f"{ADVISED:g} P"
        if advised > 0
        else f"the guides' friction alone is more than {ADVISED:g} P, so no acceleration helps"
    )
    what = (
        f"unloads the nut ({RELEASE:.2f} P): its frequency does not depend on the preload"
        if ratio >= RELEASE
        else f"softens the nut: the frequency reads {-worst.nut_load_shift:.2f} Hz low"
    )
    return [
        (
            f"{name}: the nut load of {force:.0f} N at {worst.mass:g} kg ({worst.condition}) is {ratio:.2f} "
            f"times the nominal preload of {sheet.nominal_preload:.0f} N and {what}; {cure}."
        )
    ]


def _speed(motion: Motion, acceleration: float, gap: float) -> str:
    """Where the stops are too close for a lower acceleration: the speed that goes with it."""
    slower = replace(motion, acceleration=acceleration)
    if 2 * slower.acceleration_distance <= gap:
        return ""
    # To reach a speed and stop again takes v (v / a + a / j). The motion reaches a higher acceleration within
    # the gap, so the lower one is reached at this speed too.
    rise = acceleration / motion.jerk
    speed = acceleration / 2 * (math.sqrt(rise**2 + 4 * gap / acceleration) - rise)
    return f" at {_rounded(1e3 * speed, 3, up=False):g} mm/s or less (the stops are {gap * 1e3:g} mm apart)"


def _cut(name: str, motion: Motion, cells: Sequence[ExpectedCell], gap: float) -> list[str]:
    lowest = min(cell.frequency for cell in cells)
    found = []
    needed = (RINGING + QUIET) / lowest
    if motion.dwell < needed * (1 - _ROUNDING):
        found.append(
            f"{name}: the dwell of {motion.dwell * 1e3:.3g} ms holds {motion.dwell * lowest:.1f} periods of "
            f"the lowest expected frequency ({lowest:.1f} Hz), so the ringing is cut off; "
            f"{RINGING:g} after one move and {QUIET:g} before the next need "
            f"{_rounded(1e3 * needed, 3, up=True):g} ms or more."
        )
    periods = motion.acceleration_time * lowest
    if periods < SHORTEST:
        cure = _longer(motion, SHORTEST / lowest, gap)
        found.append(
            f"{name}: an acceleration takes {motion.acceleration_time * 1e3:.3g} ms, {periods:.1f} periods "
            f"of the lowest expected frequency ({lowest:.1f} Hz); {SHORTEST:g} are needed between its two "
            f"blows: {cure}."
        )
    return found


def _longer(motion: Motion, time: float, gap: float) -> str:
    """How a phase comes to take a time."""
    slower = _rounded(motion.speed / time, 2, up=False)
    if 2 * replace(motion, acceleration=slower).acceleration_distance <= gap:
        return f"accelerate at {slower:g} m/s^2 or less"
    # v (v / a + a / j) is the gap between the stops, with a = v / time; less a little for the rounding.
    room = 0.98 * gap
    speed = 2 * room / (time + math.sqrt(time**2 + 4 * room / (time * motion.jerk)))
    speed = _rounded(speed, 3, up=False)
    slower = _rounded(speed / time, 3, up=False)
    return (
        f"accelerate at {slower:g} m/s^2 to {1e3 * speed:g} mm/s, since stops {gap * 1e3:g} mm apart "
        "leave no room for more"
    )


def _near_the_ends(plan: Plan, sheet: DataSheet) -> list[str]:
    """The data sheet does not say how long the nut is; many are three to five diameters."""
    room = _NUT * sheet.screw.nominal_diameter
    ends = (
        ("thrust bearing", plan.positions[0] + sheet.screw.bearing_to_zero, plan.positions[0]),
        ("screw's far end", sheet.travel_limit - plan.positions[-1], plan.positions[-1]),
    )
    return [
        f"the stop at {1e3 * stop:g} mm is {round(1e3 * left, 1) + 0.0:g} mm from the {end}; the nut's own "
        "length is not known here: see that it has room, and state the soft limits."
        for end, left, stop in ends
        if left < room
    ]


def _not_reached(plan: Plan) -> list[str]:
    return [
        f"motion {index} asks for {motion.acceleration:.3g} m/s^2, and reaches "
        f"{motion.peak_acceleration:.3g} m/s^2: its speed is too low for its jerk."
        for index, motion in enumerate(plan.motions)
        if not motion.reaches_acceleration
    ]
