"""Values expected from the data sheet before the fit."""

from __future__ import annotations

import math

import pytest

from ballscrew.axis.frequency import predicted_frequency
from ballscrew.axis.model import moving_mass, screw_part
from ballscrew.modal.joint.initial import expected_mass_over_preload
from ballscrew.testbed.example import AXIS, LOAD

POSITION = 0.2
NOMINAL = (float(moving_mass(AXIS, LOAD)) + screw_part(AXIS)) / AXIS.nominal_preload


def expected(ratio: float, error: float = 1.0) -> tuple[float, float]:
    """Preload over nominal, by a frequency of this preload times ``error``, and its deviation."""
    frequency = float(predicted_frequency(AXIS, POSITION, LOAD, ratio * AXIS.nominal_preload))
    value, deviation, _ = expected_mass_over_preload(AXIS, LOAD, POSITION, error * frequency)
    return NOMINAL / value, deviation


def test_a_frequency_as_predicted_is_that_of_a_sound_nut() -> None:
    preload, deviation = expected(1.0)
    assert abs(math.log(preload)) < 1.1 * deviation
    assert 0.2 < deviation < 0.45


@pytest.mark.parametrize("ratio", [0.1, 0.2, 0.5])
def test_the_interval_contains_a_worn_nut(ratio: float) -> None:
    preload, deviation = expected(ratio)
    assert preload < 1.0
    assert abs(math.log(preload / ratio)) < 2 * deviation


def test_the_lower_the_frequency_the_lower_the_preload() -> None:
    preloads = [expected(ratio)[0] for ratio in (2.0, 1.0, 0.7, 0.4, 0.2, 0.1, 0.05)]
    assert preloads == sorted(preloads, reverse=True)


@pytest.mark.parametrize("error", [0.7, 1.4])
def test_a_sheet_far_beyond_its_tolerances_determines_no_preload(error: float) -> None:
    value, deviation, _ = expected_mass_over_preload(
        AXIS, LOAD, POSITION, error * float(predicted_frequency(AXIS, POSITION, LOAD))
    )
    assert math.isfinite(value)
    assert deviation > 0.3
