"""The axis as one rigid mass with friction, from the whole moving record.

The least-squares fit of Gautier's inverse dynamic identification model, as in A. Janot, M. Gautier and
M. Brunot, *Data set and reference models of EMPS*, 2019: force = M a + Fv v + Fc sign(v) + offset, with
both sides passed through the same low-pass filter, so that its effect cancels. The whole moving record is
used: transients alone do not separate friction from inertia, and are biased by 13 % and more.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.signal import butter, sosfiltfilt
from scipy.special import stdtrit

from ballscrew.base.arrays import Array
from ballscrew.base.errors import MeasurementError
from ballscrew.base.quantity import NORMAL_95
from ballscrew.recording.kinematics import Kinematics, differentiate, rates
from ballscrew.recording.quality.signal_faults import block_means

CUTOFF = 20.0  # Hz: above the motion, well below the axial mode, whose resonance would pass for mass
CHECK_CUTOFF = 30.0  # Hz: as good a choice; the difference of both fits is part of the uncertainty
_ORDER = 4
_ENOUGH = 100  # samples a period of the cut-off; more only take time
_MOVING = 0.01  # of the cruising speed: below it, friction has no sign
_UNIDIRECTIONAL = 0.98  # correlation of direction and offset above which they cannot be separated


@dataclass(frozen=True, slots=True)
class NormalEquations:
    """Sums of a least-squares fit, which add up over recordings; by default, of no samples.

    Parameters
    ----------
    xtx : ndarray, shape (4, 4)
        Regressors' products: acceleration, speed, sign of speed, one.
    xty : ndarray, shape (4,)
        Products with the force or torque.
    yty : float
        Square of the force or torque.
    count : int
        Number of samples, decimated to the filter's bandwidth.
    """

    xtx: Array = field(default_factory=lambda: np.zeros((4, 4)))
    xty: Array = field(default_factory=lambda: np.zeros(4))
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
        Standard uncertainties of the four, from the fit's residual; and, with :meth:`checked`, from the
        choice of the filter.
    residual : float
        Root mean square of the residuals, in the input's unit.
    explained : float
        Share of the input's variance that the fit explains, 0 to 1.
    mass_scatter : float, optional
        Standard uncertainty of the equivalent mass by its scatter from trip to trip, see
        :func:`mass_scatter`.
    """

    equivalent_mass: float
    viscous: float
    coulomb: float
    offset: float
    uncertainty: tuple[float, float, float, float]
    residual: float
    explained: float
    mass_scatter: float | None = None

    @property
    def parameters(self) -> Array:
        """Equivalent mass, viscous and Coulomb friction, and offset."""
        return np.array([self.equivalent_mass, self.viscous, self.coulomb, self.offset])

    def checked(self, other: RigidBody) -> RigidBody:
        """Copy whose uncertainty includes the difference from another, equally good fit."""
        difference = self.parameters - other.parameters
        return replace(self, uncertainty=_four(np.hypot(self.uncertainty, difference)))

    def scaled(self, factor: float) -> RigidBody:
        """Copy for an input that is multiplied by a factor, as from torque to force by 1/beta."""
        uncertainty = _four(abs(factor) * np.array(self.uncertainty))
        residual = self.residual * abs(factor)
        scatter = self.mass_scatter
        if scatter is not None:
            scatter *= abs(factor)
        return RigidBody(*_four(self.parameters * factor), uncertainty, residual, self.explained, scatter)


