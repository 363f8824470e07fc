"""Initial values of the fit: from the data sheet, and from a coarse search over frequencies."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ballscrew.axis.frequency import nut_share, predicted_frequency
from ballscrew.axis.model import moving_mass, rotor_mass, screw_part
from ballscrew.axis.sheet import DataSheet
from ballscrew.axis.tolerances import with_uncertainty
from ballscrew.base.arrays import Array
from ballscrew.modal.joint.blocks import (
    ROTOR_HELD,
    Block,
    Simulation,
    orthonormaliser,
    project,
    raw_columns,
    remaining_power,
    simulate,
)
from ballscrew.modal.joint.compiled import pitching_response
from ballscrew.modal.joint.mode import INITIAL_DAMPING, AxialMode, compliance_of
from ballscrew.modal.joint.signals import TripSignals
from ballscrew.modal.joint.windows import Windows

_SMOOTH = 0.01  # s, of speed and force for the inertia
_MOVING = 0.1  # of the highest speed
_PRELOADS = np.geomspace(1e-6, 1.0, 241)  # of the nominal one
_SHEET_ERROR = 2.0  # standard uncertainties by which the data sheet may predict too high a frequency

FREQUENCY_SCALES = np.exp(np.arange(-0.40, 0.401, 0.04))
"""Frequencies tried, over the initial one."""
_PITCH_RATIOS = (1.3, 1.45, 1.6, 1.75, 1.9, 2.05, 2.2, 2.35)  # pitching mode over the axial one
_PITCH_RATIO, _PITCH_DAMPING = 1.8, 0.03  # before it is estimated

_SIGNIFICANT = 0.6  # of what a plain gain leaves unexplained: the pitching mode must leave less
_MOST_PITCH_DAMPING = 0.1
_RANK = 1e-12  # of eigenvalues: smaller ones of the columns are rounding


@dataclass(frozen=True, slots=True)
class InitialValues:
    """Expected values before the data are fitted.

    Parameters
    ----------
    rotor_free, rotor_held : float
        Frequencies in the middle of the axis, rotor free and held, Hz.
    slope : float
        Of the compliance along the axis, relative, 1/m.
    load : float
        Load on the nut over its preload, per m/s² of the table; 0 without a data sheet.
    nut : float
        Compliance of the nut in the middle over that of all other parts, at a load of 1 per m/s².
    friction : float
        On the table, as an acceleration, m/s².
    lead : float
        Of the screw, m; 0 without a data sheet.
    curved : bool
        Whether the compliance may have a curvature, as for a screw with both ends fixed.
    """

    rotor_free: float
    rotor_held: float
    slope: float
    load: float = 0.0
    nut: float = 0.0
    friction: float = 0.0
    lead: float = 0.0
    curved: bool = False

    def mode(self, index: int) -> AxialMode:
        """The mode with the rotor free (0) or held (1)."""
        return AxialMode(
            compliance=compliance_of(self.rotor_held if index == ROTOR_HELD else self.rotor_free),
            slope=self.slope,
            curve=0.0,
            damping=INITIAL_DAMPING,
            load=self.load,
            nut=self.nut,
            friction=self.friction,
            pitch=_PITCH_RATIO * self.rotor_free,
            pitch_damping=_PITCH_DAMPING,
        )


def initial_values(sheet: DataSheet, load: float, low: float, high: float) -> InitialValues:
    """Predict the modes from a data sheet.

    Parameters
    ----------
    sheet : DataSheet
        Of the axis.
    load : float
        On the table, kg.
    low, high : float
        Range of the table's motion, m.

    Returns
    -------
    InitialValues
        All of them.
    """
    middle = (low + high) / 2
    at, first, last = (float(predicted_frequency(sheet, x, load)) for x in (middle, low, high))
    slope = ((at / last) ** 2 - (at / first) ** 2) / (high - low)
    mass = float(moving_mass(sheet, load)) + screw_part(sheet)
    rotor_held = at * math.sqrt(rotor_mass(sheet) / (rotor_mass(sheet) + mass))
    share = float(nut_share(sheet, middle))
    load_ratio = mass / sheet.nominal_preload
    nut = share / (1 - share) / load_ratio ** (1 / 3)
    friction = sheet.guide.friction / mass
    curved = sheet.support == "fixed-fixed"
    return InitialValues(at, rotor_held, slope, load_ratio, nut, friction, sheet.screw.lead, curved)


def least_nut_load(sheet: DataSheet, load: float, position: float, frequency: float) -> float:
    """Least load on the nut over its preload, per m/s² of the table, that a frequency allows.

    The fit may find no softening although the frequency is far below that of a sound nut. Then the data
    sheet, within its tolerances, still limits the remaining preload.

    Parameters
    ----------
    sheet : DataSheet
        Of the axis.
    load : float
        On the table, kg.
    position : float
        Of the table, m.
    frequency : float
        Estimated there, rotor free, Hz.

    Returns
    -------
    float
        As :attr:`InitialValues.load`.
    """
    expected = with_uncertainty(sheet, position, load)
    highest = frequency * (1 + _SHEET_ERROR * float(expected.standard_uncertainty / expected.value))
    preloads = _PRELOADS * sheet.nominal_preload
    curve = predicted_frequency(sheet, position, load, preloads)
    most = float(np.interp(highest, curve, preloads))
    return (float(moving_mass(sheet, load)) + screw_part(sheet)) / most


def total_inertia(trips: Sequence[TripSignals]) -> float | None:
    """Total inertia, in units of force per m/s², by least squares with friction; None if not determined."""
    sums, products = np.zeros((4, 4)), np.zeros(4)
    for trip in trips:
        width = max(3, round(_SMOOTH * trip.rate))
        taps = np.hanning(width + 2)[1:-1]
        taps /= taps.sum()
        speed = np.convolve(np.gradient(trip.position) * trip.rate, taps, "same")
        acceleration = np.gradient(speed) * trip.rate
        force = np.convolve(trip.force, taps, "same")
        moving = np.abs(speed) > _MOVING * np.abs(speed).max()
        moving[: 2 * width] = moving[-2 * width :] = False
        rows = np.stack([acceleration, np.sign(speed), speed, np.ones_like(speed)], axis=1)[moving]
        sums += rows.T @ rows
        products += rows.T @ force[moving]
    if not np.all(np.isfinite(sums)):
        return None
    # Trips in one direction do not separate Coulomb friction from an offset; the inertia is still determined.
    if np.linalg.matrix_rank(sums) - np.linalg.matrix_rank(sums[1:, 1:]) < 1:
        return None
    mass = float(np.linalg.lstsq(sums, products, rcond=None)[0][0])
    return mass if abs(mass) > 0 else None


def search_frequencies(
    blocks: Sequence[Block], modes: Sequence[AxialMode], pitching: tuple[float, float] | None
) -> tuple[AxialMode, ...]:
    """Search the frequency of every block's mode around an initial one.

    The data choose among many starts; the data sheet only centres them.

    Parameters
    ----------
    blocks : sequence of Block
        Data.
    modes : sequence of AxialMode
        Initial modes, one per block.
    pitching : tuple of float or None
        Frequency and damping ratio of the pitching mode; None to search it as well.

    Returns
    -------
    tuple of AxialMode
        The best, with one pitching mode for all.
    """
    base = 1 / (2 * math.pi * math.sqrt(modes[0].compliance))
    candidates = [(ratio * base, _PITCH_DAMPING) for ratio in _PITCH_RATIOS]
    if pitching is not None:
        candidates = [pitching]
    trials = [[replace(mode, compliance=mode.compliance / s**2) for s in FREQUENCY_SCALES] for mode in modes]
    simulations = []
    for b, of_block in zip(blocks, trials, strict=True):
        simulations.append([simulate(b, trial) for trial in of_block])
    best_cost, best = math.inf, tuple(modes)
    for pitch, damping in candidates:
        cost, chosen = 0.0, []
        for b, of_block, simulated in zip(blocks, trials, simulations, strict=True):
            pitched = [replace(trial, pitch=pitch, pitch_damping=damping) for trial in of_block]
            remaining = _relative_powers(b, pitched, simulated)
            cost += math.log(max(min(remaining), 1e-12))
            chosen.append(pitched[int(np.argmin(remaining))])
        if cost < best_cost:
            best_cost, best = cost, tuple(chosen)
    return best


def _relative_powers(b: Block, modes: Sequence[AxialMode], simulations: Sequence[Simulation]) -> list[float]:
    """Part of the power that each mode leaves, without free responses of the windows."""
    none: NDArray[np.float64] = np.zeros((len(b.windows.place), 2))
    raw = [raw_columns(b, mode, simulation) for mode, simulation in zip(modes, simulations, strict=True)]
    first = project(b, modes[0], none, raw[0])
    return [remaining_power(b, columns, first) / max(first.total, 1e-300) for columns in raw]


def find_pitching_mode(w: Windows, low: float, high: float) -> tuple[float, float] | None:
    """Estimate the mode in which the table pitches, from two accelerometers.

    Each accelerometer contains it in its own proportion. The transfer function from one to the other is a
    filter with its poles, whatever moves the table: no model of the axis is needed.

    Parameters
    ----------
    w : Windows
        Averaged windows.
    low, high : float
        Range to search, Hz.

    Returns
    -------
    frequency, damping : float
        Hz and ratio; None if there are no two accelerometers, or the mode is not significant.
    """
    if len(w.nut) < 2:
        return None
    from scipy.optimize import minimize

    high = min(high, 0.4 * w.rate)
    grid = [(f, z) for f in np.geomspace(low, high, 30) for z in (0.02, 0.06)]
    remaining = [_unexplained_by_pitching(w, f, z) for f, z in grid]

    def objective(logarithms: Array) -> float:
        return math.log(_unexplained_by_pitching(w, math.exp(logarithms[0]), math.exp(logarithms[1])))

    best = minimize(
        objective,
        np.log(grid[int(np.argmin(remaining))]),
        method="Nelder-Mead",
        options={"maxiter": 40, "xatol": 1e-3, "fatol": 1e-3},
    )
    f, z = math.exp(best.x[0]), math.exp(best.x[1])
    significant = math.exp(best.fun) < _SIGNIFICANT * max(remaining)
    if significant and low < f < high and z < _MOST_PITCH_DAMPING:
        return f, z
    return None


def _unexplained_by_pitching(w: Windows, frequency: float, damping: float) -> float:
    """Part of the second accelerometer's power that a pitching mode does not explain by the first."""
    first, second = w.nut[0], w.nut[1]
    filtered = np.empty(len(first))
    angular = 2 * math.pi * min(frequency, 0.45 * w.rate)
    pitching_response(first, w.first, angular, damping, 1 / w.rate, filtered)
    columns = np.stack([first, np.gradient(first), filtered, np.gradient(filtered)])[:, w.from_rest]
    target = second[w.from_rest]
    part = orthonormaliser(columns @ columns.T, _RANK).T @ (columns @ target)
    return max(1 - float(part @ part) / float(target @ target), 1e-12)
