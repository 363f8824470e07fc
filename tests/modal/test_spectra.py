from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import signal

from ballscrew.modal.paper.judge import least_coherence
from ballscrew.modal.paper.lines import Lines, magnitude
from ballscrew.modal.paper.settings import PaperSettings
from ballscrew.modal.spectra import Spectra, averaged, coherence, frf

RATE = 1000.0


def records(repetitions=3, samples=130, responses=2, seed=0):
    rng = np.random.default_rng(seed)
    hann = signal.windows.hann(samples, sym=False)
    force = rng.standard_normal((repetitions, samples))
    response = rng.standard_normal((responses, repetitions, samples)) + np.roll(force, 3, axis=-1)
    return force * hann, response * hann


def plain(force, response, frequency):
    """A discrete Fourier transform of each record on any lines, then averages: the definition."""
    kernel = np.exp(-2j * np.pi * np.outer(np.arange(force.shape[-1]), frequency) / RATE) / RATE
    u, y = force @ kernel, response @ kernel
    return (np.abs(u) ** 2).mean(0), (np.abs(y) ** 2).mean(1), (u.conj() * y).mean(1)


@pytest.mark.parametrize("samples", [64, 129, 130, 800])
@pytest.mark.parametrize("step", [0.2, 3.0, 50.0])
def test_the_refined_average_is_the_average_of_zero_padded_records(samples, step):
    force, response = records(samples=samples)
    got = averaged(force, response, RATE, (5.0, 400.0), step)
    uu, yy, uy = plain(force, response, got.frequency)
    np.testing.assert_allclose(got.uu, uu, rtol=0, atol=1e-9 * uu.max())
    np.testing.assert_allclose(got.yy, yy, rtol=0, atol=1e-9 * yy.max())
    np.testing.assert_allclose(got.uy, uy, rtol=0, atol=1e-9 * np.abs(uy).max())
    assert got.count == 3
    assert got.frequency[0] >= 5.0
    assert got.frequency[-1] <= 400.0
    spacing = np.diff(got.frequency)
    assert spacing.max() <= step + 1e-9
    np.testing.assert_allclose(spacing, spacing[0], rtol=1e-6)


def test_numpys_own_fft_says_the_same():
    force, response = records()
    got = averaged(force, response, RATE, (0.0, 500.0), 1.0)
    padded = round(RATE / (got.frequency[1] - got.frequency[0]))
    u = np.fft.rfft(force, padded) / RATE
    y = np.fft.rfft(response, padded) / RATE
    np.testing.assert_allclose(got.uu, (np.abs(u) ** 2).mean(0), atol=1e-15)
    np.testing.assert_allclose(got.uy, (u.conj() * y).mean(1), atol=1e-15)


def test_scipys_csd_says_the_same():
    """One segment a record, no detrending, up to the scale of a density."""
    hann = signal.windows.hann(256, sym=False)
    raw = np.random.default_rng(3).standard_normal((4, 256))
    u, y = raw * hann, np.roll(raw, 2, axis=-1) * hann
    got = averaged(u, y[None], RATE, (0.0, 500.0), RATE / 1024)
    frequency, density = signal.csd(
        raw.ravel(), np.roll(raw, 2, axis=-1).ravel(), RATE, window=hann, nperseg=256, noverlap=0,
        nfft=1024, detrend=False, return_onesided=False,
    )  # fmt: skip
    scale = RATE * (hann**2).sum() / RATE**2
    for line in (10, 57, 200):
        at = np.argmin(np.abs(got.frequency - frequency[line]))
        assert got.frequency[at] == pytest.approx(frequency[line])
        assert got.uy[0, at] == pytest.approx(density[line] * scale, rel=1e-9)


def test_estimators_by_their_definitions():
    force, response = records()
    s = averaged(force, response, RATE, (5.0, 400.0), 1.0)
    h1, h2, hv = (frf(s, name) for name in ("H1", "H2", "Hv"))
    np.testing.assert_allclose(h1, s.uy / s.uu)
    np.testing.assert_allclose(h2, s.yy / s.uy.conj())
    np.testing.assert_allclose(np.abs(hv) ** 2, np.abs(h1) * np.abs(h2))
    np.testing.assert_allclose(np.angle(hv), np.angle(h1))
    np.testing.assert_allclose(coherence(s), (h1 / h2).real, rtol=1e-9)
    assert (np.abs(h1) <= np.abs(hv) * (1 + 1e-12)).all()
    assert (np.abs(hv) <= np.abs(h2) * (1 + 1e-12)).all()


