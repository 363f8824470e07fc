from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import butter, freqs, iirnotch, lfilter

from ballscrew.recording.filters import Filter, undo_and_apply

RATE = 4000.0
TIME = np.arange(8000) / RATE
# A record at rest, a burst that rings, and rest.
SIGNAL = 1.0 + np.exp(-(((TIME - 1.0) / 0.05) ** 2)) * np.sin(2 * np.pi * 120.0 * TIME)


@pytest.mark.parametrize("kind", ["low pass", "high pass"])
@pytest.mark.parametrize("order", [1, 2, 3, 8])
def test_passes_are_those_of_butterworth(kind, order):
    frequency = np.array([3.0, 50.0, 100.0, 700.0])
    b, a = butter(order, 2 * np.pi * 100.0, kind.removesuffix(" pass"), analog=True)
    expected = freqs(b, a, 2 * np.pi * frequency)[1]
    np.testing.assert_allclose(Filter(kind, 100.0, order).response(frequency), expected, rtol=1e-9)


def test_a_notch_has_its_width_and_its_depth():
    notch = Filter("notch", 300.0, bandwidth=60.0)
    edges = 300.0 * (np.sqrt(1 + 0.1**2) + np.array([-0.1, 0.1]))
    np.testing.assert_allclose(np.abs(notch.response(edges)), np.sqrt(0.5), rtol=1e-12)
    assert np.diff(edges) == pytest.approx(60.0)
    assert abs(notch.response(np.array([300.0]))[0]) < 1e-12
    shallow = Filter("notch", 300.0, bandwidth=60.0, depth=0.2)
    np.testing.assert_allclose(shallow.response(np.array([0.0, 300.0])), [1.0, 0.2], rtol=1e-12)


def test_a_mean_is_half_its_time_late():
    gain = Filter("moving average", time=0.004).response(np.array([10.0, 250.0]))
    assert np.angle(gain[0]) == pytest.approx(-2 * np.pi * 10.0 * 0.002)
    assert abs(gain[1]) < 1e-12


def test_filters_of_a_drive_are_applied_as_it_does():
    b, a = iirnotch(200.0, 200.0 / 50.0, RATE)
    got = undo_and_apply(SIGNAL, RATE, [], [Filter("notch", 200.0, bandwidth=50.0)])
    np.testing.assert_allclose(got, 1.0 + lfilter(b, a, SIGNAL - 1.0), rtol=0, atol=4e-3)


@pytest.mark.parametrize(
    "each",
    [
        Filter("low pass", 300.0, 2),
        Filter("high pass", 20.0),
        Filter("notch", 300.0, bandwidth=100.0, depth=0.15),
        Filter("delay", time=0.003),
        Filter("moving average", time=0.002),
    ],
    ids=lambda each: each.type,
)
def test_what_a_filter_did_is_undone(each):
    recorded = undo_and_apply(SIGNAL, RATE, [], [each])
    assert np.ptp(recorded - SIGNAL) > 0.05
    got = undo_and_apply(recorded, RATE, [each], [])
    np.testing.assert_allclose(got - got.mean(), SIGNAL - SIGNAL.mean(), rtol=0, atol=2e-3)


def test_the_inverse_amplifies_ten_times_at_most():
    noise = np.random.default_rng(0).standard_normal(4000)
    got = undo_and_apply(noise, RATE, [Filter("notch", 300.0, bandwidth=60.0)], [])
    assert np.abs(got).max() < 10 * np.abs(noise).max()


def test_samples_that_are_no_numbers_are_no_error():
    broken = SIGNAL.copy()
    broken[100] = np.inf
    assert not np.isfinite(undo_and_apply(broken, RATE, [Filter("low pass", 300.0)], [])).any()


def test_without_a_filter_nothing_changes():
    assert undo_and_apply(SIGNAL, RATE, [], []) is SIGNAL
