"""Result types of the joint estimator."""

from __future__ import annotations

from dataclasses import dataclass

from ballscrew.base.quantity import Quantity
from ballscrew.modal.cell import CellResult, SharedError
from ballscrew.modal.reason import Reason
from ballscrew.modal.run import FrameMode

METHOD = "joint"
"""Name of the method in results."""


@dataclass(frozen=True, slots=True)
class RippleOrder:
    """A force that repeats with every turn of the motor, as fitted.

    Parameters
    ----------
    order : int
        Periods per turn of the motor.
    amplitude, uncertainty : float or None
        Amplitude of the force over the equivalent mass, m/s², and its standard uncertainty; None if the run
        does not determine it.
    fractional : bool
        Whether its frequency reaches the mode and a neighbouring order was found too. The two are then
        likely to be a single force with an order between whole numbers, which whole orders describe only in
        part.
    """

    order: int
    amplitude: float | None
    uncertainty: float | None
    fractional: bool = False


@dataclass(frozen=True, slots=True)
class JointResult:
    """Result of the joint estimator for a run.

    Parameters
    ----------
    cells, shared_errors, mass_over_preload
        As in :class:`~ballscrew.modal.run.Run`; the effects of a shared error are in the order of ``cells``.
    reasons : tuple of Reason
        Why the whole run is refused; empty if it is not.
    ripple : tuple of RippleOrder
        Forces that repeat with every turn and were fitted with the mode, by order.
    frame_mode : FrameMode or None
        Mode of the frame or of the pitching table that was fitted with the axial one.
    """

    cells: tuple[CellResult, ...]
    reasons: tuple[Reason, ...] = ()
    shared_errors: tuple[SharedError, ...] = ()
    mass_over_preload: Quantity | None = None
    ripple: tuple[RippleOrder, ...] = ()
    frame_mode: FrameMode | None = None
