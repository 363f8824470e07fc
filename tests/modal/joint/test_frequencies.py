"""Frequencies of the cells by the final fit."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from tests.modal.joint.conftest import SmallRun, inertia_of

from ballscrew.modal.joint import frequencies
from ballscrew.modal.joint.blocks import make_block
from ballscrew.modal.joint.fit import SAMPLES_PER_INDEPENDENT, JointFit, Prior, fit_blocks
from ballscrew.modal.joint.frequencies import _damping_error
from ballscrew.modal.joint.mode import AxialMode, compliance_of
from ballscrew.modal.joint.profile import EXPONENT_DEVIATION, EXPONENT_MEAN
from ballscrew.modal.joint.settings import JointSettings
from ballscrew.modal.joint.windows import average_windows


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


PRIOR = SAMPLES_PER_INDEPENDENT / 0.7**2  # of the exponent, in the hessian of a fit
UNKNOWN = 1.5 * (1 + 0.9**2) / 4


def fit_with_exponent(exponent: float, information: float) -> JointFit:
    """Fit whose data alone give an exponent; the estimate of the fit is nearer to its prior."""
    estimate = (information * exponent + PRIOR * 0.5) / (information + PRIOR)
    fit = SimpleNamespace(
        parameters=(("damping", 0), ("damping_exponent", None)),
        modes=(SimpleNamespace(damping_exponent=min(estimate, 2.0)),),
        hessian=np.diag([1.0, information + PRIOR]),
    )
    return cast(JointFit, fit)


@pytest.mark.parametrize(
    ("exponent", "information", "expected"),
    [
        (4.0, 1e6, 1.5),  # at its limit: joints alone
        (1.9, 1e6, 1.5 * 0.95**2),
        (1.0, 1e6, 1.5 * 0.5**2),  # the screw is damped too
        (-1.0, 1e6, 0.0),  # the guide
        (1.0, 5.0, 1.5 * (1 + 1 / (5 + 0.9**-2)) / 4),
        (3.0, 5.0, 1.5),
        (3.0, 0.0, UNKNOWN),  # the run does not show it
    ],
)
def test_the_part_of_the_damping_in_the_joints_follows_from_its_exponent(
    exponent: float, information: float, expected: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(frequencies, "variance_inflation", lambda *_: 1.0)
    found = _damping_error(fit_with_exponent(exponent, information))
    assert found == pytest.approx(expected, abs=1e-5)


def test_less_certain_exponents_leave_more_to_the_joints(monkeypatch: pytest.MonkeyPatch) -> None:
    errors = []
    for inflation in (1.0, 100.0):
        monkeypatch.setattr(frequencies, "variance_inflation", lambda *_, factor=inflation: factor)
        errors.append(_damping_error(fit_with_exponent(1.0, 100.0)))
    assert errors[0] < errors[1] < UNKNOWN
    assert _damping_error(cast(JointFit, SimpleNamespace(parameters=()))) == pytest.approx(UNKNOWN)


def test_the_prior_of_the_exponent_is_that_of_a_fit(run: SmallRun) -> None:
    """The part of the hessian that the term takes out."""
    mass = inertia_of(run.trips)
    w = average_windows(run.trips, run.transients, mass, 90.0, 450.0)
    assert w is not None
    mode = AxialMode(compliance_of(160.0), 0.0, 0.0, 0.03, 0.0, 0.0, 0.0, 330.0, 0.03)
    prior = Prior((("damping_exponent", 1.0),), EXPONENT_MEAN, EXPONENT_DEVIATION)
    fit = fit_blocks([make_block("torque-nut", w)], [mode], ("damping_exponent",), [prior], most_steps=0)
    assert fit.hessian[0, 0] - fit.information[0, 0] == pytest.approx(PRIOR)
