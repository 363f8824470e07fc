"""An end of a fixed-fixed screw that no longer carries, against other changes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.estimation.made_runs import MODEL, calibrated, run_of

from ballscrew.axis.axial import from_sheet
from ballscrew.axis.compliance import support_compliance
from ballscrew.axis.sheet import Bearing, DataSheet, Drive, Guide, Screw, Table
from ballscrew.estimation.preload import preload

SHEET = DataSheet(
    name="bench",
    support="fixed-fixed",
    screw=Screw(0.010, 0.0176, 0.0176, 0.65, 0.08, 15e3, 480e6, 0.1, 0.04),
    bearing=Bearing(160e6),
    table=Table(32.0),
    drive=Drive(4.2e-4, coupling_stiffness=4000.0),
    guide=Guide(25.0),
)
BOTH = from_sheet(SHEET, 0.225)


def without(end):
    """What the loss of an end adds to the compliance, as a part of it."""

    def softer(x):
        shaft = {"diameter": 0.0176, "youngs_modulus": 206e9, "bearing_stiffness": 160e6}
        distance = x + 0.08
        held = support_compliance(distance, **shaft, support="fixed-fixed", length=0.65)
        left = distance if end == "far" else 0.65 - distance
        alone = support_compliance(left, **shaft, support="fixed-free")
        away = x - 0.225
        return (alone - held) / BOTH.compliance / (1 + BOTH.slope * away + BOTH.curve * away**2)

    return softer


def reasons(run, model=BOTH):
    found = preload(run, calibrated(model), run_of(model=model, name="base"))
    return found.verdict, [reason for reason in found.reasons if "no longer carries" in reason]


@pytest.mark.parametrize(
    ("end", "words"), [("far", "the far end"), ("near", "the end at the thrust bearing")]
)
@pytest.mark.parametrize("ratio", [1.0, 0.6])
def test_an_end_that_lost_its_pretension_makes_the_preload_suspect_and_is_named(end, words, ratio):
    verdict, named = reasons(run_of(ratio, model=BOTH, softer=without(end)))
    assert verdict != "good"
    assert len(named) == 1
    assert words in named[0]


@pytest.mark.parametrize(
    "changes",
    [
        {"ratio": 0.6},
        {"ratio": 0.85, "tilt": 2e-3},
        {"true_load": 110.0},
        {"moved": 5e-3},
        {"ratio": lambda x: np.where(np.abs(x - 0.2) < 0.06, 0.5, 0.95), "local": True},
    ],
)
def test_other_changes_are_no_lost_end(changes):
    assert reasons(run_of(model=BOTH, **changes))[1] == []


def test_a_screw_fixed_at_one_end_has_none_to_lose():
    assert reasons(run_of(model=MODEL, softer=without("far")), MODEL)[1] == []


def test_a_softer_bearing_at_the_far_end_is_no_lost_end():
    """Two bearings of which the far one has lost a tenth of its stiffness."""
    worn = from_sheet(replace(SHEET, bearing=Bearing(160e6, far_stiffness=144e6)), 0.225)
    assert reasons(run_of(model=worn))[1] == []


def test_two_stops_show_no_lost_end():
    """A curvature takes three."""

    def found(stops):
        run = run_of(model=BOTH, softer=without("far"), stops=stops)
        estimate = preload(run, calibrated(BOTH), run_of(model=BOTH, name="base", stops=stops))
        return any("no longer carries" in reason for reason in estimate.reasons)

    assert found((0.0, 0.15, 0.3, 0.45))
    assert not found((0.0, 0.45))
