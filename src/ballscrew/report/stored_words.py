"""What a store has about an axis, in words: the state in one line, exclusions, corrections and conflicts."""

from __future__ import annotations

import re
from collections.abc import Container, Iterator
from typing import Any

from ballscrew.base.words import NONE
from ballscrew.monitoring.epochs import moment

RUN_WIDTH = 12
"""Characters of a run's id that are printed."""
_NOT_STATED = "none"  # before or after a correction
_MOMENT = re.compile(r"\d{4}-\d\d-\d\dT[\d:.]+(?:Z|[+-]\d\d:\d\d)")


def utc_minute(time: str | None) -> str:
    """Time of a row to the minute, UTC, ``"2026-01-31 08:00"``."""
    if time is None:
        return NONE
    return moment(time, "a time in the store").strftime("%Y-%m-%d %H:%M")


def with_minutes(text: str) -> str:
    """A sentence with its times to the minute, ``"2026-01-31 08:00 UTC"``."""
    return _MOMENT.sub(lambda found: f"{utc_minute(found[0])} UTC", text)


def stored_headline(document: dict[str, Any]) -> str:
    """Axis and state; where the history has changed since, the state before.

    Parameters
    ----------
    document : dict
        As ``store show --json`` prints it.

    Returns
    -------
    str
        A line.
    """
    axis, state = document["axis"], document["state"]
    if document["assessed_until"] is None:
        return f"{axis}: {state}"
    newest = f"as of the run of {utc_minute(document['assessed_until'])}"
    if document["changed_at"]:
        before = f"{document['last_state']} {newest}"
        return f"{axis}: {state} since its history has changed ('ballscrew monitor'); {before}"
    return f"{axis}: {state}, {newest}"


def exclusions(document: dict[str, Any]) -> Iterator[str]:
    """Sentences on the runs and events that are excluded now."""
    for row in document["exclusions"]:
        if row["ended_at"] is None:
            what = f"event {str(row['event'])[:RUN_WIDTH]}"
            if row["run"]:
                what = f"run {row['run'][:RUN_WIDTH]}"
            yield f"Excluded {what}: {row['reason']} ({row['actor']})"


def changes(document: dict[str, Any]) -> Iterator[str]:
    """Sentences on corrections and conflicts."""
    counting = {run["run"] for run in document["runs"] if run["counts"]}
    for row in document["corrections"]:
        yield _correction(row, counting)
    for row in document["conflicts"]:
        yield _conflict(row)
    for pair in document["shared_recordings"]:
        first, second = (run[:RUN_WIDTH] for run in pair["runs"])
        text = f"Conflict: the runs {first} and {second} are made of the same recording, {pair['recording']}"
        yield f"{text}: exclude one of them ('ballscrew store exclude')."


def _correction(row: dict[str, Any], counting: Container[str]) -> str:
    """Sentence on a field that was corrected."""
    what = row["field"]
    if row["run"] is not None:
        what = f"{what} of the run {row['supersedes'][:RUN_WIDTH]}, which is now {row['run'][:RUN_WIDTH]}"
        if row["run"] not in counting:
            what += " and does not count"
    values = [_NOT_STATED if row[name] is None else str(row[name]) for name in ("old", "new")]
    text = f"Corrected {utc_minute(row['at'])}: {what}, from {values[0]} to {values[1]}"
    about = ", ".join(filter(None, (row["reason"], row["actor"])))
    return f"{text} ({about})" if about else text


def _conflict(row: dict[str, Any]) -> str:
    """Sentence on a refused result, with what to do."""
    run, received = row["run"][:RUN_WIDTH], utc_minute(row["received_at"])
    text = f"Conflict: another result of the run {run} was refused {received}"
    if row["differs"] == ["result"]:
        return f"{text}; if the stored one is wrong, exclude the run ('ballscrew store exclude')."
    fields = " and ".join(row["differs"])
    return f"{text}, of another {fields}; if that is right, correct the run ('ballscrew store correct')."
