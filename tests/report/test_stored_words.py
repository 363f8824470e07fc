"""Sentences on what a store has of an axis."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import pytest

from ballscrew.report.fleet_blocks import urgency_of
from ballscrew.report.stored_axis import StoredAxis, _action, _doubts, _made_rows, state_words
from ballscrew.report.stored_words import changes

EMPTY: dict[str, Any] = {"runs": [], "corrections": [], "conflicts": [], "shared_recordings": []}


def corrected(counts: bool) -> dict[str, Any]:
    row = {
        "field": "measured_at", "run": "b" * 64, "supersedes": "a" * 64, "at": "2026-01-05T08:00:30+00:00",
        "old": None, "new": "2026-01-04", "reason": "the clock was wrong", "actor": "anna",
    }  # fmt: skip
    return EMPTY | {"runs": [{"run": "b" * 64, "counts": counts}], "corrections": [row]}


def test_a_correction_that_does_not_count_says_so() -> None:
    (counting,) = changes(corrected(True))
    (other,) = changes(corrected(False))
    assert f"which is now {'b' * 12}, from" in counting
    assert f"which is now {'b' * 12} and does not count, from" in other
    assert other.startswith(f"Corrected 2026-01-05 08:00: measured_at of the run {'a' * 12}")
    assert other.endswith(" (the clock was wrong, anna)")


def test_a_recording_of_two_runs_is_a_conflict() -> None:
    pair = {"runs": ["a" * 64, "b" * 64], "recording": "trip.h5"}
    (text,) = changes(EMPTY | {"shared_recordings": [pair]})
    assert text == (
        f"Conflict: the runs {'a' * 12} and {'b' * 12} are made of the same recording, trip.h5: exclude one "
        "of them ('ballscrew store exclude')."
    )


@pytest.mark.parametrize(
    ("differs", "words"),
    [
        (["result"], "if the stored one is wrong, exclude the run"),
        (
            ["load", "time"],
            "refused 2026-01-05 08:00, of another load and time; if that is right, correct",
        ),
    ],
)
def test_a_conflict_says_what_differs(differs: list[str], words: str) -> None:
    row = {"run": "a" * 64, "received_at": "2026-01-05T08:00:30+00:00", "differs": differs}
    (text,) = changes(EMPTY | {"conflicts": [row]})
    assert words in text


def axis(**changes: Any) -> StoredAxis:
    document = {
        "axis": "x", "lamp": {"state": "alarm", "because": None}, "state": "alarm", "last_state": None,
        "urgency": "plan", "reasons": [], "waiting": 0, "to_do": [], "missing": [], "refusal": None,
        "changed_at": None, "assessed_at": "2026-01-05T08:00:00Z",
    }  # fmt: skip
    document |= {name: value for name, value in changes.items() if name in document}
    given = {"document": document, "troubles": (), "preload_alarms": (), "explained": {}, "name": "x"}
    given |= {name: value for name, value in changes.items() if name not in document}
    return cast(StoredAxis, SimpleNamespace(**given))


def test_a_state_is_urgent_or_suspect_in_words() -> None:
    assert state_words(axis()).words == "alarm"
    assert state_words(axis(urgency="now")).words == "alarm, urgent"
    assert state_words(axis(reasons=["the calibration is suspect"])).words == "alarm (suspect)"
    assert state_words(axis(urgency="now", reasons=["why"])).words == "alarm, urgent (suspect)"


def test_an_axis_in_trouble_comes_before_those_without() -> None:
    sound = {"lamp": {"state": "normal", "because": None}, "state": "normal", "urgency": "none"}
    normal, troubled = axis(**sound), axis(**sound, troubles=({"text": "silence"},))
    planned, urgent = axis(), axis(urgency="now")
    ranks = [urgency_of(each)[0] for each in (urgent, planned, troubled, normal)]
    assert ranks == sorted(set(ranks))


def test_an_action_has_its_end_where_it_has_one() -> None:
    action = {"action": "shelved", "at": "2026-01-05T08:00:00Z", "by": "anna", "until": None, "text": ""}
    assert _action(action) == "shelved 2026-01-05 08:00 by anna"
    until = action | {"until": "2026-01-09T08:00:00Z", "text": "ordered"}
    assert _action(until) == "shelved 2026-01-05 08:00 by anna until 2026-01-09 08:00: ordered"


def test_doubts_are_those_of_measurement_state_and_nut() -> None:
    state = {"reasons": ["why"], "nut_reasons": ["the bearing"], "not_judged": "", "notes": ["a note"]}
    troubles = ({"text": "silence"},)
    found = _doubts(axis(troubles=troubles, explained={"state": state}))
    assert found == ["Measurement: silence", "Suspect: why", "Nut: the bearing", "a note"]
    found = _doubts(axis(explained={"state": state | {"not_judged": "the newest run does not count"}}))
    assert found[2] == "Not judged: the newest run does not count"
    assert _doubts(axis(reasons=["why"], troubles=troubles)) == ["Measurement: silence", "Suspect: why"]


def test_how_an_assessment_was_made_names_its_load_and_what_was_accepted() -> None:
    settings: dict[str, Any] = {"settings": {"false_alarms_per_year": 0.1}, "failure": {"preload_ratio": 0.5}}
    made = {
        "version": "1.0",
        "made_at": "2026-01-05T08:00:00Z",
        "runs": 7,
        "inputs": "i",
        "model_digest": "m",
    }

    def words(**more: Any) -> str:
        given = SimpleNamespace(
            document={"method": None}, made=made | {"settings": settings | more}, counting=[]
        )
        return dict(_made_rows(cast(StoredAxis, given)))["settings"]

    plain = words()
    assert plain == "false alarms per year 0.1; end of life at P/P₀ 0.5"
    assert words(largest_load=2500.0) == f"{plain}; largest load 2500 N"
    assert words(accept=["rigidity", "misfit"]) == f"{plain}; accepted doubts rigidity, misfit"
