"""Verdicts of the cells of a run by its final fit."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from ballscrew.modal.joint.fit import JointFit
from ballscrew.modal.joint.frequencies import CellFrequencies
from ballscrew.modal.joint.mode import AxialMode
from ballscrew.modal.joint.profile import Profile
from ballscrew.modal.joint.search import SearchResult
from ballscrew.modal.joint.settings import JointSettings
from ballscrew.modal.joint.verdicts import _other_nut, _reason_of_worst_cell, _responses_differ

MODE = AxialMode(1e-6, 1.0, 0.0, 0.03, 0.1, 0.5, 0.1, 300.0, 0.03)


@pytest.mark.parametrize(("load", "uncertainty", "kind"), [(3.0, 5.0, "uncertain"), (10.0, 2.5, "unloaded")])
def test_a_run_is_refused_for_what_exceeds_its_limit_most(load: float, uncertainty: float, kind: str) -> None:
    frequencies = SimpleNamespace(
        nut_load=np.array([1.0, load]), uncertainty=np.array([0.1, uncertainty]), free=np.full(2, 100.0)
    )
    assert _reason_of_worst_cell(cast(CellFrequencies, frequencies), JointSettings()).kind == kind


@pytest.mark.parametrize(
    ("found", "expected", "load", "suspect"),
    [
        (0.7, 1.6, 1.3, True),  # day 54 of the reproduction with the gentler motion
        (0.6, 0.8, 2.5, False),  # the load is about the expected one
        (0.1, 0.3, 0.5, False),  # nor does the expected nut lose contact
        (3.0, 1.0, 5.0, False),  # the fit has found the unloaded nut
        (0.1, 0.0, 5.0, False),  # no data sheet
        (0.0, 0.0, 0.0, False),
    ],
)
def test_a_run_is_suspect_if_only_the_nut_of_the_sheet_is_unloaded(
    found: float, expected: float, load: float, suspect: bool
) -> None:
    mode = replace(MODE, mass_over_preload=found)
    result = SimpleNamespace(fit=SimpleNamespace(modes=(mode,)), profile=Profile(False, expected))
    frequencies = SimpleNamespace(nut_load=np.array([load / 2, load]))
    reason = _other_nut(cast(SearchResult, result), cast(CellFrequencies, frequencies))
    assert (reason is not None) == suspect
    if reason is not None:
        assert reason.kind == "unloaded"
        assert "at most 1.3 times the preload by the run, but 3.0 times by data sheet" in reason.text


@pytest.mark.parametrize(
    ("difference", "deviation", "suspect"),
    [
        (-1.5, 0.3, True),
        (1.5, 0.3, True),
        (-1.5, 0.6, False),  # by chance
        (0.9, 0.1, False),  # little beside the uncertainty of the result
        (np.nan, 0.1, False),
    ],
)
def test_a_run_is_suspect_if_motor_and_nut_differ_at_a_stop(
    difference: float, deviation: float, suspect: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    compared = np.array([0.1, difference]), np.array([0.1, deviation])
    monkeypatch.setattr("ballscrew.modal.joint.verdicts.response_difference", lambda _: compared)
    frequencies = SimpleNamespace(free=np.array([140.0, 150.0]), uncertainty=np.array([0.4, 0.4]))
    reason = _responses_differ(cast(JointFit, None), cast(CellFrequencies, frequencies))
    assert (reason is not None) == suspect
    if reason is not None:
        assert reason.kind == "responses-differ"
        assert f"by up to {difference / 1.5:+.2f} ± 0.20 %" in reason.text


def test_one_response_is_compared_with_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ballscrew.modal.joint.verdicts.response_difference", lambda _: None)
    assert _responses_differ(cast(JointFit, None), cast(CellFrequencies, None)) is None
