"""How the axial natural frequency answers to everything that it depends on: derivatives of Eq. (3)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ballscrew.axis.equations import Theta, frequency_from_preload, oscillating_mass
from ballscrew.base.arrays import Array

__all__ = ["Derivatives", "derivatives", "sensitivity", "theta_jacobian", "theta_rank"]


@dataclass(frozen=True, slots=True, eq=False)
class Derivatives:
    """Partial derivatives of f_a, each of the shape of the points.

    Parameters
    ----------
    x_t : ndarray
        ∂f/∂x_t, Hz/m.
    preload : ndarray
        ∂f/∂P, Hz/N.
    m_t : ndarray
        ∂f/∂m_t, Hz/kg.
    a, b, c, d : ndarray
        By θ: Hz per unit of each.
    """

    x_t: Array
    preload: Array
    m_t: Array
    a: Array
    b: Array
    c: Array
    d: Array


def derivatives(
    x_t: ArrayLike, preload: ArrayLike, m_t: ArrayLike, theta: Theta, *, rotor_mass: float = np.inf
) -> Derivatives:
    """Partial derivatives of Eq. (3), in closed form.

    ln f = (ln c − ln S − ln m) / 2 with S = P^(−1/3) − a x_t − b and 1/m = 1/(m_t + d) + 1/m_r.

    Parameters
    ----------
    x_t, preload, m_t : array_like
        Axis position, m; preload, N; moving mass, kg.
    theta : Theta
        Of the axis.
    rotor_mass : float
        m_r, kg; infinite where the rotor is held, which is Eq. (3).

    Returns
    -------
    Derivatives
        Of the shape that the points broadcast to.

    Raises
    ------
    InputError
        If an argument is no possible value.
    """
    f = frequency_from_preload(x_t, preload, m_t, theta, rotor_mass=rotor_mass)
    x, force, mass = (
        np.broadcast_to(np.asarray(part, dtype=np.float64), f.shape) for part in (x_t, preload, m_t)
    )
    softness = np.cbrt(1 / force) - theta.a * x - theta.b
    by_mass = -f / 2 * oscillating_mass(mass, theta, rotor_mass) / (mass + theta.d) ** 2
    by_b = f / 2 / softness
    return Derivatives(
        x_t=theta.a * by_b,
        preload=np.cbrt(1 / force) / (3 * force) * by_b,
        m_t=by_mass,
        a=x * by_b,
        b=by_b,
        c=f / 2 / theta.c,
        d=by_mass,
    )


def sensitivity(x_t: ArrayLike, preload: ArrayLike, theta: Theta) -> Array:
    """Return d ln f / d ln P = s/6, s = P^(−1/3) / (P^(−1/3) − a x_t − b) the nut's share of the compliance.

    It depends neither on the masses nor on whether the rotor is held.

    Parameters
    ----------
    x_t, preload : array_like
        Axis position, m; preload, N.
    theta : Theta
        Of the axis.

    Returns
    -------
    ndarray
        Between 0 and 1/6; its inverse is by how many per cent the preload is wrong for a per cent of f.

    Raises
    ------
    InputError
        If an argument is no possible value.
    """
    force = np.asarray(preload, dtype=np.float64)
    f = frequency_from_preload(x_t, force, 1.0, theta)
    return np.asarray(force / f * derivatives(x_t, force, 1.0, theta).preload)


def theta_jacobian(
    x_t: ArrayLike, preload: ArrayLike, m_t: ArrayLike, theta: Theta, *, rotor_mass: float = np.inf
) -> Array:
    r"""∂ ln f / ∂ ln \|θ\| at n points of known preload.

    Parameters
    ----------
    x_t, preload, m_t : array_like
        The points: axis position, m; preload, N; moving mass, kg.
    theta : Theta
        About which it is taken.
    rotor_mass : float
        m_r, kg; infinite where the rotor is held.

    Returns
    -------
    ndarray, shape (n, 4)
        Columns a, b, c, d.

    Raises
    ------
    InputError
        If an argument is no possible value.
    """
    slopes = derivatives(x_t, preload, m_t, theta, rotor_mass=rotor_mass)
    f = frequency_from_preload(x_t, preload, m_t, theta, rotor_mass=rotor_mass)
    columns = (theta.a * slopes.a, theta.b * slopes.b, theta.c * slopes.c, theta.d * slopes.d)
    return np.stack([np.ravel(column / f) for column in columns], axis=1)


def theta_rank(
    x_t: ArrayLike, preload: ArrayLike, m_t: ArrayLike, theta: Theta, *, rotor_mass: float = np.inf
) -> int:
    """How many of θ's four parameters frequencies at these points can tell.

    At one preload the answer is 3 at most: scale a, P^(−1/3) − b and c by one factor, and every frequency
    stays as it was. A second known preload settles it.

    Parameters
    ----------
    x_t, preload, m_t : array_like
        The points: axis position, m; known preload, N; moving mass, kg.
    theta : Theta
        About which the rank is taken.
    rotor_mass : float
        m_r, kg; infinite where the rotor is held.

    Returns
    -------
    int
        Rank of :func:`theta_jacobian`, each column divided by its length.

    Raises
    ------
    InputError
        If an argument is no possible value.
    """
    jacobian = theta_jacobian(x_t, preload, m_t, theta, rotor_mass=rotor_mass)
    lengths = np.linalg.norm(jacobian, axis=0)
    return int(np.linalg.matrix_rank(jacobian / np.where(lengths > 0, lengths, 1.0), tol=1e-9))
