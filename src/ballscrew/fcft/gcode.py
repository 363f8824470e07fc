"""A plan as a program for a numerical controller (ISO 6983, "G-code"), and a slow dry run beside it."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Literal

from ballscrew._version import __version__
from ballscrew.axis.rigidity import at_preload
from ballscrew.axis.sheet import DataSheet
from ballscrew.base.errors import InputError
from ballscrew.base.files import write_texts
from ballscrew.fcft.conditions import Condition
from ballscrew.fcft.dialect import GcodeDialect, find_dialect
from ballscrew.fcft.limits import require_safe, required_torque
from ballscrew.fcft.nutload import hardest, nut_load
from ballscrew.fcft.plan import Plan
from ballscrew.fcft.profile import route
from ballscrew.fcft.schedule import duration, settings_change, settings_changes, trips

_DIGITS = 4  # of a millimetre: 0.1 µm
_SLOW_PART = 0.1
_SLOW_MOST = 0.020
_PAUSE = 0.2
_NUMBER, _DRY_NUMBER = 1000, 1001
_MOST_BLOCKS = 1_000_000
_LONGEST_NAME = 60


def gcode(
    plan: Plan,
    sheet: DataSheet,
    *,
    dialect: Literal["iso", "fanuc", "siemens"] = "iso",
    axis_word: str = "X",
    dry_run: bool = False,
) -> Iterator[str]:
    """Program of a whole test with one load.

    It goes to the first stop slowly. Each trip then begins and ends with the standstill there, so that the
    program takes as long as :func:`~ballscrew.fcft.schedule.duration` says. A trip that needs another
    acceleration or jerk than the one before begins with a programmed stop (M0), since only the operator can
    set them.

    Parameters
    ----------
    plan : Plan
        The test.
    sheet : DataSheet
        The axis, with its limits.
    dialect : {"iso", "fanuc", "siemens"}
        How the controller's maker writes a dwell (G4 P in seconds, P in milliseconds, F in seconds), comments
        and units.
    axis_word : str
        The axis's address in the controller.
    dry_run : bool
        One round trip over all stops at a tenth of the slowest motion's speed, 20 mm/s at most.

    Returns
    -------
    iterator of str
        Lines in ASCII, without their ends.

    Raises
    ------
    InputError
        If the plan may not be run on this axis, or dialect or axis word are not known.
    """
    maker = find_dialect(dialect)
    word = maker.axis_word(axis_word)
    require_safe(plan, sheet)
    if len(set(map(_position, plan.positions))) < len(plan.positions):
        raise InputError(
            f"{plan.source}: positions has stops less than 0.1 um apart, too close for a program."
        )
    count = 2 * len(trips(plan)) * len(route(plan))
    if count > _MOST_BLOCKS:
        raise InputError(
            f"{plan.source}: positions and repetitions make a program of {count} blocks; "
            f"they must make {_MOST_BLOCKS} or fewer."
        )
    slow = min(_SLOW_MOST, _SLOW_PART * min(motion.speed for motion in plan.motions))
    remarks = tuple(_header(plan, sheet, dry_run, slow, maker.dwell_unit))
    return _program(plan, maker, word, remarks, slow, dry_run)


def write_gcode(
    plan: Plan,
    sheet: DataSheet,
    path: str | Path,
    *,
    dialect: Literal["iso", "fanuc", "siemens"] = "iso",
    axis_word: str = "X",
) -> tuple[Path, Path]:
    """Write the program and beside it its dry run; neither is written unless the plan is safe.

    Parameters
    ----------
    plan, sheet, dialect, axis_word
        As in :func:`gcode`.
    path : path-like
        The program; files of these names are replaced.

    Returns
    -------
    program, dry_run : Path
        ``path``, and ``NAME-dry-run.SUFFIX`` beside it.

    Raises
    ------
    InputError
        As :func:`gcode`; or if a file cannot be written.
    """
    path = Path(path)
    if not path.name:
        raise InputError(f"{path}: is a folder; it must be the name of a file.")
    beside = dry_run_path(path)
    program = gcode(plan, sheet, dialect=dialect, axis_word=axis_word)
    dry = gcode(plan, sheet, dialect=dialect, axis_word=axis_word, dry_run=True)
    end_line = "{}\n".format
    write_texts(((beside, map(end_line, dry)), (path, map(end_line, program))))
    return path, beside


def _program(
    plan: Plan, maker: GcodeDialect, word: str, remarks: tuple[str, ...], slow: float, dry_run: bool
) -> Iterator[str]:
    if dry_run:
        number, moves = _DRY_NUMBER, _dry_trip(plan, maker, word, slow)
    else:
        number, moves = _NUMBER, _trips(plan, maker, word)
    for line in maker.opening:
        yield line.format(number=number)
    for text in remarks:
        yield from maker.remarks(text)
    yield from maker.modes
    yield from maker.remarks("to the first stop, slowly")
    yield _move(word, plan.positions[0], slow)
    yield from moves
    for line in maker.closing:
        yield line.format(number=number)


def _dry_trip(plan: Plan, maker: GcodeDialect, word: str, slow: float) -> Iterator[str]:
    yield maker.dwells(_PAUSE)
    for position in route(plan)[1:]:
        yield _move(word, position, slow)
        yield maker.dwells(_PAUSE)


def _trips(plan: Plan, maker: GcodeDialect, word: str) -> Iterator[str]:
    order = trips(plan)
    for index, trip in enumerate(order):
        motion = trip.executed
        kind = "warm-up"
        if trip.repetition:
            kind = f"repetition {trip.repetition}"
        yield from maker.remarks(
            f"trip {index + 1} of {len(order)}, {kind}, motion {trip.motion}: "
            f"acceleration {motion.acceleration:.4g} m/s2, jerk {motion.jerk:.5g} m/s3"
        )
        if index and settings_change(order[index - 1].executed, motion):
            yield from maker.remarks("set acceleration and jerk to these in the controller, then start again")
            yield "M0"
        yield maker.dwells(motion.dwell)
        for position in route(plan)[1:]:
            yield _move(word, position, motion.speed)
            yield maker.dwells(motion.dwell)


def _move(word: str, position: float, speed: float) -> str:
    # A decimal point always: without one Fanuc reads micrometres.
    return f"G1 {word}{_position(position)} F{60_000 * speed:.3f}"


def _position(position: float) -> str:
    return f"{round(1000 * position, _DIGITS) + 0.0:.{_DIGITS}f}"


def dry_run_path(path: Path) -> Path:
    """Path of a program's dry run: NAME-dry-run.SUFFIX beside it."""
    return path.with_name(f"{path.stem}-dry-run{path.suffix}")


