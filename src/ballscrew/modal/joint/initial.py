"""Initial values of the fit: from the data sheet, and from a coarse search over frequencies."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import trapezoid

from ballscrew.axis.frequency import Rotor, nut_share, predicted_frequency, predicted_modes
from ballscrew.axis.model import guide_friction, moving_mass, rotor_mass, screw_part, weight_on_nut
from ballscrew.axis.rod import rod_modes
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
from ballscrew.modal.joint.columns import BELOW_NYQUIST, differences, pitching_response
from ballscrew.modal.joint.mode import (
    FORM_MEAN,
    GUIDE_PART_MEAN,
    INITIAL_DAMPING,
    TYPICAL_SCREW_SHIFT,
    AxialMode,
    compliance_of,
)
from ballscrew.modal.joint.signals import TripSignals
from ballscrew.modal.joint.windows import Windows

_SMOOTHING_TIME = 0.01  # s, length of the window that smooths speed and force before the inertia is fitted
_MOVING = 0.1  # over the highest speed: slower samples do not enter the fit of the inertia

_PRELOAD_RATIOS = np.geomspace(1e-3, 2.0, 153)  # preloads tried, over the nominal preload
# Mean and standard deviation of ln(preload over nominal preload).
_SOUND_NUT = (0.0, 0.35)
_WORN_NUT = (-1.5, 1.5)  # it may have lost anything from nothing to 99 % of its preload
_FREEDOM = 10.0  # degrees of freedom of Student's distribution of a predicted frequency's error

FREQUENCY_SCALES = np.exp(np.arange(-0.40, 0.401, 0.04))
"""Frequencies tried, over the initial one."""
_PITCH_RATIOS = (1.3, 1.45, 1.6, 1.75, 1.9, 2.05, 2.2, 2.35)
"""Frequencies of the pitching mode tried, over the axial one."""

# Assumed before the pitching mode is estimated.
_PITCH_RATIO = 1.8  # frequency of the pitching mode over the axial one
_PITCH_DAMPING = 0.03  # damping ratio

# Frequencies and damping ratios of the pitching mode tried with two accelerometers.
_PITCH_FREQUENCIES = 30  # number of frequencies, from the lowest to the highest
_PITCH_DAMPINGS = (0.02, 0.06)
_HIGHEST_PITCH = 0.4  # highest of these frequencies, over the sampling rate: below half of it

# Largest power that a significant pitching mode leaves unexplained, over that left by the worst frequency
# tried, which explains hardly more than a constant ratio of the two accelerometers.
_SIGNIFICANT = 0.6
_MOST_PITCH_DAMPING = 0.1  # largest damping ratio of a pitching mode: more is not a resonance
_RANK_TOLERANCE = 1e-12  # over the largest eigenvalue of AᵀA of the columns A: smaller are rounding errors

# Share of the second mode over that of the axial mode; on 30 random axes, held at one end or both, it is 0.04
# at most.
_SIMILAR_SHARE = 0.5
_ELEMENTS = 40  # of a rod: on ten random axes its frequencies are those of 400 to 1e-7
_FORM_POSITIONS = 7  # number of positions of the table at which the curve is computed
# Curve without a data sheet, times the square of half the travel. The best line through this parabola is off
# at the ends by two thirds of the curve, 0.4 % of the compliance or 0.2 % of the frequency, as on random axes
# between a 16 x 5 and a 40 x 20 mm screw (0.1 to 0.4 %).
_TYPICAL_FORM = 6e-3


@dataclass(frozen=True, slots=True)
class InitialValues:
    """Values with which the search and the fit begin.

    Parameters
    ----------
    rotor_free, rotor_held : float
        Frequencies in the middle of the axis with the rotor free and with the rotor held, Hz.
    slope : float
        Relative slope of the compliance along the axis, 1/m.
    mass_over_preload, nut_over_rest, friction, weight, viscous : float
        Fields of :class:`~ballscrew.modal.joint.mode.AxialMode`; 0 without a data sheet.
    lead : float
        Travel per turn of the motor, m; 0 without a data sheet.
    curved : bool
        Whether the compliance is a parabola along the axis, as for a screw with both ends fixed, and not
        nearly a line.
    form_curves : tuple of float
        Field ``form_curve`` of AxialMode with the rotor free and with the rotor held, 1/m²; 0 if the
        compliance is a parabola.
    rotor_correction, screw_shift : float
        Fields of AxialMode.
    sheet : DataSheet or None
        Data sheet of the axis, if there is one.
    load : float
        Load on the table, kg.
    """

    rotor_free: float
    rotor_held: float
    slope: float
    mass_over_preload: float = 0.0
    nut_over_rest: float = 0.0
    friction: float = 0.0
    weight: float = 0.0
    viscous: float = 0.0
    lead: float = 0.0
    curved: bool = False
    form_curves: tuple[float, float] = (0.0, 0.0)
    rotor_correction: float = 1.0
    screw_shift: float = TYPICAL_SCREW_SHIFT
    sheet: DataSheet | None = None
    load: float = 0.0

    def mode(self, index: int) -> AxialMode:
        """Initial mode by its index, ROTOR_FREE (0) or ROTOR_HELD (1)."""
        frequency = self.rotor_free
        if index == ROTOR_HELD:
            frequency = self.rotor_held
        return AxialMode(
            compliance=compliance_of(frequency),
            slope=self.slope,
            curve=0.0,
            damping=INITIAL_DAMPING,
            mass_over_preload=self.mass_over_preload,
            nut_over_rest=self.nut_over_rest,
            friction=self.friction,
            weight=self.weight,
            viscous=self.viscous,
            guide_part=GUIDE_PART_MEAN,
            pitch=_PITCH_RATIO * self.rotor_free,
            pitch_damping=_PITCH_DAMPING,
            form=FORM_MEAN,
            form_curve=self.form_curves[index],
            rotor_correction=self.rotor_correction,
            screw_shift=self.screw_shift,
        )


def initial_values(
    sheet: DataSheet, load: float, low: float, high: float, viscous: float = 0.0
) -> InitialValues:
    """Predict the modes from a data sheet.

    Parameters
    ----------
    sheet : DataSheet
        Data sheet of the axis.
    load : float
        Load on the table, kg.
    low, high : float
        Limits of the table's motion, m.
    viscous : float
        Viscous friction of the axis over its total inertia, 1/s.

    Returns
    -------
    InitialValues
        Prediction for a nut with its nominal preload.
    """
    middle = (low + high) / 2
    rotor_free, at_low, at_high = predicted_frequency(sheet, [middle, low, high], load).tolist()
    # The compliance is proportional to 1/f².
    relative_low, relative_high = (rotor_free / at_low) ** 2, (rotor_free / at_high) ** 2
    slope = (relative_high - relative_low) / (high - low)
    mass = float(moving_mass(sheet, load)) + screw_part(sheet)
    share = float(nut_share(sheet, middle))  # of the nut in the compliance
    mass_over_preload = mass / sheet.nominal_preload
    curved = sheet.support == "fixed-fixed"
    form_curves = (0.0, 0.0)
    if not curved:
        form_curves = _form_curve(sheet, load, low, high, "free"), _form_curve(sheet, load, low, high, "held")
    return InitialValues(
        rotor_free=rotor_free,
        rotor_held=rotor_free * math.sqrt(rotor_mass(sheet) / (rotor_mass(sheet) + mass)),
        slope=slope,
        mass_over_preload=mass_over_preload,
        nut_over_rest=share / (1 - share) / mass_over_preload ** (1 / 3),
        friction=float(guide_friction(sheet, load)) / mass,
        weight=float(weight_on_nut(sheet, load)) / mass,
        viscous=max(viscous, 0.0) * (rotor_mass(sheet) + mass) / mass,
        lead=sheet.screw.lead / sheet.drive.ratio,
        curved=curved,
        form_curves=form_curves,
        rotor_correction=_rotor_correction(sheet, load, middle),
        screw_shift=_screw_shift(sheet, load, middle),
        sheet=sheet,
        load=load,
    )


def _rotor_correction(sheet: DataSheet, load: float, position: float) -> float:
    """Field ``rotor_correction`` of AxialMode by a data sheet, at a position (m).

    It is 1 where two modes have similar shares of the table's motion: either may be called the axial one.
    """
    rotor_free = predicted_modes(sheet, position, load, rotor="free")
    rotor_held = predicted_modes(sheet, position, load, rotor="held")
    if max(float(m.second_share / m.share) for m in (rotor_free, rotor_held)) > _SIMILAR_SHARE:
        return 1.0
    shares = rotor_free.share / rotor_held.share
    return float(shares * (rotor_free.frequency / rotor_held.frequency) ** 2)


def _screw_shift(sheet: DataSheet, load: float, position: float) -> float:
    """Field ``screw_shift`` of AxialMode by a data sheet, at a position (m).

    It is that without a data sheet where two modes have similar shares of the table's motion.
    """
    modes = rod_modes(sheet, position, load, rotor="held", elements=_ELEMENTS)
    *_, second, first = np.sort(modes.table_share)
    if second > _SIMILAR_SHARE * first:
        return TYPICAL_SCREW_SHIFT
    motion = modes.axial[modes.first_axial] / modes.table[modes.first_axial]  # of the screw over the table's
    # The thread fills half of the space around the root.
    thread = ((sheet.screw.nominal_diameter / sheet.screw.root_diameter) ** 2 - 1) / 2
    mass_ratio = 3 * screw_part(sheet) * (1 + thread) / float(moving_mass(sheet, load))
    return mass_ratio * float(trapezoid(motion - motion**2 / 2, modes.nodes) / np.ptp(modes.nodes))


def _form_curve(sheet: DataSheet, load: float, low: float, high: float, rotor: Rotor) -> float:
    """Field ``form_curve`` of AxialMode (1/m²) by a data sheet, for the limits of the table's motion (m)."""
    positions = np.linspace(low, high, _FORM_POSITIONS)
    compliance = 1 / predicted_frequency(sheet, positions, load, rotor=rotor) ** 2  # times a constant
    curve, _, middle = np.polyfit(positions - (low + high) / 2, compliance, 2)
    return float(curve / middle)


