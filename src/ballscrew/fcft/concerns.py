"""Warnings and notes on a plan, as sentences: the problem, where it is, and what to change."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ballscrew.axis.model import FRICTION_COEFFICIENT, guide_friction, pretension_reserve, weight_on_nut
from ballscrew.axis.rigidity import release_ratio
from ballscrew.axis.sheet import DataSheet
from ballscrew.fcft.expected import ExpectedCell, executed, least_excitation
from ballscrew.fcft.nutload import advised_ratio
from ballscrew.fcft.plan import Motion, Plan

RINGING, QUIET = 12.0, 7.0
"""Periods of the mode in a window after a jerk phase, and before it."""
SHORTEST = 4.0
"""Periods below which a window cannot separate a mode from its neighbour."""

EXCITED = 0.2
"""Relative excitation below which the torque counts as null: its power is more than 14 dB down."""

_ROUNDING = 1e-6  # relative, of values that a plan's file gives with nine digits
_SPREADS = (0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.6, 0.8, 1.0)  # jerk spreads that are tried
_HALF_NUT = 2.0  # nominal diameters: half the length of an ordinary nut


def warnings(plan: Plan, sheet: DataSheet, cells: Sequence[ExpectedCell]) -> tuple[str, ...]:
    """Problems that would spoil the measurement.

    Parameters
    ----------
    plan : Plan
        The test.
    sheet : DataSheet
        The axis.
    cells : sequence of ExpectedCell
        Result of :func:`~ballscrew.fcft.expected.expected_cells`.

    Returns
    -------
    tuple of str
        Sentences with the problem, where it is, and what to do.
    """
    sentences: list[str] = []
    for index, motion in enumerate(plan.motions):
        own = [cell for cell in cells if cell.motion == index]
        name = "the motion" if len(plan.motions) == 1 else f"motion {index}"
        sentences += _null(name, plan, index, own)
        sentences += _unloaded(name, motion, sheet, own, plan.smallest_gap)
        sentences += _too_short(name, motion, own, plan.smallest_gap)
    return (*sentences, *_two_modes(cells), *_unloaded_end(plan, sheet, cells))


def notes(plan: Plan, sheet: DataSheet, cells: Sequence[ExpectedCell]) -> tuple[str, ...]:
    """Facts to know that spoil nothing.

    Parameters
    ----------
    plan, sheet, cells
        As in :func:`warnings`.

    Returns
    -------
    tuple of str
        Sentences.
    """
    sentences = _release(sheet, max(cells, key=lambda cell: cell.nut_load_ratio))
    missing = []
    if not plan.warm_up:
        missing.append("warm-up (warm_up)")
    if not plan.temperature:
        missing.append("temperature (temperature)")
    if missing:
        sentences.append(
            f"the plan has no {' and no '.join(missing)}: a screw a few kelvin warmer than its nut seems to "
            "have more preload, and a cold run after a warm one appears as a loss."
        )
    sentences += _rigidity(sheet) + _friction(plan, sheet) + _weight(plan, sheet) + _pretension(plan, sheet)
    sentences += _near_the_ends(plan, sheet) + _not_reached(plan)
    lowest = min(cell.frequency for cell in cells)
    for index, motion in enumerate(plan.motions):
        periods = motion.acceleration_time * lowest
        if SHORTEST <= periods < RINGING:
            sentences.append(
                f"between the two blows of motion {index} there are {periods:.1f} periods of the lowest "
                f"expected frequency; {RINGING:g} fill the window, {SHORTEST:g} are needed."
            )
    return tuple(sentences)


def _rigidity(sheet: DataSheet) -> list[str]:
    """What a rigidity of unknown convention and a spring mean for the results."""
    sentences = []
    if sheet.screw.rigidity_convention == "unknown":
        sentences.append(
            "the data sheet does not state what K means (screw.rigidity_convention): a range of nuts is "
            "assumed, and the interval of P/P₀ is half as wide again."
        )
    if sheet.screw.preload_by == "spring":
        sentences.append(
            "a nut preloaded by a spring loses contact at a load of P: every result will be suspect; keep "
            f"the load below {advised_ratio(sheet.screw):g} P."
        )
    return sentences


def _effective_spread(plan: Plan, motion: int, cells: Sequence[ExpectedCell]) -> float | None:
    """Smallest of a few jerk spreads that fills the nulls on the expected frequencies.

    Parameters
    ----------
    plan : Plan
        Plan with the repetitions over which the jerk is varied.
    motion : int
        Index of the motion.
    cells : sequence of ExpectedCell
        Cells of that motion.

    Returns
    -------
    float or None
        None if the plan has one repetition, or no spread suffices between stops so close.
    """
    modes = np.array(sorted({(cell.frequency, cell.standard_uncertainty) for cell in cells}))
    for spread in _SPREADS:
        motions = list(plan.motions)
        motions[motion] = replace(plan.motions[motion], jerk_spread=spread)
        runs = executed(replace(plan, motions=tuple(motions)), motion)
        if 2 * max(run.acceleration_distance for run in runs) > plan.smallest_gap:
            break
        if least_excitation(modes[:, 0], modes[:, 1], runs).min() >= EXCITED:
            return spread
    return None


def _rounded(value: float, digits: int, *, up: bool) -> float:
    """Number above 0 rounded to a few significant digits, up or down; others as they are."""
    if value <= 0:
        return value
    step = 10.0 ** (math.floor(math.log10(value)) - digits + 1)
    count = value / step
    slack = count * 1e-9
    whole = math.ceil(count - slack) if up else math.floor(count + slack)
    return float(f"{whole * step:.{digits + 1}g}")


def _release(sheet: DataSheet, hardest: ExpectedCell) -> list[str]:
    force, rating = abs(hardest.nut_load), sheet.screw.dynamic_load_rating
    release, limit = release_ratio(sheet.screw), advised_ratio(sheet.screw)
    if hardest.nut_load_ratio >= release:
        return []  # reported as a warning
    advised, released = force / limit, force / release
    first = ""
    if not _exceeds(hardest, limit):
        first = f"reaches {limit:g} P at {advised:.0f} N of preload ({advised / rating:.2%} of Ca) and "
    sentence = (
        f"as the preload falls, this plan's nut load of {force:.0f} N {first}unloads the nut "
        f"({release:.2f} P) at {released:.0f} N of preload ({released / rating:.2%} of Ca); below that the "
        "frequency no longer depends on the preload."
    )
    return [sentence]


def _two_modes(cells: Sequence[ExpectedCell]) -> list[str]:
    both = [cell for cell in cells if cell.second_frequency is not None]
    if not both:
        return []
    first = both[0]
    sentence = (
        f"{len(both)} of {len(cells)} cells have two axial modes, such as {first.frequency:.1f} and "
        f"{first.second_frequency:.1f} Hz at {first.position * 1e3:g} mm and {first.mass:g} kg: the table "
        "has nearly the same share of the energy in both, a run may show either, and the frequency may jump "
        "from stop to stop; choose stops or loads where one mode has most of the energy."
    )
    return [sentence]


def _exceeds(cell: ExpectedCell, ratio: float) -> bool:
    return cell.nut_load_ratio > ratio * (1 + _ROUNDING)


def _null(name: str, plan: Plan, index: int, cells: Sequence[ExpectedCell]) -> list[str]:
    motion = plan.motions[index]
    weak = [cell for cell in cells if cell.least_excitation < EXCITED]
    if not weak:
        return []
    worst = min(weak, key=lambda cell: cell.least_excitation)
    order = max(1, round(worst.frequency * motion.jerk_time))
    highest = max(cell.frequency + 2 * cell.standard_uncertainty for cell in cells)
    jerk = _rounded(_jerk(motion, highest), 3, up=True)
    spread = _effective_spread(plan, index, cells)
    alternative = ""
    if spread:
        alternative = f", and so does jerk_spread = {spread:g}, which moves the null between repetitions"
    sentence = (
        f"{name}: the torque has a null at {order / motion.jerk_time:.1f} Hz (jerk time "
        f"{motion.jerk_time * 1e3:.3g} ms), at or close to the expected natural frequency of {len(weak)} of "
        f"{len(cells)} cells, which are hardly excited, such as {worst.frequency:.1f} ± "
        f"{worst.standard_uncertainty:.1f} Hz at {worst.position * 1e3:g} mm; a jerk of {jerk:g} m/s^3 or "
        f"more (jerk time {500 / highest:.3g} ms) excites all of them{alternative}."
    )
    return [sentence]


def _jerk(motion: Motion, highest: float) -> float:
    """Jerk at which the jerk time is half a period of the highest frequency."""
    if motion.speed >= motion.acceleration / (2 * highest):
        return 2 * highest * motion.acceleration
    return 4 * highest**2 * motion.speed


def _unloaded(
    name: str, motion: Motion, sheet: DataSheet, cells: Sequence[ExpectedCell], gap: float
) -> list[str]:
    worst = max(cells, key=lambda cell: cell.nut_load_ratio)
    release, limit = release_ratio(sheet.screw), advised_ratio(sheet.screw)
    if not _exceeds(worst, limit):
        return []
    ratio, force = worst.nut_load_ratio, abs(worst.nut_load)
    advised = _acceleration(sheet, worst.mass, limit * worst.preload)
    remedy = f"{_constant_force(sheet, worst.mass)} more than {limit:g} P, so no acceleration helps"
    if advised > 0:
        speed = _speed(motion, advised, gap)
        remedy = f"an acceleration of {advised:g} m/s^2 or less{speed} keeps it below {limit:g} P"
    effect = f"softens the nut: the frequency is {-worst.nut_load_shift:.2f} Hz too low"
    if ratio >= release:
        effect = f"unloads the nut ({release:.2f} P): its frequency does not depend on the preload"
    sentence = (
        f"{name}: the nut load of {force:.0f} N at {worst.mass:g} kg ({worst.condition}) is {ratio:.2f} "
        f"times the {_which(sheet, worst)} of {worst.preload:.0f} N and {effect}; {remedy}."
    )
    return [sentence]


def _which(sheet: DataSheet, cell: ExpectedCell) -> str:
    return "nominal preload" if cell.preload == sheet.nominal_preload else "preload"


def _friction(plan: Plan, sheet: DataSheet) -> list[str]:
    if sheet.guide.friction is not None:
        return []
    force = float(guide_friction(sheet, max(plan.masses)))
    sentence = (
        f"{sheet.source} states no guide.friction: up to {force:.0f} N are assumed, "
        f"{FRICTION_COEFFICIENT:.0%} of the weight, and rolling guides have {force / 3:.0f} to "
        f"{3 * force:.0f} N; it is part of the nut load and of the torque. State the Coulomb friction of a "
        "run (ballscrew analyze), or that of sliding guides, which is higher."
    )
    return [sentence]


def _acceleration(sheet: DataSheet, mass: float, force: float) -> float:
    """Acceleration with which the nut load stays below a force, rounded down; 0 or less if none does."""
    weight = abs(float(weight_on_nut(sheet, mass)))
    remaining = force - weight - float(guide_friction(sheet, mass))
    return _rounded(remaining / (sheet.table.mass + mass), 2, up=False)


def _constant_force(sheet: DataSheet, mass: float) -> str:
    """Constant forces on the nut in words, with their verb."""
    weight, friction = abs(float(weight_on_nut(sheet, mass))), float(guide_friction(sheet, mass))
    if not weight:
        return "the guides' friction alone is"
    return f"the weight ({weight:.0f} N) and the guides' friction ({friction:.0f} N) alone are"


def _speed(motion: Motion, acceleration: float, gap: float) -> str:
    """Speed that goes with a lower acceleration, in words, where the stops are too close for the plan's."""
    slower = replace(motion, acceleration=acceleration)
    if 2 * slower.acceleration_distance <= gap:
        return ""
    # To reach a speed and stop again takes v (v / a + a / j). The motion reaches a higher acceleration within
    # the gap, so the lower one is reached at this speed too.
    rise = acceleration / motion.jerk
    speed = acceleration / 2 * (math.sqrt(rise**2 + 4 * gap / acceleration) - rise)
    return f" at {_rounded(1e3 * speed, 3, up=False):g} mm/s or less (the stops are {gap * 1e3:g} mm apart)"


