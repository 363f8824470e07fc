"""When runs of an axis are expected: shifts on working days, and waits that are counted in them."""

from __future__ import annotations

import re
from bisect import bisect_left
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, date, datetime, time, timedelta, tzinfo
from functools import lru_cache
from typing import Any, Literal, get_args
from zoneinfo import ZoneInfo, ZoneInfoNotFoundError

from ballscrew.base.errors import shown
from ballscrew.store.service_tables import Setup

Weekday = Literal["Mon", "Tue", "Wed", "Thu", "Fri", "Sat", "Sun"]
DAYS: tuple[Weekday, ...] = get_args(Weekday)

CALENDAR = ("working_days", "holidays", "time_zone", "shifts")
"""Names of the values of a calendar in settings and documents."""

LONGEST_WAIT = timedelta(days=36_525)
"""A wait ends after this time, also where fewer hours were worked."""

_SHIFT = re.compile(r"([01][0-9]|2[0-3]):([0-5][0-9])-([01][0-9]|2[0-3]|24(?=:00)):([0-5][0-9])")
_DAY_MIN = 24 * 60
_WHOLE_DAY = ((0, _DAY_MIN),)
_YEAR_D = 365
_WEEK = timedelta(weeks=1)
_RESOLUTION = timedelta(microseconds=1)

Spans = tuple[tuple[datetime, datetime], ...]


