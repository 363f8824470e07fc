"""A wrong load is corrected or refused, a drifted torque constant is not mistaken for one."""

from __future__ import annotations

import dataclasses
import math

import pytest
from tests.estimation.made_runs import LOAD, MODEL, calibrated, run_of

from ballscrew.calibration.assumptions import Assumptions
from ballscrew.estimation.causes import PossibleCause
from ballscrew.estimation.mass_check import Decision, check_mass, mass_changes
from ballscrew.estimation.preload import preload

SURE = {"uncertainty": 1e-4}
BASE = run_of(name="base", **SURE)
UNSURE = {"uncertainty": 4e-3}


def test_changes_of_the_logarithms() -> None:
    run = run_of(0.8, true_load=LOAD + 3, **SURE)
    masses = mass_changes(run, BASE, MODEL, Assumptions())
    whole = MODEL.mass + LOAD + MODEL.rotor
    assert masses is not None
    assert masses.log_mass == pytest.approx(3 / whole, rel=0.01)
    assert masses.log_mass_by_load == pytest.approx(1 / whole)
    assert masses.log_frequency_ratio == pytest.approx(3 * masses.log_frequency_ratio_by_load, rel=0.02)
    assert masses.log_friction[0][0] == pytest.approx(0.0)


def test_a_change_within_the_scatter_of_the_trips_is_none() -> None:
    run = run_of(1.0, torque=1.01, **SURE)
    certain = preload(run, calibrated(), BASE)
    scatter = 0.01 * (run.rigid_body.equivalent_mass_kg or 0.0)
    none, body = (
        dataclasses.replace(run.rigid_body, repeatability={"equivalent_mass_kg": part})
        for part in (0.0, scatter)
    )
    scattered = preload(dataclasses.replace(run, rigid_body=body), calibrated(), BASE)
    assert certain.mass is not None
    assert scattered.mass is not None
    assert (certain.mass.decision, scattered.mass.decision) == ("torque", "declared")
    spreads = []
    for rigid in (none, body):
        change = mass_changes(dataclasses.replace(run, rigid_body=rigid), BASE, MODEL, Assumptions())
        assert change is not None
        spreads.append(change.log_mass_spread)
    assert spreads[1] ** 2 - spreads[0] ** 2 == pytest.approx(0.01**2)


@pytest.mark.parametrize("hidden", [-4.0, 4.0])
@pytest.mark.parametrize("ratio", [1.0, 0.7])
def test_a_hidden_load_is_corrected(hidden: float, ratio: float) -> None:
    found = preload(run_of(ratio, true_load=LOAD + hidden, **SURE), calibrated(), BASE)
    assert found.mass is not None
    assert found.mass.decision == "corrected"
    assert found.mass.correction == pytest.approx(hidden, abs=0.02)
    assert found.relative_to_baseline is not None
    assert found.relative_to_baseline.value == pytest.approx(ratio, abs=0.01)
    assert found.verdict == "suspect"
    assert found.corrections == (f"load: {hidden:+.2f} kg",)


@pytest.mark.parametrize("declared", [-0.15, 0.15])
def test_a_hidden_load_is_corrected_beside_a_declared_change_of_it(declared: float) -> None:
    load = LOAD + declared * (MODEL.mass + LOAD)
    found = preload(run_of(0.7, load=load, true_load=load + 4.0, **SURE), calibrated(), BASE)
    assert found.mass is not None
    assert found.mass.decision == "corrected"
    assert found.mass.correction == pytest.approx(4.0, abs=0.02)
    assert found.relative_to_baseline is not None
    assert found.relative_to_baseline.value == pytest.approx(0.7, abs=0.01)


@pytest.mark.parametrize("scale", [0.985, 1.015])
def test_a_drifted_torque_constant_changes_no_preload(scale: float) -> None:
    found = preload(run_of(0.8, torque=scale, **SURE), calibrated(), BASE)
    assert found.mass is not None
    assert found.mass.decision == "torque"
    assert "changes no frequency" in found.mass.text
    assert found.relative_to_baseline is not None
    assert found.relative_to_baseline.value == pytest.approx(0.8, abs=0.005)


def test_an_undecided_interval_contains_both_preloads() -> None:
    base = run_of(name="base", **UNSURE)
    run = run_of(1.0, torque=1.01, **UNSURE)
    found = preload(run, calibrated(), base)
    assert found.mass is not None
    assert found.mass.decision == "undecided"
    assert found.verdict == "suspect"
    assert any("with and without the correction" in reason for reason in found.reasons)
    assert found.relative_to_baseline is not None
    low, high = found.relative_to_baseline.interval
    for trusted in (True, False):
        corrected = preload(run, calibrated(), base, assumptions=Assumptions(torque_trusted=trusted))
        assert corrected.relative_to_baseline is not None
        assert low < corrected.relative_to_baseline.value < high


def test_a_run_with_too_different_preloads_is_refused() -> None:
    masses = mass_changes(run_of(1.0, torque=1.01, **SURE), BASE, MODEL, Assumptions())
    assert masses is not None
    equal = tuple(PossibleCause(name, 0.5, 1.0, 0.0, 1.0, "", True, name) for name in ("load", "torque"))
    near = check_mass(masses, equal, 1.0, Assumptions())
    far = check_mass(masses, equal, 10.0, Assumptions())
    assert near.decision == far.decision == "undecided"
    assert near.change is not None
    assert near.correction == pytest.approx(near.change.value / 2)
    assert near.standard_uncertainty > near.change.value / 4
    assert far.refused
    assert not near.refused
    assert far.correction == 0.0


