"""Which runs share one preload."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import UTC, datetime, timedelta

from ballscrew.base.quantity import Quantity

__all__ = ["SAME", "groups"]

SAME = timedelta(days=1)
"""Runs that begin within it of the first are one experiment: no screw wears visibly in a day."""


def groups(
    ids: Sequence[str], measured_at: Sequence[str | None], known: Mapping[str, Quantity]
) -> tuple[int, ...]:
    """Number the preloads that runs were made at.

    Runs within a day of the first of them share one. So do runs without a time: they are taken as one
    experiment. Where different preloads are stated within an experiment each is its own, and runs without a
    statement go with the first.

    Parameters
    ----------
    ids : sequence of str
        Of the runs.
    measured_at : sequence of str or None
        ISO 8601.
    known : mapping of str to Quantity
        Stated preloads by id, N.

    Returns
    -------
    tuple of int
        Of each run its group; 0 for the first run's, then in the order of appearance.
    """
    times = [_time(text) for text in measured_at]
    days: dict[int, datetime] = {}
    keys: list[tuple[int, float | None]] = []
    for time in times:
        day = next((n for n, first in days.items() if time is not None and abs(time - first) < SAME), None)
        if time is not None and day is None:
            day = len(days) + 1
            days[day] = time
        keys.append((day or 0, None))
    stated: dict[int, list[float]] = {}
    for (day, _), one in zip(keys, ids, strict=True):
        if one in known and known[one].value not in stated.setdefault(day, []):
            stated[day].append(known[one].value)
    final: list[tuple[int, float | None]] = []
    for (day, _), one in zip(keys, ids, strict=True):
        value = known[one].value if one in known else None
        if value is None and day in stated:
            value = stated[day][0]
        final.append((day, value))
    order = list(dict.fromkeys(final))
    return tuple(order.index(key) for key in final)


def _time(text: str | None) -> datetime | None:
    if text is None:
        return None
    try:
        time = datetime.fromisoformat(text)
    except (ValueError, TypeError):
        return None
    return time if time.tzinfo else time.replace(tzinfo=UTC)
