"""The change of the compliance in each cell, and its error terms.

Symbols are those of :mod:`ballscrew.estimation.compliance`: Y, s(x), u and the reference f₀, P₀.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ballscrew.base.arrays import Array

DECLARED_LOAD, POSITION = "declared load", "position"
"""Printed names of two error terms, whose errors are also possible causes of a change."""


@dataclass(frozen=True, slots=True, eq=False)
class ErrorTerm:
    """One source of error.

    Parameters
    ----------
    name : str
        As printed.
    random : bool
        Whether the error differs from run to run.
    effects : ndarray, shape (k, n)
        Effects on Y of n cells of k independent errors of this source, each of one standard deviation.
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
        Of each cell, m.
    condition : tuple of str
        PA, PD, NA or ND of each cell.
    motion : tuple of int
        Number of each cell's motion in the plan.
    y : ndarray, shape (n,)
        Y, relative.
    nut_share : ndarray, shape (n,)
        s(x) = dY/du, the nut's share of the compliance in the state of the reference.
    bearing_share : ndarray, shape (n,)
        The share of the support bearing, or of both bearings, in the state of the reference.
    log_slope : ndarray, shape (n,)
        d ln C/dx in the state of the reference, 1/m.
    by_load : ndarray, shape (n,)
        Change of Y per kg of load that was not declared, 1/kg.
    frequency : ndarray, shape (n,)
        f, Hz.
    moving_mass : float
        By the model, with the load, kg.
    terms : tuple of ErrorTerm
        Errors of Y, except that of the nut's share.
    floor : ndarray, shape (n,)
        Standard deviation of Y that each cell is given in addition, so that the covariance can be inverted.
    by_parameters : ndarray, shape (7, n), or None
        Derivatives of Y with respect to the model's working vector
        (:func:`ballscrew.axis.axial.to_vector`), where f₀ is the model's frequency; None where it is that of
        a run.
    own : ndarray, shape (n,), or None
        Standard deviation of Y by the errors of each cell that no other cell shares. The terms contain these
        errors too.
    """

    position: Array
    condition: tuple[str, ...]
    motion: tuple[int, ...]
    y: Array
    nut_share: Array
    bearing_share: Array
    log_slope: Array
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
        Whether the floor is included. With it the covariance can always be inverted; without it the cells may
        have fewer independent errors than there are cells.
    without : sequence of str
        Names of the terms to omit.

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
