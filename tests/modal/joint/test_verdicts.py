"""Verdicts of the cells of a run by its final fit."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from ballscrew.modal.joint.frequencies import CellFrequencies
from ballscrew.modal.joint.mode import AxialMode
from ballscrew.modal.joint.profile import Profile
from ballscrew.modal.joint.search import SearchResult
from ballscrew.modal.joint.verdicts import _other_nut

MODE = AxialMode(1e-6, 1.0, 0.0, 0.03, 0.1, 0.5, 0.1, 300.0, 0.03)


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
