from __future__ import annotations

import numpy as np
import pytest

from ballscrew.base.errors import InputError
from ballscrew.modal.output_error import cell_bound, identify_cell
from ballscrew.modal.output_error.plant import ModalPlant

BAND, MODELLED = (100.0, 300.0), (40.0, 420.0)


@pytest.mark.parametrize("level", [30.0, 10.0, -5.0])
def test_the_error_is_the_cramer_rao_bounds_and_the_interval_holds_the_truth(ring, plant, rate, level):
    """16 cells: a root mean square over its expectation stays from 0.55 to 1.5 in 99 % of such trials."""
    errors, bounds, deviations, dampings = [], [], [], []
    for seed in range(16):
        force, response, noise, initial, _ = ring(seed=round(100 * level) % 1000 + seed, level=level)
        found = identify_cell(force, response, rate, BAND)
        assert found.order == 2 or level < 0
        errors.append(found.frequency - plant.frequency[0])
        deviations.append(found.uncertainty)
        dampings.append(found.damping - plant.damping[0])
        if seed < 4:
            bounds.append(cell_bound(plant, force, rate, noise, initial=initial, band=MODELLED).frequency[0])
    errors, deviations = np.array(errors), np.array(deviations)
    rms = np.sqrt(np.mean(errors**2))
    bound = np.sqrt(np.mean(np.square(bounds)))
    assert 0.55 * bound < rms < 1.5 * bound
    assert abs(errors.mean()) < 3 * rms / np.sqrt(len(errors))
    assert np.median(deviations) == pytest.approx(bound, rel=0.35)
    assert (np.abs(errors) < 1.96 * deviations).mean() >= 0.8
    assert np.sqrt(np.mean(np.square(dampings))) < 0.1 * plant.damping[0]


def test_a_mode_too_few_is_told(ring, rate):
    force, response, *_ = ring(level=20)
    found = identify_cell(force, response, rate, BAND, order=1)
    assert found.order == 1
    assert found.verdict != "good"
    assert "2 modes in place of 1 fit better" in found.reasons


def test_a_mode_too_many_is_told(ring, rate, plant):
    for seed in range(4):
        force, response, *_ = ring(level=20, seed=seed)
        found = identify_cell(force, response, rate, BAND, order=3)
        assert found.verdict != "good"
        assert found.reasons
        if found.frequency is not None:
            assert abs(found.frequency - plant.frequency[0]) < 4 * found.uncertainty


def test_one_mode_and_three_are_counted(ring, rate):
    one = ModalPlant((170.0,), (0.02,), (1.0,), 0.5)
    three = ModalPlant((130.0, 190.0, 270.0), (0.03, 0.02, 0.02), (1.0, 0.6, -0.5), 0.5)
    for truth in (one, three):
        force, response, *_ = ring(truth, level=25, repetitions=15)
        found = identify_cell(force, response, rate, BAND, expected=truth.frequency[0])
        assert found.order == len(truth.frequency)
        assert found.frequency == pytest.approx(truth.frequency[0], abs=0.2)


def test_a_residue_of_any_phase_is_no_bias(ring, rate):
    """A response mixed with its own derivative has a residue that no delay makes: the general structure."""
    truth = ModalPlant((150.0,), (0.03,), (1.0,), 0.0, 0.0)
    force, response, *_ = ring(truth, level=30)
    turned = response + 0.5 * np.gradient(response, axis=1) * rate / (2 * np.pi * 150.0)
    found = identify_cell(force, turned, rate, BAND)
    assert found.frequency == pytest.approx(150.0, abs=4 * found.uncertainty + 0.02)


def test_two_responses_share_their_poles_and_know_more(ring, rate, plant):
    force, response, *_ = ring(level=5)
    clean = ring(level=300)[1]
    other = clean + np.random.default_rng(9).standard_normal(response.shape) * (response - clean).std()
    one = identify_cell(force, response, rate, BAND)
    both = identify_cell(force, np.stack([response, -3 * other]), rate, BAND)
    assert both.uncertainty < one.uncertainty
    assert both.frequency == pytest.approx(plant.frequency[0], abs=4 * one.uncertainty)


