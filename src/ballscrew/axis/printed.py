"""Eq. (1) exactly as the paper prints it, to set beside the corrected forms; nothing computes with it.

What it does wrong, and by how much, is on the page *Where we depart from the paper, and why*.
"""

from __future__ import annotations

import math

from ballscrew.axis.compliance import transmission_ratio

__all__ = ["preload_as_printed", "torsion_as_printed"]


def torsion_as_printed(*, lead: float, diameter: float, length: float, shear_modulus: float) -> float:
    """Second term of Eq. (1) as printed, 32 β L / (π d³ G), m/N.

    Parameters
    ----------
    lead, diameter, length : float
        Of the screw (its whole length), m.
    shear_modulus : float
        G, Pa.

    Returns
    -------
    float
        m/N: d/β times the twist of a shaft of that length.
    """
    return 32 * transmission_ratio(lead) * length / (math.pi * diameter**3 * shear_modulus)


def preload_as_printed(bracket: float, *, rigidity: float, load_rating: float) -> float:
    """Eq. (1) as printed, P = 0.1 Ca / (0.8 K [·]), N: without the cube that Eqs. (2) and (3) have.

    Parameters
    ----------
    bracket : float
        The bracket of Eq. (1): the compliance that is left for the nut, m/N.
    rigidity : float
        K, N/m.
    load_rating : float
        Ca, N.

    Returns
    -------
    float
        N. With the cube, 0.1 Ca / (0.8 K [·])³, it inverts the makers' rigidity law.
    """
    return 0.1 * load_rating / (0.8 * rigidity * bracket)
