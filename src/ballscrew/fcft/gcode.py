"""A plan as a program for a numerical controller (ISO 6983, "G-code"), and a slow dry run beside it."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Literal

from ballscrew.axis.sheet import DataSheet
from ballscrew.base.errors import InputError
from ballscrew.base.files import write_texts
from ballscrew.fcft.dialect import GcodeDialect, find_dialect
from ballscrew.fcft.limits import require_safe
from ballscrew.fcft.plan import Plan
from ballscrew.fcft.profile import route
from ballscrew.fcft.program_header import header
from ballscrew.fcft.schedule import settings_change, trips

__all__ = ["dry_run_path", "gcode", "write_gcode"]

_DIGITS = 4  # of a millimetre: 0.1 µm
_SLOW_PART = 0.1
_SLOW_MOST = 0.020
_PAUSE = 0.2
_NUMBER, _DRY_NUMBER = 1000, 1001
_MOST_BLOCKS = 1_000_000


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
    stops = [_position(stop) for stop in plan.positions]
    if any(a == b for a, b in pairwise(stops)):
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
    remarks = tuple(header(plan, sheet, dry_run, slow, maker.dwell_unit))
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
    write_texts((file, (f"{line}\n" for line in lines)) for file, lines in ((beside, dry), (path, program)))
    return path, beside


def _program(
    plan: Plan, maker: GcodeDialect, word: str, remarks: tuple[str, ...], slow: float, dry_run: bool
) -> Iterator[str]:
    number = _DRY_NUMBER if dry_run else _NUMBER
    yield from (line.format(number=number) for line in maker.opening)
    for text in remarks:
        yield from maker.remarks(text)
    yield from maker.modes
    yield from maker.remarks("to the first stop, slowly")
    yield _move(word, plan.positions[0], slow)
    yield from _dry_trip(plan, maker, word, slow) if dry_run else _trips(plan, maker, word)
    yield from (line.format(number=number) for line in maker.closing)


def _dry_trip(plan: Plan, maker: GcodeDialect, word: str, slow: float) -> Iterator[str]:
    yield maker.dwells(_PAUSE)
    for position in route(plan)[1:]:
        yield _move(word, position, slow)
        yield maker.dwells(_PAUSE)


def _trips(plan: Plan, maker: GcodeDialect, word: str) -> Iterator[str]:
    order = trips(plan)
    for index, trip in enumerate(order):
        motion = trip.executed
        kind = f"repetition {trip.repetition}" if trip.repetition else "warm-up"
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