def _header(plan: Plan, sheet: DataSheet, dry_run: bool, slow: float, unit: str) -> Iterator[str]:
    """Lines that inform the operator: the program, what was checked, and the state that it needs."""
    test = "fixed cycle feature test"
    if dry_run:
        test = f"DRY RUN of a {test}"
    yield f"ballscrew {__version__}: {test}"
    yield f"axis: {_short(sheet.name)}, data sheet {_short(sheet.source)}"
    yield f"plan: {_short(plan.source)}"
    gap = plan.smallest_gap
    yield (
        f"stops: {len(plan.positions)}, from {_mm(plan.positions[0])} to {_mm(plan.positions[-1])} mm, "
        f"{_mm(gap)} mm apart or more, up and back"
    )
    if dry_run:
        yield from _dry_header(plan, slow)
    else:
        yield from _measuring_header(plan, sheet)
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


def _dry_header(plan: Plan, slow: float) -> Iterator[str]:
    distance = 2 * (plan.positions[-1] - plan.positions[0])
    yield (
        f"One round trip over all stops at {1000 * slow:.3g} mm/s, about {distance / slow:.0f} s, to check "
        "that nothing is in the way. It is not measured."
    )


def _measuring_header(plan: Plan, sheet: DataSheet) -> Iterator[str]:
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
    loads = ", ".join(map("{:g}".format, plan.masses)) + " kg"
    if len(plan.masses) > 1:
        loads += ", one run for each"
    yield f"load on the table: {loads}"
    if plan.preloads:
        preloads = ", ".join(map("{:g}".format, plan.preloads))
        yield f"preload of the nut: {preloads} N, each with every load"
        sheet = at_preload(sheet, max(plan.preloads))
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
        if value is None:
            missing.append(name)
        else:
            checked.append(name)
    yield f"checked: {', '.join(checked)}"
    if missing:
        yield f"NOT CHECKED, for the data sheet does not state it: {', '.join(missing)}"


def _short(text: str) -> str:
    return text[:_LONGEST_NAME]


def _mm(position: float) -> str:
    return f"{round(1000 * position, 4) + 0.0:g}"
