from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from ballscrew.axis.sheet import Limits
from ballscrew.axis.sheet_file import read_axis
from ballscrew.base.errors import InputError
from ballscrew.fcft.plan import Motion, Plan, read_plan
from ballscrew.fcft.profile import profile, set_points
from ballscrew.fcft.schedule import duration, trip_time, trips
from ballscrew.fcft.set_points_csv import write_set_points
from ballscrew.recording.readers.text import TextReader

COLUMNS = ["trip", "repetition", "motion", "time_s", "position_m", "speed_m_per_s", "acceleration_m_per_s2"]


def table(path):
    return TextReader().read(path, COLUMNS)


def test_the_bench_is_read_back_by_our_own_reader(bench, tmp_path):
    plan, sheet = read_plan(bench / "plan.toml"), read_axis(bench / "axis.toml")
    path = write_set_points(plan, sheet, tmp_path / "set points.csv")
    header = TextReader().read_header(path)
    assert [channel.name for channel in header.channels] == COLUMNS
    assert (header.sample_rate, header.started_at) == (1000.0, None)
    got = table(path)
    assert len(got["time_s"]) == round(duration(plan) * 1000) + 1 == 43_751
    np.testing.assert_allclose(got["time_s"], np.arange(len(got["time_s"])) / 1000, atol=1e-9)
    assert set(got["position_m"]) >= set(plan.positions)
    assert (got["position_m"][0], got["position_m"][-1]) == (0.0, 0.0)
    assert np.abs(got["speed_m_per_s"]).max() == pytest.approx(0.15)
    assert np.abs(got["acceleration_m_per_s2"]).max() == pytest.approx(2.5)
    assert b"-0.000000000" not in path.read_bytes()


def test_each_trip_is_the_profile_of_its_own_motion(sheet, tmp_path):
    motions = (Motion(0.15, 2.5, 1500.0, 0.1, 0.5, 0.05), Motion(0.1, 1.0, 700.0, 0.2))
    plan = Plan((0.0, 0.1, 0.3), 2, (50.0,), motions, warm_up=1)
    got = table(write_set_points(plan, sheet, tmp_path / "a.csv", rate=777.7))
    assert np.all(np.diff(got["time_s"]) > 0)
    start, samples = 0.0, 0
    for index, trip in enumerate(trips(plan), start=1):
        mine = got["trip"] == index
        assert set(got["repetition"][mine]) == {trip.repetition}
        assert set(got["motion"][mine]) == {trip.motion}
        time = got["time_s"][mine]
        wanted = set_points(profile(plan, trip.executed), time - start)
        np.testing.assert_allclose(got["position_m"][mine], wanted.position, atol=2e-9)
        np.testing.assert_allclose(got["speed_m_per_s"][mine], wanted.speed, atol=5e-9)
        np.testing.assert_allclose(got["acceleration_m_per_s2"][mine], wanted.acceleration, atol=2e-6)
        assert time[0] - start < 1 / 777 + 1e-9
        start += trip_time(plan, trip.executed)
        samples += int(mine.sum())
    assert samples == len(got["trip"])


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None, max_examples=40)
@given(rate=st.floats(1, 20_000) | st.integers(1, 20_000), dwell=st.floats(0, 0.3), warm_up=st.integers(0, 2))
def test_no_set_point_is_lost_or_written_twice(sheet, tmp_path, rate, dwell, warm_up):
    plan = Plan((0.0, 0.02), 2, (0.0,), (Motion(0.3, 20.0, 5000.0, dwell),), warm_up=warm_up)
    got = table(write_set_points(plan, sheet, tmp_path / "a.csv", rate=rate))
    np.testing.assert_allclose(got["time_s"], np.arange(len(got["time_s"])) / rate, atol=1e-9)
    assert duration(plan) - 1e-6 / rate <= got["time_s"][-1] + 1e-9
    assert got["time_s"][-1] < duration(plan) + 1 / rate + 1e-9
    assert np.all(np.diff(got["trip"]) >= 0)
    assert got["position_m"][-1] == 0


def test_blocks_join_without_a_seam(sheet, tmp_path, monkeypatch):
    plan = Plan((0.0, 0.1), 2, (0.0,), (Motion(0.15, 2.5, 1500.0, 0.1),))
    whole = write_set_points(plan, sheet, tmp_path / "a.csv").read_bytes()
    monkeypatch.setattr("ballscrew.fcft.set_points_csv._BLOCK", 7)
    assert write_set_points(plan, sheet, tmp_path / "b.csv").read_bytes() == whole


def test_names_are_not_in_it(read, sheet, tmp_path):
    hostile = replace(sheet, name="x\n1,2,3 sample rate: 5 Hz", source="start 2020-01-01.toml")
    path = write_set_points(replace(read(), source="%\nsampled 7 kHz"), hostile, tmp_path / "a.csv")
    header = TextReader().read_header(path)
    assert (header.sample_rate, header.started_at) == (1000.0, None)
    assert path.read_bytes().isascii()


@pytest.mark.parametrize("rate", [0, 0.5, -1.0, 1e6, math.nan, math.inf, True, None, "1000"])
def test_an_impossible_rate(read, sheet, tmp_path, rate):
    with pytest.raises(
        InputError, match=r"^the rate is .* Hz; it must be 1 Hz or more and 100000 Hz or less\.$"
    ):
        write_set_points(read(), sheet, tmp_path / "a.csv", rate=rate)
    assert not (tmp_path / "a.csv").exists()


def test_more_rows_than_a_disk_wants(read, sheet, tmp_path):
    with pytest.raises(InputError, match=r"plan\.toml: at 100000 Hz the test has .* rate must be lower"):
        write_set_points(replace(read(), repetitions=1000), sheet, tmp_path / "a.csv", rate=100_000)
    assert not (tmp_path / "a.csv").exists()


@pytest.mark.parametrize(
    "limits",
    [Limits(speed=0.1), Limits(torque=0.1), Limits(highest_position=0.4), Limits(lowest_position=0.1)],
)
def test_an_unsafe_plan_is_not_exported(read, sheet, tmp_path, limits):
    with pytest.raises(InputError, match=r"limits\."):
        write_set_points(read(), replace(sheet, limits=limits), tmp_path / "a.csv")
    assert [path.name for path in tmp_path.iterdir()] == ["plan.toml"]


@pytest.mark.parametrize("path", ["none/a.csv", ".", "a\x00.csv"])
def test_a_place_that_cannot_be_written(read, sheet, tmp_path, monkeypatch, path):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match=r"cannot be written|is a folder"):
        write_set_points(read(), sheet, path)
    assert [path.name for path in tmp_path.iterdir()] == ["plan.toml"]
