"""The preload of a run: the true value is estimated, with an interval, or the run is refused."""

from __future__ import annotations

import dataclasses
import json
import math
import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.estimation.made_runs import LOAD, MODEL, calibrated, run_of
from tests.monitoring.histories import unloading

import ballscrew.estimation.preload as preload_module
from ballscrew.axis.compliance import equivalent_preload_ratio
from ballscrew.axis.hertz import RELEASE
from ballscrew.base.errors import InputError
from ballscrew.base.provenance import Made
from ballscrew.base.quantity import Quantity
from ballscrew.calibration.assumptions import Assumptions
from ballscrew.calibration.calibrated_axis import Doubt
from ballscrew.calibration.frequency_table import common_doubts
from ballscrew.calibration.modelfile import read_model, write_model
from ballscrew.estimation.nut import nut_evidence
from ballscrew.estimation.preload import preload
from ballscrew.estimation.samples import load_significance, share_uncertainty
from ballscrew.estimation.verdict import doubts_of_cells, sheet_notes
from ballscrew.modal.reason import Reason, ReasonKind
from ballscrew.modal.run import FrameMode, Run
from ballscrew.recording.quality.clock import Clock
from ballscrew.recording.quality.finding import Quality
from ballscrew.testbed.example import AXIS

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


def doubted(run: Run, kind: ReasonKind) -> Run:
    """The run, all its cells suspect for one reason."""
    cells = [cell.with_reasons(Reason(kind, f"a {kind}")) for cell in run.cells]
    return dataclasses.replace(run, cells=tuple(cells))


@pytest.mark.parametrize(
    ("kind", "cancels", "by_chart"),
    [("unexcited", True, True), ("few-repetitions", False, True), ("frame", False, False)],
)
def test_a_doubt_of_run_and_baseline_counts_once_unless_a_change_cancels_it(
    kind: ReasonKind, cancels: bool, by_chart: bool
) -> None:
    run, baseline = run_of(0.7), run_of(name="base")
    of_run, of_baseline = doubted(run, kind), doubted(baseline, kind)
    count = f"{len(run.cells)} of {len(run.cells)}"
    assert doubts_of_cells(of_run, baseline) == [f"{count} cells are suspect: a {kind}"]
    assert doubts_of_cells(run, of_baseline) == [f"{count} cells of the baseline are suspect: a {kind}"]
    assert len(doubts_of_cells(of_run, of_baseline)) == (not cancels)
    assert len(doubts_of_cells(of_run, of_baseline, in_history=True)) == (not by_chart)
    expected = "good" if cancels else "suspect"
    assert preload(of_run, calibrated(), of_baseline).verdict == expected


@pytest.mark.parametrize(
    ("kinds", "common"),
    [
        (["frame", None], {"frame"}),
        (["frame", None, None], set()),
        (["frame", "tone", "tone", None, None], {"frame", "tone"}),
        (["frame", "uncertain", None], set()),
    ],
)
def test_a_run_is_doubted_if_half_of_its_cells_are(kinds: list[ReasonKind | None], common: set[str]) -> None:
    run = run_of(0.7)
    whole = len(run.cells) // len(kinds) * len(kinds)
    cells = [
        cell if kind is None else cell.with_reasons(Reason(kind, "why"))
        for cell, kind in zip(run.cells[:whole], kinds * whole, strict=False)
    ]
    assert common_doubts(dataclasses.replace(run, cells=tuple(cells))).keys() == common


def test_a_nut_that_the_test_unloads_has_an_upper_limit_alone() -> None:
    def loaded(run: Run, load: float) -> Run:
        cells = tuple(dataclasses.replace(cell, nut_load_over_preload=load) for cell in run.cells)
        return dataclasses.replace(run, cells=cells)

    run, baseline = doubted(run_of(0.2), "unloaded"), loaded(run_of(name="base"), 1.0)
    found = preload(run, calibrated(), baseline)
    least = 1.0 / RELEASE
    nut = found.relative_to_baseline
    assert nut is not None
    assert nut.interval[0] == 0
    assert least < nut.interval[1] < 1.3 * least
    assert (found.nut_verdict, found.preload_N, found.relative_to_model) == ("suspect", None, None)
    assert f"below {100 * nut.interval[1]:.0f} % of the baseline" in found.nut_reasons[-1]
    assert found.stiffness_relative_to_baseline is not None
    silent = preload(run, calibrated(), run_of(name="base")).relative_to_baseline
    assert silent is not None
    assert silent.interval[0] > 0
    (refused,) = unloading(4.0, [run_of(0.2)], refused=True)
    without_frequency = preload(refused, calibrated(), baseline)
    assert (without_frequency.verdict, without_frequency.nut_verdict) == ("refused", "suspect")
    assert without_frequency.relative_to_baseline is not None
    assert without_frequency.relative_to_baseline.interval == nut.interval
    bad = dataclasses.replace(baseline, quality=Quality("bad", ()))
    assert preload(refused, calibrated(), bad).relative_to_baseline is None


