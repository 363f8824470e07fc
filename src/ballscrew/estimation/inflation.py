"""Inflated uncertainty of a run that one preload does not explain."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ballscrew.calibration.assumptions import Assumptions
from ballscrew.estimation.causes import CauseEvidence, PossibleCause, other_possible_causes
from ballscrew.estimation.fusion import FusedChange

LOCAL = "a change at some stops"
UNEXPLAINED = "misfit without a known cause"


def inflate_uncertainty(
    fused: FusedChange, evidence: CauseEvidence, causes: Sequence[PossibleCause], assumptions: Assumptions
) -> FusedChange:
    """Add the misfit of the cells to the uncertainty of the change.

    Where a change at some stops explains the cells, a change of that size may lie at any stops and shifts the
    mean accordingly. Where no known cause explains them, all uncertainties are taken as too small by the same
    factor √(χ²/ν) (Birge, 1932, DOI 10.1103/PhysRev.40.207).

    Parameters
    ----------
    fused : FusedChange
        Of the cells.
    evidence : CauseEvidence
        Of the same run.
    causes : sequence of PossibleCause
        Compared on it.
    assumptions : Assumptions
        Misfit beyond which one preload does not explain the cells.

    Returns
    -------
    FusedChange
        With an additional term, where neither one preload nor another cause explains the cells.
    """
    if fused.probability >= assumptions.false_alarm:
        return fused
    others = other_possible_causes(causes)
    for cause in others:
        if cause.name == "local":
            size = cause.amount / evidence.sizes["local"]
            shift = evidence.signatures["local"][:, : len(fused.weights)] @ fused.weights
            return _with_term(fused, LOCAL, size * float(np.linalg.norm(shift)))
    if others:
        return fused
    excess = 0.0
    if fused.degrees > 0:
        excess = max(fused.chi2 / fused.degrees - 1, 0.0)
    return _with_term(fused, UNEXPLAINED, math.sqrt(excess) * fused.spread)


def is_inflated(fused: FusedChange) -> bool:
    """True where a misfit is part of the uncertainty."""
    return LOCAL in fused.terms or UNEXPLAINED in fused.terms


def _with_term(fused: FusedChange, name: str, spread: float) -> FusedChange:
    return replace(fused, terms=fused.terms | {name: (spread, False)})
