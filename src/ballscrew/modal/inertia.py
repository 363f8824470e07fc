"""The equivalent mass, read off the FRF far below its first mode, where the axis moves as one mass."""

from __future__ import annotations

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy import fft

from ballscrew.base.quantity import Quantity

__all__ = ["frf_equivalent_mass"]

_TOP = 30.0  # Hz
_PART_OF_MODE = 0.12  # of the mode's frequency: above it the resonance lifts the FRF by more than 2 %
_AROUND = 0.05  # s at each side of a phase; or half the phase, where that is longer
_STEP = 0.5  # Hz


def frf_equivalent_mass(transients: xr.Dataset, scale: float, mode: float | None) -> Quantity | None:
    """Equivalent mass from force and acceleration of all transients below 30 Hz.

    Phase and surroundings under one Hann window, means taken out: friction of one direction goes with the
    mean, the viscous part is in quadrature. Pooled over all conditions, since friction's remainder has the
    opposite sign in the two directions.

    Parameters
    ----------
    transients : Dataset
        The table *Transients*; only complete rows count.
    scale : float
        Takes the input to N: 1 for a force, 1/beta (rad/m) for a torque.
    mode : float or None
        Expected frequency of the first mode, Hz.

    Returns
    -------
    Quantity or None
        kg, its uncertainty from leaving out one stop's transients at a time; None where there are none.
    """
    kept = transients.isel(transient=transients["complete"].values)
    rate = float(transients.attrs["sample_rate"])
    top = _TOP if mode is None else min(_TOP, _PART_OF_MODE * mode)
    groups = [
        _products(kept.isel(transient=rows), rate, top, scale)
        for rows in _by_stop(kept["position_m"].values, kept["condition"].values)
    ]
    if not groups:
        return None
    products, squares = (np.array(part) for part in zip(*groups, strict=True))
    if np.any(squares.sum(axis=0) <= 0):
        return None
    value = _mass(products, squares)
    count = len(groups)
    if count < 2:
        return None
    left_out = [_mass(np.delete(products, i, 0), np.delete(squares, i, 0)) for i in range(count)]
    spread = float(np.sqrt((count - 1) * np.var(left_out)))
    return Quantity(value, spread, "kg")


def _by_stop(position: NDArray[np.float64], condition: NDArray[np.str_]) -> list[NDArray[np.intp]]:
    keys = [(p, c) for p, c in zip(position.tolist(), condition.tolist(), strict=True)]
    return [np.flatnonzero([k == key for k in keys]) for key in dict.fromkeys(keys)]


def _mass(products: NDArray[np.float64], squares: NDArray[np.float64]) -> float:
    """Mean over the responses; a sensor's polarity does not matter."""
    return float(np.mean(np.abs(products.sum(axis=0) / squares.sum(axis=0))))


def _products(
    cell: xr.Dataset, rate: float, top: float, scale: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Sums over lines and transients of Re(A* F) and |A|², shape (responses,) each."""
    onset, end, length = (np.rint(cell[name].values).astype(int) for name in ("onset", "end", "length"))
    around = max(_AROUND * rate, float(np.median(end - onset)) / 2)
    first = np.maximum(onset - round(around), 0)
    last = np.minimum(end + round(around), length)
    size = int((last - first).max())
    index = np.arange(size)[None] + first[:, None]
    inside = index < last[:, None]
    index = np.minimum(index, last[:, None] - 1)
    count = (last - first)[:, None]
    hann = np.where(inside, 0.5 - 0.5 * np.cos(2 * np.pi * np.arange(size) / count), 0.0)
    padded = fft.next_fast_len(max(size, int(rate / _STEP)), real=True)
    lines = slice(1, 1 + int(top * padded / rate))

    def spectrum(values: NDArray[np.float64]) -> NDArray[np.complex128]:
        mean = np.where(inside, values, 0.0).sum(axis=-1, keepdims=True) / count
        return np.asarray(fft.rfft((values - mean) * hann, padded)[..., lines], dtype=np.complex128)

    force = scale * spectrum(np.take_along_axis(cell["input"].values.astype(np.float64), index, axis=1))
    acceleration = spectrum(
        np.take_along_axis(cell["acceleration"].values.astype(np.float64), index[None], axis=2)
    )
    products = (acceleration.conj() * force[None]).real.sum(axis=(1, 2))
    return products, (np.abs(acceleration) ** 2).sum(axis=(1, 2))
