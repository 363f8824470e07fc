"""Expected frequency, excitation and nut load of every cell of a plan on an axis."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ballscrew.axis.frequency import predicted_modes
from ballscrew.axis.hertz import RELEASE
from ballscrew.axis.rigidity import at_preload, release_ratio
from ballscrew.axis.sheet import DataSheet
from ballscrew.axis.tolerances import with_uncertainty
from ballscrew.fcft.cells import cells
from ballscrew.fcft.conditions import Condition
from ballscrew.fcft.excitation import mean_blow_spectrum
from ballscrew.fcft.nutload import hardest, nut_load, ringing_load
from ballscrew.fcft.plan import Motion, Plan
from ballscrew.fcft.schedule import trips

_BAND = 0.05  # of f, within which the mode is looked for where the data sheet claims to be surer
_LINES = 41  # across that band


@dataclass(frozen=True, slots=True)
class ExpectedCell:
    r"""One cell of a plan, with its expected frequency, excitation and nut load.

    Parameters
    ----------
    mass : float
        Load on the table, kg.
    position : float
        The stop, m.
    condition : Condition
        How the table reaches or leaves it.
    motion : int
        Which of the plan's motions, from 0.
    frequency : float
        Axial natural frequency that the data sheet predicts, rotor free, nut unloaded, Hz.
    standard_uncertainty : float
        Standard uncertainty of the frequency, from the data sheet's tolerances, Hz.
    second_frequency : float or None
        Frequency of the mode that a test may show in its place, Hz; None where one is clearly the axial mode.
    excitation : float
        Spectrum of the torque at that frequency, over that of a jerk without duration; 0 is a null.
    least_excitation : float
        The least of it within two standard uncertainties (5 % at least) of that frequency.
    nut_load : float
        F while the acceleration is held, N; of the hardest repetition.
    nut_load_ratio : float
        \|F\|/P.
    nut_load_shift : float
        By how much the load under which the mode rings moves the frequency, Hz: at a departure F, at an
        arrival what friction leaves. Negative up to 8 P; all of the frequency where a nut preloaded by a
        spring loses contact.
    preload : float
        P, N: the nominal one, or that of the plan.
    """

    mass: float
    position: float
    condition: Condition
    motion: int
    frequency: float
    standard_uncertainty: float
    second_frequency: float | None
    excitation: float
    least_excitation: float
    nut_load: float
    nut_load_ratio: float
    nut_load_shift: float
    preload: float


def executed(plan: Plan, motion: int) -> tuple[Motion, ...]:
    """A motion as each repetition runs it."""
    return tuple(trip.executed for trip in trips(plan) if trip.repetition and trip.motion == motion)


def least_excitation(
    frequency: ArrayLike, standard_uncertainty: ArrayLike, motions: Sequence[Motion]
) -> NDArray[np.float64]:
    """The least that the blows excite a mode whose frequency is not known exactly.

    Parameters
    ----------
    frequency, standard_uncertainty : array_like
        Frequency of the mode and its uncertainty, Hz.
    motions : sequence of Motion
        As each repetition runs it.

    Returns
    -------
    ndarray
        Least of :func:`~ballscrew.fcft.excitation.mean_blow_spectrum` within two standard uncertainties,
        or 5 % where that is more; of the shape of ``frequency``.
    """
    f, u = np.asarray(frequency, dtype=np.float64), np.asarray(standard_uncertainty, dtype=np.float64)
    half = np.maximum(2 * u, _BAND * f)
    band = f[..., None] + half[..., None] * np.linspace(-1, 1, _LINES)
    return np.asarray(mean_blow_spectrum(band, motions).min(axis=-1))


def expected_cells(plan: Plan, sheet: DataSheet) -> tuple[ExpectedCell, ...]:
    """All cells of a plan with frequency, excitation and nut load.

    Parameters
    ----------
    plan : Plan
        The test.
    sheet : DataSheet
        The axis; every stop must lie on its screw.

    Returns
    -------
    tuple of ExpectedCell
        By preload, and then in the order of :func:`~ballscrew.fcft.cells.cells`.

    Raises
    ------
    InputError
        If a stop is not on the screw.
    """
    if plan.preloads:
        single = replace(plan, preloads=())
        settings = (at_preload(sheet, preload) for preload in plan.preloads)
        return tuple(cell for setting in settings for cell in expected_cells(single, setting))
    positions, masses = np.asarray(plan.positions), np.asarray(plan.masses)
    predicted = with_uncertainty(sheet, positions[None, :], masses[:, None])
    frequency, spread, ambiguous = predicted.value, predicted.standard_uncertainty, predicted.ambiguous
    runs = [executed(plan, index) for index in range(len(plan.motions))]
    spectrum = [mean_blow_spectrum(frequency, motions) for motions in runs]
    least = [least_excitation(frequency, spread, motions) for motions in runs]

    @cache
    def under_load(mass: float, force: float) -> NDArray[np.float64]:
        preload, outer = sheet.nominal_preload, force
        if release_ratio(sheet.screw) < RELEASE:
            # Of a nut with a spring the one flank that carries is under P - F in one direction.
            preload, outer = preload - abs(force), 0.0
        if preload <= 0:
            return np.zeros_like(positions)
        loaded = predicted_modes(sheet, positions, mass, preload, nut_load=outer)
        return loaded.nearest(frequency[plan.masses.index(mass)])

    found = []
    for cell in cells(plan):
        at = plan.masses.index(cell.mass), plan.positions.index(cell.position)
        motion = hardest(runs[cell.motion])
        force = nut_load(sheet, motion, cell.mass, cell.condition)
        ringing = ringing_load(sheet, motion, cell.mass, cell.condition)
        loaded = float(under_load(cell.mass, ringing)[at[1]])
        found.append(
            ExpectedCell(
                mass=cell.mass,
                position=cell.position,
                condition=cell.condition,
                motion=cell.motion,
                frequency=float(frequency[at]),
                standard_uncertainty=float(spread[at]),
                second_frequency=float(predicted.second_frequency[at]) if ambiguous[at] else None,
                excitation=float(spectrum[cell.motion][at]),
                least_excitation=float(least[cell.motion][at]),
                nut_load=force,
                nut_load_ratio=abs(force) / sheet.nominal_preload,
                nut_load_shift=loaded - float(frequency[at]),
                preload=sheet.nominal_preload,
            )
        )
    return tuple(found)
