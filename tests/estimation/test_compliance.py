"""The change Y in every cell, and the effects of all but the nut on it."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.estimation.made_runs import BEARING, LOAD, MODEL, calibrated, run_of

from ballscrew.axis.axial import frequency
from ballscrew.axis.equations import preload_change
from ballscrew.base.errors import InputError
from ballscrew.calibration.assumptions import Assumptions
from ballscrew.calibration.frequency_table import frequency_table, paired_cells
from ballscrew.estimation.compliance import change_from_model, change_since, load_sensitivity
from ballscrew.estimation.preload import preload
from ballscrew.modal.cell import SharedError

BASE = frequency_table(run_of(name="base"))


@settings(max_examples=20, deadline=None)
@given(st.floats(0.2, 2.0), st.floats(0.5, 1.2))
def test_every_cell_determines_the_ratio_at_any_level_of_the_baseline(ratio: float, level: float) -> None:
    base, run = frequency_table(run_of(level, name="base")), frequency_table(run_of(level * ratio))
    change = change_since(run, base, MODEL, BEARING, level)
    rows, of_base = paired_cells(run, base)
    np.testing.assert_allclose(change.y / change.nut_share, ratio ** (-1 / 3) - 1, atol=1e-9)
    np.testing.assert_allclose(
        preload_change(run.frequency[rows], base.frequency[of_base], change.nut_share), ratio, rtol=1e-8
    )


def test_pairs_have_the_same_stop_condition_and_motion() -> None:
    run = frequency_table(run_of())
    other = dataclasses.replace(BASE, motion=tuple(1 for _ in BASE.motion))
    assert paired_cells(run, other) == ([], [])
    with pytest.raises(InputError, match="no good cell in common"):
        change_since(run, other, MODEL, BEARING)
    rows, of_base = paired_cells(run, BASE)
    assert len(rows) == len(run.frequency)
    np.testing.assert_array_equal(run.position[rows], BASE.position[of_base])


def slope_of(softened, size: float) -> np.ndarray:
    """Derivative of Y by a small change, by the model itself."""
    f = {s: softened(s * size) for s in (-1, 1)}
    return np.asarray(((f[-1] / f[1]) ** 2 - 1) / (2 * size))


def test_signatures_are_those_of_the_model() -> None:
    change = change_since(frequency_table(run_of()), BASE, MODEL, BEARING)
    x = change.position
    mass = slope_of(lambda kg: frequency(MODEL, x, LOAD + kg), 1e-3)
    np.testing.assert_allclose(change.by_load, mass, rtol=1e-4)
    along = slope_of(lambda m: frequency(MODEL, x + m, LOAD), 1e-5)
    np.testing.assert_allclose(change.log_slope, along, rtol=1e-4)
    nut = slope_of(lambda part: frequency(MODEL, x, LOAD, (1 + part) ** -3), 1e-5)
    np.testing.assert_allclose(change.nut_share, nut, rtol=1e-4)
    whole = 1 + MODEL.slope * (x - MODEL.centre)
    np.testing.assert_allclose(change.bearing_share, BEARING / whole, rtol=1e-12)


def test_a_kilogram_without_a_rotor() -> None:
    rigid = dataclasses.replace(MODEL, rotor=np.inf)
    mass = slope_of(lambda kg: frequency(rigid, 0.1, LOAD + kg), 1e-3)
    assert load_sensitivity(rigid, LOAD) == pytest.approx(float(mass), rel=1e-4)


@pytest.mark.parametrize("more", [-5.0, 7.5])
def test_a_known_change_of_the_load_is_removed_exactly(more: float) -> None:
    change = change_since(
        frequency_table(run_of(0.7, true_load=LOAD + more)), BASE, MODEL, BEARING, load_change=more
    )
    np.testing.assert_allclose(change.y / change.nut_share, 0.7 ** (-1 / 3) - 1, atol=1e-9)
    with pytest.raises(InputError, match="leaves no mass"):
        change_since(frequency_table(run_of()), BASE, MODEL, BEARING, load_change=-200.0)


def test_other_loads_bring_in_what_the_models_masses_err_by() -> None:
    covariance = np.zeros((7, 7))
    covariance[3, 3], covariance[4, 4] = 0.05**2, 0.03**2
    more = 25.0
    run = frequency_table(run_of(1.0, load=LOAD + more))

    def change_by(model):
        return change_since(run, BASE, model, BEARING, load_change=more, covariance=covariance)

    term = next(t for t in change_by(MODEL).terms if t.name == "mass of the model")
    size = 1e-4
    by = [
        (
            change_by(dataclasses.replace(MODEL, **{name: getattr(MODEL, name) * (1 + size)})).y
            - change_by(MODEL).y
        )
        / size
        for name in ("mass", "rotor")
    ]
    expected = np.hypot(0.05 * by[0], 0.03 * by[1])
    np.testing.assert_allclose(np.abs(term.effects[0]), expected, rtol=1e-2)
    same = change_since(frequency_table(run_of()), BASE, MODEL, BEARING, covariance=covariance)
    assert "mass of the model" not in {t.name for t in same.terms}


def test_a_part_of_the_load_that_was_weighed_by_itself_has_its_own_error() -> None:
    same, other = (
        next(
            t
            for t in change_since(
                frequency_table(run_of(load=LOAD + more)), BASE, MODEL, BEARING, load_change=more
            ).terms
            if t.name == "declared load"
        ).effects.max()
        for more in (0.0, -80.0)
    )
    assert other > 1.5 * same


def test_against_the_model_its_parameters_count() -> None:
    change = change_from_model(frequency_table(run_of(0.8)), MODEL, BEARING)
    assert change.by_parameters is not None
    assert change.by_parameters.shape == (7, len(change.y))
    stiffer = dataclasses.replace(MODEL, compliance=MODEL.compliance * np.exp(1e-5))
    other = change_from_model(frequency_table(run_of(0.8)), stiffer, BEARING)
    np.testing.assert_allclose((other.y - change.y) / 1e-5, change.by_parameters[0], rtol=1e-3)


def test_an_error_that_repeats_in_one_run_alone_counts_whole() -> None:
    """What both runs have in common cancels; what only one has does not."""
    plain = {name: run_of(ratio, name=name) for name, ratio in (("run", 0.8), ("base", 1.0))}
    erring = {}
    for name, run in plain.items():
        effects = tuple(2e-3 * (cell.frequency_Hz or 0.0) for cell in run.cells)
        error = SharedError("sensor", repeats=True, effects_Hz=effects)
        erring[name] = dataclasses.replace(run, shared_errors=(error,))
    pairs = {
        "neither": (plain, plain), "the run": (erring, plain),
        "the baseline": (plain, erring), "both": (erring, erring),
    }  # fmt: skip
    part = {"neither": 0.0}
    for which, (runs, baselines) in pairs.items():
        found = preload(
            runs["run"], calibrated(), baselines["base"], assumptions=Assumptions(repeats=1.0)
        ).stiffness_relative_to_baseline
        assert found is not None
        part[which] = found.standard_uncertainty**2
    added = {which: variance - part["neither"] for which, variance in part.items()}
    assert added["the run"] == pytest.approx(added["the baseline"], rel=0.02)
    assert added["the run"] > 1e-4
    assert abs(added["both"]) < 0.1 * added["the run"]
