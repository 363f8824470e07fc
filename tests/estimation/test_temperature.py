"""Temperature: its effect by baselines, their common error, and temperatures that were not recorded."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from tests.estimation.made_runs import calibrated, run_of

from ballscrew.base.arrays import Array
from ballscrew.base.quantity import Quantity
from ballscrew.calibration.assumptions import Assumptions
from ballscrew.calibration.calibrated_axis import TemperatureSlope
from ballscrew.calibration.temperature import fit_temperature_slope
from ballscrew.estimation.estimate import PreloadEstimate
from ballscrew.estimation.preload import preload
from ballscrew.modal.run import Run
from ballscrew.recording.temperature import TemperatureCourse
from ballscrew.testbed.example import AXIS
from ballscrew.testbed.machine import Machine
from ballscrew.testbed.temperature import warmed

KNOWN = TemperatureSlope(0.0, 0.01)


def fitted_slope(
    changes: list[float], own: float, differences: list[float], prior: TemperatureSlope, shared: float = 0.0
) -> TemperatureSlope:
    """Slope of changes with own errors and an error common to all."""
    covariance = own**2 * np.eye(len(changes)) + shared**2
    return fit_temperature_slope(np.array(changes), np.array(differences), covariance, prior)


def test_the_slope_is_a_regression_with_a_prior() -> None:
    slope = fitted_slope([0.1, 0.2], 1e-6, [5.0, 10.0], KNOWN)
    assert slope.value == pytest.approx(0.02)
    assert slope.standard_uncertainty < 1e-5
    nothing = fitted_slope([], 1.0, [], KNOWN)
    assert (nothing.value, nothing.standard_uncertainty) == (0.0, pytest.approx(0.01))


def test_copies_at_one_temperature_do_not_average_the_first_baselines_error() -> None:
    shared = 0.03
    spreads = [
        fitted_slope([0.0] * count, 0.01, [2.0] * count, KNOWN, shared).standard_uncertainty
        for count in (1, 20, 400)
    ]
    least = 1 / np.hypot(1 / KNOWN.standard_uncertainty, 2.0 / shared)
    assert spreads[0] > spreads[1] > spreads[2] > least
    assert spreads[2] == pytest.approx(least, rel=0.01)


def test_the_error_of_a_correction_is_as_stated() -> None:
    """Slope, baseline's error and own errors sampled many times, with the common part."""
    rng = np.random.default_rng(4)
    temperatures, own, shared, hot = np.array([2.0, 2.0, 3.0, -1.0]), 0.01, 0.03, 6.0
    errors = []
    for _ in range(4000):
        slope, base = 0.01 * rng.standard_normal(), shared * rng.standard_normal()
        levels = slope * temperatures + base + own * rng.standard_normal(4)
        fitted = fitted_slope(levels.tolist(), own, temperatures.tolist(), KNOWN, shared)
        errors.append(base + (slope - fitted.value) * hot)
    variance = shared**2 + (fitted.standard_uncertainty * hot) ** 2 - 2 * hot * fitted.shared * shared**2
    assert np.std(errors) == pytest.approx(np.sqrt(variance), rel=0.05)


def test_the_prior_of_a_calibration_is_where_the_fit_starts() -> None:
    prior = TemperatureSlope(0.03, 0.001)
    assert fitted_slope([], 1.0, [], prior).value == prior.value
    both = fitted_slope([0.1], 0.01, [5.0], prior)
    assert 0.02 < both.value < 0.03
    assert both.standard_uncertainty < 0.001


def ratio(found: PreloadEstimate) -> Quantity:
    assert found.relative_to_baseline is not None
    return found.relative_to_baseline


def test_many_warm_copies_of_a_baseline_that_is_off_do_not_make_a_false_slope_certain() -> None:
    base = run_of(name="base", temperature_C=20.0, level=1e-3, uncertainty=1e-3)
    more = [run_of(name=f"warm {i}", temperature_C=22.0, uncertainty=1e-3, seed=i) for i in range(20)]
    found = preload(run_of(temperature_C=40.0, uncertainty=1e-3), calibrated(), base, more=more)
    low, high = ratio(found).interval
    assert low < 1 < high
    assert any("an extrapolation" in reason for reason in found.reasons)
    near = preload(run_of(temperature_C=23.0, uncertainty=1e-3), calibrated(), base, more=more)
    assert not any("carried" in reason for reason in near.reasons)


def test_temperature_is_corrected_where_baselines_determine_its_effect() -> None:
    at = {"temperature_C": 20.0}
    warm_days = [
        run_of(np.exp(0.02 * (t - 20)), name=f"day {t}", temperature_C=t, seed=i)
        for i, t in enumerate((15.0, 25.0, 30.0))
    ]
    base = run_of(name="base", **at)
    run = run_of(0.8 * np.exp(0.02 * 10), temperature_C=30.0)
    fitted = preload(run, calibrated(), base, more=warm_days)
    assumed = preload(run, calibrated(), base)
    assert ratio(fitted).value == pytest.approx(0.8, rel=0.03)
    assert any(text.startswith("temperature") for text in fitted.corrections)
    assert ratio(assumed).value == pytest.approx(0.8 * np.exp(0.2), rel=1e-3)
    low, high = ratio(assumed).interval
    assert low < 0.8 < high  # the default spread holds it


