from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.modal.plant import way

from ballscrew.fcft.plan import Motion
from ballscrew.recording.kinematics import differentiate, kinematics, rates

RATE = 2000.0
ENCODER = 5e-8  # m, the EMPS record's


def sine(frequency, amplitude, seconds=2.0, rate=RATE):
    t = np.arange(round(seconds * rate)) / rate
    w = 2 * np.pi * frequency
    return amplitude * np.sin(w * t), amplitude * w * np.cos(w * t), -amplitude * w * w * np.sin(w * t)


@pytest.mark.parametrize("order", [0, 1, 2])
@pytest.mark.parametrize("frequency", [1.0, 5.0, 20.0])
def test_a_sinusoid_loses_what_a_gaussian_takes(order, frequency):
    smoothing = 3e-3
    got = differentiate(sine(frequency, 0.1)[0], RATE, smoothing, order)
    want = sine(frequency, 0.1)[order] * np.exp(-0.5 * (2 * np.pi * frequency * smoothing) ** 2)
    # Central differences take (w/rate)²/6 each: 0.07 % at 20 Hz.
    inner = slice(100, -100)
    np.testing.assert_allclose(got[inner], want[inner], rtol=0, atol=2e-3 * np.abs(want).max())


@pytest.mark.parametrize("size", [2, 3, 10, 4000])
def test_both_rates_at_once_are_the_two_derivatives(size):
    """But for the last sample of either end, where a difference has one neighbour only."""
    x = sine(5.0, 0.1)[0][:size] if size < 4000 else sine(5.0, 0.1)[0]
    speed, acceleration = rates(x, RATE, 3e-3)
    assert speed.shape == acceleration.shape == x.shape
    if size < 4000:
        assert np.all(np.isfinite([*speed, *acceleration]))
        return
    np.testing.assert_allclose(speed, differentiate(x, RATE, 3e-3, 1), rtol=0, atol=1e-5)
    np.testing.assert_allclose(acceleration, differentiate(x, RATE, 3e-3, 2), rtol=0, atol=1e-2)
    inner = slice(20, -20)
    np.testing.assert_allclose(speed[inner], differentiate(x, RATE, 3e-3, 1)[inner], rtol=0, atol=1e-12)
    want = differentiate(x, RATE, 3e-3, 2)
    np.testing.assert_allclose(acceleration[inner], want[inner], rtol=0, atol=1e-9)


def test_a_jerk_limited_move():
    move = way([0.0, 0.1], 4000, Motion(0.2, 4.0, 400.0, 0.3))
    observed = kinematics(move.position, 4000)
    # A Gaussian rounds a corner of the acceleration by jerk·s/sqrt(2 pi), and bends the speed by jerk·s²/2.
    s, jerk = observed.smoothing, 400.0
    assert np.abs(observed.speed - move.speed).max() < 1.02 * jerk * s**2 / 2
    assert np.abs(observed.acceleration - move.acceleration).max() < 1.02 * jerk * s / np.sqrt(2 * np.pi)
    plateau = np.abs(move.acceleration) > 3.999
    plateau &= np.convolve(plateau, np.ones(100), "same") > 99.5
    assert plateau.sum() > 50
    assert np.abs(observed.acceleration - move.acceleration)[plateau].max() < 0.002 * 4.0
    assert observed.cruise == pytest.approx(0.2, rel=1e-3)
    assert 0.5e-3 <= observed.smoothing <= 6e-3


def test_the_smoothing_suits_the_motion():
    """A twentieth of the time that the speed takes to build up, in 0.5 to 6 ms."""
    for hard, expected in ((2.0, 5e-3), (10.0, 1e-3), (40.0, 0.5e-3), (0.5, 6e-3)):
        distance = {40.0: 0.02, 0.5: 0.5}.get(hard, 0.3)
        motion = Motion(0.2, hard, 1000 * hard, 0.2)
        assert kinematics(way([0.0, distance], 10000, motion).position, 10000).smoothing == pytest.approx(
            expected, rel=0.15
        )