def _too_short(name: str, motion: Motion, cells: Sequence[ExpectedCell], gap: float) -> list[str]:
    """Sentences on a dwell or an acceleration that is too short for the lowest expected frequency."""
    lowest = min(cell.frequency for cell in cells)
    sentences = []
    needed = (RINGING + QUIET) / lowest
    if motion.dwell < needed * (1 - _ROUNDING):
        sentences.append(
            f"{name}: the dwell of {motion.dwell * 1e3:.3g} ms lasts {motion.dwell * lowest:.1f} periods of "
            f"the lowest expected frequency ({lowest:.1f} Hz), so the ringing is cut off; "
            f"{RINGING:g} after one move and {QUIET:g} before the next need "
            f"{_rounded(1e3 * needed, 3, up=True):g} ms or more."
        )
    periods = motion.acceleration_time * lowest
    if periods < SHORTEST:
        remedy = _longer(motion, SHORTEST / lowest, gap)
        sentences.append(
            f"{name}: an acceleration takes {motion.acceleration_time * 1e3:.3g} ms, {periods:.1f} periods "
            f"of the lowest expected frequency ({lowest:.1f} Hz); {SHORTEST:g} are needed between its two "
            f"blows: {remedy}."
        )
    return sentences


def _longer(motion: Motion, time: float, gap: float) -> str:
    """Change that makes an acceleration take a time, in words."""
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
        "allow no more"
    )


