"""Derivatives of the models, and the normal equations of a step."""

from __future__ import annotations

import numpy as np
import pytest
from tests.modal.joint.conftest import SmallRun

from ballscrew.modal.joint.blocks import Block, make_block, project
from ballscrew.modal.joint.jacobian import model_jacobian, normal_equations
from ballscrew.modal.joint.local_wear import local_fields, with_stops
from ballscrew.modal.joint.mode import AxialMode, compliance_of
from ballscrew.modal.joint.parameters import Parameter, read_parameter

PARAMETERS: list[Parameter] = [
    ("damping_exponent", None),
    *((f, k) for k in (0, 1) for f in ("compliance", "slope")),
]


def test_a_block_that_depends_on_no_parameter_adds_nothing(run: SmallRun, blocks: list[Block]) -> None:
    middle = float(np.mean(list(run.free.values())))
    mode = AxialMode(compliance_of(middle), 0.3, 0.0, 0.03, 0.0, 0.0, 0.0, 330.0, 0.03)
    only: list[Parameter] = [("compliance", 0)]
    solved, values = [project(b, mode) for b in blocks[:2]], np.array([read_parameter(mode, "compliance")])
    first = normal_equations(blocks[:1], (mode,), solved[:1], (1.0,), only, values)
    both = normal_equations(blocks[:2], (mode, mode), solved, (1.0, 1.0), only, values)
    np.testing.assert_array_equal(both[0], first[0])
    np.testing.assert_array_equal(both[1], first[1])


@pytest.mark.parametrize("local", [False, True])
def test_normal_equations_are_the_products_of_the_jacobian(
    run: SmallRun, blocks: list[Block], local: bool
) -> None:
    w = blocks[0].windows
    ripple = np.random.default_rng(0).normal(size=(len(w.centred_position), 2))
    mixed = [
        make_block("torque-nut", w, ripple=ripple),
        blocks[1],
        make_block("torque-motor", w, ripple=ripple),
    ]
    middle, parameters = float(np.mean(list(run.free.values()))), list(PARAMETERS)
    mode = AxialMode(compliance_of(1.02 * middle), 0.3, 0.0, 0.03, 0.0, 0.0, 0.0, 330.0, 0.03)
    modes = (mode,) * len(mixed)
    if local:
        places = tuple(np.unique(w.stops).tolist())
        modes = with_stops(modes, places)
        parameters += [(field, None) for field in local_fields(places)]
    solved, weights = [project(b, m) for b, m in zip(mixed, modes, strict=True)], (1.0, 2.0, 3.0)
    values = np.array([read_parameter(modes[0], field) for field, _ in parameters])

    jacobian = model_jacobian(mixed, modes, solved, weights, parameters, values)
    hessian, descent = normal_equations(mixed, modes, solved, weights, parameters, values)

    expected = sum(j.T @ j for j in jacobian)
    size = np.sqrt(np.diag(expected))
    assert (size > 0).all()
    np.testing.assert_allclose(hessian / np.outer(size, size), expected / np.outer(size, size), atol=1e-6)
    residuals = [weight * s.residual.ravel() for weight, s in zip(weights, solved, strict=True)]
    towards = sum(j.T @ r for j, r in zip(jacobian, residuals, strict=True))
    length = np.linalg.norm(np.concatenate(residuals))
    np.testing.assert_allclose(descent / size / length, towards / size / length, atol=1e-6)
    assert np.abs(towards / size / length).max() > 1e-3
