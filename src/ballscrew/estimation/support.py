"""Loss of one end of a screw that is fixed at both ends, by the shape of the change along the screw."""

from __future__ import annotations

import numpy as np

from ballscrew.axis.axial import AxialModel
from ballscrew.calibration.assumptions import Assumptions
from ballscrew.estimation.change import ComplianceChange
from ballscrew.estimation.fusion import FusedChange

# Limits of a ratio: curvature of the compliance's growth, over that of the model with the opposite sign. It
# is 1 for a lost end, and less where the end is lost in some conditions or motions only; the model's
# curvature is uncertain.
_LEAST_CURVATURE, _MOST_CURVATURE = 0.4, 2.5


def lost_end(
    change: ComplianceChange, fused: FusedChange, model: AxialModel, assumptions: Assumptions
) -> list[str]:
    """Reason to doubt a preload where one end of the screw seems to carry no load any more.

    Let C_n and C_f be the compliances of shaft and bearing between the nut and the near end, at the thrust
    bearing, and between the nut and the far end. Both ends in parallel have C_n C_f / (C_n + C_f), a parabola
    along the screw. Without the far end it is C_n: the compliance grows by C_n²/(C_n + C_f), a parabola of
    the opposite curvature with its vertex beyond the near end. A change of the nut adds the same compliance
    at every position.

    Parameters
    ----------
    change : ComplianceChange
        Of the cells.
    fused : FusedChange
        With the misfit of these cells.
    model : AxialModel
        Of the axis; its curve is negative where both ends carry.
    assumptions : Assumptions
        With ``false_alarm``, the probability of a misfit below which the nut alone does not explain the
        cells.

    Returns
    -------
    list of str
        The reason, or none where the screw is fixed at one end, or the change has another shape.
    """
    if model.curve >= 0 or fused.probability >= assumptions.false_alarm:
        return []
    if len(np.unique(change.position)) < 3:
        return []
    x = change.position - model.centre
    # Over the model's compliance at its centre.
    growth = change.y * (1 + model.slope * x + model.curve * x**2)
    curve, slope, _ = np.polyfit(x, growth, 2)
    if not _LEAST_CURVATURE < curve / -model.curve < _MOST_CURVATURE:
        return []
    vertex = -slope / (2 * curve)
    if x.min() < vertex < x.max():
        return []
    end = "far end" if vertex < x.min() else "end at the thrust bearing"
    reason = (
        f"the compliance has grown along the screw as it does where the {end} of a screw fixed at both ends "
        "no longer carries: has it lost its pretension (a screw warmer than the bed, a loose bearing nut)? "
        "Restore it and measure again; until then the preload is not determined"
    )
    return [reason]
