"""The exchange algorithm finds the plan that tells the most per minute."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import pytest

from ballscrew.axis.axial import from_vector
from ballscrew.axis.axial_prior import prior
from ballscrew.base.errors import InputError
from ballscrew.fcft.optimise import candidate_stops, optimise
from ballscrew.fcft.plan import Motion, Plan, validate_plan
from ballscrew.fcft.plan_information import plan_information
from ballscrew.fcft.run_information import sheet_prior
from ballscrew.fcft.scatter import default_scatter

SLOW = Motion(0.15, 2.5, 1500.0, 0.35)
PLAN = Plan(
    positions=tuple(round(0.045 * i, 3) for i in range(11)),
    repetitions=30,
    masses=(0.0, 10.0, 20.0, 30.0, 40.0, 50.0),
    motions=(SLOW,),
)
# Long ways to speed leave few stops to choose from.
FAST = replace(PLAN, motions=(Motion(0.5, 2.6, 3000.0, 0.35),), positions=(0.0, 0.225, 0.45))


def middle(chosen: tuple[float, ...], all_: tuple[float, ...]) -> bool:
    third = (chosen[-1] - chosen[0]) / 3
    inner = [one for one in chosen if chosen[0] + 0.999 * third <= one <= chosen[-1] - 0.999 * third]
    return bool(inner) or len(all_) < 3


@pytest.mark.parametrize("change", [0.0, 10.0])
def test_it_finds_the_best_of_all_choices(sheet, change):
    plan = replace(FAST, positions=(0.0, 0.45), masses=(0.0, 10.0, 30.0, 50.0))
    best = optimise(plan, sheet, change_minutes=change)
    stops = candidate_stops(plan)
    assert 4 <= len(stops) <= 6
    mean, covariance = prior(sheet, 0.225)
    model, scatter = from_vector(mean, 0.225), default_scatter(sheet)
    found = []
    for inner in (pick for n in range(len(stops) - 1) for pick in combinations(stops[1:-1], n)):
        chosen = (stops[0], *inner, stops[-1])
        for loads in (pick for n in range(1, 5) for pick in combinations(plan.masses, n)):
            if middle(chosen, stops) and middle(loads, plan.masses):
                one = replace(plan, positions=chosen, masses=loads)
                found.append(
                    plan_information(one, model, covariance, scatter, change, (0.0, 0.45)).per_minute
                )
    assert best.chosen.per_minute == pytest.approx(max(found), rel=1e-9)


def test_it_beats_the_papers_plan(sheet):
    best = optimise(PLAN, sheet)
    assert best.ratio > 1.3
    assert best.chosen.minutes < 0.6 * best.given.minutes
    assert best.ratio == pytest.approx(best.chosen.per_minute / best.given.per_minute)


def test_ends_and_centre_points_stay(sheet):
    best = optimise(PLAN, sheet)
    stops, loads = best.plan.positions, best.plan.masses
    assert (stops[0], stops[-1]) == (0.0, 0.45)
    assert any(0.15 <= x <= 0.30 for x in stops)
    assert (loads[0], loads[-1]) == (0.0, 50.0)
    assert any(16 < load < 34 for load in loads)


def test_without_centre_points_it_is_no_worse(sheet):
    assert optimise(PLAN, sheet, centre=False).chosen.per_minute >= optimise(PLAN, sheet).chosen.per_minute


def test_all_but_stops_and_loads_stays(sheet):
    plan = replace(PLAN, warm_up=2, temperature=True, motions=(SLOW, replace(SLOW, jerk=900.0)))
    best = optimise(plan, sheet).plan
    assert replace(best, positions=plan.positions, masses=plan.masses, source=plan.source) == plan
    validate_plan(best, sheet)


def test_dear_changes_of_load_buy_more_stops(sheet):
    cheap, dear = (optimise(PLAN, sheet, change_minutes=minutes) for minutes in (0.0, 120.0))
    assert len(dear.plan.positions) > len(cheap.plan.positions)


def test_loads_may_be_others_than_the_plans(sheet):
    one = replace(PLAN, masses=(100.0,))
    assert optimise(one, sheet).ratio == float("inf")
    assert optimise(one, sheet).to_json()["information_per_minute_ratio"] is None
    best = optimise(one, sheet, loads=(100.0, 0.0, 50.0))
    assert best.plan.masses == (0.0, 50.0, 100.0)
    assert best.chosen.information > 0


def test_stops_are_whole_millimetres_where_they_can_be():
    stops = candidate_stops(replace(PLAN, positions=(0.0, 0.447)))
    assert all(abs(1e3 * x - round(1e3 * x)) < 1e-9 for x in stops)
    assert len(stops) == 11


@pytest.mark.parametrize("positions", [(0.0, 0.12), (0.0, 0.25), (0.01, 0.37), (0.0, 0.4500001)])
def test_candidates_are_never_too_close(sheet, positions):
    plan = replace(FAST, positions=positions)
    validate_plan(replace(plan, positions=candidate_stops(plan)), sheet)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"change_minutes": -1.0},
            "the time to change the load, in minutes, is -1.0; it must be a number, 0 or more",
        ),
        ({"change_minutes": float("nan")}, "in minutes, is nan"),
        ({"loads": ()}, "0 were given"),
        ({"loads": (1.0, 1.0)}, "each given once"),
        ({"loads": (-1.0, 1.0)}, "a load, in kg, is -1.0; it must be a number, 0 or more"),
        ({"loads": (float("nan"),)}, "is nan"),
        ({"loads": ("50 kg",)}, "is '50 kg'"),
        ({"loads": tuple(float(i) for i in range(99))}, "99 were given"),
        ({"adjust_minutes": -1.0}, "the time to set another preload, in minutes, is -1"),
        ({"preloads": (600.0, 600.0)}, "each given once"),
        ({"preloads": (0.0,)}, "a preload, in N, is 0.0; it must be a number, more than 0"),
        ({"preloads": (float("nan"),)}, "a preload, in N, is nan"),
        ({"preloads": (600.0, 9e9)}, "cannot have"),
    ],
)
def test_what_cannot_be_is_refused(sheet, change, message):
    with pytest.raises(InputError, match=message):
        optimise(PLAN, sheet, **change)


def test_a_screw_held_at_both_ends_needs_its_curve(sheet):
    both = replace(sheet, support="fixed-fixed")
    best = optimise(PLAN, both)
    assert len(best.plan.positions) >= 3
    assert "curve" in {one.name for one in best.chosen.accuracy}
    assert best.ratio > 1.2


def test_two_places_cannot_tell_a_curve_and_that_is_said(sheet):
    both = replace(sheet, support="fixed-fixed")
    best = optimise(replace(FAST, positions=(0.0, 0.12)), both)
    assert best.plan.positions == (0.0, 0.12)
    assert best.chosen.information == 0.0
    assert best.to_json()["information_per_minute_ratio"] is None


def test_a_model_and_its_covariance_belong_together(sheet):
    mean, covariance = prior(sheet, 0.225)
    model = from_vector(mean, 0.225)
    with pytest.raises(InputError, match="belong together"):
        optimise(PLAN, sheet, model=model)
    surer = optimise(PLAN, sheet, model=model, covariance=covariance / 100)
    assert surer.given.accuracy[0].before < optimise(PLAN, sheet).given.accuracy[0].before


def test_a_plan_that_leaves_the_screw_is_refused(sheet):
    with pytest.raises(InputError, match="not on the screw"):
        optimise(replace(PLAN, positions=(0.0, 5.0)), sheet)


@pytest.mark.parametrize("adjust", [0.0, 30.0])
def test_it_finds_the_best_of_all_preloads(sheet, adjust):
    plan = replace(FAST, positions=(0.0, 0.45), masses=(0.0, 50.0))
    preloads = (150.0, 250.0, 400.0, 600.0)
    best = optimise(plan, sheet, preloads=preloads, adjust_minutes=adjust)
    model, covariance = sheet_prior(replace(plan, preloads=preloads), sheet)
    found = []
    for picked in (pick for n in range(1, 5) for pick in combinations(preloads, n)):
        if 600.0 in picked and middle(picked, preloads):
            one = replace(best.plan, preloads=picked)
            for loads in ((0.0,), (50.0,), (0.0, 50.0)):
                information = plan_information(
                    replace(one, masses=loads), model, covariance, best.scatter, 10.0, (0.0, 0.45),
                    adjust_minutes=adjust, preloads=4,
                )  # fmt: skip
                found.append(information.per_minute)
    assert best.chosen.per_minute == pytest.approx(max(found), rel=1e-9)
    assert best.chosen.rank == best.chosen.parameters
    assert best.ratio == float("inf")  # the given plan leaves the share to the data sheet


def test_one_preload_of_several_is_never_enough(sheet):
    best = optimise(PLAN, sheet, preloads=(600.0, 300.0), adjust_minutes=1000.0)
    assert best.plan.preloads == (300.0, 600.0)


def test_stops_that_rounding_would_bring_too_close_are_exact():
    """Two motions of 25.2 mm between stops 25.225 mm apart: whole millimetres would be 25 mm."""
    gap = 2 * SLOW.acceleration_distance
    plan = replace(PLAN, positions=(0.0, 2.0005 * gap))
    first, middle_stop, last = candidate_stops(plan)
    assert (first, last) == plan.positions
    assert middle_stop == pytest.approx(1.00025 * gap, abs=1e-12)
    assert abs(1e3 * middle_stop - round(1e3 * middle_stop)) > 0.01


def test_the_text_says_where_the_given_plan_does_not_determine_all(sheet):
    plan = replace(FAST, positions=(0.0, 0.45), masses=(0.0, 50.0))
    best = optimise(plan, sheet)
    assert f"{best.ratio:.3g} times the information per minute of the given plan, by the data sheet" in str(
        best
    )
    single = str(optimise(replace(plan, masses=(50.0,)), sheet, loads=(0.0, 50.0)))
    assert "the given plan does not determine all parameters, by the data sheet" in single
    assert "times the information" not in single