def test_a_frame_mode_in_one_of_two_runs_makes_the_preload_suspect() -> None:
    frame = FrameMode(180.0, 0.2, 0.05, 8.0, 0.3, True)
    with_frame = run_of(0.7, frame_mode=frame)
    found = preload(with_frame, calibrated(), BASE)
    assert found.verdict == "suspect"
    assert "in the run and not in the baseline" in " ".join(found.reasons)
    both = preload(with_frame, calibrated(), run_of(name="base", frame_mode=frame))
    assert both.verdict == "good"


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
    quiet = Assumptions(
        bearing_drift=0, load=0, position=0, share=0, tilt=0, form=0, floor=1e-9, temperature_unknown=0
    )
    found = preload(
        run_of(0.5, uncertainty=1e-9), calibrated(), run_of(name="base", uncertainty=1e-9), assumptions=quiet
    )
    assert found.relative_to_baseline is not None
    u = 0.5 ** (-1 / 3)
    logit = np.log(0.2 / 0.8) + 1.96 * 0.145 * np.array([-1, 1])
    share = 1 / (1 + np.exp(-logit))
    expected = (1 + (u - 1) * 0.2 / share) ** -3
    assert found.relative_to_baseline.interval == pytest.approx(tuple(expected), abs=2e-3)
    low, high = found.relative_to_baseline.interval
    assert 0.5 - low != pytest.approx(high - 0.5, rel=0.02)  # the law is no straight line


def test_a_bearing_that_may_drift_widens_the_interval_of_an_unchanged_axis() -> None:
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


def softer_bearing(x):
    """10 % less rigidity: a ninth more of its compliance."""
    return (1 / 0.9 - 1) * 0.37 / (1 + 1.4 * (x - 0.225))


def test_a_softer_bearing_changes_the_stiffness_and_leaves_the_nut_undecided() -> None:
    found = preload(run_of(1.0, softer=softer_bearing), calibrated(), BASE)
    stiffness, nut = found.stiffness_relative_to_baseline, found.relative_to_baseline
    assert stiffness is not None
    assert nut is not None
    # The nut's share is 0.2 and the bearing's 0.37: a ninth more of it is 0.206 of the nut's compliance.
    true = float(equivalent_preload_ratio(0.37 / 9, 0.2))
    assert stiffness.value == pytest.approx(true, abs=0.01)
    assert stiffness.interval[0] < true < stiffness.interval[1] < 1
    assert found.verdict == "good"
    assert nut.interval[0] < stiffness.interval[0]
    assert nut.interval[1] > stiffness.interval[1] + 0.1
    assert found.nut_verdict == "suspect"
    assert "not identifiable" in found.nut_reasons[0]
    assert "17 % less preload of the nut" in found.nut_reasons[0]
    document = found.to_json()
    assert document["verdict"] == "good"
    assert document["nut_verdict"] == "suspect"


def test_a_bearing_within_its_prior_leaves_the_nut_within_its_interval() -> None:
    """A worn and a sound nut beside a bearing that lost or gained a tenth of its own preload."""
    for part in (0.9 ** (1 / 3), 1.1 ** (1 / 3)):
        for ratio in (1.0, 0.6):
            run = run_of(ratio, softer=lambda x, part=part: (1 / part - 1) * 0.37 / (1 + 1.4 * (x - 0.225)))
            found = preload(run, calibrated(share=1e-4), BASE).relative_to_baseline
            assert found is not None
            assert found.interval[0] < ratio < found.interval[1]


