"""``monitor``: an axis over its runs, from the first good one to the end."""

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

DAYS = tuple(float(day) for day in range(0, 63, 3))


@pytest.fixture(scope="module")
def result():
    """Ten runs in health, then worn by the law of the contact pressure: P is half at day 30 + 24.8."""
    return monitor(history(DAYS[:16], worn(27.0, 120.0)), calibrated(), duty=10_000.0)


def test_an_axis_that_wears_alarms_and_its_end_is_forecast(result):
    assert result.state.state == "alarm"
    assert result.state.alarm_at is not None
    assert result.prognosis is not None
    true = 27 + 120 * (1 - 0.5 ** (1 / 3)) - DAYS[15]
    low, high = result.prognosis.rul_days[0.05], result.prognosis.rul_days[0.95]
    assert low < true < high < low + 3 * true
    assert result.prognosis.rul_travel_m[0.05] == pytest.approx(10_000 * low)


def test_the_document_has_the_keys_that_stay(result):
    document = result.to_json()
    assert {"runs", "alarm_at", "stage", "causes", "rul_days", "rul_travel_m"} <= document.keys()
    assert document["runs"][0].keys() >= {"measured_at", "state", "relative_to_baseline"}
    assert set(document["rul_days"]["quantiles"]) >= {"0.05", "0.5", "0.95"}
    assert document["prognosis"]["failure"]["mode"] == "preload"
    assert sum(cause["probability"] for cause in document["causes"]) == pytest.approx(1)


def test_a_sound_axis_is_given_no_end():
    result = monitor(history(DAYS), calibrated())
    assert result.state.state == "normal"
    assert result.state.alarm_at is None
    assert result.prognosis.rul_days[0.95] is None


def test_no_end_is_forecast_of_an_axis_that_has_grown_stiffer():
    """A nut was replaced, and nobody said so: the alarm may still stand, and the life is another's."""
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


def test_the_order_of_the_files_is_nothing():
    runs = history(DAYS[:12], worn(20.0, 150.0))
    one, other = (monitor(each, calibrated()) for each in (runs, runs[::-1]))
    assert one.to_json() == other.to_json()


def test_a_new_nut_begins_anew_and_the_old_history_stays():
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


def test_lost_motion_is_carried_along():
    runs = history(DAYS[:6])
    lost = [
        replace(run, lost_motion=tuple(LostMotion(x, size, 2e-8, 3) for x in (0.09, 0.18, 0.27)))
        for run, size in zip(runs, (5e-7,) * 5 + (4e-6,), strict=True)
    ]
    epoch = epoch_history(health_state(lost, calibrated()), calibrated())
    assert epoch.backlash[-1] == pytest.approx(3.5e-6)
    assert epoch.resolution > 0


def test_a_largest_load_takes_the_preload_of_the_epoch():
    runs = history(DAYS[:5])
    state = health_state(runs, calibrated())
    end = end_of_life(state, runs, calibrated(), None, 1200.0)
    assert end.preload == pytest.approx(MODEL.preload, rel=0.02)
    assert end.mode(1e-5)[0] == "load"
    assert end_of_life(state, runs, calibrated(), Failure(0.8), None) == Failure(0.8)
    with pytest.raises(InputError, match="largest_load"):
        end_of_life(state, runs, calibrated(), None, -1.0)


def test_what_does_not_belong_together_is_refused():
    runs = history(DAYS[:5])
    with pytest.raises(InputError, match="one axis"):
        monitor([*runs, replace(runs[0], axis="another", id="x")], calibrated())
    with pytest.raises(InputError, match="has no time"):
        monitor([replace(runs[0], measured_at=None)], calibrated())
    with pytest.raises(InputError):
        monitor([], calibrated())


def test_a_duty_must_be_some():
    with pytest.raises(InputError, match="travel of a day"):
        monitor(history(DAYS[:5]), calibrated(), duty=math.inf)


def test_one_run_says_one_thing():
    runs = history(DAYS[:5])
    assert len(monitor([*runs, runs[2]], calibrated()).state.runs) == 5
    with pytest.raises(InputError, match="given twice"):
        monitor([*runs, replace(runs[2], temperature_C=30.0)], calibrated())


def test_a_temperature_that_nobody_recorded_is_not_called_learnt(result):
    cause = next(one for one in result.state.causes if one.cause == "temperature")
    assert cause.evidence == "no run has a temperature"
