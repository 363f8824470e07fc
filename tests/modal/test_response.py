"""FRF from arrays."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from scipy import signal

import ballscrew
from ballscrew import InputError, frf


def test_the_response_of_a_filter_is_its_frequency_response():
    random = np.random.default_rng(0)
    u = np.pad(random.normal(size=(8, 900)), ((0, 0), (0, 200)))
    b, a = signal.butter(2, 100, fs=1000.0)
    found = ballscrew.frf(u, signal.lfilter(b, a, u, axis=1), "1 kHz")
    _, expected = signal.freqz(b, a, found.frequency, fs=1000.0)
    np.testing.assert_allclose(found.frf, expected, atol=0.01)
    assert found.coherence.min() > 0.99
    assert found.count == 8


def test_noise_biases_each_estimator_its_own_way():
    random = np.random.default_rng(0)
    u = random.normal(size=(200, 512))
    noisy = u + random.normal(size=u.shape)
    of_output, of_input = ballscrew.frf(u, noisy, 1000), ballscrew.frf(noisy, u, 1000, estimator="H2")
    assert np.mean(np.abs(of_output.frf)) == pytest.approx(1, abs=0.05)
    assert np.mean(np.abs(of_input.frf)) == pytest.approx(1, abs=0.05)
    assert np.mean(of_output.coherence) == pytest.approx(0.5, abs=0.05)


def test_one_record_has_no_coherence():
    found = ballscrew.frf(np.arange(32.0), np.arange(32.0), 1.0)
    assert np.isnan(found.coherence).all()


def test_labels_and_resolution():
    dataset = ballscrew.frf(np.eye(2, 64), np.eye(2, 64), "1 kHz", resolution="2 Hz").to_xarray()
    assert np.diff(dataset.frequency).max() <= 2.0
    assert dataset.frequency.attrs["units"] == "Hz"
    assert dataset.attrs["records"] == 2


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"estimator": "h1"}, "must be H1, H2, Hv"),
        ({"resolution": 0}, "the resolution is 0 Hz"),
        ({"resolution": "1e-7 Hz"}, "suit"),
    ],
)
def test_an_estimator_or_a_resolution_that_is_none_is_refused(arguments, message):
    x = np.random.default_rng(1).normal(size=(2, 1000))
    with pytest.raises(InputError, match=message):
        frf(x, x, 1000.0, **arguments)


@pytest.mark.parametrize("size", [1e160, 1e-160])
@pytest.mark.parametrize("method", ["frf", "natural_frequency", "resonances"])
def test_values_whose_squares_are_no_numbers_are_refused(method, size):
    x = np.random.default_rng(0).normal(size=1000)
    with pytest.raises(InputError, match=f"the output has values up to .e.{abs(np.log10(size)):.0f}; state"):
        getattr(ballscrew, method)(x, size * x, "1 kHz")


def _timed(kind: str, times: np.ndarray) -> object:
    samples = np.random.default_rng(0).normal(size=len(times))
    if kind == "xarray":
        return xr.DataArray(samples, dims="time", coords={"time": times})
    if kind == "seconds":
        return pd.Series(samples, index=pd.Index(times, name="time"))
    if kind == "dates":
        return pd.Series(
            samples, index=pd.Timestamp("2026-11-02", tz="UTC") + pd.to_timedelta(times, unit="s")
        )
    return pd.Series(samples, index=pd.to_timedelta(times, unit="s"))


@pytest.mark.parametrize("kind", ["xarray", "seconds", "durations", "dates"])
def test_times_of_the_samples_must_be_those_of_the_rate(kind: str) -> None:
    times = np.arange(256) / 1000
    gap = times + 0.5 * (times > 0.1)
    assert ballscrew.frf(_timed(kind, times + 7), _timed(kind, times + 7.0002), "1 kHz").count == 1
    with pytest.raises(InputError, match="the times of the input are those of 1000 Hz; 4000 Hz was stated"):
        ballscrew.frf(_timed(kind, times), _timed(kind, times), "4 kHz")
    for wrong in (gap, times[::-1], np.append(times[:-1], times[-2])):
        with pytest.raises(InputError, match="the times of the output"):
            ballscrew.frf(_timed(kind, times), _timed(kind, wrong), "1 kHz")
    with pytest.raises(InputError, match="signal 'torque' of arrays"):
        ballscrew.Recording.from_arrays(torque=_timed(kind, times), sample_rate=4000)


@pytest.mark.parametrize("kind", ["xarray", "seconds", "durations", "dates"])
def test_signals_must_begin_at_the_same_time(kind: str) -> None:
    times = np.arange(256) / 1000
    first, second = _timed(kind, times), _timed(kind, times + 0.25)
    with pytest.raises(InputError, match=r"the output begins 0\.25 s after the input by their times"):
        ballscrew.frf(first, second, "1 kHz")
    with pytest.raises(InputError, match=r"the output begins 0\.25 s before the input by their times"):
        ballscrew.resonances([first, second], [first, first], "1 kHz")
    with pytest.raises(
        InputError, match=r"signal 'position' of arrays begins 0\.25 s after the signal 'torque'"
    ):
        ballscrew.Recording.from_arrays(torque=first, position=second, sample_rate=1000)
    assert ballscrew.frf(first, np.asarray(second), "1 kHz").count == 1


def test_an_index_that_is_no_time_is_ignored() -> None:
    samples = np.random.default_rng(0).normal(size=256)
    numbered = xr.DataArray(samples, dims="time", coords={"time": np.arange(256)})
    in_ms = xr.DataArray(samples, dims="time", coords={"time": ("time", np.arange(256.0), {"units": "ms"})})
    for u in (numbered, in_ms, pd.Series(samples), pd.Series(samples, index=np.arange(256.0))):
        assert ballscrew.frf(u, samples, "1 kHz").count == 1


def test_records_of_one_signal_have_one_unit():
    samples = np.random.default_rng(0).normal(size=256)
    in_n, in_mn = (xr.DataArray(samples, dims="time", attrs={"units": unit}) for unit in ("N", "mN"))
    assert ballscrew.frf([in_n, in_n], [in_mn, in_mn], "1 kHz").count == 2
    with pytest.raises(InputError, match="records of the input have different units: 'N', 'mN'"):
        ballscrew.frf([in_n, in_mn], [in_n, in_n], "1 kHz")
