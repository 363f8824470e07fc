"""A wrong load is corrected or refused, a drifted torque constant is not taken for one."""

from __future__ import annotations

import dataclasses

import pytest
from tests.health.made_runs import LOAD, MODEL, calibrated, run_of

from ballscrew.health.assumptions import Assumptions
from ballscrew.health.mass_check import Decision, masses_of
from ballscrew.health.preload import preload

SURE = {"told": 1e-4}
BASE = run_of(name="base", **SURE)
UNSURE = {"told": 4e-3}


def test_changes_of_the_logarithms() -> None:
    run = run_of(0.8, true_load=LOAD + 3, **SURE)
    masses = masses_of(run, BASE, MODEL, Assumptions())
    assert masses is not None
    whole = MODEL.mass + LOAD + MODEL.rotor
    assert masses.inertia == pytest.approx(3 / whole, rel=0.01)
    assert masses.by_load == pytest.approx(1 / whole)
    assert masses.parted == pytest.approx(3 * masses.parted_by_load, rel=0.02)
    assert masses.friction[0][0] == pytest.approx(0.0)


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


@pytest.mark.parametrize("scale", [0.985, 1.015])
def test_a_drifted_torque_constant_changes_no_preload(scale: float) -> None:
    found = preload(run_of(0.8, torque=scale, **SURE), calibrated(), BASE)
    assert found.mass is not None
    assert found.mass.decision == "torque"
    assert "moves no frequency" in found.mass.text
    assert found.relative_to_baseline is not None
    assert found.relative_to_baseline.value == pytest.approx(0.8, abs=0.005)


def test_what_nobody_can_tell_is_refused() -> None:
    base = run_of(name="base", **UNSURE)
    found = preload(run_of(1.0, torque=1.01, **UNSURE), calibrated(), base)
    assert found.mass is not None
    assert found.mass.decision == "undecided"
    if found.verdict == "refused":
        assert found.preload_N is None
        assert "cannot be told" in found.reasons[0]
    else:
        assert any("in it" in reason for reason in found.reasons)


def test_who_trusts_the_torque_has_the_load_corrected() -> None:
    base = run_of(name="base", **UNSURE)
    run = run_of(1.0, true_load=LOAD + 3, **UNSURE)
    decisions: dict[bool | None, Decision] = {}
    for trusted in (True, False):
        found = preload(run, calibrated(), base, assumptions=Assumptions(torque_trusted=trusted)).mass
        assert found is not None
        decisions[trusted] = found.decision
    assert decisions == {True: "corrected", False: "torque"}


def test_within_its_interval_the_declared_load_stands() -> None:
    found = preload(run_of(0.8, true_load=LOAD + 0.2, **SURE), calibrated(), BASE)
    assert found.mass is not None
    assert found.mass.decision == "declared"
    assert found.mass.change is not None
    assert found.mass.to_json()["correction_kg"] == 0.0


def vague(run):
    """The same with masses that are told to a twentieth."""
    told = {**run.rigid_body.standard_uncertainty, "equivalent_mass_kg": 40.0}
    return dataclasses.replace(run, rigid_body=dataclasses.replace(run.rigid_body, standard_uncertainty=told))


def test_masses_too_vague_to_see_a_load_do_not_vouch_for_it() -> None:
    quiet = {"told": 2e-5}
    base, run = vague(run_of(name="base", **quiet)), vague(run_of(1.0, true_load=LOAD + 6, **quiet))
    found = preload(run, calibrated(), base)
    assert found.mass is not None
    assert found.mass.decision == "undecided"
    assert found.verdict == "refused"
    worn = preload(vague(run_of(0.8, **quiet)), calibrated(), base)
    assert worn.mass is not None
    assert worn.mass.decision == "declared"
    assert any("would not be seen" in note for note in worn.notes)


@pytest.mark.parametrize("wrong", [None, -5.0, 0.0, float("nan")])
def test_masses_that_cannot_be_are_unknown(wrong: float | None) -> None:
    run = run_of(0.8)
    bad = dataclasses.replace(run, rigid_body=dataclasses.replace(run.rigid_body, equivalent_mass_kg=wrong))
    assert masses_of(bad, BASE, MODEL, Assumptions()) is None
