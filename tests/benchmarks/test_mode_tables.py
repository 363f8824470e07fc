"""Runs at the level of mode tables are like what the estimator tells, and differ where the machine does."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from benchmarks.axis_sampling import RandomAxis, random_axis
from benchmarks.mode_tables import Analyst, analyst, mode_table

from ballscrew.modal.run import Run
from ballscrew.testbed.linear import true_frequency
from ballscrew.testbed.machine import Machine
from ballscrew.testbed.trip import prepared


@pytest.fixture(scope="module")
def axis() -> RandomAxis:
    return random_axis(18)


@pytest.fixture(scope="module")
def who(axis: RandomAxis) -> Analyst:
    return analyst(axis.data_sheet, axis.plan, np.random.default_rng(1))


def run_of(
    axis: RandomAxis, who: Analyst, machine: Machine | None = None, load: float | None = None, **more: float
) -> Run:
    machine = machine or axis.rig.machine
    return mode_table(who, machine, axis.plan, load or axis.load, np.random.default_rng(2), **more)


def frequencies(run: Run) -> np.ndarray:
    return np.array([cell.frequency_Hz for cell in run.cells])


def test_the_same_seed_gives_the_same_run(axis: RandomAxis, who: Analyst) -> None:
    assert run_of(axis, who) == run_of(axis, who)


def test_every_cell_of_the_plan_is_there(axis: RandomAxis, who: Analyst) -> None:
    cells = run_of(axis, who).cells
    assert len(cells) == 4 * len(axis.plan.positions) - 4
    assert {cell.position_m for cell in cells} == set(axis.plan.positions)


def test_all_cells_of_a_run_are_one_curve(axis: RandomAxis, who: Analyst) -> None:
    """Forty cells are two numbers: what is left of their errors beside level and tilt is nothing."""
    run = run_of(axis, who)
    c = prepared(axis.rig.machine, axis.load, axis.plan)
    places = np.array([cell.position_m for cell in run.cells])
    off = np.log(frequencies(run) / [true_frequency(c, x) for x in places])
    left = off - np.polyval(np.polyfit(places, off, 2), places)
    assert np.abs(off).max() > 20 * np.abs(left).max()


def test_shared_errors_make_all_of_the_uncertainty(axis: RandomAxis, who: Analyst) -> None:
    run = run_of(axis, who)
    shared = np.array([cause.effects_Hz for cause in run.shared_errors])
    stated = [cell.standard_uncertainty_Hz for cell in run.cells]
    assert np.sqrt(np.sum(shared**2, axis=0)) == pytest.approx(stated, rel=1e-9)


def test_errors_are_mostly_within_what_is_told() -> None:
    held = []
    for seed in range(40):
        axis, random = random_axis(seed), np.random.default_rng(seed)
        run = mode_table(
            analyst(axis.data_sheet, axis.plan, random), axis.rig.machine, axis.plan, axis.load, random
        )
        c = prepared(axis.rig.machine, axis.load, axis.plan)
        for cell in run.cells:
            assert cell.frequency_Hz is not None
            assert cell.standard_uncertainty_Hz is not None
            off = cell.frequency_Hz - true_frequency(c, cell.position_m)
            held.append(abs(off) <= 1.96 * cell.standard_uncertainty_Hz)
    assert 0.9 <= np.mean(held) < 1.0


def test_most_of_the_error_is_the_same_in_the_next_run(axis: RandomAxis, who: Analyst) -> None:
    runs = [
        mode_table(who, axis.rig.machine, axis.plan, axis.load, np.random.default_rng(seed))
        for seed in range(20)
    ]
    c = prepared(axis.rig.machine, axis.load, axis.plan)
    level = np.array([np.mean(frequencies(r)) for r in runs])
    true = np.mean([true_frequency(c, cell.position_m) for cell in runs[0].cells])
    assert np.std(level) < 5e-4 * true
    assert abs(np.mean(level) / true - 1) == pytest.approx(abs(who.level), abs=3e-4)


def test_a_nut_that_is_unloaded_is_read_low(axis: RandomAxis, who: Analyst) -> None:
    """The law of the load is held to the sheet's preload."""
    half = replace(axis.rig.machine, preload=0.5 * axis.rig.machine.preload)
    c = prepared(half, axis.load, axis.plan)
    new = prepared(axis.rig.machine, axis.load, axis.plan)
    middle = axis.plan.positions[len(axis.plan.positions) // 2]
    rows = [i for i, cell in enumerate(run_of(axis, who).cells) if cell.position_m == middle]
    off = [
        frequencies(run_of(axis, who, machine))[rows[0]] / true_frequency(constants, middle)
        for machine, constants in ((axis.rig.machine, new), (half, c))
    ]
    assert off[1] < off[0] - 1e-5


def test_a_worn_stop_shows_in_its_frequency_and_its_cells(axis: RandomAxis, who: Analyst) -> None:
    machine, stop = axis.rig.machine, axis.plan.positions[3]
    deep = 0.3 * float(machine.pressed(0.0))
    lost = tuple(
        (stop + way, depth) for way, depth in ((-0.03, 0.0), (-0.02, deep), (0.02, deep), (0.03, 0.0))
    )
    before, after = run_of(axis, who), run_of(axis, who, replace(machine, lost=lost))
    change = frequencies(after) / frequencies(before) - 1
    at = np.array([cell.position_m == stop for cell in after.cells])
    assert change[at].max() < change[~at].min() - 0.005
    alone = np.array([cell.deviation_Hz or 0.0 for cell in after.cells])
    assert alone[at].max() < alone[~at].min()


def test_a_heavier_load_shows_in_the_mass_and_not_in_what_is_said(axis: RandomAxis, who: Analyst) -> None:
    before, after = run_of(axis, who), run_of(axis, who, load=axis.load + 2.0, declared=axis.load)
    assert after.mass_kg == before.mass_kg == axis.load
    masses = [run.rigid_body.equivalent_mass_kg or 0.0 for run in (before, after)]
    assert masses[1] - masses[0] == pytest.approx(2.0, rel=0.02)
    assert np.all(frequencies(after) < frequencies(before))


def test_a_torque_constant_shows_in_masses_and_friction_alone(axis: RandomAxis, who: Analyst) -> None:
    before, after = run_of(axis, who), run_of(axis, who, torque_scale=1.01)
    assert np.array_equal(frequencies(before), frequencies(after))
    for name in ("equivalent_mass_kg", "viscous_N_s_per_m", "coulomb_N"):
        one, other = (getattr(run.rigid_body, name) for run in (before, after))
        assert other == pytest.approx(1.01 * one)


def test_two_levels_tell_mass_over_preload(axis: RandomAxis) -> None:
    machine = axis.rig.machine
    assert (
        run_of(axis, analyst(axis.data_sheet, axis.plan, np.random.default_rng(1))).mass_over_preload_kg_per_N
        is None
    )
    who = analyst(axis.data_sheet, axis.plan, np.random.default_rng(1), softening=0.1)
    stated = run_of(axis, who).mass_over_preload_kg_per_N
    assert stated is not None
    right = prepared(machine, axis.load, axis.plan).table / machine.preload
    assert stated.value == pytest.approx(right, rel=0.3)
    assert stated.standard_uncertainty == pytest.approx(0.1 * stated.value)


def test_it_is_a_document_like_any_other(axis: RandomAxis, who: Analyst) -> None:
    document = run_of(axis, who).to_json()
    assert Run.from_json(document).to_json() == document
