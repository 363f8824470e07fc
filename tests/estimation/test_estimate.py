"""The output of preload --json is read back as it was written; anything else is refused in words."""

from __future__ import annotations

import copy
import json
import math
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.estimation.made_runs import LOAD, calibrated, run_of

from ballscrew.base.errors import InputError
from ballscrew.base.jsonfile import write_json
from ballscrew.estimation.estimate import PreloadEstimate
from ballscrew.estimation.preload import preload

BASE = run_of(name="base", uncertainty=1e-4)
FOUND = preload(run_of(0.7, true_load=LOAD + 4, uncertainty=1e-4), calibrated(), BASE)
DOCUMENT = FOUND.to_json()


@pytest.mark.parametrize(
    "found",
    [FOUND, preload(run_of(0.6), calibrated()), preload(run_of(1.0, level=0.2), calibrated(), BASE)],
    ids=["corrected", "without a baseline", "refused"],
)
def test_what_is_written_is_read_back(found: PreloadEstimate, tmp_path: Path) -> None:
    path = tmp_path / "preload.json"
    path.write_text(write_json(found.to_json()), encoding="utf-8")
    again = PreloadEstimate.read(path)
    assert again.to_json() == json.loads(path.read_text(encoding="utf-8"))
    assert again.change is None
    assert again.verdict == found.verdict


def test_unknown_keys_are_ignored() -> None:
    newer: dict[str, Any] = copy.deepcopy(DOCUMENT)
    newer["phase"] = 2
    newer["mass"]["hue"] = "red"
    newer["causes"][0]["since"] = 1
    assert PreloadEstimate.from_json(newer).to_json() == DOCUMENT


@pytest.mark.parametrize("key", sorted(set(DOCUMENT) - {"schema"}))
@pytest.mark.parametrize("value", [..., 3, "text"])
def test_a_missing_or_wrong_key_is_refused_or_harmless(key: str, value: object) -> None:
    bad = copy.deepcopy(DOCUMENT)
    if value is ...:
        del bad[key]
        with pytest.raises(InputError, match=r"P\.json: is not a preload"):
            PreloadEstimate.from_json(bad, "P.json")
        return
    bad[key] = value
    try:
        PreloadEstimate.from_json(bad)
    except InputError as error:
        assert "is not a preload" in str(error) or "quantity" in str(error)  # noqa: PT017


@settings(max_examples=50, deadline=None)
@given(st.recursive(st.none() | st.booleans() | st.floats() | st.text(), st.lists, max_leaves=5))
def test_hostile_documents_are_refused(anything: Any) -> None:
    with pytest.raises(InputError):
        PreloadEstimate.from_json(anything)
    with pytest.raises(InputError):
        PreloadEstimate.from_json({**DOCUMENT, "parts": anything})


def test_the_text_of_an_estimate_names_its_time() -> None:
    timed = preload(run_of(0.7, measured_at="2026-03-01T08:00:00+00:00"), calibrated(), BASE)
    first, *_ = str(timed).splitlines()
    assert "bench, 2026-03-01T08:00:00+00:00: stiffness good, preload of the nut " in first
    assert "bench: stiffness " in str(FOUND).splitlines()[0]


def test_nothing_is_known_of_a_refused_preload() -> None:
    refused = preload(run_of(1.0, level=0.2), calibrated(), BASE)
    assert refused.relative_interval == (0.0, math.inf)
    assert FOUND.stiffness_relative_to_baseline is not None
    assert FOUND.relative_interval == FOUND.stiffness_relative_to_baseline.interval
