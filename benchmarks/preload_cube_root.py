"""Cube root of the preload ratio of each run: the quantity of the reference models of a life."""

from __future__ import annotations

import numpy as np

from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError
from ballscrew.prognosis.preload_history import PreloadHistory

_FIRST_FRICTIONS = 5  # runs whose mean friction is that of the new preload
_FEWEST_RATIOS = 3  # runs that a line and its scatter need


def preload_cube_root(history: PreloadHistory) -> tuple[Array, Array, Array, Array]:
    """(P/P₀)^(1/3) of each run, for models of one quantity.

    Parameters
    ----------
    history : PreloadHistory
        With levels; or else with friction, which is then taken as proportional to the preload.

    Returns
    -------
    days, value, standard_uncertainty, temperature : ndarray, shape (n,)
        Temperature in K, 0 where it is not known.

    Raises
    ------
    InputError
        If fewer than three runs give it.
    """
    observed = np.isfinite(history.level)
    if observed.any():
        value = 1 / (1 + history.level[observed])
        spread = value**2 * history.level_uncertainty[observed]
    else:
        observed = np.isfinite(history.friction) & (history.friction > 0)
        force = history.friction[observed]
        new = np.mean(force[:_FIRST_FRICTIONS]) if len(force) else 1.0
        value = np.cbrt(force / float(new))
        spread = value / 3 * history.friction_uncertainty[observed] / force
    count = int(observed.sum())
    if count < _FEWEST_RATIOS:
        raise InputError(f"{count} runs give the preload; this life model needs {_FEWEST_RATIOS} at least.")
    return history.days[observed], value, spread, np.nan_to_num(history.temperature[observed])
