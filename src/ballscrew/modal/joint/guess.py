"""What a data sheet, or nothing, says before the data are looked at."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ballscrew.axis.frequency import nut_share, predicted_frequency
from ballscrew.axis.model import moving_mass, rotor_mass, screw_part
from ballscrew.axis.sheet import DataSheet
from ballscrew.axis.tolerances import with_uncertainty
from ballscrew.modal.joint.signals import TripSignals

__all__ = ["Guess", "guess", "least_load", "whole_mass"]

_SMOOTH = 0.01  # s
_MOVING = 0.1  # of the highest speed
_PRELOADS = np.geomspace(1e-6, 1.0, 241)  # of the nominal one
_DOUBT = 2.0  # standard uncertainties by which the data sheet may predict too high a frequency


@dataclass(frozen=True, slots=True)
class Guess:
    """What is expected.

    Parameters
    ----------
    free, held : float
        Frequencies in the middle of the axis, rotor free and held, Hz.
    slope : float
        Of the compliance along the axis, relative, 1/m.
    load : float
        On the nut over its preload, per m/s² of the table; 0 where nothing is known.
    nut : float
        The nut's compliance in the middle over that of all else, at a load of 1 per m/s².
    rubbing : float
        Friction on the table, as an acceleration, m/s².
    lead : float
        Of the screw, m; 0 where nothing is known.
    """

    free: float
    held: float
    slope: float
    load: float = 0.0
    nut: float = 0.0
    rubbing: float = 0.0
    lead: float = 0.0


def guess(sheet: DataSheet, load: float, low: float, high: float) -> Guess:
    """From a data sheet, for a table that moves from ``low`` to ``high``, m."""
    middle = (low + high) / 2
    at, first, last = (float(predicted_frequency(sheet, x, load)) for x in (middle, low, high))
    slope = ((at / last) ** 2 - (at / first) ** 2) / (high - low)
    table = float(moving_mass(sheet, load)) + screw_part(sheet)
    held = at * math.sqrt(rotor_mass(sheet) / (rotor_mass(sheet) + table))
    share = float(nut_share(sheet, middle))
    load = table / sheet.nominal_preload
    nut = share / (1 - share) / load ** (1 / 3)
    return Guess(at, held, slope, load, nut, sheet.guide.friction / table, sheet.screw.lead)


def least_load(sheet: DataSheet, load: float, position: float, frequency: float) -> float:
    """The least load on the nut over its preload, per m/s² of the table, that a frequency allows.

    The fit may find a nut sound that rings far lower than a sound one can: then the sheet, as wrong as its
    tolerances let it be, still says how much of the preload can be left at most.

    Parameters
    ----------
    sheet : DataSheet
        Of the axis.
    load : float
        On the table, kg.
    position : float
        Of the table, m.
    frequency : float
        Found there, rotor free, Hz.

    Returns
    -------
    float
        As :attr:`Guess.load`.
    """
    expected = with_uncertainty(sheet, position, load)
    highest = frequency * (1 + _DOUBT * float(expected.standard_uncertainty / expected.value))
    preloads = _PRELOADS * sheet.nominal_preload
    curve = predicted_frequency(sheet, position, load, preloads)
    most = float(np.interp(highest, curve, preloads))
    return (float(moving_mass(sheet, load)) + screw_part(sheet)) / most


def whole_mass(trips: Sequence[TripSignals]) -> float | None:
    """Whole inertia, in units of force per m/s²: least squares over all that moves, friction beside it."""
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
    # Trips of one way do not tell Coulomb friction from an offset: both are left out of account together.
    if np.linalg.matrix_rank(sums) - np.linalg.matrix_rank(sums[1:, 1:]) < 1:
        return None
    mass = float(np.linalg.lstsq(sums, products, rcond=None)[0][0])
    return mass if abs(mass) > 0 else None
