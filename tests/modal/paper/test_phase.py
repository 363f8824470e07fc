"""The phase that a mode has and a null of the torque has not."""

from __future__ import annotations

import numpy as np
import pytest

from ballscrew.modal.paper.lines import Lines
from ballscrew.modal.paper.phase import read_phase
from ballscrew.modal.spectra import Spectra

GRID = np.arange(100.0, 200.0, 0.2)
LOW = np.arange(5.0, 100.0, 0.2)


def nut(frequency, damping=0.04, pole=150.0):
    """Torque to nut acceleration: one resonator."""
    r = frequency / pole
    return 1 / (1 - r**2 + 2j * damping * r)


def motor(frequency, damping=0.04, pole=150.0, zero=115.0):
    """Torque to motor acceleration: a zero at the rotor-held frequency, then the pole."""
    s = frequency / zero
    return (1 - s**2 + 2j * damping * s) * nut(frequency, damping, pole)


def reading(response, *, at=150.0, delay=0.0, polarity=1.0, of_motor=False):
    def curve(frequency):
        return polarity * response(frequency) * np.exp(-2j * np.pi * frequency * delay)

    ones = np.ones((3, len(GRID)), complex)
    lines = Lines(GRID, ones, np.tile(curve(GRID), (1, 3, 1)))
    low = Spectra(LOW, np.ones(len(LOW)), np.abs(curve(LOW))[None] ** 2, curve(LOW)[None], 3)
    return read_phase(lines, low, at, motor=of_motor)


@pytest.mark.parametrize("damping", [0.01, 0.04, 0.07])
@pytest.mark.parametrize("polarity", [1.0, -1.0])
def test_a_mode_at_the_nut(damping, polarity):
    phase = reading(lambda f: nut(f, damping), polarity=polarity)
    assert phase.at_peak == pytest.approx(-90, abs=3)
    below, above = (np.degrees(np.angle(nut(x, damping))) for x in (135.0, 165.0))
    assert phase.fall == pytest.approx(below - above, abs=1.0)
    assert 60 < phase.fall < 180


def test_a_mode_at_the_motor():
    phase = reading(motor, of_motor=True)
    assert phase.at_peak == pytest.approx(-90, abs=15)
    assert reading(motor).at_peak > 0, "at the nut that phase would be wrong"


def test_a_delay_of_a_sample_or_two_is_no_reason():
    # 8° at 150 Hz, less the 2° by which the axis as one mass is late
    assert reading(nut, delay=1.5e-4).at_peak == pytest.approx(-96, abs=2)


def test_beside_a_mode_the_phase_is_not_that_of_one():
    assert reading(nut, at=140.0).at_peak > -55
    assert reading(nut, at=160.0).at_peak < -125
    assert reading(lambda f: nut(f, pole=400.0)).fall < 10


def test_without_lines_below_there_is_no_phase():
    lines = Lines(GRID, np.ones((1, len(GRID)), complex), np.ones((1, 1, len(GRID)), complex))
    far = Spectra(GRID[:1], np.ones(1), np.ones((1, 1)), np.ones((1, 1), complex), 1)
    assert np.isnan(read_phase(lines, far, 150.0, motor=False).at_peak)
