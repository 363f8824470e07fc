from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.io import loadmat
from tests.modal.plant import MOTION, Plant, trip, way

from ballscrew.base.errors import MeasurementError
from ballscrew.fcft.plan import Motion
from ballscrew.recording import rigid_body
from ballscrew.recording.kinematics import kinematics
from ballscrew.recording.phases import find_phases
from ballscrew.recording.rigid_body import (
    CHECK_RANGE,
    NormalEquations,
    _jackknife,
    estimate_rigid_body,
    normal_equations,
    solve,
)

RATE = 2000
# Three speeds, so that viscous and Coulomb friction can be told apart.
SPEEDS = [Motion(v, 2.5, 500.0, 0.2) for v in (0.05, 0.1, 0.2)]
MOVE = way([0.0, 0.1, 0.25, 0.4, 0.25, 0.1, 0.0], RATE, [*SPEEDS, *reversed(SPEEDS)])
RIGID = replace(Plant().quiet, frequency=600.0, damping=0.3, viscous=200.0, coulomb=20.0, offset=-3.0)


def fit(plant, move=MOVE, seed=0):
    aligned = plant.run(move, seed)
    return solve(*normal_equations(kinematics(aligned.position, aligned.rate), aligned.input))


def estimate(*forces, position=MOVE.position, rate=RATE):
    """Estimate of trips of one motion, by their forces."""
    motion = kinematics(position, rate)
    phases = find_phases(motion)
    sums, check, cells = (), (), []
    for force in forces:
        sums += normal_equations(motion, force, phases)
        check += normal_equations(motion, force, used=CHECK_RANGE)
        cells += [(round(phase.stop_position, 2), phase.condition) for phase in phases]
    return estimate_rigid_body(sums, check, cells)


def test_a_rigid_axis_with_friction():
    body = fit(RIGID)
    assert body.equivalent_mass == pytest.approx(RIGID.mass, rel=5e-3)
    assert body.viscous == pytest.approx(200, rel=0.02)
    assert body.coulomb == pytest.approx(20, rel=0.06)
    assert body.offset == pytest.approx(-3, abs=0.05)
    assert body.explained > 0.9999


def test_bias_and_scatter_under_noise():
    """5 N, an encoder of 0.2 µm noise: 40 seeds. Sign and start of friction are what is left as bias."""
    noisy = replace(RIGID, force_noise=5.0, position_noise=2e-7)
    bodies = [fit(noisy, seed=seed) for seed in range(40)]
    got = np.array([[b.equivalent_mass, b.viscous, b.coulomb, b.offset] for b in bodies])
    clean = fit(RIGID)
    exact = [clean.equivalent_mass, clean.viscous, clean.coulomb, clean.offset]
    np.testing.assert_allclose(got.mean(axis=0), exact, rtol=0.01, atol=0.05)
    assert (got.std(axis=0) < [0.5, 2.0, 0.3, 0.2]).all()
    # The residual is mostly model error, which is the same in all: the stated uncertainty is no less.
    stated = np.mean([b.uncertainty for b in bodies], axis=0)
    assert (stated > 0.7 * got.std(axis=0)).all()
    assert (stated < [2.0, 10.0, 1.5, 0.6]).all()


@pytest.mark.parametrize("frequency", [80.0, 150.0])
def test_a_resonance_does_not_pass_for_mass(frequency):
    """Above the filter's 30 Hz; what is left below it is 0.5 % of the mass, 2 % at 80 Hz."""
    ringing = replace(Plant().quiet, frequency=frequency, damping=0.04)
    body = fit(ringing)
    assert body.equivalent_mass == pytest.approx(ringing.mass, rel=5e-3 if frequency > 100 else 2e-2)
    # At a cruising speed the force of friction is what counts, however it is shared out.
    assert body.viscous * 0.1 + body.coulomb == pytest.approx(300 * 0.1 + 25, rel=0.03)


def test_a_constant_torque_scale_goes_straight_through():
    aligned = RIGID.run(MOVE)
    motion = kinematics(aligned.position, aligned.rate)
    item, half = (solve(*normal_equations(motion, part * aligned.input)) for part in (1.0, 0.5))
    assert half.equivalent_mass == pytest.approx(0.5 * item.equivalent_mass, rel=1e-9)
    back = half.scaled(2.0)
    assert back.coulomb == pytest.approx(item.coulomb, rel=1e-9)
    assert back.uncertainty == pytest.approx(item.uncertainty, rel=1e-6)
    assert back.residual == pytest.approx(item.residual, rel=1e-6)
    assert half.scaled(-2.0).uncertainty == pytest.approx(back.uncertainty)


