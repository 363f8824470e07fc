"""The averaged spectra of one run beside pyFRF: 40 cells × 30 repetitions × 4 channels × 8192 samples.

Both get the same records, take out the mean, apply one and the same Hann window (that of ``numpy.hanning``,
which pyFRF uses) and give H1 and coherence on the same lines, 10–600 Hz at 0.2 Hz.

    python -m benchmarks.spectra [--cells 40] [--rounds 3]
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ballscrew.modal.spectra import averaged, coherence, frf
from benchmarks.machine import heading

RATE, SAMPLES, REPETITIONS, RESPONSES = 12800.0, 8192, 30, 3
BAND, STEP = (10.0, 600.0), 0.2
Array = NDArray[np.float64]


def records(cells: int, seed: int = 1) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Records of a mode at 150 Hz with 3 % damping, excited by a pulse, 1 % of noise on all channels.

    Parameters
    ----------
    cells : int
        How many.
    seed : int
        Of the noise.

    Returns
    -------
    input : ndarray, shape (cells, repetitions, samples)
        N m.
    response : ndarray, shape (cells, responses, repetitions, samples)
        m/s².
    """
    random = np.random.default_rng(seed)
    t = np.arange(SAMPLES) / RATE
    frequency = np.fft.rfftfreq(2 * SAMPLES, 1 / RATE)
    r = frequency / 150.0
    response_function = 1 / (1 - r**2 + 2j * 0.03 * r)
    pulse = np.clip(np.minimum((t - 0.1) / 0.002, (0.16 - t) / 0.002), 0, 1)
    rung = np.fft.irfft(np.fft.rfft(pulse, 2 * SAMPLES) * response_function)[:SAMPLES]

    def noisy(signal: Array, shape: tuple[int, ...]) -> NDArray[np.float32]:
        noise = random.standard_normal((*shape, SAMPLES), dtype=np.float32)
        return signal.astype(np.float32) + np.float32(0.01 * np.abs(signal).max()) * noise

    return noisy(pulse, (cells, REPETITIONS)), noisy(rung, (cells, RESPONSES, REPETITIONS))


def ours(
    force: NDArray[np.float32], response: NDArray[np.float32]
) -> tuple[Array, list[tuple[Array, Array]]]:
    """H1 and coherence of every cell, by :func:`ballscrew.modal.spectra.averaged`."""
    out = []
    frequency = np.empty(0)
    hann = np.hanning(SAMPLES)
    for cell in zip(force, response, strict=True):
        u, y = ((x - x.mean(axis=-1, keepdims=True, dtype=np.float64)) * hann for x in cell)
        spectra = averaged(u, y, RATE, BAND, STEP)
        frequency = spectra.frequency
        out.append((frf(spectra), coherence(spectra)))
    return frequency, out  # type: ignore[return-value]  # H1 is complex


def theirs(
    force: NDArray[np.float32], response: NDArray[np.float32], *, whole: bool
) -> tuple[Array, list[tuple[Array, Array]]]:
    """The same by pyFRF, a repetition at a time or a whole cell at once."""
    from pyFRF import FRF

    length = round(RATE / STEP)
    out = []
    frequency = np.empty(0)
    for u, y in zip(force, response, strict=True):
        estimator = FRF(int(RATE), exc_type="f", resp_type="a", window="hann", fft_len=length)
        exc, resp = u[:, None].astype(np.float64), y.swapaxes(0, 1).astype(np.float64)
        for part in [slice(None)] if whole else [slice(k, k + 1) for k in range(len(u))]:
            estimator.add_data(exc[part], resp[part])
        frequency = estimator.get_f_axis()
        inside = (frequency >= BAND[0]) & (frequency <= BAND[1])
        h1 = estimator.get_FRF(frf_estimator="H1", frf_form="accelerance")[:, 0]
        out.append((h1[:, inside], np.atleast_2d(np.squeeze(estimator.get_coherence()))[:, inside]))
        frequency = frequency[inside]
    return frequency, out


def seconds(work: Callable[[], object], rounds: int) -> float:
    """Least of several runs."""
    best = np.inf
    for _ in range(rounds):
        start = time.perf_counter()
        work()
        best = min(best, time.perf_counter() - start)
    return float(best)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--cells", type=int, default=40)
    parser.add_argument("--rounds", type=int, default=3)
    given = parser.parse_args()
    force, response = records(given.cells)
    count = given.cells * REPETITIONS * (1 + RESPONSES)
    few = slice(0, min(4, given.cells))
    lines, mine = ours(force[few], response[few])
    their_lines, reference = theirs(force[few], response[few], whole=True)
    assert np.allclose(lines, their_lines), "the lines differ"
    worst_h1 = max(
        float(np.max(np.abs(a[0] - b[0]) / np.abs(b[0]))) for a, b in zip(mine, reference, strict=True)
    )
    worst = max(float(np.max(np.abs(a[1] - b[1]))) for a, b in zip(mine, reference, strict=True))
    rows = {
        "pyFRF, a repetition at a time": seconds(lambda: theirs(force, response, whole=False), 1),
        "pyFRF, a whole cell at once": seconds(lambda: theirs(force, response, whole=True), given.rounds),
        "ballscrew, averaged on 2N, refined once a cell": seconds(
            lambda: ours(force, response), given.rounds
        ),
    }
    base = next(iter(rows.values()))
    print(heading(f"python -m benchmarks.spectra --cells {given.cells}"), end="\n\n")
    print(f"{given.cells} cells × {REPETITIONS} repetitions × {1 + RESPONSES} channels × {SAMPLES} samples")
    print("\n| method | s | records/s | × pyFRF's loop |\n|---|---|---|---|")
    for name, took in rows.items():
        print(f"| {name} | {took:.2f} | {count / took:.0f} | {base / took:.1f} |")
    print(f"\nLargest difference from pyFRF in 10–600 Hz: H1 {worst_h1:.1e} relative, coherence {worst:.1e}.")


if __name__ == "__main__":
    main()
