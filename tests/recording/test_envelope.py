"""Minima and maxima of blocks: no sample is lost at any zoom, and the samples themselves are exact."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ballscrew.recording.envelope import read_envelope, write_envelope

LENGTH = 300_001


@pytest.fixture(scope="module")
def samples() -> np.ndarray:
    found = np.sin(np.arange(LENGTH) * 0.01).astype(np.float32)
    found[123_456], found[200_000] = 7.0, -9.0
    return found


@pytest.fixture(scope="module")
def folder(samples: np.ndarray, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("envelope") / "torque"
    write_envelope(path, samples)
    return path


@given(st.integers(0, LENGTH - 1), st.integers(1, LENGTH), st.integers(2, 2000))
def test_blocks_contain_every_sample_of_a_part(
    folder: Path, samples: np.ndarray, first: int, count: int, columns: int
) -> None:
    end = min(first + count, LENGTH)
    part = read_envelope(folder, first, end, columns)
    assert part.first[0] <= first
    assert part.end >= end
    assert len(part.first) <= max(2 * columns, 2)
    edges = np.append(part.first, part.end)
    assert (np.diff(edges) > 0).all()
    assert np.array_equal(part.low, np.minimum.reduceat(samples[: part.end], part.first))
    assert np.array_equal(part.high, np.maximum.reduceat(samples[: part.end], part.first))
    assert max(first - part.first[0], part.end - end) <= max(np.diff(edges).max(), 1)


def test_a_short_part_is_its_samples(folder: Path, samples: np.ndarray) -> None:
    part = read_envelope(folder, 123_400, 123_500, 100)
    assert part.has_samples
    assert np.array_equal(part.low, samples[123_400:123_500])
    assert not read_envelope(folder, 0, LENGTH, 100).has_samples


def test_a_spike_shows_in_the_whole_signal(folder: Path) -> None:
    part = read_envelope(folder, 0, LENGTH, 10)
    assert (part.high.max(), part.low.min()) == (7.0, -9.0)


def test_what_is_not_finite_has_no_value(tmp_path: Path) -> None:
    samples = np.arange(50_000, dtype=np.float64)
    samples[100:40_000], samples[45_000] = np.nan, np.inf
    write_envelope(tmp_path / "a", samples)
    part = read_envelope(tmp_path / "a", 0, len(samples), 10)
    assert np.isnan(part.low[3])
    assert part.high[-1] == 49_999
    assert np.isnan(read_envelope(tmp_path / "a", 44_999, 45_002, 10).low[1])


def test_a_single_sample_is_a_signal(tmp_path: Path) -> None:
    write_envelope(tmp_path / "a", np.array([3.0]))
    assert read_envelope(tmp_path / "a", 0, 1, 2).low.tolist() == [3.0]
