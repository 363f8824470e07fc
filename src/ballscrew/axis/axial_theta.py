"""The axis as its frequencies know it, in the paper's θ = {a, b, c, d}."""

from __future__ import annotations

import math

from ballscrew.axis.axial import AxialModel
from ballscrew.axis.equations import Theta
from ballscrew.base.errors import InputError

__all__ = ["to_theta"]


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