def test_a_loss_that_an_undetectable_load_imitates_is_suspect() -> None:
    quiet = {"uncertainty": 2e-5}
    base = vague(run_of(name="base", **quiet))
    small = preload(vague(run_of(0.93, **quiet)), calibrated(), base)
    large = preload(vague(run_of(0.3, **quiet)), calibrated(), base)
    assert small.mass is not None
    assert small.mass.decision == "declared"
    assert small.mass.to_json()["undetectable_kg"] > 1
    assert small.verdict == "suspect"
    assert any("has the same effect" in reason for reason in small.reasons)
    assert not any("has the same effect" in reason for reason in large.reasons)


def test_with_a_trusted_torque_the_load_is_corrected() -> None:
    base = run_of(name="base", **UNSURE)
    run = run_of(1.0, true_load=LOAD + 3, **UNSURE)
    decisions: dict[bool | None, Decision] = {}
    for trusted in (True, False):
        found = preload(run, calibrated(), base, assumptions=Assumptions(torque_trusted=trusted)).mass
        assert found is not None
        decisions[trusted] = found.decision
        assert ("is not trusted: the declared load stands" in found.text) == (not trusted)
    assert decisions == {True: "corrected", False: "torque"}


def test_within_its_interval_the_declared_load_stands() -> None:
    found = preload(run_of(0.8, true_load=LOAD + 0.2, **SURE), calibrated(), BASE)
    assert found.mass is not None
    assert found.mass.decision == "declared"
    assert found.mass.change is not None
    assert found.mass.to_json()["correction_kg"] == 0.0


def vague(run):
    """The run with masses that are uncertain by a twentieth."""
    uncertainties = {**run.rigid_body.standard_uncertainty, "equivalent_mass_kg": 40.0}
    return dataclasses.replace(
        run, rigid_body=dataclasses.replace(run.rigid_body, standard_uncertainty=uncertainties)
    )


def test_uncertain_masses_do_not_confirm_a_load() -> None:
    quiet = {"uncertainty": 2e-5}
    base, run = vague(run_of(name="base", **quiet)), vague(run_of(1.0, true_load=LOAD + 6, **quiet))
    found = preload(run, calibrated(), base)
    assert found.mass is not None
    assert found.mass.refused
    assert found.mass.to_json()["refused"] is True
    assert found.verdict == "refused"
    worn = preload(vague(run_of(0.8, **quiet)), calibrated(), base)
    assert worn.mass is not None
    assert worn.mass.decision == "declared"
    assert any("would not be detected" in note for note in worn.notes)


@pytest.mark.parametrize("wrong", [None, -5.0, 0.0, float("nan")])
def test_masses_that_cannot_be_are_unknown(wrong: float | None) -> None:
    run = run_of(0.8)
    bad = dataclasses.replace(run, rigid_body=dataclasses.replace(run.rigid_body, equivalent_mass_kg=wrong))
    assert mass_changes(bad, BASE, MODEL, Assumptions()) is None


def test_less_friction_is_not_mistaken_for_a_lighter_load() -> None:
    assumptions = Assumptions()
    worn, same = (
        mass_changes(run_of(0.5, friction=part, **SURE), BASE, MODEL, assumptions) for part in (0.5, 1.0)
    )
    assert worn is not None
    assert same is not None
    assert worn.log_mass_spread == pytest.approx(
        math.hypot(same.log_mass_spread, assumptions.mass_friction * math.log(2)), rel=1e-3
    )


def test_a_load_taken_off_that_exceeds_the_whole_inertia_is_not_compared() -> None:
    """The declared loads contradict the baseline's inertia."""
    heavy = dataclasses.replace(BASE, mass_kg=400.0)
    assert mass_changes(run_of(0.8, load=0.0, **SURE), heavy, MODEL, Assumptions()) is None
    assert mass_changes(run_of(0.8, load=200.0, **SURE), heavy, MODEL, Assumptions()) is not None


def test_an_infinite_rotor_has_no_ratio_of_frequencies() -> None:
    run = run_of(0.8, true_load=LOAD + 3, **SURE)
    infinite = dataclasses.replace(MODEL, rotor=math.inf)
    masses = mass_changes(run, BASE, infinite, Assumptions())
    assert masses is not None
    assert (masses.log_frequency_ratio, masses.log_frequency_ratio_spread) == (None, None)
    assert masses.log_mass != 0


@pytest.mark.parametrize(
    ("load", "words"), [(0.99, "99 times as probable"), (0.9995, "more than 1000 times")]
)
def test_the_odds_of_a_wrong_load_are_in_words(load: float, words: str) -> None:
    masses = mass_changes(run_of(1.0, true_load=LOAD + 4, **SURE), BASE, MODEL, Assumptions())
    assert masses is not None
    causes = tuple(
        PossibleCause(name, part, 1.0, 0.0, 1.0, "", True, name)
        for name, part in (("load", load), ("torque", 1 - load))
    )
    found = check_mass(masses, causes, 0.1, Assumptions())
    assert found.decision == "corrected"
    assert f"not with a drifted torque constant ({words}" in found.text
