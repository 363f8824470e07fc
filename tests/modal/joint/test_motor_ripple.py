from __future__ import annotations

import numpy as np
import pytest
from tests.recording.synthetic import SHEET

from ballscrew.modal.joint.analysis import motor_ripple
from ballscrew.modal.joint.result import RippleOrder
from ballscrew.modal.run import MotorRipple, RigidBodyResult


def test_ripple_is_a_torque_of_all_that_moves():
    body = RigidBodyResult(equivalent_mass_kg=200.0, standard_uncertainty={"equivalent_mass_kg": 2.0})
    arm = 200.0 * SHEET.screw.lead / (2 * np.pi)
    known, unknown = motor_ripple((RippleOrder(6, 0.02, 0.0004), RippleOrder(12, 0.02, 0.011)), body, SHEET)
    assert motor_ripple((RippleOrder(2, None, None),), body, SHEET) == (MotorRipple(2, None, None),)
    assert known.torque_Nm == pytest.approx(0.02 * arm)
    assert known.standard_uncertainty_Nm == pytest.approx(np.hypot(0.02, 0.01) * known.torque_Nm)
    assert unknown == MotorRipple(12, None, None)


@pytest.mark.parametrize(("mass", "sheet"), [(None, SHEET), (200.0, None)])
def test_without_mass_or_lead_ripple_has_no_torque(mass, sheet):
    body = RigidBodyResult(equivalent_mass_kg=mass, standard_uncertainty={"equivalent_mass_kg": 2.0})
    assert motor_ripple((RippleOrder(6, 0.02, 0.0004),), body, sheet) == (MotorRipple(6, None, None),)
