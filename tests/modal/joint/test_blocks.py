"""The linear part of the model."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import sosfilt
from tests.modal.joint.conftest import SmallRun

from ballscrew.modal.joint import windows
from ballscrew.modal.joint.blocks import (
    Block,
    make_block,
    orthonormaliser,
    pitching_of,
    project,
    raw_columns,
    raw_columns_of,
    remaining_power,
    simulate,
    whiten,
    with_whitening,
)
from ballscrew.modal.joint.columns import fill_change
from ballscrew.modal.joint.mode import AxialMode, compliance_of
from ballscrew.modal.joint.windows import average_windows


def shape(middle: float) -> AxialMode:
    return AxialMode(compliance_of(middle), 0.3, 0.0, 0.03, 0.0, 0.0, 0.0, 330.0, 0.03)


@pytest.mark.parametrize("thinned", [1, 4])
def test_what_a_window_leaves_out_changes_nothing(
    run: SmallRun, thinned: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Neither the columns nor the residual, whitened, nor its mean square; thinned to 800 Hz as well."""
    trips = []
    for trip in run.trips:
        names = ("force", "position", "motor")
        channels = {name: getattr(trip, name)[::thinned] for name in names if getattr(trip, name) is not None}
        trips.append(
            replace(trip, rate=trip.rate / thinned, response=trip.response[:, ::thinned], **channels)
        )
    found = []
    for length in (windows._used_length, len):
        monkeypatch.setattr(windows, "_used_length", length)
        w = average_windows(trips, run.transients, 1.0, 90.0, 300.0)
        assert w is not None
        for name in ("torque-nut", "motor-nut", "torque-motor"):
            b = make_block(name, w)
            b = with_whitening(b, project(b, shape(170.0)).residual, 0.01)
            solved = project(b, shape(170.0))
            fitted = b.counted
            found.append((solved.columns[fitted], solved.residual[fitted], b.mean_square(solved.residual)))
    for cut, whole in zip(found[:3], found[3:], strict=True):
        for one, other in zip(cut, whole, strict=True):
            np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-9 * np.abs(other).max())


def test_what_is_left_over_is_what_the_residual_has(run: SmallRun, blocks: list[Block]) -> None:
    """With the ringing of another mode, as a search has it."""
    middle = float(np.mean(list(run.free.values())))
    for b in blocks:
        like = project(b, shape(middle))
        for scale in (0.9, 1.0, 1.1):
            there = shape(scale * middle)
            power = remaining_power(b, raw_columns(b, there), like)
            solved = project(b, there, like.free_vibration)
            assert power == pytest.approx(float(np.sum(solved.residual**2)), rel=1e-9)


def test_at_a_constant_speed_viscous_friction_softens_the_nut_as_coulomb_friction_does(
    blocks: list[Block],
) -> None:
    b = blocks[0]
    b = replace(b, windows=replace(b.windows, speed=0.15 * b.windows.direction))
    worn = replace(shape(150.0), mass_over_preload=0.8, nut_over_rest=0.8)
    viscous = simulate(b, replace(worn, viscous=10.0, guide_part=0.4)).response
    np.testing.assert_allclose(viscous, simulate(b, replace(worn, friction=0.6)).response, rtol=1e-12)
    assert not np.allclose(viscous, simulate(b, worn).response, rtol=1e-2)


def test_the_torque_that_overcomes_friction_does_not_soften_the_nut(blocks: list[Block]) -> None:
    by_torque, by_motion = blocks[:2]
    worn = replace(shape(150.0), mass_over_preload=0.8, nut_over_rest=0.8)
    w = by_torque.windows
    at_start = np.repeat(w.speed[w.starts[:-1]], np.diff(w.starts))
    friction = 8.0 * (w.speed - at_start)  # m/s², slow
    without = simulate(by_torque, worn).response
    with_friction = replace(w, force=w.force + friction, drag=w.drag + friction)
    counted_as_load = replace(with_friction, drag=w.drag)
    change, change_as_load = (
        np.abs(simulate(replace(by_torque, windows=each), worn).response - without).max()
        for each in (with_friction, counted_as_load)
    )
    assert change < 0.5 * change_as_load
    # The motor's motion is no force, and friction is no part of it.
    with_drag = replace(by_motion, windows=replace(w, drag=w.drag + friction))
    np.testing.assert_array_equal(simulate(with_drag, worn).response, simulate(by_motion, worn).response)


@pytest.mark.parametrize("step", [1e-4, 0.3])
def test_the_change_of_a_model_is_that_of_its_columns_times_their_weights(run: SmallRun, step: float) -> None:
    random, mode = np.random.default_rng(0), shape(150.0)
    w = average_windows(run.trips, run.transients, 1.0, 90.0, 300.0)
    assert w is not None
    force = random.normal(size=(len(w.centred_position), 2))
    for name in ("torque-nut", "torque-motor"):
        b = make_block(name, w, ripple=force)
        b = replace(b, fixed_columns=np.empty((len(force), 0)))
        columns = raw_columns(b, mode)
        weights, now = random.normal(size=(columns.shape[1], b.target.shape[1])), random.normal(b.target)
        weights[-1] = 0.0
        simulation, found = simulate(b, mode), np.empty(now.shape)
        pitching = pitching_of(b, mode, simulation)
        fill_change(
            simulation.response,
            pitching,
            simulation.ripple_response,
            w.stop_of_sample,
            w.starts,
            weights,
            now,
            step,
            found,
        )
        expected = (columns @ weights - now) / step
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-12 * np.abs(expected).max())


