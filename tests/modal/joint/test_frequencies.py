"""Frequencies of the cells by the final fit."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from ballscrew.modal.joint import frequencies
from ballscrew.modal.joint.fit import JointFit
from ballscrew.modal.joint.frequencies import _damping_error
from ballscrew.modal.joint.settings import JointSettings


@pytest.mark.parametrize(("zero", "uncertainty"), [(np.nan, 0.2), (100.6, np.hypot(0.2, 0.2))])
def test_a_zero_that_is_not_found_does_not_discard_the_rotor_held_frequency(
    monkeypatch: pytest.MonkeyPatch, zero: float, uncertainty: float
) -> None:
    """It adds a third of the difference where there is one."""
    free, term = np.array([120.0]), frequencies.UncertaintyTerm("noise", False, np.array([[0.2]]))
    block: Any = SimpleNamespace(windows=SimpleNamespace(stops=np.zeros(1)))
    found: Any = SimpleNamespace(fit=SimpleNamespace(blocks=[block, block]), unwhitened=None)
    monkeypatch.setattr(frequencies, "_torque_zero", lambda *_: (np.array([zero]), np.array([np.inf])))
    monkeypatch.setattr(frequencies, "_frequency_and_terms", lambda *_: (np.array([100.0]), [term]))
    monkeypatch.setattr(frequencies, "unexplained_power", lambda _: {})
    tied: Any = None
    found_at = frequencies._rotor_held_frequency(found, tied, tied, JointSettings(), free, free)
    np.testing.assert_allclose(found_at, ([100.0], [uncertainty]))


@pytest.mark.parametrize(
    ("exponent", "information", "expected"),
    [
        (2.0, 1.0, 1.5),  # at its limit: joints alone
        (1.9, 1e6, 1.5 * 0.95**2),
        (1.0, 1e6, 1.5 * 0.5**2),  # the screw is damped too
        (-1.0, 1e6, 0.0),  # the guide
        (0.5, 0.0, 1.5 * (1 + 0.9**2) / 4),  # the run does not show it
    ],
)
def test_the_part_of_the_damping_in_the_joints_follows_from_its_exponent(
    exponent: float, information: float, expected: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(frequencies, "variance_inflation", lambda *_: 1.0)
    fit = SimpleNamespace(
        parameters=(("damping", 0), ("damping_exponent", None)),
        modes=(SimpleNamespace(damping_exponent=exponent),),
        hessian=np.diag([1.0, information + 0.7**-2]),
    )
    assert _damping_error(cast(JointFit, fit)) == pytest.approx(expected, abs=1e-5)


def test_less_certain_exponents_leave_more_to_the_joints(monkeypatch: pytest.MonkeyPatch) -> None:
    errors = []
    for inflation in (1.0, 100.0):
        monkeypatch.setattr(frequencies, "variance_inflation", lambda *_, factor=inflation: factor)
        fit = SimpleNamespace(
            parameters=(("damping_exponent", None),),
            modes=(SimpleNamespace(damping_exponent=1.0),),
            hessian=np.array([[100.0]]),
        )
        errors.append(_damping_error(cast(JointFit, fit)))
    assert errors[0] < errors[1] < 1.5 * (1 + 0.9**2) / 4
    without = SimpleNamespace(parameters=())
    assert _damping_error(cast(JointFit, without)) == pytest.approx(1.5 * (1 + 0.9**2) / 4)
