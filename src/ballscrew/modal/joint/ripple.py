"""Ripple: forces of the motor that repeat with every turn of the screw, and that no channel measures.

Cogging, poles and slots push with whole orders of a turn, where the motor is, and alike in every trip:
averaging over repetitions does not remove them. The drive reports the torque computed from its currents,
not this. While the axis accelerates, an order sweeps through the mode. A sine and a cosine of each order
drive the spring together with the torque; their amplitudes are linear parameters, solved at every step of
the fit.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ballscrew.base.arrays import Array
from ballscrew.modal.joint.blocks import make_block, orthonormaliser, project, raw_columns, whiten
from ballscrew.modal.joint.fit import CLEARLY, SAMPLES_PER_INDEPENDENT, JointFit
from ballscrew.modal.joint.initial import FREQUENCY_SCALES, InitialValues
from ballscrew.modal.joint.local_wear import UNKNOWN, LocalVariation
from ballscrew.modal.joint.mode import INITIAL_DAMPING, AxialMode, compliance_of
from ballscrew.modal.joint.profile import Profile, fit_profile
from ballscrew.modal.joint.result import RippleOrder
from ballscrew.modal.joint.signals import TripSignals
from ballscrew.modal.joint.windows import Windows, subset

_HIGHEST = 36  # order
_MOST_ORDERS = 5
_LEAST = 0.004  # of the residual's power: a smaller order moves no frequency
_CHANCE = 20.0  # times an independent sample's power: by chance once in 2000 orders or less
_OUTSTANDING = 12.0  # times the median order, since the residual is not white
_RANK = 1e-6  # of the largest eigenvalue: smaller ones are taken for rounding
_ROUNDS = 3
_ITERATIONS = 6
_POOR = 0.05  # of the power of the response: where more is unexplained, the mode may be a wrong one

# Relative error of an amplitude, by the testbed.
_MODEL_ERROR = {"torque-nut": 0.04, "torque-motor": 0.07}
_REACHED = 0.65  # of the mode's frequency at full speed: below it, the two columns of an order are too alike
_NEIGHBOUR = 3  # difference of orders that one fractional order may excite
_ZERO = 1e-12  # m/s²


@dataclass(frozen=True, slots=True)
class RippleFit:
    """A fit with ripple: the fit, the local variation of its priors, and the orders in it."""

    fit: JointFit
    variation: LocalVariation
    orders: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True)
class RippleModel:
    """Selects the orders of a run and fits them with the mode, until the selection no longer changes.

    Parameters
    ----------
    trips : sequence of TripSignals
        The run.
    names : sequence of str
        Blocks.
    departures : bool
        Whether departures count from standstill on.
    initial : InitialValues
        The lead, and the frequency to search again if ripple was taken for the mode.
    profile : Profile
        What is free.
    """

    trips: Sequence[TripSignals]
    names: Sequence[str]
    departures: bool
    initial: InitialValues
    profile: Profile

    def fit(self, now: JointFit, variation: LocalVariation) -> RippleFit:
        """Add the significant orders to a fit without ripple."""
        w = now.blocks[0].windows
        harmonics = turn_harmonics(self.trips, w, self.initial.lead)
        found = self._iterate(w, harmonics, now.modes, variation, now)
        if not harmonics.size or found.fit.solved[0].unexplained < _POOR:
            return found
        # At constant speed an order is a tone, and may have been taken for the mode.
        modes = self._search_mode(subset(w), now.modes)
        other = self._iterate(w, harmonics, modes, UNKNOWN, None)
        if other.fit.log_residual < found.fit.log_residual + CLEARLY:
            return other
        return found

    def _iterate(
        self,
        w: Windows,
        harmonics: Array,
        modes: tuple[AxialMode, ...],
        variation: LocalVariation,
        now: JointFit | None,
    ) -> RippleFit:
        """Select and fit in turns, beginning with a fit without ripple if there is one."""
        orders: tuple[int, ...] = ()
        for turn in range(_ROUNDS):
            before = orders
            orders = select_orders(self.names[0], w, self.departures, modes[0], harmonics)
            # The first fit did not count departures.
            if now is not None and orders == before and (turn > 0 or not self.departures):
                break
            forces = _columns(harmonics, orders)
            blocks = [make_block(name, w, departures=self.departures, ripple=forces) for name in self.names]
            now, variation = fit_profile(blocks, modes, self.profile, variation, _ITERATIONS)
            modes = now.modes
        assert now is not None  # noqa: S101  the first turn fits if there was no fit
        return RippleFit(now, variation, orders)

    def _search_mode(self, w: Windows, modes: tuple[AxialMode, ...]) -> tuple[AxialMode, ...]:
        """The rotor-free mode that leaves least, at any frequency, with the best orders for each.

        The motor's motion contains the ripple, so the mode that it drives gives slope and damping.
        """
        base = replace(modes[0], slope=self.initial.slope, curve=0.0)
        if len(modes) > 1:
            base = modes[1]
        base = replace(base, damping=INITIAL_DAMPING, power=0.0, load=self.initial.load, places=(), local=())
        harmonics = turn_harmonics(self.trips, w, self.initial.lead)
        name = self.names[0]
        least, best = math.inf, base
        for scale in FREQUENCY_SCALES:
            mode = replace(base, compliance=compliance_of(self.initial.rotor_free * scale))
            orders = select_orders(name, w, self.departures, mode, harmonics)
            forces = _columns(harmonics, orders)
            block = make_block(name, w, departures=self.departures, ripple=forces)
            power = float(np.sum(project(block, mode).residual ** 2))
            if power < least:
                least, best = power, mode
        return (best, *modes[1:])


def turn_harmonics(trips: Sequence[TripSignals], w: Windows, lead: float) -> Array:
    """Cosine and sine of the orders of a turn, averaged over the trips like all signals.

    Parameters
    ----------
    trips : sequence of TripSignals
        The run.
    w : Windows
        Its averages.
    lead : float
        Travel per turn, m; 0 if it is not known.

    Returns
    -------
    ndarray, shape (n, orders, 2)
        From the first order on; 0 at the start of a window. No orders without a lead.
    """
    if not lead > 0:
        return np.empty((len(w.place), 0, 2))
    out = np.empty((len(w.place), _HIGHEST, 2))
    for (start, stop), pieces in zip(w.spans, w.pieces, strict=True):
        total = np.zeros((stop - start, _HIGHEST), complex)
        for trip, first in pieces:
            position = trips[trip].position[first : first + stop - start]
            fundamental = np.exp(2j * math.pi / lead * position)
            total += np.cumprod(np.repeat(fundamental[:, None], _HIGHEST, axis=1), axis=1)
        mean = (total - total[0]) / len(pieces)
        out[start:stop, :, 0], out[start:stop, :, 1] = mean.real, mean.imag
    return out


def select_orders(
    name: str, w: Windows, departures: bool, mode: AxialMode, harmonics: Array
) -> tuple[int, ...]:
    """Orders that explain a significant part of the residual of a block without ripple.

    Parameters
    ----------
    name, w, departures
        Of the block, as for :func:`~ballscrew.modal.joint.blocks.make_block`; driven by the torque.
    mode : AxialMode
        The mode, as far as it is known.
    harmonics : ndarray, shape (n, orders, 2)
        See :func:`turn_harmonics`.

    Returns
    -------
    tuple of int
        Ascending. Selected one by one, the most significant first, each orthogonal to those before.
    """
    count = harmonics.shape[1]
    if count == 0:
        return ()
    b = make_block(name, w, departures=departures)
    solved = project(b, mode)
    residual = solved.residual
    independent = max(int(b.counted.sum()), 1) / SAMPLES_PER_INDEPENDENT
    least = max(_LEAST, _CHANCE / independent) * float(np.sum(residual**2))
    forces = harmonics.reshape(len(harmonics), 2 * count)
    with_ripple = make_block(name, w, departures=departures, ripple=forces)
    raw = raw_columns(with_ripple, mode)[:, solved.raw.shape[1] :]
    columns = whiten(b, raw, solved.free)
    columns -= solved.basis @ (solved.basis.T @ columns)
    # Columns of one order: cosine and sine, in the band and through the mode.
    of_order = np.arange(columns.shape[1]).reshape(-1, count, 2).transpose(1, 0, 2).reshape(count, -1)
    products, correlation = columns.T @ columns, columns.T @ residual  # all that follows needs
    found: list[int] = []
    while len(found) < _MOST_ORDERS:
        bases, gains = {}, {}
        for k, at in enumerate(of_order):
            if k + 1 not in found:
                bases[k] = orthonormaliser(products[np.ix_(at, at)], _RANK)
                gains[k] = float(np.sum((bases[k].T @ correlation[at]) ** 2))
        best = max(gains, key=lambda k: gains[k])
        if gains[best] < max(least, _OUTSTANDING * float(np.median(list(gains.values())))):
            break
        found.append(best + 1)
        at = of_order[best]
        # Gram and Schmidt: the other columns without their parts along those of the order.
        projection, explained = bases[best].T @ products[at], bases[best].T @ correlation[at]
        products, correlation = products - projection.T @ projection, correlation - projection.T @ explained
    return tuple(sorted(found))


def _columns(harmonics: Array, orders: Sequence[int]) -> Array:
    """Cosine and sine of these orders, shape (n, 2 * orders)."""
    selected = harmonics[:, [order - 1 for order in orders]]
    return np.ascontiguousarray(selected.reshape(len(harmonics), 2 * len(orders)))


def ripple_amplitudes(found: JointFit, orders: Sequence[int], lead: float) -> tuple[RippleOrder, ...]:
    """Amplitude of each fitted order.

    Parameters
    ----------
    found : JointFit
        Of a run; its first block is driven by the torque.
    orders : sequence of int
        The orders in it.
    lead : float
        Of the screw, m.

    Returns
    -------
    tuple of RippleOrder
        Response of the mode to the order over that to the torque, in the mean of the responses. Without an
        amplitude if the order stays well below the mode, where its columns in the band and through the mode
        are alike, and if a neighbouring order was found, which indicates a fractional order.
    """
    solved, b, mode = found.solved[0], found.blocks[0], found.modes[0]
    weights, residual = solved.weights.mean(axis=1), solved.residual.mean(axis=1)
    to_basis = orthonormaliser(solved.columns.T @ solved.columns, _RANK)
    covariance = SAMPLES_PER_INDEPENDENT * float(np.mean(residual**2)) * to_basis @ to_basis.T
    gain = _torque_gain(found, weights)
    turns = float(np.abs(b.windows.speed).max()) / lead if lead > 0 else 0.0
    out = []
    for k, order in enumerate(orders):
        at = len(weights) - 2 * (len(orders) - k) + np.arange(2)
        size = math.hypot(*weights[at])
        near = order * turns >= _REACHED * mode.centre
        alone = not any(0 < abs(other - order) <= _NEIGHBOUR for other in orders)
        if not alone or not near or size < _ZERO or gain < _ZERO:
            out.append(RippleOrder(order, None, None, near and not alone))
            continue
        slope = weights[at] / size / gain
        noise = math.sqrt(slope @ covariance[np.ix_(at, at)] @ slope)
        out.append(RippleOrder(order, size / gain, math.hypot(noise, _MODEL_ERROR[b.name] * size / gain)))
    return tuple(out)


def _torque_gain(found: JointFit, weights: Array) -> float:
    """Gain of the response to the torque at the mode, over that of the table's acceleration."""
    b, mode = found.blocks[0], found.modes[0]
    f = mode.centre
    derivative, ratio = 1j * math.sin(2 * math.pi * f / b.windows.rate), f / mode.pitch
    factors = [1, derivative]
    if b.name != "torque-motor":
        pitching = 1 / (1 - ratio**2 + 2j * mode.pitch_damping * ratio)
        factors += [derivative**2, pitching, pitching * derivative]
    return abs(complex(weights[: len(factors)] @ np.array(factors)))
