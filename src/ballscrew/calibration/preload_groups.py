"""Which runs share one preload."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime, timedelta

from ballscrew.base.quantity import Quantity

__all__ = ["SAME", "groups", "said_of_groups"]

SAME = timedelta(days=1)
"""Runs that begin within it of the first are one experiment: no screw wears visibly in a day."""


_ALIKE = 2.0  # standard uncertainties of their difference


def groups(
    ids: Sequence[str], measured_at: Sequence[str | None], known: Mapping[str, Quantity]
) -> tuple[int, ...]:
    """Number the preloads that runs were made at.

    Runs within a day of the first of them share one. So do runs without a time: they are taken as one
    experiment. Where preloads are stated within an experiment that differ by more than twice what they may
    err, each is its own, and runs without a statement go with the first.

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
    stated: dict[int, list[Quantity]] = {}
    for (day, _), one in zip(keys, ids, strict=True):
        if one in known and _like(known[one], stated.setdefault(day, [])) is None:
            stated[day].append(known[one])
    final: list[tuple[int, float | None]] = []
    for (day, _), one in zip(keys, ids, strict=True):
        value = _like(known[one], stated[day]) if one in known else None
        if value is None and day in stated:
            value = stated[day][0].value
        final.append((day, value))
    order = list(dict.fromkeys(final))
    return tuple(order.index(key) for key in final)


def said_of_groups(
    ids: Sequence[str], measured_at: Sequence[str | None], known: Mapping[str, Quantity]
) -> tuple[str, ...]:
    """Say what was taken for granted when runs were grouped; parameters as :func:`groups`."""
    said = []
    timeless = [one[:12] for one, text in zip(ids, measured_at, strict=True) if _time(text) is None]
    if len(timeless) > 1:
        said.append(
            f"{len(timeless)} runs tell no time ({', '.join(timeless[:3])}{', …' * (len(timeless) > 3)}) and "
            "were taken as made on one day, at one preload: say when (analyze --measured-at)"
        )
    without = groups(ids, measured_at, {})
    with_ = groups(ids, measured_at, known)
    for day in sorted(set(without)):
        of = [i for i, one in enumerate(without) if one == day]
        first = {with_[i]: known[ids[i]].value for i in reversed(of) if ids[i] in known}
        if len(first) > 1:
            told = " and ".join(f"{value:g} N" for _, value in sorted(first.items()))
            alone = [ids[i][:12] for i in of if ids[i] not in known]
            which = with_[next(i for i in of if ids[i] in known)]
            more = f"; {', '.join(alone)} as at {first[which]:g} N" if alone else ""
            said.append(f"runs of one day were taken as at {told}, since that was stated{more}")
    return tuple(said)


def _like(one: Quantity, stated: Sequence[Quantity]) -> float | None:
    """The first of the stated preloads that this one may be."""
    for other in stated:
        if abs(one.value - other.value) <= _ALIKE * math.hypot(
            one.standard_uncertainty, other.standard_uncertainty
        ):
            return other.value
    return None


def when(text: str | None) -> datetime:
    """Time of a run as a sort key; runs without one come last."""
    return _time(text) or datetime.max.replace(tzinfo=UTC)


def _time(text: str | None) -> datetime | None:
    if text is None:
        return None
    try:
        time = datetime.fromisoformat(text)
    except (ValueError, TypeError):
        return None
    return time if time.tzinfo else time.replace(tzinfo=UTC)
