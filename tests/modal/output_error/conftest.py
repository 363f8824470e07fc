from __future__ import annotations

import numpy as np
import pytest

from ballscrew.modal.output_error.plant import ModalPlant, free_decay, padded_lines, respond

RATE, SAMPLES = 6400.0, 1280
PLANT = ModalPlant((150.0, 235.0), (0.03, 0.025), (1.2, -0.4), 0.9, 5e-5)


def ring(plant=PLANT, level=10.0, seed=0, repetitions=10, force_noise=0.0, samples=SAMPLES, tilt=False):
    """A cell: pulses that differ a little, ringing at the start, drift; white noise, or falling with tilt."""
    rng = np.random.default_rng(seed)
    time = np.arange(samples) / RATE
    start = 0.03 + rng.uniform(-0.003, 0.003, (repetitions, 1))
    length = 0.06 * (1 + rng.uniform(-0.05, 0.05, (repetitions, 1)))
    force = 100 * np.clip(np.minimum((time - start) / 0.0025, (start + length - time) / 0.0025), 0, 1)
    force += 0.5 * rng.standard_normal(force.shape)
    clean = respond(plant.transfer(padded_lines(samples, RATE)), force)
    initial = 0.3 * clean.std() * rng.standard_normal((repetitions, len(plant.frequency), 2))
    for mode, (f, z) in enumerate(zip(plant.frequency, plant.damping, strict=True)):
        clean = clean + initial[:, mode] @ free_decay(f, z, samples, RATE)
    drift = np.stack([np.ones(samples), np.linspace(-1, 1, samples)])
    clean = clean + 0.2 * clean.std() * rng.standard_normal((repetitions, 2)) @ drift
    noise = clean.std() * 10 ** (-level / 20)
    white = rng.standard_normal(clean.shape)
    if tilt:
        white = np.apply_along_axis(np.convolve, -1, white, np.ones(12) / 4)[:, :samples]
    measured = force + force_noise * rng.standard_normal(force.shape)
    return measured, clean + noise * white, noise, initial, force


@pytest.fixture(name="ring")
def _ring():
    return ring


@pytest.fixture(name="plant")
def _plant():
    return PLANT


@pytest.fixture(name="rate")
def _rate():
    return RATE
