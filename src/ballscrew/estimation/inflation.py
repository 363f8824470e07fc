"""Larger uncertainty for a run whose cells one preload does not explain."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ballscrew.calibration.assumptions import Assumptions
from ballscrew.estimation.causes import CauseEvidence, PossibleCause, other_possible_causes
from ballscrew.estimation.fusion import FusedChange

LOCAL = "a change at some stops"
GRADIENT = "a screw warmer at one end"
UNEXPLAINED = "misfit without a known cause"
"""Names of the error terms of a misfit, as printed."""


def inflate_uncertainty(
    fused: FusedChange, evidence: CauseEvidence, causes: Sequence[PossibleCause], assumptions: Assumptions
) -> FusedChange:
    """Add the misfit of the cells to the uncertainty of the change.

    If a change at some stops is a possible cause, the term is the standard deviation by which changes of that
    size at random stops move the mean. If a screw that is warmer at one end is, the cold end may be the one
    that has not changed, and the term is half of the change from end to end. If no known cause explains them,
    all uncertainties are taken as too small by the same factor √(χ²/ν) (Birge, 1932, DOI
    10.1103/PhysRev.40.207).

    Parameters
    ----------
    fused : FusedChange
        Of the cells.
    evidence : CauseEvidence
        Of the same run.
    causes : sequence of PossibleCause
        By :func:`~ballscrew.estimation.causes.compare_causes` from this evidence.
    assumptions : Assumptions
        With ``false_alarm``: cells whose misfit is less probable are not explained by one preload.

    Returns
    -------
    FusedChange
        With an additional term in these three cases; unchanged where one preload explains the cells, or any
        other cause does.
    """
    if fused.probability >= assumptions.false_alarm:
        return fused
    others = other_possible_causes(causes)
    for cause in others:
        if cause.name == "gradient":
            # Half of the amount, which is a change of ln P, and du = −u/3 d ln P.
            return _with_term(fused, GRADIENT, abs(cause.amount) / 6 * fused.u)
        if cause.name == "local":
            relative_size = cause.amount / evidence.sizes["local"]
            # Changes of u by the independent forms of a local change, each at its plausible size.
            shifts = evidence.signatures["local"][:, : len(fused.weights)] @ fused.weights
            return _with_term(fused, LOCAL, relative_size * float(np.linalg.norm(shifts)))
    if others:
        return fused
    excess = 0.0
    if fused.degrees > 0:
        excess = max(fused.chi2 / fused.degrees - 1, 0.0)
    return _with_term(fused, UNEXPLAINED, math.sqrt(excess) * fused.spread)


def with_misfit_of(fused: FusedChange, other: FusedChange) -> FusedChange:
    """The change with the misfit term of another change of the same run, in proportion to u."""
    for name in (LOCAL, GRADIENT, UNEXPLAINED):
        if name in other.terms and other.u > 0:
            fused = _with_term(fused, name, other.terms[name][0] * fused.u / other.u)
    return fused


def is_inflated(fused: FusedChange) -> bool:
    """Whether a misfit is part of the uncertainty."""
    return not fused.terms.keys().isdisjoint((LOCAL, GRADIENT, UNEXPLAINED))


def _with_term(fused: FusedChange, name: str, spread: float) -> FusedChange:
    """The change with an additional systematic term; ``spread`` is a standard uncertainty of u."""
    return replace(fused, terms=fused.terms | {name: (spread, False)})
