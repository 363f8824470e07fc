"""What is said of an isolated cell."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballscrew.modal.output_error.model import Structure

__all__ = ["Candidate", "CellEstimate", "ModeEstimate"]


@dataclass(frozen=True, slots=True)
class ModeEstimate:
    """A mode.

    Parameters
    ----------
    frequency, frequency_uncertainty : float
        Undamped natural frequency and its standard uncertainty, Hz.
    damping, damping_uncertainty : float
        Damping ratio and its standard uncertainty.
    share : float
        Its part of the power that all modes together make.
    """

    frequency: float
    frequency_uncertainty: float
    damping: float
    damping_uncertainty: float
    share: float


@dataclass(frozen=True, slots=True)
class Candidate:
    """A model that was tried.

    Parameters
    ----------
    order : int
        Number of modes.
    structure : {"prompt", "classical", "general"}
        Of the transfer function.
    criterion : float
        Bayesian information criterion: the least is the best.
    modes : tuple of ModeEstimate
        By frequency.
    delay : float or None
        s; None where the structure has none of its own.
    """

    order: int
    structure: Structure
    criterion: float
    modes: tuple[ModeEstimate, ...]
    delay: float | None


@dataclass(frozen=True, slots=True)
class CellEstimate:
    """An isolated cell, identified or refused.

    Parameters
    ----------
    frequency, uncertainty : float or None
        Of the mode asked for, Hz: averaged over the models that are nearly as good as the best. None where
        refused.
    damping, damping_uncertainty : float or None
        Likewise.
    verdict : str
        ``"good"``, ``"suspect"`` or ``"refused"``.
    reasons : tuple of str
        In words; at least one where the verdict is not good.
    best : Candidate or None
        The model kept.
    candidates : tuple of Candidate
        All that were tried, the best first.
    repetitions : int
        Used.
    dropped : tuple of int
        Repetitions left out, since they do not belong.
    input_noise : float
        Standard deviation of the noise on the force, in its unit; 0 where the residual does not show it.
    terms : tuple of (str, float)
        Parts of the uncertainty, Hz.
    """

    frequency: float | None
    uncertainty: float | None
    damping: float | None
    damping_uncertainty: float | None
    verdict: str
    reasons: tuple[str, ...]
    best: Candidate | None
    candidates: tuple[Candidate, ...]
    repetitions: int
    dropped: tuple[int, ...] = ()
    input_noise: float = 0.0
    terms: tuple[tuple[str, float], ...] = ()

    @property
    def order(self) -> int:
        """Number of modes of the model kept; 0 where there is none."""
        return self.best.order if self.best else 0

    def interval(self, factor: float = 1.96) -> NDArray[np.float64]:
        """Frequency ± factor × uncertainty, Hz; not a number where refused."""
        if self.frequency is None or self.uncertainty is None:
            return np.full(2, np.nan)
        return self.frequency + factor * self.uncertainty * np.array([-1.0, 1.0])