def test_a_statement_on_the_bearing_makes_the_nut_as_good_as_the_stiffness() -> None:
    found = preload(run_of(0.6), calibrated(), BASE, assumptions=Assumptions(bearing_drift=0.01))
    stiffness, nut = found.stiffness_relative_to_baseline, found.relative_to_baseline
    assert stiffness is not None
    assert nut is not None
    assert (found.nut_verdict, found.nut_reasons) == ("good", ())
    assert nut.standard_uncertainty < 1.15 * stiffness.standard_uncertainty
    rigid = preload(run_of(0.6), calibrated(), BASE, assumptions=Assumptions(bearing_drift=0.0))
    assert rigid.relative_to_baseline is not None
    assert rigid.stiffness_relative_to_baseline is not None
    assert rigid.relative_to_baseline.interval == pytest.approx(rigid.stiffness_relative_to_baseline.interval)


def softening(ratio: float, mass: float = 132.0) -> Quantity:
    """Mass over preload from two acceleration levels."""
    value = mass / (600.0 * ratio)
    return Quantity(value, 0.1 * value, "kg/N")


def test_two_acceleration_levels_separate_the_nut_from_the_bearing() -> None:
    base = run_of(name="base", mass_over_preload_kg_per_N=softening(1.0))
    for ratio, softer in ((1.0, softer_bearing), (0.6, None), (0.6, softer_bearing)):
        run = run_of(ratio, softer=softer, mass_over_preload_kg_per_N=softening(ratio))
        found = preload(run, calibrated(), base)
        nut = found.relative_to_baseline
        assert nut is not None
        assert nut.value == pytest.approx(ratio, rel=0.03)
        assert nut.interval[0] < ratio < nut.interval[1]
        assert nut.standard_uncertainty < 0.075 * ratio
        assert found.nut_verdict == "good"


def test_the_noise_of_two_softenings_does_not_cancel_as_their_law_does() -> None:
    def uncertainty(own: float, runs: int = 1) -> float:
        value = softening(1.0).value
        run = run_of(0.6, mass_over_preload_kg_per_N=Quantity(value, own * value, "kg/N"))
        found = nut_evidence(run, [run] * runs, calibrated(), Assumptions(), 20.0)
        assert found.log_ratio_spread is not None
        return found.log_ratio_spread

    law, noisy = uncertainty(0.1), uncertainty(0.2)
    assert law == pytest.approx(0.1 * math.sqrt(0.2 * 2))
    assert noisy == pytest.approx(math.sqrt(law**2 + 2 * (0.2**2 - 0.1**2)))
    assert uncertainty(0.2, 4) < 0.85 * noisy  # noise of the baseline is averaged


def test_a_softening_that_is_less_certain_than_the_bearing_separates_nothing() -> None:
    vague = Quantity(0.22, 0.2, "kg/N")
    base = run_of(name="base", mass_over_preload_kg_per_N=vague)
    found = preload(run_of(0.6, mass_over_preload_kg_per_N=vague), calibrated(), base)
    plain = preload(run_of(0.6), calibrated(), BASE)
    assert found.relative_to_baseline == plain.relative_to_baseline
    assert found.nut_verdict == "suspect"


def test_the_nut_is_as_good_as_the_stiffness_where_nothing_has_changed() -> None:
    for ratio, verdict in ((1.0, "good"), (0.98, "good"), (0.6, "suspect")):
        assert preload(run_of(ratio), calibrated(), BASE).nut_verdict == verdict


def test_random_and_systematic_parts_make_the_whole() -> None:
    found = preload(run_of(0.6), calibrated(), BASE)
    assert found.stiffness_relative_to_baseline is not None
    assert found.random_ratio is not None
    assert found.systematic_ratio is not None
    whole = found.stiffness_relative_to_baseline.standard_uncertainty
    assert np.hypot(found.random_ratio, found.systematic_ratio) == pytest.approx(whole, rel=1e-6)
    terms = np.sqrt(sum(term.standard_uncertainty**2 for term in found.terms))
    assert terms == pytest.approx(whole, rel=0.08)


