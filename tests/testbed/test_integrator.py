"""Energy, convergence, damping, poles and nut forces of what the kernel integrates."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from benchmarks.testbed import potential
from tests.testbed.rigs import AXES, NO_WAVES, OFF, RATE, Array, at, coupled, lossless, machine, plain, run

from ballscrew.fcft.conditions import Condition
from ballscrew.fcft.plan import Motion, Plan
from ballscrew.fcft.profile import planned_transients, profile, set_points
from ballscrew.testbed.forces import nut_force, spring_forces
from ballscrew.testbed.integrator import integrate
from ballscrew.testbed.linear import natural_frequencies, structural_damping, true_frequency
from ballscrew.testbed.machine import Constants, Machine, constants
from ballscrew.testbed.servo import Servo, loop
from ballscrew.testbed.trip import prepared

MOTION = Motion(0.15, 2.0, 2000.0, 0.35)
_KICK = 0.06  # m/s
PLAN = Plan((0.0, 0.1, 0.2), 1, (0.0,), (MOTION,))


def _energy(c: Constants, state: Array) -> float:
    inertia = np.array([c.motor, c.screw, c.rod, c.table, c.bed])
    return float(0.5 * inertia @ state[5:10] ** 2 + potential(c, *state[:5]))


def _swinging() -> Array:
    """Running along the screw and swinging so far that the flanks let go in turn."""
    state = at(0.2, 0.1)
    state[8] += _KICK
    return state


def _energies(c: Constants, steps: int, count: int = 4000) -> tuple[Array, float]:
    """Energy after every sample, and how much of it swings."""
    state = _swinging()
    start = _energy(c, state)
    stored = []
    for _ in range(count):
        _, state = run(c, state, 1, steps)
        stored.append(_energy(c, state))
    m = c.motor + c.screw
    relative = 0.5 * m * c.table / (m + c.table) * _KICK**2
    return np.array(stored) - start, relative


def test_the_swinging_machine_does_lose_contact():
    c = plain()
    records, end = run(c, _swinging(), 4000)
    assert np.abs(records[:, 6]).max() > 1.5 * 2.83 * 680
    assert end[3] > 0.22


def test_energy_is_conserved_without_friction_and_control():
    c = plain()
    off, swinging = _energies(c, 4)
    assert np.abs(off).max() < 0.06 * swinging
    early, late = off[:1000].mean(), off[-1000:].mean()
    assert abs(late - early) < 2e-3 * swinging


def test_energy_error_falls_with_the_step():
    c = plain()
    worst = [float(np.abs(_energies(c, steps, 500)[0]).max()) for steps in (4, 8, 16, 32)]
    ratios = np.array(worst[:-1]) / np.array(worst[1:])
    assert np.all((ratios > 1.7) & (ratios < 2.5))


def test_energy_is_not_conserved_with_damping():
    c = plain()._replace(structural=5e-5)
    off, swinging = _energies(c, 4, 1000)
    assert off[-1] < -0.3 * swinging


def test_momentum_is_conserved_by_forces_between_screw_and_nut():
    """A ball-pass force acts and reacts: without mounts nothing pushes the machine as a whole."""
    c = plain()._replace(bed_stiffness=0.0)
    pushed = np.zeros((2000, 2))
    pushed[:, 1] = 50 * np.sin(np.arange(2000) / 20)
    _, end = integrate(c, OFF, np.zeros((2000, 3)), pushed, NO_WAVES, 4, RATE, at(0.2))
    along = c.rod * end[7] + c.table * end[8] + c.bed * end[9]
    assert np.abs(end[5:10]).max() > 1e-5
    assert abs(along) < 1e-9 * c.table


def _departure(steps: int) -> Array:
    c = prepared(machine(), 0.0, PLAN)
    move = profile(PLAN, MOTION)
    points = set_points(move, np.arange(int(0.6 * RATE)) / RATE)
    wanted = np.stack([points.position, points.speed, points.acceleration], axis=1)
    servo = loop(Servo(resolution=0.0), machine(), c)
    return integrate(c, servo, wanted, np.zeros((len(wanted), 2)), NO_WAVES, steps, RATE, at(0.0))[0]


def test_a_departure_converges_with_the_step():
    fine = _departure(128)[:, 1]
    error = [float(np.sqrt(np.mean((_departure(s)[:, 1] - fine) ** 2))) for s in (4, 8, 16, 32)]
    size = float(np.sqrt(np.mean(fine**2)))
    assert error[0] < 0.01 * size
    ratios = np.array(error[:-1]) / np.array(error[1:])
    assert np.all(ratios > 1.7)


def _decay(c: Constants) -> float:
    """Damping ratio of a free decay, on the move, since what stands is held by friction.

    With a kick and without, so that all but the kick cancels.
    """
    steady = c.coulomb + c.drag + (c.viscous + c.motor_viscous) * 0.1
    settled = run(c, at(0.05, 0.1), 4000, 4, steady)[1]
    kicked = settled.copy()
    kicked[8] += 1e-3
    free = run(c, kicked, 2000, 4, steady)[0][:, 1] - run(c, settled, 2000, 4, steady)[0][:, 1]
    w = 2 * math.pi * true_frequency(c, 0.1)
    # After the shaft's own fast modes are gone; the peaks of the decay.
    first = round(4 * 2 * math.pi / w * RATE)
    tail = np.abs(free[first : first + round(8 * 2 * math.pi / w * RATE)])
    top = [i for i in range(1, len(tail) - 1) if tail[i] >= max(tail[i - 1], tail[i + 1])]
    return float(-np.polyfit(np.array(top) / RATE, np.log(tail[top]), 1)[0] / w)


@pytest.mark.parametrize("name", AXES)
@pytest.mark.parametrize("ratio", [0.015, 0.03, 0.05])
def test_a_free_decay_has_the_damping_ratio_that_was_asked_for(name, ratio):
    c = constants(replace(machine(name), sheet=coupled(AXES[name], 5000.0)), 0.0, 0.1)
    c = c._replace(structural=structural_damping(c, 0.1, ratio))
    assert _decay(c) == pytest.approx(ratio, rel=0.05)


@pytest.mark.parametrize("ratio", [0.015, 0.03, 0.05])
def test_what_a_trip_is_prepared_with_decays_as_the_machine_says(ratio):
    axis = machine(damping_ratio=ratio)
    c = prepared(replace(axis, sheet=coupled(axis.sheet, 5000.0)), 0.0, PLAN)
    assert _decay(c) == pytest.approx(ratio, rel=0.10)


def test_guide_holds_the_table_until_it_breaks_away():
    c = constants(machine(), 0.0, 0.2)._replace(drag=0.0, structural=5e-5)
    slowly = np.minimum(np.arange(51200) / 25600, 1.0)
    stuck = run(c, at(0.2), 51200, 4, 20.0 * slowly)[1]
    # Slower than Stribeck's speed the way is −F_s/σ₀ ln(1 − F/F_s).
    way = -c.breakaway / c.bristle * math.log(1 - 20 / c.breakaway)
    assert stuck[3] - stuck[4] - 0.2 == pytest.approx(way, rel=0.03)
    assert np.abs(stuck[5:10]).max() < 1e-6
    gone = run(c, at(0.2), 12800, 4, 40.0)[1]
    assert gone[3] - 0.2 > 1e-3


# Poles.


def _shaken(bandwidth: float, noise_seed: int = 1) -> tuple[Array, Array]:
    """Torque and table acceleration in the closed loop, shaken by a white torque, without friction."""
    c = constants(machine(bed_mass=1e8, bed_frequency=0.1), 0.0, 0.0)
    c = lossless(c)._replace(structural=2 * 0.02 / (2 * math.pi * 181), viscous=50.0)
    servo = loop(Servo(speed_bandwidth=bandwidth, resolution=0.0, dead_samples=1), machine(), c)
    n = 20 * 12800
    pushed = np.zeros((n, 2))
    pushed[:, 0] = 20 * np.random.default_rng(noise_seed).standard_normal(n)
    records, _ = integrate(c, servo, np.zeros((n, 3)), pushed, NO_WAVES, 4, RATE, at(0.0))
    return records[:, 0] + pushed[:, 0], records[:, 1]


def _peaks(bandwidth: float) -> tuple[float, float]:
    """Peaks of the transfer function and of the response alone, Hz."""
    u, y = (x[: len(x) // 12800 * 12800].reshape(-1, 12800) * np.hanning(12800) for x in _shaken(bandwidth))
    fu, fy = np.fft.rfft(u), np.fft.rfft(y)
    h1 = np.abs((fu.conj() * fy).sum(0) / (np.abs(fu) ** 2).sum(0))
    response = np.convolve((np.abs(fy) ** 2).sum(0), np.ones(5), "same")
    near = slice(100, 260)
    return 100.0 + float(np.argmax(h1[near])), 100.0 + float(np.argmax(response[near]))


def test_the_pole_of_torque_to_acceleration_does_not_move_with_the_servo_but_the_response_does():
    slow, slow_response = _peaks(10.0)
    fast, fast_response = _peaks(150.0)
    assert slow == pytest.approx(181, abs=1.5)
    assert fast == pytest.approx(slow, abs=1)
    assert slow_response == pytest.approx(181, abs=3)
    assert fast_response < 170


# The nut's load.


@pytest.mark.parametrize("drag", [0.0, 1.0])
def test_nut_force_in_the_four_conditions(drag):
    """PA +Ma+F, PD −Ma+F, NA −Ma−F, ND +Ma−F: while the acceleration is held."""
    c = prepared(machine(drag_ratio=drag), 0.0, PLAN)
    move = profile(PLAN, MOTION)
    points = set_points(move, np.arange(int(move.duration * RATE)) / RATE)
    wanted = np.stack([points.position, points.speed, points.acceleration], axis=1)
    servo = loop(Servo(mass_ahead=1.0), machine(), c)
    records, _ = integrate(c, servo, wanted, np.zeros((len(wanted), 2)), NO_WAVES, 4, RATE, at(0.0))
    signs = {Condition.PA: (1, 1), Condition.PD: (-1, 1), Condition.NA: (-1, -1), Condition.ND: (1, -1)}
    observed = set()
    for transient in planned_transients(PLAN, MOTION):
        inside = slice(round((transient.start_s + 0.015) * RATE), round((transient.stop_s - 0.004) * RATE))
        forward, back = signs[transient.condition]
        speed = points.speed[inside].mean()
        expected = forward * c.table * 2.0 + back * (c.coulomb + c.viscous * abs(speed))
        assert records[inside, 6].mean() == pytest.approx(expected, rel=0.05), transient
        observed.add(transient.condition)
    assert observed == set(signs)


# The record.


def test_a_record_in_two_parts_is_the_record():
    c = plain()
    whole, end = run(c, _swinging(), 1000)
    first, middle = run(c, _swinging(), 400)
    second, last = run(c, middle, 600)
    assert np.array_equal(np.concatenate([first, second]), whole)
    assert np.array_equal(last, end)


def test_accelerations_are_means_over_the_sample():
    c = constants(machine(), 0.0, 0.2)
    before = at(0.2, 0.05)
    records, after = run(c, before, 1, 7, 500.0)
    for column, speed in ((1, 8), (2, 5), (3, 9)):
        assert records[0, column] == pytest.approx((after[speed] - before[speed]) * RATE, rel=1e-6, abs=1e-9)
    assert records[0, 5] == 0.2


def test_inputs_stay_as_they_are():
    c, state, pushed, wanted = plain(), at(0.2, 0.1), np.ones((50, 2)), np.zeros((50, 3))
    integrate(c, OFF, wanted, pushed, NO_WAVES, 4, RATE, state)
    assert np.array_equal(state, at(0.2, 0.1))
    assert np.all(pushed == 1)
    assert not wanted.any()


def test_nut_with_backlash_rattles_free():
    c = lossless(constants(replace(machine(preload_ratio=0.0), backlash=1e-5), 0.0, 0.2))
    state = at(0.2)
    state[8] = 1e-3
    records, end = run(c, state, 40)
    assert not records[:, 6].any()
    assert end[8] == 1e-3
    later, _ = run(c, state, 200)
    assert later[:, 6].min() < -1


def test_modes_have_no_stiffness_of_a_nut_without_preload():
    c = constants(machine(preload_ratio=0.0), 0.0, 0.2)
    assert np.sum(natural_frequencies(c, 0.2)[0] < 0.5) == 2


def test_oil_presses_the_flanks_of_a_moving_nut():
    """Pushed by the guide alone, the nut yields as one with its film's approach more."""
    sheet = AXES["M"]
    c = lossless(constants(Machine(sheet, 680.0, oil_film=3e-7), 0.0, 0.2))
    c = c._replace(viscous=3000.0, film=2 * c.film)
    end = run(c._replace(structural=2e-4), at(0.2, 0.1), 4000, 8, 300.0)[1]
    film = c.film * (abs(end[8] - end[9]) / 0.1) ** 0.67
    force, _ = nut_force(end[1] + end[2] - end[3], c.flank, c.pressed + film)
    dry, _ = nut_force(end[1] + end[2] - end[3], c.flank, c.pressed)
    assert force == pytest.approx(3000.0 * (end[8] - end[9]), rel=0.02)
    assert dry < 0.92 * force


