"""What the paper says, beside what our bench in software shows."""

from __future__ import annotations

from collections.abc import Callable

from ballscrew.reproduction import measured_claims as measured
from ballscrew.reproduction import preload as preload
from ballscrew.reproduction import theory_claims as theory
from ballscrew.reproduction import watched as watched
from ballscrew.reproduction.results import Claim, Experiments

__all__ = ["claims"]


def claims(found: Experiments) -> tuple[Claim, ...]:
    """Hold every claim of the paper against what was measured.

    Parameters
    ----------
    found : Experiments
        Both experiments.

    Returns
    -------
    tuple of Claim
        In the paper's order.
    """
    each: tuple[Callable[[Experiments], Claim], ...] = (
        theory.stages,
        theory.as_printed,
        theory.theory_falls,
        measured.identified,
        preload.metrology,
        measured.conditions,
        measured.repetitions,
        measured.with_load,
        measured.with_position,
        theory.agreement,
        preload.contact,
        measured.with_preload,
        measured.early,
        watched.detected,
        measured.with_backlash,
        preload.along,
    )
    return tuple(claim(found) for claim in each)