@pytest.mark.slow
def test_intervals_contain_the_true_ratio_as_often_as_stated_and_are_no_wider() -> None:
    rng = np.random.default_rng(7)
    quiet = Assumptions(bearing_drift=0, load=0, position=0, share=0, tilt=0, temperature_unknown=0)
    model, contained, deviations = calibrated(share=1e-4), 0, []
    for seed in range(60):
        ratio = float(rng.uniform(0.4, 1.1))
        # Level and tilt are both stated as 1e-3: the document's terms are shared as such.
        errors = 1e-3 * rng.standard_normal(4)
        base = run_of(name="base", level=errors[0], tilt=0.7 * errors[1], uncertainty=1e-3, seed=seed)
        run = run_of(ratio, level=errors[2], tilt=0.7 * errors[3], uncertainty=1e-3, seed=seed + 1000)
        estimate = preload(run, model, base, assumptions=quiet).relative_to_baseline
        assert estimate is not None
        low, high = estimate.interval
        contained += low < ratio < high
        deviations.append((estimate.value - ratio) / estimate.standard_uncertainty)
    assert contained >= 0.87 * 60
    assert 0.7 < np.sqrt(np.mean(np.square(deviations))) < 1.3


def test_a_run_that_no_preload_explains_is_suspect_and_the_cause_named() -> None:
    bent = run_of(0.9, softer=lambda x: 0.05 * np.cos(8 * np.pi * x))
    found = preload(bent, calibrated(), BASE)
    assert found.verdict == "suspect"
    assert any("no preload explains all cells" in reason for reason in found.reasons)
    assert found.chi2 is not None
    assert found.degrees is not None
    assert found.chi2 > 3 * found.degrees
    assert preload(run_of(0.9), calibrated(), BASE).verdict == "good"


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


def test_a_run_without_frequencies_is_refused_before_its_baseline_is_read() -> None:
    cells = (dataclasses.replace(BASE.cells[0], frequency_Hz=-1.0), *BASE.cells[1:])
    impossible = dataclasses.replace(BASE, cells=cells)
    found = preload(refused_cells(run_of()), calibrated(), impossible)
    assert found.reasons == ("no cell of the run has a frequency",)
    silent = refused_cells(run_of())
    named = dataclasses.replace(silent, cells=(dataclasses.replace(silent.cells[0], reasons=("noise",)),))
    assert preload(named, calibrated()).reasons == ("no cell of the run has a frequency: noise",)
    with pytest.raises(InputError, match="frequency_Hz"):
        preload(run_of(), calibrated(), impossible)


def test_no_good_cell_is_refused() -> None:
    assert "no cell" in preload(refused_cells(run_of()), calibrated(), BASE).reasons[0]
    assert "baseline has no cell" in preload(run_of(), calibrated(), refused_cells(BASE)).reasons[0]
    bad = dataclasses.replace(BASE, quality=Quality("bad", ("the encoder is still",)))
    assert preload(run_of(), calibrated(), bad).reasons[0] == "the measurement of the baseline is bad"


def test_frequencies_above_an_infinitely_stiff_nut_are_refused() -> None:
    stiff = run_of(1.0, level=0.15)
    for baseline in (BASE, None):
        found = preload(stiff, calibrated(), baseline)
        assert found.verdict == "refused"
        assert "infinitely stiff nut" in found.reasons[0]


def test_another_axis_plan_or_load_is_refused() -> None:
    model = calibrated()
    with pytest.raises(InputError, match="must be of one axis"):
        preload(run_of(axis="other"), model, BASE)
    other = dataclasses.replace(BASE.made, inputs={"plan": "q" * 64})
    with pytest.raises(InputError, match="another plan"):
        preload(run_of(), model, dataclasses.replace(BASE, made=other))
    with pytest.raises(InputError, match="about the same load"):
        preload(run_of(), model, run_of(name="base", load=10.0))
    with pytest.raises(InputError, match="has no load"):
        preload(dataclasses.replace(run_of(), mass_kg=None), model, BASE)


def test_a_cell_that_is_not_on_the_screw_is_refused() -> None:
    model = dataclasses.replace(calibrated(), made=Made({"sheet": AXIS.to_settings()}))
    far = run_of(name="far", stops=(0.0, 0.225, 0.780000004))
    sentence = "run far: the stop is 0.780000004 m; it must be on the screw, which ends at -0.12 and 0.78 m"
    for pair in ((far, BASE), (run_of(0.6), far)):
        with pytest.raises(InputError, match=re.escape(sentence)):
            preload(pair[0], model, pair[1])
    with pytest.raises(InputError, match=re.escape(sentence)):
        preload(run_of(0.6), model, BASE, more=[far])


