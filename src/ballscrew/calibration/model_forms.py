"""Forms of the axial model that a calibration compares, each with its prior."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from ballscrew.axis.axial import PARAMETERS
from ballscrew.axis.axial_prior import both_ends_curve, prior, tolerated
from ballscrew.axis.sheet import Bearing, DataSheet
from ballscrew.base.arrays import Array

EQ3 = "Eq. (3), no rotor"
SINGLE_END = "free rotor, fixed at one end"

_STEP = 1e-6  # of each element of the working vector, in a numerical derivative

_COMPLIANCE, _CURVE = PARAMETERS.index("compliance"), PARAMETERS.index("curve")
_MASS, _ROTOR = PARAMETERS.index("mass"), PARAMETERS.index("rotor")


@dataclass(frozen=True, slots=True, eq=False)
class ModelForm:
    """One form of the model, with its prior by the data sheet.

    Parameters
    ----------
    name : str
        As printed.
    mean, covariance : ndarray, shape (7,), (7, 7)
        Of the working vector.
    tolerances : mapping of str to ndarray, shape (7,)
        Effect of one standard uncertainty of each number of the sheet that has a tolerance, by its field; the
        covariance contains them.
    """

    name: str
    mean: Array
    covariance: Array
    tolerances: Mapping[str, Array] = field(default_factory=dict)

    @property
    def free(self) -> tuple[str, ...]:
        """Names of the parameters that are fitted."""
        return tuple(np.array(PARAMETERS)[np.diag(self.covariance) > 0].tolist())


def model_forms(sheet: DataSheet, centre: float, load: float) -> tuple[ModelForm, ...]:
    """The forms that are compared; the first is the sheet's own.

    Parameters
    ----------
    sheet : DataSheet
        The axis.
    centre : float
        Position where the compliance is stated, m.
    load : float
        Load at which Eq. (3) is equivalent to a free rotor, kg: the middle of the loads measured.

    Returns
    -------
    tuple of ModelForm
        The free rotor with the sheet's support, the paper's Eq. (3), and the other support.
    """
    mean, covariance = prior(sheet, centre)
    own = ModelForm("free rotor", mean, covariance, tolerated(sheet, centre))
    if sheet.support == "fixed-fixed":
        bearing = Bearing(sheet.bearing.stiffness)
        single_end = replace(sheet, support="fixed-free", bearing=bearing)
        other = ModelForm(SINGLE_END, *prior(single_end, centre), tolerated(single_end, centre))
    else:
        wider = covariance.copy()
        wider[_CURVE, _CURVE] = both_ends_curve(sheet, centre) ** 2
        other = ModelForm("free rotor, curve", mean, wider, own.tolerances)
    return own, without_rotor(own, load), other


def without_rotor(form: ModelForm, load: float) -> ModelForm:
    """Eq. (3) nearest to a free rotor: the same frequency, and slope over the load, at one load.

    By f² ∝ (1/(m + l) + 1/m_r)/U with a free rotor, and 1/((m' + l) U') by Eq. (3), both agree at the load l
    with their slopes where m' + l = (m + l) g and U' = U/g², g = 1 + (m + l)/m_r. They differ in their
    curvature over the load.

    Parameters
    ----------
    form : ModelForm
        With a free rotor.
    load : float
        l, where they agree, kg.

    Returns
    -------
    ModelForm
        The same prior in the parameters of Eq. (3); its rotor is infinite and not fitted.
    """

    def transformed(vector: Array) -> Array:
        """Working vector of Eq. (3), except its rotor."""
        out = vector.copy()
        moving = np.exp(vector[_MASS]) + load
        factor = 1 + moving / np.exp(vector[_ROTOR])
        out[_COMPLIANCE] -= 2 * np.log(factor)
        out[_MASS] = np.log(moving * factor - load)
        return np.asarray(out)

    jacobian = np.empty((len(form.mean), len(form.mean)))
    for column, step in enumerate(_STEP * np.eye(len(form.mean))):
        difference = transformed(form.mean + step) - transformed(form.mean - step)
        jacobian[:, column] = difference / (2 * _STEP)
    jacobian[_ROTOR] = 0.0
    mean = transformed(form.mean)
    mean[_ROTOR] = np.inf
    effects = {name: jacobian @ effect for name, effect in form.tolerances.items()}
    return ModelForm(EQ3, mean, jacobian @ form.covariance @ jacobian.T, effects)