def test_noise_on_the_force_is_seen(ring, rate, plant):
    force, response, *_ = ring(level=30, force_noise=1.0, repetitions=20)
    found = identify_cell(force, response, rate, BAND)
    assert found.input_noise == pytest.approx(1.0, rel=0.3)
    assert found.frequency == pytest.approx(plant.frequency[0], abs=4 * found.uncertainty)
    clean = identify_cell(*ring(level=30, repetitions=20)[:2], rate, BAND)
    assert clean.input_noise == 0.0
    assert clean.uncertainty < 0.5 * found.uncertainty


def test_coloured_noise_keeps_the_interval_true(ring, rate, plant):
    held = []
    for seed in range(16):
        force, response, *_ = ring(level=10, seed=seed, tilt=True)
        found = identify_cell(force, response, rate, BAND)
        held.append(abs(found.frequency - plant.frequency[0]) < 1.96 * found.uncertainty)
    assert np.mean(held) >= 0.75


def test_a_repetition_that_does_not_belong_is_dropped_and_told(ring, rate, plant):
    force, response, *_ = ring(level=20)
    response[3] += 5 * response.std() * np.random.default_rng(2).standard_normal(response.shape[1])
    found = identify_cell(force, response, rate, BAND)
    assert found.dropped == (3,)
    assert found.repetitions == 9
    assert any("belong" in reason for reason in found.reasons)
    assert found.frequency == pytest.approx(plant.frequency[0], abs=4 * found.uncertainty)


def test_a_known_delay_makes_it_surer(ring, rate, plant):
    force, response, *_ = ring(level=5)
    guessed, known = (identify_cell(force, response, rate, BAND, delay=d) for d in (None, plant.delay))
    assert known.uncertainty < 0.95 * guessed.uncertainty


def test_scale_and_sign_do_not_matter(ring, rate):
    force, response, *_ = ring()
    one, other = (identify_cell(a * force, b * response, rate, BAND) for a, b in ((1, 1), (1e-6, -1e4)))
    assert other.frequency == pytest.approx(one.frequency, rel=1e-6)
    assert other.uncertainty == pytest.approx(one.uncertainty, rel=1e-3)


def test_noise_alone_is_refused_or_very_unsure(rate):
    rng = np.random.default_rng(4)
    force, response = rng.standard_normal((2, 8, 1280))
    found = identify_cell(force, response, rate, BAND)
    assert found.verdict == "refused"
    assert found.frequency is None
    assert found.reasons
    assert np.isnan(found.interval()).all()


@pytest.mark.parametrize("dead", ["force", "response", "both"])
def test_a_dead_channel_is_refused(ring, rate, dead):
    force, response, *_ = ring()
    found = identify_cell(force * (dead == "response"), response * (dead == "force"), rate, BAND)
    assert found.verdict == "refused"
    assert "zero" in found.reasons[0]


def test_a_single_repetition_is_refused_and_two_are_not(ring, rate, plant):
    force, response, *_ = ring(level=30)
    assert identify_cell(force[:1], response[:1], rate, BAND).verdict == "refused"
    found = identify_cell(force[:2], response[:2], rate, BAND)
    assert found.frequency == pytest.approx(plant.frequency[0], abs=1.0)


def test_what_cannot_be_is_said(ring, rate):
    force, response, *_ = ring()
    with pytest.raises(InputError, match="one of 1, 2, 3"):
        identify_cell(force, response, rate, BAND, order=4)
    short = identify_cell(force[:, :150], response[:, :150], rate, (100.0, 300.0))
    assert short.verdict == "refused"
    with pytest.raises(InputError, match="at least 8"):
        identify_cell(force[:, :80], response[:, :80], rate, BAND)
