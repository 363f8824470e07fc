from __future__ import annotations

import numpy as np
import pytest

from ballscrew.recording.encoder import interpolation_error

RATE = 8000.0


def moves(step=1e-8):
    """Six moves of 30 mm at speeds that differ a little, there and back, and the encoder's steps."""
    random = np.random.default_rng(2)
    speeds = []
    for index in range(6):
        speed = 0.15 * (1 + 0.003 * random.standard_normal()) * (1 if index < 3 else -1)
        ramp = np.linspace(0, 1, 480) * speed
        speeds += [np.zeros(400), ramp, np.full(1100, speed), ramp[::-1]]
    position = np.cumsum(np.concatenate(speeds)) / RATE
    return np.round(position / step) * step


@pytest.mark.parametrize(("amplitude", "period"), [(1e-6, 20e-6), (2e-7, 20.48e-6), (1e-6, 80e-6)])
def test_an_error_per_period_is_found(amplitude, period):
    x = moves()
    error = amplitude * np.sin(2 * np.pi * x / period)
    assert np.std(interpolation_error(x + error, RATE) - error) < 0.05 * np.std(error)


@pytest.mark.parametrize("step", [1e-8, 1e-6, 2e-6])
def test_a_good_encoder_has_none(step):
    assert not interpolation_error(moves(step), RATE).any()


def test_an_axis_that_stands_has_none():
    assert not interpolation_error(np.zeros(4000), RATE).any()
    assert not interpolation_error(1e-8 * np.random.default_rng(0).standard_normal(4000), RATE).any()
