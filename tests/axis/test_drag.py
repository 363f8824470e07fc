from __future__ import annotations

import numpy as np
import pytest

from ballscrew.axis.drag import preload_torque
from ballscrew.base.errors import InputError


def test_a_screw_of_25_by_10():
    # By hand: tan λ = 10/(25π) = 0.12732; 0.05/√0.12732 = 0.14013; 680 N · 10 mm/2π = 1.08225 N m.
    assert float(preload_torque(680.0, 0.01, 0.025)) == pytest.approx(0.15165, abs=5e-6)


def test_the_screw_of_a_wear_test():
    """Lead 8 mm, 1500 N, and a diameter that its record does not state."""
    low, high = preload_torque(1500.0, 0.008, np.array([0.040, 0.045]))
    assert f"{low:.2f} {high:.2f}" == "0.38 0.40"


def test_it_is_what_was_measured_when_new(data):
    series = data / "xjtu" / "friction_torque_upper.csv"
    if not series.is_file():
        pytest.skip(f"no {series}")
    new = np.loadtxt(series, delimiter=",", skiprows=1)[0, 1]
    low, high = preload_torque(1500.0, 0.008, np.array([0.040, 0.045]))
    assert low < new < high


def test_it_is_in_proportion_to_the_preload():
    got = preload_torque(np.array([0.0, 100.0, 200.0]), 0.01, 0.025)
    np.testing.assert_allclose(got / got[1], [0, 1, 2])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((-1.0, 0.01, 0.02), "a preload of -1 was given; it must be 0 N or more"),
        ((np.nan, 0.01, 0.02), "a preload of nan was given"),
        ((1.0, 0.0, 0.02), "a lead of 0 was given; it must be more than 0 m"),
        ((1.0, 0.01, [0.02, -0.02]), "a pitch diameter of -0.02 was given"),
    ],
)
def test_impossible_values(arguments, message):
    with pytest.raises(InputError, match=message):
        preload_torque(*arguments)
