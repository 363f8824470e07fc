from __future__ import annotations

from dataclasses import replace

import pytest
from tests.modal.conftest import table_of
from tests.modal.plant import Plant
from tests.recording.synthetic import SHEET

from ballscrew.axis.model import rotor_mass
from ballscrew.modal.masses import rigid_body_result
from ballscrew.recording.measure import Measurement
from ballscrew.recording.quality.finding import Quality
from ballscrew.recording.rigid_body import RigidBody

FIT = RigidBody(295.0, 300.0, 25.0, -5.0, (1.0, 2.0, 3.0, 4.0), 0.1, 0.999, (0.1, 0.2, 0.3, 0.4))


@pytest.fixture(scope="module")
def measurement():
    return Measurement((), None, Quality("good"), table_of(Plant(servo=0.5)), FIT)


def test_with_a_sheet(measurement):
    body = rigid_body_result(measurement, SHEET, 100.0)
    assert body.equivalent_mass_kg == 295.0
    assert body.moving_mass_kg == pytest.approx(295.0 - rotor_mass(SHEET))
    assert (body.viscous_N_s_per_m, body.coulomb_N, body.offset_N) == (300.0, 25.0, -5.0)
    assert body.frf_equivalent_mass_kg == pytest.approx(295.0, rel=0.02)
    assert set(body.standard_uncertainty) == {
        "equivalent_mass_kg", "viscous_N_s_per_m", "coulomb_N", "offset_N", "moving_mass_kg",
        "frf_equivalent_mass_kg",
    }  # fmt: skip
    assert body.standard_uncertainty["coulomb_N"] == 3.0
    assert body.repeatability == {
        "equivalent_mass_kg": 0.1, "viscous_N_s_per_m": 0.2, "coulomb_N": 0.3, "offset_N": 0.4,
    }  # fmt: skip
    assert body.reasons == ()


def test_without_a_sheet_a_force_weighs_but_the_rotor_is_not_known(measurement):
    body = rigid_body_result(measurement, None, 0.0)
    assert body.moving_mass_kg is None
    assert "moving_mass_kg" not in body.standard_uncertainty
    assert body.frf_equivalent_mass_kg == pytest.approx(295.0, rel=0.03)
    assert "--axis" in body.reasons[0]


def test_what_cannot_be_known_is_none_with_the_reason(measurement):
    for lacking in (
        replace(measurement, rigid_body=None, reasons=("why",)),
        replace(measurement, rigid_body=None, transients=None, reasons=("why",)),
    ):
        body = rigid_body_result(lacking, SHEET, 100.0)
        assert (body.equivalent_mass_kg, body.moving_mass_kg, body.coulomb_N) == (None, None, None)
        assert body.reasons == ("why",)
        assert body.standard_uncertainty == {}


def test_too_few_transients_are_said(measurement):
    few = replace(measurement, transients=measurement.transients.isel(transient=[]))
    body = rigid_body_result(few, SHEET, 100.0)
    assert body.equivalent_mass_kg == 295.0
    assert body.frf_equivalent_mass_kg is None
    assert body.reasons == ("too few transients for the equivalent mass from the FRF",)
