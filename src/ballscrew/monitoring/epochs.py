"""What was done to an axis, and the epochs that it parts its history into.

A new nut, a new bearing or maintenance begins a new epoch: the baseline is learnt anew and the history kept.
Grease, and a sensor taken off and put on again, make a step of unknown size in the epoch that goes on.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, date, datetime
from pathlib import Path
from typing import Any

from ballscrew.base.errors import InputError, shown
from ballscrew.base.tomlfile import Fields, read_toml

__all__ = ["BEGINS", "KINDS", "STEPS", "Epoch", "Event", "epochs_of", "moment", "read_events"]

BEGINS = ("nut replaced", "maintenance", "bearing replaced")
STEPS = ("greased", "sensor remounted")
KINDS = (*BEGINS, *STEPS, "note")
_YEARS = 1970, 2200  # what a clock says that was never set, and more than a life later


@dataclass(frozen=True, slots=True)
class Event:
    """Something that was done.

    Parameters
    ----------
    at : str
        ISO 8601; UTC where it names no zone.
    kind : str
        One of :data:`KINDS`.
    text : str
        In the words of who did it.

    Raises
    ------
    InputError
        If the time or the kind is none.
    """

    at: str
    kind: str
    text: str = ""

    def __post_init__(self) -> None:
        """Refuse what cannot be."""
        moment(self.at, "an event: at")
        if self.kind not in KINDS:
            raise InputError(f"an event's kind is {shown(self.kind)}; it must be one of {', '.join(KINDS)}.")

    @property
    def when(self) -> datetime:
        """The moment."""
        return moment(self.at, "an event: at")


@dataclass(frozen=True, slots=True)
class Epoch:
    """The time between two events that change the nut's rigidity.

    Parameters
    ----------
    number : int
        From 0.
    begins, ends : str or None
        ISO 8601; None where it is open.
    cause : str
        The event that began it; empty for the first.
    events : tuple of Event
        In it, by time.
    reference, reference_at : str or None
        Id and time of the run that its levels are told against; None where no run was good.
    alarm_at : str or None
        Time at which its newest alarm began.
    """

    number: int
    begins: str | None
    ends: str | None
    cause: str
    events: tuple[Event, ...] = ()
    reference: str | None = None
    reference_at: str | None = None
    alarm_at: str | None = None


def moment(text: Any, where: str) -> datetime:
    """Read a time.

    Parameters
    ----------
    text : str
        ISO 8601, with or without a zone.
    where : str
        For the message.

    Returns
    -------
    datetime
        With its zone; UTC where none is named.

    Raises
    ------
    InputError
        If it is none.
    """
    try:
        found = datetime.fromisoformat(text)
        told = found.replace(tzinfo=UTC) if found.tzinfo is None else found.astimezone(UTC)
    except (TypeError, ValueError, OverflowError):
        raise InputError(
            f"{where} is {shown(text)}; it must be a time as 2026-01-31T08:00Z (ISO 8601)."
        ) from None
    if not _YEARS[0] <= told.year <= _YEARS[1]:
        raise InputError(
            f"{where} is {shown(text)}; a year from {_YEARS[0]} to {_YEARS[1]} is needed: look at the clock."
        )
    return told


def read_events(path: str | Path) -> tuple[Event, ...]:
    """Read EVENTS.toml: tables ``[[events]]`` with ``at``, ``kind`` and ``text``.

    Parameters
    ----------
    path : path-like
        The file.

    Returns
    -------
    tuple of Event
        By time.

    Raises
    ------
    InputError
        If a field is wrong.
    """
    top = read_toml(path)
    top.only(["events"])
    return tuple(sorted((_event(row) for row in top.subs("events")), key=lambda one: one.when))


def epochs_of(events: Sequence[Event], newest: datetime | None = None) -> tuple[Epoch, ...]:
    """Part the time into epochs.

    Parameters
    ----------
    events : sequence of Event
        In any order.
    newest : datetime, optional
        Of the newest run. What was done, or is planned, after it begins no epoch yet: it is among the events
        of the last one.

    Returns
    -------
    tuple of Epoch
        One more than there are moments at which an event begins one.
    """
    ordered = sorted(events, key=lambda one: one.when)
    begins: list[Event] = []
    for one in ordered:
        if newest is not None and one.when > newest:
            break
        if one.kind in BEGINS and (not begins or one.when > begins[-1].when):
            begins.append(one)
    found = []
    for number in range(len(begins) + 1):
        first = begins[number - 1] if number else None
        last = begins[number] if number < len(begins) else None
        inside = tuple(
            one
            for one in ordered
            if (first is None or one.when >= first.when) and (last is None or one.when < last.when)
        )
        found.append(
            Epoch(
                number,
                None if first is None else first.at,
                None if last is None else last.at,
                "" if first is None else first.kind,
                inside,
            )
        )
    return tuple(found)


def _event(row: Fields) -> Event:
    row.only(["at", "kind", "text"])
    at = row.table.get("at")
    if isinstance(at, datetime):
        at = at.isoformat()
    elif isinstance(at, date):
        at = datetime(at.year, at.month, at.day, tzinfo=UTC).isoformat()
    if not isinstance(at, str):
        raise row.error("at", "a time as 2026-01-31T08:00Z (ISO 8601)")
    moment(at, f"{row.source}: {row.name('at')}")
    return Event(at, row.text("kind", choices=KINDS), row.text("text", ""))
