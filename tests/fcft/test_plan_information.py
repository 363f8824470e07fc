"""Information of a plan, and its time."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ballscrew.axis.axial import PARAMETERS, frequency, from_sheet
from ballscrew.axis.axial_prior import prior
from ballscrew.fcft.plan import Motion, Plan
from ballscrew.fcft.plan_information import determined_parameters, plan_information, test_minutes
from ballscrew.fcft.run_information import preload_ratio, sheet_prior
from ballscrew.fcft.scatter import FrequencyScatter
from ballscrew.fcft.schedule import duration

PLAN = Plan(
    positions=tuple(round(0.045 * i, 3) for i in range(11)),
    repetitions=3,
    masses=(0.0, 25.0, 50.0),
    motions=(Motion(0.15, 2.5, 1500.0, 0.35),),
)
SCATTER = FrequencyScatter(cell=0.1, trip=0.05, run=0.04, lasting=0.1)


@pytest.fixture
def information_of(sheet):
    model, covariance = from_sheet(sheet, 0.225), prior(sheet, 0.225)[1]

    def of(plan: Plan = PLAN, scatter: FrequencyScatter = SCATTER, change: float = 10.0):
        return plan_information(plan, model, covariance, scatter, change, (0.0, 0.45))

    return of


def accuracy(information_of) -> dict[str, float]:
    return {one.name: one.after for one in information_of.accuracy}


def test_time_is_that_of_every_load_and_of_changing_them():
    whole, measuring = test_minutes(PLAN, 7.0, 0.0)
    assert measuring == pytest.approx(3 * duration(PLAN) / 60)
    assert whole == pytest.approx(measuring + 14.0)


@pytest.mark.parametrize("slope", [0.0, 5e-324, 1e-12])
def test_a_nearly_constant_compliance_is_one_without_slope(sheet, slope):
    straight = replace(from_sheet(sheet, 0.225), slope=slope)
    found = plan_information(PLAN, straight, prior(sheet, 0.225)[1], SCATTER, 10.0, (0.0, 0.45))
    (of_slope,) = [each for each in found.accuracy if each.name == "slope"]
    assert 0 < of_slope.after < of_slope.before < 1


def test_what_is_wanted_has_a_curve_only_where_the_screw_has_one(sheet):
    assert [PARAMETERS[i] for i in determined_parameters(from_sheet(sheet, 0.2))] == [
        "compliance",
        "slope",
        "mass",
    ]
    both = replace(sheet, support="fixed-fixed")
    assert [PARAMETERS[i] for i in determined_parameters(from_sheet(both, 0.2))] == [
        "compliance",
        "slope",
        "mass",
        "curve",
    ]


def test_a_test_narrows_every_number_and_no_frequency_tells_newtons(information_of):
    one = information_of()
    assert all(part.after <= part.before * (1 + 1e-9) for part in one.accuracy)
    gains = {part.name: part.after / part.before for part in one.accuracy}
    assert gains["compliance"] < 0.25
    assert gains["slope"] < 0.1
    assert gains["preload"] > 0.95
    assert gains["share"] > 0.9
    assert one.bits > 5


def test_more_stops_loads_and_repetitions_never_tell_less(information_of):
    few = information_of(replace(PLAN, positions=PLAN.positions[::5]))
    light = information_of(replace(PLAN, masses=(0.0, 50.0)))
    once = information_of(replace(PLAN, repetitions=1))
    whole = information_of()
    for less in (few, light, once):
        assert less.information < whole.information
        assert less.bits < whole.bits
        assert less.minutes < whole.minutes


def test_one_load_leaves_the_mass_to_the_sheet(information_of):
    one = information_of(replace(PLAN, masses=(50.0,)))
    assert one.information == 0.0
    assert accuracy(one)["mass"] == pytest.approx(0.02, rel=0.05)


def test_no_number_of_repetitions_beats_what_runs_scatter_by(information_of):
    endless = information_of(replace(PLAN, repetitions=100_000 // 11))
    still = information_of(scatter=FrequencyScatter(cell=1e-4, trip=0.0, run=1e-5, lasting=0.0, load=0.0))
    assert accuracy(endless)["slope"] > 3 * accuracy(still)["slope"]


def test_a_later_run_is_as_sure_as_a_fit_of_it(sheet, information_of):
    """The random part against estimates from drawn runs, the axis known."""
    one = information_of()
    model = from_sheet(sheet, 0.225)
    x = np.array(PLAN.positions)
    cells = np.array([2] + [4] * 9 + [2])
    rng = np.random.default_rng(1)
    tilt = (2 * x - 0.45) / 0.45

    def run(ratio: float) -> np.ndarray:
        f = frequency(model, x, 50.0, ratio)
        noise = rng.normal(size=(3000, 11)) * SCATTER.own(3) / np.sqrt(cells)
        noise += SCATTER.of_run(3) * (rng.normal(size=(3000, 1)) + rng.normal(size=(3000, 1)) * tilt)
        return np.log(f + noise)

    change = run(0.9) - run(1.0)
    share = np.exp(np.log(frequency(model, x, 50.0, 0.9 * 1.001)) - np.log(frequency(model, x, 50.0, 0.9)))
    slope = np.log(share) / np.log(1.001)
    f = frequency(model, x, 50.0, 0.9)
    own = np.diag(2 * SCATTER.own(3) ** 2 / cells / f**2)
    spread = own + 2 * SCATTER.of_run(3) ** 2 * (np.outer(1 / f, 1 / f) + np.outer(tilt / f, tilt / f))
    weights = np.linalg.solve(spread, slope)
    fitted = change @ weights / (weights @ slope)
    later = one.later[0]
    assert later.ratio == 0.9
    assert 0.9 * fitted.std() == pytest.approx(later.random, rel=0.05)
    assert later.standard_uncertainty > later.random


def test_json_has_every_number(information_of):
    document = information_of().to_json()
    assert document["information_per_minute"] == pytest.approx(document["information"] / document["minutes"])
    assert {one["name"] for one in document["accuracy"]} == set(PARAMETERS) - {"curve"}


def test_two_known_preloads_determine_the_share(sheet):
    """Where frequencies are exact, u(s)/s = √2 · 2 % · n / (3 (n − 1)) with n = (P/P_ref)^(−1/3)."""
    exact = FrequencyScatter(cell=1e-3, trip=0.0, run=0.0, lasting=0.0, load=0.0)
    for low in (0.5, 0.25):
        plan = replace(PLAN, preloads=(600.0, low * 600.0))
        model, covariance = sheet_prior(plan, sheet)
        wide = covariance + np.diag([0, 0, 0, 0, 0, 100.0, 100.0])
        found = plan_information(plan, model, wide, exact, 10.0)
        nut = low ** (-1 / 3)
        assert accuracy(found)["share"] == pytest.approx(np.sqrt(2) * 0.02 * nut / (3 * (nut - 1)), rel=1e-3)
        assert accuracy(found)["preload"] == pytest.approx(0.02, rel=1e-3)


@pytest.mark.parametrize(
    ("change", "rank"),
    [
        ({}, 3),
        ({"preloads": (600.0,)}, 3),
        ({"preloads": (600.0, 300.0)}, 4),
        ({"preloads": (600.0, 300.0, 150.0)}, 4),
        ({"masses": (0.0,)}, 2),
        ({"masses": (0.0,), "preloads": (600.0, 300.0)}, 3),
    ],
)
def test_rank_without_the_data_sheet(information_of, change, rank):
    found = information_of(replace(PLAN, **change))
    assert (found.rank, found.parameters) == (rank, 4)


def test_a_known_preload_alone_gives_newtons_and_no_share(information_of):
    without, known = information_of(), information_of(replace(PLAN, preloads=(600.0,)))
    assert accuracy(known)["preload"] < 0.02 < accuracy(without)["preload"]
    assert accuracy(known)["share"] > 0.9 * accuracy(without)["share"]
    assert known.information == pytest.approx(without.information, rel=1e-9)


def test_preloads_take_the_time_of_their_runs_and_adjustments():
    whole, measuring = test_minutes(replace(PLAN, preloads=(600.0, 300.0)), 7.0, 30.0)
    assert measuring == pytest.approx(6 * duration(PLAN) / 60)
    assert whole == pytest.approx(measuring + 4 * 7.0 + 30.0)


def test_a_model_far_from_every_preload_is_at_none_of_them(sheet):
    model = from_sheet(sheet, 0.225)
    assert preload_ratio(600.0, 600.0, model) == 1.0
    assert preload_ratio(300.0, 600.0, model) == pytest.approx(0.5)
    assert preload_ratio(300.0, 300.0, model) == pytest.approx(0.5)
    assert preload_ratio(None, None, model) == 1.0
