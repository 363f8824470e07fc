"""Axial model in the paper's θ = {a, b, c, d}."""

from __future__ import annotations

import math

from ballscrew.axis.axial import AxialModel
from ballscrew.axis.equations import Theta
from ballscrew.base.errors import InputError


def to_theta(model: AxialModel, table_mass: float = 0.0) -> Theta:
    """θ = {a, b, c, d} of Eqs. (2) and (3).

    Parameters
    ----------
    model : AxialModel
        The axis.
    table_mass : float
        Mass of table and nut, kg, which d does not contain. If 0, d contains them and m_t is the load.

    Returns
    -------
    Theta
        Parameters, with the uncertainty of the reference preload.

    Raises
    ------
    InputError
        If the screw has both ends fixed, or the table heavier than all that moves.
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
