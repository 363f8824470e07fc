"""``monitor``: health state and remaining life from the runs of an axis."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from tests.estimation.made_runs import MODEL, calibrated
from tests.monitoring.histories import at, history, worn

from ballscrew.base.errors import InputError
from ballscrew.monitoring.epochs import Event
from ballscrew.monitoring.health import health_state
from ballscrew.prognosis.failure import Failure
from ballscrew.prognosis.monitor import end_of_life, epoch_history, monitor
from ballscrew.recording.lost_motion import LostMotion
from ballscrew.report.monitor_words import headline

DAYS = tuple(float(day) for day in range(0, 63, 3))


@pytest.fixture(scope="module")
def result():
    """Ten healthy runs, then wear by the law of contact pressure: P is half at day 30 + 24.8."""
    return monitor(history(DAYS[:16], worn(27.0, 120.0)), calibrated(), duty=10_000.0)


def test_an_axis_that_wears_alarms_and_its_end_is_forecast(result):
    assert result.state.state == "alarm"
    assert result.state.alarm_at is not None
    assert result.prognosis is not None
    true = 27 + 120 * (1 - 0.5 ** (1 / 3)) - DAYS[15]
    low, high = result.prognosis.rul_days[0.05], result.prognosis.rul_days[0.95]
    assert low < true < high < low + 3 * true
    assert result.prognosis.rul_travel_m[0.05] == pytest.approx(10_000 * low)


@pytest.mark.parametrize("every", [3.0, 7.0])
def test_an_alarm_is_raised_with_a_forecast(every):
    """The second run with wear raises it."""
    runs = history(np.arange(0.0, 8 * every, every), worn(5 * every, 30 * every))
    states = health_state(runs, calibrated()).runs
    first = next(k for k, run in enumerate(states) if run.state == "alarm")
    result = monitor(runs[: first + 1], calibrated())
    assert result.prognosis.rul_days[0.05] is not None
    assert "of life remain" in headline(result)


def test_the_document_has_the_stable_keys(result):
    document = result.to_json()
    assert {"runs", "alarm_at", "stage", "causes", "rul_days", "rul_travel_m"} <= document.keys()
    assert document["runs"][0].keys() >= {"measured_at", "state", "relative_to_baseline"}
    assert set(document["rul_days"]["quantiles"]) >= {"0.05", "0.5", "0.95"}
    assert document["prognosis"]["failure"]["mode"] == "preload"
    assert sum(cause["probability"] for cause in document["causes"]) == pytest.approx(1)


def test_runs_may_be_files_or_come_one_by_one(tmp_path):
    runs = history(tuple(float(day) for day in range(4)))
    paths = []
    for number, run in enumerate(runs):
        paths.append(tmp_path / f"{number}.json")
        run.write(paths[-1])
    expected = monitor(runs, calibrated()).state.state
    assert monitor(iter(runs), calibrated()).state.state == expected
    assert monitor(map(str, paths), calibrated()).state.state == expected


def test_a_healthy_axis_has_an_open_end():
    result = monitor(history(DAYS), calibrated())
    assert result.state.state == "normal"
    assert result.state.alarm_at is None
    assert result.prognosis.rul_days[0.95] is None


def test_no_end_is_forecast_for_an_axis_that_became_stiffer():
    """As after a new nut without an event: the alarm may last, and the history is not that of the new nut."""
    wear = worn(18.0, 40.0)
    result = monitor(history(DAYS[:14], lambda day: wear(day) if day < 33 else 1.1), calibrated())
    assert result.state.stiffer
    assert result.prognosis is None
    assert result.to_json()["rul_days"] == {"quantiles": {}}


def test_two_runs_give_no_forecast():
    result = monitor(history(DAYS[:2]), calibrated())
    assert result.state.state == "learning"
    assert result.prognosis is None
    assert result.to_json()["rul_days"] == {"quantiles": {}}


def test_the_order_of_the_runs_does_not_matter():
    runs = history(DAYS[:12], worn(20.0, 150.0))
    forward, backward = (monitor(each, calibrated()) for each in (runs, runs[::-1]))
    assert forward.to_json() == backward.to_json()


def test_a_new_nut_begins_an_epoch_and_the_earlier_runs_remain():
    runs = history(DAYS[:16], lambda day: worn(12.0, 90.0)(day) if day < 36 else 1.0)
    event = Event(at(35.0), "nut replaced", "new nut")
    result = monitor(runs, calibrated(), events=[event])
    assert result.state.state == "normal"
    assert result.state.alarm_at is None
    assert result.state.epochs[0].alarm_at is not None
    assert len(result.state.runs) == 16
    history_of = epoch_history(result.state, calibrated())
    assert len(history_of) == 4
    assert history_of.days[0] == 0


def test_the_history_of_an_epoch_excludes_a_known_step():
    runs = history(DAYS[:14], lambda day: 1.0 if day < 20 else 0.96)
    step = epoch_history(health_state(runs, calibrated(), events=[Event(at(20.0), "greased")]), calibrated())
    plain = epoch_history(health_state(runs, calibrated()), calibrated())
    assert plain.level[-1] == pytest.approx(0.96 ** (-1 / 3) - 1, abs=0.004)
    assert abs(step.level[-3:].mean()) < 0.5 * abs(plain.level[-3:].mean())


def test_the_approach_of_the_flanks_is_that_of_the_nut():
    epoch = epoch_history(health_state(history(DAYS[:5]), calibrated()), calibrated())
    rigidity = 1 / (MODEL.share * MODEL.compliance)  # of the nut at its preload: 3 P / δ₀
    assert epoch.approach == pytest.approx(3 * MODEL.preload / rigidity)
    assert epoch.scale > 0.1
    assert np.isfinite(epoch.friction).all()
    assert np.isnan(epoch.backlash).all()


def test_the_history_contains_lost_motion():
    runs = history(DAYS[:6])
    lost = [
        replace(run, lost_motion=tuple(LostMotion(x, size, 2e-8, 3) for x in (0.09, 0.18, 0.27)))
        for run, size in zip(runs, (5e-7,) * 5 + (4e-6,), strict=True)
    ]
    epoch = epoch_history(health_state(lost, calibrated()), calibrated())
    assert epoch.backlash[-1] == pytest.approx(3.5e-6)
    assert epoch.resolution > 0


def test_a_largest_load_uses_the_preload_of_the_epoch():
    runs = history(DAYS[:5])
    end = end_of_life(runs[0], calibrated(), None, 1200.0)
    assert end.preload == pytest.approx(MODEL.preload, rel=0.02)
    assert end.mode(1e-5)[0] == "load"
    assert end_of_life(runs[0], calibrated(), Failure(0.8), None) == Failure(0.8)
    with pytest.raises(InputError, match="largest_load"):
        end_of_life(runs[0], calibrated(), None, -1.0)


def test_runs_without_a_time_or_of_another_axis_are_refused():
    runs = history(DAYS[:5])
    with pytest.raises(InputError, match="one axis"):
        monitor([*runs, replace(runs[0], axis="another", id="x")], calibrated())
    with pytest.raises(InputError, match="has no time"):
        monitor([replace(runs[0], measured_at=None)], calibrated())
    with pytest.raises(InputError):
        monitor([], calibrated())


def test_an_infinite_duty_is_refused():
    with pytest.raises(InputError, match="travel of a day"):
        monitor(history(DAYS[:5]), calibrated(), duty=math.inf)


def test_a_run_given_twice_counts_once():
    runs = history(DAYS[:5])
    assert len(monitor([*runs, runs[2]], calibrated()).state.runs) == 5
    with pytest.raises(InputError, match="given twice"):
        monitor([*runs, replace(runs[2], temperature_C=30.0)], calibrated())


def test_the_evidence_on_temperature_without_temperatures(result):
    cause = next(cause for cause in result.state.causes if cause.cause == "temperature")
    assert cause.evidence == "unclear: no run has a temperature"


def test_the_text_names_a_newest_run_that_was_set_aside():
    runs = history(range(8))
    found = monitor(runs, calibrated())
    assert "<Monitored> bench: normal" in str(found).splitlines()[0]
    (odd,) = history((9.0,), seed=5)
    found = monitor([*runs, replace(odd, mass_kg=130.0)], calibrated())
    assert found.state.runs[-1].state == "suspect"
    assert "before the newest run, which was set aside" in str(found).splitlines()[0]
