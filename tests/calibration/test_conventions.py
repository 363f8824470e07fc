"""Conventions of the nut's rigidity compared by a calibration."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from ballscrew.axis.axial import PARAMETERS, from_sheet, to_vector
from ballscrew.axis.rigidity import kappa, other_readings
from ballscrew.base.errors import MeasurementError
from ballscrew.base.quantity import Quantity
from ballscrew.calibration.assumptions import DEFAULT_ASSUMPTIONS
from ballscrew.calibration.calibrated_axis import ConventionEvidence, Doubt
from ballscrew.calibration.calibration import calibrate
from ballscrew.calibration.conventions import WRONG, add_convention, stiffer_nut
from ballscrew.estimation.preload import preload
from ballscrew.estimation.samples import share_uncertainty

CLEARANCE = "a nut with clearance at 0.30 Ca of load"


def restated(sheet, **screw):
    return replace(sheet, screw=replace(sheet.screw, **screw))


@pytest.mark.parametrize("ratio", [0.5, 1.0, 2.08])
def test_a_stiffer_nut_is_that_of_a_sheet_with_more_rigidity(sheet, ratio) -> None:
    stiffer = restated(sheet, rigidity=ratio * sheet.screw.rigidity)
    expected = to_vector(from_sheet(stiffer, 0.2))
    np.testing.assert_allclose(stiffer_nut(to_vector(from_sheet(sheet, 0.2)), ratio), expected, rtol=1e-9)


def test_readings_of_a_rigidity(sheet) -> None:
    readings = other_readings(sheet.screw)
    assert readings[CLEARANCE] == pytest.approx(3 ** (2 / 3))
    assert readings["a nut preloaded at 0.05 Ca or R_nu,ar (ISO 3408-4) at 0.10 Ca"] == pytest.approx(
        2 ** (1 / 3)
    )
    assert len(readings) == 2
    clearance = restated(sheet, rigidity_convention="clearance", rigidity_preload_ratio=None)
    assert other_readings(clearance.screw)["a nut preloaded at 0.10 Ca"] == pytest.approx(3 ** (-2 / 3))


@pytest.fixture(scope="module")
def two_preloads(experiment):
    """Runs at two known preloads."""
    new = experiment(measured_at="2026-01-01T08:00Z")
    worn = experiment(ratio=0.5, measured_at="2026-03-01T08:00Z", loads=(100.0,))
    return [*new, *worn], {new[0].id: Quantity(600.0, 12.0, "N"), worn[0].id: Quantity(300.0, 6.0, "N")}


def test_two_known_preloads_name_the_convention(two_preloads, sheet) -> None:
    runs, known = two_preloads
    right = calibrate(runs, sheet, known=known)
    assert right.reasons == ()
    wrong = calibrate(runs, restated(sheet, rigidity=sheet.screw.rigidity / 3 ** (2 / 3)), known=known)
    best = wrong.conventions[0]
    assert (best.convention, best.probability) == (CLEARANCE, pytest.approx(1.0, abs=0.02))
    (doubt,) = (doubt for doubt in wrong.reasons if doubt.name == "rigidity")
    assert f"the data fit a K of {CLEARANCE} (ratio {best.ratio:.2f})" in doubt.text
    found = right.tolerances[0].estimate * 0.2 / math.sqrt(3)
    assert math.log(best.ratio) == pytest.approx(found, abs=0.06)
    stated = restated(
        sheet, rigidity=sheet.screw.rigidity / 3 ** (2 / 3), rigidity_convention="clearance",
        rigidity_preload_ratio=None, rigidity_load_ratio=0.30,
    )  # fmt: skip
    assert kappa(stated.screw) == pytest.approx(kappa(sheet.screw))
    assert calibrate(runs, stated, known=known).reasons == ()


def test_one_preload_leaves_other_conventions_possible(experiment, sheet) -> None:
    runs = experiment()
    model = calibrate(runs, sheet)
    others = sum(reading.probability for reading in model.conventions)
    assert WRONG / 10 < others < 1.2 * WRONG
    assert model.reasons == ()
    worn = experiment(3, ratio=0.5, loads=(100.0,))[0]
    plain = preload(worn, replace(model, conventions=()), runs[-1]).stiffness_relative_to_baseline
    mixed = preload(worn, model, runs[-1]).stiffness_relative_to_baseline
    assert plain is not None
    assert mixed is not None
    assert mixed.value == plain.value
    assert mixed.interval[1] - mixed.interval[0] > plain.interval[1] - plain.interval[0]


def test_an_interval_contains_the_truth_by_another_convention(experiment, sheet) -> None:
    """K of a stiff nut preloaded at 0.10 Ca, stated as R_nu,ar: 0.58 is the upper end by that alone."""
    stated = restated(sheet, rigidity=1.15 * sheet.screw.rigidity, rigidity_convention="iso")
    runs, worn = experiment(), experiment(3, ratio=0.6, loads=(100.0,))[0]
    model = calibrate(runs, stated)
    both = preload(worn, model, runs[-1])
    alone = preload(worn, replace(model, conventions=()), runs[-1]).stiffness_relative_to_baseline
    assert both.verdict == "good"
    assert both.stiffness_relative_to_baseline is not None
    assert alone is not None
    assert alone.interval[1] < 0.6 < both.stiffness_relative_to_baseline.interval[1]


def clearance_as_preloaded(sheet, rigidity, stiffness):
    """The sheet with K of a nut with clearance stated as preloaded; numbers relative to the sheet's."""
    soft = restated(sheet, rigidity=rigidity * sheet.screw.rigidity / 3 ** (2 / 3))
    return replace(soft, bearing=replace(sheet.bearing, stiffness=stiffness * sheet.bearing.stiffness))


