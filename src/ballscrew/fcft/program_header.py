"""Header of a controller program, which informs the operator."""

from __future__ import annotations

from collections.abc import Iterator

from ballscrew._version import __version__
from ballscrew.axis.sheet import DataSheet
from ballscrew.fcft.conditions import Condition
from ballscrew.fcft.limits import required_torque
from ballscrew.fcft.nutload import hardest, nut_load
from ballscrew.fcft.plan import Plan
from ballscrew.fcft.schedule import duration, settings_changes, trips

__all__ = ["header"]

_LONGEST_NAME = 60


def header(plan: Plan, sheet: DataSheet, dry_run: bool, slow: float, unit: str) -> Iterator[str]:
    """Say what the program does and what was checked.

    Parameters
    ----------
    plan : Plan
        The test.
    sheet : DataSheet
        The axis.
    dry_run : bool
        Whether it is the dry run.
    slow : float
        Speed of the dry run and of the way to the first stop, m/s.
    unit : str
        What the block of a dwell stands for, in words.

    Yields
    ------
    str
        Lines of the header; names of files and of the axis as given.
    """
    prefix = "DRY RUN of a " if dry_run else ""
    yield f"ballscrew {__version__}: {prefix}fixed cycle feature test"
    yield f"axis: {_short(sheet.name)}, data sheet {_short(sheet.source)}"
    yield f"plan: {_short(plan.source)}"
    gap = plan.smallest_gap
    yield (
        f"stops: {len(plan.positions)}, from {_mm(plan.positions[0])} to {_mm(plan.positions[-1])} mm, "
        f"{_mm(gap)} mm apart or more, up and back"
    )
    if dry_run:
        yield from _dry(plan, slow)
    else:
        yield from _real(plan, sheet)
    yield from _checks(sheet)
    yield (
        "Before the start: home the axis, clear the way, and switch work offset, tool offset, scaling and "
        "mirroring off, for positions are those of the axis."
    )
    yield (
        "The next blocks stand for millimetres, absolute positions, feed in mm/min and exact stop, and "
        f"{unit}: check that they do in this controller. Made for a linear axis of a milling system: on a "
        "lathe, U and W may be incremental, G90 and G94 turning cycles, and X a diameter."
    )


def _dry(plan: Plan, slow: float) -> Iterator[str]:
    way = 2 * (plan.positions[-1] - plan.positions[0])
    yield (
        f"One round trip over all stops at {1000 * slow:.3g} mm/s, about {way / slow:.0f} s, to check that "
        "nothing is in the way. It is not measured."
    )


def _real(plan: Plan, sheet: DataSheet) -> Iterator[str]:
    order = trips(plan)
    for index, motion in enumerate(plan.motions):
        yield (
            f"motion {index}: speed {1000 * motion.speed:.4g} mm/s, "
            f"acceleration {motion.acceleration:.4g} m/s2, jerk {motion.jerk:.5g} m/s3, "
            f"dwell {motion.dwell:.4g} s"
        )
    yield (
        "ACCELERATION AND JERK cannot be set in ISO 6983: set them in the controller first. With "
        "other values this is another test."
    )
    yield from _variation(plan)
    warm_up = f"the first {plan.warm_up} to warm up" if plan.warm_up else "no warm-up"
    yield f"trips: {len(order)} round trips, {warm_up}"
    loads = ", ".join(f"{mass:g}" for mass in plan.masses)
    yield f"load on the table: {loads} kg" + (", one run for each" if len(plan.masses) > 1 else "")
    yield f"time of one run: {duration(plan):.1f} s, from the first stop"
    load = max(plan.masses)
    motion = hardest([trip.executed for trip in order])
    torque = required_torque(sheet, motion, load)
    force = nut_load(sheet, motion, load, Condition.PA)
    yield (
        f"at most, with {load:g} kg: nut load {force:.0f} N, "
        f"motor torque {torque:.3g} N m at a preload of {sheet.nominal_preload:.0f} N"
    )
    if plan.temperature:
        yield "TEMPERATURE: the plan asks for it. Note that of the nut or the screw with each run."
    yield "RUN THE DRY RUN FIRST. Set all overrides to 100 percent after it."


def _variation(plan: Plan) -> Iterator[str]:
    count = settings_changes(plan)
    if count:
        yield (
            f"Acceleration or jerk change {count} times: the program stops with M0 before each trip that "
            "needs the controller set anew, and the comment above says to what."
        )
    if any(motion.start_spread for motion in plan.motions):
        yield "The dwell is varied between repetitions, in the program itself."


def _checks(sheet: DataSheet) -> Iterator[str]:
    limits = sheet.limits
    stated = {
        "lower soft limit": limits.lowest_position,
        "upper soft limit": limits.highest_position,
        "speed": limits.speed,
        "torque": limits.torque,
    }
    checked = ["travel of the screw, without the length of the nut"]
    missing: list[str] = []
    for name, value in stated.items():
        (missing if value is None else checked).append(name)
    yield f"checked: {', '.join(checked)}"
    if missing:
        yield f"NOT CHECKED, for the data sheet does not state it: {', '.join(missing)}"


def _short(text: str) -> str:
    return text[:_LONGEST_NAME]


def _mm(position: float) -> str:
    return f"{round(1000 * position, 4) + 0.0:g}"
