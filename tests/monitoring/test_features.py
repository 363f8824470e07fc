"""Features that others use."""

from __future__ import annotations

import math

import numpy as np
import pytest
from tests.estimation.made_runs import run_of

from ballscrew.base.errors import InputError
from ballscrew.monitoring.features import kurtosis, of_run, response_peak, rms, three_sigma


def test_of_a_sine() -> None:
    wave = 2 * np.sin(2 * np.pi * 50.3 * np.arange(4000) / 1000) + 7
    assert rms(wave) == pytest.approx(math.sqrt(2), rel=1e-3)
    assert kurtosis(wave) == pytest.approx(1.5, rel=1e-3)
    assert response_peak(wave, 1000.0, (10, 400)) == pytest.approx(50.3, abs=0.02)


def test_of_noise_and_of_nothing() -> None:
    assert kurtosis(np.random.default_rng(1).standard_normal(200_000)) == pytest.approx(3, abs=0.05)
    assert math.isnan(kurtosis(np.ones(9)))


@pytest.mark.parametrize("signal", [[], [1.0], [1.0, float("nan")]])
def test_signals_that_are_none(signal: list[float]) -> None:
    for one in (rms, kurtosis):
        with pytest.raises(InputError, match="signal of"):
            one(signal)


def test_a_band_without_a_line() -> None:
    with pytest.raises(InputError, match="no line"):
        response_peak(np.ones(100), 1000.0, (600, 900))
    with pytest.raises(InputError, match="rate"):
        response_peak(np.ones(100), 0.0, (1, 9))


def test_a_run_tells_its_friction_and_frequency() -> None:
    told = of_run(run_of())
    assert told["coulomb_N"] == 45.0
    assert told["mean_frequency_Hz"] > 0


def test_three_sigma_takes_two_in_a_row() -> None:
    base = [1.0, 1.1, 0.9, 1.05, 0.95]
    assert three_sigma([*base, 2.0, 1.0, 2.0, 2.0], 5) == 8
    assert three_sigma([*base, 0.1, 0.1], 5) is None
    assert three_sigma([*base, 0.1, 0.1], 5, sign=-1) == 6
    with pytest.raises(InputError, match="baseline"):
        three_sigma(base, 1)
