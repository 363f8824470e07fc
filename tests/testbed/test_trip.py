"""A trip: deterministic, no two alike, quiet where nothing is wrong, and as noisy as a good real bench."""

from __future__ import annotations

from dataclasses import replace

import h5py
import numpy as np
import pytest
from tests.testbed.rigs import OFF

from ballscrew.fcft.schedule import trip_time
from ballscrew.testbed.example import AXIS, LOAD, PLAN, example_rig
from ballscrew.testbed.instruments import Instruments
from ballscrew.testbed.integrator import integrate
from ballscrew.testbed.linear import true_frequency
from ballscrew.testbed.trip import Disturbances, Variation, prepared, simulate_trip, waves

SHORT = replace(PLAN, positions=PLAN.positions[:3])
(MOTION,) = SHORT.motions
STEADY = replace(example_rig(), variation=Variation(0.0, 0.0, 0.0))
SILENT = replace(
    STEADY,
    disturbances=Disturbances(ripple=0.0, ball_pass=0.0, torque_noise=0.0),
    instruments=Instruments(torque_noise=0.0, current_noise=0.0, acceleration_noise=0.0, hum=0.0),
)


def test_the_same_seed_gives_the_same_trip():
    item, other = (simulate_trip(example_rig(), SHORT, MOTION, LOAD, 7) for _ in range(2))
    assert item.keys() == other.keys()
    assert all(np.array_equal(item[name], other[name]) for name in item)


def test_no_two_trips_are_alike():
    item, other = (simulate_trip(example_rig(), SHORT, MOTION, LOAD, seed) for seed in (1, 2))
    assert len(item["torque"]) != len(other["torque"])
    # Also where start and speed are the same, ripple, friction and noise are not.
    rig = replace(example_rig(), variation=Variation(0.0, 0.0, 0.05))
    item, other = (simulate_trip(rig, SHORT, MOTION, LOAD, seed) for seed in (1, 2))
    assert np.std(item["torque"] - other["torque"]) > 0.003


def test_it_takes_the_plans_time_and_goes_the_plans_way():
    channels = simulate_trip(STEADY, SHORT, MOTION, LOAD, 1)
    rate = STEADY.sample_rate
    assert len(channels["torque"]) == pytest.approx(trip_time(SHORT, MOTION) * rate, abs=2)
    position = channels["position"]
    assert position.max() == pytest.approx(SHORT.positions[-1], abs=2e-5)
    assert abs(position[-1] - SHORT.positions[0]) < 1e-5


@pytest.mark.parametrize("seed", range(4))
def test_trips_start_later_and_run_faster_or_slower_within_their_bounds(seed):
    channels = simulate_trip(example_rig(), SHORT, MOTION, LOAD, seed)
    planned = trip_time(SHORT, MOTION)
    took = len(channels["torque"]) / example_rig().sample_rate
    assert planned * 0.994 <= took <= planned * 1.006 + 0.2


def test_newton_holds_at_the_motor():
    """While the acceleration is held, the torque is inertia, friction and drag, with nothing left over."""
    channels = simulate_trip(SILENT, SHORT, MOTION, LOAD, 1)
    c = prepared(SILENT.machine, LOAD, SHORT)
    rate = SILENT.sample_rate
    start = round((MOTION.dwell + 0.6 * MOTION.acceleration_time) * rate)
    part = slice(start, start + round(0.3 * MOTION.acceleration_time * rate))
    beta = AXIS.screw.lead / (2 * np.pi)
    force = channels["torque"][part].mean() / beta
    speed = np.diff(channels["position"])[part].mean() * rate
    mass = c.motor + c.screw + c.table + c.rod
    expected = (
        mass * channels["acc1_x"][part].mean() + c.coulomb + c.drag + (c.viscous + c.motor_viscous) * speed
    )
    assert force == pytest.approx(expected, rel=0.02)


def test_the_instruments_are_no_quieter_than_the_bench(foreign_bench):
    channels = simulate_trip(example_rig(), SHORT, MOTION, LOAD, 1)
    still = slice(200, 4000)
    with h5py.File(foreign_bench / "preload-4-percent-trip1.h5") as file:
        for name in ("torque", "acc1_x", "acc1_y", "acc2_z", "current_u"):
            theirs, ours = file[name][still], channels[name][still]
            assert np.std(np.diff(ours)) > 0.7 * np.std(np.diff(theirs)), name
        steps = np.diff(np.unique(file["position"][:4000]))
        assert np.diff(np.unique(channels["position"])).min() > 0.9 * steps.min()


