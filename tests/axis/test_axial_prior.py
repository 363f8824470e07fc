"""Prior of the model by the data sheet, against machines that the lumped formula does not describe."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from benchmarks.axis_sampling import random_axis

from ballscrew.axis.axial import PARAMETERS, frequency, from_sheet, from_vector, gradient, to_vector
from ballscrew.axis.axial_prior import DISCREPANCY, both_ends_curve, distributed, prior
from ballscrew.axis.frequency import predicted_frequency
from ballscrew.axis.rod import rod_frequency
from ballscrew.axis.sheet import DataSheet, Drive
from ballscrew.testbed.linear import true_frequency
from ballscrew.testbed.machine import constants


def test_follows_the_rod(axes: dict[str, DataSheet]) -> None:
    sheet = replace(axes["M"], drive=replace(axes["M"].drive, coupling_stiffness=5000.0))
    model = from_vector(distributed(sheet, 0.2), 0.2)
    for x, load in ((0.05, 0.0), (0.25, 30.0), (0.45, 100.0)):
        wanted = float(np.asarray(rod_frequency(sheet, x, load, elements=60)))
        assert float(frequency(model, x, load)) == pytest.approx(wanted, rel=1.5e-3)
        assert float(frequency(from_sheet(sheet, 0.2), x, load)) != pytest.approx(wanted, rel=4e-3)


def test_a_model_is_found_where_the_modes_of_a_soft_belt_take_turns(axes: dict[str, DataSheet]) -> None:
    drive = Drive(3.3e-3, coupling_stiffness=2e4, belt_stiffness=600.0, ratio=3.0)
    sheet = replace(axes["L"], drive=drive)
    x = np.linspace(0.0, 0.8, 4)
    wanted = predicted_frequency(sheet, x, 0.0)
    assert wanted.max() > 3 * wanted.min()
    model = from_vector(distributed(sheet, 0.4), 0.4)
    assert np.all(np.isfinite(to_vector(model)))
    # The misfit is a part of the model's uncertainty.
    assert np.abs(np.log(frequency(model, x, 0.0) / wanted)).max() < np.log(wanted.max() / wanted.min())


def test_k_moves_share_and_compliance_together(axes: dict[str, DataSheet]) -> None:
    sheet = replace(axes["M"], tolerances={"rigidity": 0.2, "stiffness": 0.0, "preload_ratio": 0.0})
    _, spread = prior(sheet, 0.2, {}, bed=(18.0, 0.0))
    i, j = PARAMETERS.index("compliance"), PARAMETERS.index("share")
    assert spread[i, j] == pytest.approx(np.sqrt(spread[i, i] * spread[j, j]), rel=1e-6)
    share = from_sheet(sheet, 0.2).share
    # U = U_s + 1/k_n: d ln U / d ln K = −s.
    assert np.sqrt(spread[i, i]) == pytest.approx(share * 0.2 / np.sqrt(3), rel=1e-4)


def test_the_discrepancy_widens_and_takes_from_the_nut_what_the_rest_gains(
    axes: dict[str, DataSheet],
) -> None:
    sheet = replace(axes["M"], tolerances={"rigidity": 0.0, "stiffness": 0.0, "preload_ratio": 0.0})
    mean, spread = prior(sheet, 0.2, {"compliance": 0.04}, bed=(18.0, 0.0))
    share = from_vector(mean, 0.2).share
    nut = np.zeros(7)  # ln(U s) does not move
    nut[PARAMETERS.index("compliance")], nut[PARAMETERS.index("share")] = 1.0, 1 - share
    assert nut @ spread @ nut == pytest.approx(0.0, abs=1e-12)
    assert spread[0, 0] == pytest.approx(0.04**2)


def test_no_curve_where_one_end_is_fixed(axes: dict[str, DataSheet]) -> None:
    mean, spread = prior(axes["M"], 0.2)
    at = PARAMETERS.index("curve")
    assert mean[at] == 0
    assert not spread[at].any()
    assert both_ends_curve(axes["M"], 0.2) < 0


@pytest.mark.parametrize("seed", range(4))
def test_the_truth_of_random_axes_lies_within_the_discrepancy(seed: int) -> None:
    """True values of the sheet, no tolerance: what is left is what the model lacks."""
    random_sheet = random_axis(seed)
    machine = random_sheet.rig.machine
    none = dict.fromkeys(("rigidity", "stiffness", "preload_ratio"), 1e-6)
    sheet, centre = replace(machine.sheet, tolerances=none), float(np.mean(random_sheet.plan.positions))
    mean, spread = prior(sheet, centre)
    x = np.repeat(random_sheet.plan.positions, 3)
    load = np.tile([0.0, 0.5, 1.0], len(random_sheet.plan.positions)) * sheet.table.mass
    true = np.array([true_frequency(constants(machine, m, centre), p) for p, m in zip(x, load, strict=True)])
    off = np.log(true / frequency(from_vector(mean, centre), x, load))
    assert abs(off.mean()) < 0.035
    assert abs(off.mean()) < abs(np.log(true / frequency(from_sheet(sheet, centre), x, load)).mean())
    slopes = gradient(from_vector(mean, centre), x, load)[:, :7]
    covariance = slopes @ spread @ slopes.T + 5e-4**2 * np.eye(len(x))
    assert off @ np.linalg.solve(covariance, off) < len(x) + 5 * np.sqrt(2 * len(x))


def test_the_sheets_preload_is_the_mean(axes: dict[str, DataSheet]) -> None:
    mean, _ = prior(axes["L"], 0.3)
    assert np.exp(mean[-1]) == pytest.approx(axes["L"].nominal_preload)
    assert np.isfinite(to_vector(from_vector(mean, 0.3))).all()
    assert set(DISCREPANCY) <= set(PARAMETERS)
