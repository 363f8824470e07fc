from __future__ import annotations

from pathlib import Path

from benchmarks.sinumerik_response import difference, time_series

import ballscrew


def test_the_response_is_that_of_the_files_own_spectra(data: Path) -> None:
    path = data / "machine-files" / "sinumerik-freq-trace.xml"
    inputs, outputs, rate = time_series(path)
    response, frequency = difference(path, inputs, outputs, rate)
    assert response < 1e-11
    assert 0.0014 < frequency < 0.0015


def test_both_series_have_the_same_antiresonance(data: Path) -> None:
    inputs, outputs, rate = time_series(data / "machine-files" / "sinumerik-freq-trace.xml")
    intervals = []
    for part in (slice(None), slice(0, 1), slice(1, 2)):
        found = ballscrew.resonances(
            inputs[part], outputs[part], rate, quantities=("speed", "speed"), band=(133.6, 593.8)
        )
        assert found.antiresonance.frequency is not None
        intervals.append(found.antiresonance.frequency.interval)
    assert max(low for low, _ in intervals) < min(high for _, high in intervals)
