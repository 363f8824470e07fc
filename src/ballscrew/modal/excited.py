"""Whether the test asks anything of a mode: a jerk that lasts a whole period of it does not."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ballscrew.fcft.expected import executed, least_excitation
from ballscrew.fcft.plan import Motion, Plan
from ballscrew.modal.run import CellResult

__all__ = ["excited"]

_LEAST = 0.15  # of the spectrum of a jerk without duration
_NEAR = 0.25  # of a period beside a whole number of them: there the null is


def excited(cells: Sequence[CellResult], plan: Plan | None) -> tuple[CellResult, ...]:
    """Doubt cells whose frequency the torque hardly asks for.

    What rings there was excited by something else. Of the motor's ripple the fit knows; what balls and the
    guide do nobody measured, a fit takes it for an answer to the torque, and no scatter shows that.

    Parameters
    ----------
    cells : sequence of CellResult
        Of a run.
    plan : Plan or None
        Its test; None where it is not known, and nothing can be said.

    Returns
    -------
    tuple of CellResult
        The same; suspect, with the reason, where the spectrum of the test's blows falls below 15 % within
        5 % of the frequency.
    """
    if plan is None:
        return tuple(cells)
    motions = {index: executed(plan, index) for index in range(len(plan.motions))}
    return tuple(_doubted(cell, motions.get(cell.motion, ())) for cell in cells)


def _doubted(cell: CellResult, motions: Sequence[Motion]) -> CellResult:
    f, u = cell.frequency_Hz, cell.standard_uncertainty_Hz
    if f is None or u is None or not motions:
        return cell
    left = float(np.min(least_excitation(np.array([f]), np.array([u]), motions)))
    if left >= _LEAST:
        return cell
    ms = 1e3 * motions[0].jerk_time
    periods = f * ms / 1e3
    if abs(periods - round(periods)) < _NEAR:
        reason = (
            f"the jerk lasts {ms:.1f} ms, about a whole number of the mode's periods: the torque has a null "
            "there, and hardly excites it"
        )
    else:
        reason = (
            f"the jerk lasts {ms:.1f} ms, {periods:.1f} of the mode's periods: so soft a blow hardly excites "
            "it"
        )
    return replace(cell, verdict="suspect", reasons=(*cell.reasons, reason))
