"""Events on an axis, and the epochs into which they divide its history.

A new nut, a new bearing or maintenance begins a new epoch: the baseline is learned again, the history stays.
Grease and a remounted sensor cause a step of unknown size within the epoch; a changed method of analysis one
that was estimated.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import UTC, date, datetime
from pathlib import Path
from typing import Any

from ballscrew.base.errors import InputError, shown
from ballscrew.base.tomlfile import Fields, read_toml

BEGINS = ("nut replaced", "maintenance", "bearing replaced")
STEPS = ("greased", "sensor remounted")
KINDS = (*BEGINS, *STEPS, "note")
METHOD_CHANGED = "method changed"
"""Kind of an event whose step is estimated, which :func:`ballscrew.store.reprocessing.reprocess` makes."""

_YEARS = 1970, 2100  # the first is that of a clock that was never set


@dataclass(frozen=True, slots=True)
class Event:
    """Event on an axis.

    Parameters
    ----------
    at : str
        ISO 8601; UTC where it names no zone.
    kind : str
        One of :data:`KINDS`.
    text : str
        Free text.
    step, step_uncertainty : float or None
        Of the kind "method changed" alone: step of the relative change of the
        nut's compliance, and its standard uncertainty.

    Raises
    ------
    InputError
        If the time or the kind is not valid.
    """

    at: str
    kind: str
    text: str = ""
    step: float | None = None
    step_uncertainty: float | None = None

    def __post_init__(self) -> None:
        """Check time and kind."""
        moment(self.at, "an event: at")
        if self.kind == METHOD_CHANGED and self.step is not None and self.step_uncertainty is not None:
            return
        if self.kind not in KINDS:
            raise InputError(f"an event's kind is {shown(self.kind)}; it must be one of {', '.join(KINDS)}.")

    @property
    def when(self) -> datetime:
        """Time with its zone."""
        return moment(self.at, "an event: at")

    @property
    def effect(self) -> str:
        """Kind, with the step where it is estimated: what results depend on."""
        if self.step is None:
            return self.kind
        return f"{self.kind} {self.step!r} {self.step_uncertainty!r}"

    def to_json(self) -> dict[str, Any]:
        """JSON form; the step only where it is estimated."""
        document: dict[str, Any] = {"at": self.at, "kind": self.kind, "text": self.text}
        if self.step is not None:
            document |= {"step": self.step, "step_uncertainty": self.step_uncertainty}
        return document


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
        Its events, by time.
    reference, reference_at : str or None
        Id and time of the run that its levels are relative to; None where no run was good.
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
        Place of the text, for messages.

    Returns
    -------
    datetime
        With its zone; UTC where none is named.

    Raises
    ------
    InputError
        If the text is no time, or its year is out of range.
    """
    try:
        found = datetime.fromisoformat(text)
        if found.tzinfo is None:
            found = found.replace(tzinfo=UTC)
        found = found.astimezone(UTC)
    except (TypeError, ValueError, OverflowError):
        raise InputError(
            f"{where} is {shown(text)}; it must be a time as 2026-01-31T08:00Z (ISO 8601)."
        ) from None
    if not _YEARS[0] <= found.year <= _YEARS[1]:
        raise InputError(
            f"{where} is {shown(text)}; a year from {_YEARS[0]} to {_YEARS[1]} is needed: look at the clock."
        )
    return found


def read_events(path: str | Path) -> tuple[Event, ...]:
    """Read EVENTS.toml: tables ``[[events]]`` with ``at``, ``kind`` and ``text``, and steps that are known.

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
    return tuple(sorted((_event(row) for row in top.subs("events")), key=_when))


def epochs_of(events: Sequence[Event], newest: datetime | None = None) -> tuple[Epoch, ...]:
    """Divide the time into epochs.

    Parameters
    ----------
    events : sequence of Event
        In any order.
    newest : datetime, optional
        Time of the newest run. A later event, also a planned one, begins no epoch yet: it is among the events
        of the last one.

    Returns
    -------
    tuple of Epoch
        One more than there are times at which an event begins one.
    """
    ordered = sorted(events, key=_when)
    starts: list[Event] = []
    for event in ordered:
        past = newest is None or event.when <= newest
        first = not starts or event.when > starts[-1].when
        if event.kind in BEGINS and past and first:
            starts.append(event)
    times = [start.when for start in starts]
    inside: list[list[Event]] = [[] for _ in range(len(starts) + 1)]
    for event in ordered:
        inside[bisect_right(times, event.when)].append(event)
    epochs = [Epoch(0, None, None, "", tuple(inside[0]))]
    for start, others in zip(starts, inside[1:], strict=True):
        epochs[-1] = replace(epochs[-1], ends=start.at)
        epochs.append(Epoch(len(epochs), start.at, None, start.kind, tuple(others)))
    return tuple(epochs)


def _when(event: Event) -> datetime:
    return event.when


def _event(row: Fields) -> Event:
    kind = row.text("kind", choices=(*KINDS, METHOD_CHANGED))
    names, step = ["at", "kind", "text"], dict[str, float]()
    if kind == METHOD_CHANGED:
        names += ["step", "step_uncertainty"]
        step["step"] = row.quantity("step", "", least=-1, most=1)
        step["step_uncertainty"] = row.quantity("step_uncertainty", "", least=0, most=1)
    row.only(names)
    at = row.table.get("at")
    if isinstance(at, datetime):
        at = at.isoformat()
    elif isinstance(at, date):
        at = datetime(at.year, at.month, at.day, tzinfo=UTC).isoformat()
    if not isinstance(at, str):
        raise row.error("at", "a time as 2026-01-31T08:00Z (ISO 8601)")
    moment(at, f"{row.source}: {row.name('at')}")
    return Event(at, kind, row.text("text", ""), **step)
