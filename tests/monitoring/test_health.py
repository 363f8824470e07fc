"""The health of an axis from its runs."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from tests.estimation.made_runs import LOAD, calibrated, run_of
from tests.monitoring.histories import at, history, unloading, worn

import ballscrew.monitoring.assessment as assessment
from ballscrew.axis.hertz import RELEASE
from ballscrew.base.errors import InputError
from ballscrew.base.quantity import Quantity
from ballscrew.calibration.assumptions import Assumptions
from ballscrew.calibration.calibrated_axis import Doubt
from ballscrew.calibration.frequency_table import frequency_table
from ballscrew.estimation.preload import preload
from ballscrew.modal.reason import Reason
from ballscrew.modal.run import Run
from ballscrew.monitoring.assessment import AssessedRun, fused_change
from ballscrew.monitoring.detection.chart import chart_of
from ballscrew.monitoring.detection.settings import MonitorSettings
from ballscrew.monitoring.epochs import Event, moment
from ballscrew.monitoring.health import health_state
from ballscrew.monitoring.history_causes import NAMES, _add_mass, _Evidence, trend_evidence
from ballscrew.monitoring.reading import Reading
from ballscrew.monitoring.state import HealthState
from ballscrew.recording.lost_motion import LostMotion
from ballscrew.recording.quality.finding import Quality
from ballscrew.recording.temperature import TemperatureCourse

FEW = MonitorSettings(draws=2000)
MODEL = calibrated()


def assess(runs: list[Run], *events: Event, settings: MonitorSettings = FEW) -> HealthState:
    return health_state(runs, MODEL, events=events, settings=settings)


def states(found: HealthState) -> list[str]:
    return [run.state for run in found.runs]


@pytest.fixture(scope="module")
def life() -> list[Run]:
    return history(range(40), worn(19.5, 120.0))


@pytest.fixture(scope="module")
def ended(life: list[Run]) -> HealthState:
    return assess(life)


def test_wear_alarms_early_and_the_nut_is_named(ended: HealthState) -> None:
    first = states(ended).index("alarm")
    assert 20 <= first <= 23
    assert ended.alarm_at == ended.runs[first].reading.measured_at
    assert ended.state == "alarm"
    assert ended.causes[0].cause == "nut or bearing"
    assert sum(cause.probability for cause in ended.causes) == pytest.approx(1)


def test_constant_friction_makes_a_loss_of_preload_less_probable() -> None:
    stays = history(range(40), worn(19.5, 60.0), drag_share=0.0)
    falls = history(range(40), worn(19.5, 60.0))
    chance = [{cause.cause: cause.probability for cause in assess(runs).causes} for runs in (stays, falls)]
    odds = [found["nut or bearing"] / (1 - found["nut or bearing"]) for found in chance]
    assert odds[1] > 5 * odds[0]


@pytest.mark.parametrize("moved", [0.002, 0.0])
def test_a_moved_zero_is_named_by_the_cells(moved: float) -> None:
    precise = {"scatter": 1e-5, "uncertainty": 2e-5}
    wear = (lambda _: 1.0) if moved else worn(19.5, 120.0)
    before, after = (
        history(range(20), **precise),
        history(range(20, 30), wear, moved=moved, seed=1, **precise),
    )
    found = assess([*before, *after])
    zero = next(cause for cause in found.causes if cause.cause == "controller")
    assert (zero == found.causes[0]) == bool(moved)
    assert ("for: the cells changed as if the zero of the axis had moved" in zero.evidence) == bool(moved)


def softening(ratio: float) -> Quantity:
    """Mass over preload, as two acceleration levels determine it."""
    value = (MODEL.nut_mass + LOAD) / (MODEL.model.preload * ratio)
    return Quantity(value, 0.1 * value, "kg/N")


@pytest.mark.parametrize("cause", ["nut", "bearing"])
def test_two_acceleration_levels_name_the_nut_or_the_bearing(cause: str) -> None:
    wear = worn(10.5, 120.0)
    runs = []
    for run in history(range(30), wear):
        ratio = wear((moment(run.measured_at, "") - moment(at(0), "")).days)
        known = softening(ratio if cause == "nut" else 1.0)
        runs.append(replace(run, mass_over_preload_kg_per_N=known))
    found = assess(runs)
    causes = {named.cause: named.probability for named in found.causes}
    assert causes[cause] > 0.8 * (causes["nut"] + causes["bearing"] + causes["both"])
    assert (found.nut_verdict, found.nut_reasons) == ("good", ())
    newest = found.runs[-1]
    assert newest.stiffness is not None
    assert newest.relative is not None
    assert newest.stiffness.value == pytest.approx(wear(29), abs=0.02)
    true = wear(29) if cause == "nut" else 1.0
    assert newest.relative.value == pytest.approx(true, abs=0.03)
    assert newest.relative.interval[0] < true < newest.relative.interval[1]


def test_a_softening_that_excludes_the_stiffness_makes_the_nut_suspect() -> None:
    runs = [replace(run, mass_over_preload_kg_per_N=softening(1.0)) for run in history(range(20))]
    assert assess(runs).nut_verdict == "good"
    runs[-1] = replace(runs[-1], mass_over_preload_kg_per_N=softening(0.2))
    found = assess(runs)
    assert (found.verdict, found.nut_verdict) == ("good", "suspect")
    assert "exclude each other" in found.nut_reasons[0]


def test_without_an_anchor_the_stiffness_is_good_and_the_nut_is_not(ended: HealthState) -> None:
    assert ended.verdict == "good"
    assert ended.nut_verdict == "suspect"
    assert "not identifiable" in ended.nut_reasons[0]
    newest = ended.runs[-1]
    assert newest.stiffness is not None
    assert newest.relative is not None
    assert np.ptp(newest.relative.interval) > 1.5 * np.ptp(newest.stiffness.interval)
    stated = MonitorSettings(draws=2000, assumptions=Assumptions(bearing_drift=0.01))
    known = assess(history(range(40), worn(19.5, 120.0)), settings=stated)
    assert known.nut_verdict == "good"
    assert known.causes[0].cause == "nut"


@pytest.mark.parametrize("change", [0.001, 0.02, 0.15, 0.5])
def test_another_mass_is_evidence_for_a_load_or_a_torque_scale_however_large_it_is(change: float) -> None:
    values = [1.0 + 1e-4 * sign for sign in (1, -1, 1, -1)] + [1.0 + change] * 3
    good = [_with_mass(300.0 * value) for value in values]
    chart = SimpleNamespace(baseline=np.arange(4))
    evidence = _Evidence(dict.fromkeys(("nut or bearing", *NAMES), 0.1))
    before = evidence.log_odds["load"]
    _add_mass(evidence, good, chart)
    spread = math.hypot(np.std(np.log(values[:4]), ddof=1) * math.sqrt(1 / 4 + 1 / 3), 1e-3)
    wide, shift = math.hypot(spread, 0.02), math.log1p(change)
    exact = math.log(spread / wide) + shift**2 / 2 * (spread**-2 - wide**-2)
    assert evidence.log_odds["load"] - before == pytest.approx(np.clip(exact, -4, 4), abs=1e-3)


def _with_mass(mass: float) -> AssessedRun:
    reading = Reading("run", at(0), 0.0, 0, math.nan, 0.0, 1e-3, "good", equivalent_mass=mass)
    return AssessedRun(run_of(), reading)


def test_the_masses_of_the_model_count_where_the_loads_differ() -> None:
    base, other = (frequency_table(run_of(load=LOAD + more)) for more in (0.0, 20.0))
    vague, sure = calibrated(mass=0.05), calibrated(mass=1e-6, rotor=1e-6)
    spread = [fused_change(other, base, model, FEW)[1].spread for model in (vague, sure)]
    assert spread[0] > 1.1 * spread[1]


def test_a_sudden_change_makes_the_sensor_more_probable() -> None:
    step = assess(history(range(40), lambda day: 0.8 if day > 24 else 1.0))
    wear = assess(history(range(40), worn(19.5, 120.0)))
    sensor = [{cause.cause: cause.probability for cause in found.causes}["sensor"] for found in (step, wear)]
    assert sensor[0] > 5 * sensor[1]


def test_the_preload_is_relative_to_the_baseline(ended: HealthState) -> None:
    for day in (0, 10, 25, 39):
        quantity = ended.runs[day].stiffness
        assert quantity is not None
        assert quantity.value == pytest.approx(worn(19.5, 120.0)(day), abs=0.02)
        assert quantity.interval[0] < worn(19.5, 120.0)(day) < quantity.interval[1]


def test_learning_then_normal(ended: HealthState) -> None:
    assert states(ended)[:3] == ["learning"] * 3
    assert set(states(ended)[3:20]) == {"normal"}


def test_a_healthy_axis_has_no_alarm_no_cause_and_no_stage() -> None:
    found = assess(history(range(25)))
    assert set(states(found)) == {"learning", "normal"}
    assert (found.alarm_at, found.causes, found.stage, found.notes) == (None, (), None, ())


def test_an_axis_that_wears_is_in_stage_one(ended: HealthState) -> None:
    assert ended.stage is not None
    assert ended.stage.I > 0.95
    assert "not observable" in ended.stage.how


def test_any_order_and_any_run_twice_give_the_same(life: list[Run]) -> None:
    some = life[15:26]
    forward, backward = assess(some), assess([*some[::-1], some[3], some[0]])
    assert json.dumps(forward.to_json(), sort_keys=True) == json.dumps(backward.to_json(), sort_keys=True)


def test_a_later_run_changes_no_earlier_state(life: list[Run]) -> None:
    assert states(assess(life[:24])) == states(assess(life))[:24]


def test_a_suspect_run_is_listed_and_changes_no_statistic(life: list[Run]) -> None:
    wrong = replace(run_of(0.5, name="wrong"), measured_at=at(5.5), quality=Quality("suspect", ("clipped",)))
    bad = replace(run_of(name="bad"), measured_at=at(6.5), quality=Quality("bad", ("no torque",)))
    found = assess([*life[:20], wrong, bad])
    shown = {state.reading.run: state for state in found.runs}
    assert shown["wrong"].state == shown["bad"].state == "suspect"
    assert shown["wrong"].reading.reasons[0] == "clipped"
    without = {state.reading.run: state.ramp for state in assess(life[:20]).runs}
    assert all(shown[name].ramp == value or math.isnan(value) for name, value in without.items())


def test_a_run_is_suspect_by_a_doubt_of_its_cells_that_the_reference_has_not(life: list[Run]) -> None:
    reason = Reason("unexcited", "the jerk is too soft")

    def doubted(run: Run) -> Run:
        return replace(run, cells=tuple(cell.with_reasons(reason) for cell in run.cells))

    found = assess([*life[:5], doubted(life[5]), *life[6:]])
    assert states(found)[5] == "suspect"
    assert "too soft" in found.runs[5].reading.reasons[0]
    assert states(assess([doubted(run) for run in life])) == states(assess(life))


def test_a_wrong_load_is_suspect_by_its_mass() -> None:
    heavier = replace(run_of(true_load=104.0, name="heavier"), measured_at=at(12.5))
    found = assess([*history(range(12)), heavier])
    assert found.runs[-1].state == "suspect"
    assert "mass" in found.runs[-1].reading.reasons[0]
    assert found.state == "normal"


def test_the_check_of_a_runs_load_has_the_uncertainty_that_preload_has(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    found: list[tuple[float, float]] = []
    check, significance = assessment.check_mass, assessment.load_significance

    def compute(*given: Any) -> float:
        found.append((significance(*given), math.nan))
        return found[-1][0]

    def record(masses: Any, causes: Any, sensitivity: float, assumptions: Assumptions) -> Any:
        found[-1] = (found[-1][0], sensitivity)
        return check(masses, causes, sensitivity, assumptions)

    monkeypatch.setattr(assessment, "load_significance", compute)
    monkeypatch.setattr(assessment, "check_mass", record)
    heavier = replace(run_of(true_load=104.0, name="heavier"), measured_at=at(12.5))
    assess([*history(range(12)), heavier])
    assert found
    assert all(given == used for given, used in found)


def uneven(ratio: float, **others: Any) -> Run:
    """A run whose preload falls along the screw, as by uneven wear or by a screw that is colder there."""
    run = run_of(lambda x: 1 - (1 - ratio) * x / 0.45, local=True, **others)
    return replace(run, measured_at=at(12.5))


def test_a_run_that_one_preload_does_not_explain_counts_and_is_suspect_as_in_preload() -> None:
    runs = history(range(12))
    found, estimate = assess([*runs, uneven(0.8, name="uneven")]), preload(uneven(0.8), MODEL, runs[0])
    assert estimate.verdict == "suspect"
    assert found.runs[-1].stiffness is not None
    assert (found.verdict, found.nut_verdict) == ("suspect", "suspect")
    misfit, _, _ = estimate.reasons[0].partition(", and the interval")
    assert f"the newest good run: {misfit}" in found.reasons
    assert "uneven wear" in misfit
    assert assess(runs).verdict == "good"


def test_a_run_whose_screw_was_warmer_than_its_nut_does_not_count() -> None:
    warm = replace(run_of(name="warm"), measured_at=at(12.5))
    warm = replace(
        warm, temperature=TemperatureCourse(20.0, 20.0, 20.0, 0.0, place="nut", screw_above_nut_K=10.0)
    )
    found = assess([*history(range(12)), warm])
    assert found.runs[-1].state == "suspect"
    assert "10.0 K warmer than its nut" in found.runs[-1].reading.reasons[0]


def test_a_drifted_torque_constant_is_no_loss_of_preload() -> None:
    warmer = replace(run_of(torque=1.01, name="warmer"), measured_at=at(12.5))
    found = assess([*history(range(12)), warmer])
    assert found.runs[-1].state == "normal"
    assert "torque" in " ".join(found.runs[-1].reading.reasons)
    (note,) = found.notes
    assert note.startswith("The newest run: ")


def test_a_loose_accelerometer_is_suspect_by_its_frf() -> None:
    runs = history(range(12))
    runs = [
        replace(run, rigid_body=replace(run.rigid_body, frf_equivalent_mass_kg=scale * 289.0))
        for run, scale in zip(runs, [1.0] * 11 + [1.07], strict=True)
    ]
    found = assess(runs)
    assert found.runs[-1].state == "suspect"
    assert "accelerometer" in found.runs[-1].reading.reasons[0]


def test_a_replaced_nut_begins_an_epoch_and_the_earlier_runs_remain() -> None:
    before, after = worn(14.5, 100.0), worn(60.0, 100.0)
    runs = history(range(50), lambda day: before(day) if day < 30 else 1.05 * after(day))
    found = assess(runs, Event(at(29.6), "nut replaced"))
    assert [epoch.alarm_at is not None for epoch in found.epochs] == [True, False]
    assert states(found)[29] == "alarm"
    assert states(found)[30:33] == ["learning"] * 3
    assert set(states(found)[33:]) == {"normal"}
    assert (found.state, found.alarm_at, found.causes) == ("normal", None, ())
    newest = found.runs[-1].stiffness
    assert newest is not None
    assert newest.value == pytest.approx(1, abs=0.01)
    assert len(found.runs) == 50


def test_an_event_after_the_newest_run_ends_no_alarm(life: list[Run], ended: HealthState) -> None:
    planned = Event(at(300), "nut replaced")
    found = assess(life, planned)
    assert (found.state, found.alarm_at) == (ended.state, ended.alarm_at)
    assert states(found) == states(ended)
    assert found.stage is not None
    assert found.causes
    assert [epoch.events for epoch in found.epochs] == [(planned,)]
    assert "nut replaced" in found.notes[0]
    follows = assess([*life, *history([301.0], seed=1)], planned)
    assert (follows.state, len(follows.epochs)) == ("learning", 2)


def test_wear_goes_on_through_grease() -> None:
    """The loss since the baseline is not attributed to the step, whenever it occurs."""
    true = worn(15, 200)
    runs = history(range(40), true)
    for when in (9.5, 17.5, 30.3):
        found = assess(runs, Event(at(when), "greased"))
        assert found.causes[0].cause == "nut or bearing"
        for run in found.runs:
            assert run.stiffness is not None
            low, high = run.stiffness.interval
            assert low < true(run.reading.day) < high
            assert run.stiffness.value == pytest.approx(true(run.reading.day), abs=0.02)


def test_a_healthy_axis_may_be_greased() -> None:
    assert set(states(assess(history(range(30)), Event(at(14.5), "greased")))) == {"learning", "normal"}


def test_the_time_of_the_alarm_is_that_of_the_newest() -> None:
    def ratio(day: float) -> float:
        return 0.97 if 12 <= day < 14 else worn(59.5, 120.0)(day)

    found = assess(history(range(70), ratio))
    sequence = states(found)
    first, newest = sequence.index("alarm"), 69 - sequence[::-1].index("normal") + 1
    while sequence[newest] != "alarm":
        newest += 1
    assert first < 20 < 58 < newest
    assert found.state == "alarm"
    assert found.alarm_at == found.runs[newest].reading.measured_at


@pytest.mark.parametrize(("ratio", "verdict"), [(5.0, "good"), (12.0, "suspect")])
def test_a_run_that_no_preload_of_the_nut_explains_is_not_good(ratio: float, verdict: str) -> None:
    """Such as one of another axis of the same masses; a soft one cannot be told from a worn nut."""
    runs = history([3.0 * day for day in range(7)], lambda day: ratio if day == 15.0 else 1.0)
    reading = health_state(runs, MODEL).runs[5].reading
    assert reading.verdict == verdict
    if verdict == "suspect":
        assert reading.reasons[0].startswith("it is as stiff as with 12 times the preload")


def test_a_note_asks_for_the_events_of_an_axis_that_became_stiffer() -> None:
    found = assess(history(range(40), lambda day: 1.3 if day > 19 else 1.0))
    assert (found.state, found.alarm_at) == ("normal", None)
    assert "EVENTS" in found.notes[0]


def test_an_outlying_first_run_is_not_the_reference() -> None:
    runs = history(range(12))
    odd = replace(run_of(name="first", true_load=104.0), measured_at=at(0))
    found = assess([odd, *runs[1:]])
    assert found.epochs[0].reference == runs[1].id
    assert states(found) == ["suspect", *["learning"] * 3, *["normal"] * 8]
    assert "mass" in found.runs[0].reading.reasons[0]
    assert assess([odd, runs[1]]).epochs[0].reference == "first"


def test_an_outlying_second_run_does_not_change_the_reference() -> None:
    runs = history(range(6))
    odd = replace(run_of(name="odd", true_load=104.0), measured_at=at(1))
    found = assess([runs[0], odd, *runs[2:]])
    assert found.epochs[0].reference == runs[0].id
    assert states(found)[1] == "suspect"


def test_steady_wear_in_precise_runs_is_no_sudden_change() -> None:
    """Levels of a demonstration with wear from day 15 on, more precise than any of the shapes fits them."""
    days = np.array([0, 3, 6, 12, 15, 18, 21, 24, 30, 36, 48, 60, 72], dtype=float)
    level = np.array(
        [0, -1.6e-3, 0.9e-3, 0.4e-3, -2.1e-3, 0.0378, 0.0563, 0.0852, 0.1417, 0.2048, 0.3635, 0.6155, 1.0381]
    )
    spread = 1e-3 * np.array([2.7, 4.1, 8.7, 3.6, 5.1, 9.9, 6.0, 4.3, 4.9, 12.1, 2.6, 5.3, 7.9])
    found = chart_of(days, level, spread, np.full(13, np.nan), (), FEW)
    odds, words = trend_evidence(found)
    assert odds > 1
    assert "progresses" in words


@pytest.mark.parametrize("understatement", [1.0, 10.0])
def test_a_step_is_a_sudden_change_whatever_the_stated_uncertainty(understatement: float) -> None:
    days = np.arange(30.0)
    level = 0.08 * (days > 19) + 1e-3 * np.random.default_rng(1).standard_normal(30)
    found = chart_of(days, level, np.full(30, 2e-3 / understatement), np.full(30, np.nan), (), FEW)
    odds, words = trend_evidence(found)
    assert odds < -1
    assert "at once" in words


def test_backlash_measured_by_a_scale_indicates_stage_two() -> None:
    def moved(run: Run, lost: float) -> Run:
        return replace(run, lost_motion=tuple(LostMotion(x, lost, 3e-8, 3) for x in (0.1, 0.2)))

    runs = history(range(30), worn(8.5, 22.0))
    gone = assess([moved(run, 3e-7 + (1e-6 if k > 27 else 0.0)) for k, run in enumerate(runs)])
    healthy = assess([moved(run, 3e-7) for run in history(range(12))])
    assert gone.stage is not None
    assert healthy.stage is None
    assert gone.stage.II > 0.5
    assert "lost motion" in gone.stage.how
    assert gone.runs[-1].reading.backlash == pytest.approx(1e-6, rel=0.4)


def test_the_wind_up_of_a_softer_axis_is_no_backlash() -> None:
    def moved(run: Run, first: Run) -> Run:
        softer = (first.cells[0].frequency_Hz / run.cells[0].frequency_Hz) ** 2  # type: ignore[operator]
        return replace(run, lost_motion=tuple(LostMotion(x, 8e-7 * softer, 2e-8, 3) for x in (0.1, 0.2)))

    runs = history(range(30), worn(8.5, 40.0))
    found = assess([moved(run, runs[0]) for run in runs])
    last = found.runs[-1].reading
    assert abs(last.backlash) < 2 * last.backlash_uncertainty
    assert found.stage is not None
    assert found.stage.II < 0.2


def test_the_document_is_plain_and_has_the_agreed_keys(ended: HealthState) -> None:
    document = json.loads(json.dumps(ended.to_json(), allow_nan=False))
    assert {"schema", "runs", "alarm_at", "stage", "causes"} <= document.keys()
    assert {"measured_at", "state", "stiffness_relative_to_baseline", "relative_to_baseline"} <= document[
        "runs"
    ][0].keys()
    assert set(document["stage"]) == {"I", "II", "how"}
    assert {"cause", "probability"} <= document["causes"][0].keys()


def test_runs_without_a_time_or_of_another_axis_are_refused() -> None:
    runs = history(range(5))
    with pytest.raises(InputError, match="no run was given"):
        assess([])
    with pytest.raises(InputError, match="has no time"):
        assess([replace(runs[0], measured_at=None)])
    with pytest.raises(InputError, match="must be a time"):
        assess([replace(runs[0], measured_at="soon")])
    with pytest.raises(InputError, match="one axis"):
        assess([replace(runs[0], axis="another")])


def test_another_plan_or_load_is_suspect_with_a_reason() -> None:
    runs = history(range(5))
    other = replace(runs[3], made=replace(runs[3].made, inputs={"plan": "x"}))
    runs = [replace(run, made=replace(run.made, inputs={"plan": "y"})) for run in runs]
    found = assess([*runs[:3], other, replace(runs[4], mass_kg=20.0)])
    assert [run.state for run in found.runs[3:]] == ["suspect"] * 2
    assert "its plan is not that of the epoch's reference" in found.runs[3].reading.reasons[0]
    assert "20 kg" in found.runs[4].reading.reasons[0]


def test_a_repeat_of_an_outlying_run_is_requested_until_a_good_run_follows() -> None:
    days = [float(day) for day in range(18)]
    first = assess(history(days, outliers={17: -6e-4}))
    assert first.repeat_asked
    assert first.state in ("normal", "watch")
    never = MonitorSettings(draws=2000, repeats_per_year=0)
    assert not assess(history(days, outliers={17: -6e-4}), settings=never).repeat_asked
    assert not assess(history(days)).repeat_asked
    runs = history([*days, 17.1], outliers={17: -6e-4})
    again = assess(runs)
    assert not again.repeat_asked
    assert again.state == "normal"
    assert states(again)[:-1] == states(first)
    # A bad repeat on the same day does not count; on another day no repeat is requested.
    bad = Quality("bad", ("clipped",))
    assert assess([*runs[:-1], replace(runs[-1], quality=bad)]).repeat_asked
    later = history([*days, 18.0], outliers={17: -6e-4})
    assert not assess([*later[:-1], replace(later[-1], quality=bad)]).repeat_asked
    assert first.to_json()["repeat_asked"] is True
    assert HealthState.from_json(first.to_json()).repeat_asked


def test_a_recording_counts_once_whatever_the_id_of_its_run() -> None:
    runs = history([float(day) for day in range(4)])
    copy = replace(runs[3], id="copy", measured_at=at(3.1))
    with pytest.raises(InputError, match="made of the same recording"):
        assess([*runs, copy])
    assess([*runs, runs[3]])


def test_a_doubtful_calibration_makes_the_result_suspect_and_detects_as_before() -> None:
    runs = history(range(6), worn(19.5, 120.0))
    doubtful = replace(MODEL, reasons=(Doubt("misfit", "it scatters"),))
    good, suspect = assess(runs), health_state(runs, doubtful, settings=FEW)
    assert (good.verdict, suspect.verdict) == ("good", "suspect")
    assert suspect.reasons == ("the calibration is suspect (misfit): it scatters",)
    assert states(suspect) == states(good)
    accepted = health_state(runs, doubtful, settings=FEW, accept=["misfit"])
    assert accepted.verdict == "good"
    assert "accepted (misfit): it scatters" in accepted.notes
    assert accepted.made.settings["accept"] == ["misfit"]
    read = HealthState.from_json(json.loads(json.dumps(suspect.to_json())))
    assert (read.verdict, read.reasons) == ("suspect", suspect.reasons)
    with pytest.raises(InputError, match="must be one of 'misfit'"):
        health_state(runs, doubtful, settings=FEW, accept=["rigidity"])


def test_two_runs_that_unload_the_nut_are_an_alarm_and_one_is_to_be_repeated() -> None:
    healthy = unloading(1.0, history(range(8)))
    worn_out = unloading(4.0, history((8.0, 9.0), seed=9), refused=True)
    single = assess([*healthy, worn_out[0]])
    assert states(single)[-1] == "unloaded"
    assert (single.state, single.repeat_asked, single.alarm_at) == ("watch", True, None)
    both = assess([*healthy, *worn_out])
    newest = both.runs[-1].reading.measured_at
    assert (both.state, both.alarm_at, both.urgency) == ("alarm", newest, "now")
    assert both.assessed is both.runs[-1]
    assert both.assessed.preload_below == pytest.approx(1 / RELEASE, rel=0.3)
    assert both.stage is not None
    assert "which unloads the nut" in both.stage.how
    assert "below" in both.nut_reasons[-1]
    document = both.to_json()
    assert (document["state_at"], document["set_aside"]) == (newest, [])
    assert document["preload_below"] == pytest.approx(both.assessed.preload_below)
    assert HealthState.from_json(document).state == "alarm"


@pytest.mark.parametrize("change", ["load", "measurement", "moderate"])
def test_no_limit_follows_from_a_run_of_another_mass_or_a_doubtful_one(change: str) -> None:
    healthy = unloading(1.0, history(range(8)))
    load = 2.0 if change == "moderate" else 4.0
    torque = 1.1 if change == "load" else 1.0
    quality = Quality("suspect", ("why",)) if change == "measurement" else Quality("good")
    last = unloading(load, history((8.0,), seed=9, torque=torque, quality=quality), refused=True)
    found = assess([*healthy, *last])
    assert (found.state, states(found)[-1]) == ("normal", "suspect")
    assert found.set_aside == found.runs[-1:]
    assert found.why_unassessed.startswith("the newest run does not count (")


def test_a_history_of_a_hundred_years_is_refused() -> None:
    runs = history((0.0, 60 * 365.0))
    with pytest.raises(InputError, match="more than 50 years apart"):
        assess(runs)


def test_a_loss_within_the_baseline_is_named() -> None:
    sound = assess(history((0, 7, 14)))
    worn_early = assess(history((0, 7, 14), lambda day: 1 - 0.28 * day / 14))
    assert sound.loss_while_learning is None
    assert worn_early.loss_while_learning == pytest.approx(0.28, abs=0.05)
    assert "already softened in these runs" in worn_early.why_unassessed


def test_wear_within_the_baseline_is_no_effect_of_the_temperature() -> None:
    """Five weekly runs of axes that wear from the first on, as they become warmer."""
    days = np.arange(5) * 7.0
    ratio = worn(0.0, 28 / (1 - 0.851 ** (1 / 3)))
    contained = []
    for seed in range(8):
        steps = np.random.default_rng(seed).uniform(0.0, 1.5, 4)
        warmth = dict(zip(days, np.append(20.0, 20.0 + np.cumsum(steps)), strict=True))
        runs = history(days, ratio, seed=seed, scatter=2e-4, temperature=warmth.__getitem__)
        for day, run in zip(days[1:], assess(runs).runs[1:], strict=True):
            assert run.stiffness is not None
            low, high = run.stiffness.interval
            contained.append(low < ratio(day) < high)
    assert sum(contained) >= 28


def test_the_doubt_of_a_baseline_without_wear_widens_no_interval() -> None:
    runs = history(range(5), temperature=lambda day: 20 + 3 * (day % 2))
    for run in assess(runs).runs:
        assert run.stiffness is not None
        low, high = run.stiffness.interval
        assert low < 1 < high
        assert high - low < 0.035


def test_a_history_of_refused_runs_has_no_chart_and_no_stage() -> None:
    runs = history(range(3), quality=Quality("bad", ("clipped",)))
    found = assess(runs)
    assert [run.state for run in found.runs] == ["suspect"] * 3
    assert {run.reading.verdict for run in found.runs} == {"refused"}
    assert (found.stage, found.causes, found.alarm_at) == (None, (), None)
    assert not found.stiffer


def test_a_suspect_run_before_the_first_good_one_is_suspect_by_itself() -> None:
    first, *others = history(range(6))
    found = assess([replace(first, quality=Quality("suspect", ("torque hums",))), *others])
    assert (found.runs[0].state, found.runs[0].reading.reasons) == ("suspect", ("torque hums",))
    assert found.epochs[0].reference == others[0].id


def test_a_run_without_a_common_cell_is_suspect() -> None:
    *runs, newest = history(range(6))
    cells = tuple(replace(cell, motion=1) for cell in newest.cells)
    found = assess([*runs, replace(newest, cells=cells)])
    assert found.runs[-1].state == "suspect"
    assert found.runs[-1].reading.reasons == (
        "it has no cell with a frequency in common with the epoch's reference",
    )


def test_lost_motion_without_an_uncertainty_is_no_backlash() -> None:
    def moved(run: Run, uncertainty: float) -> Run:
        return replace(run, lost_motion=(LostMotion(0.1, 1e-6, uncertainty, 1),))

    for uncertainty, known in ((math.nan, False), (0.0, False), (3e-8, True)):
        found = assess([moved(run, uncertainty) for run in history(range(5), scatter=0.0)])
        assert math.isfinite(found.runs[-1].reading.backlash) == known


def test_one_run_shows_no_trend() -> None:
    chart = chart_of(*(np.array([value]) for value in (0.0, 0.0, 1e-3, math.nan)), (), FEW, 0.0)
    assert trend_evidence(chart) == (0.0, "there are too few runs for a trend")


def test_a_run_with_another_data_sheet_than_the_reference_counts_with_a_note() -> None:
    runs = history(range(6))
    runs = [replace(run, made=replace(run.made, inputs={"axis": "a"})) for run in runs]
    runs[-1] = replace(runs[-1], made=replace(runs[-1].made, inputs={"axis": "b"}))
    readings = [run.reading for run in assess(runs).runs]
    noted = [any("another data sheet" in reason for reason in reading.reasons) for reading in readings]
    assert noted == [False] * 5 + [True]
    assert readings[-1].verdict == "good"
