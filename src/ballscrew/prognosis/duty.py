"""Duty of an axis by the counters of its machine: revolutions of the screw, hours of operation, or both.

A counter gives the duty up to each day of an epoch, past and ahead, so that wear can be followed in it and
the remaining life stated in it. Rows after the newest run are planned duty; after the last row the duty
continues at its mean over the last 30 days of the file.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

import numpy as np

from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError, shown
from ballscrew.base.files import decode, read_whole
from ballscrew.base.words import plural
from ballscrew.monitoring.epochs import moment

COUNTERS = ("revolutions", "hours")
"""Columns of a duty file beside ``date``: readings of counters since any start, never falling."""

_RECENT = 30.0  # days whose mean continues: a month has every shift
_GAP = 7.0  # days without a reading before the first run and after the last: a reading a week
_DAY = 86_400.0  # s
_LARGEST = 50_000_000  # bytes of a file
_MOST_ROWS = 100_000  # 270 years of days; a recording given by mistake has more
_Rows = list[tuple[int, dict[str, str]]]
_MOST_HOURS = 24.0 * (1 + 1e-9)


@dataclass(frozen=True, slots=True, eq=False)
class DutyRecord:
    """Readings of the counters of a machine.

    Parameters
    ----------
    times : ndarray, shape (n,)
        Days since 1970, ascending; UTC.
    counters : mapping of str to ndarray, shape (n,)
        Readings by name, of :data:`COUNTERS`.
    source : str
        Name of the file, for messages.
    """

    times: Array
    counters: Mapping[str, Array]
    source: str = "the duty"

    def of_epoch(self, first: datetime, last: datetime) -> dict[str, EpochDuty]:
        """Duty of an epoch from its first to its last run.

        Parameters
        ----------
        first, last : datetime
            Times of the runs.

        Returns
        -------
        dict of str to EpochDuty
            By name of the counter; day 0 is that of the first run. Empty where all runs are at one time.

        Raises
        ------
        InputError
            If the readings do not cover the runs, or a counter stands still between them.
        """
        start, end = first.timestamp() / _DAY, last.timestamp() / _DAY
        if self.times[0] > start + _GAP or self.times[-1] < end - _GAP:
            raise InputError(
                f"{self.source}: has the duty from {_date(self.times[0])} to {_date(self.times[-1])}, and "
                f"the runs of the epoch are from {_date(start)} to {_date(end)}; it must cover them to "
                f"within {_GAP:g} days."
            )
        duties: dict[str, EpochDuty] = {}
        if not end > start:
            return duties
        for name, values in self.counters.items():
            duty = EpochDuty(self.times - start, values, end - start)
            if not duty.per_day > 0:
                raise InputError(
                    f"{self.source}: {name} does not rise from {_date(start)} to {_date(end)}, between the "
                    "first and the last run of the epoch; leave out a counter that does not count."
                )
            duties[name] = duty
        return duties


@dataclass(frozen=True, slots=True, eq=False)
class EpochDuty:
    """One counter over the days of an epoch.

    Parameters
    ----------
    days : ndarray, shape (n,)
        Days of the epoch, ascending; 0 is its first run.
    values : ndarray, shape (n,)
        Readings.
    last : float
        Day of the last run.
    """

    days: Array
    values: Array
    last: float

    @property
    def per_day(self) -> float:
        """Mean duty of a day from the first to the last run."""
        first, last = self.up_to(np.array([0.0, self.last])).tolist()
        return float((last - first) / self.last)

    @property
    def ahead_per_day(self) -> float:
        """Duty of a day after the last reading: the mean of the last 30 days."""
        start = max(self.days[-1] - _RECENT, self.days[0])
        before = np.interp(start, self.days, self.values)
        return float((self.values[-1] - before) / (self.days[-1] - start))

    def up_to(self, days: Array) -> Array:
        """Reading on some days: linear between two readings, and beyond them at the mean of a day."""
        inside = np.interp(days, self.days, self.values)
        whole = (self.values[-1] - self.values[0]) / (self.days[-1] - self.days[0])
        before = np.minimum(days - self.days[0], 0.0) * whole
        after = np.maximum(days - self.days[-1], 0.0) * self.ahead_per_day
        return np.asarray(inside + before + after)

    def average_days(self, days: Array) -> Array:
        """Duty since the first run up to some days, as that of so many average days."""
        return np.asarray((self.up_to(days) - self.up_to(np.zeros(1))) / self.per_day)

    def remaining(self, at: float, days: float) -> float:
        """Duty of so many days after a day."""
        now, then = self.up_to(np.array([at, at + days])).tolist()
        return float(then - now)


def read_duty(path: str | Path) -> DutyRecord:
    """Read the duty of an axis from a CSV file.

    Parameters
    ----------
    path : path-like
        A heading with ``date`` (ISO 8601, UTC where it names no zone) and ``revolutions`` of the screw,
        ``hours`` of operation, or both; further columns are ignored. A row per reading, by ascending date.
        The counters are cumulative, from any start.

    Returns
    -------
    DutyRecord
        Two readings or more.

    Raises
    ------
    InputError
        If the file cannot be read, a column or a value is missing, dates do not ascend, or a counter is
        negative, falls, or counts more than 24 hours a day.
    """
    source = Path(path).name
    heading, rows = _rows(path, source)
    names = [name for name in COUNTERS if name in heading]
    if "date" not in heading or not names:
        raise InputError(
            f"{source}: has the columns {shown(', '.join(heading))}; it must have date, and revolutions or "
            "hours."
        )
    times = _times(rows, source)
    counters = {name: _counter(name, rows, source) for name in names}
    if "hours" in counters:
        _check_hours(times, counters["hours"], [line for line, _ in rows], source)
    return DutyRecord(times, counters, source)


def _lines(path: str | Path, source: str) -> list[str]:
    try:
        text = decode(read_whole(path, _LARGEST))
    except UnicodeDecodeError:
        raise InputError(f"{path}: is not text in UTF-8; a duty is a CSV file.") from None
    except InputError as error:
        text = str(error).removesuffix(".")
        raise InputError(f"{text}; a duty is a CSV file or a travel per day.") from None
    lines = text.splitlines()
    if len(lines) > _MOST_ROWS:
        raise InputError(f"{source}: has {len(lines)} lines; a duty has {_MOST_ROWS} or fewer.")
    return lines


def _times(rows: _Rows, source: str) -> Array:
    """Ascending days since 1970."""
    times: list[float] = []
    for line, row in rows:
        time = moment(row.get("date", ""), f"{source}: date in line {line}").timestamp() / _DAY
        if times and time <= times[-1]:
            raise InputError(f"{source}: the date in line {line} is not after the one before; sort the rows.")
        times.append(time)
    return np.array(times)


def _rows(path: str | Path, source: str) -> tuple[list[str], _Rows]:
    """Heading, and the rows with the numbers of their lines."""
    lines = _lines(path, source)
    delimiter = ";" if lines and ";" in lines[0] else ","
    table = csv.reader(lines, delimiter=delimiter, skipinitialspace=True)
    try:
        heading = [name.strip().lower() for name in next(table, [])]
        rows = [(table.line_num, cells) for cells in table if any(map(str.strip, cells))]
    except csv.Error as error:
        raise InputError(f"{source}: line {table.line_num} is no CSV ({error}).") from None
    if len(set(heading)) < len(heading):
        raise InputError(f"{source}: two columns have the same name; each must have its own.")
    if len(rows) < 2:
        raise InputError(
            f"{source}: has {plural(len(rows), 'reading')} below its heading; it must have two or more."
        )
    return heading, [(line, dict(zip(heading, map(str.strip, cells), strict=False))) for line, cells in rows]


def _counter(name: str, rows: _Rows, source: str) -> Array:
    values: list[float] = []
    for line, row in rows:
        text = row.get(name, "")
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not 0 <= value < math.inf:
            raise InputError(
                f"{source}: {name} in line {line} is {shown(text)}; it must be a number, 0 or more."
            )
        if values and value < values[-1]:
            raise InputError(
                f"{source}: {name} falls from {values[-1]:g} to {value:g} in line {line}; the counter must "
                "never fall: add the earlier count after a reset, and sum up a duty per day."
            )
        values.append(value)
    return np.array(values)


def _check_hours(times: Array, hours: Array, lines: list[int], source: str) -> None:
    """Refuse more than 24 hours a day."""
    fast = np.flatnonzero(np.diff(hours) > _MOST_HOURS * np.diff(times) + 1e-6)
    if len(fast):
        raise InputError(
            f"{source}: hours rise by {np.diff(hours)[fast[0]]:g} up to line {lines[fast[0] + 1]}, in "
            f"{24 * np.diff(times)[fast[0]]:.4g} hours of time; look at unit and date."
        )


def _date(day: float) -> str:
    return str(np.datetime64(math.floor(day), "D"))