@dataclass(frozen=True)
class RunCalendar:
    """Times at which runs are expected.

    Parameters
    ----------
    weekdays : tuple of int
        Of these, Monday is 0; at least one.
    holidays : frozenset of date
        Days on which none are expected besides.
    zone : tzinfo
        Time zone of these days.
    shifts : tuple of pairs of int
        Begin and end of each shift, in minutes since the midnight before it begins, by time; without any,
        the whole day. One that passes midnight belongs to the day on which it begins.
    """

    weekdays: tuple[int, ...] = tuple(range(7))
    holidays: frozenset[date] = frozenset()
    zone: tzinfo = UTC
    shifts: tuple[tuple[int, int], ...] = ()

    def after(self, begin: datetime, wait: timedelta) -> datetime:
        """Last time until which no more than a wait was worked since ``begin``, UTC.

        Shifts are counted by absolute time, also where clocks change; at most :data:`LONGEST_WAIT`.
        """
        begin = begin.astimezone(UTC)
        if self._is_always:
            return begin + wait
        end = begin + LONGEST_WAIT
        day = begin.astimezone(self.zone).date() - timedelta(days=1)  # whose last shift may pass midnight
        monday = _monday(day)
        while monday <= end.date():
            spans, total = _week(self, monday)
            if spans and begin <= spans[0][0] and total <= wait:
                count = min(_weeks_alike(self, monday), wait // total)
                wait -= count * total
                monday += count * _WEEK
                continue
            for start, stop in spans:
                if begin < stop:
                    first = max(start, begin)
                    if wait < stop - first:
                        return min(first + wait, end)
                    wait -= stop - first
            monday += _WEEK
        return end

    @property
    def _is_always(self) -> bool:
        """Whether a run is expected at any time."""
        worked = sum(end - begin for begin, end in self.shifts or _WHOLE_DAY)
        return not self.holidays and worked == _DAY_MIN and len(set(self.weekdays)) == len(DAYS)

    def problem(self) -> str | None:
        """Sentence about a year without a working day, whenever it begins; None where there is none."""
        first = before = 0  # ordinals, which unlike dates may lie before year 1 and after 9999
        for day in sorted(day.toordinal() for day in self.holidays if day.weekday() in self.weekdays):
            if before == 0 or day != self._next(before):
                first = day
            before = day
            if self._next(day) - self._next(first, -1) > _YEAR_D:
                return f"holidays: there is no working day for a year from {date.fromordinal(first)} on."
        return None

    def _next(self, day: int, step: int = 1) -> int:
        """Next of the weekdays after a day, or before it with a step of -1; both are ordinals."""
        day += step
        while (day - 1) % len(DAYS) not in self.weekdays:  # 1 was a Monday
            day += step
        return day

    def changed(self, stated: Mapping[str, Any]) -> RunCalendar:
        """The same calendar with other values of :data:`CALENDAR`, as JSON has them."""
        values = {}
        for name, value in stated.items():
            field, read = _READERS[name]
            values[field] = read(value)
        return replace(self, **values)

    def to_settings(self) -> dict[str, Any]:
        """Values of :data:`CALENDAR`, as JSON has them."""
        return {
            "working_days": [DAYS[number] for number in self.weekdays],
            "holidays": [str(day) for day in sorted(self.holidays)],
            "time_zone": str(self.zone),
            "shifts": [f"{_clock(begin)}-{_clock(end)}" for begin, end in self.shifts],
        }


EVERY_DAY = RunCalendar()
"""Runs are expected at any time."""


def calendar_of(setup: Setup | None, server: RunCalendar) -> RunCalendar:
    """Calendar of an axis: that of the server, with the values that its schedule states.

    Without holidays where both together leave a year without a working day, as those of the server may since
    they were changed: a run that is expected too early is noticed.
    """
    if setup is None or not setup.calendar:
        return server
    return _usable(server.changed(setup.calendar))


@lru_cache(maxsize=1024)
def _usable(calendar: RunCalendar) -> RunCalendar:
    return calendar if calendar.problem() is None else replace(calendar, holidays=frozenset())


def known_zone(name: str) -> ZoneInfo | None:
    """Time zone of a name; None where this computer knows none."""
    try:
        return ZoneInfo(name)
    except (ZoneInfoNotFoundError, ValueError, OSError):
        return None


def parse_shifts(texts: Sequence[str]) -> tuple[tuple[int, int], ...]:
    """Shifts such as ``"06:00-14:00"``, as :class:`RunCalendar` has them.

    Raises
    ------
    ValueError
        If one is none, or overlaps with another.
    """
    found = sorted(map(_shift, texts))
    if found:
        first = found[0][0] + _DAY_MIN  # of the next day
        begins = [begin for begin, _ in found[1:]]
        for (begin, end), following in zip(found, [*begins, first], strict=True):
            if end > following:
                raise ValueError(f"the shift {_clock(begin)}-{_clock(end)} overlaps with the next")
    return tuple(found)


def _shift(text: str) -> tuple[int, int]:
    """Begin and end of a shift, min."""
    match = _SHIFT.fullmatch(text)
    if match is None:
        raise ValueError(f"a shift is {shown(text)}; it must be such as 06:00-14:00")
    hour, minute, last_hour, last_minute = map(int, match.groups())
    begin, end = 60 * hour + minute, 60 * last_hour + last_minute
    if begin == end:
        raise ValueError(f"the shift {text} is empty; the whole day is 00:00-24:00")
    return begin, end if begin < end else end + _DAY_MIN


def _monday(day: date) -> date:
    """Monday of the week of a day."""
    return day - timedelta(days=day.weekday())


def _clock(minutes: int) -> str:
    """Time of day, such as 06:00."""
    if minutes > _DAY_MIN:
        minutes -= _DAY_MIN
    return f"{minutes // 60:02}:{minutes % 60:02}"


_READERS: dict[str, tuple[str, Callable[[Any], Any]]] = {
    "working_days": ("weekdays", lambda days: tuple(map(DAYS.index, days))),
    "holidays": ("holidays", lambda days: frozenset(map(date.fromisoformat, days))),
    "time_zone": ("zone", lambda name: known_zone(name) or UTC),
    "shifts": ("shifts", parse_shifts),
}


def _weeks_alike(calendar: RunCalendar, monday: date) -> int:
    """Number of weeks of a year with the same shifts, from one on."""
    others = _uneven_weeks(calendar, monday.year)
    return max(1, (others[bisect_left(others, monday)] - monday) // _WEEK)


@lru_cache(maxsize=4096)
def _uneven_weeks(calendar: RunCalendar, year: int) -> tuple[date, ...]:
    """Mondays of the weeks of a year with a holiday or a change of the clocks, and the first of the next."""
    new_year = date(year + 1, 1, 1)
    found = {_monday(new_year + timedelta(days=6))}
    changes = _changes(calendar.zone, year) | _changes(calendar.zone, year + 1)
    for day in calendar.holidays | changes:
        if year <= day.year <= year + 1:
            eve = day - timedelta(days=1)  # whose last shift may pass midnight
            found |= {_monday(day), _monday(eve)}
    return tuple(sorted(day for day in found if year <= day.year))


@lru_cache(maxsize=1024)
def _changes(zone: tzinfo, year: int) -> frozenset[date]:
    """Days of a year with a change of the clocks."""
    found, midnight = [], datetime(year, 1, 1, tzinfo=zone)
    while midnight.year == year:
        following = midnight + timedelta(days=1)
        if midnight.utcoffset() != following.utcoffset():
            found.append(midnight.date())
        midnight = following
    return frozenset(found)


@lru_cache(maxsize=4096)
def _week(calendar: RunCalendar, monday: date) -> tuple[Spans, timedelta]:
    """Shifts that begin in a week, UTC, and their sum."""
    spans, total = [], timedelta(0)
    for number in sorted(set(calendar.weekdays)):
        day = monday + timedelta(days=number)
        if day not in calendar.holidays:
            for start, stop in _day(day, calendar.shifts or _WHOLE_DAY, calendar.zone):
                if start < stop:  # not where the clocks skip it
                    spans.append((start, stop))
                    total += stop - start
    return tuple(spans), total


def _day(day: date, shifts: Sequence[tuple[int, int]], zone: tzinfo) -> Iterator[tuple[datetime, datetime]]:
    """Shifts that begin on a day, UTC."""
    midnight, two_days = datetime.combine(day, time()), timedelta(days=2)
    first = midnight.replace(tzinfo=zone).astimezone(UTC)
    changes = (midnight + two_days).replace(tzinfo=zone).astimezone(UTC) - first != two_days
    for begin, end in shifts:
        start, stop = timedelta(minutes=begin), timedelta(minutes=end)
        if changes:
            yield _utc(midnight + start, zone), _utc(midnight + stop, zone)
        else:
            yield first + start, first + stop


def _utc(local: datetime, zone: tzinfo) -> datetime:
    """UTC of a local time: the first of two, or when the clocks skip it."""
    late = local.replace(tzinfo=zone).astimezone(UTC)
    if late.astimezone(zone).replace(tzinfo=None) == local:
        return late
    early = local.replace(tzinfo=zone, fold=1).astimezone(UTC)  # by the offset after the change
    while late - early > _RESOLUTION:
        middle = early + (late - early) / 2
        if middle.astimezone(zone).replace(tzinfo=None) < local:
            early = middle
        else:
            late = middle
    return late
