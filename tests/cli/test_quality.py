from __future__ import annotations

from dataclasses import replace

import pytest

import ballscrew as package
from ballscrew.base.jsonfile import SCHEMA


def test_good(ballscrew, rig):
    outcome = ballscrew("quality", rig / "run.toml")
    assert (outcome.status, outcome.err) == (0, "")
    assert outcome.out.strip() == "good"


def test_json(ballscrew, rig):
    outcome = ballscrew("quality", rig / "run.toml", "--json")
    assert outcome.status == 0
    assert outcome.document["schema"] == SCHEMA
    assert outcome.document["quality"] == {"verdict": "good", "reasons": [], "notes": []}


def test_bad_is_1_with_the_reasons_on_both_sides(ballscrew, rig):
    outcome = ballscrew("quality", rig / "bad.h5", "--channels", rig / "channels.toml", "--json")
    assert outcome.status == 1
    quality = outcome.document["quality"]
    assert quality["verdict"] == "bad"
    assert "NaN" in " ".join(quality["reasons"])
    for reason in quality["reasons"]:
        assert f"ballscrew: bad measurement: {reason}\n" in outcome.err
    text = ballscrew("quality", rig / "bad.h5", "--channels", rig / "channels.toml")
    assert text.out.startswith("bad")


def test_the_more_is_given_the_more_is_checked(ballscrew, rig):
    bare = ballscrew("quality", rig / "trip1.h5", "--channels", rig / "channels.toml", "--json").document
    assert bare["quality"]["verdict"] == "good"
    planned = ballscrew(
        "quality", rig / "trip1.h5", "--channels", rig / "channels.toml", "--plan", rig / "plan.toml",
        "--json",
    ).document  # fmt: skip
    assert planned["quality"]["verdict"] == "suspect"
    assert "repetition" in " ".join(planned["quality"]["reasons"])
    heavy = ballscrew("quality", rig / "run.toml", "--mass", "160 kg", "--json")
    assert heavy.status in (0, 1)
    assert heavy.document["quality"]["verdict"] != "good"


def test_the_function_of_the_same_name(rig):
    assert package.quality(rig / "run.toml").verdict == "good"
    assert package.quality(rig / "bad.h5", channels=rig / "channels.toml").verdict == "bad"


def test_an_axis_that_leaves_the_screw_is_bad(rig):
    """The rate that its mode takes cannot be predicted there."""
    sheet = package.read_axis(rig / "axis.toml")
    screw = replace(sheet.screw, bearing_to_zero=-0.01)
    found = package.quality(
        rig / "trip1.h5", channels=rig / "channels.toml", axis=replace(sheet, screw=screw), mass="100 kg"
    )
    assert found.verdict == "bad"
    assert "off the screw" in " ".join(found.reasons)


@pytest.mark.parametrize("arguments", [["none.h5"], ["trip1.h5"], ["run.toml", "trip1.h5"]])
def test_wrong_input_is_2(ballscrew, rig, arguments):
    outcome = ballscrew("quality", *(rig / name for name in arguments))
    assert (outcome.status, outcome.out) == (2, "")
    assert outcome.err.count("\n") == 1