def test_a_convention_that_the_data_do_not_exclude_is_in_the_interval(experiment, sheet) -> None:
    """Sheet within its tolerances, in the wrong convention, with some evidence for the stated one."""
    runs, worn = experiment(loads=(0.0, 100.0)), experiment(3, ratio=0.6, loads=(100.0,))[0]
    model = calibrate(runs, clearance_as_preloaded(sheet, 1.2, 1.15))
    (clearance,) = (reading for reading in model.conventions if reading.convention == CLEARANCE)
    others = sum(reading.probability for reading in model.conventions)
    assert clearance.probability < WRONG / 2 / (1 - WRONG) * (1 - others)
    estimate = preload(worn, model, runs[-1])
    assert estimate.verdict == "good"
    assert estimate.stiffness_relative_to_baseline is not None
    low, high = estimate.stiffness_relative_to_baseline.interval
    assert low < 0.6 < high


def test_the_interval_of_a_probable_convention_is_a_part_of_the_whole(experiment, sheet) -> None:
    runs, worn = experiment(loads=(0.0, 100.0)), experiment(3, ratio=0.6, loads=(100.0,))[0]
    model = calibrate(runs, sheet)

    def upper_end(*probabilities: float) -> float:
        pairs = zip(model.conventions, probabilities, strict=True)
        others = tuple(replace(reading, probability=probability) for reading, probability in pairs)
        estimate = preload(worn, replace(model, conventions=others), runs[-1])
        assert estimate.stiffness_relative_to_baseline is not None
        return estimate.stiffness_relative_to_baseline.interval[1]

    # The conventions other than that of the sheet are those of stiffer nuts, with larger losses.
    alone = upper_end(0.0, 0.0)
    assert upper_end(0.5, 0.3) == pytest.approx(alone, abs=0.008)
    assert upper_end(0.6, 0.3) < alone - 0.016


def test_a_better_convention_is_a_note_until_the_evidence_is_decisive(experiment, sheet) -> None:
    runs, worn = experiment(loads=(0.0, 100.0)), experiment(3, ratio=0.6, loads=(100.0,))[0]
    better = calibrate(runs, clearance_as_preloaded(sheet, 0.9, 0.85))
    assert better.reasons == ()
    assert any(note.startswith("the data fit a K of ") for note in better.notes)
    estimate = preload(worn, better, runs[-1])
    assert estimate.verdict == "good"
    assert any("check what the catalogue's K means" in note for note in estimate.notes)
    assert estimate.stiffness_relative_to_baseline is not None
    low, high = estimate.stiffness_relative_to_baseline.interval
    assert low < 0.6 < high
    decisive = calibrate(runs, clearance_as_preloaded(sheet, 0.75, 0.7))
    assert "rigidity" in [doubt.name for doubt in decisive.reasons]
    assert not any(note.startswith("the data fit a K of ") for note in decisive.notes)


def test_samples_of_a_convention_are_those_of_a_sheet_that_states_it(experiment, sheet) -> None:
    runs, worn = experiment(), experiment(3, ratio=0.6, loads=(100.0,))[0]
    other = calibrate(runs, restated(sheet, rigidity_convention="iso"))
    (its,) = (reading for reading in other.conventions if "preloaded" in reading.convention)
    certain = replace(other, conventions=(replace(its, probability=1.0),))
    right = replace(calibrate(runs, sheet), conventions=())
    first, second = (
        preload(worn, model, runs[-1]).stiffness_relative_to_baseline for model in (certain, right)
    )
    assert first is not None
    assert second is not None
    assert first.interval == pytest.approx(second.interval, abs=0.005)


