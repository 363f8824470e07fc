from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ballscrew.modal.output_error import cell_bound
from ballscrew.modal.output_error.plant import free_decay, padded_lines, respond


def test_sensitivities_by_differences_give_the_same_bound(ring, plant, rate):
    """J by central differences of the simulated cell, eliminated by plain least squares."""
    _, _, noise, initial, force = ring(repetitions=3)
    samples = force.shape[1]

    def rung(p):
        out = respond(p.transfer(padded_lines(samples, rate)), force)
        for mode, (f, z) in enumerate(zip(p.frequency, p.damping, strict=True)):
            out = out + initial[:, mode] @ free_decay(f, z, samples, rate)
        return out

    def slope(name, index, step):
        sides = []
        for sign in (1, -1):
            value = getattr(plant, name)
            if index is None:
                value = value + sign * step
            else:
                value = tuple(v + sign * step * (k == index) for k, v in enumerate(value))
            sides.append(rung(replace(plant, **{name: value})))
        return (sides[0] - sides[1]) / (2 * step)

    wanted = [("frequency", 0, 1e-3), ("damping", 0, 1e-5), ("frequency", 1, 1e-3), ("damping", 1, 1e-5)]
    wanted += [("gain", 0, 1e-3), ("gain", 1, 1e-3), ("rigid", None, 1e-3), ("delay", None, 1e-7)]
    own = [np.ones(samples), np.linspace(-1, 1, samples)]
    own += [
        c
        for f, z in zip(plant.frequency, plant.damping, strict=True)
        for c in free_decay(f, z, samples, rate)
    ]
    shared = np.array([slope(*each) for each in wanted]).reshape(len(wanted), -1)
    local = np.kron(np.eye(3), np.array(own))
    jacobian = np.concatenate([shared, local])
    scale = np.linalg.norm(jacobian, axis=1)
    covariance = np.linalg.inv((jacobian / scale[:, None]) @ (jacobian / scale[:, None]).T)
    expected = noise * np.sqrt(np.diag(covariance))[:4] / scale[:4]
    bound = cell_bound(plant, force, rate, noise, initial=initial)
    np.testing.assert_allclose(bound.frequency, expected[[0, 2]], rtol=1e-3)
    np.testing.assert_allclose(bound.damping, expected[[1, 3]], rtol=1e-3)


def test_it_falls_with_the_noise_and_with_repetitions(ring, plant, rate):
    force = ring(repetitions=2)[4]
    one = cell_bound(plant, force, rate, 1.0)
    assert cell_bound(plant, force, rate, 0.1).frequency == pytest.approx(one.frequency / 10)
    four = cell_bound(plant, np.tile(force, (4, 1)), rate, 1.0)
    assert four.frequency == pytest.approx(one.frequency / 2)


def test_whatever_is_unknown_besides_raises_it(ring, plant, rate):
    force = ring()[4]
    base = cell_bound(plant, force, rate, 1.0).frequency
    assert np.all(cell_bound(plant, force, rate, 1.0, delay=False).frequency < base)
    assert np.all(cell_bound(plant, force, rate, 1.0, phases=True).frequency > base)
    assert np.all(cell_bound(plant, force, rate, 1.0, band=(50.0, 400.0)).frequency > base)
    assert np.all(cell_bound(plant, force, rate, 1.0, force_noise=1.0).frequency > base)
    assert np.all(cell_bound(plant, force, rate, 1.0, drift=4).frequency >= base * (1 - 1e-9))