def test_pitching_parts_the_mode_as_a_body_on_a_spring_does():
    """Peaks of a free decay against the eigenvalues with a sixth body."""
    base = machine(pitch_frequency=170.0, pitch_share=0.3, pitch_damping=0.0)
    c = lossless(constants(replace(base, sheet=coupled(AXES["M"], 5000.0)), 0.0, 0.2))
    mass, stiffness = np.zeros((6, 6)), np.zeros((6, 6))
    rest = np.array([0.2, 0.2, 0.0, 0.2, 0.0])
    for column, step in enumerate(1e-9 * np.eye(5)):
        up, down = (np.array(spring_forces(c, *(rest + way))[:5]) for way in (step, -step))
        stiffness[:5, column] = -(up - down) / 2e-9
    link = np.array([0, 0, 0, 1, 0, -1])
    stiffness += c.pitch_stiffness * np.outer(link, link)
    mass = np.diag([c.motor, c.screw, c.rod, c.table - c.pitch_mass, c.bed, c.pitch_mass])
    expected = np.sqrt(np.abs(np.linalg.eigvals(np.linalg.solve(mass, stiffness)))) / (2 * math.pi)
    kicked = at(0.2)
    kicked[8] = 1e-4
    still, rung = (run(c, state, 12800, 16)[0] for state in (at(0.2), kicked))
    decay = (rung - still)[:, 1]
    spectrum = np.abs(np.fft.rfft(decay * np.hanning(len(decay)), 16 * len(decay)))
    f = np.fft.rfftfreq(16 * len(decay), 1 / RATE)
    for mode in expected[(expected > 100) & (expected < 300)]:
        near = np.abs(f - mode) < 5
        assert f[near][np.argmax(spectrum[near])] == pytest.approx(mode, rel=2e-3)
    assert np.sum((expected > 100) & (expected < 300)) == 2
