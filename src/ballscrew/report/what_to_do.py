"""What to do on an axis: from its two lamps, what it waits for, and the advice of its newest assessment."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from datetime import datetime, timedelta
from typing import Any

from ballscrew.base.reasons import coded_reason
from ballscrew.monitoring.epochs import moment
from ballscrew.report.monitor_words import AGAIN_SOON, NOTHING

OVERDUE = "Run the test, or find out why no run arrives: it is overdue."
OLD = "Run the test: the newest run is too old to show the present state."
BAD = "Correct the measurement, then run the test again: the newest run was bad."
REFUSED = "Correct what prevents the assessment, see its reasons."
FUTURE = "Correct the time of the newest run, which is in the future: 'ballscrew store correct'."
RESET = (
    "Run the test: the axis was repaired after the newest run, and a new baseline begins with the next one."
)
NO_RUN = "Run the test: the axis has no run yet."
WAIT = "Wait for the next assessment, or assess the axis: 'ballscrew monitor AXIS --store DIR'."

_OF_TROUBLES = {"silence": OVERDUE, "measurement": BAD, "assessment": REFUSED}
_OF_REASONS = {"old": OLD, "overdue": OLD, "bad": BAD, "waiting": WAIT}
_URGENT = ("alarm", "unloaded")  # states whose advice comes before that on the measurement
_REPEAT = "do-repeat"
_REPEATABLE = timedelta(hours=12)  # as the advice states; later, the next planned run decides
_STALE = (_REPEAT, "do-next-good")  # codes of advice that an old newest run makes invalid
_CORRECT = "do-correct"  # the same as BAD


def what_to_do(document: Mapping[str, Any], advice: Sequence[str], at: datetime | None = None) -> list[str]:
    """Sentences on what to do, the first action first; never an action beside *nothing to do*.

    Parameters
    ----------
    document : mapping
        Of the axis, with ``lamp`` and ``measurement``; and, where known, ``waiting``, ``changed_at``,
        ``assessed_at``, ``runs``, ``missing`` and ``refusal``.
    advice : sequence of str
        Of the newest assessment, see :func:`~ballscrew.report.monitor_words.advice`; none where the history
        has changed since.
    at : datetime, optional
        The present time, after which a repeat may be too late.

    Returns
    -------
    list of str
        One or more.
    """
    measures = [*_of_measurement(document), *_of_assessment(document)]
    advised = _valid(document, advice, at)
    found = [*measures, *advised]
    if document["lamp"]["state"] in _URGENT:
        found = [*advised, *measures]
    actions = [each for each in dict.fromkeys(found) if each != NOTHING]
    if actions:
        return actions
    if NOTHING in advised and document["lamp"]["state"] == "normal":
        return [NOTHING]
    return [WAIT]


def action_on(trouble: str) -> str:
    """Sentence on what to do about a trouble, by its kind."""
    return _OF_TROUBLES.get(trouble, REFUSED)


def _of_measurement(document: Mapping[str, Any]) -> Iterator[str]:
    """Actions on the measurement, and on runs that are missing."""
    because = _because(document)
    actions = [action_on(each["kind"]) for each in document["measurement"]["troubles"]]
    yield from actions
    if document["lamp"]["because"] == "reset":
        yield RESET
    elif because in _OF_REASONS and OVERDUE not in actions:
        yield _OF_REASONS[because]
    if because == "future":
        yield FUTURE
    if because == "no run" and not (document.get("runs") or document.get("missing") or actions):
        yield NO_RUN


def _because(document: Mapping[str, Any]) -> str | None:
    """Why the newest run does not show the present state; a run that waits may show it."""
    because: str | None = document["measurement"]["because"]
    return "waiting" if because in ("old", "overdue") and document.get("waiting") else because


def _of_assessment(document: Mapping[str, Any]) -> Iterator[str]:
    """Actions on what an assessment needs, or waits for."""
    missing, is_assessed = document.get("missing"), document.get("assessed_at") is not None
    if document.get("refusal"):
        yield REFUSED
    elif missing and not is_assessed:
        yield f"Add what is missing: {', '.join(missing)}."
    elif document.get("changed_at") and is_assessed:
        yield WAIT


def _valid(document: Mapping[str, Any], advice: Sequence[str], at: datetime | None) -> list[str]:
    """Advice of the newest assessment that holds now."""
    if document["lamp"]["because"] == "reset":
        return []
    omitted = _omitted(document)
    found = []
    for sentence in advice:
        reason = coded_reason(sentence)
        code = None if reason is None else reason.code
        if code == _REPEAT and _is_late(document, at):
            found.append(AGAIN_SOON if document["lamp"]["state"] == "watch" else NOTHING)
        elif code not in omitted:
            found.append(sentence)
    return found


def _is_late(document: Mapping[str, Any], at: datetime | None) -> bool:
    """Whether it is too late to repeat the newest run: the next planned one decides."""
    recent = document["measurement"]["recent"]
    return bool(recent and at and at > moment(document["newest_at"], "newest_at") + _REPEATABLE)


def _omitted(document: Mapping[str, Any]) -> tuple[str, ...]:
    """Codes of advice that holds no longer, or that another sentence contains."""
    omitted: tuple[str, ...] = ()
    if not document["measurement"]["recent"]:
        omitted = _STALE
    if any(each["kind"] == "measurement" for each in document["measurement"]["troubles"]):
        omitted += (_CORRECT,)
    return omitted
