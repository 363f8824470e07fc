"""Mode of one input and one output against known modes: value, scatter, coverage, refusals."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import signal

import ballscrew

RATE = 4000.0
FREQUENCY, DAMPING = 120.0, 0.03


def transients(seed=0, count=4, *, noise=0.05, samples=800, frequency=FREQUENCY, kind="force"):
    """Jerk-limited pulses of a force with noise, and the response of a mode that vibrates at the start."""
    random = np.random.default_rng(seed)
    w, fine = 2 * math.pi * frequency, 8
    time = np.arange(samples * fine) / (RATE * fine)
    numerator = {"force": [w**2], "motor": [1, 0.1 * w, (0.4 * w) ** 2]}[kind]
    mode = signal.cont2discrete((numerator, [1, 2 * DAMPING * w, w**2]), 1 / (RATE * fine), "foh")
    low_pass = signal.butter(2, 300, fs=RATE * fine)
    pulse = 500 * (np.clip((time - 0.03) / 0.015, 0, 1) - np.clip((time - 0.12) / 0.015, 0, 1))
    inputs, outputs = [], []
    for _ in range(count):
        u = pulse + 60 * signal.lfilter(*low_pass, random.normal(size=time.size))
        y = signal.lfilter(np.ravel(mode[0]), mode[1], u)
        y += 30 * np.exp(-DAMPING * w * time) * np.cos(w * time + random.uniform(0, 6))
        inputs.append(u[::fine])
        outputs.append(y[::fine] + noise * y.std() * random.normal(size=samples))
    return np.array(inputs), np.array(outputs)


@pytest.mark.parametrize("kind", ["force", "motor"])
def test_a_mode_without_noise_is_found_exactly(kind):
    found = ballscrew.natural_frequency(*transients(noise=0.0, kind=kind), "4 kHz")
    assert found.frequency.value == pytest.approx(FREQUENCY, rel=1e-4)
    assert found.damping.value == pytest.approx(DAMPING, rel=0.01)
    assert found.verdict == "good"
    assert found.unexplained < 1e-3  # the input is no ramp between samples


@pytest.mark.slow
def test_intervals_contain_the_frequency():
    deviations = []
    for seed in range(12):
        f = ballscrew.natural_frequency(*transients(seed, 3, samples=600), RATE).frequency
        deviations.append((f.value - FREQUENCY) / f.standard_uncertainty)
    assert np.mean(np.abs(deviations) < 1.96) >= 0.8  # 10 of 12: fewer in 1 of 50 cases at 95 %
    assert abs(np.mean(deviations)) < 3 / math.sqrt(12)
    assert 0.5 < np.std(deviations) < 1.4


def test_transients_may_have_different_lengths_and_units_of_the_rate():
    inputs, outputs = transients()
    cut = [600, 800, 700, 650]
    found = ballscrew.natural_frequency(
        [u[:n] for u, n in zip(inputs, cut, strict=True)],
        [y[:n] for y, n in zip(outputs, cut, strict=True)],
        "4 kHz",
    )
    assert abs(found.frequency.value - FREQUENCY) < 3 * found.frequency.standard_uncertainty


def test_a_higher_rate_gives_the_same_mode():
    inputs, outputs = (signal.resample_poly(x, 8, 1, axis=1) for x in transients(noise=0.02))
    found = ballscrew.natural_frequency(inputs, outputs, 8 * RATE)
    assert found.frequency.value == pytest.approx(FREQUENCY, rel=2e-3)


def test_one_transient_is_suspect():
    inputs, outputs = transients(count=1)
    found = ballscrew.natural_frequency(inputs[0], outputs[0], RATE)
    assert found.verdict == "suspect"
    assert "1 transient" in found.reasons[0]
    assert abs(found.frequency.value - FREQUENCY) < 4 * found.frequency.standard_uncertainty


def test_a_band_excludes_a_higher_peak():
    inputs, outputs = transients(noise=0.01)
    _, other = transients(noise=0.01, frequency=200.0)
    found = ballscrew.natural_frequency(inputs, outputs + 0.5 * other, RATE, band=("90 Hz", 150.0))
    assert found.frequency.value == pytest.approx(FREQUENCY, rel=0.02)


def test_outputs_of_noise_are_refused():
    inputs, _ = transients()
    noise = np.random.default_rng(1).normal(size=inputs.shape)
    with pytest.raises(ballscrew.MeasurementError, match="no mode"):
        ballscrew.natural_frequency(inputs, noise, RATE)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"output": np.eye(4, 700)}, "same number of samples"),
        ({"output": np.full((4, 800), np.nan)}, "not finite"),
        ({"output": np.full((4, 800), 1e-3)}, "constant"),
        ({"input": np.zeros((4, 800))}, "constant"),
        ({"input": [["a"] * 800] * 4}, "must be numbers"),
        ({"input": np.ones((4, 800), complex)}, "must be numbers"),
        ({"input": np.eye(4, 800) > 0}, "must be numbers"),
        ({"input": np.ma.masked_less(np.eye(4, 800), 0.5)}, "not finite"),
        ({"input": np.zeros((2, 2, 800))}, "shape"),
        ({"sample_rate": "0 Hz"}, "more than 0"),
        ({"sample_rate": "4 kg"}, "kg"),
        ({"band": (150, 90)}, "must rise"),
        ({"band": 100}, "two frequencies"),
        ({"band": (90, 1500)}, "up to 250 Hz"),
    ],
)
def test_wrong_input_is_one_sentence(arguments, message):
    inputs, outputs = transients()
    given = {"input": inputs, "output": outputs, "sample_rate": RATE} | arguments
    with pytest.raises(ballscrew.InputError, match=message):
        ballscrew.natural_frequency(**given)


def test_what_the_mode_leaves_of_the_output_makes_it_suspect():
    inputs, outputs = transients(noise=0.0)
    assert ballscrew.natural_frequency(inputs, outputs, RATE).verdict == "good"
    time = np.arange(outputs.shape[1]) / RATE
    stuck = outputs + 0.3 * outputs.std() * np.sin(2 * np.pi * 1.2 * FREQUENCY * time)
    found = ballscrew.natural_frequency(inputs, stuck, RATE)
    assert found.verdict == "suspect"
    assert any("of the output's power is not explained" in reason for reason in found.reasons)


def test_transients_that_are_too_short_are_refused_with_what_would_do():
    inputs, outputs = transients(samples=100)
    with pytest.raises(ballscrew.InputError, match="ms"):
        ballscrew.natural_frequency(inputs, outputs, RATE, band=(90, 150))


def test_a_band_beside_the_mode_has_none():
    inputs, outputs = transients(noise=0.0)
    text = "no mode was found from 180 to 250 Hz; state the band in which it is expected"
    with pytest.raises(ballscrew.MeasurementError, match=text):
        ballscrew.natural_frequency(inputs, outputs, RATE, band=(180, 250))


@pytest.mark.parametrize(("damping", "uncertain"), [(0.2, False), (0.3, False), (0.8, True)])
def test_a_mode_of_high_damping_is_suspect(damping, uncertain):
    w = 2 * math.pi * FREQUENCY
    mode = signal.cont2discrete(([w**2], [1, 2 * damping * w, w**2]), 1 / RATE, "foh")
    low_pass = signal.butter(2, 300, fs=RATE)
    inputs = signal.lfilter(*low_pass, np.random.default_rng(0).normal(size=(4, 800)))
    outputs = signal.lfilter(np.ravel(mode[0]), mode[1], inputs)
    found = ballscrew.natural_frequency(inputs, outputs, RATE, band=(90, 200))
    assert found.verdict == ("good" if damping < 0.25 else "suspect")
    words = f"the damping ratio is {found.damping.value:.2f}: too high for a resonance; are input and output"
    assert any(words in reason for reason in found.reasons) == (damping > 0.25)
    assert ("the standard uncertainty is above 3 %" in found.reasons) == uncertain
    if not uncertain:
        assert found.frequency.value == pytest.approx(FREQUENCY, rel=1e-3)
