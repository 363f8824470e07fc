"""The benchmark of the constants changes each, and puts it back."""

from __future__ import annotations

import math

import pytest
from benchmarks.constants import Constant, altered, compared, constants, effect_cells, scaled

from ballscrew.modal.joint import fit, profile


@pytest.mark.parametrize(
    ("value", "half", "double"),
    [(5.0, 2.5, 10.0), (0.5, 1 / 3, 2 / 3), (3, 2, 6), (1, 1, 2)],
)
def test_a_number_is_halved_and_a_fraction_by_its_odds(value: float, half: float, double: float) -> None:
    assert scaled(value, 0.5) == pytest.approx(half)
    assert scaled(value, 2.0) == pytest.approx(double)


def test_a_range_around_1_widens_on_both_sides() -> None:
    assert Constant("x", "_NEAR", (0.5, 2.0)).changed(2.0) == (0.25, 4.0)
    assert Constant("x", "_NEAR", (2.0, 3.0)).changed(2.0) == (4.0, 6.0)


def test_constants_are_numbers_that_only_their_file_states() -> None:
    found = {(one.module, one.name): one.value for one in constants("joint")}
    assert found["modal/joint/fit.py", "SAMPLES_PER_INDEPENDENT"] == fit.SAMPLES_PER_INDEPENDENT
    assert ("modal/joint/settings.py", "clock") in found
    assert not any(math.isnan(value) for value in found.values() if not isinstance(value, tuple))
    names = {one.name for one in constants("preload")}
    assert not names & {"SIZE", "_SHARE", "_PRELOAD"}  # indices and lengths
    assert "repeats" in names


def test_a_constant_is_changed_wherever_it_was_imported_and_restored() -> None:
    (one,) = (one for one in constants("joint") if one.name == "SAMPLES_PER_INDEPENDENT")
    with altered(one, 2.5):
        assert fit.SAMPLES_PER_INDEPENDENT == profile.SAMPLES_PER_INDEPENDENT == 2.5
    assert fit.SAMPLES_PER_INDEPENDENT == profile.SAMPLES_PER_INDEPENDENT == one.value


def test_a_setting_is_passed_and_changes_no_module() -> None:
    (one,) = (one for one in constants("preload") if one.name == "repeats")
    with altered(one, 0.8) as settings:
        assert settings.assumptions.repeats == 0.8


def test_moves_are_in_standard_uncertainties_and_verdicts_are_counted() -> None:
    before = {"a": (100.0, 0.5, "good"), "b": (90.0, 0.5, "good"), "c": (math.nan, math.nan, "refused")}
    after = {"a": (101.0, 0.25, "good"), "b": (80.0, 0.5, "suspect"), "c": (math.nan, math.nan, "refused")}
    assert compared(before, after) == (2.0, 2.0, 1)
    assert effect_cells(2.0, 2.0, 1, "") == "2.00 | 2.00 | 1"
    assert effect_cells(0.0, 1.0, 0, "InputError").startswith("InputError | ")