FRICTIONS = {
    "plain": lambda v, _: 20 * np.sign(v) + 200 * v,
    "Stribeck": lambda v, _: np.sign(v) * (20 + 16 * np.exp(-((v / 0.04) ** 2))) + 200 * v,
    "asymmetric": lambda v, _: np.where(v > 0, 30, -15) + np.where(v > 0, 260, 160) * v,
    "by position": lambda v, x: (20 * np.sign(v) + 200 * v) * (1 + 0.1 * np.sin(30 * x)),
    "cable chain": lambda v, x: 20 * np.sign(v) + 200 * v + 200 * (x - 0.2) ** 2,
    "breakaway": lambda v, x: np.sign(v) * (20 + 40 * np.exp(-np.abs(x - nearest_stop(x)) / 3e-4)) + 200 * v,
}


def nearest_stop(x):
    stops = np.array([0.0, 0.1, 0.25, 0.4])
    return stops[np.abs(x[:, None] - stops).argmin(axis=1)]


def force_of(friction, mass=95.0, noise=0.0, seed=0):
    random = np.random.default_rng(seed)
    speed = np.where(MOVE.direction == 0, 0.0, MOVE.speed)
    inner = mass * MOVE.acceleration + friction(speed, MOVE.position) * (speed != 0)
    return inner + noise * random.standard_normal(len(inner))


@pytest.mark.parametrize("friction", FRICTIONS.values(), ids=FRICTIONS)
def test_the_interval_of_the_mass_holds_on_frictions_of_other_models(friction):
    body = estimate(force_of(friction), force_of(friction, noise=0.5))
    assert abs(body.equivalent_mass - 95.0) <= 1.96 * body.uncertainty[0]
    assert body.uncertainty[0] < 0.02 * 95.0


def test_two_trips_of_one_friction_repeat_better_than_its_mass_is_known():
    friction = FRICTIONS["breakaway"]
    single = [estimate(force_of(friction, noise=0.5, seed=seed)) for seed in range(4)]
    masses = [body.equivalent_mass for body in single]
    assert np.std(masses, ddof=1) < single[0].repeatability[0] < 0.5 * single[0].uncertainty[0]
    changed = estimate(force_of(friction, mass=96.0, noise=0.5, seed=4))
    least = 1.96 * np.hypot(changed.repeatability[0], single[0].repeatability[0])
    assert changed.equivalent_mass - masses[0] > least, "a kilogram more shows"


def test_laps_of_a_real_drive_agree_within_their_repeatability(emps):
    """Four laps of 6.24 s at 1 kHz; the mass itself is less certain."""
    record = loadmat(emps / "DATA_EMPS.mat")
    position, force = record["qm"].ravel(), 35.15 * record["vir"].ravel()
    laps = []
    for first in range(0, 4 * 6240, 6240):
        part = slice(first, first + 6240)
        laps.append(estimate(force[part], position=position[part], rate=1000))
    masses = np.array([lap.equivalent_mass for lap in laps])
    repeatability = np.array([lap.repeatability[0] for lap in laps])
    assert (np.abs(masses - masses.mean()) < 1.96 * repeatability).all()
    assert all(lap.uncertainty[0] > 2 * lap.repeatability[0] for lap in laps)


def test_screw_and_bed_are_no_mass():
    """Towards a mode at 40 Hz a mass seems to grow by (f/40 Hz)²."""
    snap = np.gradient(np.gradient(MOVE.acceleration)) * RATE**2
    force = force_of(FRICTIONS["plain"]) - 95.0 / (2 * np.pi * 40) ** 2 * snap
    assert estimate(force).equivalent_mass == pytest.approx(95.0, rel=2e-3)


@pytest.mark.parametrize(("parts", "quantile"), [((0.98, 1.0, 1.02), 2.446912), ((0.97, 1.03), 2.570582)])
def test_scatter_of_trips_has_students_interval(parts, quantile):
    """Where it is much larger than the residuals, which count as four degrees of freedom."""
    force = RIGID.run(MOVE).input
    trips = estimate(*(part * force for part in parts))
    mean, degrees = estimate(force).equivalent_mass, len(parts) - 1
    scatter = mean * np.std(parts, ddof=1) / np.sqrt(len(parts)) * np.sqrt(degrees / (4 + degrees))
    assert 1.959964 * trips.repeatability[0] == pytest.approx(quantile * scatter, rel=0.05)
    assert trips.scaled(-3.0).repeatability[0] == pytest.approx(3.0 * trips.repeatability[0])


def test_a_record_without_phases_has_the_uncertainty_of_its_residual():
    motion = kinematics(MOVE.position, MOVE.rate)
    force = force_of(FRICTIONS["plain"], noise=0.5)
    sums = normal_equations(motion, force)
    body = estimate_rigid_body(sums, normal_equations(motion, force, used=CHECK_RANGE), [()])
    assert body.uncertainty[0] >= solve(*sums).uncertainty[0]
    assert 0 < body.repeatability[0] <= solve(*sums).uncertainty[0]


