"""The preload of a run: what is put in comes out, with an interval, and what cannot be known is refused."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.health.made_runs import LOAD, MODEL, calibrated, run_of

from ballscrew.base.errors import InputError
from ballscrew.health.assumptions import Assumptions
from ballscrew.health.preload import preload, warmth
from ballscrew.modal.run import Run
from ballscrew.recording.quality.finding import Quality

BASE = run_of(name="base")


@settings(max_examples=15, deadline=None)
@given(st.floats(0.25, 1.6))
def test_the_preload_that_is_put_in_comes_out(ratio: float) -> None:
    found = preload(run_of(ratio), calibrated(), BASE)
    assert found.relative_to_baseline is not None
    assert found.preload_N is not None
    assert found.preload_ratio is not None
    assert found.relative_to_baseline.value == pytest.approx(ratio, rel=1e-6)
    assert found.preload_N.value == pytest.approx(ratio * MODEL.preload, rel=1e-6)
    assert found.preload_ratio.value == pytest.approx(ratio * MODEL.preload / 15_000, rel=1e-6)
    low, high = found.relative_to_baseline.interval
    assert low < ratio < high


@pytest.mark.parametrize("ratio", [0.4, 0.8, 1.2])
def test_without_a_baseline_the_model_takes_its_place(ratio: float) -> None:
    found = preload(run_of(ratio), calibrated())
    assert found.relative_to_baseline is None
    assert found.relative_to_model is not None
    assert found.relative_to_model.value == pytest.approx(ratio, rel=1e-6)
    assert found.to_json()["relative_to_baseline"] is None
    assert "baseline" in found.notes[-1]


def test_errors_that_repeat_cancel_against_a_baseline_only() -> None:
    wrong = {"level": 3e-3, "tilt": 2e-3}
    sure = calibrated(compliance=1e-6, mass=1e-6, slope=1e-6)
    with_baseline = preload(run_of(0.7, **wrong), sure, run_of(name="base", **wrong))
    alone = preload(run_of(0.7, **wrong), sure)
    assert with_baseline.relative_to_baseline is not None
    assert alone.relative_to_model is not None
    assert with_baseline.relative_to_baseline.value == pytest.approx(0.7, abs=0.01)
    assert abs(alone.relative_to_model.value - 0.7) > 0.05


def test_a_wrong_share_scales_the_loss_and_does_not_change_its_sign() -> None:
    wrong = calibrated(dataclasses.replace(MODEL, share=0.25))
    found = preload(run_of(0.6), wrong, BASE).relative_to_baseline
    assert found is not None
    assert 0.6 < found.value < 0.8
    low, high = found.interval
    assert low < 0.6 < high


def test_the_interval_of_a_share_alone_is_that_of_the_formula() -> None:
    quiet = Assumptions(bearing_drift=0, load=0, position=0, share=0, tilt=0, form=0, floor=1e-9)
    found = preload(run_of(0.5, told=1e-9), calibrated(), run_of(name="base", told=1e-9), assumptions=quiet)
    assert found.relative_to_baseline is not None
    u = 0.5 ** (-1 / 3)
    logit = np.log(0.2 / 0.8) + 1.96 * 0.145 * np.array([-1, 1])
    share = 1 / (1 + np.exp(-logit))
    expected = (1 + (u - 1) * 0.2 / share) ** -3
    assert found.relative_to_baseline.interval == pytest.approx(tuple(expected), abs=2e-3)
    left, right = found.relative_to_baseline.interval
    assert 0.5 - left != pytest.approx(right - 0.5, rel=0.02)  # the law is no straight line


def test_a_bearing_that_may_drift_widens_what_is_told_of_an_unchanged_axis() -> None:
    widths = []
    for drift in (0.0, 0.02, 0.10):
        found = preload(run_of(1.0), calibrated(), BASE, assumptions=Assumptions(bearing_drift=drift))
        assert found.relative_to_baseline is not None
        low, high = found.relative_to_baseline.interval
        widths.append(high - low)
    assert widths[0] < widths[1] < widths[2]
    # Of 2 % of the bearing: 3 (bearing's share)/(nut's share) × 2 % on either side, about.
    alone = np.sqrt(widths[1] ** 2 - widths[0] ** 2)
    assert alone == pytest.approx(2 * 3 * 0.37 / 0.2 * 0.02, rel=0.15)


def test_a_softer_bearing_is_named_as_a_possible_cause() -> None:
    drifted = run_of(1.0, softer=lambda x: 0.11 * 0.37 / (1 + 1.4 * (x - 0.225)))
    found = preload(drifted, calibrated(), BASE)
    assert found.relative_to_baseline is not None
    assert found.relative_to_baseline.value < 0.75  # it reads as a loss
    bearing = next(cause for cause in found.causes if cause.name == "bearing")
    assert bearing.possible
    assert bearing.amount == pytest.approx(-0.11, abs=0.01)
    assert any("cannot tell the nut from the bearing" in note for note in found.notes)


def test_random_and_systematic_parts_make_the_whole() -> None:
    found = preload(run_of(0.6), calibrated(), BASE)
    assert found.relative_to_baseline is not None
    assert found.random_ratio is not None
    assert found.systematic_ratio is not None
    whole = found.relative_to_baseline.standard_uncertainty
    assert np.hypot(found.random_ratio, found.systematic_ratio) == pytest.approx(whole, rel=1e-6)
    terms = np.sqrt(sum(term.standard_uncertainty**2 for term in found.terms))
    assert terms == pytest.approx(whole, rel=0.08)


def test_intervals_hold_as_often_as_they_say() -> None:
    rng = np.random.default_rng(7)
    quiet = Assumptions(bearing_drift=0, load=0, position=0, share=0, tilt=0)
    model, held, trials = calibrated(share=1e-4), 0, 60
    for seed in range(trials):
        ratio = float(rng.uniform(0.4, 1.1))
        # Level and tilt are both told as 1e-3: the document's terms are shared as such.
        errors = 1e-3 * rng.standard_normal(4)
        base = run_of(name="base", level=errors[0], tilt=0.7 * errors[1], told=1e-3, seed=seed)
        run = run_of(ratio, level=errors[2], tilt=0.7 * errors[3], told=1e-3, seed=seed + 1000)
        told = preload(run, model, base, assumptions=quiet).relative_to_baseline
        assert told is not None
        low, high = told.interval
        held += low < ratio < high
    assert held >= 0.87 * trials


def test_a_run_that_no_preload_explains_is_suspect_and_the_cause_named() -> None:
    bent = run_of(0.9, softer=lambda x: 0.05 * np.cos(8 * np.pi * x))
    found = preload(bent, calibrated(), BASE)
    assert found.verdict == "suspect"
    assert any("no preload explains all cells" in reason for reason in found.reasons)
    assert found.chi2 is not None
    assert found.degrees is not None
    assert found.chi2 > 3 * found.degrees
    assert preload(run_of(0.9), calibrated(), BASE).verdict == "good"


def test_a_worn_nut_under_load_is_corrected() -> None:
    ratio, term = 0.5, 1e-3
    low = Assumptions().nut_load * term * np.log(1 / ratio)
    run = run_of(ratio, level=-low, nut_load=term)
    found = preload(run, calibrated(), run_of(name="base", nut_load=term)).relative_to_baseline
    ignored = preload(
        run, calibrated(), run_of(name="base", nut_load=term), assumptions=Assumptions(nut_load=0.0)
    ).relative_to_baseline
    assert found is not None
    assert ignored is not None
    assert found.value == pytest.approx(ratio, abs=2e-3)
    assert ignored.value < 0.495


def test_temperature_is_taken_out_where_baselines_taught_it() -> None:
    at = {"temperature_C": 20.0}
    warmed = [
        run_of(np.exp(0.02 * (t - 20)), name=f"day {t}", temperature_C=t, seed=i)
        for i, t in enumerate((15.0, 25.0, 30.0))
    ]
    base = run_of(name="base", **at)
    run = run_of(0.8 * np.exp(0.02 * 10), temperature_C=30.0)
    learned = preload(run, calibrated(), base, more=warmed)
    believed = preload(run, calibrated(), base)
    assert learned.relative_to_baseline is not None
    assert believed.relative_to_baseline is not None
    assert learned.relative_to_baseline.value == pytest.approx(0.8, rel=0.03)
    assert any(text.startswith("temperature") for text in learned.corrections)
    assert believed.relative_to_baseline.value == pytest.approx(0.8 * np.exp(0.2), rel=1e-3)
    low, high = believed.relative_to_baseline.interval
    assert low < 0.8 < high  # the default spread holds it


def test_warmth_is_a_regression_with_what_was_believed_before() -> None:
    known = Assumptions(temperature=0.01)
    slope, spread = warmth([(0.1, 1e-6), (0.2, 1e-6)], [5.0, 10.0], known)
    assert slope == pytest.approx(0.02)
    assert spread < 1e-5
    assert warmth([], [], known) == (0.0, pytest.approx(0.01))


@pytest.mark.parametrize("baseline", [BASE, None])
def test_a_bad_measurement_is_refused(baseline: Run | None) -> None:
    found = preload(run_of(quality=Quality("bad", ("clipped",))), calibrated(), baseline)
    assert found.verdict == "refused"
    assert "clipped" in found.reasons[0]
    assert found.preload_N is None
    document = json.loads(json.dumps(found.to_json(), allow_nan=False))
    assert document["relative_to_baseline"] is None


def refused_cells(run: Run) -> Run:
    cells = tuple(
        dataclasses.replace(c, verdict="refused", frequency_Hz=None, standard_uncertainty_Hz=None)
        for c in run.cells
    )
    return dataclasses.replace(run, cells=cells)


def test_no_good_cell_is_refused() -> None:
    assert "no cell" in preload(refused_cells(run_of()), calibrated(), BASE).reasons[0]
    assert "baseline has no cell" in preload(run_of(), calibrated(), refused_cells(BASE)).reasons[0]


def test_frequencies_above_an_infinitely_stiff_nut_are_refused() -> None:
    stiff = run_of(1.0, level=0.15)
    for baseline in (BASE, None):
        found = preload(stiff, calibrated(), baseline)
        assert found.verdict == "refused"
        assert "infinitely stiff nut" in found.reasons[0]


def test_other_axis_plan_or_load_are_said_plainly() -> None:
    model = calibrated()
    with pytest.raises(InputError, match="must be of one axis"):
        preload(run_of(axis="other"), model, BASE)
    other = dataclasses.replace(BASE.made, inputs={"plan": "q" * 64})
    with pytest.raises(InputError, match="another plan"):
        preload(run_of(), model, dataclasses.replace(BASE, made=other))
    with pytest.raises(InputError, match="about the same load"):
        preload(run_of(), model, run_of(name="base", load=10.0))
    with pytest.raises(InputError, match="tells no load"):
        preload(dataclasses.replace(run_of(), mass_kg=None), model, BASE)


def test_stops_that_the_baseline_lacks_are_left_out() -> None:
    fewer = run_of(name="base", stops=(0.0, 0.225, 0.45))
    found = preload(run_of(0.6), calibrated(), fewer)
    assert found.relative_to_baseline is not None
    assert found.relative_to_baseline.value == pytest.approx(0.6, rel=1e-6)
    assert found.change is not None
    assert set(found.change.position.tolist()) == {0.0, 0.225, 0.45}
    far = run_of(name="base", stops=(0.01, 0.2, 0.4))
    assert preload(run_of(0.6), calibrated(), far).verdict == "refused"


def test_the_same_inputs_give_the_same_document() -> None:
    documents = [json.dumps(preload(run_of(0.6), calibrated(), BASE).to_json()) for _ in range(2)]
    assert documents[0] == documents[1]


@pytest.mark.parametrize("more", [-15.0, 5.0, 15.0])
def test_a_declared_change_of_the_load_is_counted(more: float) -> None:
    found = preload(run_of(0.7, load=LOAD + more), calibrated(), BASE)
    assert found.relative_to_baseline is not None
    assert found.relative_to_baseline.value == pytest.approx(0.7, rel=1e-6)
    assert found.mass is not None
    assert found.mass.decision == "declared"


def test_a_baseline_outside_the_calibration_is_read_by_the_model() -> None:
    found = preload(run_of(0.5), calibrated(runs=()), run_of(0.8, name="base"))
    assert found.relative_to_baseline is not None
    assert found.preload_N is not None
    assert found.relative_to_baseline.value == pytest.approx(0.5 / 0.8, rel=1e-3)
    assert found.preload_N.value == pytest.approx(300.0, rel=1e-3)


@pytest.mark.parametrize("wrong", [{"load": -1.0}, {"floor": 0.0}, {"repeats": 1.5}, {"share": float("nan")}])
def test_assumptions_that_cannot_be(wrong: dict[str, float]) -> None:
    with pytest.raises(InputError, match=next(iter(wrong))):
        Assumptions(**wrong)
