"""Resonance and antiresonance of two masses in a speed loop, by noise, chirp, sine steps and binary noise.

python -m benchmarks.drive_excitation [--count 50]

Prints error, uncertainty and coverage of both frequencies, without and with the excitation as reference.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy import signal

import ballscrew
from ballscrew.base.arrays import Array
from ballscrew.base.quantity import NORMAL_95

RATE = 8000.0
ROTOR_HELD, ROTOR, TABLE = 150.0, 250.0, 100.0  # Hz, kg
ROTOR_FREE = ROTOR_HELD * math.sqrt(1 + TABLE / ROTOR)
PERIOD = 2047  # samples of the binary noise
CLOCK = 0.0005  # largest error of the recorder's rate, as the uncertainty assumes it
_SETTLED = 4000  # samples
_BANDWIDTH, _RESET = 60.0, 0.02  # of the speed loop: Hz, s

CASES: Sequence[tuple[str, float, float]] = (
    ("noise", 2e-5, 2.0),
    ("noise", 1e-4, 2.0),
    ("noise", 3e-4, 2.0),
    ("chirp", 1e-4, 2.0),
    ("steps", 1e-4, 2.0),
    ("binary", 3e-5, PERIOD / RATE),
)
"""Excitation, noise of the speed (m/s), duration (s)."""


def excite(kind: str, random: np.random.Generator, count: int) -> Array:
    """Force that is added to that of the controller, N: its rms is 100 N."""
    if kind == "noise":
        return 100 * random.normal(size=count)
    if kind == "binary":
        return 100 * np.sign(random.normal(size=PERIOD))[np.mod(np.arange(count), PERIOD)]
    length = count - _SETTLED
    phase = np.mod(np.arange(count), length) / length
    if kind == "chirp":
        seconds = length / RATE
        sweep = signal.chirp(phase * seconds, 20, seconds, 500, method="logarithmic")
        return np.asarray(140 * sweep)
    steps = np.geomspace(30, 400, 48)[np.minimum((48 * phase).astype(int), 47)]
    return np.asarray(140 * np.sin(2 * np.pi * np.cumsum(steps) / RATE))


def simulate(
    seed: int = 0,
    kind: str = "noise",
    *,
    seconds: float = 1.0,
    noise: float = 3e-5,
    damping: float = 0.015,
    excitation: float = 1.0,
) -> tuple[Array, Array, Array]:
    """Force (N), speed (m/s) and excitation (N) of a loop with a delay of one sample.

    ``noise`` is that of the measured speed, m/s, which the controller turns into force.
    """
    random = np.random.default_rng(seed)
    count = _SETTLED + round(seconds * RATE)
    k = TABLE * (2 * np.pi * ROTOR_HELD) ** 2
    d = 2 * damping * math.sqrt(k * TABLE)
    table = [TABLE, d, k]
    denominator = np.polyadd(np.polymul([ROTOR, 0], table), np.polymul([d, k], [TABLE, 0]))
    plant: Any = (table, denominator)  # the stubs know no transfer functions of lists
    b, a, _ = signal.cont2discrete(plant, 1 / RATE, "zoh")
    gain = (ROTOR + TABLE) * 2 * np.pi * _BANDWIDTH
    controller = np.array([0, gain, -gain * (1 - 1 / (_RESET * RATE))])
    open_loop = np.pad(np.polymul(a, [1.0, -1.0]), (0, 1))
    closed_loop = np.polyadd(open_loop, np.polymul(np.ravel(b), controller))
    added = excitation * excite(kind, random, count)
    w = noise * random.normal(size=count)
    force = signal.lfilter(open_loop, closed_loop, added)
    force = force - signal.lfilter(np.polymul(a, controller), closed_loop, w)
    speed = signal.lfilter(np.ravel(b), a, force) + w
    return force[_SETTLED:], speed[_SETTLED:], added[_SETTLED:]


def row_of(kind: str, noise: float, seconds: float, referred: bool, count: int) -> str:
    """Row of the table: error, uncertainty and coverage of both frequencies."""
    errors: tuple[list[tuple[float, float]], ...] = ([], [])
    for seed in range(count):
        force, speed, added = simulate(seed, kind, noise=noise, seconds=seconds)
        reference = added if referred else None
        clock = 1 + np.random.default_rng(seed).uniform(-CLOCK, CLOCK)
        found = ballscrew.resonances(force, speed, clock * RATE, reference=reference)
        pairs = ((found.resonance, ROTOR_FREE), (found.antiresonance, ROTOR_HELD))
        for rows, (mode, true) in zip(errors, pairs, strict=True):
            if mode.frequency is not None:
                rows.append((mode.frequency.value - true, mode.frequency.standard_uncertainty))
    cells = [f"{kind}, {seconds:.2g} s", f"{1e6 * noise:g}", "yes" if referred else "no"]
    for rows in errors:
        if not rows:
            cells.append("– | – | refused")
            continue
        error, u = np.array(rows).T
        inside = int(np.sum(np.abs(error) < NORMAL_95 * u))
        cells.append(
            f"{np.mean(error):+.2f} ± {np.std(error):.2f} | {np.median(u):.2f} | {inside} of {len(u)}"
        )
    return "| " + " | ".join(cells) + " |"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=50, help="recordings of each row")
    count = parser.parse_args().count
    for case in CASES:
        for referred in (False, True):
            print(row_of(*case, referred, count), flush=True)


if __name__ == "__main__":
    main()
