"""An interval for a run that one preload does not explain: wider, by what is left unexplained."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ballscrew.calibration.assumptions import Assumptions
from ballscrew.estimation.cause import Cause, possible_beside
from ballscrew.estimation.causes import Seen
from ballscrew.estimation.fusion import FusedChange

__all__ = ["LOCAL", "UNEXPLAINED", "widened"]

LOCAL = "a change at some stops"
UNEXPLAINED = "what no known cause explains"


def widened(fused: FusedChange, shown: Seen, found: Sequence[Cause], assumptions: Assumptions) -> FusedChange:
    """Add what the misfit says to the uncertainty of the change.

    Where a change at some stops and not at others explains the cells, a change of that size may lie anywhere
    and moves the mean by so much. Where no known cause does, all uncertainty is as much too small as the
    misfit is too large, √(χ²/ν) times (Birge, 1932, DOI 10.1103/PhysRev.40.207).

    Parameters
    ----------
    fused : FusedChange
        Of the cells.
    shown : Seen
        The same, with the signatures of the causes.
    found : sequence of Cause
        Compared on it.
    assumptions : Assumptions
        From which misfit on no preload explains the cells.

    Returns
    -------
    FusedChange
        The same with one term more; as it was where one preload or another cause explains the cells.
    """
    if fused.probability >= assumptions.false_alarm:
        return fused
    others = possible_beside(found)
    local = next((cause for cause in others if cause.name == "local"), None)
    if local is not None:
        size = local.amount / shown.sizes["local"]
        moved = shown.signatures["local"][:, : len(fused.weights)] @ fused.weights
        return _with(fused, LOCAL, size * float(np.linalg.norm(moved)))
    if others:
        return fused
    more = max(fused.chi2 / fused.degrees - 1, 0.0) if fused.degrees > 0 else 0.0
    return _with(fused, UNEXPLAINED, math.sqrt(more) * fused.spread)


def _with(fused: FusedChange, name: str, size: float) -> FusedChange:
    return replace(fused, terms=fused.terms | {name: (size, False)})