@given(seed=st.integers(0, 1000), count=st.integers(1, 6))
@settings(max_examples=30, deadline=None)
def test_coherence_lies_between_nought_and_one(seed, count):
    s = averaged(*records(repetitions=count, seed=seed), RATE, (5.0, 450.0), 2.0)
    curve = coherence(s)
    assert curve.min() >= 0
    assert curve.max() <= 1 + 1e-9
    if count == 1:
        np.testing.assert_allclose(curve, 1.0, rtol=1e-6)


def test_a_single_record_has_coherence_one_and_equal_estimators():
    s = averaged(*records(repetitions=1), RATE, (5.0, 450.0), 1.0)
    np.testing.assert_allclose(coherence(s), 1.0, rtol=1e-6)
    np.testing.assert_allclose(frf(s, "H1"), frf(s, "H2"), rtol=1e-6)


def test_a_late_response_has_a_falling_phase():
    """Response per input, e^(−iωτ): the sign that users of other tools miss."""
    force = records(repetitions=3, samples=400)[0]
    delay = 4
    late = np.pad(force, ((0, 0), (delay, 0)))[None]
    early = np.pad(force, ((0, 0), (0, delay)))
    s = averaged(early, late, RATE, (5.0, 100.0), 1.0)
    expected = -2 * np.pi * s.frequency * delay / RATE
    for name in ("H1", "H2", "Hv"):
        np.testing.assert_allclose(np.angle(frf(s, name))[0], expected, atol=1e-6)


def test_averaging_twice_the_same_changes_nothing_but_the_count():
    force, response = records()
    once = averaged(force, response, RATE, (5.0, 400.0), 1.0)
    twice = averaged(np.tile(force, (2, 1)), np.tile(response, (1, 2, 1)), RATE, (5.0, 400.0), 1.0)
    np.testing.assert_allclose(once.uy, twice.uy)
    np.testing.assert_allclose(coherence(once), coherence(twice))
    assert (once.count, twice.count) == (3, 6)


def test_the_order_of_repetitions_does_not_matter_and_gains_go_through():
    force, response = records()
    one = averaged(force, response, RATE, (5.0, 400.0), 1.0)
    other = averaged(force[::-1] * -2, response[:, ::-1] * 6, RATE, (5.0, 400.0), 1.0)
    np.testing.assert_allclose(frf(other), -3 * frf(one), rtol=1e-9)
    np.testing.assert_allclose(coherence(other), coherence(one), rtol=1e-9)


def test_noise_on_one_side_biases_the_other_estimator():
    """H1 bears noise on the response, H2 noise on the input: 2000 records of a gain of 3."""
    rng = np.random.default_rng(0)
    clean = rng.standard_normal((2000, 64))
    noise = rng.standard_normal((2000, 64))
    on_response = averaged(clean, (3 * clean + 3 * noise)[None], RATE, (20.0, 480.0), 20.0)
    assert np.median(np.abs(frf(on_response, "H1"))) == pytest.approx(3, rel=0.02)
    assert np.median(np.abs(frf(on_response, "H2"))) == pytest.approx(6, rel=0.02)
    assert np.median(np.abs(frf(on_response, "Hv"))) == pytest.approx(np.sqrt(18), rel=0.02)
    assert np.median(coherence(on_response)) == pytest.approx(0.5, abs=0.02)
    on_input = averaged(clean + noise, (3 * clean)[None], RATE, (20.0, 480.0), 20.0)
    assert np.median(np.abs(frf(on_input, "H2"))) == pytest.approx(3, rel=0.02)
    assert np.median(np.abs(frf(on_input, "H1"))) == pytest.approx(1.5, rel=0.02)


def test_no_power_is_nan_and_warns_of_nothing():
    s = averaged(np.zeros((2, 64)), np.zeros((1, 2, 64)), RATE, (5.0, 400.0), 10.0)
    assert np.isnan(frf(s)).all()
    assert np.isnan(coherence(s)).all()


def test_cells_of_other_windows_share_their_lines():
    grids = [averaged(*records(samples=n), RATE, (5.0, 300.0), 0.5).frequency for n in (100, 333, 1500, 2600)]
    coarse = grids[0]
    for grid in grids:
        distance = np.abs(grid[:, None] - coarse).min(axis=0)
        assert distance.max() < 1e-6


