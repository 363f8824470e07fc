from __future__ import annotations

from pathlib import Path

import numpy as np
from benchmarks.machine_files import Signal, difference, other_signals, row
from tests.recording.readers.machine_files import sound

X = np.arange(8.0)


def test_differences_are_shares_of_the_largest_value() -> None:
    ours = [Signal(X, 1000.0), Signal(X)]
    assert difference(ours, ours) == "0.0e+00; rate 0.0e+00"
    assert difference(ours, [Signal(X + 0.0, 1001.0), Signal(2 * X)]) == "5.0e-01; rate 1.0e-03"
    assert difference([Signal(X)], [Signal(X)]) == "0.0e+00; rate not given"
    assert difference(ours, [Signal(X), Signal(X[:-1])]) == "sizes [8, 8] and [8, 7]"


def test_rows_of_a_file_that_is_read_and_of_one_that_is_cut(tmp_path: Path) -> None:
    path = tmp_path / "a.wav"
    samples = np.array([-5, 3, 7, 9], "<i2").tobytes()
    path.write_bytes(sound(samples))
    assert row(path) == "| `a.wav` | wav | 1 | 4 | 1000 | - | -5, 9 | 0.0e+00; rate 0.0e+00 |"
    path.write_bytes(sound(samples)[:-2])
    assert row(path).startswith("| `a.wav` | refused: cannot be read as WAV (the file is cut")
    assert other_signals(path, "hdf5") == "none"
