"""How close an isolated cell's estimate is to what its data hold: scatter over the Cramér-Rao bound.

A linear plant of two modes (150 Hz with 3 %, 235 Hz with 2.5 % damping, a delay of 50 µs) is struck by
jerk-limited pulses that differ a little, rings when a record starts, and drifts; 30 repetitions of 0.2 s at
12.8 kHz, white noise. The bound is that of the modelled band, 40 to 420 Hz, with everything unknown that the
estimator does not know; a second column takes the whole record, up to 6.4 kHz, where a delay shows better.

    python -m benchmarks.cell_bound [--cells 60] [--force-noise 0] [--delay 50e-6]
"""

from __future__ import annotations

import argparse
import contextlib
import importlib
import io
import time
import warnings
from collections.abc import Callable

import numpy as np

from ballscrew.base.arrays import Array
from ballscrew.modal.lines import Lines
from ballscrew.modal.output_error import cell_bound, identify_cell
from ballscrew.modal.output_error.plant import ModalPlant, free_decay, padded_lines, respond
from ballscrew.modal.peak import first_peak
from ballscrew.modal.spectra import averaged, frf
from benchmarks.machine import heading

RATE, SAMPLES, REPETITIONS = 12800.0, 2560, 30
BAND, MODELLED = (100.0, 300.0), (40.0, 420.0)
Estimator = Callable[[Array, Array], tuple[float, float]]


def plant(delay: float = 50e-6) -> ModalPlant:
    """The plant."""
    return ModalPlant((150.0, 235.0), (0.03, 0.025), (1.2, -0.4), 0.9, delay)


def cell(truth: ModalPlant, level: float, seed: int) -> tuple[Array, Array, float, Array]:
    """Force, response, the noise's standard deviation and the ringing at the start, at a level in dB."""
    random = np.random.default_rng(seed)
    time_ = np.arange(SAMPLES) / RATE
    start = 0.03 + random.uniform(-0.003, 0.003, (REPETITIONS, 1))
    length = 0.06 * (1 + random.uniform(-0.05, 0.05, (REPETITIONS, 1)))
    force = 100 * np.clip(np.minimum((time_ - start) / 0.0025, (start + length - time_) / 0.0025), 0, 1)
    force += 0.5 * random.standard_normal(force.shape)
    clean = respond(truth.transfer(padded_lines(SAMPLES, RATE)), force)
    size = float(clean.std())
    initial = 0.3 * size * random.standard_normal((REPETITIONS, len(truth.frequency), 2))
    for mode, (f, z) in enumerate(zip(truth.frequency, truth.damping, strict=True)):
        clean = clean + initial[:, mode] @ free_decay(f, z, SAMPLES, RATE)
    drift = np.stack([np.ones(SAMPLES), np.linspace(-1, 1, SAMPLES)])
    clean = clean + 0.2 * size * random.standard_normal((REPETITIONS, 2)) @ drift
    noise = float(clean.std()) * 10 ** (-level / 20)
    return force, clean + noise * random.standard_normal(clean.shape), noise, initial


def papers(force: Array, response: Array) -> tuple[float, float]:
    """The paper's: truncated to one blow, Hann window, H1, the first peak."""
    window = np.hanning(1664)
    u, y = ((x - x.mean(axis=1, keepdims=True)) * window for x in (force[:, :1664], response[:, :1664]))
    lines = Lines.of(u, y[None], RATE, np.arange(BAND[0], BAND[1], 0.2))
    magnitude = np.abs(frf(lines.averages())[0])
    peak = first_peak(lines.grid, magnitude, BAND)
    return (peak.frequency if peak else np.nan), np.nan