def test_on_other_lines_takes_the_nearest():
    s = Spectra(
        np.array([10.0, 11.0, 12.0]),
        np.array([1.0, 2.0, 3.0]),
        np.array([[4.0, 5.0, 6.0]]),
        np.array([[7j, 8j, 9j]]),
        3,
    )
    other = s.on(np.array([9.0, 10.4, 10.6, 12.0, 13.0]))
    assert other.uu.tolist() == [1, 1, 2, 3, 3]
    assert other.uy[0].tolist() == [7j, 7j, 8j, 9j, 9j]


def test_lines_of_a_band_say_what_the_averages_say():
    force, response = records(repetitions=4, samples=300)
    spectra = averaged(force, response, RATE, (100.0, 200.0), 0.5)
    lines = Lines.of(force, response, RATE, spectra.frequency)
    mean = lines.averages()
    np.testing.assert_allclose(mean.uu, spectra.uu, atol=1e-9 * spectra.uu.max())
    np.testing.assert_allclose(mean.uy, spectra.uy, atol=1e-9 * np.abs(spectra.uy).max())
    np.testing.assert_allclose(
        magnitude(lines, PaperSettings()), np.sqrt((np.abs(frf(spectra)) ** 2).mean(axis=0)), rtol=1e-6
    )


def test_leaving_one_out():
    force, response = records(repetitions=4)
    grid = np.arange(100.0, 200.0, 1.0)
    left = Lines.of(force, response, RATE, grid).without(1)
    selected = [0, 2, 3]
    other = Lines.of(force[selected], response[:, selected], RATE, grid)
    np.testing.assert_array_equal(left.input, other.input)
    np.testing.assert_array_equal(left.response, other.response)


def test_the_papers_other_reading_is_the_mean_of_ratios():
    force, response = records(repetitions=4)
    lines = Lines.of(force, response, RATE, np.arange(100.0, 200.0, 1.0))
    got = magnitude(lines, PaperSettings(average="ratios"))
    ratio = (lines.response / lines.input).mean(axis=1)
    np.testing.assert_allclose(got, np.sqrt((np.abs(ratio) ** 2).mean(axis=0)))
    assert not np.allclose(got, magnitude(lines, PaperSettings()), rtol=0.05)


def test_the_sign_of_a_sensor_does_not_matter():
    force, response = records()
    grid = np.arange(100.0, 200.0, 1.0)
    flipped = response * np.array([1.0, -1.0])[:, None, None]
    for settings_ in (PaperSettings(), PaperSettings(average="ratios"), PaperSettings(estimator="Hv")):
        np.testing.assert_allclose(
            magnitude(Lines.of(force, response, RATE, grid), settings_),
            magnitude(Lines.of(force, flipped, RATE, grid), settings_),
        )


def test_excitation_is_the_part_of_the_bands_median():
    grid = np.linspace(100.0, 200.0, 101)
    power = np.ones(101)
    power[40] = 0.01
    lines = Lines(grid, np.sqrt(power)[None].astype(complex), np.ones((1, 1, 101), complex))
    assert lines.excitation_at(140.2) == pytest.approx(0.01)
    assert lines.excitation_at(150.0) == pytest.approx(1.0)
    silent = Lines(grid, np.zeros((1, 101), complex), np.ones((1, 1, 101), complex))
    assert silent.excitation_at(140.0) == 0.0


@pytest.mark.parametrize("count", [2, 3, 4, 5, 10, 30])
def test_unrelated_noise_reaches_the_least_coherence_once_in_a_hundred(count):
    """The distribution that the limit is made of, (1 − g)^(count − 1), by simulation: 20 000 trials."""
    rng = np.random.default_rng(count)
    trials = 20_000
    u, y = (rng.standard_normal((2, count, trials)) for _ in range(2))
    u, y = u[0] + 1j * u[1], y[0] + 1j * y[1]
    limit = least_coherence(count, PaperSettings(least_coherence=0.0))
    assert limit == pytest.approx(1 - 0.01 ** (1 / (count - 1)))
    s = Spectra(
        np.arange(trials, dtype=float),
        (np.abs(u) ** 2).mean(0),
        (np.abs(y) ** 2).mean(0)[None],
        (u.conj() * y).mean(0)[None],
        count,
    )
    false_alarms = (coherence(s) > limit).mean()
    assert false_alarms == pytest.approx(0.01, abs=0.0028), "4 sigma of a binomial"


def test_the_least_coherence_asked_for_is_a_floor():
    assert least_coherence(1, PaperSettings()) == 0.0
    assert least_coherence(100, PaperSettings(least_coherence=0.6)) == 0.6
    assert least_coherence(3, PaperSettings(least_coherence=0.6)) == pytest.approx(0.9)
