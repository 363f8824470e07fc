from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ballscrew.recording.quality.timebase import Timing, check_rates, check_time, check_timing, time_rate

TIME = np.arange(20_000) / 12800.0


def test_a_uniform_time_passes():
    assert check_time("a.csv", TIME) == []
    assert time_rate(TIME) == pytest.approx(12800.0)


@pytest.mark.parametrize("start", [0.0, 3.7, 1.7e9])
@pytest.mark.parametrize("digits", [3, 4, 5, 6, 9])
def test_a_uniform_time_with_few_digits_passes(start, digits):
    assert check_time("a.csv", np.round(start + TIME, digits)) == []


def test_a_time_in_single_precision_passes():
    assert check_time("a.csv", TIME.astype(np.float32).astype(np.float64)) == []


@pytest.mark.parametrize("lost", [1, 3, 500])
def test_a_gap_is_reported_with_what_is_missing(lost):
    (finding,) = check_time("a.csv", np.delete(TIME, slice(7000, 7000 + lost)))
    assert finding.code == "dropped"
    assert finding.severity == "suspect"
    assert f"about {lost} samples" in finding.message
    assert "0.5468 s" in finding.message


def test_many_gaps_are_bad():
    (finding,) = check_time("a.csv", np.delete(TIME, np.arange(100, 20_000, 300)))
    assert (finding.severity, finding.code) == ("bad", "dropped")


def test_a_time_that_goes_back_is_bad():
    time = TIME.copy()
    time[5000:] -= 0.2
    (finding,) = check_time("a.csv", time)
    assert (finding.severity, finding.code) == ("bad", "time")
    assert "goes back 1 time, first at 0.3905 s" in finding.message


@pytest.mark.parametrize("time", [np.zeros(1000), TIME[::-1], np.full(1000, np.nan)])
def test_a_time_that_is_none_is_bad(time):
    (finding,) = check_time("a.csv", time)
    assert (finding.severity, finding.code) == ("bad", "time")


def test_a_clock_that_wanders_is_reported():
    bent = TIME + 2e-3 * np.sin(2 * np.pi * TIME)
    (finding,) = check_time("a.csv", bent)
    assert (finding.severity, finding.code) == ("bad", "time")
    assert "not uniform" in finding.message


@pytest.mark.parametrize(
    ("stated", "severity"), [(12800.0, None), (12812.0, None), (12840.0, "suspect"), (12000.0, "bad")]
)
def test_rates_are_compared(stated, severity):
    findings = check_rates("a.h5", 12800.0, {"the channel map says": 12800.0, "the file says": stated})
    assert [f.severity for f in findings] == ([severity] if severity else [])


def test_rates_that_nobody_states_contradict_nothing():
    assert check_rates("a.h5", 12800.0, {"the channel map says": None, "the file says": None}) == []


@given(st.lists(st.floats(), min_size=64, max_size=80))
def test_any_column_of_numbers_is_checked_without_raising(values):
    with np.errstate(all="ignore"):
        for finding in check_time("a.csv", np.array(values)):
            assert finding.message.startswith("a.csv: ")


@pytest.mark.parametrize("time", [np.full(100, np.nan), np.zeros(1)])
def test_times_of_which_none_is_known_have_no_rate(time):
    assert time_rate(time) is None


@pytest.mark.parametrize(
    ("timing", "gain", "codes", "is_sure"),
    [
        (Timing(0.02, 0.04, -0.02, None), None, ["rate"], False),  # no witness: another motion, or the rate
        (Timing(0.02, 0.04, -0.02, -0.02), None, ["rate"], True),
        (Timing(0.06, 0.12, -0.06, 0.0), None, ["speed"], True),
        (Timing(0.2, None, None, None), None, ["speed"], True),
        (Timing(0.2, 0.2, 0.0, None), None, ["scale"], True),
        (Timing(0.0, 0.0, 0.0, 0.0), None, [], True),
        (Timing(None, None, None, None), None, [], False),
    ],
)
def test_the_plan_tells_a_wrong_rate_from_another_speed_or_scale(timing, gain, codes, is_sure):
    findings, confirmed = check_timing("a.h5", 1000.0, timing, gain)
    assert [finding.code for finding in findings] == codes
    assert confirmed is is_sure
    if codes == ["rate"] and not is_sure:
        assert "or another motion was run" in findings[0].message


def test_times_that_are_not_finite_are_left_out_of_the_rate_without_a_warning() -> None:
    time = np.arange(1600) / 100.0
    time[[200, 299]] = np.inf  # with a step of 99 samples, one is subtracted from the other
    assert time_rate(time) == pytest.approx(100.0)
