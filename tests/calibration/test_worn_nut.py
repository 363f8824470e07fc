"""Correction for the test's own load on a worn nut, and its uncertainty."""

from __future__ import annotations

import numpy as np
import pytest
from tests.estimation.made_runs import calibrated, run_of

from ballscrew.base.quantity import NORMAL_95
from ballscrew.calibration.assumptions import Assumptions
from ballscrew.calibration.frequency_table import frequency_table
from ballscrew.calibration.worn_nut import frequency_loss_under_load
from ballscrew.estimation.preload import preload

TERM = 1e-3


def test_it_grows_by_the_logarithm_of_the_wear() -> None:
    base = frequency_table(run_of(name="base", nut_load=TERM))
    rows = range(len(base.frequency))
    soft, doubt = frequency_loss_under_load(base, rows, 0.5, Assumptions(nut_load=1.2, nut_load_spread=0.7))
    np.testing.assert_allclose(soft, 1.2 * TERM * np.log(2), rtol=1e-6)
    np.testing.assert_allclose(doubt, 0.7 * TERM * np.log(2), rtol=1e-6)
    assumptions = Assumptions()
    assert frequency_loss_under_load(base, rows, 1.0, assumptions)[0].max() == 0
    half, twice, tenth = (frequency_loss_under_load(base, rows, r, assumptions)[0] for r in (0.5, 2.0, 0.1))
    np.testing.assert_allclose(twice, -half)  # relative to a worn nut
    np.testing.assert_allclose(tenth / half, np.log(10) / np.log(2))  # nothing is cut off
    plain = frequency_table(run_of(name="base"))
    assert (
        frequency_loss_under_load(plain, rows, 0.5, assumptions)[0].max() == 0
    )  # nothing stated, nothing corrected


def test_the_interval_contains_no_correction_at_all() -> None:
    assumptions = Assumptions()
    assert NORMAL_95 * assumptions.nut_load_spread > assumptions.nut_load


@pytest.mark.parametrize("multiple", [0.0, 1.0, 2.0, 3.0])
def test_the_interval_contains_the_true_ratio_for_any_effect_of_the_load(multiple: float) -> None:
    """From no effect to twice the correction."""
    ratio, term = 0.5, 3e-3
    run = run_of(ratio, level=-multiple * term * np.log(1 / ratio), nut_load=term)
    model = calibrated(share=1e-4)
    quiet = Assumptions(bearing_drift=0, load=0, position=0, share=0, tilt=0, form=0, temperature_unknown=0)
    found = preload(run, model, run_of(name="base", nut_load=term), assumptions=quiet).relative_to_baseline
    assert found is not None
    low, high = found.interval
    assert low < ratio < high


def test_the_correction_is_reported_with_its_size() -> None:
    run, base = run_of(0.5, nut_load=TERM), run_of(name="base", nut_load=TERM)
    found = preload(run, calibrated(), base)
    without = preload(run, calibrated(), base, assumptions=Assumptions(nut_load=0.0))
    assert found.relative_to_baseline is not None
    assert without.relative_to_baseline is not None
    more = 100 * (found.relative_to_baseline.value / without.relative_to_baseline.value - 1)
    corrections = [text for text in found.corrections if text.startswith("load on a worn nut")]
    assert len(corrections) == 1
    assert float(corrections[0].split(":")[1].split("%")[0]) == pytest.approx(more, abs=0.15)
    assert "±" in corrections[0]
    assert without.corrections == ()
    assert without.relative_to_baseline.value == pytest.approx(0.5, rel=1e-6)