@pytest.mark.parametrize("recorded", [(None, None), (20.0, None), (None, 20.0)])
def test_a_missing_temperature_widens_the_interval(recorded: tuple[float | None, float | None]) -> None:
    known = preload(run_of(0.8, temperature_C=20.0), calibrated(), run_of(name="base", temperature_C=20.0))
    run, base = run_of(0.8, temperature_C=recorded[0]), run_of(name="base", temperature_C=recorded[1])
    found = preload(run, calibrated(), base)
    part = Assumptions().temperature * Assumptions().temperature_unknown
    assert ratio(found).standard_uncertainty == pytest.approx(
        np.hypot(ratio(known).standard_uncertainty, 0.8 * part), rel=0.03
    )
    assert any(term.name == "temperature (not recorded)" for term in found.terms)
    assert any("was not recorded" in note for note in found.notes)
    assert not any("temperature" in note for note in known.notes)


def test_further_baselines_do_not_replace_the_unknown_temperature_of_the_first() -> None:
    """Their temperatures less that of the first are not known, so they determine no slope."""
    run, base = run_of(0.8, temperature_C=20.0), run_of(name="base", temperature_C=None)
    more = [run_of(name=f"day {t}", temperature_C=t, seed=i) for i, t in enumerate((21.0, 22.0))]
    alone, found = preload(run, calibrated(), base), preload(run, calibrated(), base, more=more)
    assert ratio(found).standard_uncertainty == pytest.approx(ratio(alone).standard_uncertainty, rel=1e-9)


def warm(run: Run, **course: float) -> Run:
    """The run with a recorded temperature of 20 °C in the mean."""
    values = {"mean_C": 20.0, "start_C": 20.0, "end_C": 20.0, "range_K": 0.0} | course
    return replace(run, temperature=TemperatureCourse(**values, place="nut"))


def test_the_slope_of_the_calibration_corrects_a_run() -> None:
    model = replace(calibrated(), temperature=TemperatureSlope(0.02, 0.001))
    base = run_of(name="base", temperature_C=20.0)
    found = preload(run_of(0.8 * np.exp(0.2), temperature_C=30.0), model, base)
    assert ratio(found).value == pytest.approx(0.8, rel=0.01)
    assumed = preload(run_of(0.8 * np.exp(0.2), temperature_C=30.0), calibrated(), base)
    assert ratio(found).standard_uncertainty < 0.75 * ratio(assumed).standard_uncertainty


def test_a_temperature_that_changes_during_the_run_widens_the_interval() -> None:
    base, run = run_of(name="base", temperature_C=20.0), run_of(0.8, temperature_C=21.0)
    steady = ratio(preload(warm(run), calibrated(), base)).standard_uncertainty
    changing = ratio(preload(warm(run, range_K=6.0), calibrated(), base)).standard_uncertainty
    assert changing == pytest.approx(np.hypot(steady, 0.8 * 0.01 * 6.0 / np.sqrt(12)), rel=0.05)


def test_a_sensor_elsewhere_is_noted() -> None:
    base, run = run_of(name="base", temperature_C=20.0), run_of(temperature_C=21.0)
    bed = replace(run, temperature=TemperatureCourse(21.0, 21.0, 21.0, 0.0, None, "bed"))
    found = preload(bed, calibrated(), base)
    assert "the temperature of the run was recorded at 'bed', not at nut or screw" in found.notes
    stated = preload(replace(bed, temperature_C=23.0), calibrated(), base)
    assert not any("recorded at" in note for note in stated.notes)


@pytest.mark.parametrize("difference", [0.0, 0.01])
def test_a_temperature_that_varied_in_a_run_of_the_same_mean_is_uncertain(difference: float) -> None:
    model = replace(calibrated(), temperature=TemperatureSlope(0.02, 0.001))
    base = run_of(name="base", temperature_C=20.0)
    even, varied = (
        preload(warm(run_of(0.8, temperature_C=20.0 + difference), range_K=range_K), model, base)
        for range_K in (0.0, 5.0)
    )
    added = ratio(varied).standard_uncertainty ** 2 - ratio(even).standard_uncertainty ** 2
    assert added == pytest.approx((0.8 * 0.02 * 5.0 / math.sqrt(12)) ** 2, rel=0.1)


def warm_screw_reasons(
    excess: float | None, base_excess: float | None, *, calibrated_base: bool
) -> list[str]:
    model, run = calibrated(), run_of(temperature_C=21.0)
    base = run_of(name="base" if calibrated_base else "other", temperature_C=20.0)
    if excess is not None:
        run = warm(run, screw_above_nut_K=excess)
    if base_excess is not None:
        base = warm(base, screw_above_nut_K=base_excess)
    found = preload(run, model, base)
    reasons = [reason for reason in found.reasons if "the screw was" in reason]
    assert not reasons or found.verdict == "suspect"
    notes = [note for note in found.notes if "no temperature of screw and nut" in note]
    assert len(notes) == ((excess is None) != (base_excess is None))
    return reasons