def test_sums_by_phase_are_those_of_the_record():
    motion = kinematics(MOVE.position, MOVE.rate)
    phases = find_phases(motion)
    force = RIGID.run(MOVE).input
    parts, (whole,) = normal_equations(motion, force, phases), normal_equations(motion, force)
    assert len(parts) == len(phases)
    np.testing.assert_allclose(sum(parts, NormalEquations()).xtx, whole.xtx, rtol=1e-9, atol=1e-9)


def test_sums_of_two_recordings_are_one_fit():
    first, second = way([0.0, 0.2], RATE, SPEEDS[2]), way([0.2, 0.0], RATE, SPEEDS[2])
    sums = []
    for move in (first, second):
        aligned = RIGID.run(move)
        sums += normal_equations(kinematics(aligned.position, RATE), aligned.input)
    both = sums[0] + sums[1]
    assert both.count == sums[0].count + sums[1].count
    np.testing.assert_array_equal(both.xtx, sums[0].xtx + sums[1].xtx)
    assert solve(both).equivalent_mass == pytest.approx(RIGID.mass, rel=0.01)
    # One direction alone cannot tell Coulomb friction from the offset; two together can.
    for item in sums:
        with pytest.raises(MeasurementError, match="one direction only"):
            solve(item)
    assert solve(both).offset == pytest.approx(-3, abs=0.1)
    assert solve(both).coulomb == pytest.approx(20, abs=3.0)


def test_an_axis_that_stands_is_refused():
    noise = 1e-8 * np.random.default_rng(0).standard_normal(8000)
    for position in (np.full(8000, 0.1), np.zeros(8000)):
        (sums,) = normal_equations(kinematics(position, RATE), noise)
        assert sums.count == 0
        with pytest.raises(MeasurementError, match="does not move enough"):
            solve(sums)


def test_one_speed_without_acceleration_is_refused():
    position = 0.1 * np.arange(8000) / RATE
    force = np.full(8000, 30.0)
    with pytest.raises(MeasurementError, match=r"mass and friction cannot be separated|does not move"):
        solve(*normal_equations(kinematics(position, RATE), force))


def test_a_record_shorter_than_the_filter_gives_nothing():
    move = way([0.0, 0.02], RATE, Motion(0.2, 10.0, 5000.0, 0.0), lead=0.0)
    position = move.position[:200]
    (sums,) = normal_equations(kinematics(position, RATE), np.ones(200))
    assert sums.count == 0
    (other,) = normal_equations(kinematics(MOVE.position, RATE), RIGID.run(MOVE).input)
    assert solve(sums + other).equivalent_mass == solve(other).equivalent_mass


@pytest.mark.parametrize("rate", [1000, 5120, 12800])
def test_the_rate_does_not_matter(rate):
    move = way([0.0, 0.1, 0.25, 0.1, 0.0], rate, [SPEEDS[1], SPEEDS[2], SPEEDS[2], SPEEDS[1]])
    assert fit(RIGID, move).equivalent_mass == pytest.approx(RIGID.mass, rel=0.01)


def test_transients_alone_would_be_biased():
    """The whole moving record is used, not the accelerations alone: so the friction is known as well."""
    body = fit(replace(RIGID, coulomb=60.0), way(trip([0.0, 0.06, 0.12]), RATE, MOTION))
    assert body.equivalent_mass == pytest.approx(RIGID.mass, rel=0.01)


def test_a_group_without_which_nothing_is_determined_leaves_no_jackknife():
    """Of two groups that each have half of what is needed."""
    aligned = RIGID.run(MOVE, 0)
    motion = kinematics(aligned.position, aligned.rate)
    sums = normal_equations(motion, aligned.input, find_phases(motion))
    forth = [phase.condition.direction > 0 for phase in find_phases(motion)]
    assert _jackknife(sums, [number % 2 for number in range(len(sums))]) is not None
    assert _jackknife(sums, forth) is None
    assert _jackknife(sums, ["one"] * len(sums)) is None


def test_without_motion_for_more_models_of_friction_the_four_parameters_are_estimated(monkeypatch):
    force = RIGID.run(MOVE, 0).input
    before = estimate(force, force)
    solve_four = rigid_body.solve

    def refuse(sums, *terms):
        if terms:
            raise MeasurementError("too little motion")
        return solve_four(sums)

    monkeypatch.setattr(rigid_body, "solve", refuse)
    after = estimate(force, force)
    assert after.equivalent_mass == before.equivalent_mass
    assert after.uncertainty[0] <= before.uncertainty[0]
    assert after.repeatability[0] >= before.repeatability[0]