@pytest.mark.parametrize("offset", [0.5, -3.0, 100.0])
@pytest.mark.parametrize("rate", [1000.0, 12800.0])
def test_an_offset_of_the_position_is_no_acceleration(offset, rate):
    """A sampled derivative of a Gaussian does not add up to zero: half a metre once became 0.1 m/s²."""
    still = np.full(4000, offset)
    for order in (1, 2):
        assert np.all(differentiate(still, rate, 4e-3, order) == 0)
    move = way([0.0, 0.05], rate).position
    at_zero, away = kinematics(move, rate), kinematics(move + offset, rate)
    # What is left is the rounding of the shifted position, times rate².
    rounding = 4 * np.spacing(abs(offset)) * rate**2
    np.testing.assert_allclose(away.acceleration, at_zero.acceleration, rtol=0, atol=rounding)
    assert away.smoothing == pytest.approx(at_zero.smoothing, rel=1e-3)
    assert away.cruise == pytest.approx(at_zero.cruise, rel=1e-6)


@given(
    slope=st.floats(-1, 1),
    offset=st.floats(-10, 10),
    rate=st.sampled_from([1000.0, 5120.0, 25600.0]),
    smoothing=st.floats(1e-4, 1e-2),
)
@settings(max_examples=60, deadline=None)
def test_a_record_that_moves_from_end_to_end_keeps_its_speed_at_the_ends(slope, offset, rate, smoothing):
    x = offset + slope * np.arange(1500) / rate
    rounding = 64 * np.finfo(float).eps * (abs(offset) + 1) * rate
    np.testing.assert_allclose(differentiate(x, rate, smoothing, 0), x, rtol=0, atol=rounding)
    np.testing.assert_allclose(differentiate(x, rate, smoothing, 1), slope, rtol=0, atol=rounding)
    np.testing.assert_allclose(differentiate(x, rate, smoothing, 2), 0.0, rtol=0, atol=rounding * rate)


def test_a_record_that_starts_in_motion():
    move = way([0.0, 0.3], RATE, Motion(0.2, 2.0, 200.0, 0.3))
    first = int(0.9 * RATE)
    assert move.speed[first] == pytest.approx(0.2)
    whole, cut = kinematics(move.position, RATE), kinematics(move.position[first:], RATE)
    assert cut.smoothing == pytest.approx(whole.smoothing, rel=0.2)
    assert np.abs(cut.speed[:50] - 0.2).max() < 1e-3
    assert np.abs(cut.acceleration[:50]).max() < 0.02


def test_noise_of_an_encoder_stays_below_a_tenth_of_the_motion():
    move = way([0.0, 0.1], 1000, Motion(0.2, 4.0, 400.0, 0.3))
    counted = np.round(move.position / ENCODER) * ENCODER
    clean, observed = kinematics(move.position, 1000), kinematics(counted, 1000)
    assert np.abs(observed.acceleration - clean.acceleration).max() < 0.02 * 4.0
    assert np.abs(observed.speed - clean.speed).max() < 1e-4
    noisy = move.position + 1e-6 * np.random.default_rng(0).standard_normal(len(counted))
    rough = kinematics(noisy, 1000)
    assert rough.cruise == pytest.approx(0.2, rel=0.01)
    assert np.std(rough.acceleration - clean.acceleration) < 0.1 * 4.0


def test_the_smoothed_noise_is_what_theory_says():
    """White noise s through the second derivative of a Gaussian: s·sqrt(3/(8·sqrt(pi)·rate·T⁵))."""
    rate, smoothing, size = 5000.0, 4e-3, 1e-6
    noise = size * np.random.default_rng(1).standard_normal(200_000)
    got = np.std(differentiate(noise, rate, smoothing, 2))
    assert got == pytest.approx(size * np.sqrt(3 / (8 * np.sqrt(np.pi) * rate * smoothing**5)), rel=0.03)


def test_an_axis_that_stands():
    observed = kinematics(np.full(3000, 0.2), RATE)
    assert observed.cruise == 0
    assert not observed.speed.any()
    assert not observed.acceleration.any()


def test_a_record_shorter_than_the_smoothing():
    x = np.linspace(0, 0.001, 16)
    observed = kinematics(x, 25600.0)
    assert observed.speed == pytest.approx(0.001 / 15 * 25600, rel=1e-6)
    assert np.isfinite(observed.acceleration).all()


def test_the_position_is_not_changed():
    move = way([0.0, 0.05], 1000).position
    before = move.copy()
    assert kinematics(move, 1000).position is move
    np.testing.assert_array_equal(move, before)