def test_known_columns_of_forces_are_in_the_band(run: SmallRun) -> None:
    w = average_windows(run.trips, run.transients, 1.0, 90.0, 300.0)
    assert w is not None
    force = np.random.default_rng(0).normal(size=(len(w.centred_position), 3))
    given = force.copy()
    found = make_block("torque-nut", w, ripple=force).fixed_columns[:, -3:]
    np.testing.assert_array_equal(force, given)
    for start, stop in w.spans:
        expected = sosfilt(w.band.sections, force[start:stop], axis=0)
        np.testing.assert_allclose(found[start:stop], expected, rtol=1e-9, atol=1e-12)


def test_blocks_with_the_same_drive_have_the_columns_of_a_simulation_of_their_own(
    blocks: list[Block],
) -> None:
    modes = [shape(150.0), shape(120.0), shape(150.0)]
    for b, mode, columns in zip(blocks, modes, raw_columns_of(blocks, modes), strict=True):
        np.testing.assert_array_equal(columns, raw_columns(b, mode))


def test_the_residual_is_orthogonal_to_the_columns_and_to_the_ringing(
    run: SmallRun, blocks: list[Block]
) -> None:
    middle = float(np.mean(list(run.free.values())))
    for b in blocks:
        solved = project(b, shape(middle))
        size = math.sqrt(solved.total)
        lengths = np.linalg.norm(solved.columns, axis=0)
        assert np.abs(solved.columns.T @ solved.residual / lengths[:, None]).max() < 1e-6 * size
        for start, stop in b.windows.spans:
            assert (
                np.abs(solved.free_vibration[start:stop].T @ solved.residual[start:stop]).max() < 1e-9 * size
            )


def test_products_are_those_of_signals_without_their_parts_along_the_columns(blocks: list[Block]) -> None:
    solved, random = project(blocks[0], shape(150.0)), np.random.default_rng(0)
    along = solved.columns @ random.normal(size=(solved.columns.shape[1], 4))
    values = along + 0.1 * np.std(along, axis=0) * random.normal(size=along.shape)
    without = solved.without_columns(values)
    assert np.abs(solved.columns.T @ without).max() < 1e-6 * np.abs(solved.columns.T @ values).max()
    expected = without.T @ without
    np.testing.assert_allclose(solved.products(values, 4), expected, atol=1e-6 * np.abs(expected).max())


def test_columns_that_are_alike_count_once() -> None:
    random = np.random.default_rng(0)
    columns = random.normal(size=(50, 3)) * [1.0, 1e3, 1e-3]
    ways = orthonormaliser(columns.T @ columns, 1e-8)
    assert ways.shape == (3, 3)
    np.testing.assert_allclose((columns @ ways).T @ (columns @ ways), np.eye(3), atol=1e-9)
    twice = np.column_stack([columns, columns[:, 0]])
    assert orthonormaliser(twice.T @ twice, 1e-8).shape == (4, 3)


def test_columns_of_zeros_do_not_count() -> None:
    columns = np.random.default_rng(0).normal(size=(50, 4)) * [0.0, 1.0, 0.0, 1e-3]
    ways = orthonormaliser(columns.T @ columns, 1e-8)
    assert ways.shape == (4, 2)
    np.testing.assert_allclose((columns @ ways).T @ (columns @ ways), np.eye(2), atol=1e-9)
    assert np.abs(ways[[0, 2]]).max() < 1e-12
    assert orthonormaliser(np.zeros((2, 2)), 1e-8).shape == (2, 0)


def test_a_wrong_mode_leaves_more(run: SmallRun, blocks: list[Block]) -> None:
    middle = float(np.mean(list(run.free.values())))
    like = project(blocks[0], shape(middle))
    powers = []
    for scale in (0.8, 1.0, 1.2):
        mode = replace(shape(middle), compliance=compliance_of(scale * middle))
        powers.append(remaining_power(blocks[0], raw_columns(blocks[0], mode), like))
    assert powers[1] < 0.5 * min(powers[0], powers[2])


@pytest.mark.parametrize("name", ["torque-nut", "torque-motor"])
def test_a_gain_that_changes_along_the_axis_leaves_no_residual(blocks: list[Block], name: str) -> None:
    (b,) = (b for b in blocks if b.name == name)
    mode, w = shape(150.0), b.windows
    response = simulate(b, mode).response * (1.0 + 0.7 * w.stop_of_sample)
    moved = replace(w, nut=np.stack([response] * len(w.nut)), motor_band=response)
    solved = project(replace(b, windows=moved), mode)
    assert solved.unexplained < 1e-12


def test_a_table_that_already_pitches_leaves_no_residual(run: SmallRun, blocks: list[Block]) -> None:
    """Free vibration of the pitching mode from the first sample of each window, with a phase of its own."""
    b, mode = blocks[0], shape(float(np.mean(list(run.free.values()))))
    nut = np.zeros_like(b.windows.nut)
    for number, (start, stop) in enumerate(b.windows.spans):
        begin = start + int(np.argmax(b.counted[start:stop]))
        time = (np.arange(start, stop) - begin) / b.windows.rate
        angular = 2 * math.pi * mode.pitch
        phase = angular * math.sqrt(1 - mode.pitch_damping**2) * time + number
        nut[:, start:stop] = np.exp(-mode.pitch_damping * angular * np.maximum(time, 0.0)) * np.cos(phase)
    pitching = replace(b, windows=replace(b.windows, nut=nut))
    before = whiten(pitching, pitching.target, np.zeros((len(nut.T), 1)))
    assert project(pitching, mode).total < 1e-9 * float(np.sum(before**2))
