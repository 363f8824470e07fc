"""A force at the nut between whole orders of a turn is found, and none where there is none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.modal.joint.conftest import SmallRun
from tests.modal.joint.test_ripple import LEAD, first_fit

from ballscrew.modal.joint.balls import ball_forces, find_balls
from ballscrew.modal.joint.blocks import make_block, simulate
from ballscrew.modal.joint.fit import JointFit
from ballscrew.modal.joint.windows import Windows


@pytest.fixture(scope="module")
def fitted(run: SmallRun) -> JointFit:
    return first_fit(run)[0]


def pushed_windows(fitted: JointFit, order: float, size: float) -> Windows:
    """Modelled response with noise, and with that to a force of another phase in each direction."""
    w, mode = fitted.blocks[0].windows, fitted.modes[0]
    b = make_block("torque-nut", w, balls=ball_forces(w, LEAD, order))
    response = simulate(b, mode).ripple_response @ np.array([1.0, 0.3, -0.2, 0.9])
    noise = np.random.default_rng(0).normal(scale=0.05, size=w.nut.shape)
    return replace(w, nut=fitted.projections[0].model.T + noise + size * response)


def test_the_order_is_found(fitted: JointFit) -> None:
    w = pushed_windows(fitted, 12.37, 0.01)
    found = find_balls("torque-nut", w, fitted.modes[0], LEAD, np.empty((len(w.centred_position), 0)))
    assert found == pytest.approx(12.37, abs=0.005)


def test_noise_is_no_force(fitted: JointFit) -> None:
    w = pushed_windows(fitted, 12.37, 0.0)
    assert find_balls("torque-nut", w, fitted.modes[0], LEAD, np.empty((len(w.centred_position), 0))) is None
    assert ball_forces(w, LEAD, None).shape == (len(w.centred_position), 0)


def test_one_direction_may_have_no_sample_that_counts(fitted: JointFit) -> None:
    w = pushed_windows(fitted, 12.37, 0.03)
    one_way = replace(w, in_motion=w.in_motion & (w.direction > 0))
    found = find_balls("torque-nut", one_way, fitted.modes[0], LEAD, np.empty((len(w.centred_position), 0)))
    assert found == pytest.approx(12.37, abs=0.2)  # fewer samples resolve an order less well


def test_it_drives_both_modes(fitted: JointFit) -> None:
    """The motor's motion does not contain a force at the nut."""
    w = fitted.blocks[0].windows
    forces = ball_forces(w, LEAD, 12.37)
    for name in ("torque-nut", "motor-nut", "torque-motor"):
        assert make_block(name, w, balls=forces).ripple.shape[1] == 4


def test_a_way_of_less_than_two_turns_resolves_no_order_between_whole_ones(fitted: JointFit) -> None:
    w = pushed_windows(fitted, 12.37, 0.03)
    lead = float(np.ptp(w.centred_position)) / 1.9
    assert find_balls("torque-nut", w, fitted.modes[0], lead, np.empty((len(w.centred_position), 0))) is None