def test_a_worn_nut_rings_lower_and_a_loaded_table_too():
    def true(preload, load):
        return true_frequency(prepared(example_rig(preload).machine, load, PLAN), 0.1)

    assert true(340.0, LOAD) < true(680.0, LOAD) - 3
    assert true(680.0, LOAD + 20) < true(680.0, LOAD) - 3


def test_a_nut_with_backlash_still_runs():
    channels = simulate_trip(example_rig(0.0, 2e-6), SHORT, MOTION, LOAD, 1)
    assert all(np.all(np.isfinite(values)) for values in channels.values())


def test_ripple_has_its_orders():
    """Along the motor's way the force has a line at each order, and none between."""
    place = np.linspace(0, 10 * AXIS.screw.lead, 20_000, endpoint=False)
    sizes = Disturbances(ripple_orders=(6.0, 12.0), ripple=0.01, ball_pass=1.0, torque_noise=0.0)
    found = waves(sizes, example_rig().machine, np.random.default_rng(1))
    forces = np.sin(np.outer(place, found[:, 0]) + found[:, 1]) @ found[:, 2:]
    beta = AXIS.screw.lead / (2 * np.pi)
    lines = np.abs(np.fft.rfft(forces[:, 0])) * 2 / len(place) * beta
    assert lines[60] == pytest.approx(0.01, rel=1e-6)
    assert lines[120] == pytest.approx(0.01 * 2 / 3, rel=1e-6)
    assert np.delete(lines, [60, 120]).max() < 1e-6
    assert np.abs(forces[:, 1]).max() == pytest.approx(1.0, rel=1e-3)


def test_ripple_is_the_motors_and_balls_creep():
    """From trip to trip only the balls lie elsewhere; another motor has other phases."""
    machine = example_rig().machine
    item, other = (waves(Disturbances(), machine, np.random.default_rng(trip)) for trip in (1, 2))
    assert np.array_equal(item[:-1], other[:-1])
    assert item[-1, 1] != other[-1, 1]
    another = waves(Disturbances(ripple_seed=2), machine, np.random.default_rng(1))
    assert not np.any(another[:-1, 1] == item[:-1, 1])


def test_ripple_pushes_where_the_motor_is():
    """A motor that lags by half a wave is pushed the other way than one that does not."""
    lag = 0.5 * AXIS.screw.lead / 12
    beta = AXIS.screw.lead / (2 * np.pi)
    once = np.array([[12 / beta, 0.3, 5.0, 0.0]])
    c = prepared(example_rig().machine, LOAD, PLAN)
    pushed = []
    for place in (0.1, 0.1 + lag):
        start = np.zeros(11)
        start[[0, 1, 3]] = place
        still = np.zeros((1, 3))
        records, _ = integrate(c, OFF, still, np.zeros((1, 2)), once, 4, 12800.0, start)
        pushed.append(records[0, 2])
    assert pushed[0] == pytest.approx(-pushed[1], rel=1e-3)
    assert abs(pushed[0]) > 0


@pytest.mark.parametrize("rig", [replace(SILENT, instruments=replace(SILENT.instruments, torque_delay=1e-3))])
def test_a_torque_that_is_reported_late(rig):
    late = simulate_trip(rig, SHORT, MOTION, LOAD, 1)["torque"]
    prompt = simulate_trip(SILENT, SHORT, MOTION, LOAD, 1)["torque"]
    samples = 1e-3 * rig.sample_rate
    shifted = np.interp(np.arange(len(prompt)) - samples, np.arange(len(prompt)), prompt)
    assert np.abs(late - shifted)[100:].max() < 1.1e-3


def test_the_two_accelerometers_see_the_pitch_of_the_table_otherwise():
    rig = replace(SILENT, instruments=replace(SILENT.instruments, pitch_frequency=300.0))
    channels = simulate_trip(rig, SHORT, MOTION, LOAD, 1)
    spectrum = np.abs(np.fft.rfft(channels["acc1_x"] - channels["acc2_x"]))
    frequency = np.fft.rfftfreq(len(channels["acc1_x"]), 1 / rig.sample_rate)
    high = frequency > 230
    assert frequency[high][spectrum[high].argmax()] == pytest.approx(300, abs=15)


def test_optional_probes():
    rig = replace(
        example_rig(0.0, 2e-6),
        instruments=Instruments(linear_scale=True, backlash_probe=True, acceleration_range=1.0),
    )
    channels = simulate_trip(rig, SHORT, MOTION, LOAD, 1)
    assert channels["backlash"].mean() == pytest.approx(2e-6, rel=0.01)
    assert np.abs(channels["scale"] - channels["position"]).max() < 5e-5
    assert np.abs(channels["acc1_x"]).max() == 1.0