def test_a_screw_warmer_than_its_nut_makes_the_preload_suspect() -> None:
    (reason,) = warm_screw_reasons(5.0, None, calibrated_base=True)
    assert reason.startswith("the screw was 5.0 K warmer than its nut in the run, which raises")
    assert "14 %" in reason
    (reason,) = warm_screw_reasons(None, -5.0, calibrated_base=True)
    assert "5.0 K colder than its nut in the baseline" in reason
    (reason,) = warm_screw_reasons(4.0, 1.0, calibrated_base=True)
    assert "3.0 K warmer against its nut than in the baseline" in reason
    assert warm_screw_reasons(1.0, None, calibrated_base=True) == []
    assert warm_screw_reasons(5.0, 5.0, calibrated_base=True) == []  # as in the calibration
    assert len(warm_screw_reasons(5.0, 5.0, calibrated_base=False)) == 2


def test_a_warm_screw_without_a_baseline_makes_the_preload_suspect() -> None:
    found = preload(warm(run_of(), screw_above_nut_K=10.0), calibrated())
    assert any("10.0 K warmer than its nut" in reason for reason in found.reasons)


def test_a_run_far_outside_the_temperatures_of_the_calibration_is_suspect() -> None:
    slope = TemperatureSlope(0.02, 0.001, lowest=18.0, highest=33.0)
    model, base = replace(calibrated(), temperature=slope), run_of(name="base", temperature_C=18.0)
    far = preload(run_of(temperature_C=60.0), model, base)
    assert far.verdict == "suspect"
    assert any("at +0.0 to +15.0 K" in reason and "+42.0 K" in reason for reason in far.reasons)
    hot_base = preload(run_of(temperature_C=60.0), model, run_of(name="base", temperature_C=55.0))
    assert any("an extrapolation" in reason for reason in hot_base.reasons)
    within = preload(run_of(temperature_C=30.0), model, run_of(name="base", temperature_C=60.0))
    assert any("which is outside this range" in reason for reason in within.reasons)
    near = preload(run_of(temperature_C=40.0), model, base)
    assert not any("an extrapolation" in reason for reason in near.reasons)


def test_baselines_of_another_day_share_the_drift_of_the_bearing() -> None:
    def slope_spread(day: str, drift: float | None) -> float:
        base = run_of(name="base", temperature_C=20.0, measured_at="2026-01-01T08:00Z")
        more = [
            run_of(name=f"warm {i}", temperature_C=24.0, measured_at=f"{day}T{8 + i:02d}:00Z", seed=i)
            for i in range(4)
        ]
        run = run_of(temperature_C=40.0, measured_at="2026-03-01T08:00Z")
        found = preload(run, calibrated(), base, more=more, assumptions=Assumptions(bearing_drift=drift))
        return next(term.standard_uncertainty for term in found.terms if term.name == "temperature")

    assert slope_spread("2026-01-01", 0.03) == pytest.approx(slope_spread("2026-01-01", 0.0))
    assert slope_spread("2026-01-05", 0.03) > 1.1 * slope_spread("2026-01-01", 0.03)


@pytest.mark.parametrize(("gradient", "end"), [(10.0 / 0.45, "far"), (-10.0 / 0.45, "near")])
def test_a_gradient_along_the_screw_is_named_and_widens_the_interval(gradient: float, end: str) -> None:
    base = run_of(name="base", uncertainty=1e-4)
    machine = Machine(AXIS, AXIS.nominal_preload)
    colder = max(-gradient * 0.45, 0.0)  # so that one end is as warm as the nut

    def pressed(x: Array) -> Array:
        return np.asarray(warmed(machine, colder, gradient).local_preload(x)) / machine.preload

    found = preload(run_of(pressed, uncertainty=1e-4, local=True), calibrated(), base)
    assert found.verdict == "suspect"
    assert any(f"warmer towards its {end} end" in reason for reason in found.reasons)
    low, high = ratio(found).interval
    assert low < 1 < high
    even = preload(run_of(0.8, uncertainty=1e-4), calibrated(), base)
    assert not any("warmer towards" in text for text in (*even.reasons, *even.notes))


def test_runs_of_the_calibration_do_not_count_again_for_its_slope() -> None:
    base = run_of(name="base", temperature_C=20.0)
    warm_run = run_of(np.exp(0.5), name="warm", temperature_C=25.0)  # far off the slope
    run = run_of(0.8 * np.exp(0.2), temperature_C=30.0)
    ratios = []
    for runs in (("base", "warm"), ("base",)):
        model = replace(calibrated(runs=runs), temperature=TemperatureSlope(0.02, 0.01))
        ratios.append(ratio(preload(run, model, base, more=[warm_run])).value)
    assert ratios[0] == pytest.approx(0.8, rel=0.01)
    assert abs(ratios[1] - 0.8) > 0.05
