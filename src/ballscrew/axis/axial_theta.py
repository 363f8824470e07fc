"""The axis as its frequencies know it, in the paper's θ = {a, b, c, d} and back."""

from __future__ import annotations

import math

from ballscrew.axis.axial import AxialModel
from ballscrew.axis.equations import Theta
from ballscrew.axis.given import positive
from ballscrew.base.errors import InputError

__all__ = ["from_theta", "to_theta"]


def to_theta(model: AxialModel, table_mass: float = 0.0) -> Theta:
    """θ = {a, b, c, d} of Eqs. (2) and (3).

    Parameters
    ----------
    model : AxialModel
        The axis.
    table_mass : float
        Of table and nut, kg: d is what moves besides. Without it d holds them too, and m_t is the load.

    Returns
    -------
    Theta
        In newtons: as good as the reference preload is.

    Raises
    ------
    InputError
        If the screw is held at both ends, or the table heavier than all that moves.
    """
    if model.curve != 0.0:
        raise InputError("θ = {a, b, c, d} is linear in the position; this model has a curve and no θ.")
    kappa_ = 1 / (model.share * model.compliance * math.cbrt(model.preload))
    at_zero = model.compliance * (1 - model.share - model.slope * model.centre)
    return Theta(
        a=-kappa_ * model.compliance * model.slope,
        b=-kappa_ * at_zero,
        c=kappa_ / (4 * math.pi**2),
        d=model.mass - table_mass,
    )


def from_theta(
    theta: Theta, rotor_mass: float, table_mass: float, preload: float, centre: float
) -> AxialModel:
    """Return the model of θ, at a reference preload and about a centre.

    Parameters
    ----------
    theta : Theta
        Of Eqs. (2) and (3).
    rotor_mass : float
        m_r, kg; infinite for Eq. (3).
    table_mass : float
        Of table and nut, kg.
    preload : float
        P_ref, N.
    centre : float
        Where the compliance is stated, m.

    Returns
    -------
    AxialModel
        With the same frequencies.

    Raises
    ------
    InputError
        If an argument is no possible value.
    """
    force = float(positive("preload", preload, "N"))
    kappa_ = 4 * math.pi**2 * theta.c
    nut = 1 / (kappa_ * math.cbrt(force))
    whole = nut - (theta.b + theta.a * centre) / kappa_
    return AxialModel(
        centre=centre,
        compliance=whole,
        slope=-theta.a / kappa_ / whole,
        curve=0.0,
        mass=table_mass + theta.d,
        rotor=rotor_mass,
        share=nut / whole,
        preload=force,
    )
