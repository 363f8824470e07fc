"""The change of the compliance in every cell, and the sources of its errors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ballscrew.base.arrays import Array

__all__ = ["ComplianceChange", "Term", "covariance_of"]


@dataclass(frozen=True, slots=True, eq=False)
class Term:
    """One source of error.

    Parameters
    ----------
    name : str
        In words.
    random : bool
        Whether another run would draw it anew.
    effects : ndarray, shape (k, n)
        On Y of each cell, of k independent standard-normal causes.
    """

    name: str
    random: bool
    effects: Array


@dataclass(frozen=True, slots=True, eq=False)
class ComplianceChange:
    """The change of the compliance in n cells.

    Parameters
    ----------
    position : ndarray, shape (n,)
        m.
    condition : tuple of str
        Of each cell.
    motion : tuple of int
        Of each cell.
    y : ndarray, shape (n,)
        Y.
    nut : ndarray, shape (n,)
        s(x): what Y grows by u.
    bearing : ndarray, shape (n,)
        The thrust bearing's share of the compliance.
    along : ndarray, shape (n,)
        d ln C/dx, 1/m.
    mass : ndarray, shape (n,)
        What Y grows by each kg of load that is not declared, 1/kg.
    frequency : ndarray, shape (n,)
        f, Hz.
    terms : tuple of Term
        All that Y may err by, but not by the share.
    floor : ndarray, shape (n,)
        Standard deviation of Y below which no model is right.
    model : ndarray, shape (7, n), or None
        ∂Y by the working vector, where f₀ is the model's.
    own : ndarray, shape (n,), or None
        Standard deviation of Y by what is each cell's own; it is in the terms too.
    """

    position: Array
    condition: tuple[str, ...]
    motion: tuple[int, ...]
    y: Array
    nut: Array
    bearing: Array
    along: Array
    mass: Array
    frequency: Array
    terms: tuple[Term, ...]
    floor: Array
    model: Array | None = None
    own: Array | None = None


def covariance_of(change: ComplianceChange, *, floor: bool = True, less: Sequence[str] = ()) -> Array:
    """Covariance of Y.

    Parameters
    ----------
    change : ComplianceChange
        Of n cells.
    floor : bool
        Whether the floor is in it.
    less : sequence of str
        Terms that are left out.

    Returns
    -------
    ndarray, shape (n, n)
        Regular with the floor.
    """
    whole = np.diag(change.floor**2) if floor else np.zeros((len(change.y), len(change.y)))
    for term in change.terms:
        if term.name not in less:
            whole = whole + term.effects.T @ term.effects
    return np.asarray(whole)
