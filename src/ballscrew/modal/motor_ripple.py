"""Forces that repeat with every turn, as torques."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from ballscrew.axis.compliance import transmission_ratio
from ballscrew.axis.sheet import DataSheet
from ballscrew.modal.joint.result import Push

if TYPE_CHECKING:
    from ballscrew.modal.run import RigidBodyResult

__all__ = ["MotorRipple", "motor_ripple"]

_KNOWN = 0.5  # of itself: with a larger standard uncertainty a size is none


@dataclass(frozen=True, slots=True)
class MotorRipple:
    """A force that repeats with every turn and that no channel tells, as one at the motor.

    Parameters
    ----------
    order : int
        Per turn of the screw.
    torque_Nm, standard_uncertainty_Nm : float or None
        Its amplitude; None where it is not known to half of itself, stays well below the mode at full speed,
        has an order beside it that was found too, or where nothing tells newtons.
    """

    order: int
    torque_Nm: float | None  # noqa: N815  the unit's own letters
    standard_uncertainty_Nm: float | None  # noqa: N815


def motor_ripple(
    pushes: Sequence[Push], body: RigidBodyResult, sheet: DataSheet | None
) -> tuple[MotorRipple, ...]:
    """Ripple of the motor as torques.

    Parameters
    ----------
    pushes : sequence of Push
        As accelerations of all that moves.
    body : RigidBodyResult
        What moves.
    sheet : DataSheet or None
        Tells the lead.

    Returns
    -------
    tuple of MotorRipple
        Without a torque where it is known too badly, or where mass or lead are not known.
    """
    mass = body.equivalent_mass_kg
    if mass is None or sheet is None:
        return tuple(MotorRipple(push.order, None, None) for push in pushes)
    arm = mass * transmission_ratio(sheet.screw.lead)
    doubt = body.standard_uncertainty["equivalent_mass_kg"] / mass
    out = []
    for push in pushes:
        size, spread = push.size, push.uncertainty
        if size is None or spread is None or spread > _KNOWN * size:
            out.append(MotorRipple(push.order, None, None))
        else:
            out.append(MotorRipple(push.order, arm * size, arm * size * math.hypot(spread / size, doubt)))
    return tuple(out)