def test_conventions_are_part_of_the_uncertainty_of_the_share(experiment, sheet) -> None:
    model = replace(calibrate(experiment(loads=(0.0, 50.0)), sheet), conventions=())
    change = np.zeros(8)
    change[PARAMETERS.index("share")] = 0.4
    even = replace(model, conventions=(ConventionEvidence("another", 0.5, 1.0, change, np.zeros(3)),))
    more = (
        share_uncertainty(even, DEFAULT_ASSUMPTIONS) ** 2 - share_uncertainty(model, DEFAULT_ASSUMPTIONS) ** 2
    )
    assert math.sqrt(more) == pytest.approx((1 - model.model.share) * 0.2)


def test_samples_follow_the_probability_of_a_convention(experiment, sheet) -> None:
    runs = experiment()
    model = replace(calibrate(runs, sheet), conventions=())
    change = np.zeros(8)
    change[PARAMETERS.index("preload")] = math.log(2)
    same = np.array([number.estimate for number in model.tolerances])
    certain = replace(model, conventions=(ConventionEvidence("another", 1.0, 1.0, change, same),))
    first, second = (preload(runs[-1], axis).preload_N for axis in (model, certain))
    assert first is not None
    assert second is not None
    assert second.interval[1] == pytest.approx(2 * first.interval[1], rel=1e-6)


@pytest.mark.parametrize("convention", ["measured", "unknown"])
def test_a_measured_rigidity_has_no_other_readings(experiment, sheet, convention) -> None:
    stated = restated(sheet, rigidity_convention=convention, rigidity_preload_ratio=None)
    assert calibrate(experiment(loads=(0.0, 50.0)), stated).conventions == ()


def test_a_convention_is_named_in_the_doubt_of_the_rigidity() -> None:
    others = [ConventionEvidence(CLEARANCE, 0.995, 0.97, np.zeros(8), np.zeros(3))]
    doubts = [Doubt("rigidity", "rigidity is estimated at 202 %"), Doubt("stiffness", "soft")]
    (other, named), notes = add_convention(doubts, others)
    assert other.name == "stiffness"
    assert named.text.startswith("rigidity is estimated at 202 %; the data fit a K of a nut with clearance")
    assert "(ratio 0.97)" in named.text
    assert "falls from 60 % to 0.5 %; check" in named.text
    assert notes == []
    assert add_convention(doubts, ()) == (doubts, [])


@pytest.mark.parametrize(
    ("others", "doubted", "noted"), [(0.67, 0, 0), (0.69, 0, 1), (0.98, 0, 1), (0.99, 1, 0)]
)
def test_evidence_for_another_convention_is_a_note_or_a_doubt(others, doubted, noted) -> None:
    readings = [ConventionEvidence(CLEARANCE, others, 1.0, np.zeros(8), np.zeros(3))]
    doubts, notes = add_convention([], readings)
    assert (len(doubts), len(notes)) == (doubted, noted)


def test_an_unknown_convention_is_named_where_the_data_determine_it(two_preloads, sheet) -> None:
    runs, known = two_preloads
    unknown = {"rigidity_convention": "unknown", "rigidity_preload_ratio": None}
    soft = restated(sheet, rigidity=sheet.screw.rigidity / 3 ** (2 / 3), **unknown)
    model = calibrate(runs, soft, known=known)
    assert model.reasons == ()
    assert any(f"most likely that of {CLEARANCE}" in note for note in model.notes)
    between = restated(sheet, rigidity=sheet.screw.rigidity / 3 ** (1 / 3), **unknown)
    assert not any(CLEARANCE in note for note in calibrate(runs[:5], between).notes)


def test_a_convention_that_fits_no_axis_is_left_out(experiment, sheet, monkeypatch) -> None:
    def fails(*_: object) -> None:
        raise MeasurementError("the calibration does not converge")

    monkeypatch.setattr("ballscrew.calibration.conventions.solve", fails)
    runs = experiment(loads=(0.0, 50.0))
    assert calibrate(runs, sheet).conventions == ()
    unknown = restated(sheet, rigidity_convention="unknown", rigidity_preload_ratio=None)
    assert not any("most likely" in note for note in calibrate(runs, unknown).notes)
