"""Stiffness and softening: two results for the nut that agree, or exclude each other."""

from __future__ import annotations

import math

import numpy as np
import pytest
from tests.estimation.made_runs import calibrated, run_of
from tests.monitoring.histories import unloading

from ballscrew.axis.hertz import RELEASE
from ballscrew.base.quantity import Quantity
from ballscrew.calibration.assumptions import Assumptions
from ballscrew.estimation.nut import (
    NutEvidence,
    describe_contradiction,
    nut_quantity,
    nut_ratios,
    release_limit,
)
from ballscrew.estimation.preload import preload

BEARING_OVER_NUT = 0.5
STIFFNESS = Quantity(1.0, 0.02, "", (0.96, 1.04))


def evidence(ratio: float) -> NutEvidence:
    return NutEvidence(0.10, stated=False, log_ratio=math.log(ratio), log_ratio_spread=0.10)


def deviation(ratio: float) -> float:
    """Difference of the two u over its standard uncertainty, by hand."""
    u = math.pow(ratio, -1 / 3)
    return (u - 1) / math.sqrt((0.02 / 3) ** 2 + (BEARING_OVER_NUT * 0.10) ** 2 + (u * 0.10 / 3) ** 2)


@pytest.mark.parametrize(("ratio", "excluded"), [(1.0, False), (0.66, False), (0.60, True), (0.45, True)])
def test_stiffness_and_softening_exclude_each_other_beyond_one_in_a_hundred(
    ratio: float, excluded: bool
) -> None:
    assert (deviation(ratio) > 2.6) == excluded
    assert bool(describe_contradiction(STIFFNESS, BEARING_OVER_NUT, evidence(ratio))) == excluded


def test_an_interval_of_two_results_that_exclude_each_other_contains_both() -> None:
    found = nut_quantity(STIFFNESS, BEARING_OVER_NUT, evidence(0.45))
    assert found is not None
    assert found.interval[0] < 0.45 < 1.0 < found.interval[1]
    normal = np.random.default_rng(1).standard_normal((20_000, 2))
    ratios = 1 + 0.02 * np.random.default_rng(2).standard_normal(20_000)
    samples, weight = nut_ratios(ratios, np.full(20_000, BEARING_OVER_NUT), evidence(0.45), normal, 0.0)
    assert weight == pytest.approx(0.5, abs=0.05)
    assert np.percentile(samples, [2.5, 97.5]) == pytest.approx(found.interval, rel=0.1)


def test_a_contradiction_is_a_reason_against_the_nut_alone() -> None:
    def softening(ratio: float) -> Quantity:
        value = 132.0 / (600.0 * ratio)
        return Quantity(value, 0.1 * value, "kg/N")

    base = run_of(name="base", mass_over_preload_kg_per_N=softening(1.0))
    found = preload(run_of(1.0, mass_over_preload_kg_per_N=softening(0.2)), calibrated(), base)
    assert (found.verdict, found.nut_verdict) == ("good", "suspect")
    assert "exclude each other" in found.nut_reasons[0]
    assert found.relative_to_baseline is not None
    assert found.relative_to_baseline.interval[0] < 0.2 < 1.0 < found.relative_to_baseline.interval[1]


def test_newtons_by_a_baseline_outside_the_calibration_use_the_softening_too() -> None:
    """A sound nut beside a bearing that lost 15 % of its rigidity after the baseline."""

    def softer(x: np.ndarray) -> np.ndarray:
        return (1 / 0.85 - 1) * 0.37 / (1 + 1.4 * (x - 0.225))

    known = Quantity(0.22, 0.022, "kg/N")
    sure = calibrated(compliance=1e-4, mass=1e-4, slope=1e-4, rotor=1e-4, share=1e-3, preload=1e-3)
    base = run_of(name="elsewhere", mass_over_preload_kg_per_N=known)
    found = preload(run_of(1.0, softer=softer, mass_over_preload_kg_per_N=known), sure, base)
    assert found.preload_N is not None
    assert found.relative_to_baseline is not None
    assert found.relative_to_baseline.interval[0] < 1.0 < found.relative_to_baseline.interval[1]
    assert found.preload_N.value == pytest.approx(600 * found.relative_to_baseline.value, rel=1e-3)
    assert found.preload_N.interval[0] < 600.0 < found.preload_N.interval[1]


def test_a_bearing_that_may_have_changed_too_much_leaves_the_nut_without_an_upper_end() -> None:
    wide = NutEvidence(0.9, stated=True)
    assert nut_quantity(STIFFNESS, BEARING_OVER_NUT, NutEvidence(0.1, stated=True)) is not None
    assert nut_quantity(Quantity(3.0, 0.5, "", (2.0, 4.5)), 1.5, wide) is None
    base = run_of(name="base")
    found = preload(run_of(3.0), calibrated(), base, assumptions=Assumptions(bearing_drift=0.5))
    assert (found.verdict, found.nut_verdict) == ("good", "refused")
    assert found.nut_reasons == (
        "within the support bearing's possible change the nut's preload has no upper end",
    )
    assert found.relative_to_baseline is None
    assert found.stiffness_relative_to_baseline is not None


def test_the_limit_of_an_unloaded_nut_is_as_certain_as_the_baselines_softening() -> None:
    (run,) = unloading(4.0, [run_of(0.2)])
    limits = []
    for relative in (None, 0.01, 0.2):
        known = None if relative is None else Quantity(0.22, relative * 0.22, "kg/N")
        (base,) = unloading(1.0, [run_of(name="base", mass_over_preload_kg_per_N=known)])
        limits.append(release_limit(run, base, calibrated(preload=0.09)))
    by_model, certain, uncertain = (math.log(limit * RELEASE) for limit in limits if limit is not None)
    assert by_model / 0.09 == pytest.approx(certain / 0.01)
    assert uncertain == pytest.approx(20 * certain)
