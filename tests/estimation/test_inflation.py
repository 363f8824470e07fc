"""A misfit inflates the uncertainty: by its size, or by a change at some stops only."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from tests.estimation.made_runs import LOAD, calibrated, run_of

from ballscrew.calibration.assumptions import Assumptions
from ballscrew.estimation.causes import PossibleCause
from ballscrew.estimation.inflation import GRADIENT, LOCAL, UNEXPLAINED, inflate_uncertainty
from ballscrew.estimation.preload import preload

BASE = run_of(name="base")


def test_the_interval_contains_the_true_ratio_behind_a_bow() -> None:
    found = preload(run_of(0.9, softer=lambda x: 0.05 * np.cos(4 * np.pi * x)), calibrated(), BASE)
    assert found.stiffness_relative_to_baseline is not None
    low, high = found.stiffness_relative_to_baseline.interval
    assert low < 0.9 < high
    assert found.terms[0].name == LOCAL
    assert any("the interval includes this misfit" in reason for reason in found.reasons)


def test_an_unexplained_misfit_inflates_the_uncertainty() -> None:
    cells = np.random.default_rng(2)
    run = run_of(0.9, uncertainty=5e-4, softer=lambda x: 4e-3 * cells.standard_normal(len(x)))
    found = preload(run, calibrated(), run_of(name="base", uncertainty=5e-4))
    assert found.fused is not None
    assert found.chi2 is not None
    assert found.degrees is not None
    assert found.probability is not None
    assert found.probability < 0.01
    term, random = found.fused.terms[UNEXPLAINED]
    rest = np.sqrt(found.fused.spread**2 - term**2)
    assert found.fused.spread / rest == pytest.approx(np.sqrt(found.chi2 / found.degrees), rel=1e-6)
    assert not random


def test_newtons_against_the_model_contain_the_misfit_too() -> None:
    """The baseline is not of the calibration, so the newtons are by the model."""
    sure = calibrated(compliance=1e-5, mass=1e-5, slope=1e-5, rotor=1e-5, share=1e-4, preload=1e-4, runs=())
    base = run_of(name="base")
    even, bowed = (
        preload(run_of(0.9, softer=lambda x, size=size: size * np.cos(4 * np.pi * x)), sure, base).preload_N
        for size in (0.0, 0.05)
    )
    assert even is not None
    assert bowed is not None
    assert bowed.standard_uncertainty > 2 * even.standard_uncertainty


def test_a_misfit_beyond_all_bounds_is_refused() -> None:
    found = preload(run_of(0.9, softer=lambda x: 0.05 * np.cos(12 * np.pi * x)), calibrated(), BASE)
    assert found.verdict == "refused"
    assert "no preload explains all cells" in found.reasons[0]
    assert "no upper end" in found.reasons[0]


@pytest.mark.parametrize("ratio", [1.0, 0.5])
def test_a_run_that_one_preload_explains_is_not_inflated(ratio: float) -> None:
    found = preload(run_of(ratio), calibrated(), BASE)
    assert found.fused is not None
    assert not found.fused.terms.keys() & {LOCAL, UNEXPLAINED}


def test_a_misfit_that_another_cause_explains_inflates_nothing() -> None:
    cells = np.random.default_rng(2)
    run = run_of(0.9, uncertainty=5e-4, softer=lambda x: 4e-3 * cells.standard_normal(len(x)))
    misfit = preload(run, calibrated(), run_of(name="base", uncertainty=5e-4))
    plain = preload(run_of(0.9), calibrated(), BASE).fused
    assert misfit.fused is not None
    assert plain is not None
    fused = replace(plain, probability=misfit.fused.probability, chi2=misfit.fused.chi2)
    evidence: Any = None  # which only a local change takes
    moved = PossibleCause("position", 0.9, 1.0, 0.02, 1e-3, "m", True, "a zero that has moved")
    assert inflate_uncertainty(fused, evidence, [moved], Assumptions()) == fused
    nothing = inflate_uncertainty(fused, evidence, [replace(moved, possible=False)], Assumptions())
    assert nothing.terms.keys() - fused.terms.keys() == {UNEXPLAINED}


def test_the_misfit_of_a_run_with_a_wrong_load_is_that_without_its_effect() -> None:
    spreads = []
    for hidden in (8.0, -8.0):
        run = run_of(lambda x: 0.8 + 0.9 * x, true_load=LOAD + hidden, uncertainty=1e-4)
        base = run_of(name="base", uncertainty=1e-4)
        found = preload(run, calibrated(), base, assumptions=Assumptions(torque_trusted=True))
        assert found.mass is not None
        assert found.mass.decision == "corrected"
        assert any("the likeliest cause is a screw that is warmer" in reason for reason in found.reasons)
        assert found.terms[0].name == GRADIENT
        spreads.append(found.terms[0].standard_uncertainty)
    assert spreads[0] == pytest.approx(spreads[1], rel=0.1)
