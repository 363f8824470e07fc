from __future__ import annotations

import numpy as np
import pytest

from ballscrew.modal.output_error.fit import _at, fit, one_step
from ballscrew.modal.output_error.lines import cell_lines
from ballscrew.modal.output_error.model import Poles
from ballscrew.modal.output_error.plant import padded_lines, respond

SPAN = (50.0, 400.0)


@pytest.mark.parametrize("structure", ["prompt", "classical", "general"])
@pytest.mark.parametrize("input_noise", [0.0, 0.5])
def test_the_gradient_is_that_of_the_cost(ring, rate, structure, input_noise):
    force, response, *_ = ring(level=20)
    lines = cell_lines(force, np.stack([response, 2 * response[::-1]]), rate, SPAN)
    poles = Poles(
        np.array([148.0, 240.0]), np.array([0.035, 0.02]), 1e-4 * (structure != "general"), structure
    )
    weight = np.stack([np.linspace(1, 2, len(lines.omega)), np.ones(len(lines.omega))])
    gradient = _at(lines, poles, weight, input_noise).gradient
    step = 1e-6
    for index in range(len(poles.vector)):
        moved = np.zeros(len(poles.vector))
        moved[index] = step
        up, down = (_at(lines, poles.moved(s * moved), weight, input_noise).fit.cost for s in (1, -1))
        assert gradient[index] == pytest.approx(-(up - down) / (4 * step), rel=1e-3, abs=1e-3)


def test_without_noise_it_finds_the_plant(ring, plant, rate):
    force, response, *_ = ring(level=250)
    lines = cell_lines(force, response, rate, SPAN)
    found = fit(lines, Poles(np.array([146.0, 242.0]), np.array([0.04, 0.04])), rounds=60)
    np.testing.assert_allclose(found.poles.frequency, plant.frequency, rtol=1e-6)
    np.testing.assert_allclose(found.poles.damping, plant.damping, rtol=1e-4)
    assert found.poles.delay == pytest.approx(plant.delay, rel=1e-3)


def test_one_step_goes_where_the_fit_would(ring, rate):
    force, response, *_ = ring(level=20)
    lines = cell_lines(force, response, rate, SPAN)
    found = fit(lines, Poles(np.array([149.0, 236.0]), np.array([0.03, 0.03])), rounds=40)
    start = found.poles.moved(np.array([1e-4, -1e-4, 1e-3, 1e-3, 1e-3]))
    step, covariance = one_step(lines, start, np.ones((1, len(lines.omega))), 0.0)
    np.testing.assert_allclose(start.moved(step).frequency, found.poles.frequency, rtol=1e-5)
    assert np.all(np.diag(covariance) > 0)


def test_noise_on_the_force_biases_only_what_does_not_know_of_it(plant, rate):
    """A force of 1 with noise of 0.7: the gain comes out a third too small, unless the noise is known."""
    rng = np.random.default_rng(0)
    force = rng.standard_normal((40, 1280))
    response = respond(plant.transfer(padded_lines(1280, rate)), force)
    measured = force + 0.7 * rng.standard_normal(force.shape)
    start = Poles(np.array([150.0, 235.0]), np.array([0.03, 0.025]), 5e-5)
    right, wrong, mended = (
        fit(cell_lines(u, response, rate, SPAN), start, input_noise=noise).factor[0, 2]
        for u, noise in ((force, 0.0), (measured, 0.0), (measured, 0.49))
    )
    assert wrong / right == pytest.approx(1 / 1.49, abs=0.06)
    assert mended / right == pytest.approx(1.0, abs=0.08)
