"""The thrust bearing's share of the compliance, which frequencies cannot separate from the nut's."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ballscrew.axis.axial import AxialModel, from_sheet
from ballscrew.axis.sheet import DataSheet
from ballscrew.base.quantity import NORMAL_95
from ballscrew.calibration.assumptions import BEARING_PRELOAD

_STEP = 1e-4  # relative, of k_b in a numerical derivative


def bearing_share(sheet: DataSheet, model: AxialModel) -> float:
    """−d ln U / d ln k_b, the share of the bearing, or of both bearings, in the compliance at the centre.

    Parameters
    ----------
    sheet : DataSheet
        Gives the bearing's part of the compliance that is not the nut's.
    model : AxialModel
        Gives the nut's share.

    Returns
    -------
    float
        0 to 1.
    """

    def with_bearing(factor: float) -> AxialModel:
        stiffness, far = sheet.bearing.stiffness * factor, sheet.bearing.far_stiffness
        if far is not None:
            far *= factor
        bearing = replace(sheet.bearing, stiffness=stiffness, far_stiffness=far)
        return from_sheet(replace(sheet, bearing=bearing), model.centre)

    softer, stiffer = with_bearing(1 - _STEP), with_bearing(1 + _STEP)
    share_of_sheet = -np.log(stiffer.compliance / softer.compliance) / (2 * _STEP)
    return float(share_of_sheet / (1 - with_bearing(1.0).share) * (1 - model.share))


def single_run_note(sheet: DataSheet, model: AxialModel, share: float) -> str:
    """A note on the interval of a single run by ``preload``, wider than that of a history of runs.

    Parameters
    ----------
    sheet : DataSheet
        The axis.
    model : AxialModel
        Its model.
    share : float
        The nut's share of the compliance, in the middle of the stops.

    Returns
    -------
    str
        For the notes of :func:`~ballscrew.monitoring.capability.capability`.
    """
    # Half-width of the 95 % interval of ln P: ln k_b changes by a third of the bearing's ln preload, and ln P
    # of the nut by three times that, times the ratio of the shares.
    width = NORMAL_95 * BEARING_PRELOAD * bearing_share(sheet, model) / share
    return (
        "these losses are detected in a history of runs, where only errors that differ from run to run "
        f"count; `preload` estimates the nut's own preload to ±{100 * width:.0f} % at best: the support "
        f"bearing's preload may have changed by {100 * BEARING_PRELOAD:g} % (standard deviation) since the "
        "baseline, which looks like a change of the nut's and does not average out; two acceleration levels, "
        "or --bearing-drift, separate the two"
    )
