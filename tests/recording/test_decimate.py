from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ballscrew.base.errors import InputError
from ballscrew.recording.decimate import _filter, decimator

RATE, TOP = 12800.0, 600.0


def test_wanted_frequencies_pass_and_their_images_do_not():
    thin = decimator(RATE, TOP)
    lines = np.fft.rfftfreq(1 << 16, 1 / RATE)
    gain = np.abs(np.fft.rfft(thin.taps, 1 << 16))
    assert np.abs(gain[lines <= TOP] - 1).max() < 2e-5
    images = np.zeros_like(lines, dtype=bool)
    for k in range(1, thin.step // 2 + 1):
        images |= np.abs(lines - k * RATE / thin.step) <= TOP
    assert gain[images].max() < 2e-5


def test_a_sample_is_that_of_the_signal():
    thin = decimator(RATE, TOP)
    time = np.arange(20000) / RATE
    x = 0.5 + np.cos(2 * np.pi * 150 * time) + 0.1 * np.sin(2 * np.pi * 590 * time)
    (stored,) = thin([x], 5003, 9001)
    assert len(stored) == -(-(9001 - 5003) // thin.step)
    np.testing.assert_allclose(stored, x[5003 : 9001 : thin.step], atol=3e-5)


def test_each_signal_by_itself_and_as_a_convolution_has_it():
    thin = decimator(RATE, TOP)
    x = np.random.default_rng(0).normal(size=(3, 4000))
    stored = thin(x, 500, 3503)
    for row, mine in zip(x, stored, strict=True):
        np.testing.assert_array_equal(mine, thin([row], 500, 3503)[0])
        want = np.convolve(row, thin.taps, mode="same")[500 : 3503 : thin.step]
        np.testing.assert_allclose(mine, want, rtol=0, atol=1e-13)


def test_beyond_its_ends_a_signal_stays():
    thin = decimator(RATE, TOP)
    x = np.random.default_rng(1).normal(size=900)
    half = len(thin.taps) // 2
    want = np.convolve(np.pad(x, half, mode="edge"), thin.taps, mode="valid")[:: thin.step]
    np.testing.assert_allclose(thin([x], 0, 900)[0], want, rtol=0, atol=1e-13)


@given(
    size=st.integers(1, 700),
    span=st.tuples(st.integers(0, 699), st.integers(1, 700)),
    rate=st.sampled_from([9600.0, 12800.0, 20000.0]),
)
def test_a_constant_stays_whatever_the_span_also_at_the_ends(size, span, rate):
    first = min(span[0], size - 1)
    last = min(max(span[1], first + 1), size)
    thin = decimator(rate, TOP)
    (stored,) = thin([np.full(size, 0.45)], first, last)
    assert len(stored) == -(-(last - first) // thin.step)
    np.testing.assert_array_equal(stored, 0.45)


def test_a_whole_rate_stays_whole():
    """So that the lines of the spectra stay where they are."""
    assert decimator(12800.0, 600.0).step == 5
    assert decimator(20000.0, 600.0).step == 10
    assert decimator(12801.0, 600.0).step == 6  # its divisors are too small
    assert decimator(12799.9, 600.0).step == 6


@pytest.mark.parametrize(("rate", "top"), [(1000.0, 600.0), (3000.0, 600.0), (12800.0, None)])
def test_a_low_rate_is_unchanged(rate, top):
    thin = decimator(rate, top)
    x = np.random.default_rng(0).normal(size=(2, 50))
    stored = thin(x, 3, 40)
    np.testing.assert_array_equal(stored, x[:, 3:40])
    assert not np.shares_memory(stored, x)


@pytest.mark.parametrize("top", [0.0, -1.0, float("nan"), float("inf")])
def test_no_such_frequency(top):
    with pytest.raises(InputError, match="highest frequency"):
        decimator(RATE, top)


@pytest.mark.parametrize(
    ("first", "last"), [(-1, 20), (4005, 4020), (10**7, 10**7 + 20), (3990, 4001), (5, 5)]
)
@pytest.mark.parametrize("top", [TOP, None])
def test_a_span_outside_is_an_error(first, last, top):
    with pytest.raises(IndexError, match="samples"):
        decimator(RATE, top)([np.zeros(4000)], first, last)


def test_single_precision_and_every_other_sample():
    thin = decimator(RATE, TOP)
    x = np.random.default_rng(0).normal(size=8000)
    np.testing.assert_array_equal(thin([x[::2]], 5, 3000), thin([x[::2].copy()], 5, 3000))
    np.testing.assert_allclose(thin([x.astype(np.float32)], 5, 3000), thin([x], 5, 3000), atol=1e-6)


@pytest.mark.parametrize("first", [0, 100, 880])
def test_the_loop_that_is_compiled_is_a_convolution_of_the_signal_continued_by_its_ends(first):
    taps = np.array([1.0, 2.0, 3.0, 2.0, 1.0]) / 9
    line = 0.5 + 1e-6 * np.random.default_rng(2).normal(size=900)
    out = np.empty(5)
    _filter(line, first, taps, 4, out)
    want = np.convolve(np.pad(line, 2, mode="edge"), taps, mode="valid")[first:900:4][:5]
    np.testing.assert_allclose(out, want, rtol=0, atol=1e-15)