def typical_form_curve(low: float, high: float) -> float:
    """Field ``form_curve`` of AxialMode (1/m²) without a data sheet, for the limits of the motion (m)."""
    return _TYPICAL_FORM / ((high - low) / 2) ** 2


def expected_mass_over_preload(
    sheet: DataSheet, load: float, position: float, frequency: float
) -> tuple[float, float, float]:
    """Moving mass over preload expected from the data sheet and an estimated frequency.

    A priori the nut is with equal probability sound, with about its nominal preload, or worn. The likelihood
    of a preload is Student's distribution of ln(estimated over predicted frequency), in units of the relative
    uncertainty by the data sheet: data sheets may be wrong by more than their tolerances.

    Parameters
    ----------
    sheet : DataSheet
        Data sheet of the axis.
    load : float
        Load on the table, kg.
    position : float
        Axis position, m.
    frequency : float
        Frequency that was estimated at this position, rotor free, Hz.

    Returns
    -------
    value : float
        Geometric mean, kg/N.
    deviation : float
        Standard deviation of its logarithm.
    least : float
        Lower limit, kg/N; the true value is below it with a probability of 2.5 %.
    """
    expected = with_uncertainty(sheet, position, load)
    tolerance = float(expected.standard_uncertainty / expected.value)
    predicted = predicted_frequency(sheet, position, load, _PRELOAD_RATIOS * sheet.nominal_preload)
    squares = (np.log(frequency / predicted) / tolerance) ** 2
    logarithms = np.log(_PRELOAD_RATIOS)
    prior = np.zeros_like(logarithms)
    for centre, spread in (_SOUND_NUT, _WORN_NUT):
        prior += np.exp(-(((logarithms - centre) / spread) ** 2) / 2) / spread
    # Posterior probabilities, times a constant.
    weights = prior * (1 + squares / _FREEDOM) ** (-(_FREEDOM + 1) / 2)
    mean = float(np.average(logarithms, weights=weights))
    deviation = math.sqrt(np.average((logarithms - mean) ** 2, weights=weights))
    mass = float(moving_mass(sheet, load)) + screw_part(sheet)
    highest = float(np.interp(0.975, np.cumsum(weights) / np.sum(weights), logarithms))
    nominal = mass / sheet.nominal_preload
    return nominal * math.exp(-mean), deviation, nominal * math.exp(-highest)


