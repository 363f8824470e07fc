"""The Cramér-Rao bound of a cell of a simulated axis, from what its instruments' noise leaves to be known."""

from __future__ import annotations

import numpy as np
import xarray as xr

from ballscrew.modal.output_error import cell_bound
from ballscrew.modal.output_error.plant import ModalPlant
from ballscrew.modal.spectra import averaged, frf
from ballscrew.testbed.trip import Rig

__all__ = ["cell_limit"]

MODELLED = (0.5, 2.6)  # of the frequency, as the joint estimator has it


def cell_limit(cell: xr.Dataset, rig: Rig, frequency: float) -> float:
    """Least standard deviation that an unbiased estimate from this cell alone can have.

    Parameters
    ----------
    cell : Dataset
        The cell's complete rows of the table *Transients*.
    rig : Rig
        The machine: its damping, its pitching mode and its instruments are taken from here.
    frequency : float
        The true one, Hz.

    Returns
    -------
    float
        Hz. Gains are fitted to the cell's own FRF. White noise of the accelerometers and of the torque; what
        each record starts with, a drift and the delay are unknown. The accelerometers' information adds up.
    """
    instruments, rate = rig.instruments, float(cell.attrs["sample_rate"])
    size = int(cell["length"].min())
    force = cell["input"].values[:, :size].astype(np.float64)
    response = cell["acceleration"].values[:, :, :size].astype(np.float64)
    band = (MODELLED[0] * frequency, MODELLED[1] * frequency)
    hann = np.hanning(size)
    u, y = ((x - x.mean(axis=-1, keepdims=True)) * hann for x in (force, response))
    spectra = averaged(u, y, rate, band, 1.0)
    modes = (frequency, instruments.pitch_frequency)
    damping = (rig.machine.damping_ratio, instruments.pitch_damping)
    bare = ModalPlant(modes, damping, (0.0, 0.0))
    columns = np.stack([np.ones_like(spectra.frequency), *bare.parts(2 * np.pi * spectra.frequency)])
    weight = np.sqrt(spectra.uu)
    information = 0.0
    for h in frf(spectra):
        a, b = (columns * weight).T, h * weight
        gains, *_ = np.linalg.lstsq(
            np.concatenate([a.real, a.imag]), np.concatenate([b.real, b.imag]), rcond=None
        )
        plant = ModalPlant(modes, damping, (float(gains[1]), float(gains[2])), float(gains[0]))
        bound = cell_bound(
            plant,
            force,
            rate,
            instruments.acceleration_noise,
            band=band,
            force_noise=instruments.torque_noise,
        )
        information += bound.frequency[0] ** -2
    return float(information**-0.5)
