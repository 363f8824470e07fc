"""Families of wear: their laws in closed form, and courses that slow down, speed up and change."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ballscrew.axis.wear import WEAR_LAWS
from ballscrew.prognosis.families import (
    FAMILIES,
    LAW_EXPONENTS,
    N_PARAMETERS,
    FamilyPrior,
    named_laws,
    remaining_part,
    wear_depth,
)

PRIOR = FamilyPrior()
Z = np.random.default_rng(1).standard_normal((200, N_PARAMETERS))
BY_NAME = {family.name: family for family in FAMILIES}


@pytest.mark.parametrize("law", WEAR_LAWS)
def test_the_depth_of_a_named_law_is_linear_in_the_travel(law: str) -> None:
    travel = np.linspace(0, 1.2, 7)
    x = WEAR_LAWS[law](travel, 1.0, 1.0) ** (2 / 3)
    z = wear_depth(x, np.array(LAW_EXPONENTS[law]))
    assert z == pytest.approx(travel * z[-1] / travel[-1], rel=1e-4)


def test_a_straight_fall_of_the_preload_is_linear_too() -> None:
    ratio = np.linspace(1, 0.2, 5)
    assert np.diff(wear_depth(ratio ** (2 / 3), np.array(-0.5)), 2) == pytest.approx(0, abs=1e-12)


@given(st.floats(0.0, 1e4))
def test_the_onset_of_a_probability_has_that_probability(duty: float) -> None:
    prior = FamilyPrior()
    probability = prior.onset_probability(np.array([duty]))
    assert prior.onset_at(probability)[0] == pytest.approx(duty, rel=1e-9)
    assert prior.onset_probability(np.array([prior.onset]))[0] == 0.5


@given(st.floats(-2, 1.1), st.floats(-0.5, 1.5))
def test_depth_and_remaining_part_are_inverse(x: float, p: float) -> None:
    """Also with backlash, where x is below 0."""
    depth = wear_depth(np.array(x), np.array(p))
    assert remaining_part(depth, np.array(p)) == pytest.approx(x, abs=1e-6)


@pytest.mark.parametrize("law", LAW_EXPONENTS)
def test_noise_makes_no_new_nut_many_times_as_stiff(law: str) -> None:
    """Above x = 1 the depth of the steepest laws has a limit, which noise may pass."""
    x = remaining_part(np.array([-0.5, -2.5, -100.0]), np.array(LAW_EXPONENTS[law]))
    assert (x > 1).all()
    assert (x <= 2).all()


@pytest.mark.parametrize("family", FAMILIES)
def test_a_course_begins_at_the_onset_and_never_falls(family) -> None:
    cloud = family.cloud(Z, PRIOR, 60.0)
    duty = np.linspace(0, 200, 101)
    course = cloud.course(duty)
    assert (np.diff(course, axis=1) >= 0).all()
    assert (course[duty[None, :] <= cloud.onset[:, None]] == 0).all()


def test_the_pace_of_each_family() -> None:
    pace = {}
    for name, family in BY_NAME.items():
        cloud = family.cloud(np.zeros((1, N_PARAMETERS)), PRIOR, 100.0)
        pace[name] = np.diff(cloud.course(np.arange(20.0, 300.0)))[0]
    assert pace["straight line"] == pytest.approx(1)
    assert pace["law of wear, by time"] == pytest.approx(1)
    assert (np.diff(pace["running-in"]) < 0).all()
    assert pace["running-in"][0] / pace["running-in"][-1] == pytest.approx(1 + 1 / 0.7, rel=0.05)
    assert np.log(pace["exponential"])[-1] == pytest.approx(PRIOR.growth * 279 / 80, rel=0.02)
    assert np.unique(pace["change of regime"].round(6)).tolist() == [1.0, PRIOR.factor]


def test_the_nearest_law_is_named() -> None:
    result = named_laws(np.array([0.1, 0.4, 0.5, 1.4]), np.full(4, 2.0))
    assert named_laws(np.empty(0), np.empty(0)) == {}
    assert named_laws(np.array([0.1, 1.4]), np.array([3.0, 1.0]))["external-load"] == 0.75
    assert result == {"external-load": 0.25, "contact-pressure": 0.5, "exponential": 0, "preload": 0.25}


def test_a_family_names_the_numbers_it_uses() -> None:
    """A number that is not used changes no member."""
    for family in FAMILIES:
        unused = [k for k in range(N_PARAMETERS) if k not in family.free]
        other = Z.copy()
        other[:, unused] = 7.0
        first, second = (family.cloud(z, PRIOR, 60.0) for z in (Z, other))
        for name in first.__slots__:
            assert (getattr(first, name) == getattr(second, name)).all(), (family.name, name)
        for used in family.free:
            other = Z.copy()
            other[:, used] = 1.5
            second = family.cloud(other, PRIOR, 60.0)
            assert any((getattr(first, name) != getattr(second, name)).any() for name in first.__slots__)