def lscf(force: Array, response: Array) -> tuple[float, float]:
    """LSCF of sdypy-EMA on H1 of Hann-windowed records: the pole that orders agree on."""
    ema = importlib.import_module("sdypy.EMA")

    window = np.hanning(SAMPLES)
    u, y = ((x - x.mean(axis=1, keepdims=True)) * window for x in (force, response))
    spectra = averaged(u, y[None], RATE, (5.0, 500.0), 1.0)
    h1 = frf(spectra)
    with contextlib.redirect_stdout(io.StringIO()), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        model = ema.Model(
            h1, spectra.frequency, lower=40, upper=420, pol_order_high=16, frf_form="accelerance"
        )
        model.get_poles(method="lscf", show_progress=False)
    # The median over the upper half of the orders; of each the pole whose damping is likeliest.
    found = []
    for f, z in zip(model.pole_freq, model.pole_xi, strict=True):
        inside = (f > BAND[0]) & (f < 0.5 * (150 + 235)) & (z > 0.002) & (z < 0.2)
        if inside.any():
            at = np.flatnonzero(inside)[np.argmin(np.abs(z[inside] - 0.03))]
            found.append((f[at], z[at]))
    middle = np.median(np.array(found[len(found) // 2 :]), axis=0) if found else np.full(2, np.nan)
    return float(middle[0]), float(middle[1])


def ours(force: Array, response: Array, **given: float) -> tuple[float, float]:
    """By :func:`ballscrew.modal.output_error.identify_cell`."""
    found = identify_cell(force, response, RATE, BAND, **given)  # type: ignore[arg-type]
    return found.frequency or np.nan, found.damping or np.nan


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--cells", type=int, default=60)
    parser.add_argument("--force-noise", type=float, default=0.0, help="N, on pulses of 100 N")
    parser.add_argument("--delay", type=float, default=50e-6, help="s")
    given = parser.parse_args()
    truth = plant(given.delay)
    methods: dict[str, Estimator] = {"the paper's peak": papers}
    try:
        importlib.import_module("sdypy.EMA")
        methods["sdypy-EMA, LSCF on H1"] = lscf
    except ImportError:
        print("sdypy-EMA is not installed: its rows are left out.\n")
    methods["output error"] = ours
    methods["output error, delay known"] = lambda u, y: ours(u, y, delay=given.delay)
    command = f"python -m benchmarks.cell_bound --cells {given.cells} --force-noise {given.force_noise:g}"
    print(heading(f"{command} --delay {given.delay:g}"), end="\n\n")
    print("| dB | method | rms error, Hz | bound, Hz | error / bound | / bound of the whole record |", end="")
    print(" damping, rms error | found | least ms |\n|---|---|---|---|---|---|---|---|---|")
    for level in (30.0, 10.0, -5.0):
        table(truth, level, given.cells, given.force_noise, methods)


def table(
    truth: ModalPlant, level: float, cells: int, force_noise: float, methods: dict[str, Estimator]
) -> None:
    """Rows of one level of noise."""
    values: dict[str, list[tuple[float, float]]] = {name: [] for name in methods}
    least = dict.fromkeys(methods, np.inf)
    bounds: dict[str, list[tuple[float, float]]] = {"unknown": [], "known": []}
    for seed in range(cells):
        force, response, noise, initial = cell(truth, level, 1000 * round(level + 10) + seed)
        measured = force + force_noise * np.random.default_rng(10_000 + seed).standard_normal(force.shape)
        for name, known in (("unknown", False), ("known", True)):
            both = [
                cell_bound(
                    truth, force, RATE, noise, initial=initial, delay=not known, band=band,
                    force_noise=force_noise,
                ).frequency[0]
                for band in (MODELLED, None)
            ]  # fmt: skip
            bounds[name].append((both[0], both[1]))
        for name, method in methods.items():
            start = time.perf_counter()
            values[name].append(method(measured, response))
            least[name] = min(least[name], time.perf_counter() - start)
    for name, found in values.items():
        error = np.array(found) - (truth.frequency[0], truth.damping[0])
        rms = np.sqrt([np.mean(e[np.isfinite(e)] ** 2) if np.isfinite(e).any() else np.nan for e in error.T])
        bound = np.sqrt(np.mean(np.square(bounds["known" if "known" in name else "unknown"]), axis=0))
        damping = "–" if np.isnan(rms[1]) else f"{100 * rms[1] / truth.damping[0]:.1f} %"
        part = f"{np.isfinite(error[:, 0]).sum()}/{cells}"
        print(
            f"| {level:g} | {name} | {rms[0]:.4f} | {bound[0]:.4f} | {rms[0] / bound[0]:.2f} | "
            f"{rms[0] / bound[1]:.2f} | {damping} | {part} | {1e3 * least[name]:.0f} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
