"""Calendars: waits that are counted within shifts, on working days, by absolute time."""

from __future__ import annotations

from datetime import UTC, date, datetime, timedelta, tzinfo
from time import process_time
from typing import Any
from zoneinfo import ZoneInfo

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ballscrew.store.calendars import EVERY_DAY, LONGEST_WAIT, RunCalendar, calendar_of, parse_shifts
from ballscrew.store.service_tables import Setup

BERLIN = ZoneInfo("Europe/Berlin")
WEEK = tuple(range(5))
MINUTE = timedelta(minutes=1)
ZONES = (
    "UTC", "Europe/Berlin", "America/New_York", "Australia/Lord_Howe", "Asia/Kathmandu", "Africa/Cairo",
    "America/Havana", "Pacific/Apia",
)  # fmt: skip
"""Of half an hour, of three quarters, with a change at midnight, and one that left out a day."""
DAYS = (
    "2026-03-29", "2026-10-25", "2026-03-08", "2026-11-01", "2026-04-05", "2026-10-04", "2026-04-24",
    "2026-10-30", "2011-12-30", "2025-12-29", "2026-01-01",
)  # fmt: skip
CHANGES = [datetime.fromisoformat(f"{day}T00:00Z") for day in DAYS]
THREE = ("06:00-14:00", "14:00-22:00", "22:00-06:00")


def calendar(
    *shifts: str, weekdays: tuple[int, ...] = WEEK, holidays: tuple[str, ...] = (), zone: tzinfo = BERLIN
) -> RunCalendar:
    return RunCalendar(weekdays, frozenset(map(date.fromisoformat, holidays)), zone, parse_shifts(shifts))


def is_worked(found: RunCalendar, at: datetime, step: timedelta = MINUTE) -> bool:
    """Whether a shift goes on, by the wall clock; where it is set back, as just before."""
    local = at.astimezone(found.zone)
    while local.fold:
        at -= step
        local = at.astimezone(found.zone)
    for before in (0, 1):
        day = local.date() - timedelta(days=before)
        minute = 60 * (24 * before + local.hour) + local.minute
        if day.weekday() in found.weekdays and day not in found.holidays:
            for begin, end in found.shifts or [(0, 1440)]:
                if begin <= minute < end:
                    return True
    return False


def counted(
    found: RunCalendar, begin: datetime, wait: timedelta, steps: int, step: timedelta = MINUTE
) -> datetime | None:
    """Last time until which a wait was worked, counted in steps; None where these do not suffice."""
    for number in range(steps):
        at = begin + number * step
        if is_worked(found, at, step):
            if wait == timedelta(0):
                return at
            wait -= step
    return None


