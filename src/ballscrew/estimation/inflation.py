"""Increased uncertainty of a run whose cells one preload does not explain."""

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
"""Printed names of the error terms of a misfit."""


def inflate_uncertainty(
    fused: FusedChange, evidence: CauseEvidence, causes: Sequence[PossibleCause], assumptions: Assumptions
) -> FusedChange:
    """Add the misfit of the cells to the uncertainty of the change.

    The possible cause of the misfit determines the added term; of two, the more probable one does:

    - a change at some stops: the standard deviation of u by changes of that size at random stops;
    - a screw that is warmer at one end: half of the change from end to end, since it is not known which end
      has not changed;
    - none that is known: all uncertainties are assumed to be too small by the same factor √(χ²/ν) (Birge,
      1932, DOI 10.1103/PhysRev.40.207).

    Parameters
    ----------
    fused : FusedChange
        Of a run.
    evidence : CauseEvidence
        Of the same change.
    causes : sequence of PossibleCause
        By :func:`~ballscrew.estimation.causes.compare_causes` from this evidence, the most probable first.
    assumptions : Assumptions
        With ``false_alarm``, the probability of a misfit below which one preload does not explain the cells.

    Returns
    -------
    FusedChange
        With an additional term in these three cases; unchanged where one preload explains the cells, or
        other causes alone are possible.
    """
    if fused.probability >= assumptions.false_alarm:
        return fused
    others = other_possible_causes(causes)
    for cause in others:
        if cause.name == "gradient":
            # Half of the amount, which is a difference of ln P; du = −u/3 d ln P.
            return _with_term(fused, GRADIENT, abs(cause.amount) / 6 * fused.u)
        if cause.name == "local":
            relative_size = cause.amount / evidence.sizes["local"]
            # Changes of the fused u by the independent forms of a local change, each at its plausible size.
            shifts = evidence.signatures["local"][:, : len(fused.weights)] @ fused.weights
            return _with_term(fused, LOCAL, relative_size * float(np.linalg.norm(shifts)))
    if others:
        return fused
    excess = 0.0
    if fused.degrees > 0:
        excess = max(fused.chi2 / fused.degrees - 1, 0.0)
    return _with_term(fused, UNEXPLAINED, math.sqrt(excess) * fused.spread)


def with_misfit_of(fused: FusedChange, other: FusedChange) -> FusedChange:
    """The change with the misfit term of another change of the same run, at the same relative size of u."""
    for name in (LOCAL, GRADIENT, UNEXPLAINED):
        if name in other.terms and other.u > 0:
            fused = _with_term(fused, name, other.terms[name][0] * fused.u / other.u)
    return fused


def is_inflated(fused: FusedChange) -> bool:
    """Whether the uncertainty contains a misfit of the cells."""
    return not fused.terms.keys().isdisjoint((LOCAL, GRADIENT, UNEXPLAINED))


def _with_term(fused: FusedChange, name: str, spread: float) -> FusedChange:
    """The change with an additional systematic term; ``spread`` is a standard uncertainty of u."""
    return replace(fused, terms=fused.terms | {name: (spread, False)})
