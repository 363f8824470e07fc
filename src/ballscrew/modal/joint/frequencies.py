"""Frequencies of all cells by the final fit, rotor free and held, with the terms of their uncertainty."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ballscrew.base.arrays import Array
from ballscrew.modal.joint.blocks import ROTOR_FREE, ROTOR_HELD, Projection, make_block, project
from ballscrew.modal.joint.columns import MOTOR_MODE_COLUMNS
from ballscrew.modal.joint.fit import SAMPLES_PER_INDEPENDENT, JointFit
from ballscrew.modal.joint.frame import FrameSearch, is_far_above
from ballscrew.modal.joint.local_wear import local_residue, shrinkage_covariance
from ballscrew.modal.joint.mode import FORM_DEVIATION, AxialMode, mode_frequency
from ballscrew.modal.joint.parameters import limits_of
from ballscrew.modal.joint.profile import EXPONENT_DEVIATION, EXPONENT_MEAN
from ballscrew.modal.joint.search import SearchResult
from ballscrew.modal.joint.settings import JointSettings
from ballscrew.modal.joint.uncertainty import (
    TiedCurves,
    nut_loads,
    sheet_weight,
    tie_slopes,
    variance_inflation,
)

_SHORTEST = 0.05  # m, least length of the axis that is assumed where the slopes of the two modes are tied

# Sizes of the terms of the uncertainty, without unit. They were set with 174 runs on 29 random axes of the
# testbed: docs/explanation/identification.md, "The uncertainty". A relative error is that of the frequency.

# Term "residual", of an unmeasured force that excites the mode: error over the half-width of the resonance
# (damping ratio times frequency), per unexplained part of the power of the response.
_FORCE_ERROR = 0.5
# Part of the power unexplained by the motor's motion that is due to such a force; the rest is encoder noise.
_FORCE_OF_MOTION = 0.6

# Term "local": error of the compliance between two stops, over the deviation of a stop from its neighbours.
_INTERPOLATION = 0.06
# Term "noise": factor of the uncertainty by the scatter of cells, since about half of this variance is also
# in the scatter of conditions.
_SCATTER_FACTOR = math.sqrt(0.5)

# Term "load": relative errors for a nut that is all of the compliance, at a load F on the nut that is equal
# to its preload P. In proportion to the nut's share of the compliance. The 174 runs gave them for loads that
# contained the torque that overcomes friction; without it loads are 1.2 times lower.
_WEAR_ERROR = 0.012  # by even wear that the run does not show: times (F/P)² and the result of `sheet_weight`
_LAW_ERROR = 6e-4  # by the law of the softening: times F/P below 1 and (F/P)² above

# Relative standard uncertainty of the rotor-held frequency as the zero of the motor's response to the torque,
# by modes above the band, beside the shift by their column: on the bench it is 0.4 % off.
_ZERO_ERROR = 0.003

# Term "ripple", of a force between whole orders of a turn, as of a belt, that is fitted as whole orders:
# relative error if it caused the whole power of the response, in proportion to its amplitude.
_FRACTIONAL = 0.025
# Part of the power of the response by an unmeasured force up to which the term is omitted.
_LEAST_UNMEASURED = 1e-4

# Term "damping", of dampers that lie in the joints alone: the modulus of the pole, which the fit estimates,
# then exceeds the undamped frequency. Relative error over the square of the damping ratio in the middle: 0 to
# 2.1 in 14 runs of 8 finite-element machines, rms 1.3; 2 (1 - s)/s for joints with a part s of the
# compliance.
_JOINT_DAMPERS = 1.5
# The part of the damping that lies in the joints is about half of the exponent of the damping ratio along the
# axis: this is 2 or more for joints (2.5 to 4 on these machines), 0 to 1 if all parts are damped alike (0.96
# to 1.14 on ten random axes). Mean and standard deviation where the run does not show it:
_EXPONENT = (1.0, 0.9)

# Term "frame": relative error if a mode of the frame is fitted. On three random axes with little noise it is
# 0.15 % at most in 30 runs, with frames of 4 to 20 times the moving mass at 0.7 to 1.2 of the mode. With a
# table that pitches at 0.75 to 1.35 of the mode it is 0.3 % at most in 16 runs of eight such axes with a
# coupling up to 0.2, and 0.7 % with one of 0.23.
_FRAME_ERROR = 1e-3
_PITCHING_ERROR = 2e-3
# The same with a frame far above the mode. With frames at 1.6 and 1.8 of the mode of nine random axes the
# error is up to 0.8 %, in runs with a standard uncertainty of 0.3 % without this term.
_HIGH_FRAME_ERROR = 3e-3
# Coupling (moving mass over the frame's) from which on the term grows with its square. On distributed screws
# with a frame of 4 times the moving mass at 0.75 of the mode the error is up to 1.5 %.
_FRAME_COUPLING = 1 / 8

# Amplitude of the torque's rounding error in the band, over that by TripSignals.rounding: 0.65 to 0.8 for
# steps of 0.02 to 0.1 N m on the bench.
_ROUNDING = 0.8
# Term "steps", of the rounding, from 16 runs of the bench with steps of 0.02, 0.05 and 0.1 N m that begin at
# different torques. The fitted damping grows with the rounding, by a different amount at each stop.
# Rms of the mean relative error, over the product of `_rounding_amplitude` and damping ratio; 0.2 in 8 runs
# of an axis of the testbed.
_ROUNDING_MEAN = 1.4
# Rms of the difference of the relative errors in the middle and at an end of the axis, over
# `_rounding_amplitude`; 0.022 in these 8 runs.
_ROUNDING_TILT = 0.095
_LEAST_ROUNDING = 5e-5  # damping ratio times `_rounding_amplitude` up to which the term is omitted

# The rotor-held frequencies by the two methods are assumed to differ by up to so many standard uncertainties.
_METHODS_DIFFERENCE = 3.0

_ZERO_DAMPING = 0.3  # largest damping ratio of the zero of the motor's response


@dataclass(frozen=True, slots=True)
class UncertaintyTerm:
    """One term of the uncertainty of a frequency.

    Parameters
    ----------
    name : str
        Key in :attr:`~ballscrew.modal.cell.CellResult.uncertainty_terms_Hz`.
    repeats : bool
        Whether its errors are the same in another run of the same plan.
    effects : ndarray, shape (causes, cells)
        Effect of each of the independent causes on every cell, for one standard deviation of the cause, Hz.
    """

    name: str
    repeats: bool
    effects: Array

    @property
    def standard_uncertainty(self) -> Array:
        """Standard uncertainty of every cell by this term, shape (cells,), Hz."""
        return np.asarray(np.sqrt(np.sum(self.effects**2, axis=0)))


@dataclass(frozen=True, slots=True)
class CellFrequencies:
    """Estimates for all cells that have a window.

    Parameters
    ----------
    rotor_free : ndarray, shape (cells,)
        Natural frequency with the rotor free, Hz.
    terms : list of UncertaintyTerm
        Terms of the uncertainty of ``rotor_free``.
    rotor_held, rotor_held_uncertainty : ndarray, shape (cells,)
        Natural frequency with the rotor held and its standard uncertainty, Hz; the latter is not finite if
        the run does not determine the frequency.
    nut_load : ndarray, shape (cells,)
        Highest load on the nut over its preload; not lower than by the data sheet's lower limit of mass over
        preload.
    """

    rotor_free: Array
    terms: list[UncertaintyTerm]
    rotor_held: Array
    rotor_held_uncertainty: Array
    nut_load: Array

    @property
    def uncertainty(self) -> Array:
        """Standard uncertainty of the rotor-free frequency, shape (cells,), Hz."""
        return _total(self.terms)


def estimate_frequencies(
    found: SearchResult, settings: JointSettings, rounding: float = 0.0
) -> CellFrequencies:
    """Estimate the frequencies of all cells.

    Parameters
    ----------
    found : SearchResult
        The final fit and the fit before whitening.
    settings : JointSettings
        Settings of the method.
    rounding : float
        Power spectral density of the rounding error of the force over the total inertia, (m/s²)²/Hz.

    Returns
    -------
    CellFrequencies
        Of all cells that have a window.
    """
    fit = found.fit
    stops = fit.blocks[0].windows.stops
    length = max(float(np.ptp(stops)), _SHORTEST)
    shrinkage = shrinkage_covariance(fit, found.variation)
    final = tie_slopes(fit, shrinkage, settings.slopes, length)
    shrinkage = shrinkage_covariance(found.unwhitened, found.variation)
    unwhitened = tie_slopes(found.unwhitened, shrinkage, settings.slopes, length)
    rotor_free, terms = _frequency_and_terms(found, final, unwhitened, ROTOR_FREE, stops, settings)
    rotor_held, rotor_held_uncertainty = _rotor_held_frequency(
        found, final, unwhitened, settings, rotor_free, _total(terms)
    )
    loads, shares = nut_loads(fit)
    mass_over_preload = fit.modes[0].mass_over_preload
    if mass_over_preload > 0:
        # Not lower than by the data sheet's lower limit.
        loads = loads * max(1.0, found.profile.least_mass_over_preload / mass_over_preload)
    by_load = _load_error(found, loads) * shares
    terms.append(UncertaintyTerm("load", False, (by_load * rotor_free)[None]))
    by_ripple = _ripple_error(found)
    if by_ripple > 0:
        terms.append(UncertaintyTerm("ripple", False, by_ripple * rotor_free[None]))
    amplitude = _rounding_amplitude(fit, rounding)
    damped_amplitude = fit.modes[ROTOR_FREE].damping * amplitude
    if damped_amplitude > _LEAST_ROUNDING:
        mean = np.full(len(stops), _ROUNDING_MEAN * damped_amplitude)
        tilt = _ROUNDING_TILT * amplitude * (stops - stops.mean()) / (length / 2)
        terms.append(UncertaintyTerm("steps", False, np.stack([mean, tilt]) * rotor_free))
    return CellFrequencies(rotor_free, terms, rotor_held, rotor_held_uncertainty, loads)


def _load_error(found: SearchResult, loads: Array) -> Array:
    """Relative error of the nut's stiffness by the test's own load, at each stop."""
    by_law = _LAW_ERROR * loads * np.maximum(loads, 1.0)
    load_information = found.profile.load_information(found.variation.prior_inflation)
    by_wear = _WEAR_ERROR * sheet_weight(found.fit, load_information) * loads**2
    return np.asarray(np.hypot(by_law, by_wear))


def _ripple_error(found: SearchResult) -> float:
    """Relative error of the frequencies by an unmeasured force between whole orders."""
    unmeasured = _unmeasured_power(found)
    if unmeasured <= _LEAST_UNMEASURED or not any(order.fractional for order in found.ripple):
        return 0.0
    return _FRACTIONAL * math.sqrt(unmeasured)


def _rounding_amplitude(fit: JointFit, rounding: float) -> float:
    """Rms of Im(e/F) in the band, where e is the torque's rounding error and F the torque; without unit.

    ``rounding`` is as for :func:`estimate_frequencies`. A force e in addition to F turns the phase of the
    response to F by Im(e/F). At the resonance this has the effect of a relative shift of the frequency by
    Im(e/F) times the damping ratio. The motion is the same at every stop, and so, on average, is the
    rounding. Half of the power of e/F is in its imaginary part.
    """
    w = fit.blocks[0].windows
    power = float(np.mean(w.force_band[w.from_rest] ** 2))  # of F, (m/s²)²
    rounding_power = _ROUNDING**2 * rounding * (w.band.high - w.band.low)
    return math.sqrt(rounding_power / max(power, 1e-300) / 2)


def _damping_error(fit: JointFit) -> float:
    """Relative error of the frequencies by dampers in the joints, over the square of the damping ratio."""
    mean, deviation = _EXPONENT
    information = deviation**-2
    parameter = ("damping_exponent", None)
    if parameter in fit.parameters:
        exponent = fit.modes[0].damping_exponent
        if exponent >= limits_of([parameter])[1, 0]:
            return _JOINT_DAMPERS
        index = fit.parameters.index(parameter)
        # The fit's own prior is taken out of its estimate.
        whole = 1 / float(np.linalg.pinv(fit.hessian)[index, index])
        by_prior = SAMPLES_PER_INDEPENDENT * EXPONENT_DEVIATION**-2
        if whole > by_prior:
            inflation = variance_inflation(fit, index)
            own = (whole - by_prior) / inflation
            weighted = (whole * exponent - by_prior * EXPONENT_MEAN) / inflation
            mean = (weighted + information * mean) / (own + information)
            information += own
    in_joints = math.sqrt(max(mean, 0.0) ** 2 + 1 / information) / 2  # part of the damping, rms
    return _JOINT_DAMPERS * min(in_joints, 1.0) ** 2


def _unmeasured_power(found: SearchResult) -> float:
    """Part of the power of the first response that the motor's motion explains and the torque does not.

    Without a fit of the response to the motor's motion it is all that the torque does not explain.
    """
    by_block = unexplained_power(found.unwhitened)
    return max(found.unwhitened.projections[0].unexplained - by_block.get("motor-nut", 0.0), 0.0)


def unexplained_power(fit: JointFit) -> dict[str, float]:
    """Unexplained part of the power of each block's responses, by the block's name."""
    return {b.name: projection.unexplained for b, projection in zip(fit.blocks, fit.projections, strict=True)}


def _frequency_and_terms(
    found: SearchResult,
    final: TiedCurves,
    unwhitened: TiedCurves,
    mode: int,
    stops: Array,
    settings: JointSettings,
) -> tuple[Array, list[UncertaintyTerm]]:
    """Frequency (Hz) of a mode at stops, given by their positions from the middle (m), and its uncertainty.

    ``final`` and ``unwhitened`` are the final fit and the fit before whitening, ``mode`` is ROTOR_FREE or
    ROTOR_HELD. The uncertainty is a list of terms.
    """
    fit, f = final.fit, final.curve(mode, stops)
    by_motion = unexplained_power(fit).get("motor-nut", 0.0)
    unexplained = max(fit.projections[0].unexplained, _FORCE_OF_MOTION * by_motion)
    force = _FORCE_ERROR * unexplained * fit.modes[mode].damping
    floor = settings.model_floor
    if mode == ROTOR_HELD:
        floor = settings.rotor_held_floor
    # The relative error of a frequency is half of that of the compliance.
    interpolation = _INTERPOLATION / 2 * f[None] * local_residue(fit.modes[0], stops)
    terms = [
        # Neither of these two contains all of the other.
        UncertaintyTerm("noise", False, _SCATTER_FACTOR * final.effects(mode, stops, "noise")),
        UncertaintyTerm("conditions", False, final.effects(mode, stops, "conditions")),
        # Half of the change of the frequency by the whitening, and half of that by the tie of the slopes.
        UncertaintyTerm("weights", True, (f - unwhitened.curve(mode, stops))[None] / 2),
        UncertaintyTerm("drives", True, (f - mode_frequency(fit.modes[mode], stops))[None] / 2),
        UncertaintyTerm("model", True, floor * f[None]),
        UncertaintyTerm("clock", True, settings.clock * f[None]),
        UncertaintyTerm("residual", False, force * f[None]),
        UncertaintyTerm("local", False, interpolation),
        UncertaintyTerm("damping", True, _damping_error(fit) * fit.modes[mode].damping ** 2 * f[None]),
    ]
    if found.frame is None:
        return f, terms
    relative, shift = _frame_term(found.frame, fit.modes[mode], far_above=is_far_above(fit.modes[0]))
    terms.append(UncertaintyTerm("frame", False, relative * f[None]))
    return f * (1 - shift), terms


def _frame_term(frame: FrameSearch, mode: AxialMode, *, far_above: bool) -> tuple[float, float]:
    """Relative uncertainty of a frequency by the frame's mode, and the relative excess to subtract."""
    growth = max(1.0, mode.coupling / _FRAME_COUPLING) ** 2
    if frame.pitching:
        return growth * _PITCHING_ERROR, 0.0
    relative = _FRAME_ERROR
    if far_above:
        relative = _HIGH_FRAME_ERROR
    whole = mode.screw_shift * mode.coupling  # the excess if the mass of the screw is distributed
    return math.hypot(growth * relative, FORM_DEVIATION * whole), whole * min(max(mode.form, 0.0), 1.0)


