"""What the joint estimator tells."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["Cause", "CellEstimate", "JointResult", "Push"]


@dataclass(frozen=True, slots=True)
class CellEstimate:
    """One cell. Frequencies in Hz, undamped, at the cell's nominal position, without load on the nut.

    Parameters
    ----------
    position : float
        m.
    condition : str
        PA, PD, NA or ND.
    motion, repetitions : int
        Which motion, and how many transients were averaged.
    frequency, uncertainty : float or None
        Rotor free, and its standard uncertainty; None where refused.
    held_frequency, held_uncertainty : float or None
        Rotor held.
    damping : float or None
        Ratio of the free mode.
    deviation, deviation_uncertainty : float or None
        Of this cell's own data from the curve through all cells, Hz: a local defect shows here.
    terms : tuple of (name, float)
        Parts of the standard uncertainty, Hz.
    verdict : str
        good, suspect or refused.
    reasons : tuple of str
        Why it is not good.
    """

    position: float
    condition: str
    motion: int
    repetitions: int
    frequency: float | None
    uncertainty: float | None
    held_frequency: float | None
    held_uncertainty: float | None
    damping: float | None
    deviation: float | None
    deviation_uncertainty: float | None
    terms: tuple[tuple[str, float], ...]
    verdict: str
    reasons: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Cause:
    """One cause of error that cells share: a standard normal number times its effect on each.

    Parameters
    ----------
    name : str
        The term of the uncertainty that it is a part of.
    repeats : bool
        Whether it acts alike in the next run of the same plan.
    effects : tuple of float
        Hz, in the order of the cells; 0 where a cell is refused.
    """

    name: str
    repeats: bool
    effects: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Push:
    """A force that repeats with every turn, as the fit tells it.

    Parameters
    ----------
    order : int
        Per turn.
    size, uncertainty : float or None
        Of its amplitude, as an acceleration of all that moves, m/s², and the standard uncertainty; None where
        the run does not tell it.
    between : bool
        Whether it comes near the mode and another order was found beside it: then the force lies between
        them, and what whole orders make of it is not all of it.
    """

    order: int
    size: float | None
    uncertainty: float | None
    between: bool = False


@dataclass(frozen=True, slots=True)
class JointResult:
    """A run.

    Parameters
    ----------
    cells : tuple of CellEstimate
        By position, condition and motion.
    reasons : tuple of str
        Why the whole run is refused; none where it is not.
    damping : float or None
        Ratio of the free mode.
    pitch_frequency : float or None
        Of the accelerometers' mode, Hz.
    unexplained : tuple of (name, float)
        Part of the power in the band that each block's model leaves.
    band : tuple of float or None
        Hz.
    causes : tuple of Cause
        What the cells' uncertainties have in common: all lie on one curve.
    mass_over_preload : tuple of float or None
        What the nut moves over its preload, kg/N, and its standard uncertainty, as the softening under the
        test's own load tells it without the data sheet's preload; None where it does not.
    pushes : tuple of Push
        Forces that repeat with every turn and were told beside the mode, by order.
    """

    cells: tuple[CellEstimate, ...]
    reasons: tuple[str, ...] = ()
    damping: float | None = None
    pitch_frequency: float | None = None
    unexplained: tuple[tuple[str, float], ...] = ()
    band: tuple[float, float] | None = None
    causes: tuple[Cause, ...] = ()
    mass_over_preload: tuple[float, float] | None = None
    pushes: tuple[Push, ...] = ()
