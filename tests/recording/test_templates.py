"""Files that ``init`` writes, by what it found."""

from __future__ import annotations

import math
import tomllib

import pytest

from ballscrew.recording.guess import ChannelGuess
from ballscrew.recording.measured_plan import MeasuredPlan
from ballscrew.recording.templates import channels_text, plan_text

POSITION = ChannelGuess("x", "position", "mm", "name", sure=True, used=True)
TORQUE = ChannelGuess("m", "torque", "N m", "name", sure=True, used=True)


@pytest.mark.parametrize(
    ("guesses", "missing"),
    [
        ([POSITION, TORQUE], []),
        ([POSITION], ["torque"]),
        ([TORQUE], ["position"]),
        ([], ["torque", "position"]),
    ],
)
def test_what_an_analysis_needs_and_no_channel_is_is_asked_for(
    guesses: list[ChannelGuess], missing: list[str]
) -> None:
    rows = tomllib.loads(channels_text(guesses, 1000.0, ())).get("channel", [])
    assert [row["quantity"] for row in rows if row["source"] == "TODO"] == missing
    assert len(rows) == len(guesses) + len(missing)


def test_of_many_channels_that_are_not_used_some_are_comments_and_the_others_a_number() -> None:
    unused = [ChannelGuess(f"c{number}", "", "", "", sure=False) for number in range(500)]
    text = channels_text([POSITION, TORQUE, *unused], 1000.0, ())
    listed = sum(line.startswith("# source = ") for line in text.splitlines())
    assert 0 < listed < 500
    assert f"# and {500 - listed} more." in text
    assert len(tomllib.loads(text)["channel"]) == 2


def test_a_reason_with_line_breaks_is_one_comment() -> None:
    guess = ChannelGuess("a\nb", "torque", "N m", "the unit is \n[[channel]]\tx\x1b", sure=False, used=True)
    text = channels_text([POSITION, guess], 1000.0, ())
    assert "# check: the unit is [[channel]] x" in text
    assert {row["source"] for row in tomllib.loads(text)["channel"]} == {"x", "a\nb"}


@pytest.mark.parametrize(
    ("step", "expected"),
    [
        (None, ["0 mm", "100 mm", "300 mm"]),
        (0.15, {"start": "0 mm", "stop": "300 mm", "step": "150 mm"}),
    ],
)
def test_stops_are_a_range_where_they_are_evenly_spaced_and_else_a_list(
    step: float | None, expected: object
) -> None:
    plan = MeasuredPlan((0.0, 0.1, 0.3), step, 2, 0.2, 2.5, math.nan)
    found = tomllib.loads(plan_text(plan, 3))
    assert found["positions"] == expected
    assert (found["repetitions"], found["motion"]["dwell"]) == (6, "TODO")