def inertia_and_viscous_friction(trips: Sequence[TripSignals]) -> tuple[float, float] | None:
    """Total inertia and viscous friction of the axis; None if the trips do not determine the inertia.

    The inertia is in units of the recorded force per m/s², the viscous friction over the inertia in 1/s. The
    force on the moving axis is the sum of that of inertia, Coulomb friction, viscous friction and a
    constant. The four coefficients are fitted by least squares over all trips.
    """
    normal_matrix, products = np.zeros((4, 4)), np.zeros(4)
    for trip in trips:
        width = max(3, round(_SMOOTHING_TIME * trip.rate))
        taps = np.hanning(width + 2)[1:-1]
        taps /= taps.sum()
        speed = np.convolve(np.gradient(trip.position) * trip.rate, taps, "same")
        acceleration = np.gradient(speed) * trip.rate
        force = np.convolve(trip.force, taps, "same")
        moving = np.abs(speed) > _MOVING * np.abs(speed).max()
        # At both ends the smoothing lacks samples.
        moving[: 2 * width] = False
        moving[-2 * width :] = False
        rows = np.stack([acceleration, np.sign(speed), speed, np.ones_like(speed)], axis=1)[moving]
        normal_matrix += rows.T @ rows
        products += rows.T @ force[moving]
    if not np.all(np.isfinite(normal_matrix)):
        return None
    # Trips in one direction do not separate Coulomb friction from a constant. The inertia is still determined
    # if the acceleration is linearly independent of the other columns.
    rank, rank_of_others = np.linalg.matrix_rank(normal_matrix), np.linalg.matrix_rank(normal_matrix[1:, 1:])
    if rank - rank_of_others < 1:
        return None
    inertia, _, viscous, _ = np.linalg.lstsq(normal_matrix, products, rcond=None)[0].tolist()
    if not abs(inertia) > 0:
        return None
    return inertia, viscous / inertia


