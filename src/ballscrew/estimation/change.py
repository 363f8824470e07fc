"""The change of the compliance in every cell, and the sources of its errors.

Symbols are those of :mod:`ballscrew.estimation.compliance`: Y, s(x), u and the reference f₀, P₀.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ballscrew.base.arrays import Array

DECLARED_LOAD, POSITION = "declared load", "position"
"""Names of two error terms, as printed, that are also compared as causes of a change."""


@dataclass(frozen=True, slots=True, eq=False)
class ErrorTerm:
    """One source of error.

    Parameters
    ----------
    name : str
        As printed.
    random : bool
        Whether it differs from run to run.
    effects : ndarray, shape (k, n)
        Effects of k independent standard-normal errors on Y of n cells.
    """

    name: str
    random: bool
    effects: Array


@dataclass(frozen=True, slots=True, eq=False)
class ComplianceChange:
    """The change Y = (f₀/f)² − 1 of the compliance in n cells.

    Parameters
    ----------
    position : ndarray, shape (n,)
        m.
    condition : tuple of str
        PA, PD, NA or ND of each cell.
    motion : tuple of int
        Number of each cell's motion in the plan.
    y : ndarray, shape (n,)
        Y.
    nut : ndarray, shape (n,)
        s(x) = dY/du, the nut's share of the compliance in the state of the reference.
    bearing : ndarray, shape (n,)
        The thrust bearing's share of the same.
    slope : ndarray, shape (n,)
        d ln C/dx, 1/m.
    by_load : ndarray, shape (n,)
        Change of Y per kg of load that was not declared, 1/kg.
    frequency : ndarray, shape (n,)
        f, Hz.
    moving_mass : float
        Of the model, with the load, kg.
    terms : tuple of ErrorTerm
        Every error of Y except that of the nut's share.
    floor : ndarray, shape (n,)
        Standard deviation of Y in each cell by which every model deviates from it.
    by_parameters : ndarray, shape (7, n), or None
        Derivatives of Y by the model's working vector (:func:`ballscrew.axis.axial.to_vector`), where f₀ is
        the model's frequency.
    own : ndarray, shape (n,), or None
        Standard deviation of Y by the errors of each cell that no other cell shares; the terms contain them.
    """

    position: Array
    condition: tuple[str, ...]
    motion: tuple[int, ...]
    y: Array
    nut: Array
    bearing: Array
    slope: Array
    by_load: Array
    frequency: Array
    moving_mass: float
    terms: tuple[ErrorTerm, ...]
    floor: Array
    by_parameters: Array | None = None
    own: Array | None = None


def change_covariance(change: ComplianceChange, *, floor: bool = True, without: Sequence[str] = ()) -> Array:
    """Covariance of Y.

    Parameters
    ----------
    change : ComplianceChange
        Of n cells.
    floor : bool
        Whether the floor is included; with it the covariance can be inverted.
    without : sequence of str
        Names of terms to leave out.

    Returns
    -------
    ndarray, shape (n, n)
        Symmetric.
    """
    covariance = np.zeros((len(change.y), len(change.y)))
    if floor:
        covariance += np.diag(change.floor**2)
    for term in change.terms:
        if term.name not in without:
            covariance += term.effects.T @ term.effects
    return covariance