def _weight(plan: Plan, sheet: DataSheet) -> list[str]:
    """Sentence on the weight of an axis that is not horizontal."""
    weight = max((float(weight_on_nut(sheet, mass)) for mass in plan.masses), key=abs)
    if not weight:
        return []
    which, preload = "nominal", sheet.nominal_preload
    if plan.preloads:
        which, preload = "lowest", min(plan.preloads)
    sentence = (
        f"the weight of table and load acts on the nut at all times: {abs(weight):.0f} N, "
        f"{abs(weight) / preload:.2f} times the {which} preload; the nut load of every cell "
        "includes it."
    )
    return [sentence]


def _pretension(plan: Plan, sheet: DataSheet) -> list[str]:
    """Sentence on what uses up the pretension of a screw fixed at both ends."""
    reserve = pretension_reserve(sheet, plan.positions)
    if reserve is None:
        return []
    load, warmer = reserve
    sentence = (
        f"the screw's pretension of {sheet.bearing.pretension:.0f} N is used up by a nut load of "
        f"{load:.0f} N or by a screw {warmer:.1f} K warmer than the bed: an end that has lost it no longer "
        "pulls, and the frequency falls as if preload were lost."
    )
    return [sentence]


def _unloaded_end(plan: Plan, sheet: DataSheet, cells: Sequence[ExpectedCell]) -> list[str]:
    """Sentence on a nut load that uses up the pretension."""
    reserve = pretension_reserve(sheet, plan.positions)
    worst = max(cells, key=lambda cell: abs(cell.nut_load))
    if reserve is None or not abs(worst.nut_load) > reserve[0]:
        return []
    advised = _acceleration(sheet, worst.mass, reserve[0])
    remedy = f"{_constant_force(sheet, worst.mass)} more, so no acceleration helps: stretch the screw further"
    if advised > 0:
        remedy = f"an acceleration of {advised:g} m/s^2 or less, or more pretension, keeps both ends pulling"
    sentence = (
        f"the nut load of {abs(worst.nut_load):.0f} N at {worst.mass:g} kg ({worst.condition}) unloads an "
        f"end of the screw: its pretension of {sheet.bearing.pretension:.0f} N is used up by "
        f"{reserve[0]:.0f} N. The frequency falls as if preload were lost, and the run will be suspect; "
        f"{remedy}."
    )
    return [sentence]


def _near_the_ends(plan: Plan, sheet: DataSheet) -> list[str]:
    """Sentences on stops close to an end of the screw; nuts are three to five diameters long."""
    first, last = plan.positions[0], plan.positions[-1]
    ends = (
        ("thrust bearing", first, first + sheet.screw.bearing_to_zero),
        ("screw's far end", last, sheet.travel_limit - last),
    )
    sentences = []
    for end, stop, distance in ends:
        if distance < _HALF_NUT * sheet.screw.nominal_diameter:
            sentences.append(
                f"the stop at {1e3 * stop:g} mm is {round(1e3 * distance, 1) + 0.0:g} mm from the {end}; the "
                "length of the nut is not known here: check that it has room, and state the soft limits."
            )
    return sentences


def _not_reached(plan: Plan) -> list[str]:
    sentences = []
    for index, motion in enumerate(plan.motions):
        if not motion.reaches_acceleration:
            sentences.append(
                f"motion {index} asks for {motion.acceleration:.3g} m/s^2, and reaches "
                f"{motion.peak_acceleration:.3g} m/s^2: its speed is too low for its jerk."
            )
    return sentences
