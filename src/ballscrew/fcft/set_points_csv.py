"""A plan as a table of set-points, for a drive that follows a table, and for a look at the test."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from ballscrew._version import __version__
from ballscrew.axis.sheet import DataSheet
from ballscrew.base.errors import InputError, shown
from ballscrew.base.files import write_texts
from ballscrew.base.provenance import digest
from ballscrew.fcft.limits import require_safe
from ballscrew.fcft.plan import Plan
from ballscrew.fcft.profile import profile, set_points
from ballscrew.fcft.schedule import duration, trips

_LEAST_RATE, _MOST_RATE = 1.0, 1e5
_MOST_ROWS = 20_000_000
_BLOCK = 1 << 16
_ROUNDING = 1e-6  # of a sample
_COLUMNS = (
    "trip", "repetition", "motion", "time_s", "position_m", "speed_m_per_s", "acceleration_m_per_s2"
)  # fmt: skip


def check_rate(rate: float) -> float:
    """Give a rate of set-points back, Hz, or raise InputError where it is impossible."""
    if isinstance(rate, bool) or not isinstance(rate, (int, float)) or not _LEAST_RATE <= rate <= _MOST_RATE:
        raise InputError(
            f"the rate is {shown(rate)} Hz; it must be {_LEAST_RATE:g} Hz or more "
            f"and {_MOST_RATE:g} Hz or less."
        )
    return rate


def write_set_points(plan: Plan, sheet: DataSheet, path: str | Path, *, rate: float = 1000.0) -> Path:
    """Write the set-points of a whole test with one load as CSV.

    The time runs on through all trips, without a break between them.

    Parameters
    ----------
    plan : Plan
        The test.
    sheet : DataSheet
        The axis, with its limits.
    path : path-like
        The file; one of that name is replaced.
    rate : float
        Set-points per second, 1 to 100 000 Hz.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    InputError
        If the plan may not be run on this axis, the rate is impossible or gives more than 20 million rows, or
        the file cannot be written.
    """
    path = Path(path)
    rate = check_rate(rate)
    require_safe(plan, sheet)
    rows = duration(plan) * rate
    if rows > _MOST_ROWS:
        raise InputError(
            f"{plan.source}: at {rate:g} Hz the test has {rows:.3g} set-points; "
            f"they must be {_MOST_ROWS} or fewer, so the rate must be lower."
        )
    write_texts([(path, _lines(plan, sheet, rate))])
    return path


def _lines(plan: Plan, sheet: DataSheet, rate: float) -> Iterator[str]:
    # No name of a file or an axis: a reader of tables looks for rates and dates in these lines.
    yield f"# sample rate: {rate:.10g} Hz\n"
    yield f"# set-points of a fixed cycle feature test, ballscrew {__version__}\n"
    yield f"# plan {digest(plan.to_settings())}\n# axis {digest(sheet.to_settings())}\n"
    yield "# trips count from 1, motions from 0; repetition 0 is a warm-up\n"
    yield ",".join(_COLUMNS) + "\n"
    order = trips(plan)
    start, first = 0.0, 0
    for index, trip in enumerate(order):
        motion = profile(plan, trip.executed)
        # To the same sum as `duration`, so that no sample is lost or written twice where trips meet.
        stop = start + motion.duration
        last = math.ceil(stop * rate - _ROUNDING) + (index == len(order) - 1)
        label = f"{index + 1},{trip.repetition},{trip.motion}"
        for begin in range(first, last, _BLOCK):
            time = np.arange(begin, min(begin + _BLOCK, last)) / rate
            points = set_points(motion, time - start)
            table = [time, points.position, points.speed, points.acceleration]
            # + 0.0 turns -0.0 into 0.0.
            columns = [(np.round(column, 9) + 0.0).tolist() for column in table]
            yield "".join(
                f"{label},{t:.9f},{x:.9f},{v:.9f},{a:.9f}\n" for t, x, v, a in zip(*columns, strict=True)
            )
        start, first = stop, last
