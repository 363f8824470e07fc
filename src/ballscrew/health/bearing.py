"""The thrust bearing's part of the compliance, which frequencies cannot tell from the nut's."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ballscrew.axis.axial import AxialModel, from_sheet
from ballscrew.axis.sheet import DataSheet

__all__ = ["bearing_share"]

_STEP = 1e-4


def bearing_share(sheet: DataSheet, model: AxialModel) -> float:
    """−d ln U / d ln k_b: by the sheet, of what is not the nut's.

    Parameters
    ----------
    sheet : DataSheet
        The axis.
    model : AxialModel
        As it is known; says what is the nut's.

    Returns
    -------
    float
        The bearing's part of the whole compliance at the model's centre.
    """

    def whole(factor: float) -> AxialModel:
        bearing = replace(sheet.bearing, stiffness=sheet.bearing.stiffness * factor)
        return from_sheet(replace(sheet, bearing=bearing), model.centre)

    part = -np.log(whole(1 + _STEP).compliance / whole(1 - _STEP).compliance) / (2 * _STEP)
    return float(part / (1 - whole(1.0).share) * (1 - model.share))
