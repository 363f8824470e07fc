"""Eq. (1) of the paper as it is printed, to set beside the rest.

Nothing else computes with it. Its errors, and their size, are on the page *Where we depart from the paper,
and why*. Han, Miller, Vogl, Chen and Jia, *Robust feature design for early detection of ball screw preload
loss*, 2024.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ballscrew.base.arrays import Array


def preload_as_printed(bracket: ArrayLike, *, rigidity: float, load_rating: float) -> Array:
    """Eq. (1) as printed, P = 0.1 Ca / (0.8 K [·]), N: without the cube that Eqs. (2) and (3) have.

    Parameters
    ----------
    bracket : array_like
        The bracket of Eq. (1): the compliance that is left for the nut, m/N.
    rigidity : float
        K, N/m.
    load_rating : float
        Ca, N.

    Returns
    -------
    ndarray
        N. With the cube, 0.1 Ca / (0.8 K [·])³, it inverts the makers' rigidity law.
    """
    return np.asarray(0.1 * load_rating / (0.8 * rigidity * np.asarray(bracket, dtype=np.float64)))
