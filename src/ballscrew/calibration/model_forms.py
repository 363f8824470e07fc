"""Forms of the model that the data may ask for, and the evidence for each."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from ballscrew.axis.axial import PARAMETERS
from ballscrew.axis.axial_prior import both_ends_curve, prior, tolerated
from ballscrew.axis.sheet import DataSheet
from ballscrew.base.arrays import Array

__all__ = ["ASK", "EQ3", "Form", "forms", "held_rotor"]


ASK = 3.0
"""By how much ln evidence must be better before another form takes the place of the sheet's: 20 to 1."""

EQ3 = "Eq. (3), no rotor"

_STEP = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class Form:
    """One form of the model, with what is known before any data.

    Parameters
    ----------
    name : str
        In words.
    mean, covariance : ndarray, shape (7,), (7, 7)
        Of the working vector.
    tolerated : mapping of str to ndarray, shape (7,)
        What one standard uncertainty of each number of the sheet does to it; part of the covariance.
    """

    name: str
    mean: Array
    covariance: Array
    tolerated: Mapping[str, Array] = field(default_factory=dict)

    @property
    def free(self) -> tuple[str, ...]:
        """Which of the working vector is fitted."""
        return tuple(name for k, name in enumerate(PARAMETERS) if self.covariance[k, k] > 0)


def forms(sheet: DataSheet, centre: float, load: float) -> tuple[Form, ...]:
    """List the forms that are compared; the first is the sheet's own.

    Parameters
    ----------
    sheet : DataSheet
        The axis.
    centre : float
        Where the compliance is stated, m.
    load : float
        About which Eq. (3) stands in for a free rotor, kg: the middle of the loads measured.

    Returns
    -------
    tuple of Form
        The free rotor with the sheet's support, the paper's Eq. (3), and the other support.
    """
    mean, covariance = prior(sheet, centre)
    own = Form("free rotor", mean, covariance, tolerated(sheet, centre))
    if sheet.support == "fixed-fixed":
        one_end = replace(sheet, support="fixed-free")
        other = Form("free rotor, held at one end", *prior(one_end, centre), tolerated(one_end, centre))
        return own, held_rotor(own, load), other
    curve = PARAMETERS.index("curve")
    wider = covariance.copy()
    wider[curve, curve] = both_ends_curve(sheet, centre) ** 2
    return own, held_rotor(own, load), Form("free rotor, curve", mean, wider, own.tolerated)


def held_rotor(form: Form, load: float) -> Form:
    """Eq. (3) that comes nearest to a free rotor: the same frequency and slope over the load at one load.

    (1/(m + l) + 1/m_r)/U and 1/(m' + l)/U' agree with their slopes where m' + l = (m + l) g and U' = U/g²,
    g = 1 + (m + l)/m_r. What is left for the data to tell is how they bend over the load.

    Parameters
    ----------
    form : Form
        With a free rotor.
    load : float
        Where they agree, kg.

    Returns
    -------
    Form
        Its rotor infinite and not free.
    """

    def moved(vector: Array) -> Array:
        out = vector.copy()
        mass, rotor = np.exp(vector[PARAMETERS.index("mass")]), np.exp(vector[PARAMETERS.index("rotor")])
        more = 1 + (mass + load) / rotor
        out[PARAMETERS.index("compliance")] -= 2 * np.log(more)
        out[PARAMETERS.index("mass")] = np.log((mass + load) * more - load)
        return np.asarray(out)

    steps = _STEP * np.eye(len(form.mean))
    turn = np.stack([(moved(form.mean + s) - moved(form.mean - s)) / (2 * _STEP) for s in steps], axis=1)
    rotor = PARAMETERS.index("rotor")
    turn[rotor] = 0.0
    covariance = turn @ form.covariance @ turn.T
    mean = moved(form.mean)
    mean[rotor] = np.inf
    return Form(EQ3, mean, covariance, {name: turn @ effect for name, effect in form.tolerated.items()})
