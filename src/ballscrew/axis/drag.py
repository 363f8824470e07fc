"""Drag torque of a preloaded nut, which every drive can measure at a slow speed."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ballscrew.axis.given import not_negative, positive


def preload_torque(preload: ArrayLike, lead: ArrayLike, pitch_diameter: ArrayLike) -> NDArray[np.float64]:
    """T = 0.05 (tan λ)^(−1/2) P β, tan λ = lead / (π d), β = lead / 2π.

    The form of JIS B 1192, which the makers' catalogues (THK, NSK) print; its 0.05 is what lubricated screws
    have on average, and the standard allows tens of per cent about it. It is proportional to P: its
    change is more accurate than its value.

    Parameters
    ----------
    preload : array_like
        P, N; 0 or more.
    lead : array_like
        m.
    pitch_diameter : array_like
        d, through the centres of the balls, m.

    Returns
    -------
    ndarray
        T, N m.

    Raises
    ------
    InputError
        If a number is not finite, the preload negative, or lead or diameter not above 0.
    """
    force = not_negative("preload", preload, "N")
    travel = positive("lead", lead, "m")
    slope = travel / (math.pi * positive("pitch diameter", pitch_diameter, "m"))
    return np.asarray(0.05 / np.sqrt(slope) * force * travel / (2 * math.pi))
