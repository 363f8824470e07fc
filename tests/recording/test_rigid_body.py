from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.modal.plant import MOTION, Plant, trip, way

from ballscrew.base.errors import MeasurementError
from ballscrew.fcft.plan import Motion
from ballscrew.recording.kinematics import kinematics
from ballscrew.recording.rigid_body import NormalEquations, mass_scatter, normal_equations, solve

RATE = 2000
# Three speeds, so that viscous and Coulomb friction can be told apart.
SPEEDS = [Motion(v, 2.5, 500.0, 0.2) for v in (0.05, 0.1, 0.2)]
MOVE = way([0.0, 0.1, 0.25, 0.4, 0.25, 0.1, 0.0], RATE, [*SPEEDS, *reversed(SPEEDS)])
RIGID = replace(Plant().quiet, frequency=600.0, damping=0.3, viscous=200.0, coulomb=20.0, offset=-3.0)


def fit(plant, move=MOVE, seed=0):
    aligned = plant.run(move, seed)
    return solve(normal_equations(kinematics(aligned.position, aligned.rate), aligned.input))


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
    item, half = (solve(normal_equations(motion, part * aligned.input)) for part in (1.0, 0.5))
    assert half.equivalent_mass == pytest.approx(0.5 * item.equivalent_mass, rel=1e-9)
    back = half.scaled(2.0)
    assert back.coulomb == pytest.approx(item.coulomb, rel=1e-9)
    assert back.uncertainty == pytest.approx(item.uncertainty, rel=1e-6)
    assert back.residual == pytest.approx(item.residual, rel=1e-6)
    assert half.scaled(-2.0).uncertainty == pytest.approx(back.uncertainty)


@pytest.mark.parametrize(("parts", "quantile"), [((0.98, 1.0, 1.02), 4.302653), ((0.97, 1.03), 12.706205)])
def test_scatter_of_the_mass_over_trips_has_students_interval(parts, quantile):
    aligned = RIGID.run(MOVE)
    motion = kinematics(aligned.position, aligned.rate)
    trips = [normal_equations(motion, part * aligned.input) for part in parts]
    mean = solve(trips[0]).equivalent_mass / parts[0]
    expected = mean * np.std(parts, ddof=1) / np.sqrt(len(parts)) * quantile
    assert 1.959964 * mass_scatter(trips) == pytest.approx(expected, rel=1e-5)
    body = replace(solve(trips[0]), mass_scatter=mass_scatter(trips))
    assert body.scaled(-3.0).mass_scatter == pytest.approx(3.0 * mass_scatter(trips))


def test_one_trip_or_one_without_motion_has_no_scatter():
    aligned = RIGID.run(MOVE)
    trip = normal_equations(kinematics(aligned.position, aligned.rate), aligned.input)
    assert mass_scatter([trip]) is None
    assert mass_scatter([trip, NormalEquations()]) is None


def test_sums_of_two_recordings_are_one_fit():
    first, second = way([0.0, 0.2], RATE, SPEEDS[2]), way([0.2, 0.0], RATE, SPEEDS[2])
    sums = []
    for move in (first, second):
        aligned = RIGID.run(move)
        sums.append(normal_equations(kinematics(aligned.position, RATE), aligned.input))
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
        sums = normal_equations(kinematics(position, RATE), noise)
        assert sums.count == 0
        with pytest.raises(MeasurementError, match="does not move enough"):
            solve(sums)


def test_one_speed_without_acceleration_is_refused():
    position = 0.1 * np.arange(8000) / RATE
    force = np.full(8000, 30.0)
    with pytest.raises(MeasurementError, match=r"mass and friction cannot be separated|does not move"):
        solve(normal_equations(kinematics(position, RATE), force))


def test_a_record_shorter_than_the_filter_gives_nothing():
    move = way([0.0, 0.02], RATE, Motion(0.2, 10.0, 5000.0, 0.0), lead=0.0)
    position = move.position[:200]
    sums = normal_equations(kinematics(position, RATE), np.ones(200))
    assert sums.count == 0
    other = normal_equations(kinematics(MOVE.position, RATE), RIGID.run(MOVE).input)
    assert solve(sums + other).equivalent_mass == solve(other).equivalent_mass


@pytest.mark.parametrize("rate", [1000, 5120, 12800])
def test_the_rate_does_not_matter(rate):
    move = way([0.0, 0.1, 0.25, 0.1, 0.0], rate, [SPEEDS[1], SPEEDS[2], SPEEDS[2], SPEEDS[1]])
    assert fit(RIGID, move).equivalent_mass == pytest.approx(RIGID.mass, rel=0.01)


def test_transients_alone_would_be_biased():
    """The whole moving record is used, not the accelerations alone: so the friction is known as well."""
    body = fit(replace(RIGID, coulomb=60.0), way(trip([0.0, 0.06, 0.12]), RATE, MOTION))
    assert body.equivalent_mass == pytest.approx(RIGID.mass, rel=0.01)
