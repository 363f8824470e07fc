"""Result types of the joint estimator."""

from __future__ import annotations

from dataclasses import dataclass

from ballscrew.base.quantity import Quantity
from ballscrew.modal.run import CellResult, SharedError

METHOD = "joint"


@dataclass(frozen=True, slots=True)
class RippleOrder:
    """A force that repeats with every turn of the screw, as fitted.

    Parameters
    ----------
    order : int
        Periods per turn.
    amplitude, uncertainty : float or None
        Amplitude as an acceleration of the equivalent mass, m/s², and its standard uncertainty; None if the
        run does not determine it.
    fractional : bool
        Whether it comes near the mode and a neighbouring order was found too: then one force with an order
        between whole numbers is likely, and whole orders describe it only in part.
    """

    order: int
    amplitude: float | None
    uncertainty: float | None
    fractional: bool = False


@dataclass(frozen=True, slots=True)
class JointResult:
    """A run.

    Parameters
    ----------
    cells : tuple of CellResult
        By position, condition and motion; without coherence.
    reasons : tuple of str
        Why the whole run is refused; empty if it is not.
    damping : float or None
        Ratio of the rotor-free mode in the middle of the axis.
    pitch_frequency : float or None
        Of the pitching mode of the table, Hz.
    unexplained : tuple of (name, float)
        Part of the power in the band that each block's model does not explain.
    band : tuple of float or None
        Hz.
    shared_errors : tuple of SharedError
        Common part of the cells' uncertainties: all lie on one curve.
    mass_over_preload : Quantity or None
        Moving mass over preload, kg/N, as determined by the softening under the test's own load without the
        data sheet's preload; None if it is not determined.
    ripple : tuple of RippleOrder
        Forces that repeat with every turn and were fitted with the mode, by order.
    """

    cells: tuple[CellResult, ...]
    reasons: tuple[str, ...] = ()
    damping: float | None = None
    pitch_frequency: float | None = None
    unexplained: tuple[tuple[str, float], ...] = ()
    band: tuple[float, float] | None = None
    shared_errors: tuple[SharedError, ...] = ()
    mass_over_preload: Quantity | None = None
    ripple: tuple[RippleOrder, ...] = ()
