"""Eqs. (2) and (3) of the paper in θ = {a, b, c, d}, and the same with a rotor that is free to turn.

At the same position and mass, with the same rotor, only the nut's part of Eq. (3) changes:

    (f₀/f)² = C/C₀ = 1 + s₀ [(P/P₀)^(−1/3) − 1],

s₀ the nut's share of the whole axial compliance C₀ at P₀. Masses, geometry and the maker's K act through s₀
alone. An error of s₀ scales a loss, it does not change its sign.

Han, Miller, Vogl, Chen and Jia, *Robust feature design for early detection of ball screw preload loss*, 2024.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ballscrew.axis.given import finite, positive, together
from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError
from ballscrew.base.settings import check_setting


@dataclass(frozen=True, slots=True)
class Theta:
    """θ = {a, b, c, d} of Eqs. (2) and (3).

    Parameters
    ----------
    a : float
        −κ × compliance of the shaft per length, N^(−1/3)/m; negative.
    b : float
        −κ × all other compliance but the nut's, N^(−1/3); negative.
    c : float
        κ / 4π², N^(2/3)/m; positive.
    d : float
        Moving mass besides table, nut and load: a third of the screw's mass, kg; 0 or more.

    Raises
    ------
    InputError
        If a or b is above 0, c not above 0, d below 0, or one no finite number.
    """

    a: float
    b: float
    c: float
    d: float

    def __post_init__(self) -> None:
        """Refuse values that no axis has."""
        check_setting("a of θ", self.a, most=0)
        check_setting("b of θ", self.b, most=0)
        check_setting("c of θ", self.c, above=0)
        check_setting("d of θ", self.d, least=0)


def preload_at_frequency(
    x_t: ArrayLike, f_a: ArrayLike, m_t: ArrayLike, theta: Theta, *, rotor_mass: float = np.inf
) -> Array:
    """Preload of the nut, Eq. (2): P = [a x_t + b + c / (f_a² m)]^(−3).

    m is m_t + d where the rotor is held, as the paper has it. Where the rotor is free, 1/m is
    1/(m_t + d) + 1/m_r.

    Parameters
    ----------
    x_t : array_like
        Axis position, m.
    f_a : array_like
        Axial natural frequency, undamped, Hz.
    m_t : array_like
        Moving mass: table, nut and load, kg.
    theta : Theta
        Parameters of the axis.
    rotor_mass : float
        m_r, kg; infinite where the rotor is held.

    Returns
    -------
    ndarray
        P, N, of the shape that the arguments broadcast to.

    Raises
    ------
    InputError
        If a frequency lies at or above the limit of a nut without any compliance, where no preload explains
        it, or an argument is no possible value.
    """
    x, f, mass = together(
        position=finite("position", x_t, "m"),
        frequency=positive("frequency", f_a, "Hz"),
        moving_mass=positive("moving mass", m_t, "kg"),
    )
    moving = oscillating_mass(mass, theta, rotor_mass)
    softness = theta.a * x + theta.b + theta.c / (f**2 * moving)
    bad = ~(softness > 0)
    if np.any(bad):
        limit = limit_frequency(x, mass, theta, rotor_mass=rotor_mass)
        raise InputError(
            f"a frequency of {f[bad].flat[0]:.6g} Hz was given; it must lie below {limit[bad].flat[0]:.6g} "
            "Hz, where the nut would have no compliance at all."
        )
    return np.asarray(softness**-3)


def frequency_from_preload(
    x_t: ArrayLike, preload: ArrayLike, m_t: ArrayLike, theta: Theta, *, rotor_mass: float = np.inf
) -> Array:
    """Axial natural frequency, Eq. (3): f_a² m = c / (P^(−1/3) − a x_t − b).

    Parameters
    ----------
    x_t : array_like
        Axis position, m.
    preload : array_like
        P, N.
    m_t : array_like
        Moving mass: table, nut and load, kg.
    theta : Theta
        Parameters of the axis.
    rotor_mass : float
        m_r, kg; infinite where the rotor is held, which is Eq. (3).

    Returns
    -------
    ndarray
        f_a, Hz, of the shape that the arguments broadcast to.

    Raises
    ------
    InputError
        If an argument is no possible value.
    """
    x, force, mass = together(
        position=finite("position", x_t, "m"),
        preload=positive("preload", preload, "N"),
        moving_mass=positive("moving mass", m_t, "kg"),
    )
    return _frequency(np.cbrt(1 / force), x, mass, theta, rotor_mass)


def limit_frequency(x_t: ArrayLike, m_t: ArrayLike, theta: Theta, *, rotor_mass: float = np.inf) -> Array:
    """Frequency of an axis whose nut has no compliance: Eq. (3) as P grows without end.

    Parameters
    ----------
    x_t : array_like
        Axis position, m.
    m_t : array_like
        Moving mass, kg.
    theta : Theta
        Parameters of the axis.
    rotor_mass : float
        m_r, kg.

    Returns
    -------
    ndarray
        Hz; no measured frequency can lie above it.
    """
    x, mass = together(position=finite("position", x_t, "m"), moving_mass=positive("moving mass", m_t, "kg"))
    return _frequency(np.zeros_like(x), x, mass, theta, rotor_mass)


def oscillating_mass(m_t: ArrayLike, theta: Theta, rotor_mass: float = np.inf) -> Array:
    """The mass m of Eq. (3): m_t + d with the rotor held; less where a free rotor swings against it.

    Parameters
    ----------
    m_t : array_like
        Moving mass, kg.
    theta : Theta
        Gives d.
    rotor_mass : float
        m_r, kg; infinite where the rotor is held.

    Returns
    -------
    ndarray
        kg, the shape of ``m_t``.

    Raises
    ------
    InputError
        If a mass is not more than 0, or is NaN.
    """
    mass = positive("moving mass", m_t, "kg")
    if not rotor_mass > 0:
        raise InputError(
            f"a rotor mass of {rotor_mass:g} kg was given; it must be more than 0 kg, or infinite."
        )
    return np.asarray(1 / (1 / (mass + theta.d) + 1 / rotor_mass))


def preload_change(frequency: ArrayLike, reference_frequency: ArrayLike, nut_share: ArrayLike) -> Array:
    """P/P₀ = [1 + ((f₀/f)² − 1) / s₀]⁻³.

    Parameters
    ----------
    frequency : array_like
        f, Hz.
    reference_frequency : array_like
        f₀, at the same position and mass, Hz.
    nut_share : array_like
        s₀, the nut's share of the axial compliance at the reference, above 0, 1 at most.

    Returns
    -------
    ndarray
        P/P₀.

    Raises
    ------
    InputError
        If a number cannot be, or a frequency lies at or above f₀ / √(1 − s₀), that of an infinitely stiff
        nut, where no preload belongs to it.
    """
    f, f0 = positive("frequency", frequency, "Hz"), positive("reference frequency", reference_frequency, "Hz")
    f, f0, share = np.broadcast_arrays(f, f0, _share(nut_share))
    bracket = 1 + ((f0 / f) ** 2 - 1) / share
    if not np.all(bracket > 0):
        wrong = ~(bracket > 0)
        given = f[wrong].flat[0]
        limit = f0[wrong].flat[0] / np.sqrt(1 - share[wrong].flat[0])
        raise InputError(
            f"a frequency of {given:.9g} Hz was given; it must be below {limit:.9g} Hz, which this axis has "
            "with an infinitely stiff nut."
        )
    return np.asarray(bracket**-3.0)


def _frequency(nut: Array, x: Array, mass: Array, theta: Theta, rotor_mass: float) -> Array:
    softness = nut - theta.a * x - theta.b
    bad = ~(softness > 0)
    if np.any(bad):
        raise InputError(
            f"at a position of {x[bad].flat[0]:g} m θ leaves no compliance at all; the position must "
            "lie on the screw."
        )
    return np.asarray(np.sqrt(theta.c / (softness * oscillating_mass(mass, theta, rotor_mass))))


def _share(nut_share: ArrayLike) -> Array:
    share = positive("nut's share of the compliance", nut_share)
    if not np.all(share <= 1):
        wrong = share[share > 1].flat[0]
        raise InputError(
            f"a nut's share of the compliance of {wrong:g} was given; it must be more than 0, 1 at most."
        )
    return share
