from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.modal.conftest import table_of
from tests.modal.plant import Plant, trip, way

from ballscrew.fcft.plan import Motion
from ballscrew.modal.masses import frf_equivalent_mass

# A stiff axis: what is measured far below its mode is its mass.
STIFF = replace(Plant().quiet, frequency=400.0, damping=0.05)


def test_the_mass_of_a_known_axis():
    mass = frf_equivalent_mass(table_of(STIFF), 1.0, 400.0)
    assert mass.unit == "kg"
    assert mass.value == pytest.approx(STIFF.mass, rel=0.01)
    assert abs(mass.value - STIFF.mass) < 3 * mass.standard_uncertainty + 0.005 * STIFF.mass


def test_the_mode_lifts_nothing_where_it_is_known():
    """With the mode at 120 Hz the lines end at 14 Hz; at 30 Hz the resonance takes 6 % of the mass."""
    soft = replace(STIFF, frequency=120.0)
    table = table_of(soft)
    assert frf_equivalent_mass(table, 1.0, 120.0).value == pytest.approx(soft.mass, rel=0.02)


def test_bias_and_scatter_under_noise():
    noisy = replace(STIFF, force_noise=5.0, acceleration_noise=0.1, ripple=5.0)
    got = [frf_equivalent_mass(table_of(noisy, seed=seed), 1.0, 400.0) for seed in range(12)]
    values = np.array([q.value for q in got])
    assert values.mean() == pytest.approx(STIFF.mass, rel=0.01)
    assert values.std() < 0.005 * STIFF.mass
    assert values.std() < 2 * np.mean([q.standard_uncertainty for q in got])


def test_friction_cancels_over_directions():
    rough = replace(STIFF, coulomb=120.0)
    slow = way(trip([0.0, 0.06, 0.12]), 5000, Motion(0.05, 1.0, 200.0, 0.35))
    assert frf_equivalent_mass(table_of(rough, move=slow), 1.0, 400.0).value == pytest.approx(
        STIFF.mass, rel=0.03
    )


@pytest.mark.parametrize("scale", [2.0, 1 / 0.0015915])
def test_the_scale_takes_a_torque_to_a_force(scale):
    table = table_of(STIFF)
    plain = frf_equivalent_mass(table, 1.0, 400.0)
    scaled = frf_equivalent_mass(table, scale, 400.0)
    assert scaled.value == pytest.approx(scale * plain.value)
    assert scaled.standard_uncertainty == pytest.approx(scale * plain.standard_uncertainty)


def test_a_sensor_upside_down_weighs_the_same():
    table = table_of(STIFF, responses=2)
    upside = table.copy(deep=True)
    upside["acceleration"].values[1] *= -1
    one, other = (frf_equivalent_mass(t, 1.0, 400.0).value for t in (table, upside))
    assert other == pytest.approx(one, rel=1e-9)


def test_incomplete_phases_do_not_count():
    table = table_of(STIFF)
    spoilt = table.copy(deep=True)
    spoilt["complete"].values[0] = False
    spoilt["input"].values[0] = 1e6
    assert frf_equivalent_mass(spoilt, 1.0, 400.0).value == pytest.approx(
        frf_equivalent_mass(table, 1.0, 400.0).value, rel=0.01
    )


def test_nothing_to_weigh():
    table = table_of(STIFF)
    none = table.isel(transient=[])
    assert frf_equivalent_mass(none, 1.0, 400.0) is None
    assert frf_equivalent_mass(table.isel(transient=[0]), 1.0, 400.0) is None, "one stop has no scatter"
    still = table.copy(deep=True)
    still["acceleration"].values[:] = 0.0
    assert frf_equivalent_mass(still, 1.0, 400.0) is None