def _total(terms: Sequence[UncertaintyTerm]) -> Array:
    """Root sum of squares of the terms, shape (cells,), Hz."""
    return np.asarray(np.sqrt(sum((term.standard_uncertainty**2 for term in terms), np.zeros(()))))


def _rotor_held_frequency(
    found: SearchResult,
    final: TiedCurves,
    unwhitened: TiedCurves,
    settings: JointSettings,
    rotor_free: Array,
    rotor_free_uncertainty: Array,
) -> tuple[Array, Array]:
    """Rotor-held frequency and its standard uncertainty, shape (cells,), Hz.

    It is estimated by the nut's response to the motor's motion; without this response by the zero of the
    motor's response to the torque.
    """
    zero, zero_uncertainty = _torque_zero(found, rotor_free)
    fit = found.fit
    if len(fit.blocks) > 1:
        stops = fit.blocks[0].windows.stops
        rotor_held, terms = _frequency_and_terms(found, final, unwhitened, ROTOR_HELD, stops, settings)
        # Noise of the encoder is an error of this method, whose drive is the motor's motion, but not of the
        # zero.
        difference = np.where(np.isfinite(zero), rotor_held - zero, 0.0)
        uncertainty = np.hypot(_total(terms), difference / _METHODS_DIFFERENCE)
    else:
        rotor_held = zero
        uncertainty = np.sqrt(zero_uncertainty**2 + (rotor_free_uncertainty * zero / rotor_free) ** 2)
        uncertainty = np.hypot(uncertainty, _ZERO_ERROR * rotor_held)
    # If the motor's motion is mostly noise, as with a coarse encoder, neither method determines the
    # frequency.
    for name, power in unexplained_power(found.unwhitened).items():
        if name != "torque-nut" and power > settings.most_unexplained:
            uncertainty = np.full_like(rotor_held, np.inf)
    return rotor_held, uncertainty


