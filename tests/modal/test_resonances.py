"""Resonance and antiresonance against a closed loop with known ones: value, coverage, refusals."""

from __future__ import annotations

import math

import numpy as np
import pytest
from benchmarks.drive_excitation import RATE, ROTOR_FREE, ROTOR_HELD, simulate
from scipy import signal

import ballscrew
from ballscrew.modal.joint.settings import JointSettings
from ballscrew.modal.rational_fit import FourierLines, RationalFit
from ballscrew.modal.reason import Reason
from ballscrew.modal.resonance_verdicts import ModeOfAxis, _with_verdict, axial_mode, mode_doubts


def deviation(mode, true):
    return (mode.frequency.value - true) / mode.frequency.standard_uncertainty


@pytest.mark.parametrize("kind", ["noise", "chirp", "steps"])
def test_frequencies_of_every_excitation_are_those_of_the_two_masses(kind):
    force, speed, _ = simulate(3, kind, noise=1e-5)
    found = ballscrew.resonances(force, speed, "8 kHz")
    assert found.resonance.frequency.value == pytest.approx(ROTOR_FREE, rel=2e-3)
    assert found.antiresonance.frequency.value == pytest.approx(ROTOR_HELD, rel=3e-3)
    assert (found.resonance.verdict, found.antiresonance.verdict) == ("good", "good")
    assert found.coherence > 0.9


def test_without_noise_only_the_hold_between_samples_shifts_the_antiresonance():
    force, speed, _ = simulate(noise=0.0)
    found = ballscrew.resonances(force, speed, RATE)
    assert found.resonance.frequency.value == pytest.approx(ROTOR_FREE, rel=2e-5)
    assert found.resonance.damping == pytest.approx(0.015 * ROTOR_FREE / ROTOR_HELD, rel=0.01)
    assert abs(deviation(found.antiresonance, ROTOR_HELD)) < 2


def test_intervals_contain_the_frequencies_of_one_period_of_binary_noise():
    deviations = []
    for seed in range(5):
        force, speed, _ = simulate(seed, "binary", seconds=2047 / RATE)
        found = ballscrew.resonances(force, speed, RATE)
        deviations += [
            deviation(found.resonance, ROTOR_FREE),
            deviation(found.antiresonance, ROTOR_HELD),
        ]
    assert np.mean(np.abs(deviations) < 1.96) >= 0.7  # 7 of 10: fewer in 1 of 1000 cases at 95 %
    assert abs(np.mean(deviations)) < 3 / math.sqrt(10)


def test_the_reference_removes_the_bias_of_the_controller():
    """Here the noise of the motion has a third of the power that the excitation has."""
    plain, referred = [], []
    for seed in range(2):
        force, speed, added = simulate(seed, noise=2.5e-4)
        without = ballscrew.resonances(force, speed, RATE, band=(80, 350))
        found = ballscrew.resonances(force, speed, RATE, reference=added, band=(80, 350))
        assert without.antiresonance.verdict == "refused"
        assert "reference" in without.antiresonance.reasons[-1].text
        plain.append(deviation(without.resonance, ROTOR_FREE))
        referred.append(deviation(found.resonance, ROTOR_FREE))
    assert np.abs([plain, referred]).max() < 3


def test_a_loop_that_only_amplifies_noise_has_no_antiresonance():
    force, speed, _ = simulate(noise=1e-3, excitation=0.1)
    found = ballscrew.resonances(force, speed, RATE, band=(80, 350))
    assert found.antiresonance.verdict == "refused"


def test_independent_signals_are_refused():
    random = np.random.default_rng(1)
    found = ballscrew.resonances(*random.normal(size=(2, 8000)), RATE, band=(80, 350))
    assert found.resonance.verdict == "refused"
    assert found.resonance.frequency is None


def test_a_mode_narrower_than_the_lines_is_a_tone():
    force, speed, _ = simulate(seconds=0.25)
    lines = FourierLines.of([(force, speed)], RATE, (80, 350), 1)
    modes = np.log([[170 / lines.scale], [1e-4]])
    fit = RationalFit(lines, modes, np.ones(len(lines.frequency)), np.empty(0)).solved()
    assert axial_mode(fit, 80, 350, duration=0.25).kind == "tone"
    assert axial_mode(fit, 80, 350, duration=100.0) == 0
    assert axial_mode(fit, 200, 350, duration=100.0).kind == "no-mode"


def test_two_modes_close_to_each_other_are_suspect():
    force, speed, _ = simulate(noise=1e-6)
    w = 2 * math.pi * 200
    beside = signal.cont2discrete(([0.0015, 0], [1, 0.03 * w, w**2]), 1 / RATE, "foh")
    speed = speed + signal.lfilter(np.ravel(beside[0]), beside[1], force)
    found = ballscrew.resonances(force, speed, RATE)
    assert found.resonance.verdict == "suspect"
    assert "frame" in [reason.kind for reason in found.resonance.reasons]


def test_a_set_point_shows_the_antiresonance_only():
    _, speed, added = simulate(noise=1e-6)
    found = ballscrew.resonances(
        np.cumsum(added) / RATE, speed, RATE, quantities=("speed", "speed"), band=(80, 350)
    )
    assert found.closed_loop
    assert found.resonance.verdict != "good"
    assert found.antiresonance.frequency.value == pytest.approx(ROTOR_HELD, rel=5e-3)


