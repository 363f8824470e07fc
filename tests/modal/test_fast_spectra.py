from __future__ import annotations

import numpy as np
import pytest

from ballscrew.modal.fast_spectra import averaged_fast, decimation
from ballscrew.modal.spectra import averaged, coherence, frf

RATE, BAND, STEP = 12800.0, (10.0, 600.0), 0.5


def records(samples=4096, repetitions=4, responses=2, seed=0):
    """A pulse into a mode at 150 Hz, 1 % of noise, with an offset and with much above the band."""
    rng = np.random.default_rng(seed)
    t = np.arange(samples) / RATE
    pulse = np.clip(np.minimum((t - 0.05) / 0.002, (0.11 - t) / 0.002), 0, 1)
    r = np.fft.rfftfreq(2 * samples, 1 / RATE) / 150.0
    rung = np.fft.irfft(np.fft.rfft(pulse, 2 * samples) / (1 - r**2 + 0.06j * r))[:samples]
    hum = np.sin(2 * np.pi * 1003.0 * t) + np.sin(2 * np.pi * 4100.0 * t)
    force = 5 + pulse + 0.01 * rng.standard_normal((repetitions, samples)) + 0.02 * hum
    response = rung + 0.02 * rng.standard_normal((responses, repetitions, samples)) + 0.02 * hum
    return force.astype(np.float32), response.astype(np.float32)


@pytest.mark.parametrize("compiled", [True, False])
@pytest.mark.parametrize(
    ("rate", "samples"), [(12800.0, 4096), (12800.0, 4001), (10000.0, 3000), (25600.0, 9000)]
)
def test_it_says_what_the_exact_average_says(compiled, rate, samples):
    force, response = records(samples)
    window = np.hanning(samples)
    u, y = ((x - x.mean(axis=-1, keepdims=True, dtype=np.float64)) * window for x in (force, response))
    exact = averaged(u, y, rate, BAND, STEP)
    got = averaged_fast(force, response, rate, BAND, STEP, window=window, compiled=compiled)
    assert decimation(rate, BAND[1]).factor > 1
    np.testing.assert_allclose(got.frequency, exact.frequency, rtol=1e-12)
    np.testing.assert_allclose(got.uu, exact.uu, rtol=1e-3, atol=1e-6 * exact.uu.max())
    np.testing.assert_allclose(got.yy, exact.yy, rtol=1e-3, atol=1e-6 * exact.yy.max())
    strong = coherence(exact) > 0.5
    difference = np.abs(frf(got) - frf(exact)) / np.abs(frf(exact))
    assert difference[strong].max() < 1e-4
    assert np.abs(coherence(got) - coherence(exact)).max() < 1e-3
    assert got.count == exact.count


@pytest.mark.parametrize("compiled", [True, False])
def test_records_windowed_beforehand_give_the_same(compiled):
    force, response = records()
    window = np.hanning(force.shape[-1])
    u, y = ((x - x.mean(axis=-1, keepdims=True, dtype=np.float64)) * window for x in (force, response))
    one = averaged_fast(u, y, RATE, BAND, STEP, compiled=compiled)
    other = averaged_fast(force, response, RATE, BAND, STEP, window=window, compiled=compiled)
    np.testing.assert_allclose(one.uu, other.uu, rtol=1e-3)


def test_both_ways_agree():
    force, response = records()
    window = np.hanning(force.shape[-1])
    one, other = (
        averaged_fast(force, response, RATE, BAND, STEP, window=window, compiled=c) for c in (True, False)
    )
    np.testing.assert_allclose(one.uy, other.uy, atol=1e-5 * np.abs(one.uy).max())


@pytest.mark.parametrize(
    ("rate", "band"), [(1300.0, (10.0, 600.0)), (12800.0, (0.0, 600.0)), (12800.0, (1.0, 6000.0))]
)
def test_where_nothing_can_be_gained_it_is_the_exact_one(rate, band):
    force, response = records(1000)
    window = np.hanning(1000)
    u, y = ((x - x.mean(axis=-1, keepdims=True, dtype=np.float64)) * window for x in (force, response))
    exact = averaged(u, y, rate, band, STEP)
    got = averaged_fast(force, response, rate, band, STEP, window=window)
    np.testing.assert_allclose(got.uy, exact.uy, rtol=1e-4, atol=1e-9 * np.abs(exact.uy).max())


@pytest.mark.parametrize(
    ("rate", "top"), [(12800.0, 600.0), (12800.0, 200.0), (51200.0, 1000.0), (3200.0, 600.0)]
)
def test_no_alias_reaches_the_band(rate, top):
    """The gain of every frequency that folds into the band, by the filter's own taps."""
    filtered = decimation(rate, top)
    lowest = filtered.gain(np.linspace(0.02 * top, top, 200), rate)[-1]
    out = np.linspace(rate / filtered.factor - top, rate / 2, 2000)
    folded = np.abs(np.exp(-2j * np.pi / rate * np.outer(out, np.arange(64))) @ filtered.taps) ** 2 * 16
    assert filtered.factor >= 2
    assert 10 * np.log10(folded.max() / lowest) < -95
    assert rate / filtered.factor > 2 * top


def test_silence_is_nan_and_warns_of_nothing():
    zero = np.zeros((3, 4096), np.float32)
    got = averaged_fast(zero, zero[None], RATE, BAND, STEP, window=np.hanning(4096))
    assert np.isnan(frf(got)).all()
