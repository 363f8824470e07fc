"""What happens beside the wear is as large as it is stated, and nobody does better than the bound."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from benchmarks.axis_sampling import random_axis
from benchmarks.mode_tables import analyst, true_effects
from benchmarks.preload_bound import Bound
from benchmarks.preload_cases import happened, stiffer, true_stiffness

from ballscrew.calibration.assumptions import Assumptions

STATES = (0.8, 0.5, 0.25)


def test_what_is_allowed_for_happens_at_its_size() -> None:
    machine, prior = random_axis(18).rig.machine, Assumptions()
    deviations = []
    for seed in range(400):
        moved, load = happened(machine, 50.0, prior, np.random.default_rng(seed), prior.bearing_spread)
        deviations.append(
            (
                moved.sheet.bearing.stiffness / machine.sheet.bearing.stiffness - 1,
                moved.sheet.screw.bearing_to_zero - machine.sheet.screw.bearing_to_zero,
                load / 50.0 - 1,
            )
        )
    expected = np.array([prior.bearing_spread, prior.position, prior.load])
    np.testing.assert_allclose(np.std(deviations, axis=0), expected, rtol=0.12)
    assert (np.abs(np.mean(deviations, axis=0)) < 0.2 * expected).all()


def test_the_bearing_keeps_for_a_day() -> None:
    machine = random_axis(18).rig.machine
    moved, _ = happened(machine, 50.0, Assumptions(), np.random.default_rng(0), 0.0)
    assert moved.sheet.bearing == machine.sheet.bearing
    still = Assumptions(bearing_drift=0.0, load=0.0, position=0.0)
    assert happened(machine, 50.0, still, np.random.default_rng(0), 0.0) == (machine, 50.0)


def test_the_true_stiffness_is_the_nut_where_only_the_nut_changes() -> None:
    machine = random_axis(18).rig.machine
    worn = replace(machine, preload=0.6 * machine.preload)
    assert true_stiffness(worn, machine) == pytest.approx(0.6)
    assert true_stiffness(stiffer(machine, 0.965), machine) < 0.95
    assert true_stiffness(stiffer(worn, 1.05), machine) > 0.6


@pytest.fixture(scope="module")
def bound() -> Bound:
    axis = random_axis(18)
    who = analyst(axis.data_sheet, axis.plan, np.random.default_rng(1))
    return Bound(axis.rig.machine, axis.plan, who, (0.0, axis.load / 2, axis.load), 0.02)


def test_who_knows_more_errs_less(bound: Bound) -> None:
    none, half, low, both = (bound.ratio(STATES, *given) for given in ((), (0.5,), (0.25,), (0.5, True)))
    assert (none > half).all()
    assert (half > low).all()
    assert (low > both).all()
    assert (both > 0).all()


def test_what_happens_beside_the_wear_costs(bound: Bound) -> None:
    prior = Assumptions()
    for given in ((None, False), (0.5, True)):
        assert (bound.ratio(STATES, *given, prior) > bound.ratio(STATES, *given)).all()


def test_without_an_anchor_it_is_the_tolerance_of_the_sheet(bound: Bound) -> None:
    """The share errs by what K errs by, about: d ln(P/P₀) = 3 (1 − 1/u) of it."""
    u = 0.25 ** (-1 / 3)
    by_rigidity = 3 * (1 - 1 / u) * 0.20 / np.sqrt(3) * 0.25
    assert bound.ratio([0.25])[0] == pytest.approx(by_rigidity, rel=0.25)


def test_true_errors_are_those_that_are_drawn(bound: Bound) -> None:
    repeating, fresh = true_effects(bound.who, bound.machine, bound.plan, 10.0)
    assert repeating.shape == fresh.shape == (3, len(bound.plan.positions))
    assert np.ptp(repeating[0]) == 0
    assert fresh[0] == pytest.approx(0.72 * bound.who.noise)
