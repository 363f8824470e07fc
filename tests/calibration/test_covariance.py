"""Errors of bearing and worn nut between two experiments: counted once, and corrected once."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.estimation.made_runs import BEARING, MODEL, run_of

from ballscrew.axis.axial import PARAMETERS
from ballscrew.base.quantity import NORMAL_95, Quantity
from ballscrew.calibration.assumptions import Assumptions
from ballscrew.calibration.calibration import calibrate, solve_calibration
from ballscrew.calibration.covariance import (
    WORN_NUT,
    ExperimentVariation,
    error_correlation,
    experiment_covariance,
    experiment_effects,
    joint_covariance,
    with_repeating_load,
    worn_nut_slopes,
)
from ballscrew.calibration.frequency_table import frequency_table
from ballscrew.calibration.worn_nut import frequency_loss_under_load
from ballscrew.modal.cell import SharedError
from ballscrew.modal.run import Run

DAY, LATER = "2026-01-01T08:00+00:00", "2026-03-01T08:00+00:00"
TERM = 2e-3


def test_the_effect_of_the_load_repeats_from_run_to_run() -> None:
    runs = [frequency_table(with_load(run_of(name=name), TERM)) for name in ("one", "two")]
    again = [with_repeating_load(run) for run in runs]
    soft = [name.startswith("load") for name in again[0].shared_names]
    assert any(soft)
    assert not runs[0].repeats[soft].any()
    assert again[0].repeats[soft].all()
    np.testing.assert_array_equal(again[0].repeats[~np.array(soft)], runs[0].repeats[~np.array(soft)])
    n, f = len(runs[0].frequency), runs[0].frequency
    common = joint_covariance(again)[:n, n:] / np.outer(f, f)
    assert np.diag(common) == pytest.approx(0.9 * TERM**2, rel=1e-6)
    plain = frequency_table(run_of())
    assert with_repeating_load(plain).repeats.tolist() == plain.repeats.tolist()


@pytest.mark.parametrize(("name", "correlation"), [("clock", 0.9), ("damping", 1.0), ("residual", 0.0)])
def test_the_error_by_the_place_of_the_dampers_is_the_same_in_every_run(
    name: str, correlation: float
) -> None:
    table = frequency_table(with_load(run_of(), TERM, name=name, repeats=name != "residual"))
    n, f = len(table.frequency), table.frequency
    common = joint_covariance([table, table])[:n, n:] / np.outer(f, f)
    assert common == pytest.approx(np.full((n, n), correlation * TERM**2), rel=1e-6)
    assert not joint_covariance([table, table], 0.0)[:n, n:].any()  # of two axes
    assert error_correlation(name, 0.0) == 0.0


def test_calibration_and_preload_correct_the_load_on_a_worn_nut_alike() -> None:
    run, assumptions = frequency_table(run_of(nut_load=TERM)), Assumptions()
    soft, _ = frequency_loss_under_load(run, range(len(run.frequency)), 0.5, assumptions)
    np.testing.assert_allclose(worn_nut_slopes([run], assumptions) * np.log(0.5), -soft, rtol=1e-12)
    assert not worn_nut_slopes([frequency_table(run_of())], assumptions).any()


def test_effects_of_bearing_and_worn_nut_are_as_large_as_stated() -> None:
    variation = ExperimentVariation(BEARING, Assumptions(bearing_drift=0.02, nut_load_spread=0.5))
    run = frequency_table(run_of(nut_load=TERM))
    bearing, worn = experiment_effects(run, MODEL, variation, np.log(0.5))
    whole = 1 + MODEL.slope * (run.position - MODEL.centre)
    np.testing.assert_allclose(bearing, 0.5 * 0.02 / NORMAL_95 * BEARING / whole)
    np.testing.assert_allclose(worn, 0.5 * np.log(2) * TERM, rtol=1e-6)
    # A run that does not state the term has the error that was found in such runs.
    np.testing.assert_array_equal(
        experiment_effects(frequency_table(run_of()), MODEL, variation, 0.0)[1], WORN_NUT
    )


def test_a_bearing_is_common_to_a_day_and_a_nut_to_a_preload() -> None:
    variation = ExperimentVariation(BEARING, Assumptions(bearing_drift=0.02))
    first = frequency_table(run_of(name="first", measured_at=DAY))
    same_day = frequency_table(run_of(0.5, name="second", measured_at=DAY))
    later = [frequency_table(run_of(0.5, name=name, measured_at=LATER)) for name in ("third", "fourth")]
    whole = experiment_covariance([first, same_day, *later], [0, 1, 2, 2], MODEL, variation)
    n = len(first.frequency)

    def block(i: int, j: int) -> np.ndarray:
        return whole[i * n : (i + 1) * n, j * n : (j + 1) * n]

    bearing, worn = experiment_effects(later[0], MODEL, variation, np.log(0.5))
    assert not block(0, 0).any()
    np.testing.assert_allclose(block(1, 1), np.outer(worn, worn))
    np.testing.assert_allclose(block(2, 3), np.outer(worn, worn) + np.outer(bearing, bearing))
    assert not block(1, 2).any()


def test_impossible_frequencies_have_a_finite_covariance() -> None:
    far = frequency_table(run_of(0.5, name="far", nut_load=TERM, measured_at=LATER))
    for factor in (1e-100, 1e-6, 1e6, 1e100):
        other = replace(far, frequency=far.frequency * factor, shared=far.shared * factor)
        runs = [frequency_table(run_of(measured_at=DAY)), other]
        assert np.isfinite(experiment_covariance(runs, [0, 1], MODEL, ExperimentVariation(BEARING))).all()


def with_load(run: Run, term: float, low: float = 0.0, *, name: str = "load", repeats: bool = False) -> Run:
    """The run with a term "load" of its uncertainty, and frequencies that are too low by a part."""
    cells = tuple(replace(c, frequency_Hz=c.frequency_Hz * (1 - low)) for c in run.cells)
    effects = tuple(term * c.frequency_Hz for c in cells)
    more = SharedError(name, repeats, effects)
    sure = tuple(
        replace(c, standard_uncertainty_Hz=float(np.hypot(c.standard_uncertainty_Hz, e)))
        for c, e in zip(cells, effects, strict=True)
    )
    return replace(run, cells=sure, shared_errors=(*run.shared_errors, more))


def two_known(experiment, truth, low: float, **more):
    runs = [with_load(run, TERM) for run in experiment(measured_at=DAY)]
    worn = with_load(experiment(ratio=0.5, measured_at=LATER, loads=(100.0,))[0], TERM, low)
    known = {
        runs[0].id: Quantity(truth.preload, 0.005 * truth.preload, "N"),
        worn.id: Quantity(truth.preload / 2, 0.0025 * truth.preload, "N"),
    }
    return [*runs, worn], {"known": known, **more}


def test_the_load_on_a_worn_nut_does_not_change_the_share(experiment, sheet, truth) -> None:
    assumptions = Assumptions()
    low = assumptions.nut_load * TERM * np.log(2)
    shares = {}
    for name, size, assumed in (
        ("no load", 0.0, Assumptions(nut_load=0.0)),
        ("corrected", low, assumptions),
        ("not corrected", low, Assumptions(nut_load=0.0)),
    ):
        runs, given = two_known(experiment, truth, size, assumptions=assumed)
        shares[name] = calibrate(runs, sheet, **given).model.share
    assert shares["corrected"] == pytest.approx(shares["no load"], rel=0.02)
    assert shares["not corrected"] > 1.03 * shares["no load"]


def test_a_bearing_that_may_have_drifted_makes_the_share_less_certain(experiment, sheet, truth) -> None:
    spread = {}
    for drift in (0.0, 0.01, 0.05):
        runs, given = two_known(experiment, truth, 0.0, assumptions=Assumptions(bearing_drift=drift))
        spread[drift] = calibrate(runs, sheet, **given).standard_uncertainty("share")
    assert spread[0.0] < spread[0.01] < spread[0.05]
    # On one day there is one bearing: nothing is lost.
    one_day = [
        calibrate(experiment(measured_at=DAY), sheet, assumptions=Assumptions(bearing_drift=d)).covariance
        for d in (0.0, 0.05)
    ]
    np.testing.assert_array_equal(*one_day)


def test_the_slopes_of_the_rows_are_those_of_the_rows(experiment, sheet, truth) -> None:
    runs, given = two_known(experiment, truth, 0.0)
    _, fit = solve_calibration(runs, sheet, given["known"], Assumptions())
    at, problem = fit.unknown, fit.problem
    for k in (PARAMETERS.index("share"), len(at) - 1):
        step = np.zeros(len(at))
        step[k] = 1e-5
        by = (problem.predicted(at + step) - problem.predicted(at - step)) / 2e-5
        np.testing.assert_allclose(problem.jacobian(at)[:, k], by, atol=1e-7)


def test_the_model_records_its_assumptions(experiment, sheet) -> None:
    made = calibrate(experiment(), sheet, assumptions=Assumptions(bearing_drift=0.03, nut_load=1.0)).made
    assert (made.settings["bearing_drift"], made.settings["nut_load"]) == (0.03, [1.0, 0.8])
