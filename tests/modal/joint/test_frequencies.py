"""Frequencies of the cells by the final fit."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from ballscrew.modal.joint import frequencies
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
