"""Tolerances as limits of the samples of a calibration."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from ballscrew.axis.axial_prior import prior, tolerated
from ballscrew.base.quantity import Quantity
from ballscrew.calibration.assumptions import Assumptions
from ballscrew.calibration.calibrated_axis import ToleranceEstimate
from ballscrew.calibration.calibration import calibrate
from ballscrew.calibration.model_forms import ModelForm, model_forms, without_rotor
from ballscrew.calibration.tolerances import (
    estimate_tolerances,
    is_part_of_prior,
    log_density_ratio,
    resample_within_tolerances,
)
from ballscrew.estimation.preload import preload
from ballscrew.estimation.samples import normal_samples

Array = NDArray[np.float64]

END = math.sqrt(3.0)
ROW = np.array([0.3, 0.0, 0.0, 0.1, 0.0, -0.2, 0.05])


def test_the_density_is_level_within_the_tolerance_and_integrates_to_1() -> None:
    z = np.linspace(-12.0, 12.0, 240_001)
    density = np.exp(log_density_ratio(z[:, None]) - z**2 / 2)
    assert float(np.sum(density) * (z[1] - z[0])) == pytest.approx(1.0, abs=1e-3)
    inside = density[np.abs(z) < END]
    assert inside.max() / inside.min() < 1.1
    assert float(np.sum(density[np.abs(z) > END]) * (z[1] - z[0])) == pytest.approx(0.02 * 0.3173, abs=2e-4)


def test_two_numbers_count_each_for_itself() -> None:
    pair = np.array([[0.3, 2.0], [-1.0, 0.0]])
    alone = log_density_ratio(pair[:, :1]) + log_density_ratio(pair[:, 1:])
    np.testing.assert_allclose(log_density_ratio(pair), alone)


def chosen(found: float, spread: float, prior_size: float = 1e-6, *, copies: int = 1) -> Array:
    """Samples of a number that a calibration estimates as ``found`` ± ``spread``."""
    prior_covariance = np.outer(ROW, ROW) + prior_size * np.eye(7)
    samples, beside = normal_samples(spread**2 * np.outer(ROW, ROW), copies, 40_000)
    also = [ToleranceEstimate(f"friction {k}", np.zeros(7), 0.0) for k in range(copies - 1)]
    at = resample_within_tolerances(
        [ToleranceEstimate("rigidity", ROW, found), *also], prior_covariance, samples, beside, 10_000
    )
    return np.asarray(found + samples[at] @ ROW / float(ROW @ ROW))


def test_a_number_by_the_sheet_alone_lies_within_its_tolerance() -> None:
    samples = chosen(0.0, 1.0)
    assert np.quantile(samples, 0.975) == pytest.approx(1.656, abs=0.03)  # of a normal one 1.96
    assert np.quantile(samples, 0.25) == pytest.approx(-END / 2, abs=0.03)  # of a normal one -0.67
    assert abs(np.mean(samples)) < 0.02


def test_a_number_by_the_data_is_unchanged() -> None:
    samples = chosen(0.5, 0.1)
    assert np.mean(samples) == pytest.approx(0.5, abs=0.02)
    assert np.std(samples) == pytest.approx(0.1, rel=0.03)


@pytest.mark.parametrize("found", [1.8, 4.0, 100.0, -1000.0])
def test_a_number_beyond_its_tolerance_retains_the_normal_distribution(found: float) -> None:
    samples = chosen(found, 0.3)
    assert np.mean(samples) == pytest.approx(found, abs=1e-9 * abs(found) + 0.003)
    assert np.std(samples) == pytest.approx(0.3, rel=0.02)


def test_numbers_that_do_not_matter_change_nothing() -> None:
    quantiles = [0.025, 0.5, 0.975]
    alone, among = (np.quantile(chosen(0.0, 1.0, copies=n), quantiles) for n in (1, 12))
    np.testing.assert_allclose(among, alone, atol=0.03)


def test_two_numbers_with_a_measured_sum_vary_within_their_tolerances() -> None:
    """Their sum is measured, their difference is by the sheet: uniform over a square, cut by a line."""
    rows = np.zeros((2, 7))
    rows[0, 5], rows[1, 6] = 0.2, 0.1  # share and preload
    whole = rows.T @ rows + 1e-9 * np.eye(7)
    tie = np.array([1.0, 1.0]) / math.sqrt(2)
    remaining = np.eye(2) - np.outer(tie, tie) * (1 - 1e-6)
    samples, beside = normal_samples(rows.T @ remaining @ rows, 2, 40_000)
    numbers = [
        ToleranceEstimate(name, row, 0.0)
        for name, row in zip(("rigidity", "preload_ratio"), rows, strict=True)
    ]
    at = resample_within_tolerances(numbers, whole, samples, beside, 10_000)
    first, second = samples[at, 5] / 0.2, samples[at, 6] / 0.1
    np.testing.assert_allclose(first, -second, atol=0.02)
    assert np.quantile(first, 0.975) == pytest.approx(0.95 * END, abs=0.03)  # of normal ones 1.39
    assert np.std(first) == pytest.approx(1.0, abs=0.03)


def test_a_number_that_the_vector_does_not_determine_is_sampled_beside_it() -> None:
    """A number with an effect far below the errors of the model is not bounded by the vector."""
    whole = np.outer(ROW, ROW) + 100.0 * np.eye(7)
    samples, beside = normal_samples(whole, 1, 40_000)
    at = resample_within_tolerances([ToleranceEstimate("rigidity", ROW, 0.0)], whole, samples, beside, 10_000)
    assert np.std(samples[at][:, 0]) == pytest.approx(np.std(samples[:, 0]), rel=0.05)
    assert np.quantile(beside[at, 0], 0.975) == pytest.approx(1.656, abs=0.03)


def test_without_tolerances_every_sample_counts_once() -> None:
    samples, beside = normal_samples(np.eye(7), 0)
    at = resample_within_tolerances((), np.eye(7), samples, beside, len(samples))
    np.testing.assert_array_equal(at, np.arange(len(samples)))


def test_effects_larger_than_the_prior_or_beside_it_are_no_part_of_it() -> None:
    whole = np.outer(ROW, ROW) + np.diag([1e-4, 0.0, 0.0, 1e-4, 0.0, 1e-4, 1e-4])
    assert is_part_of_prior((), whole)
    assert is_part_of_prior([ToleranceEstimate("rigidity", ROW, 0.0)], whole)
    assert not is_part_of_prior([ToleranceEstimate("rigidity", 1.2 * ROW, 0.0)], whole)
    assert not is_part_of_prior([ToleranceEstimate("rigidity", ROW + 0.1 * np.eye(7)[1], 0.0)], whole)
    assert not is_part_of_prior(
        [ToleranceEstimate("rigidity", ROW, 0.0), ToleranceEstimate("stiffness", ROW, 0.0)], whole
    )


def test_the_prior_contains_the_tolerances(sheet) -> None:
    for form in model_forms(sheet, 0.225, 50.0):
        columns = np.stack(list(form.tolerances.values()), axis=1)
        remaining = form.covariance - columns @ columns.T
        assert np.linalg.eigvalsh(remaining).min() > -1e-9 * np.linalg.eigvalsh(form.covariance).max()
        assert is_part_of_prior(estimate_tolerances(form, form.mean), form.covariance)
    assert set(tolerated(sheet, 0.225)) == {"rigidity", "stiffness", "preload_ratio"}


def test_the_effects_of_eq_3_are_those_of_a_sheet_that_is_another(sheet) -> None:
    own, eq3 = model_forms(sheet, 0.225, 50.0)[:2]
    for name, effects in own.tolerances.items():
        other = without_rotor(replace(own, mean=own.mean + 1e-4 * effects), 50.0)
        free = np.isfinite(eq3.mean)
        moved = other.mean[free] - eq3.mean[free]
        np.testing.assert_allclose(1e-4 * eq3.tolerances[name][free], moved, rtol=1e-3, atol=1e-9)


def test_a_calibration_finds_the_number_of_the_sheet_that_is_wrong(experiment, sheet) -> None:
    runs = experiment()
    known = {runs[0].id: Quantity(600.0, 6.0, "N")}
    right = {number.field: number.estimate for number in calibrate(runs, sheet, known=known).tolerances}
    low = replace(sheet, screw=replace(sheet.screw, preload_ratio=0.8 * sheet.screw.preload_ratio))
    model = calibrate(runs, low, known=known)
    found = {number.field: number.estimate for number in model.tolerances}
    assert found["preload_ratio"] - right["preload_ratio"] == pytest.approx(math.log(1.25) / 0.0866, rel=0.1)
    assert found["preload_ratio"] > END
    reasons = [doubt.text for doubt in model.reasons if doubt.name == "preload_ratio"]
    assert len(reasons) == 1
    assert "a tolerance of ± 15 %" in reasons[0]
    assert calibrate(runs, sheet).reasons == ()
    estimate = preload(runs[-1], model)
    assert estimate.verdict == "suspect"
    assert any("(preload_ratio): preload_ratio is estimated at" in reason for reason in estimate.reasons)


def test_a_number_outside_its_tolerance_is_a_doubt_only_if_it_is_significant(experiment, sheet) -> None:
    new = experiment(measured_at="2026-01-01T08:00Z")
    worn = experiment(ratio=0.25, measured_at="2026-03-01T08:00Z", loads=(100.0,))
    known = {new[0].id: Quantity(600.0, 12.0, "N"), worn[0].id: Quantity(150.0, 3.0, "N")}
    models = []
    for factor in (1.0, 0.75, 0.7):
        # Measured, so that no other convention of K explains it.
        rigidity = 0.8 * factor * sheet.screw.rigidity
        screw = replace(sheet.screw, rigidity=rigidity, rigidity_convention="measured")
        wrong = replace(sheet, screw=screw, tolerances={"rigidity": 0.2})
        models.append(calibrate([*new, *worn], wrong, known=known))
    assert ["rigidity" in {doubt.name for doubt in model.reasons} for model in models] == [False, False, True]
    noted = [any("rigidity is estimated at" in note for note in model.notes) for model in models]
    assert noted == [False, True, False]


def test_frequencies_far_from_the_sheet_are_a_doubt_at_one_preload(experiment, sheet) -> None:
    rigid = {"rigidity_convention": "measured", "rigidity_preload_ratio": 0.1}
    for factor, doubted in ((0.8, False), (0.25, True)):
        screw = replace(sheet.screw, rigidity=factor * sheet.screw.rigidity, **rigid)
        wrong = replace(sheet, screw=screw, tolerances={"rigidity": 0.2})
        reasons = calibrate(experiment(loads=(0.0, 50.0)), wrong).reasons
        assert bool(reasons) == doubted, reasons
    assert any("standard deviations from those of the data sheet" in doubt.text for doubt in reasons) or any(
        "rigidity is estimated at" in doubt.text for doubt in reasons
    )


def test_a_vector_moved_by_a_number_is_attributed_to_it(sheet) -> None:
    mean, covariance = prior(sheet, 0.225)
    effects = tolerated(sheet, 0.225)
    form = ModelForm("free rotor", mean, covariance, effects)
    for which in effects:
        found = {number.field: number.estimate for number in estimate_tolerances(form, mean + effects[which])}
        assert found[which] == max(found.values())
        assert 0.5 < found[which] < 1.05


def test_a_sheet_without_tolerances_has_none(sheet) -> None:
    exact = replace(sheet, tolerances=dict.fromkeys(("rigidity", "stiffness", "preload_ratio"), 0.0))
    assert model_forms(exact, 0.225, 50.0)[0].tolerances == {}
    assert estimate_tolerances(model_forms(exact, 0.225, 50.0)[0], prior(exact, 0.225)[0]) == ()


def test_a_preload_by_the_sheet_alone_lies_within_its_tolerance(experiment, sheet) -> None:
    runs = experiment()
    model = replace(calibrate(runs, sheet), conventions=())
    fixed_bearing = Assumptions(bearing_drift=0.0)  # whose own uncertainty no tolerance bounds
    bounded = preload(runs[-2], model, runs[-1], assumptions=fixed_bearing).preload_N
    unbounded = replace(model, tolerances=())
    plain = preload(runs[-2], unbounded, runs[-1], assumptions=fixed_bearing).preload_N
    assert bounded is not None
    assert plain is not None
    assert bounded.value == plain.value
    assert np.ptp(bounded.interval) < 0.99 * np.ptp(plain.interval)


def test_with_a_known_preload_the_tolerances_hardly_matter(experiment, sheet) -> None:
    runs = experiment()
    known = {runs[0].id: Quantity(600.0, 6.0, "N")}
    model = replace(calibrate(runs, sheet, known=known), conventions=())
    bounded = preload(runs[-1], model).preload_N
    plain = preload(runs[-1], replace(model, tolerances=())).preload_N
    assert bounded is not None
    assert plain is not None
    assert bounded.standard_uncertainty == pytest.approx(plain.standard_uncertainty, rel=0.06)
