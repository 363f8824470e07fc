"""The axis as one rigid mass with friction, from the whole moving record.

The least-squares fit of Gautier's inverse dynamic identification model, as in A. Janot, M. Gautier and
M. Brunot, *Data set and reference models of EMPS*, 2019: force = M a + Fv v + Fc sign(v) + offset, with
both sides passed through the same low-pass filter, so that its effect cancels. The whole moving record is
used: transients alone do not separate friction from inertia, and are biased by 13 % and more.

Screw and bed are not rigid: towards their modes the mass seems to grow with the square of the frequency,
which a term in the second derivative of the acceleration takes up. Without it and with speeds near the
reversals, where friction has no one level, the mass was 0.28 % too high in the median of 40 simulated axes.

The uncertainty of the mass is that of the mass itself. It contains what repeats in every run: how masses
differ among the accelerations of a trip (jackknife), other filters and speeds, and other models of friction.
The repeatability, for a comparison of two runs, is the scatter from trip to trip.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Hashable, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.special import stdtrit

from ballscrew.base.arrays import Array
from ballscrew.base.errors import MeasurementError
from ballscrew.base.quantity import NORMAL_95
from ballscrew.recording.kinematics import Kinematics, differentiate, rates
from ballscrew.recording.phases import MotionPhase
from ballscrew.recording.quality.signal_faults import block_means


class FitRange(NamedTuple):
    """Cut-off of the low-pass filter, Hz, and lowest speed that is used, in cruising speeds."""

    cutoff: float
    slowest: float


# Above the motion; below modes of bed and screw, which would pass for mass; faster than Stribeck's friction.
# Of cut-offs of 10 to 30 Hz and speeds of 0.01 to 0.3, the one with the least error on 40 simulated axes.
FIT_RANGE = FitRange(14.0, 0.2)
CHECK_RANGE = FitRange(20.0, 0.1)  # as good a choice; the difference of both fits is part of the uncertainty
_ORDER = 4
_ENOUGH = 100  # samples a period of the cut-off; more only take time
_MOVING = 0.01  # of the cruising speed: below it, friction has no sign
_UNIDIRECTIONAL = 0.98  # correlation of direction and offset above which they cannot be separated
_PARAMETERS = 4
_TERMS = 5  # of the fit: acceleration, speed, sign of speed, one, second derivative of acceleration
# And other models of friction: |v| (directions differ), v|v|, sign exp(−(v/v_s)²), sign exp(−s/s_0) with the
# distance s since standstill, x, x sign.
_ALL_TERMS = 11
_STRIBECK = 0.1  # v_s of the cruising speed
_PRESLIDING = 1e-4  # m, s_0: rolling guides slide after some 10 µm; below 1 mm the filter makes all alike
_RESIDUAL_DEGREES = 4  # on 40 simulated axes the scatter of two runs is 0.5 to 0.8 of what residuals predict


@dataclass(frozen=True, slots=True)
class NormalEquations:
    """Sums of a least-squares fit, which add up over recordings; by default, of no samples.

    Parameters
    ----------
    xtx : ndarray, shape (11, 11)
        Regressors' products: acceleration, speed, sign of speed, one, second derivative of acceleration; then
        six terms of other models of friction.
    xty : ndarray, shape (11,)
        Products with the force or torque.
    yty : float
        Square of the force or torque.
    count : int
        Number of samples, decimated to the filter's bandwidth.
    """

    xtx: Array = field(default_factory=lambda: np.zeros((_ALL_TERMS, _ALL_TERMS)))
    xty: Array = field(default_factory=lambda: np.zeros(_ALL_TERMS))
    yty: float = 0.0
    count: int = 0

    def __add__(self, other: NormalEquations) -> NormalEquations:
        """Sums of two recordings."""
        return NormalEquations(
            self.xtx + other.xtx, self.xty + other.xty, self.yty + other.yty, self.count + other.count
        )


@dataclass(frozen=True, slots=True)
class RigidBody:
    """Rigid-body parameters of an axis, referred to the table.

    Parameters
    ----------
    equivalent_mass, viscous, coulomb, offset : float
        kg, N s/m, N, N; where the input is a torque without a known lead: N m per m/s² and so on.
    uncertainty : tuple of float
        Standard uncertainties of the four: by :func:`solve` from the fit's residual, by
        :func:`estimate_rigid_body` of the values themselves.
    residual : float
        Root mean square of the residuals, in the input's unit.
    explained : float
        Share of the input's variance that the fit explains, 0 to 1.
    repeatability : tuple of float, optional
        Standard uncertainties of the four for a comparison with another run of the same test.
    """

    equivalent_mass: float
    viscous: float
    coulomb: float
    offset: float
    uncertainty: tuple[float, float, float, float]
    residual: float
    explained: float
    repeatability: tuple[float, float, float, float] | None = None

    @property
    def parameters(self) -> Array:
        """Equivalent mass, viscous and Coulomb friction, and offset."""
        return np.array([self.equivalent_mass, self.viscous, self.coulomb, self.offset])

    def scaled(self, factor: float) -> RigidBody:
        """Copy for an input that is multiplied by a factor, as from torque to force by 1/beta."""
        uncertainty = _four(abs(factor) * np.array(self.uncertainty))
        residual = self.residual * abs(factor)
        repeatability = self.repeatability
        if repeatability is not None:
            repeatability = _four(abs(factor) * np.array(repeatability))
        parameters = _four(self.parameters * factor)
        return RigidBody(*parameters, uncertainty, residual, self.explained, repeatability)


def normal_equations(
    motion: Kinematics, drive: Array, phases: Sequence[MotionPhase] = (), used: FitRange = FIT_RANGE
) -> tuple[NormalEquations, ...]:
    """Sums of the rigid-body fit over the surroundings of each phase of one recording.

    Parameters
    ----------
    motion : Kinematics
        Motion of the recording.
    drive : ndarray, shape (n,)
        Force (N) or torque (N m), as many samples as the position.
    phases : sequence of MotionPhase
        Accelerations and decelerations; the record is divided in the middle between two of them.
    used : FitRange
        Cut-off frequency of the low-pass filter on both sides, and lowest speed.

    Returns
    -------
    tuple of NormalEquations
        As many as phases, or one of the whole recording; empty sums where the axis never moves or the record
        is shorter than the filter.
    """
    from scipy.signal import butter, sosfiltfilt

    nothing = (NormalEquations(),) * max(1, len(phases))
    cutoff = min(used.cutoff, 0.2 * motion.rate)
    # Means over a few samples are one more filter on both sides.
    thin = max(1, int(motion.rate / (_ENOUGH * cutoff)))
    rate = motion.rate / thin
    filtered = butter(_ORDER, cutoff, fs=rate, output="sos")
    settle = int(2 * rate / cutoff)  # start and end transients of the filter
    if motion.cruise <= 0 or len(drive) < 4 * settle * thin:
        return nothing
    # The derivative of an encoder needs smoothing, which both sides pass.
    smoothing = 0.1 / cutoff
    speed, terms = _terms(block_means(motion.position, thin), rate, smoothing, motion.cruise)
    force = differentiate(block_means(drive, thin), rate, smoothing, 0)
    columns = sosfiltfilt(filtered, [*terms, force], axis=1)
    fast = np.abs(speed) > used.slowest * motion.cruise
    fast[:settle] = fast[-settle:] = False
    # Two samples per period of the cut-off are independent; more would make the uncertainty too small.
    chosen = np.flatnonzero(fast)[:: max(1, int(rate / (2 * cutoff)))]
    middles = [(before.stop + after.start) / 2 for before, after in pairwise(phases)]
    bounds = [0, *np.searchsorted(chosen * thin, middles), len(chosen)]
    sums = []
    for first, last in pairwise(bounds):
        x, y = columns[:-1, chosen[first:last]], columns[-1, chosen[first:last]]
        sums.append(NormalEquations(x @ x.T, x @ y, float(y @ y), len(y)))
    return tuple(sums)


def _terms(position: Array, rate: float, smoothing: float, cruise: float) -> tuple[Array, list[Array]]:
    """Speed, and the terms of the fit and of other models of friction."""
    speed, acceleration = rates(position, rate, smoothing)
    moving = np.abs(speed) > _MOVING * cruise
    # Standstill has no direction: there the guide balances the drive, and the sign is noise.
    sign = np.where(moving, np.sign(speed), 0.0)
    stribeck = sign * np.exp(-((speed / (_STRIBECK * cruise)) ** 2))
    starts = np.flatnonzero(np.diff(sign, prepend=sign[0]))
    before = np.searchsorted(starts, np.arange(len(sign)), side="right")
    distance = np.abs(position - np.concatenate([position[:1], position[starts]])[before])
    presliding = sign * np.exp(-distance / _PRESLIDING)

    def smooth(x: Array) -> Array:
        return differentiate(x, rate, smoothing, 0)

    fitted = [
        acceleration,
        speed,
        smooth(sign),
        np.ones_like(speed),
        np.gradient(np.gradient(acceleration)) * rate**2,
    ]
    others = [np.abs(speed), speed * np.abs(speed), stribeck, presliding, position, position * sign]
    return speed, fitted + [smooth(x) for x in others]


def solve(sums: NormalEquations, terms: int = _TERMS) -> RigidBody:
    """Rigid-body parameters from the sums.

    Parameters
    ----------
    sums : NormalEquations
        Sums of one recording, or of several.
    terms : int
        How many of the regressors are fitted: 5, or 11 with the other models of friction.

    Returns
    -------
    RigidBody
        Least-squares estimate.

    Raises
    ------
    MeasurementError
        If the record has too little motion to separate the parameters.
    """
    xtx, xty = sums.xtx[:terms, :terms], sums.xty[:terms]
    scale = np.sqrt(np.diag(xtx))
    if sums.count < 20 or np.any(scale == 0):
        raise MeasurementError("the axis does not move enough to separate its mass from its friction")
    normalised = xtx / np.outer(scale, scale)
    if np.linalg.cond(normalised) > 1e10:
        raise MeasurementError(
            "the axis moves at one speed and acceleration only: mass and friction cannot be separated"
        )
    if abs(normalised[2, 3]) > _UNIDIRECTIONAL:
        raise MeasurementError(
            "the axis moves in one direction only: Coulomb friction and offset cannot be separated"
        )
    solution = np.linalg.solve(normalised, xty / scale) / scale
    squares = max(0.0, sums.yty - float(solution @ xty))
    variance = squares / (sums.count - terms)
    covariance = np.linalg.inv(normalised) / np.outer(scale, scale) * variance
    deviation = np.sqrt(np.diag(covariance))
    mean = float(sums.xty[3]) / sums.count
    total = sums.yty - sums.count * mean**2
    explained = float(1 - squares / total) if total > 0 else 0.0
    parameters, spread = _four(solution[:_PARAMETERS]), _four(deviation[:_PARAMETERS])
    return RigidBody(*parameters, spread, float(np.sqrt(variance)), explained)


def estimate_rigid_body(
    sums: Sequence[NormalEquations], check: Sequence[NormalEquations], cells: Sequence[Hashable]
) -> RigidBody:
    """Rigid-body parameters of a run, with their uncertainty and their repeatability.

    Parameters
    ----------
    sums : sequence of NormalEquations
        Of each phase, in the order of time.
    check : sequence of NormalEquations
        Of another choice of filter and speeds.
    cells : sequence
        Which phases are the same: stop, condition and motion of each.

    Returns
    -------
    RigidBody
        The uncertainty is the larger of residual and jackknife over cells, combined with the difference of
        the other choice and, for the mass, of the fit with all models of friction; the parameters of friction
        have no meaning beyond their model.

    Raises
    ------
    MeasurementError
        If the record has too little motion to separate the parameters.
    """
    fit = solve(_add_up(sums))
    others = [solve(_add_up(check)).parameters - fit.parameters]
    noise = np.array(fit.uncertainty)
    try:
        full = solve(_add_up(sums), _ALL_TERMS)
        others.append(np.array([full.equivalent_mass - fit.equivalent_mass, 0.0, 0.0, 0.0]))
        # The rest of the residual is friction that repeats.
        noise *= min(1.0, full.residual / fit.residual)
    except MeasurementError:
        pass  # too little motion for further terms
    own = np.array(fit.uncertainty)
    by_cell = _jackknife(sums, cells)
    if by_cell is not None:
        own = np.maximum(own, by_cell)
    uncertainty = np.sqrt(own**2 + np.square(others).sum(axis=0))
    repeatability = _repeatability(sums, cells, noise)
    return replace(fit, uncertainty=_four(uncertainty), repeatability=_four(repeatability))


def _repeatability(sums: Sequence[NormalEquations], cells: Sequence[Hashable], noise: Array) -> Array:
    """Standard uncertainties by the residual and by the scatter from trip to trip.

    The residual counts as four degrees of freedom. The scatter of few trips is itself uncertain: it is
    multiplied by Student's quantile over that of the normal distribution, so that ± 1.96 of it is the 95 %
    interval of the mean (JCGM 100:2008, G.3).
    """
    reached: Counter[Hashable] = Counter()
    visits = []
    for cell in cells:
        visits.append(reached[cell])
        reached[cell] += 1
    # What is left of an incomplete trip belongs to the one before.
    sizes = np.bincount(visits)
    trips = int(np.count_nonzero(sizes >= sizes[0] / 2))
    scatter = _jackknife(sums, [min(visit, trips - 1) for visit in visits])
    if scatter is None:
        return noise
    degrees = _RESIDUAL_DEGREES + trips - 1
    variance = (_RESIDUAL_DEGREES * noise**2 + (trips - 1) * scatter**2) / degrees
    return np.asarray(np.sqrt(variance) * float(stdtrit(degrees, 0.975)) / NORMAL_95)


def _jackknife(sums: Sequence[NormalEquations], groups: Sequence[Hashable]) -> Array | None:
    """Standard uncertainties of the four by leaving out one group after the other; None where impossible."""
    names = list(dict.fromkeys(groups))
    if len(names) < 2:
        return None
    estimates = []
    for name in names:
        rest = [part for part, group in zip(sums, groups, strict=True) if group != name]
        try:
            estimates.append(solve(_add_up(rest)).parameters)
        except MeasurementError:
            return None
    return np.asarray(math.sqrt(len(names) - 1) * np.std(estimates, axis=0))


def _add_up(sums: Sequence[NormalEquations]) -> NormalEquations:
    return sum(sums, NormalEquations())


def _four(values: Array) -> tuple[float, float, float, float]:
    mass, viscous, coulomb, offset = values.tolist()
    return mass, viscous, coulomb, offset