def _torque_zero(found: SearchResult, rotor_free: Array) -> tuple[Array, Array]:
    """Zero of the motor's response to the torque, and its standard uncertainty, shape (cells,), Hz.

    At the zero the force of the spring is equal to that of the motor, and the rotor does not move, as if it
    were held. Without a zero the results are nan and infinity.

    Modes above the band shift the zero, and noise of the torque resembles them. The zero is therefore
    estimated without the column for these modes, and its shift with that column is part of the uncertainty.
    """
    projection, first = _motor_projection(found), found.fit.blocks[0]
    damping = found.fit.modes[0].damping
    angle = 2 * math.pi * float(np.mean(rotor_free)) / first.windows.rate
    # The columns begin with the response of the mode, its derivative, the change of its gain along the axis,
    # and the force with its two derivatives; those of the ripple follow.
    used = [0, 1, *range(MOTOR_MODE_COLUMNS, MOTOR_MODE_COLUMNS + 3)]
    with_modes_above, fitted = projection.columns[:, used], projection.weights[used]
    columns = with_modes_above[:, :4]
    ratio_with_modes_above = _zero_over_pole(fitted[:, 0], angle, damping)
    # The response without ripple, with the mean gain along the axis.
    target = with_modes_above @ fitted + projection.residual
    weights = np.linalg.lstsq(columns, target, rcond=None)[0][:, 0]
    ratio = _zero_over_pole(np.append(weights, 0.0), angle, damping)
    if ratio is None or ratio_with_modes_above is None:
        return np.full_like(rotor_free, np.nan), np.full_like(rotor_free, np.inf)
    noise = SAMPLES_PER_INDEPENDENT * first.mean_square(projection.residual)
    covariance = noise * np.linalg.pinv(columns.T @ columns)
    # The ratio without damping and delays is 1 + weights[0] / weights[2].
    gradient = np.array([1 / weights[2], 0, -weights[0] / weights[2] ** 2, 0])
    relative = math.sqrt(max(float(gradient @ covariance @ gradient), 0.0)) / (2 * ratio)
    rotor_held = rotor_free * math.sqrt(ratio)
    shift = rotor_free * abs(math.sqrt(ratio_with_modes_above) - math.sqrt(ratio))
    return rotor_held, np.hypot(rotor_held * relative, shift)


