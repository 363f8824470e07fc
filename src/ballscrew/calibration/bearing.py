"""The thrust bearing's part of the compliance, which frequencies cannot tell from the nut's."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ballscrew.axis.axial import AxialModel, from_sheet
from ballscrew.axis.sheet import DataSheet
from ballscrew.calibration.assumptions import Assumptions

__all__ = ["bearing_share", "single_run_note"]

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


def single_run_note(sheet: DataSheet, model: AxialModel, share: float) -> str:
    """Say what ``preload`` allows for in one run that no history of runs averages out.

    Parameters
    ----------
    sheet, model
        The axis.
    share : float
        The nut's part of the compliance, in the middle of the stops.

    Returns
    -------
    str
        A sentence for the notes of a capability.
    """
    drift = Assumptions().bearing_drift
    width = 3 * drift * bearing_share(sheet, model) / share
    return (
        "these losses are what a history of runs shows, by what differs from run to run; `preload` tells one "
        f"run by itself within ±{100 * width:.1f} % or more: it allows the thrust bearing "
        f"{100 * drift:g} % of drift since the baseline (--bearing-drift), which looks like that much "
        "preload, is the same in every run and averages out in none, as are a load or a temperature that "
        "lastingly differ"
    )
