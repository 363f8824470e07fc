"""What to do, of all combinations of lamps, troubles, what an axis waits for, and advice."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from itertools import chain, combinations, product
from typing import Any

import pytest
from tests.base.test_reasons import CATALOGUE

from ballscrew.base.reasons import coded_reason
from ballscrew.report.monitor_words import NOTHING
from ballscrew.report.what_to_do import BAD, NO_RUN, OLD, OVERDUE, REFUSED, RESET, WAIT, what_to_do

STATES = ("alarm", "unloaded", "watch", "suspect", "unknown", "not assessed", "learning", "normal")
MACHINE = (None, "overdue", "old", "no run", "future", "set aside", "reset")
MEASUREMENT = (None, "overdue", "old", "no run", "future")
KINDS = ("silence", "measurement", "assessment")
TROUBLES = tuple(chain.from_iterable(combinations(KINDS, count) for count in range(4)))
WAITING: tuple[dict[str, Any], ...] = (
    {},
    {"changed_at": "2026-01-05T08:00:00Z"},
    {"refusal": "the store has no model"},
    {"missing": ["plan", "model"], "assessed_at": None},
)
ORDER = "Order a nut and plan the repair; until then, test more often."
AGAIN = CATALOGUE["reasons"]["do-repeat"]
NEXT = CATALOGUE["reasons"]["do-next-good"]
CORRECT = CATALOGUE["reasons"]["do-correct"]
ADVICE = ((), (NOTHING,), (ORDER,), (AGAIN,), (NEXT,), (NOTHING, CORRECT))
PAST = (AGAIN, NEXT)


def axis(
    state: str,
    *,
    lamp: str | None = None,
    because: str | None = None,
    troubles: tuple[str, ...] = (),
    **waiting: Any,
) -> dict[str, Any]:
    """Document of an axis."""
    return {
        "lamp": {"state": state, "because": lamp},
        "measurement": {
            "troubles": [{"kind": kind} for kind in troubles],
            "recent": because is None,
            "because": because,
        },
        "assessed_at": "2026-01-04T08:00:00Z",
        "changed_at": None,
        "runs": 0 if because == "no run" else 5,
        **waiting,
    }


def combined() -> Iterator[tuple[dict[str, Any], tuple[str, ...]]]:
    """All combinations, also those that do not occur."""
    for state, lamp, because, troubles, waiting, advice in product(
        STATES, MACHINE, MEASUREMENT, TROUBLES, WAITING, ADVICE
    ):
        yield axis(state, lamp=lamp, because=because, troubles=troubles, **waiting), advice


def test_no_combination_contradicts_itself() -> None:
    sentences: set[str] = set()
    for document, advice in combined():
        found = what_to_do(document, advice)
        sentences |= set(found)
        measurement, because = document["measurement"], document["lamp"]["because"]
        assert found
        assert len(set(found)) == len(found)
        if NOTHING in found:
            assert found == [NOTHING]
            assert document["lamp"]["state"] == "normal"
            assert measurement["recent"]
            assert not measurement["troubles"]
            assert not any(document.get(name) for name in ("changed_at", "refusal", "missing"))
        kinds = {each["kind"] for each in measurement["troubles"]}
        assert (OVERDUE in found) == ("silence" in kinds)
        assert (BAD in found) == ("measurement" in kinds)
        assert (REFUSED in found) == ("assessment" in kinds or "refusal" in document)
        assert (RESET in found) == (because == "reset")
        assert not (OLD in found and (OVERDUE in found or RESET in found))
        assert not (BAD in found and CORRECT in found)
        if not measurement["recent"] or because == "reset":
            assert not set(PAST) & set(found)
    assert [text for text in sentences if coded_reason(text) is None] == []


def test_a_repeat_is_advised_for_half_a_day() -> None:
    later = {"watch": [CATALOGUE["reasons"]["do-again-soon"]], "normal": [NOTHING]}
    for state, expected in later.items():
        document = axis(state, newest_at="2026-01-04T08:00:00Z")
        begin = datetime(2026, 1, 4, 8, tzinfo=UTC)
        assert what_to_do(document, (AGAIN,), begin + timedelta(hours=11)) == [AGAIN]
        assert what_to_do(document, (AGAIN,), begin + timedelta(hours=13)) == expected


@pytest.mark.parametrize(
    ("document", "advice", "expected"),
    [
        (axis("normal"), (NOTHING,), [NOTHING]),
        (axis("unknown", lamp="overdue", because="overdue", troubles=("silence",)), (NOTHING,), [OVERDUE]),
        (axis("unknown", lamp="old", because="old"), (NOTHING,), [OLD]),
        (axis("unknown", lamp="overdue", because="overdue", waiting=1), (NOTHING,), [WAIT]),
        (axis("unknown", lamp="overdue", because="overdue", waiting=0), (NOTHING,), [OLD]),
        (axis("unknown", because="overdue", troubles=("silence",), waiting=1), (), [OVERDUE]),
        (axis("normal", because="bad", waiting=1), (NOTHING,), [BAD]),
        (axis("normal", troubles=("measurement",)), (NOTHING, CORRECT), [BAD]),
        (axis("unknown", lamp="set aside"), (NOTHING, CORRECT), [CORRECT]),
        (axis("alarm", because="overdue", troubles=("silence",)), (ORDER,), [ORDER, OVERDUE]),
        (axis("alarm", troubles=("measurement",)), (ORDER, CORRECT), [ORDER, BAD]),
        (axis("watch", because="old"), (AGAIN,), [OLD]),
        (axis("unknown", lamp="reset", because="old"), (ORDER,), [RESET]),
        (axis("unknown", changed_at="2026-01-05T08:00:00Z"), (), [WAIT]),
        (axis("alarm"), (), [WAIT]),
        (axis("not assessed", because="no run", assessed_at=None), (), [NO_RUN]),
        (axis("not assessed", because="no run", assessed_at=None, runs=2), (), [WAIT]),
        (
            axis("not assessed", because="no run", **WAITING[3]),
            (),
            ["Add what is missing: plan, model."],
        ),
        (axis("unknown", changed_at="2026-01-05", refusal="no model"), (), [REFUSED]),
    ],
)
def test_what_to_do_in_a_state(
    document: dict[str, Any], advice: tuple[str, ...], expected: list[str]
) -> None:
    assert what_to_do(document, advice) == expected