def test_an_acceleration_shows_the_resonance_only():
    force, speed, _ = simulate(noise=1e-6)
    found = ballscrew.resonances(
        force, np.gradient(speed, 1 / RATE), RATE, quantities=("torque", "acceleration")
    )
    assert found.resonance.frequency.value == pytest.approx(ROTOR_FREE, rel=2e-3)
    assert found.antiresonance.verdict == "refused"


def test_several_records_of_different_length_are_fitted_together():
    records = [simulate(seed, seconds=seconds)[:2] for seed, seconds in ((1, 0.4), (2, 0.6))]
    found = ballscrew.resonances(*zip(*records, strict=True), RATE)
    alone = ballscrew.resonances(*records[0], RATE)
    assert abs(deviation(found.resonance, ROTOR_FREE)) < 3
    assert found.resonance.frequency.standard_uncertainty < alone.resonance.frequency.standard_uncertainty
    assert len(found.halves) == 2
    assert found.to_dataframe().shape[0] == 2
    assert "resonance" in repr(found)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"quantities": ("torque", "force")}, "the output is a force"),
        ({"quantities": ("torque", "voltage")}, "'voltage' is not one of"),
        ({"band": (200, 100)}, "must rise"),
        ({"band": (100, 1000)}, "up to 800 Hz"),
        ({"reference": np.ones(4)}, "number of samples|shape"),
        ({"output": np.full(2000, np.nan)}, "not finite"),
        ({"sample_rate": 300.0}, "too slow"),
    ],
)
def test_wrong_input_is_one_sentence(arguments, message):
    force, speed, _ = simulate(seconds=0.25)
    given = {"input": force, "output": speed, "sample_rate": RATE} | arguments
    with pytest.raises(ballscrew.InputError, match=message):
        ballscrew.resonances(**given)


def test_a_short_record_is_refused_with_what_would_do():
    force, speed, _ = simulate(seconds=0.05)
    found = ballscrew.resonances(force, speed, RATE, band=(80, 350))
    assert found.resonance.verdict == "refused"
    assert "40 are needed" in found.resonance.reasons[0].text


@pytest.mark.parametrize(("rate", "frequency", "count"), [(500.0, 175.9, 8000), (500.0, 107.5, 4000)])
def test_a_clean_step_in_place_of_the_motion_is_not_good(rate, frequency, count):
    """Input and output are exchanged. Some columns of the fit are zeros, which makes no warning."""
    w = 2 * math.pi * frequency
    b, a, _ = signal.cont2discrete(([0.04 * w, w**2], [1.0, 0.04 * w, w**2]), 1 / rate)
    step = (np.arange(count) > count / 2) * 1.0
    found = ballscrew.resonances(signal.lfilter(b.ravel(), a, step), step, rate)
    assert "good" not in (found.resonance.verdict, found.antiresonance.verdict)


def test_a_band_without_a_mode_is_refused_with_the_fitted_model():
    force, speed, _ = simulate(noise=1e-6)
    found = ballscrew.resonances(force, speed, RATE, band=(250, 400))
    for mode in (found.resonance, found.antiresonance):
        assert (mode.verdict, mode.frequency) == ("refused", None)
        assert [reason.kind for reason in mode.reasons] == ["no-mode"]
    assert found.coherence is None
    assert found.model is not None
    assert np.isfinite(found.model.frf).all()


def test_a_mode_that_the_input_hardly_excites_is_doubted():
    force, speed, _ = simulate(seconds=0.25)
    lines = FourierLines.of([(force, speed)], RATE, (80, 350), 1)
    modes = np.log([[170 / lines.scale], [0.02]])
    fit = RationalFit(lines, modes, np.ones(len(lines.frequency)), np.empty(0)).solved()
    assert mode_doubts(fit, 0, 0.99, excited=True) == ()
    (doubt,) = mode_doubts(fit, 0, 0.99, excited=False)
    assert doubt == Reason("unexcited", "the input hardly excites the mode at 170.0 Hz")


def test_a_band_that_begins_above_the_antiresonance_shows_none():
    force, speed, _ = simulate(noise=1e-6)
    between = (ROTOR_HELD + ROTOR_FREE) / 2
    found = ballscrew.resonances(force, speed, RATE, band=(between, 350))
    assert found.resonance.frequency.value == pytest.approx(ROTOR_FREE, rel=5e-3)
    assert found.antiresonance.frequency is None
    assert "no antiresonance shows from" in found.antiresonance.reasons[-1].text


def test_a_frequency_of_large_uncertainty_is_refused():
    force, speed, _ = simulate(seconds=0.25)
    lines = FourierLines.of([(force, speed)], RATE, (80, 350), 1)
    modes = np.log([[170 / lines.scale], [0.02]])
    fit = RationalFit(lines, modes, np.ones(len(lines.frequency)), np.empty(0)).solved()
    doubts = (Reason("unexcited", "why"),)
    mode = ModeOfAxis(fit, 0, RATE, driven=True, collocated=True, explained=0.9, doubts=doubts)
    most = JointSettings().most_uncertainty
    for part, verdict in ((0.1, "suspect"), (0.99, "suspect"), (1.01, "refused"), (math.nan, "refused")):
        estimated = _with_verdict(mode, 200.0, 0.02, {"noise": part * most * 200.0}, doubts)
        assert estimated.verdict == verdict
        assert estimated.reasons[0] == doubts[0]
        assert (estimated.frequency is None) == (verdict == "refused")
    assert estimated.reasons[-1].kind == "uncertain"
