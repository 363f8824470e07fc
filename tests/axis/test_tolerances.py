"""The makers' tolerances: defaults, what they make of θ and of a frequency, against a sample of axes."""

from __future__ import annotations

import math
from dataclasses import asdict, replace

import numpy as np
import pytest

from ballscrew.axis.frequency import predicted_frequency
from ballscrew.axis.model import theta
from ballscrew.axis.tolerances import (
    DEFAULT_TOLERANCES,
    propagate,
    relative_uncertainties,
    tolerances,
    with_uncertainty,
)
from ballscrew.base.errors import InputError


def test_the_defaults(axes):
    assert tolerances(axes["M"]) == {"rigidity": 0.20, "stiffness": 0.30, "preload_ratio": 0.15}


def test_a_sheet_overrules_them(sheets):
    sheet = sheets.read(tolerances__rigidity=0.1, tolerances__mass=0.02)
    predicted = tolerances(sheet)
    assert (predicted["rigidity"], predicted["stiffness"], predicted["mass"]) == (0.1, 0.3, 0.02)


def test_a_tolerance_is_the_half_width_of_a_rectangle(axes):
    assert relative_uncertainties(axes["M"])["rigidity"] == pytest.approx(0.2 / math.sqrt(3))


def test_no_tolerance_and_no_value_add_nothing(axes):
    none = dict.fromkeys(DEFAULT_TOLERANCES, 0.0) | {"coupling_stiffness": 0.5}
    sheet = replace(axes["M"], tolerances=none)
    assert relative_uncertainties(sheet) == {}
    predicted = with_uncertainty(sheet, [0.0, 0.4], 0.0)
    np.testing.assert_array_equal(predicted.standard_uncertainty, 0)
    np.testing.assert_array_equal(predicted.covariance, np.zeros((2, 2)))


def theta_with_uncertainty(sheet):
    return propagate(sheet, lambda varied: list(asdict(theta(varied)).values()))


def test_theta_by_hand(axes):
    # a, b, c ∝ κ ∝ K; of b only the bearing's part follows k_b.
    sheet = axes["M"]
    predicted = theta_with_uncertainty(sheet)
    u = predicted.standard_uncertainty / np.abs(predicted.value)
    assert u[0] == pytest.approx(0.2 / math.sqrt(3), rel=1e-6)
    assert u[2] == pytest.approx(0.2 / math.sqrt(3), rel=1e-6)
    assert u[3] == 0
    part = (1 / 180e6) / (1 / 180e6 + 0.12 / (206e9 * math.pi * 0.0214**2 / 4))
    assert u[1] == pytest.approx(math.hypot(0.2, 0.3 * part) / math.sqrt(3), rel=1e-6)


def test_a_and_c_share_the_nut(axes):
    predicted = theta_with_uncertainty(axes["M"])
    u = predicted.standard_uncertainty
    assert predicted.covariance[0, 2] == pytest.approx(-u[0] * u[2])
    assert predicted.covariance.shape == (4, 4)
    assert np.linalg.matrix_rank(predicted.covariance / np.outer(u + 1, u + 1), tol=1e-12) == 2


@pytest.mark.slow
def test_the_uncertainty_of_the_frequency_is_that_of_a_sample_of_axes(axes):
    sheet = axes["M"]
    predicted = with_uncertainty(sheet, np.array([0.0, 0.45]), 0.0)
    rng = np.random.default_rng(1)
    sample = []
    for _ in range(4000):
        k, b, p = 1 + rng.uniform(-1, 1, 3) * [0.2, 0.3, 0.15]
        other = replace(
            sheet,
            screw=replace(
                sheet.screw, rigidity=k * sheet.screw.rigidity, preload_ratio=p * sheet.screw.preload_ratio
            ),
            bearing=replace(sheet.bearing, stiffness=b * sheet.bearing.stiffness),
        )
        sample.append(predicted_frequency(other, np.array([0.0, 0.45]), 0.0))
    spread = np.std(sample, axis=0)
    # First order: 3 % off where the bearing's tolerance bends the curve; a sample of 4000 knows 1 %.
    np.testing.assert_allclose(predicted.standard_uncertainty, spread, rtol=0.05)
    correlation = predicted.covariance[0, 1] / np.prod(predicted.standard_uncertainty)
    assert correlation == pytest.approx(np.corrcoef(np.array(sample).T)[0, 1], abs=0.02)


def test_where_the_axial_mode_changes_the_other_one_is_in_the_uncertainty(axes):
    drive = replace(axes["L"].drive, coupling_stiffness=2e4, belt_stiffness=1000.0)
    sheet = replace(axes["L"], drive=drive)
    found = with_uncertainty(sheet, np.linspace(0.0, 0.8, 33), 0.0)
    (jump,) = np.flatnonzero(np.abs(np.diff(np.log(found.value))) > 0.3)
    assert found.ambiguous[jump : jump + 2].all()
    for k in (jump, jump + 1):
        away = abs(found.second_frequency[k] - found.value[k])
        assert 0.5 * away < found.standard_uncertainty[k] < away
    # At each mode by itself the sheet's tolerances add as little as elsewhere.
    assert np.abs(found.contributions["rigidity"] / found.value).max() < 0.1
    clear = with_uncertainty(axes["L"], 0.2, 0.0)
    assert not clear.ambiguous
    assert abs(clear.contributions["second mode"]) < 1e-6 * clear.standard_uncertainty


def test_at_the_end_of_the_screw_one_side_is_enough(axes):
    sheet = replace(axes["M"], tolerances={"length": 0.01})
    predicted = with_uncertainty(sheet, sheet.travel_limit, 0.0)
    assert np.isfinite(predicted.standard_uncertainty)
    assert predicted.contributions["length"] != 0


def test_any_number_of_a_sheet(axes):
    predicted = propagate(axes["M"], lambda sheet: sheet.nominal_preload)
    assert predicted.value == pytest.approx(680)
    assert predicted.standard_uncertainty == pytest.approx(680 * 0.15 / math.sqrt(3), rel=1e-6)


def test_a_tolerance_of_nothing(axes):
    with pytest.raises(InputError, match=r"tolerances\.colour is no field"):
        relative_uncertainties(replace(axes["M"], tolerances={"colour": 0.1}))
