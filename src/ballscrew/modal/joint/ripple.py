"""Ripple: forces of the motor that repeat with every turn of it, and that no channel measures.

Poles and slots of the motor cause ripple of its torque (cogging): forces with a whole number of periods per
turn, their *order*. Their phase is the same in every trip, so that averaging over repetitions does not remove
them. The drive reports the torque computed from its currents, which does not contain them. While the axis
accelerates, the frequency of an order sweeps through the mode. A cosine and a sine of each order therefore
drive the mode together with the torque; their amplitudes are linear parameters, which are estimated at every
step of the fit.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ballscrew.base.arrays import Array
from ballscrew.modal.joint.balls import ball_forces, find_balls
from ballscrew.modal.joint.blocks import (
    ROTOR_HELD,
    make_block,
    orthonormaliser,
    project,
    ripple_columns,
    whiten,
)
from ballscrew.modal.joint.fit import CLEAR_REDUCTION, SAMPLES_PER_INDEPENDENT, JointFit
from ballscrew.modal.joint.initial import FREQUENCY_SCALES, InitialValues
from ballscrew.modal.joint.local_wear import UNKNOWN, LocalVariation
from ballscrew.modal.joint.mode import GUIDE_PART_MEAN, INITIAL_DAMPING, AxialMode, compliance_of
from ballscrew.modal.joint.profile import Profile, fit_profile
from ballscrew.modal.joint.result import RippleOrder
from ballscrew.modal.joint.signals import TripSignals
from ballscrew.modal.joint.windows import Windows, subset

_HIGHEST_ORDER = 36  # periods per turn of the highest order that is considered
_MOST_ORDERS = 5  # largest number of orders that are fitted

# An order is significant if the power of the residual that it explains exceeds each of these.
_LEAST_POWER = 0.004  # over the power of the residual: a smaller order has no effect on a frequency
_CHANCE = 20.0  # over the mean power of an independent sample: by chance in at most one of 2000 orders
_OUTSTANDING = 12.0  # over the power that the median order explains, since the residual is not white

_RANK_TOLERANCE = 1e-6  # over the largest eigenvalue of AᵀA of the columns A: smaller are rounding errors
_ROUNDS = 4  # largest number of alternations of selection and fit
_ITERATIONS = 6  # largest number of iterations of such a fit
# Unexplained part of the power of the response from which on the mode may be a tone: it is searched for
# again.
_POOR = 0.05

# Relative standard uncertainty of an amplitude by errors of the model, from runs of the testbed, for each
# block.
_MODEL_ERROR = {"torque-nut": 0.04, "torque-motor": 0.07}
# Least frequency at full speed, over that of the mode, of an order whose amplitude is estimated: below it the
# order in the band and the response of the mode to it are too similar.
_REACHED = 0.65
_NEIGHBOUR = 3  # a force between whole orders may appear as several orders that differ by up to this number
_ZERO = 1e-12  # smaller weights of an order and smaller gains count as 0


@dataclass(frozen=True, slots=True)
class ForceOrders:
    """Orders of the forces in a fit that repeat along the screw.

    Parameters
    ----------
    lead : float
        Travel per turn of the motor, m; 0 if it is not known.
    whole : tuple of int
        Whole orders, of the motor's ripple, periods per turn, ascending.
    balls : float or None
        Order of the force of passing balls, periods per turn; None if it is not significant.
    """

    lead: float
    whole: tuple[int, ...] = ()
    balls: float | None = None


@dataclass(frozen=True, slots=True)
class RippleFit:
    """A fit with ripple.

    Parameters
    ----------
    fit : JointFit
        The fit.
    variation : LocalVariation
        Local variation assumed in its priors.
    orders : ForceOrders
        Orders of the forces in it.
    """

    fit: JointFit
    variation: LocalVariation
    orders: ForceOrders


@dataclass(frozen=True, slots=True)
class RippleModel:
    """Selection of the orders of a run and their fit with the mode, until the selection no longer changes.

    Parameters
    ----------
    trips : sequence of TripSignals
        Decimated recordings of the run.
    names : sequence of str
        Names of the blocks; the torque drives the first.
    from_rest : bool
        As for :func:`~ballscrew.modal.joint.blocks.make_block`.
    initial : InitialValues
        Gives the lead, and the frequency around which the mode is searched for again if it may be a tone.
    profile : Profile
        Which parameters are fitted.
    """

    trips: Sequence[TripSignals]
    names: Sequence[str]
    from_rest: bool
    initial: InitialValues
    profile: Profile

    def fit(self, plain: JointFit, variation: LocalVariation) -> RippleFit:
        """Add the significant orders to a fit without ripple, ``plain``, and fit again."""
        w = plain.blocks[0].windows
        harmonics = turn_harmonics(self.trips, w, self.initial.lead)
        found = self._iterate(w, harmonics, plain.modes, variation, plain)
        if not harmonics.size or found.fit.projections[0].unexplained < _POOR:
            return found
        # At constant speed an order is a tone, which the fit may have taken for the mode.
        modes = self._search_mode(subset(w), plain.modes)
        other = self._iterate(w, harmonics, modes, UNKNOWN, None)
        if other.fit.log_residual < found.fit.log_residual + CLEAR_REDUCTION:
            return other
        return found

    def _iterate(
        self,
        w: Windows,
        harmonics: Array,
        modes: tuple[AxialMode, ...],
        variation: LocalVariation,
        fit: JointFit | None,
    ) -> RippleFit:
        """Select the orders and fit, in alternation; ``fit`` is a fit in motion without ripple, or None."""
        orders = ForceOrders(self.initial.lead)
        for number in range(_ROUNDS):
            before = orders
            orders = self._select(w, harmonics, modes[0], orders)
            # From standstill on, a fit is needed even without any order: a given fit is in motion alone.
            is_fitted = number > 0 or not self.from_rest
            if fit is not None and orders == before and is_fitted:
                break
            ripple = select_harmonics(harmonics, orders.whole)
            balls = ball_forces(w, orders.lead, orders.balls)
            blocks = [
                make_block(name, w, from_rest=self.from_rest, ripple=ripple, balls=balls)
                for name in self.names
            ]
            fit, variation = fit_profile(blocks, modes, self.profile, variation, _ITERATIONS)
            modes = fit.modes
        assert fit is not None  # noqa: S101  without a given fit, the first round makes one
        return RippleFit(fit, variation, orders)

    def _select(self, w: Windows, harmonics: Array, mode: AxialMode, before: ForceOrders) -> ForceOrders:
        """Select the whole orders, and once these no longer change, the order of the balls.

        As long as a whole order is not fitted, the search might find it instead of that of the balls.
        """
        name, lead = self.names[0], before.lead
        balls = ball_forces(w, lead, before.balls)
        whole = select_orders(name, w, mode, harmonics, lead, balls, from_rest=self.from_rest)
        if whole != before.whole or before.balls is not None or not harmonics.size:
            return replace(before, whole=whole)
        ripple = select_harmonics(harmonics, whole)
        return replace(before, balls=find_balls(name, w, mode, lead, ripple, from_rest=self.from_rest))

    def _search_mode(self, w: Windows, modes: tuple[AxialMode, ...]) -> tuple[AxialMode, ...]:
        """Search for the rotor-free frequency that leaves the least power, each tried with its best orders.

        The motor's motion contains the effect of the ripple, so the rotor-held mode is right in spite of it:
        if it was fitted, the profile along the axis is taken from this mode.
        """
        base = replace(modes[0], slope=self.initial.slope, curve=0.0)
        if len(modes) > 1:
            base = modes[ROTOR_HELD]
        base = replace(
            base,
            damping=INITIAL_DAMPING,
            damping_exponent=0.0,
            mass_over_preload=self.profile.mass_over_preload,
            guide_part=GUIDE_PART_MEAN,
            form_curve=modes[0].form_curve,
            coupling=modes[0].coupling,
            rotor_part=modes[0].rotor_part,
            stops=(),
            local=(),
        )
        harmonics = turn_harmonics(self.trips, w, self.initial.lead)
        name = self.names[0]
        least, best = math.inf, base
        for scale in FREQUENCY_SCALES:
            mode = replace(base, compliance=compliance_of(self.initial.rotor_free * scale))
            whole = select_orders(name, w, mode, harmonics, self.initial.lead, from_rest=self.from_rest)
            ripple = select_harmonics(harmonics, whole)
            block = make_block(name, w, from_rest=self.from_rest, ripple=ripple)
            power = float(np.sum(project(block, mode).residual ** 2))
            if power < least:
                least, best = power, mode
        return (best, *modes[1:])


def turn_harmonics(trips: Sequence[TripSignals], w: Windows, lead: float) -> Array:
    """Cosine and sine of every order along the windows, averaged over the trips as all signals are.

    Parameters
    ----------
    trips : sequence of TripSignals
        Decimated recordings of the run.
    w : Windows
        Averaged windows of the run.
    lead : float
        Travel per turn of the motor, m; 0 if it is not known.

    Returns
    -------
    ndarray, shape (n, orders, 2)
        For the orders from 1 on, less the values at the start of each window; shape (n, 0, 2) without a lead.
    """
    if not lead > 0:
        return np.empty((len(w.centred_position), 0, 2))
    out = np.empty((len(w.centred_position), _HIGHEST_ORDER, 2))
    for (start, stop), pieces in zip(w.spans, w.pieces, strict=True):
        total = np.zeros((stop - start, _HIGHEST_ORDER), complex)
        for trip, first in pieces:
            position = trips[trip].position[first : first + stop - start]
            fundamental = np.exp(2j * math.pi / lead * position)
            # The exponential of an order is that of order 1 to this power.
            total += np.cumprod(np.repeat(fundamental[:, None], _HIGHEST_ORDER, axis=1), axis=1)
        mean = (total - total[0]) / len(pieces)
        out[start:stop, :, 0] = mean.real
        out[start:stop, :, 1] = mean.imag
    return out


def forces_along(trips: Sequence[TripSignals], w: Windows, orders: ForceOrders) -> tuple[Array, Array]:
    """Forces of these orders along the averaged windows of trips.

    Parameters
    ----------
    trips : sequence of TripSignals
        Decimated recordings.
    w : Windows
        Their averaged windows.
    orders : ForceOrders
        The orders.

    Returns
    -------
    ripple, balls : ndarray, shape (n, k)
        As for :func:`~ballscrew.modal.joint.blocks.make_block`.
    """
    ripple = np.empty((len(w.centred_position), 0))
    if orders.whole:
        ripple = select_harmonics(turn_harmonics(trips, w, orders.lead), orders.whole)
    return ripple, ball_forces(w, orders.lead, orders.balls)


def select_orders(
    name: str,
    w: Windows,
    mode: AxialMode,
    harmonics: Array,
    lead: float,
    balls: Array | None = None,
    *,
    from_rest: bool = False,
) -> tuple[int, ...]:
    """Select the orders in the band that explain a significant part of a block's residual without ripple.

    An order whose frequency at full speed lies below the band does not excite the mode. While the axis
    accelerates, its columns vary as slowly as friction, and would be fitted to friction.

    Parameters
    ----------
    name, w, from_rest
        As for :func:`~ballscrew.modal.joint.blocks.make_block`, for a block that the torque drives.
    mode : AxialMode
        Mode of the block, as estimated so far.
    harmonics : ndarray, shape (n, orders, 2)
        Result of :func:`turn_harmonics`.
    lead : float
        Travel per turn of the motor, m.
    balls : ndarray, shape (n, 4), optional
        Result of :func:`~ballscrew.modal.joint.balls.ball_forces`: forces that are fitted too, so that the
        residual does not contain them.

    Returns
    -------
    tuple of int
        Ascending. They are selected one by one, the most significant first; the part of the residual that an
        order explains is removed before the next is selected (orthogonal least squares).
    """
    count = harmonics.shape[1]
    if count == 0:
        return ()
    b = make_block(name, w, from_rest=from_rest, balls=balls)
    projection = project(b, mode)
    residual = projection.residual
    independent = max(int(b.counted.sum()), 1) / SAMPLES_PER_INDEPENDENT
    least = max(_LEAST_POWER, _CHANCE / independent) * float(np.sum(residual**2))
    forces = harmonics.reshape(len(harmonics), 2 * count)
    with_ripple = make_block(name, w, from_rest=from_rest, ripple=forces)
    columns = whiten(b, ripple_columns(with_ripple, mode), projection.free_vibration)
    # Columns: cosine and sine of each order in the band, then the response of the mode to each. By order
    # these are four columns, whose indices are a row of the following.
    indices = np.arange(columns.shape[1]).reshape(2, count, 2)
    columns_of_order = indices.transpose(1, 0, 2).reshape(count, 4)
    products = projection.products(columns, columns.shape[1])
    correlation = columns.T @ residual
    lowest = math.ceil(w.band.low * lead / float(np.abs(w.speed).max()))
    candidates = set(range(lowest, count + 1))
    found: list[int] = []
    while candidates and len(found) < _MOST_ORDERS:
        to_basis, powers = {}, {}  # powers: of the residual, that each order explains
        for order, at in enumerate(columns_of_order, start=1):
            if order not in found:
                to_basis[order] = orthonormaliser(products[np.ix_(at, at)], _RANK_TOLERANCE)
                powers[order] = float(np.sum((to_basis[order].T @ correlation[at]) ** 2))
        best = max(candidates, key=lambda order: powers[order])
        if powers[best] < max(least, _OUTSTANDING * float(np.median(list(powers.values())))):
            break
        found.append(best)
        candidates.remove(best)
        at = columns_of_order[best - 1]
        # Gram-Schmidt process: subtract from all columns, and from the residual, their projection on the
        # columns of this order.
        coordinates = to_basis[best].T @ products[at]
        explained = to_basis[best].T @ correlation[at]
        products = products - coordinates.T @ coordinates
        correlation = correlation - coordinates.T @ explained
    return tuple(sorted(found))


def select_harmonics(harmonics: Array, orders: Sequence[int]) -> Array:
    """Cosine and sine of some orders.

    Parameters
    ----------
    harmonics : ndarray, shape (n, orders, 2)
        Result of :func:`turn_harmonics`.
    orders : sequence of int
        The selected orders.

    Returns
    -------
    ndarray, shape (n, 2 * k)
        Of k orders, in the order given.
    """
    selected = harmonics[:, [order - 1 for order in orders]]
    return np.ascontiguousarray(selected.reshape(len(harmonics), 2 * len(orders)))


def ripple_amplitudes(fit: JointFit, orders: Sequence[int], lead: float) -> tuple[RippleOrder, ...]:
    """Estimate the amplitude of each fitted order.

    Parameters
    ----------
    fit : JointFit
        Fit of a run; the torque drives its first block.
    orders : sequence of int
        The whole orders in it.
    lead : float
        Travel per turn of the motor, m.

    Returns
    -------
    tuple of RippleOrder
        Each amplitude, m/s², is the weight of the mode's response to the order over the gain of its response
        to the torque, for the mean of the accelerometers. It is None if the frequency of the order stays well
        below the mode during the test, or if a neighbouring order was found too, which indicates a single
        force between whole orders.
    """
    projection, b, mode = fit.projections[0], fit.blocks[0], fit.modes[0]
    weights, residual = projection.weights.mean(axis=1), projection.residual.mean(axis=1)
    to_basis = orthonormaliser(projection.columns.T @ projection.columns, _RANK_TOLERANCE)
    covariance = SAMPLES_PER_INDEPENDENT * b.mean_square(residual) * to_basis @ to_basis.T
    gain = _torque_gain(fit, weights)
    turns = 0.0  # per second, at full speed
    if lead > 0:
        turns = float(np.abs(b.windows.speed).max()) / lead
    out = []
    first = len(weights) - 2 * len(orders)  # the last weights are those of cosine and sine of each order
    for k, order in enumerate(orders):
        at = first + 2 * k + np.arange(2)
        weight = math.hypot(*weights[at])
        reaches_mode = order * turns >= _REACHED * mode.middle_frequency
        has_neighbour = any(0 < abs(other - order) <= _NEIGHBOUR for other in orders)
        if has_neighbour or not reaches_mode or weight < _ZERO or gain < _ZERO:
            out.append(RippleOrder(order, None, None, reaches_mode and has_neighbour))
            continue
        gradient = weights[at] / weight / gain  # of the amplitude by the two weights
        noise = math.sqrt(gradient @ covariance[np.ix_(at, at)] @ gradient)
        uncertainty = math.hypot(noise, _MODEL_ERROR[b.name] * weight / gain)
        out.append(RippleOrder(order, weight / gain, uncertainty))
    return tuple(out)


def _torque_gain(fit: JointFit, weights: Array) -> float:
    """Gain, at the mode's frequency, of a response over the simulated acceleration of the table.

    ``weights``, shape (columns,), are those of the columns of the first block in the response.
    """
    b, mode = fit.blocks[0], fit.modes[0]
    f = mode.middle_frequency
    derivative = 1j * math.sin(2 * math.pi * f / b.windows.rate)  # gain of central differences
    ratio = f / mode.pitch
    factors = [1, derivative]  # gains of the columns of the modes, in the order of raw_columns
    if b.name != "torque-motor":
        pitching = 1 / (1 - ratio**2 + 2j * mode.pitch_damping * ratio)
        factors += [derivative**2, pitching, pitching * derivative]
    return abs(complex(weights[: len(factors)] @ np.array(factors)))