def test_stops_that_the_baseline_lacks_are_omitted() -> None:
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


def test_runs_and_model_may_be_files(tmp_path: Path) -> None:
    run, baseline, model = tmp_path / "run.json", tmp_path / "baseline.json", tmp_path / "model.json"
    run_of(0.6).write(run)
    BASE.write(baseline)
    write_model(calibrated(), model)
    of_files = preload(run, str(model), baseline, more=[baseline]).stiffness_relative_to_baseline
    read = preload(Run.read(run), read_model(model), Run.read(baseline), more=[Run.read(baseline)])
    assert of_files == read.stiffness_relative_to_baseline


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


def test_newtons_do_not_count_the_noise_of_a_baseline_that_cancels() -> None:
    sure = calibrated(compliance=1e-5, mass=1e-5, slope=1e-5, rotor=1e-5, share=1e-4, preload=1e-4, runs=())
    assumptions = Assumptions(bearing_drift=0, temperature_unknown=0)
    run, base = run_of(0.8, uncertainty=2e-3), run_of(name="base", uncertainty=2e-3)
    alone = preload(run, sure, assumptions=assumptions).preload_N
    beside = preload(run, sure, base, assumptions=assumptions).preload_N
    assert alone is not None
    assert beside is not None
    assert beside.interval == pytest.approx(alone.interval, rel=0.01)
    # The user's assumptions count for newtons as well.
    wide = preload(run, sure, base, assumptions=Assumptions(bearing_drift=0.05)).preload_N
    assert wide is not None
    assert wide.standard_uncertainty > 1.5 * beside.standard_uncertainty


@pytest.mark.slow
def test_newtons_with_a_baseline_outside_the_calibration_err_as_stated() -> None:
    sure = calibrated(compliance=1e-5, mass=1e-5, slope=1e-5, rotor=1e-5, share=1e-4, preload=1e-4, runs=())
    assumptions = Assumptions(bearing_drift=0, temperature_unknown=0, tilt=0, form=0)
    rng, deviations = np.random.default_rng(0), []
    for _ in range(50):
        z = 2e-3 * rng.standard_normal(4)
        run = run_of(0.8, uncertainty=2e-3, level=z[0], tilt=0.7 * z[1])
        found = preload(
            run,
            sure,
            run_of(name="base", uncertainty=2e-3, level=z[2], tilt=0.7 * z[3]),
            assumptions=assumptions,
        )
        assert found.preload_N is not None
        deviations.append((found.preload_N.value - 480) / found.preload_N.standard_uncertainty)
    assert 0.7 < np.sqrt(np.mean(np.square(deviations))) < 1.3


def test_a_ratio_is_reported_where_only_newtons_have_no_end() -> None:
    vague = calibrated(compliance=0.2, slope=0.5, runs=())
    found = preload(run_of(0.8), vague, BASE)
    assert found.relative_to_baseline is not None
    assert found.preload_N is None
    assert found.random_N is None
    assert found.verdict != "refused"
    assert any("no preload in newtons" in note for note in found.notes)
    assert json.loads(json.dumps(found.to_json(), allow_nan=False))["preload_N"] is None


def test_another_load_counts_what_the_models_masses_err_by() -> None:
    vague = calibrated(mass=0.05)
    heavier = run_of(0.8, load=LOAD + 30)
    same = preload(run_of(0.8), vague, BASE).stiffness_relative_to_baseline
    other = preload(heavier, vague, BASE).stiffness_relative_to_baseline
    sure = preload(heavier, calibrated(mass=1e-6, rotor=1e-6), BASE).stiffness_relative_to_baseline
    assert same is not None
    assert other is not None
    assert sure is not None
    assert other.standard_uncertainty > 1.02 * max(same.standard_uncertainty, sure.standard_uncertainty)


def test_a_baseline_above_an_infinitely_stiff_nut_is_refused() -> None:
    estimate = preload(run_of(0.8), calibrated(), run_of(name="another", level=0.15))
    assert estimate.verdict == "refused"
    assert "infinitely stiff" in estimate.reasons[0]