def search_frequencies(
    blocks: Sequence[Block], modes: Sequence[AxialMode], pitching: tuple[float, float] | None
) -> tuple[AxialMode, ...]:
    """Search for the frequency of every block's mode that leaves the least power unexplained.

    The frequencies tried are :data:`FREQUENCY_SCALES` times the initial one.

    Parameters
    ----------
    blocks : sequence of Block
        Drives and responses.
    modes : sequence of AxialMode
        Initial modes, one per block.
    pitching : tuple of float or None
        Frequency (Hz) and damping ratio of the pitching mode; None to search for it as well.

    Returns
    -------
    tuple of AxialMode
        One per block, all with the same pitching mode.
    """
    axial = 1 / (2 * math.pi * math.sqrt(modes[0].compliance))  # Hz
    candidates = [(ratio * axial, _PITCH_DAMPING) for ratio in _PITCH_RATIOS]  # of the pitching mode
    if pitching is not None:
        candidates = [pitching]
    trials, simulations = [], []  # for each block, one of every frequency
    for b, mode in zip(blocks, modes, strict=True):
        block_trials = [replace(mode, compliance=mode.compliance / s**2) for s in FREQUENCY_SCALES]
        trials.append(block_trials)
        simulations.append([simulate(b, trial) for trial in block_trials])
    best_cost, best = math.inf, tuple(modes)
    for pitch, damping in candidates:
        cost, chosen = 0.0, []  # cost: sum of the logarithms of the least powers
        for b, block_trials, block_simulations in zip(blocks, trials, simulations, strict=True):
            pitched = [replace(trial, pitch=pitch, pitch_damping=damping) for trial in block_trials]
            remaining = _relative_powers(b, pitched, block_simulations)
            cost += math.log(max(min(remaining), 1e-12))  # a power may be 0
            chosen.append(pitched[int(np.argmin(remaining))])
        if cost < best_cost:
            best_cost, best = cost, tuple(chosen)
    return best


def _relative_powers(b: Block, modes: Sequence[AxialMode], simulations: Sequence[Simulation]) -> list[float]:
    """Part of the power of a block that each mode leaves unexplained, if every window begins at rest."""
    no_free_vibration: NDArray[np.float64] = np.zeros((len(b.windows.centred_position), 2))
    raw = [raw_columns(b, mode, simulation) for mode, simulation in zip(modes, simulations, strict=True)]
    reference = project(b, modes[0], no_free_vibration, raw[0])
    return [remaining_power(b, columns, reference) / max(reference.total, 1e-300) for columns in raw]


def find_pitching_mode(w: Windows, low: float, high: float) -> tuple[float, float] | None:
    """Estimate the mode in which the table pitches, from two accelerometers.

    Two accelerometers at different heights measure the same axial motion and different amounts of pitching.
    Whatever moves the table, the second signal is therefore a weighted sum of the first and of the first
    filtered by a resonance: that of the pitching mode, if the first signal contains little pitching. No model
    of the axis is needed. Frequencies near the result are tried in the fit.

    Parameters
    ----------
    w : Windows
        Averaged windows.
    low, high : float
        Limits of the frequencies tried, Hz.

    Returns
    -------
    tuple of float or None
        Frequency (Hz) and damping ratio; None without a second accelerometer, or if the mode is not
        significant.
    """
    if len(w.nut) < 2:
        return None
    from scipy.optimize import minimize

    high = min(high, _HIGHEST_PITCH * w.rate)
    frequencies = np.geomspace(low, high, _PITCH_FREQUENCIES)
    grid = [(f, z) for f in frequencies for z in _PITCH_DAMPINGS]
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
    """Part of the second accelerometer's power that the first and its filtered signal do not explain.

    The derivatives of both account for a delay between the accelerometers. ``frequency`` (Hz) and ``damping``
    ratio are those of the pitching mode, which filters the first signal.
    """
    first, second = w.nut[0], w.nut[1]
    filtered = np.empty(len(first))
    angular = 2 * math.pi * min(frequency, BELOW_NYQUIST * w.rate)
    pitching_response(first, w.starts, angular, damping, 1 / w.rate, filtered)
    derivatives = [differences(values, w.starts) for values in (first, filtered)]
    columns = np.stack([first, filtered, *derivatives])[:, w.from_rest]
    target = second[w.from_rest]
    explained = orthonormaliser(columns @ columns.T, _RANK_TOLERANCE).T @ (columns @ target)
    return max(1 - float(explained @ explained) / float(target @ target), 1e-12)
