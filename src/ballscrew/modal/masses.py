"""Masses and friction of a run, twice: from the rigid-body fit, and from the FRF far below its first mode."""

from __future__ import annotations

import math

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy import fft

from ballscrew.axis.frequency import predicted_frequency
from ballscrew.axis.model import rotor_mass
from ballscrew.axis.sheet import DataSheet
from ballscrew.base.arrays import Array
from ballscrew.base.quantity import Quantity
from ballscrew.base.tables import group_rows
from ballscrew.modal.run import RigidBodyResult
from ballscrew.recording.drive_input import force_scale
from ballscrew.recording.measure import Measurement

_ROTOR_TOLERANCE = 0.02  # of the rotor's inertia: tolerance of makers' data sheets
_HIGHEST_LINE = 30.0  # Hz
_PART_OF_MODE = 0.12  # of the mode's frequency: above it the resonance lifts the FRF by more than 2 %
_MARGIN = 0.05  # s at each side of a phase; or half the phase, if that is longer
_LINE_SPACING = 0.5  # Hz


def rigid_body_result(measurement: Measurement, sheet: DataSheet | None, mass: float) -> RigidBodyResult:
    """Masses and friction of a run.

    Parameters
    ----------
    measurement : Measurement
        The run.
    sheet : DataSheet or None
        The axis; gives the rotor's part of the mass.
    mass : float
        Load on the table, kg.

    Returns
    -------
    RigidBodyResult
        Values that cannot be known are None, with the reason.
    """
    fit, transients = measurement.rigid_body, measurement.transients
    if fit is None or transients is None:
        return RigidBodyResult(reasons=measurement.reasons)
    reasons = []
    fitted = ("equivalent_mass_kg", "viscous_N_s_per_m", "coulomb_N", "offset_N")
    uncertainty = dict(zip(fitted, fit.uncertainty, strict=True))
    repeatability = dict(zip(fitted, fit.repeatability or (), strict=False))
    mode = moving = None
    if sheet is None:
        reasons.append("the moving mass requires a data sheet (--axis), which gives the rotor's inertia")
    else:
        mode = float(predicted_frequency(sheet, sheet.travel_limit / 2, mass))
        moving = fit.equivalent_mass - rotor_mass(sheet)
        uncertainty["moving_mass_kg"] = math.hypot(fit.uncertainty[0], _ROTOR_TOLERANCE * rotor_mass(sheet))
    scale = force_scale(str(transients["input"].attrs["quantity"]), sheet)
    from_frf = None
    if scale is not None:
        from_frf = frf_equivalent_mass(transients, scale, mode)
    if from_frf is None:
        reasons.append("too few transients for the equivalent mass from the FRF")
    else:
        uncertainty["frf_equivalent_mass_kg"] = from_frf.standard_uncertainty
    return RigidBodyResult(
        equivalent_mass_kg=fit.equivalent_mass,
        moving_mass_kg=moving,
        viscous_N_s_per_m=fit.viscous,
        coulomb_N=fit.coulomb,
        offset_N=fit.offset,
        frf_equivalent_mass_kg=from_frf.value if from_frf else None,
        standard_uncertainty=uncertainty,
        repeatability=repeatability,
        reasons=tuple(reasons),
    )


def frf_equivalent_mass(transients: xr.Dataset, scale: float, mode: float | None) -> Quantity | None:
    """Equivalent mass from force and acceleration of all transients below 30 Hz.

    Phase and surroundings under one Hann window, without their means: friction of one direction vanishes with
    the mean, the viscous part is in quadrature. Pooled over all conditions, since the remainder of friction
    has the opposite sign in the two directions.

    Parameters
    ----------
    transients : Dataset
        The table *Transients*; only complete rows count.
    scale : float
        Newtons per unit of the input: 1 for a force, 1/beta (rad/m) for a torque.
    mode : float or None
        Expected frequency of the first mode, Hz.

    Returns
    -------
    Quantity or None
        kg, with its uncertainty from leaving out the transients of one stop at a time; None if there are
        fewer than two stops.
    """
    complete = transients.isel(transient=transients["complete"].values)
    rate = float(transients.attrs["sample_rate"])
    top = _HIGHEST_LINE if mode is None else min(_HIGHEST_LINE, _PART_OF_MODE * mode)
    groups = group_rows(complete, "position_m", "condition").values()
    # Without the coordinates, which take most of the time of a selection.
    signals = complete[["onset", "end", "length", "input", "acceleration"]].reset_coords(drop=True)
    sums = [_products(signals.isel(transient=rows), rate, top, scale) for rows in groups]
    count = len(sums)
    if count < 2:
        return None
    products, squares = (np.array(part) for part in zip(*sums, strict=True))
    if np.any(squares.sum(axis=0) <= 0):
        return None
    without = [_mass(np.delete(products, i, 0), np.delete(squares, i, 0)) for i in range(count)]
    jackknife = float(np.sqrt((count - 1) * np.var(without)))
    return Quantity(_mass(products, squares), jackknife, "kg")


def _mass(products: Array, squares: Array) -> float:
    """Mean over the responses; a sensor's polarity does not matter."""
    return float(np.mean(np.abs(products.sum(axis=0) / squares.sum(axis=0))))


def _products(cell: xr.Dataset, rate: float, top: float, scale: float) -> tuple[Array, Array]:
    """Sums over lines and transients of Re(A* F) and |A|², shape (responses,) each."""
    onset, end, length = (np.rint(cell[name].values).astype(int) for name in ("onset", "end", "length"))
    margin = max(_MARGIN * rate, float(np.median(end - onset)) / 2)
    first = np.maximum(onset - round(margin), 0)
    last = np.minimum(end + round(margin), length)
    size = int((last - first).max())
    index = np.arange(size)[None] + first[:, None]
    inside = index < last[:, None]
    index = np.minimum(index, last[:, None] - 1)
    count = (last - first)[:, None]
    hann = np.where(inside, 0.5 - 0.5 * np.cos(2 * np.pi * np.arange(size) / count), 0.0)
    padded = fft.next_fast_len(max(size, int(rate / _LINE_SPACING)), real=True)
    lines = slice(1, 1 + int(top * padded / rate))

    def spectrum(values: Array) -> NDArray[np.complex128]:
        mean = np.where(inside, values, 0.0).sum(axis=-1, keepdims=True) / count
        return np.asarray(fft.rfft((values - mean) * hann, padded)[..., lines], dtype=np.complex128)

    force = scale * spectrum(np.take_along_axis(cell["input"].values.astype(np.float64), index, axis=1))
    acceleration = spectrum(
        np.take_along_axis(cell["acceleration"].values.astype(np.float64), index[None], axis=2)
    )
    products = (acceleration.conj() * force[None]).real.sum(axis=(1, 2))
    return products, (np.abs(acceleration) ** 2).sum(axis=(1, 2))
