"""The averaged spectra of one run beside pyFRF: 40 cells × 30 repetitions × 4 channels × 8192 samples.

Both get the same records, take out the mean, apply one and the same Hann window (that of ``numpy.hanning``,
which pyFRF uses) and give H1 and coherence on the same lines, 10–600 Hz at 0.2 Hz. All rows take turns, and
the least time of each counts: what disturbs the machine then disturbs all alike.

    python -m benchmarks.spectra [--cells 40] [--rounds 3]
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ballscrew.base.arrays import Array
from ballscrew.modal.spectra import averaged, coherence, frf
from benchmarks.machine import heading

RATE, SAMPLES, REPETITIONS, RESPONSES = 12800.0, 8192, 30, 3
BAND, STEP = (10.0, 600.0), 0.2


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


def interleaved(work: dict[str, Callable[[], object]], rounds: int) -> dict[str, float]:
    """Least time of several runs, each round all of them in turn."""
    best = dict.fromkeys(work, np.inf)
    for _ in range(rounds):
        for name, run in work.items():
            start = time.perf_counter()
            run()
            best[name] = min(best[name], time.perf_counter() - start)
    return best


def differences(
    mine: list[tuple[Array, Array]], reference: list[tuple[Array, Array]]
) -> tuple[float, float, float]:
    """Largest relative difference of H1 where the coherence is above a half, and at all; of the coherence."""
    strong, anywhere, of_coherence = 0.0, 0.0, 0.0
    for (h, c), (h0, c0) in zip(mine, reference, strict=True):
        relative = np.abs(h - h0) / np.abs(h0)
        strong = max(strong, float(relative[c0 > 0.5].max()))
        anywhere = max(anywhere, float(relative.max()))
        of_coherence = max(of_coherence, float(np.abs(c - c0).max()))
    return strong, anywhere, of_coherence


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
    work: dict[str, Callable[..., tuple[Array, list[tuple[Array, Array]]]]] = {
        "pyFRF, a repetition at a time": lambda u, y: theirs(u, y, whole=False),
        "pyFRF, a whole cell at once": lambda u, y: theirs(u, y, whole=True),
        "ballscrew, averaged on 2N, refined once a cell": ours,
    }
    their_lines, reference = theirs(force[few], response[few], whole=True)
    off = {}
    for name, run in work.items():
        lines, values = run(force[few], response[few])
        assert np.allclose(lines, their_lines), f"{name}: the lines differ"
        off[name] = differences(values, reference)
    rows = interleaved(
        {name: lambda run=run: run(force, response) for name, run in work.items()},  # type: ignore[misc]
        given.rounds,
    )
    base = next(iter(rows.values()))
    print(heading(f"python -m benchmarks.spectra --cells {given.cells}"), end="\n\n")
    print(f"{given.cells} cells × {REPETITIONS} repetitions × {1 + RESPONSES} channels × {SAMPLES} samples")
    whole = rows["pyFRF, a whole cell at once"]
    print("\n| method | s | records/s | × pyFRF's loop | × its whole cell | H1 off, coherent | all |")
    print("|---|---|---|---|---|---|---|")
    for name, took in rows.items():
        strong, anywhere, _ = off[name]
        print(
            f"| {name} | {took:.3f} | {count / took:.0f} | {base / took:.1f} | {whole / took:.1f} | "
            f"{strong:.0e} | {anywhere:.0e} |"
        )
    worst = max(of_coherence for _, _, of_coherence in off.values())
    print(
        f"\nH1 off: the largest relative difference from pyFRF's in 10–600 Hz where the coherence is above "
        f"a half, and on all lines, also in dips full of noise. Coherence: {worst:.0e} at most."
    )


if __name__ == "__main__":
    main()
