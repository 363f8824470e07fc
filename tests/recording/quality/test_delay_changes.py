from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.recording.quality.conftest import codes, moved
from tests.recording.synthetic import changed

from ballscrew.recording.quality.delay import delay_change, part_lags

TIME = np.arange(20.0)
CERTAIN = np.full(20, 1e-6)


def scatter(size: float, seed: int = 0) -> np.ndarray:
    return size * np.random.default_rng(seed).standard_normal(20)


@given(seed=st.integers(0, 10_000), size=st.floats(0, 3e-5))
def test_scatter_is_no_change(seed, size):
    assert delay_change(scatter(size, seed), CERTAIN, TIME) is None


def test_one_odd_part_is_no_change():
    lag = scatter(1e-5)
    lag[0], lag[-1], lag[7] = 5e-3, -5e-3, 5e-3
    assert delay_change(lag, CERTAIN, TIME) is None


def test_a_step_is_reported_with_its_place():
    found = delay_change(scatter(1e-5) + np.where(TIME > 12.5, 2.5e-3, 0.0), CERTAIN, TIME)
    assert found.by == pytest.approx(2.5e-3, abs=5e-5)
    assert found.time == pytest.approx(12.5)


def test_a_drift_has_no_place():
    found = delay_change(scatter(1e-5) + 1e-4 * TIME, CERTAIN, TIME)
    assert found.by == pytest.approx(1.9e-3, rel=0.02)
    assert np.isnan(found.time)


def test_what_changes_by_less_than_matters_passes():
    assert delay_change(np.where(TIME > 9.5, 0.2e-3, 0.0), CERTAIN, TIME) is None


def test_a_change_within_the_scatter_passes():
    assert delay_change(scatter(1e-4) + np.where(TIME > 9.5, 0.4e-3, 0.0), CERTAIN, TIME) is None


@pytest.mark.parametrize("known", [0, 1, 7, 9])
def test_too_few_known_parts_show_no_change(known):
    lag = np.where(TIME > 3.5, 5e-3, 0.0)
    lag[known:] = np.nan
    assert delay_change(lag, CERTAIN, TIME) is None


def test_lags_are_measured_between_samples():
    time = np.arange(3000) / 1000
    model = np.sin(2 * np.pi * 9 * time) * np.exp(-(((time - 1.5) / 0.3) ** 2))
    signal = -3 + 0.5 * np.interp(time - 4.3e-3, time, model)
    parts = [np.arange(1000, 1400), np.arange(1500, 1900)]
    lags, uncertainties = part_lags(signal, model, parts, 1000.0)
    assert lags == pytest.approx([4.3e-3, 4.3e-3], abs=5e-5)
    assert (uncertainties < 5e-5).all()


def test_what_is_not_alike_or_at_the_edge_has_no_lag():
    random = np.random.default_rng(0)
    x = random.standard_normal((2, 2000))
    parts = [np.arange(0, 200), np.arange(800, 1000), np.arange(1800, 2000)]
    assert np.isnan(part_lags(x[0], x[1], parts, 1000.0)).all()
    assert np.isnan(part_lags(np.zeros(2000), x[1], parts, 1000.0)).all()


def test_the_uncertainty_of_a_lag_is_its_error_by_a_force_of_any_phase():
    time = np.arange(3000) / 1000
    model = np.exp(-(((time - 1.35) / 0.04) ** 2)) - np.exp(-(((time - 1.65) / 0.04) ** 2))
    errors, reported = [], []
    for phase in np.linspace(0, 2 * np.pi, 16, endpoint=False):
        signal = model + 0.05 * np.sin(2 * np.pi * 4 * time + phase)
        lags, uncertainties = part_lags(signal, model, [np.arange(1100, 1900)], 1000.0)
        errors.append(lags[0])
        reported.append(uncertainties[0])
    assert np.mean(reported) == pytest.approx(np.std(errors), rel=0.15)


def test_a_step_within_the_uncertainty_of_the_lags_passes():
    """Forces that repeat with every turn: smooth on the way out, smooth on the way back."""
    lag = 1e-4 * np.concatenate([np.linspace(1, 2, 10), np.linspace(-2, -1, 10)])
    assert delay_change(lag, np.full(20, 1.2e-4), TIME) is None
    assert delay_change(lag, np.full(20, 5e-5), TIME) is not None


@pytest.mark.parametrize("lost", [6, 32, 300])
def test_samples_lost_in_one_accelerometer_are_reported_as_such(run, lost):
    def shortened(_, x):
        at = int(0.6 * len(x))
        return np.concatenate([x[:at], x[at + lost :], x[-lost:]])

    findings = moved(changed(run.one, shortened, "acc1_x"), run.plan)
    assert "delay-changes" in codes(findings)
    assert not {"delay", "unrelated"} & codes(findings).keys()
    message = next(f.message for f in findings if f.code == "delay-changes")
    assert "acceleration:nut-1:x shifts by" in message
    assert "samples of one of them were lost" in message


def test_accelerometers_on_another_clock_are_reported_as_such(run):
    def drifting(_, x):
        index = np.arange(len(x), dtype=float)
        return np.interp(index * (1 + 3e-3 * 12800 / len(x)), index, x)

    findings = moved(changed(run.one, drifting, "acc1_x", "acc2_x"), run.plan)
    reported = [f.message for f in findings if f.code == "delay-changes"]
    assert len(reported) == 2
    assert all("separate clocks" in message for message in reported)


@pytest.mark.parametrize("lost", [1, 2])
def test_a_single_sample_that_is_lost_does_not_matter(run, lost):
    def shortened(_, x):
        at = int(0.6 * len(x))
        return np.concatenate([x[:at], x[at + lost :], x[-lost:]])

    assert "delay-changes" not in codes(moved(changed(run.one, shortened, "acc1_x"), run.plan))
