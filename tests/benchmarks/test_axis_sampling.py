from __future__ import annotations

from dataclasses import asdict

import numpy as np
import pytest
from benchmarks.axis_sampling import RandomAxis, random_axis

from ballscrew.base.errors import InputError
from ballscrew.fcft.conditions import Condition
from ballscrew.fcft.limits import require_safe
from ballscrew.fcft.nutload import nut_load
from ballscrew.fcft.plan import validate_plan
from ballscrew.testbed.linear import true_frequency
from ballscrew.testbed.trip import prepared, simulate_trip

SEEDS = range(20)


@pytest.fixture(scope="module")
def axes() -> list[RandomAxis]:
    return [random_axis(seed) for seed in SEEDS]


def test_the_seed_decides_everything(axes):
    for seed, axis in zip(SEEDS, axes, strict=True):
        assert asdict(random_axis(seed)) == asdict(axis)
    assert len({axis.frequency for axis in axes}) == len(axes)


def test_the_data_sheet_errs_within_the_makers_tolerances(axes):
    off = np.array(
        [
            [
                axis.rig.machine.sheet.screw.rigidity / axis.data_sheet.screw.rigidity,
                axis.rig.machine.sheet.bearing.stiffness / axis.data_sheet.bearing.stiffness,
                axis.rig.machine.preload / axis.data_sheet.nominal_preload,
            ]
            for axis in axes
        ]
    )
    most = np.array([0.20, 0.30, 0.15])
    assert np.all(np.abs(off - 1) <= most)
    assert np.all(np.abs(off - 1).max(axis=0) > 0.7 * most)  # and they use them
    for axis in axes:
        assert axis.rig.machine.preload == axis.rig.machine.sheet.nominal_preload
        assert axis.rig.machine.sheet.table == axis.data_sheet.table
        assert axis.rig.machine.sheet.drive == axis.data_sheet.drive


def test_values_lie_in_their_ranges(axes):
    for axis in axes:
        screw, machine, motion = axis.data_sheet.screw, axis.rig.machine, axis.plan.motions[0]
        assert 0.016 <= screw.nominal_diameter <= 0.040
        assert screw.root_diameter < screw.nominal_diameter
        assert 0.2 < screw.lead / screw.nominal_diameter < 0.65
        assert 9e3 <= screw.dynamic_load_rating <= 40e3
        assert 230e6 <= screw.rigidity <= 800e6
        assert 100e6 <= axis.data_sheet.bearing.stiffness <= 400e6
        assert 0.015 <= machine.damping_ratio <= 0.05
        assert 600 <= motion.jerk <= 2500
        assert axis.data_sheet.guide.friction < 0.15 * machine.preload
        constants = prepared(machine, axis.load, axis.plan)
        middle = (axis.plan.positions[0] + axis.plan.positions[-1]) / 2
        assert axis.frequency == true_frequency(constants, middle)
        assert 1.4 <= axis.rig.instruments.pitch_frequency / axis.frequency <= 2.2
        assert 80 < axis.frequency < 400
    diameters = [axis.data_sheet.screw.nominal_diameter for axis in axes]
    assert min(diameters) < 0.020
    assert max(diameters) > 0.032
    assert len({axis.data_sheet.screw.lead for axis in axes}) > 1


def test_the_plan_suits_the_axis(axes):
    for axis in axes:
        motion = axis.plan.motions[0]
        validate_plan(axis.plan, axis.data_sheet)
        require_safe(axis.plan, axis.rig.machine.sheet)
        loads = [abs(nut_load(axis.data_sheet, motion, axis.load, condition)) for condition in Condition]
        assert max(loads) <= axis.rig.machine.preload
        assert motion.reaches_acceleration
        assert motion.jerk_time < 1 / (2 * axis.frequency)
        assert axis.plan.masses == (axis.load,)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_trip_runs(axes, seed):
    axis = axes[seed]
    channels = simulate_trip(axis.rig, axis.plan, axis.plan.motions[0], axis.load, seed)
    assert all(np.all(np.isfinite(values)) for values in channels.values())
    position, acceleration = channels["position"], channels["acc1_x"]
    assert position.max() == pytest.approx(axis.plan.positions[-1], abs=2e-3)
    assert abs(position[-1] - axis.plan.positions[0]) < 5e-5
    assert np.abs(acceleration).max() < 3 * axis.plan.motions[0].acceleration
    # The servo holds the table: it does not ring on at the last stop.
    assert np.std(acceleration[-1000:]) < 0.05 * np.abs(acceleration).max()


@pytest.mark.parametrize("seed", [-1, 1.5, "1", None, True])
def test_seeds_that_cannot_be(seed):
    with pytest.raises(InputError, match="seed"):
        random_axis(seed)