def test_a_doubtful_calibration_makes_every_preload_suspect() -> None:
    good = calibrated()
    doubtful = dataclasses.replace(
        good, reasons=(Doubt("rigidity", "too stiff"), Doubt("misfit", "it scatters"))
    )
    assert (good.verdict, doubtful.verdict) == ("good", "suspect")
    assert preload(run_of(0.8), good, BASE).verdict == "good"
    found = preload(run_of(0.8), doubtful, BASE)
    assert found.verdict == "suspect"
    assert found.reasons == (
        "the calibration is suspect (rigidity): too stiff",
        "the calibration is suspect (misfit): it scatters",
    )
    partly = preload(run_of(0.8), doubtful, BASE, accept=["rigidity"])
    assert partly.reasons == ("the calibration is suspect (misfit): it scatters",)
    accepted = preload(run_of(0.8), doubtful, BASE, accept=["rigidity", "misfit"])
    assert accepted.verdict == "good"
    assert accepted.made.settings["accept"] == ["misfit", "rigidity"]
    assert "accepted (rigidity): too stiff" in accepted.notes


def test_doubts_are_sentences_one_for_each_name_with_the_times_of_runs() -> None:
    model = calibrated()
    assert [run.measured_at for run in model.runs] == [None]
    timed = dataclasses.replace(model.runs[0], measured_at="2026-01-31T08:00:00+00:00")
    short = timed.id[:12]
    doubts = [Doubt(f"field{number}", "wrong") for number in range(5)]
    doubts += [Doubt("outlying-run", f"run {short} does not fit")] * 3
    doubtful = dataclasses.replace(model, runs=(timed,), reasons=tuple(doubts))
    reasons = preload(run_of(), doubtful, BASE).reasons
    assert reasons[4] == "the calibration is suspect (field4): wrong"
    last = "the calibration is suspect (outlying-run): run of 2026-01-31T08:00 does not fit"
    assert reasons[5:] == (f"{last} (2 further reasons of this name)",)


@pytest.mark.parametrize("reasons", [(), (Doubt("misfit", "it scatters"),)])
def test_a_reason_that_the_calibration_does_not_have_cannot_be_accepted(reasons: tuple[Doubt, ...]) -> None:
    model = dataclasses.replace(calibrated(), reasons=reasons)
    expected = "it must be one of 'misfit'" if reasons else "needs nothing accepted"
    with pytest.raises(InputError, match=expected):
        preload(run_of(), model, BASE, accept=["rigidity"])


def test_assumptions_of_the_calibration_are_notes_and_no_doubt() -> None:
    found = preload(run_of(), dataclasses.replace(calibrated(), notes=("one day",)), BASE)
    assert found.verdict == "good"
    assert "of the calibration: one day" in found.notes


def test_a_refused_preload_reports_the_doubts_too() -> None:
    doubtful = dataclasses.replace(calibrated(), reasons=(Doubt("misfit", "it scatters"),))
    found = preload(run_of(1e9), doubtful, BASE)
    assert found.verdict == "refused"
    assert found.reasons[-1] == "the calibration is suspect (misfit): it scatters"


def test_refusals_before_any_estimate_name_the_doubts_of_the_calibration() -> None:
    doubtful = dataclasses.replace(calibrated(), reasons=(Doubt("misfit", "it scatters"),))
    bad = dataclasses.replace(run_of(0.8), quality=Quality("bad", ("clipped",)))
    empty = dataclasses.replace(run_of(0.8), cells=())
    for run in (bad, empty):
        estimate = preload(run, doubtful, BASE)
        assert estimate.verdict == "refused"
        assert estimate.reasons[1:] == ("the calibration is suspect (misfit): it scatters",)
        assert len(preload(run, doubtful, BASE, accept=["misfit"]).reasons) == 1


def test_a_suspect_measurement_makes_the_preload_suspect_and_one_of_the_baseline_too() -> None:
    doubt = Quality("suspect", ("torque hums at 50 Hz", "a spike"))
    found = preload(run_of(0.8, quality=doubt), calibrated(), BASE)
    assert found.verdict == "suspect"
    assert found.reasons[0] == "the measurement is suspect: torque hums at 50 Hz"
    found = preload(run_of(0.8), calibrated(), dataclasses.replace(BASE, quality=doubt))
    assert found.verdict == "suspect"
    assert found.reasons[0] == "the measurement of the baseline is suspect"