def normal_equations(motion: Kinematics, drive: Array, cutoff: float = CUTOFF) -> NormalEquations:
    """Sums of the rigid-body fit over one recording.

    Parameters
    ----------
    motion : Kinematics
        Motion of the recording.
    drive : ndarray, shape (n,)
        Force (N) or torque (N m), as many samples as the position.
    cutoff : float
        Cut-off frequency of the low-pass filter on both sides, Hz.

    Returns
    -------
    NormalEquations
        Empty sums where the axis never moves or the record is shorter than the filter.
    """
    cutoff = min(cutoff, 0.2 * motion.rate)
    # Means over a few samples are one more filter on both sides.
    every = max(1, int(motion.rate / (2 * cutoff)))
    most = max(1, int(motion.rate / (_ENOUGH * cutoff)))
    thin = next(count for count in range(most, 0, -1) if every % count == 0)
    rate = motion.rate / thin
    filtered = butter(_ORDER, cutoff, fs=rate, output="sos")
    settle = int(2 * rate / cutoff)  # start and end transients of the filter
    if motion.cruise <= 0 or len(drive) < 4 * settle * thin:
        return NormalEquations()
    place, drive = block_means(motion.position - motion.position[0], thin), block_means(drive, thin)
    # The derivative of an encoder needs smoothing, which both sides pass.
    smoothing = 0.1 / cutoff
    speed, acceleration = rates(place, rate, smoothing)
    moving = np.abs(speed) > _MOVING * motion.cruise
    # Standstill has no direction: there the guide balances the drive, and the sign is noise.
    direction = differentiate(np.where(moving, np.sign(speed), 0.0), rate, smoothing, 0)
    force = differentiate(drive, rate, smoothing, 0)
    columns = np.stack([acceleration, speed, direction, np.ones_like(speed), force])
    columns = sosfiltfilt(filtered, columns, axis=1)
    moving[:settle] = moving[-settle:] = False
    # Two samples per period of the cut-off are independent; more would make the uncertainty too small.
    used = columns[:, moving][:, :: every // thin]
    x, y = used[:4], used[4]
    return NormalEquations(x @ x.T, x @ y, float(y @ y), used.shape[1])


def solve(sums: NormalEquations) -> RigidBody:
    """Rigid-body parameters from the sums.

    Parameters
    ----------
    sums : NormalEquations
        Sums of one recording, or of several.

    Returns
    -------
    RigidBody
        Least-squares estimate.

    Raises
    ------
    MeasurementError
        If the record has too little motion to separate the four parameters.
    """
    scale = np.sqrt(np.diag(sums.xtx))
    if sums.count < 20 or np.any(scale == 0):
        raise MeasurementError("the axis does not move enough to separate its mass from its friction")
    normalised = sums.xtx / np.outer(scale, scale)
    if np.linalg.cond(normalised) > 1e10:
        raise MeasurementError(
            "the axis moves at one speed and acceleration only: mass and friction cannot be separated"
        )
    if abs(normalised[2, 3]) > _UNIDIRECTIONAL:
        raise MeasurementError(
            "the axis moves in one direction only: Coulomb friction and offset cannot be separated"
        )
    solution = np.linalg.solve(normalised, sums.xty / scale) / scale
    squares = max(0.0, sums.yty - float(solution @ sums.xty))
    variance = squares / (sums.count - 4)
    covariance = np.linalg.inv(normalised) / np.outer(scale, scale) * variance
    deviation = np.sqrt(np.diag(covariance))
    mean = float(sums.xty[3]) / sums.count
    total = sums.yty - sums.count * mean**2
    explained = float(1 - squares / total) if total > 0 else 0.0
    return RigidBody(*_four(solution), _four(deviation), float(np.sqrt(variance)), explained)


def mass_scatter(trips: Sequence[NormalEquations]) -> float | None:
    """Standard uncertainty of the equivalent mass by its scatter from trip to trip.

    The scatter of few trips is itself uncertain: s/√n is multiplied by Student's quantile over that of the
    normal distribution, so that ± 1.96 of it is the 95 % interval of the mean (JCGM 100:2008, G.3).

    Parameters
    ----------
    trips : sequence of NormalEquations
        Sums of each trip.

    Returns
    -------
    float or None
        In the unit of the equivalent mass; None for a single trip, or where one trip alone has too little
        motion for a fit.
    """
    if len(trips) < 2:
        return None
    try:
        masses = [solve(sums).equivalent_mass for sums in trips]
    except MeasurementError:
        return None
    quantile = float(stdtrit(len(masses) - 1, 0.975))
    return float(np.std(masses, ddof=1)) / math.sqrt(len(masses)) * quantile / NORMAL_95


def _four(values: Array) -> tuple[float, float, float, float]:
    mass, viscous, coulomb, offset = values.tolist()
    return mass, viscous, coulomb, offset
