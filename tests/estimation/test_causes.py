"""Each cause is found by its own signature, and none where there is none."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from tests.estimation.made_runs import BEARING, LOAD, MODEL, calibrated, run_of

from ballscrew.base.errors import InputError
from ballscrew.base.quantity import Quantity
from ballscrew.calibration.assumptions import Assumptions, Priors
from ballscrew.calibration.frequency_table import frequency_table
from ballscrew.estimation.causes import PossibleCause, describe_cause, gather_evidence
from ballscrew.estimation.compliance import change_since
from ballscrew.estimation.mass_check import mass_changes
from ballscrew.estimation.preload import preload
from ballscrew.estimation.verdict import estimate_notes

BASE = run_of(name="base", uncertainty=1e-4)
MODEL_ = calibrated()


def probabilities(run, base=BASE) -> dict[str, float]:
    found = preload(run, MODEL_, base).causes
    assert sum(cause.probability for cause in found) == pytest.approx(1.0)
    assert [c.probability for c in found] == sorted((c.probability for c in found), reverse=True)
    return {cause.name: cause.probability for cause in found}


def test_a_worn_nut_is_a_worn_nut() -> None:
    ranked = probabilities(run_of(0.6, uncertainty=1e-4))
    assert max(ranked, key=lambda name: ranked[name]) == "nut or bearing"
    assert ranked["nut or bearing"] > 0.5


def test_a_load_and_a_torque_constant() -> None:
    heavier = probabilities(run_of(1.0, true_load=LOAD + 4, uncertainty=1e-4))
    assert max(heavier, key=lambda name: heavier[name]) == "load"
    drifted = probabilities(run_of(1.0, torque=1.012, uncertainty=1e-4))
    assert max(drifted, key=lambda name: drifted[name]) == "torque"


def test_a_zero_that_has_moved_looks_like_the_nut_and_is_named() -> None:
    found = preload(run_of(1.0, moved=3e-3, uncertainty=1e-4), MODEL_, BASE)
    position = next(cause for cause in found.causes if cause.name == "position")
    assert position.possible
    assert position.amount == pytest.approx(3e-3, rel=0.02)
    assert position.unit == "m"
    assert any("a zero that has moved by +3.0 mm" in note for note in found.notes)


def test_the_stiffness_is_listed_with_its_size() -> None:
    found = preload(run_of(0.5, uncertainty=1e-4), MODEL_, BASE)
    nut = next(cause for cause in found.causes if cause.name == "nut or bearing")
    assert nut.amount == pytest.approx(0.5 ** (-1 / 3) - 1, rel=0.02)
    assert nut.to_json()["amount"]["value"] == nut.amount
    assert "50" in nut.text or "49" in nut.text


def test_an_unchanged_axis_has_no_other_possible_cause() -> None:
    found = preload(run_of(1.0, uncertainty=1e-4), MODEL_, BASE).causes
    assert [cause.name for cause in found if cause.possible and cause.name != "nut or bearing"] == []


def test_warmth_is_listed_only_where_a_temperature_differs() -> None:
    warm = preload(run_of(1.1, temperature_C=30.0), MODEL_, run_of(name="base", temperature_C=20.0)).causes
    cold = preload(run_of(1.1), MODEL_, run_of(name="base", temperature_C=20.0)).causes
    assert "temperature" in {cause.name for cause in warm}
    assert "temperature" not in {cause.name for cause in cold}


def test_every_cause_has_words_for_both_signs() -> None:
    for name in (
        "nut",
        "bearing",
        "both",
        "nut or bearing",
        "load",
        "torque",
        "position",
        "temperature",
        "local",
    ):
        assert describe_cause(name, 0.02)
        assert describe_cause(name, -0.02)
    assert describe_cause("load", 2.0) == "a load 2 kg heavier than declared"
    assert describe_cause("bearing", -0.1) == "the support bearing, 10.0 % softer"


def test_without_the_masses_there_is_no_torque_to_judge() -> None:
    run = run_of(0.8)
    bare = dataclasses.replace(run, rigid_body=dataclasses.replace(run.rigid_body, equivalent_mass_kg=None))
    assert mass_changes(bare, BASE, MODEL, Assumptions()) is None
    found = preload(bare, MODEL_, BASE)
    assert "torque" not in {cause.name for cause in found.causes}
    assert found.mass is not None
    assert found.mass.decision == "unknown"


def test_local_wear_is_local() -> None:
    run = run_of(lambda x: np.where(np.abs(x - 0.225) < 0.05, 0.7, 1.0), uncertainty=1e-4)
    ranked = probabilities(run)
    assert max(ranked, key=lambda name: ranked[name]) == "local"


def bowed(waves: float):
    return run_of(0.9, softer=lambda x: 0.05 * np.cos(waves * np.pi * x))


@pytest.mark.parametrize("waves", [4, 8, 12])
def test_a_cause_that_does_not_explain_the_cells_is_not_possible(waves: float) -> None:
    found = preload(bowed(waves), MODEL_, BASE)
    for cause in found.causes:
        assert cause.possible <= (cause.fit >= Assumptions().false_alarm)
        if cause.name != "local":
            assert not cause.possible  # the nut neither: it was possible since nothing is worse than itself
    local = next(cause for cause in found.causes if cause.name == "local")
    named = any("the likeliest cause is a change at some stops" in reason for reason in found.reasons)
    assert named == local.possible
    assert not any("wear at" in reason for reason in found.reasons)  # a bow may as well be a gain
    assert any("no known cause does either" in reason for reason in found.reasons) != named


def test_causes_that_explain_the_cells_stay_possible() -> None:
    found = preload(run_of(0.6, uncertainty=1e-4), MODEL_, BASE)
    assert {c.name for c in found.causes if c.possible} == {"nut or bearing"}
    assert next(c for c in found.causes if c.possible).fit > 0.5
    dent = preload(run_of(lambda x: np.where(np.abs(x - 0.225) < 0.05, 0.7, 1.0)), MODEL_, BASE)
    assert {c.name for c in dent.causes if c.possible} == {"local"}


@pytest.mark.parametrize(("significance", "possible"), [(1.9, False), (2.3, True)])
def test_a_gradient_is_possible_from_twice_its_uncertainty_on(significance: float, possible: bool) -> None:
    """At 1.9 its evidence exceeds that of the nut already; so it does by chance in a tenth of all runs."""

    def gradient(slope: float) -> PossibleCause:
        run = run_of(lambda x: np.exp(slope * (x - 0.225)), uncertainty=1e-2)
        (cause,) = (c for c in preload(run, MODEL_, BASE).causes if c.name == "gradient")
        return cause

    trial = gradient(0.1)
    found = gradient(0.1 * significance * trial.standard_uncertainty / abs(trial.amount))
    assert abs(found.amount) / found.standard_uncertainty == pytest.approx(significance, rel=0.05)
    assert found.possible == possible


def test_the_priors_are_assumptions() -> None:
    usual = Assumptions(bearing_drift=0.2)
    sure = Assumptions(bearing_drift=0.2, priors=Priors(bearing_chance=1e-6))
    run = run_of(0.6, uncertainty=1e-4)
    usual, less = (
        next(c for c in preload(run, MODEL_, BASE, assumptions=assumptions).causes if c.name == "bearing")
        for assumptions in (usual, sure)
    )
    assert less.probability < 1e-3 * usual.probability
    assert preload(run, MODEL_, BASE).to_json()["made"]["settings"]["priors"]["odds"] == 30.0
    with pytest.raises(InputError, match="odds"):
        Priors(odds=0.0)


def softening(ratio: float) -> Quantity:
    """Mass over preload, as two acceleration levels determine it."""
    value = (MODEL.mass + LOAD) / (MODEL.preload * ratio)
    return Quantity(value, 0.1 * value, "kg/N")


@pytest.mark.parametrize(
    ("ratio", "bearing", "cause"), [(0.7, 1.0, "nut"), (1.0, 0.93, "bearing"), (0.7, 0.9, "both")]
)
def test_the_softening_tells_nut_bearing_and_both(ratio: float, bearing: float, cause: str) -> None:
    run = run_of(
        ratio,
        uncertainty=1e-4,
        softer=lambda x: (1 / bearing - 1) * BEARING / (1 + MODEL.slope * (x - MODEL.centre)),
        mass_over_preload_kg_per_N=softening(ratio),
    )
    base = run_of(name="base", uncertainty=1e-4, mass_over_preload_kg_per_N=softening(1.0))
    found = preload(run, MODEL_, base)
    share = found.nut_or_bearing
    assert share is not None
    assert share.identifiable
    assert found.causes[0].name == cause
    assert getattr(share, cause) > 0.8
    assert share.nut + share.bearing + share.both == pytest.approx(1.0)
    assert "softening" in share.text


def test_without_an_anchor_the_share_of_nut_and_bearing_is_not_identifiable() -> None:
    worn = preload(run_of(0.6, uncertainty=1e-4), MODEL_, BASE).nut_or_bearing
    assert worn is not None
    assert (worn.identifiable, worn.nut, worn.bearing, worn.both) == (False, None, None, None)
    assert "not identifiable" in worn.text
    same = preload(run_of(1.0, uncertainty=1e-4), MODEL_, BASE).nut_or_bearing
    assert same is not None
    assert "not changed significantly" in same.text


def test_an_undeclared_load_is_as_large_as_a_part_of_the_moving_mass() -> None:
    base, run = frequency_table(BASE), frequency_table(run_of(0.8))
    change = change_since(run, base, MODEL, BEARING)
    masses = mass_changes(run_of(0.8), BASE, MODEL, Assumptions())
    for known in (None, masses):
        evidence = gather_evidence(change, known, Assumptions(wrong_load=0.02))
        assert evidence.sizes["load"] == pytest.approx(0.02 * (MODEL.mass + LOAD))


@pytest.mark.parametrize("hidden", [-8.0, 8.0])
@pytest.mark.parametrize(
    ("ratio", "bearing", "cause"), [(0.7, 1.0, "nut"), (1.0, 0.93, "bearing"), (0.7, 0.9, "both")]
)
def test_nut_and_bearing_are_compared_without_the_effect_of_a_wrong_load(
    ratio: float, bearing: float, cause: str, hidden: float
) -> None:
    value = softening(ratio).value * (1 + hidden / (MODEL.mass + LOAD))
    run = run_of(
        ratio,
        uncertainty=1e-4,
        true_load=LOAD + hidden,
        softer=lambda x: (1 / bearing - 1) * BEARING / (1 + MODEL.slope * (x - MODEL.centre)),
        mass_over_preload_kg_per_N=Quantity(value, 0.1 * value, "kg/N"),
    )
    base = run_of(name="base", uncertainty=1e-4, mass_over_preload_kg_per_N=softening(1.0))
    found = preload(run, MODEL_, base)
    assert found.mass is not None
    assert found.mass.decision == "corrected"
    assert found.causes[0].name == "load"
    assert found.nut_or_bearing is not None
    probability = {name: getattr(found.nut_or_bearing, name) for name in ("nut", "bearing", "both")}
    assert probability[cause] > 0.8
    assert sum(probability.values()) == pytest.approx(1.0)
    assert found.relative_to_baseline is not None
    assert found.relative_to_baseline.value == pytest.approx(ratio, rel=0.02)
    assert not any("than declared" in note for note in found.notes)


@pytest.mark.parametrize(("probability", "printed"), [(0.004, False), (0.006, True)])
def test_a_possible_cause_is_noted_unless_its_probability_is_printed_as_zero(
    probability: float, printed: bool
) -> None:
    text = "a screw that is warmer towards its far end"
    cause = PossibleCause("gradient", probability, 1.0, 2.0, 0.5, "K", True, text)
    found = dataclasses.replace(preload(run_of(0.8), MODEL_, BASE), causes=(cause,))
    notes = estimate_notes(found, run_of(0.8), BASE, MODEL_)
    assert any(text in note for note in notes) is printed
