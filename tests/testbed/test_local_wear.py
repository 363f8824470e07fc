"""Wear that is local: a nut that is pressed more here than there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from benchmarks.testbed import potential
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.testbed.rigs import NO_WAVES, RATE, lossless, machine

from ballscrew.base.errors import InputError
from ballscrew.testbed.example import LOAD, PLAN, example_rig
from ballscrew.testbed.forces import drag_share, pressed_at, spring_forces
from ballscrew.testbed.integrator import integrate
from ballscrew.testbed.linear import true_frequency
from ballscrew.testbed.machine import constants
from ballscrew.testbed.run import truth
from ballscrew.testbed.trip import prepared, simulate_trip

DENT = ((0.10, 0.0), (0.20, 2e-6), (0.30, 0.0))
WAY = st.floats(-8e-6, 8e-6)


def test_without_loss_it_is_the_same_everywhere():
    even = machine()
    assert even.pressed([0.0, 0.3]) == pytest.approx(constants(even, 0.0, 0.0).pressed)
    np.testing.assert_allclose(even.local_preload([0.0, 0.3]), even.preload)
    np.testing.assert_array_equal(even.local_backlash([0.0, 0.3]), 0.0)


def test_a_loss_everywhere_is_another_preload():
    lost = 1.5e-6
    worn = machine(lost=((0.0, lost),))
    remaining = float(worn.local_preload(0.2))
    alike = replace(worn, preload=remaining, lost=())
    frequencies = [true_frequency(constants(item, 50.0, 0.2), 0.2) for item in (worn, alike)]
    assert frequencies[0] == pytest.approx(frequencies[1], rel=1e-9)
    assert remaining < 0.8 * worn.preload


def test_what_is_lost_beyond_the_preload_is_backlash():
    new = machine()
    deep = replace(new, lost=((0.0, float(new.pressed(0.0)) + 1e-6),))
    assert float(deep.local_preload(0.3)) == 0.0
    assert float(deep.local_backlash(0.3)) == pytest.approx(2e-6)


def test_the_kernel_looks_up_what_the_machine_says():
    dented = machine(lost=DENT)
    c = constants(dented, 0.0, 0.2)
    for place in (-0.05, 0.1, 0.1504, 0.2, 0.27, 0.3, 0.5):
        pressed, _ = pressed_at(c, place)
        # The grid's places do not fall on the dent's own.
        assert pressed == pytest.approx(float(dented.pressed(place)), abs=2e-8)
        share = float(dented.local_preload(place)) / dented.preload
        assert drag_share(c, place) == pytest.approx(share, abs=5e-3)


@settings(max_examples=60, deadline=None)
@given(place=st.floats(0.105, 0.295), ways=st.tuples(WAY, WAY, WAY, WAY))
def test_forces_are_minus_the_gradient_where_wear_is_local(place, ways):
    c = constants(machine(lost=((0.0, 0.0), (0.4, 4e-6))), 10.0, 0.2)
    where = np.array([place + ways[0], place + ways[1], ways[2], place, ways[3]])
    forces = spring_forces(c, *where)[:5]
    step = 1e-8
    for index, force in enumerate(forces):
        up, down = where.copy(), where.copy()
        up[index] += step
        down[index] -= step
        slope = (potential(c, *up) - potential(c, *down)) / (up[index] - down[index])
        assert force == pytest.approx(-slope, rel=1e-4, abs=0.05)


def test_a_tight_place_pushes_the_nut_away():
    c = lossless(constants(machine(lost=((0.0, 0.0), (0.4, 4e-6))), 0.0, 0.2))
    fx = spring_forces(c, 0.2, 0.2, 0.0, 0.2, 0.0)[3]
    assert fx > 0  # towards where more is lost


def test_a_passage_over_the_dent_keeps_its_energy():
    from tests.testbed.rigs import OFF

    c = lossless(constants(machine(lost=DENT), 0.0, 0.2))
    state = np.zeros(11)
    state[[0, 1, 3]], state[[5, 6, 8]] = 0.12, 0.15
    n = round(1.2 * RATE)
    _, end = integrate(c, OFF, np.zeros((n, 3)), np.zeros((n, 2)), NO_WAVES, 8, RATE, state)
    assert end[3] > 0.29  # it went in and out again

    def energy(s):
        kinetic = 0.5 * (np.array([c.motor, c.screw, c.rod, c.table, c.bed]) * s[5:10] ** 2).sum()
        return kinetic + potential(c, *s[:5])

    moving = energy(state) - potential(c, 0.0, 0.0, 0.0, 0.0, 0.0)
    assert energy(end) - energy(state) == pytest.approx(0.0, abs=2e-4 * abs(moving))


def test_the_truth_is_reported_stop_by_stop():
    rig = example_rig()
    dented = replace(rig, machine=replace(rig.machine, lost=((0.0, 0.0), (0.2, 3e-6), (0.45, 0.0))))
    reported = truth(dented, PLAN, LOAD)
    even = truth(rig, PLAN, LOAD)
    falls = [
        even["axial_natural_frequency_Hz"][f"{x:.6f}"] - reported["axial_natural_frequency_Hz"][f"{x:.6f}"]
        for x in PLAN.positions
    ]
    assert falls[0] == pytest.approx(0.0, abs=1e-9)
    assert falls[-1] == pytest.approx(0.0, abs=1e-9)
    assert np.argmax(falls) in (4, 5)
    assert reported["preload_N"] < even["preload_N"]
    assert min(reported["local_preload_N"].values()) < 0.6 * rig.machine.preload


def test_a_trip_over_a_worn_place_loses_drag_there():
    rig = example_rig()
    gone = replace(rig, machine=replace(rig.machine, lost=((0.20, 0.0), (0.21, 1e-5), (0.45, 1e-5))))
    new, worn = (simulate_trip(item, PLAN, PLAN.motions[0], LOAD, seed=3) for item in (rig, gone))
    place = new["position"]
    moving = np.abs(np.gradient(place)) * RATE > 0.14
    for low, high, same in ((0.02, 0.19, True), (0.25, 0.43, False)):
        part = moving & (place > low) & (place < high) & (np.gradient(place) > 0)
        loss = new["torque"][part].mean() - worn["torque"][part].mean()
        assert (abs(loss) < 0.005) if same else (loss > 0.03)


def test_a_nut_that_is_gone_in_the_middle_keeps_the_springs_damping():
    rig = example_rig()
    gone = replace(rig.machine, lost=((0.0, 0.0), (0.2, 2e-5), (0.45, 0.0)))
    assert prepared(gone, LOAD, PLAN).structural == prepared(rig.machine, LOAD, PLAN).structural


@pytest.mark.parametrize(
    "lost",
    [((0.1, 0.0), (0.1, 1e-6)), ((0.2, 0.0), (0.1, 0.0)), ((0.1, float("nan")),), ((float("inf"), 0.0),)],
)
def test_places_that_do_not_ascend_or_are_no_numbers(lost):
    with pytest.raises(InputError, match="lost approach"):
        machine(lost=lost)