@st.composite
def calendars(draw: st.DrawFn) -> RunCalendar:
    bounds = sorted(draw(st.sets(st.integers(0, 95), max_size=8)))
    times = [60 * (15 * each // 60) + 15 * each % 60 for each in bounds]
    shifts = [tuple(times[number : number + 2]) for number in range(0, len(times) - 1, 2)]
    if shifts and draw(st.booleans()):  # all but these: one passes midnight
        ends = [*(begin for begin, _ in shifts[1:]), shifts[0][0] + 1440]
        shifts = [(end, following) for (_, end), following in zip(shifts, ends, strict=True)]
    weekdays = draw(st.sets(st.integers(0, 6), min_size=1))
    days = st.sampled_from(CHANGES).map(lambda at: at.date() + timedelta(days=draw(st.integers(-2, 2))))
    zone = ZoneInfo(draw(st.sampled_from(ZONES)))
    return RunCalendar(tuple(weekdays), draw(st.frozensets(days, max_size=3)), zone, tuple(shifts))


begins = st.builds(
    lambda at, minutes: at + timedelta(minutes=minutes), st.sampled_from(CHANGES), st.integers(-4000, 2000)
)
waits = st.integers(0, 3000).map(lambda minutes: timedelta(minutes=minutes))
long_waits = st.integers(0, 2_000_000).map(lambda minutes: timedelta(minutes=minutes))


@settings(max_examples=100, deadline=None)
@given(calendars(), begins, waits)
def test_a_wait_is_what_counting_by_minutes_gives(
    found: RunCalendar, begin: datetime, wait: timedelta
) -> None:
    steps = 4 * 1440
    expected = counted(found, begin, wait, steps)
    if expected is None:
        assert found.after(begin, wait) >= begin + steps * MINUTE
    else:
        assert found.after(begin, wait) == expected


@settings(max_examples=200, deadline=None)
@given(calendars(), begins, long_waits, long_waits)
def test_waits_add_up_and_longer_ones_end_later(
    found: RunCalendar, begin: datetime, first: timedelta, second: timedelta
) -> None:
    end = found.after(begin, first + second)
    assert begin <= found.after(begin, first) <= end
    if end < begin + LONGEST_WAIT:
        assert found.after(found.after(begin, first), second) == end


@pytest.mark.parametrize("years", [0.5, 1.0, 3.0])
def test_a_wait_of_years_is_what_counting_by_hours_gives(years: float) -> None:
    days = ("2024-12-25", "2025-01-01", "2025-05-01", "2025-10-26", "2025-12-29", "2026-03-29")
    found = calendar("22:00-06:00", "08:00-09:00", weekdays=(0, 2, 5, 6), holidays=days)
    hour = timedelta(hours=1)
    begin = datetime(2024, 3, 5, 3, tzinfo=UTC)
    worked = sum(is_worked(found, begin + number * hour, hour) for number in range(round(years * 8766)))
    assert found.after(begin, worked * hour) == counted(found, begin, worked * hour, 60_000, hour)


@pytest.mark.parametrize(
    ("begin", "wait_h", "end", "shifts"),
    [
        ("2026-01-02T08:00+01:00", 5.9, "2026-01-02T13:54+01:00", ("06:00-14:00",)),  # Friday
        ("2026-01-02T08:00+01:00", 6.0, "2026-01-05T06:00+01:00", ("06:00-14:00",)),
        ("2026-01-03T08:00+01:00", 0.0, "2026-01-05T06:00+01:00", ("06:00-14:00",)),
        ("2026-01-05T15:00+01:00", 9.0, "2026-01-08T07:00+01:00", ("06:00-14:00",)),  # Tuesday is a holiday
        ("2026-01-02T20:00+01:00", 7.0, "2026-01-03T05:00+01:00", ("22:00-06:00",)),  # of Friday
        ("2026-01-05T00:00+01:00", 0.0, "2026-01-05T22:00+01:00", ("22:00-06:00",)),  # Sunday has none
        ("2026-01-05T06:00+01:00", 23.0, "2026-01-06T05:00+01:00", THREE),
        ("2026-01-05T06:00+01:00", 24.0, "2026-01-07T06:00+01:00", THREE),
        ("2026-01-05T06:00+01:00", 19.0, "2026-01-07T01:00+01:00", ("00:00-24:00",)),
    ],
)  # fmt: skip
def test_time_counts_within_the_shifts_of_working_days(
    begin: str, wait_h: float, end: str, shifts: tuple[str, ...]
) -> None:
    found = calendar(*shifts, holidays=("2026-01-06",))
    assert found.after(datetime.fromisoformat(begin), timedelta(hours=wait_h)) == datetime.fromisoformat(end)


@pytest.mark.parametrize(
    ("day", "shift", "hours"),
    [
        ("2026-03-28", "22:00-06:00", 7), ("2026-10-24", "22:00-06:00", 9), ("2026-03-27", "22:00-06:00", 8),
        ("2026-03-29", "00:00-24:00", 23), ("2026-10-25", "00:00-24:00", 25),
        ("2026-03-29", "02:00-03:00", 0), ("2026-03-29", "02:30-06:00", 3), ("2026-03-29", "01:00-02:30", 1),
        ("2026-10-25", "02:00-03:00", 2), ("2026-10-25", "02:30-06:00", 4.5),
        ("2026-10-25", "01:00-02:30", 1.5),
    ],
)  # fmt: skip
def test_a_shift_is_as_long_as_it_lasts_where_the_clocks_change(day: str, shift: str, hours: float) -> None:
    begin = datetime.fromisoformat(f"{day}T00:00").replace(tzinfo=BERLIN).astimezone(UTC)
    found = calendar(shift, weekdays=(begin.astimezone(BERLIN).weekday(),))
    next_week = begin + timedelta(days=5)
    wait = timedelta(hours=hours)
    assert found.after(begin, wait) > next_week
    if hours:
        assert found.after(begin, wait - timedelta(microseconds=1)) < next_week


def test_every_day_without_shifts_is_a_sum() -> None:
    begin = datetime(2026, 1, 1, 5, tzinfo=BERLIN)
    whole = RunCalendar(zone=BERLIN, shifts=parse_shifts(["22:00-06:00", "06:00-22:00"]))
    for found in (EVERY_DAY, whole, RunCalendar(zone=BERLIN)):
        assert found.after(begin, timedelta(days=20_000)) == begin.astimezone(UTC) + timedelta(days=20_000)


@pytest.mark.parametrize("seconds", [2e9, 1e11])
def test_a_wait_always_ends_and_soon(seconds: float) -> None:
    begin = datetime(2026, 1, 1, tzinfo=UTC)
    started = process_time()
    end = calendar("00:00-00:01", weekdays=(0,)).after(begin, timedelta(seconds=seconds))
    assert process_time() - started < 2
    assert end == begin + LONGEST_WAIT


@pytest.mark.parametrize(
    ("shifts", "message"),
    [
        (["6-14"], "'6-14'; it must be such as 06:00-14:00"),
        (["24:00-06:00"], "such as"),
        (["06:00-24:30"], "such as"),
        (["06:00-14:00\n"], "such as"),
        (["٠٦:00-14:00"], "such as"),
        ([""], "such as"),
        (["06:00-06:00"], "06:00-06:00 is empty"),
        (["06:00-14:00", "13:59-22:00"], "06:00-14:00 overlaps"),
        (["06:00-14:00", "06:00-14:00"], "overlaps"),
        (["22:00-06:00", "05:00-13:00"], "22:00-06:00 overlaps"),
        (["22:00-24:00", "23:00-01:00"], "22:00-24:00 overlaps"),
    ],
)
def test_a_wrong_shift_is_refused(shifts: list[str], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        parse_shifts(shifts)


def test_holidays_of_any_year_are_possible() -> None:
    found = calendar("06:00-14:00", holidays=("0001-01-01", "9999-12-31", "2026-01-01"))
    assert found.problem() is None
    end = found.after(datetime(2025, 1, 1, tzinfo=UTC), timedelta(hours=8 * 261))  # working days of 2025
    assert end == datetime(2026, 1, 2, 5, tzinfo=UTC)


def test_a_year_without_a_working_day_is_a_problem() -> None:
    days = [str(date(2027, 1, 1) + timedelta(days=number)) for number in range(365)]
    sentence = "holidays: there is no working day for a year from 2027-01-01 on."
    assert calendar(holidays=tuple(days)).problem() == sentence
    assert calendar(holidays=tuple(days[:-1])).problem() is None
    always = tuple(range(7))
    assert calendar(weekdays=always, holidays=tuple(days)).problem() == sentence
    assert calendar(weekdays=always, holidays=tuple(days[1:])).problem() is None
    assert calendar(holidays=(*days[:103], *days[104:])).problem() is None
    from_summer = [str(date(2027, 7, 1) + timedelta(days=number)) for number in range(366)]
    found = calendar(holidays=tuple(from_summer)).problem()
    assert found == "holidays: there is no working day for a year from 2027-07-01 on."
    last = [str(date(9999, 1, 1) + timedelta(days=number)) for number in range(365)]
    assert calendar(holidays=tuple(last)).problem() is not None
    of_leap_year = [str(date(2028, 1, 1) + timedelta(days=number)) for number in range(366)]
    assert calendar(weekdays=(6,), holidays=tuple(of_leap_year)).problem() is not None
    assert calendar(weekdays=(6,), holidays=tuple(of_leap_year[8:-8])).problem() is None
    mondays = tuple(days[3::7])
    assert calendar(weekdays=(0,), holidays=mondays).problem() is not None
    assert calendar(weekdays=(0,), holidays=mondays[1:]).problem() is None
    assert calendar(holidays=mondays).problem() is None
    assert EVERY_DAY.problem() is None


@pytest.mark.parametrize(
    "stated",
    [
        {"working_days": ["Mon", "Sun"], "holidays": ["2026-12-25"], "time_zone": "Asia/Tokyo", "shifts": []},
        {"shifts": ["06:00-14:00", "22:00-06:00"]},
        {"holidays": []},
    ],
)
def test_an_axis_has_the_calendar_of_the_server_but_for_what_it_states(stated: dict[str, Any]) -> None:
    server = calendar("08:00-16:00", holidays=("2026-01-06",))
    found = calendar_of(Setup(calendar=stated), server).to_settings()
    assert found == server.to_settings() | stated
    for setup in (None, Setup(), Setup(calendar={})):
        assert calendar_of(setup, server) is server


def test_a_zone_that_this_computer_does_not_know_is_utc() -> None:
    assert calendar_of(Setup(calendar={"time_zone": "Mars/Base"}), EVERY_DAY).zone == UTC


def test_holidays_that_leave_an_axis_no_working_day_are_working_days() -> None:
    """The holidays of the server were changed after the working days of the axis were stated."""
    sundays = [date(2026, 1, 4) + timedelta(weeks=week) for week in range(52)]
    server = RunCalendar(holidays=frozenset(sundays))
    found = calendar_of(Setup(calendar={"working_days": ["Sun"]}), server)
    begin = datetime(2026, 3, 2, tzinfo=UTC)
    assert found.after(begin, timedelta(hours=36)) == datetime(2026, 3, 15, 12, tzinfo=UTC)
    mondays = calendar_of(Setup(calendar={"working_days": ["Mon", "Sun"]}), server)
    assert mondays.holidays == server.holidays
