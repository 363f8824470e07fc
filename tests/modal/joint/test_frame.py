"""A frame whose mode is near the axial one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.modal.joint.conftest import SmallRun, small_run

from ballscrew.axis.sheet import DataSheet
from ballscrew.modal.joint.identify import identify_jointly
from ballscrew.modal.joint.result import JointResult
from ballscrew.testbed.example import LOAD
from ballscrew.testbed.trip import Rig

MOVING = 91.5 + 0.8  # of the example, with a third of the screw, kg


@pytest.fixture(scope="module")
def framed(rig: Rig) -> SmallRun:
    """The example on a frame of eight times the moving mass at 0.93 of the axial mode."""
    machine = replace(rig.machine, bed_mass=8 * MOVING, bed_frequency=155.0, bed_damping=0.05)
    return small_run(replace(rig, machine=machine))


@pytest.fixture(scope="module")
def result(framed: SmallRun, sheet: DataSheet) -> JointResult:
    return identify_jointly(framed.trips, framed.transients, sheet, LOAD)


@pytest.mark.slow
def test_the_frequencies_are_those_with_the_frame_blocked(result: JointResult, framed: SmallRun) -> None:
    off, spread = [], []
    for cell in result.cells:
        assert cell.frequency_Hz is not None
        assert cell.standard_uncertainty_Hz is not None
        off.append(cell.frequency_Hz - framed.free[cell.position_m])
        spread.append(cell.standard_uncertainty_Hz)
    assert np.abs(off).max() < 0.8
    assert (np.abs(off) < 3 * np.array(spread)).all()
    assert all(
        cell.uncertainty_terms_Hz["frame"] == pytest.approx(7e-4 * cell.frequency_Hz) for cell in result.cells
    )


def test_the_frame_is_reported(result: JointResult) -> None:
    frame = result.frame_mode
    assert frame is not None
    assert frame.distinct
    assert frame.frequency_Hz == pytest.approx(155.0, abs=1.0)
    assert frame.damping_ratio == pytest.approx(0.05, abs=0.01)
    assert frame.mass_ratio == pytest.approx(8.0, rel=0.1)
    assert frame.residual_ratio < 0.7


def test_a_machine_on_soft_mounts_shows_no_frame(run: SmallRun, sheet: DataSheet) -> None:
    assert identify_jointly(run.trips, run.transients, sheet, LOAD).frame_mode is None
