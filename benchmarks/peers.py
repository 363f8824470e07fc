"""Other ways to read a natural frequency off one cell: the paper's words, pyFRF, sdypy-EMA.

Each gets the cell's complete rows of the table *Transients*, all repetitions, both accelerometers, and the
data sheet's prediction for this place; none gets the truth. None knows when to refuse, but for LSCF, which
may find no stable pole.
"""

from __future__ import annotations

import contextlib
import importlib
import io
import warnings
from collections.abc import Callable
from itertools import pairwise

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from ballscrew.base.arrays import Array
from ballscrew.fcft.conditions import Condition
from ballscrew.modal.paper.lines import Lines, magnitude
from ballscrew.modal.paper.settings import PaperSettings
from ballscrew.modal.paper.window import Extent, tapered

__all__ = ["PEERS", "Peer", "available"]

Peer = Callable[[xr.Dataset, float], float | None]
HALF = 0.25  # of the prediction, where the mode is looked for
STEP = 0.2  # Hz, of the lines
BEFORE, AFTER = 0.010, 0.100  # s around the phase: transient, without the steady state
WIDE = (0.3, 2.5)  # of the prediction: lines that LSCF fits where it is not limited to the band
SAME_FREQUENCY, SAME_DAMPING = 1e-3, 5e-2  # sdypy-EMA's own defaults for a stable pole
DAMPED = 0.2


def transient(cell: xr.Dataset) -> Extent:
    """From 10 ms before the phase to 100 ms after it, in samples around the blow next to standstill."""
    rate = float(cell.attrs["sample_rate"])
    phase = int(np.median(cell["end"].values - cell["onset"].values))
    departs = Condition(str(cell["condition"].values[0])).accelerating
    before, after = round(BEFORE * rate), round(AFTER * rate)
    return Extent(before, after + phase) if departs else Extent(before + phase, after)


def printed(cell: xr.Dataset, expected: float) -> float | None:
    """As the paper has it in words: truncate, Hann, pad with zeros, average, take the highest point."""
    condition = Condition(str(cell["condition"].values[0]))
    force, response = tapered(cell, condition, transient(cell))
    if len(force) == 0:
        return None
    grid = np.arange((1 - HALF) * expected, (1 + HALF) * expected, STEP)
    lines = Lines.of(force, response, float(cell.attrs["sample_rate"]), grid)
    return float(grid[np.argmax(magnitude(lines, PaperSettings()))])


def pyfrf(cell: xr.Dataset) -> tuple[Array, NDArray[np.complex128]]:
    """Lines and H1 of both accelerometers by pyFRF: whole segments, cut to the shortest, Hann, padded."""
    module = importlib.import_module("pyFRF")
    rate, size = float(cell.attrs["sample_rate"]), int(cell["length"].min())
    force = cell["input"].values[:, None, :size].astype(np.float64)
    response = cell["acceleration"].values[:, :, :size].swapaxes(0, 1).astype(np.float64)
    force, response = (x - x.mean(axis=-1, keepdims=True) for x in (force, response))
    estimator = module.FRF(
        int(rate), exc_type="f", resp_type="a", window="hann", fft_len=max(size, round(rate / STEP))
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        estimator.add_data(force, response)
        h1 = estimator.get_FRF(frf_estimator="H1", frf_form="accelerance")[:, 0]
    return estimator.get_f_axis(), np.nan_to_num(np.atleast_2d(h1))  # at 0 Hz it is 0/0


def highest(frequency: Array, h1: NDArray[np.complex128], expected: float) -> float:
    """Highest point in the band, both accelerometers together."""
    inside = np.flatnonzero(np.abs(frequency / expected - 1) <= HALF)
    return float(frequency[inside[np.argmax((np.abs(h1[:, inside]) ** 2).sum(axis=0))]])


def pyfrf_peak(cell: xr.Dataset, expected: float) -> float | None:
    """H1 by pyFRF, its highest point in the band."""
    return highest(*pyfrf(cell), expected)


def lscf(cell: xr.Dataset, expected: float, lines: tuple[float, float], order: int) -> float | None:
    """sdypy-EMA's LSCF on pyFRF's H1: the stable pole nearest to the band's strongest peak."""
    ema = importlib.import_module("sdypy.EMA")
    frequency, h1 = pyfrf(cell)
    near = highest(frequency, h1, expected)
    with contextlib.redirect_stdout(io.StringIO()), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        model = ema.Model(
            h1,
            frequency,
            lower=lines[0] * expected,
            upper=lines[1] * expected,
            pol_order_high=order,
            frf_form="accelerance",
        )
        model.get_poles(method="lscf", show_progress=False)
    orders = [np.stack(pair) for pair in zip(model.pole_freq, model.pole_xi, strict=True)]
    stable = np.concatenate([_stable(before, poles) for before, poles in pairwise(orders)])
    stable = stable[np.abs(stable / expected - 1) <= HALF]
    if len(stable) == 0:
        return None
    nearest = stable[np.argmin(np.abs(stable - near))]
    return float(np.median(stable[np.abs(stable / nearest - 1) < 0.01]))  # over the orders that have it


def _stable(before: Array, poles: Array) -> Array:
    """Frequencies of poles that the order before had too; each of shape (2, poles): Hz, damping ratio."""
    poles = poles[:, (poles[1] > 0) & (poles[1] < DAMPED)]
    off = np.abs(before[:, None, :] / poles[:, :, None] - 1)
    return np.asarray(poles[0, ((off[0] < SAME_FREQUENCY) & (off[1] < SAME_DAMPING)).any(axis=1)])


PEERS: dict[str, tuple[Peer, tuple[str, ...]]] = {
    "the paper as printed, highest point": (printed, ()),
    "pyFRF, highest point": (pyfrf_peak, ("pyFRF",)),
    "sdypy-EMA LSCF, band, order 15": (
        lambda cell, f: lscf(cell, f, (1 - HALF, 1 + HALF), 15),
        ("pyFRF", "sdypy.EMA"),
    ),
    "sdypy-EMA LSCF, wide, order 15": (lambda cell, f: lscf(cell, f, WIDE, 15), ("pyFRF", "sdypy.EMA")),
    "sdypy-EMA LSCF, wide, order 30": (lambda cell, f: lscf(cell, f, WIDE, 30), ("pyFRF", "sdypy.EMA")),
}


def available() -> dict[str, Peer]:
    """Those whose packages are installed."""
    found = {}
    for name, (peer, needed) in PEERS.items():
        with contextlib.suppress(ImportError):
            for module in needed:
                importlib.import_module(module)
            found[name] = peer
    return found