def test_a_clock_that_differs_from_the_baselines_makes_the_preload_suspect() -> None:
    clocks = [Clock(error, 1e-4) for error in (0.0, 0.02)]
    base = dataclasses.replace(BASE, clock=clocks[0])
    same = preload(run_of(0.8, clock=clocks[0]), calibrated(), base)
    assert not any("clock" in reason for reason in same.reasons)
    other = preload(run_of(0.8, clock=clocks[1]), calibrated(), base)
    assert other.verdict == "suspect"
    assert any(
        "the clock of the recordings differs from the baseline's by +2.00 %" in reason
        for reason in other.reasons
    )


def test_a_run_stiffer_than_the_model_allows_has_a_stiffness_by_its_baseline_and_no_newtons() -> None:
    """Both runs are of an axis that is stiffer than the model, which has not been calibrated with them."""
    base = run_of(name="base", level=0.115)
    found = preload(run_of(1.2, level=0.115), calibrated(runs=()), base)
    stiffness = found.stiffness_relative_to_baseline
    assert stiffness is not None
    assert stiffness.interval[0] > 1
    assert (found.preload_N, found.preload_ratio, found.relative_to_model) == (None, None, None)
    calibrated_with_it = preload(run_of(1.2, level=0.115), calibrated(runs=("base",)), base)
    assert calibrated_with_it.preload_N is not None


def test_without_a_baseline_a_nut_without_an_upper_end_is_refused() -> None:
    loose = Assumptions(bearing_drift=0.5)
    assert preload(run_of(1.5), calibrated()).relative_to_model is not None
    found = preload(run_of(1.5), calibrated(), assumptions=loose)
    assert (found.verdict, found.relative_to_model) == ("refused", None)
    assert found.reasons[0].startswith("the interval of the preload has no upper end")


def test_the_check_of_the_load_has_the_whole_uncertainty_of_the_nuts_share(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """With a share that is known badly, a load has to be wrong by more before the preload shows it."""
    sensitivities = []
    check = preload_module.check_mass

    def check_mass(masses: Any, causes: Any, sensitivity: float, assumptions: Assumptions) -> Any:
        sensitivities.append(sensitivity)
        return check(masses, causes, sensitivity, assumptions)

    monkeypatch.setattr(preload_module, "check_mass", check_mass)
    model = calibrated()
    for share in (0.02, 0.5):
        preload(run_of(0.5), model, run_of(1.0), assumptions=Assumptions(share=share))
    small, large = (share_uncertainty(model, Assumptions(share=share)) for share in (0.02, 0.5))
    assert sensitivities[1] < sensitivities[0]
    assert sensitivities[0] / sensitivities[1] <= large / small


def test_newtons_that_are_hardly_known_are_a_reason_to_doubt_the_nut() -> None:
    found = preload(run_of(1.0), calibrated(preload=0.9), BASE)
    assert found.preload_N is not None
    assert found.preload_N.interval[1] > 8 * found.preload_N.interval[0]
    assert (found.verdict, found.nut_verdict) == ("good", "suspect")
    assert any("the interval of the preload in newtons is too wide" in reason for reason in found.nut_reasons)
    assert preload(run_of(1.0), calibrated(), BASE).nut_reasons == ()


@pytest.mark.parametrize("level", [0.0, -0.1])
def test_a_kilogram_is_compared_with_the_uncertainty_of_cells_and_share(level: float) -> None:
    change = SimpleNamespace(by_load=np.array([0.002, 0.004]))
    fused = SimpleNamespace(level=level, spread=0.003, weights=np.array([0.5, 0.5]))
    model, assumptions = calibrated(), Assumptions(share=0.04)
    by_share = abs(level) * share_uncertainty(model, assumptions)
    found = load_significance(cast(Any, change), cast(Any, fused), model, assumptions)
    assert found == pytest.approx(0.003 / np.hypot(0.003, by_share))


@pytest.mark.parametrize(
    ("of_run", "of_baseline", "differs"), [("a", "a", False), ("a", "b", True), ("a", None, False)]
)
def test_another_data_sheet_than_the_baselines_is_noted(
    of_run: str, of_baseline: str | None, differs: bool
) -> None:
    run, baseline = (
        cast(Run, SimpleNamespace(made=SimpleNamespace(inputs={"axis": sheet})))
        for sheet in (of_run, of_baseline)
    )
    assert bool(sheet_notes(run, baseline)) == differs
    assert sheet_notes(run, None) == []
