"""The iteration of a fit, and limits of its parameters."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.modal.joint.conftest import SmallRun

from ballscrew.modal.joint import parameters
from ballscrew.modal.joint.blocks import Block
from ballscrew.modal.joint.fit import JointFit, Prior, fit_blocks
from ballscrew.modal.joint.mode import AxialMode, compliance_of
from ballscrew.modal.joint.parameters import limits_of

FIELDS = ("compliance", "damping", "slope")
WIDE = 50.0
PRIOR = [Prior((("damping_exponent", 1.0),), 0.5, 0.7)]


def initial(run: SmallRun, power: float) -> AxialMode:
    middle = float(np.mean(list(run.free.values())))
    return AxialMode(
        compliance_of(middle), 0.3, 0.0, 0.03, 0.0, 0.0, 0.0, 330.0, 0.03, damping_exponent=power
    )


@pytest.fixture(scope="module")
def free(run: SmallRun, blocks: list[Block]) -> JointFit:
    """The fit with wide limits of the power."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(parameters._LIMITS, "damping_exponent", (-WIDE, WIDE))
        return fit_blocks(blocks[:1], [initial(run, 0.0)], (*FIELDS, "damping_exponent"), PRIOR, 30, 1e-12)


@pytest.mark.parametrize("side", [-1, 1])
@pytest.mark.parametrize("start", [-1.9, 1.9])
def test_a_limit_is_reached_and_the_other_parameters_are_as_with_the_field_at_it(
    run: SmallRun,
    blocks: list[Block],
    free: JointFit,
    side: int,
    start: float,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    assert abs(free.modes[0].damping_exponent) < WIDE
    limit = free.modes[0].damping_exponent + 0.3 * side
    limits = (limit, WIDE) if side > 0 else (-WIDE, limit)
    monkeypatch.setitem(parameters._LIMITS, "damping_exponent", limits)
    found = fit_blocks(blocks[:1], [initial(run, start)], (*FIELDS, "damping_exponent"), PRIOR, 30, 1e-12)
    there = fit_blocks(blocks[:1], [initial(run, limit)], FIELDS, (), 30, 1e-12)
    assert found.modes[0].damping_exponent == limit
    assert found.log_residual > free.log_residual
    for field in FIELDS:
        assert getattr(found.modes[0], field) == pytest.approx(getattr(there.modes[0], field), rel=1e-4)


@pytest.mark.parametrize("side", [-1, 1])
def test_a_limit_at_which_a_fit_begins_is_left(
    run: SmallRun, blocks: list[Block], free: JointFit, side: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    begin = free.modes[0].damping_exponent + 0.5 * side
    limits = (-WIDE, begin) if side > 0 else (begin, WIDE)
    monkeypatch.setitem(parameters._LIMITS, "damping_exponent", limits)
    found = fit_blocks(blocks[:1], [initial(run, begin)], (*FIELDS, "damping_exponent"), PRIOR, 30, 1e-12)
    assert found.modes[0].damping_exponent == pytest.approx(free.modes[0].damping_exponent, abs=0.01)


def test_limits_are_those_of_the_parameters() -> None:
    """Logarithms for fields whose logarithm is fitted; the values of limits are modes at the limits."""
    which = [("damping", 0), ("damping_exponent", None), ("slope", 0), ("local:0", None)]
    low, high = limits_of(which)
    np.testing.assert_allclose(np.exp([low[0], high[0]]), (1e-3, 0.5))
    assert (low[1], high[1], low[3], high[3]) == (-2.0, 2.0, -0.8, 20.0)
    assert np.isinf(low[2])
    assert np.isinf(high[2])


def test_a_response_without_a_residual_is_fitted(run: SmallRun, blocks: list[Block]) -> None:
    """As of a sensor that shows nothing: the weight of its residual is still a number."""
    w = replace(blocks[0].windows, nut=np.zeros_like(blocks[0].windows.nut))
    silent = replace(blocks[0], windows=w)
    found = fit_blocks([silent], [initial(run, 0.0)], (*FIELDS, "damping_exponent"), PRIOR)
    assert np.isfinite(found.hessian).all()
    assert all(np.isfinite(each).all() for each in found.residual)


def test_a_parameter_without_a_range_stays(
    run: SmallRun, blocks: list[Block], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(parameters._LIMITS, "damping_exponent", (0.5, 0.5))
    found = fit_blocks(blocks[:1], [initial(run, 0.0)], ("damping_exponent",), PRIOR, 30, 1e-12)
    assert found.modes == (initial(run, 0.5),)
