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
from ballscrew.modal.joint.verdicts import (
    _ambiguous_load,
    _moved_by_ripple,
    _reason_of_worst_cell,
    _responses_differ,
    _run_reasons,
    _run_refusal,
)
from ballscrew.modal.reason import Reason
from ballscrew.modal.run import FrameMode

MODE = AxialMode(1e-6, 1.0, 0.0, 0.03, 0.1, 0.5, 0.1, 300.0, 0.03)


@pytest.mark.parametrize(("load", "uncertainty", "kind"), [(3.0, 5.0, "uncertain"), (10.0, 2.5, "unloaded")])
def test_a_run_is_refused_for_what_exceeds_its_limit_most(load: float, uncertainty: float, kind: str) -> None:
    frequencies = SimpleNamespace(
        nut_load=np.array([1.0, load]), uncertainty=np.array([0.1, uncertainty]), rotor_free=np.full(2, 100.0)
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
    reason = _ambiguous_load(cast(SearchResult, result), cast(CellFrequencies, frequencies))
    assert (reason is not None) == suspect
    if reason is not None:
        assert reason.kind == "unloaded"
        assert "at most 1.3 times the preload from the run, but 3.0 times from data sheet" in reason.text


@pytest.mark.parametrize(("load", "suspect"), [(2.6, True), (2.3, False)])
def test_the_load_by_the_run_is_that_without_the_lower_limit_of_the_sheet(load: float, suspect: bool) -> None:
    mode = replace(MODE, mass_over_preload=0.5)
    profile = Profile(False, 1.2, least_mass_over_preload=1.0)  # doubles the load by the run
    result = SimpleNamespace(fit=SimpleNamespace(modes=(mode,)), profile=profile)
    frequencies = SimpleNamespace(nut_load=np.array([load]))
    reason = _ambiguous_load(cast(SearchResult, result), cast(CellFrequencies, frequencies))
    assert (reason is not None) == suspect
    if reason is not None:
        assert "at most 1.3 times the preload from the run, but 3.1 times from data sheet" in reason.text


@pytest.mark.parametrize(
    ("difference", "deviation", "unexplained", "suspect"),
    [
        (-1.5, 0.3, 0.1, True),
        (1.5, 0.3, 0.1, True),
        (-1.5, 0.6, 0.1, False),  # by chance
        (0.9, 0.1, 0.1, False),  # little beside the uncertainty of the result
        (-1.5, 0.3, 0.75, False),  # by what the model of the motor's response lacks
        (np.nan, 0.1, 0.1, False),
    ],
)
def test_a_run_is_suspect_if_motor_and_nut_differ_at_a_stop(
    difference: float, deviation: float, unexplained: float, suspect: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    compared = np.array([0.1, difference]), np.array([0.1, deviation])
    monkeypatch.setattr("ballscrew.modal.joint.verdicts.response_difference", lambda _: compared)
    frequencies = SimpleNamespace(rotor_free=np.array([140.0, 150.0]), uncertainty=np.array([0.4, 0.4]))
    blocks = [SimpleNamespace(name=name) for name in ("torque-nut", "torque-motor")]
    projections = [SimpleNamespace(unexplained=part) for part in (0.01, unexplained)]
    fit = SimpleNamespace(blocks=blocks, projections=projections)
    reason = _responses_differ(cast(JointFit, fit), cast(CellFrequencies, frequencies))
    assert (reason is not None) == suspect
    if reason is not None:
        assert reason.kind == "responses-differ"
        assert f"by up to {difference / 1.5:+.2f} ± 0.20 %" in reason.text


def test_one_response_is_compared_with_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ballscrew.modal.joint.verdicts.response_difference", lambda _: None)
    assert _responses_differ(cast(JointFit, None), cast(CellFrequencies, None)) is None


def search_result(mode: AxialMode, unexplained: float) -> SearchResult:
    """A result whose fit leaves a part of the response, with a search band from 90 to 450 Hz."""
    windows = SimpleNamespace(centred_position=np.array([0.0]), band=SimpleNamespace(low=90.0, high=450.0))
    block = SimpleNamespace(windows=windows, name="torque-nut")
    fit = SimpleNamespace(
        modes=(mode,), blocks=(block,), projections=(SimpleNamespace(unexplained=unexplained),)
    )
    return cast(SearchResult, SimpleNamespace(fit=fit, unwhitened=fit, frame=None, trips=()))


@pytest.mark.parametrize(
    ("unexplained", "share"), [(float("nan"), "0 %"), (0.6, "40 %"), (1.5, "0 %"), (0.4, None)]
)
def test_a_run_that_the_mode_explains_too_little_of_is_refused(
    unexplained: float, share: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    frequencies = np.array([200.0, 150.0])
    monkeypatch.setattr("ballscrew.modal.joint.verdicts.mode_frequency", lambda *_: frequencies)
    monkeypatch.setattr("ballscrew.modal.joint.verdicts.unexplained_power", lambda _: {})
    reason = _run_refusal(search_result(MODE, unexplained), JointSettings())
    if share is None:
        assert reason is None
    else:
        assert reason == Reason(
            "no-mode", f"a mode along the axis explains only {share} of the response in the band"
        )


@pytest.mark.parametrize(
    ("frequencies", "refused"),
    [((440.0, 300.0), True), ((300.0, 440.0), True), ((300.0, 92.0), True), ((300.0, 150.0), False)],
)
def test_a_mode_at_the_edge_of_the_search_band_is_refused(
    frequencies: tuple[float, float], refused: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("ballscrew.modal.joint.verdicts.mode_frequency", lambda *_: np.array(frequencies))
    monkeypatch.setattr("ballscrew.modal.joint.verdicts.unexplained_power", lambda _: {})
    reason = _run_refusal(search_result(MODE, 0.1), JointSettings())
    assert (reason is not None) == refused
    if reason is not None:
        low, high = sorted(frequencies)
        assert reason.kind == "no-mode"
        assert reason.text == (
            f"the mode found, {low:.0f} to {high:.0f} Hz, lies at the edge of the search band"
        )


def with_fields(result: SearchResult, **changes: object) -> SearchResult:
    return cast(SearchResult, SimpleNamespace(**(vars(result) | changes)))


@pytest.mark.parametrize("pitching", [True, False])
@pytest.mark.parametrize("distinct", [True, False])
def test_all_cells_are_suspect_if_either_mode_may_be_that_of_the_frame(
    distinct: bool, pitching: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    module = "ballscrew.modal.joint.verdicts"
    monkeypatch.setattr(f"{module}._moved_by_ripple", lambda _: False)
    for name in ("_unmeasured_force", "_ambiguous_load", "_responses_differ"):
        monkeypatch.setattr(f"{module}.{name}", lambda *_: None)
    frame = FrameMode(41.0, 0.5, 0.02, 12.3, 0.1, distinct, pitching)
    found = with_fields(search_result(replace(MODE, frame=41.0), 0.1), frame=frame)
    reasons = _run_reasons(found, cast(CellFrequencies, None))
    assert [reason.kind for reason in reasons] == ([] if distinct else ["frame"])
    mode = "the table pitches near 41 Hz" if pitching else "the machine's frame has a mode near 41 Hz"
    assert all(reason.text.startswith(mode) for reason in reasons)


@pytest.mark.parametrize(
    ("direct", "by_mode", "moved"), [(0.0, 0.9, False), (0.0, 1.1, True), (1.1, 0.0, True), (0.8, 0.8, True)]
)
def test_ripple_in_the_band_counts_as_much_as_the_response_of_the_mode_to_it(
    direct: float, by_mode: float, moved: bool
) -> None:
    """The columns are those of the torque, of the ripple itself, and of the mode's response to it."""
    solved = SimpleNamespace(columns=np.eye(3), weights=np.array([[1.0], [direct], [by_mode]]))
    fit = SimpleNamespace(projections=(solved,), blocks=(SimpleNamespace(ripple=np.empty((3, 1))),))
    assert _moved_by_ripple(cast(JointFit, fit)) == moved