def _motor_projection(found: SearchResult) -> Projection:
    """Linear part of the block "torque-motor" with the final mode; the block is made if it was not fitted."""
    fit = found.fit
    for b, projection in zip(fit.blocks, fit.projections, strict=True):
        if b.name == "torque-motor":
            return projection
    first = fit.blocks[0]
    block = make_block("torque-motor", first.windows, from_rest=found.from_rest, ripple=first.ripple)
    return project(block, fit.modes[0])


def _zero_over_pole(weights: Array, angle: float, damping: float) -> float | None:
    """Ratio of squared frequencies: of the zero of the motor's response to the torque, over the pole.

    Parameters
    ----------
    weights : ndarray, shape (5,)
        Weights of columns of the block "torque-motor": response of the mode and its derivative, force and its
        two derivatives.
    angle : float
        Angular frequency of the mode, rad per sample.
    damping : float
        Damping ratio of the mode.

    Returns
    -------
    float or None
        That of the highest lightly damped zero below the pole; None if there is none.
    """
    # Polynomials in s, where a derivative per sample is a factor s. The transfer function of the mode is the
    # damping and stiffness terms of `pole` over `pole`.
    pole = np.array([1.0, 2 * damping * angle, angle**2])
    by_force = np.polymul([weights[4], weights[3], weights[2]], pole)
    by_mode = np.polymul([weights[1], weights[0]], pole * (0.0, 1.0, 1.0))
    roots = np.roots(np.polyadd(by_force, by_mode))
    frequencies = np.abs(roots)  # rad per sample
    lightly_damped = np.abs(roots.real) < _ZERO_DAMPING * frequencies
    below = (roots.imag > 0) & (frequencies < angle) & lightly_damped
    return max((frequencies[below] ** 2 / angle**2).tolist(), default=None)
