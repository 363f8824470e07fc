"""``ballscrew plan`` as a function: the bench's plan (Show 3), JSON, errors."""

from __future__ import annotations

import json
from dataclasses import replace

import h5py
import pytest

import ballscrew
from ballscrew.axis.sheet import Limits
from ballscrew.axis.sheet_file import read_axis
from ballscrew.base.errors import InputError
from ballscrew.base.jsonfile import SCHEMA, write_json
from ballscrew.fcft.excitation import torque_spectrum
from ballscrew.fcft.plan import Motion, Plan, read_plan
from ballscrew.fcft.planned import plan


@pytest.fixture
def planned(bench):
    return plan(bench / "plan.toml", axis=bench / "axis.toml")


def test_the_bench_has_forty_cells(planned):
    assert len(planned.cells) == 40
    assert planned.trip_count == 3
    assert planned.warnings == ()
    assert planned.broken == ()


def test_its_duration_is_that_of_the_recordings(bench, planned):
    for state in ("4", "2"):
        seconds = 0.0
        for path in sorted(bench.glob(f"preload-{state}-percent-trip*.h5")):
            with h5py.File(path) as file:
                seconds += len(file["position"]) / file.attrs["sample_rate"]
        assert planned.duration_s == pytest.approx(seconds, rel=0.03)


def test_nut_load_and_excitation_are_told(planned):
    assert {abs(cell.nut_load) for cell in planned.cells} == {132 * 2.5 + 25, 132 * 2.5 - 25}
    assert max(cell.nut_load_ratio for cell in planned.cells) == pytest.approx(355 / 600)
    assert all(0.85 < cell.excitation < 0.95 for cell in planned.cells)
    (motion,) = planned.motions
    assert motion.nulls == pytest.approx((600,))
    # 317 kg at 2.5 m/s² and 25 N, times lead/2π, and the drag of the nut.
    assert motion.torque == pytest.approx((317 * 2.5 + 25) * 0.01 / 6.2832 + 0.112, abs=0.02)


def test_what_is_expected_is_what_is(bench, planned):
    truth = json.loads((bench / "truth.json").read_text())["preload-4-percent"]["axial_natural_frequency_Hz"]
    for cell in planned.cells:
        true = truth[f"{cell.position:.3f}"]
        assert abs(cell.frequency - true) < 2 * cell.standard_uncertainty


def test_it_is_a_function_of_the_package(bench):
    assert ballscrew.plan is plan
    sheet, test = read_axis(bench / "axis.toml"), read_plan(bench / "plan.toml")
    assert plan(test, axis=sheet).to_json() == plan(bench / "plan.toml", axis=bench / "axis.toml").to_json()


def test_the_json_says_it_all_and_can_be_written(planned):
    document = json.loads(write_json(planned.to_json()))
    assert document["schema"] == SCHEMA
    assert len(document["cells"]) == 40
    assert document["cells"][0]["frequency_Hz"] == pytest.approx(planned.cells[0].frequency)
    assert document["duration_s"] == document["total_s"] == pytest.approx(43.75)
    assert set(document["made"]["inputs"]) == {"axis", "plan"}
    assert document["made"]["settings"]["tolerances"]["rigidity"] == 0.2


def test_every_load_takes_its_time(bench):
    test = replace(read_plan(bench / "plan.toml"), masses=(0.0, 20.0, 50.0), warm_up=2)
    got = plan(test, axis=bench / "axis.toml")
    assert len(got.cells) == 120
    assert got.trip_count == 5
    assert got.to_json()["total_s"] == pytest.approx(3 * got.duration_s)


def test_limits_that_are_not_stated_are_told(bench):
    sheet = read_axis(bench / "axis.toml")
    test = read_plan(bench / "plan.toml")
    assert any("limits.speed, limits.torque" in note for note in plan(test, axis=sheet).notes)
    stated = replace(sheet, limits=Limits(-0.01, 0.46, 0.2, 5.0))
    assert not any("limits." in note for note in plan(test, axis=stated).notes)


def test_limits_that_are_broken_are_told(bench):
    sheet = replace(read_axis(bench / "axis.toml"), limits=Limits(-0.01, 0.40, 0.1, 1.0))
    broken = plan(bench / "plan.toml", axis=sheet).broken
    assert [name for name in ("highest_position", "speed", "torque") if any(name in b for b in broken)] == [
        "highest_position", "speed", "torque",
    ]  # fmt: skip


def test_a_plan_that_leaves_the_screw(bench):
    with pytest.raises(InputError, match="not on the screw"):
        plan(Plan((0.0, 0.6), 1, (0.0,), (Motion(0.15, 2.5, 1500, 0.35),)), axis=bench / "axis.toml")


def test_stops_too_close_for_the_speed(bench):
    with pytest.raises(InputError, match="to accelerate and stop again"):
        plan(Plan((0.0, 0.01), 1, (0.0,), (Motion(0.5, 2.5, 1500, 0.35),)), axis=bench / "axis.toml")


def test_a_varied_motion_is_told_as_it_is_run(bench):
    """On a null the nominal jerk excites nothing; the repetitions do, and the hardest of them counts."""
    null = Motion(0.15, 2.5, 2.5 * 140.0, 0.35)
    sheet = read_axis(bench / "axis.toml")

    def planned_with(motion):
        (one,) = plan(Plan((0.0, 0.225, 0.45), 8, (0.0, 100.0), (motion,)), axis=sheet).motions
        return one

    assert (
        planned_with(replace(null, jerk_spread=1.0)).torque_excitation
        > 3 * planned_with(null).torque_excitation
    )
    triangle = Motion(0.1, 10.0, 500.0, 0.35)
    assert planned_with(replace(triangle, jerk_spread=1.0)).torque > 1.1 * planned_with(triangle).torque


def test_the_least_torque_is_that_of_some_stop_and_load(bench):
    test = replace(read_plan(bench / "plan.toml"), masses=(0.0, 100.0))
    got = plan(test, axis=bench / "axis.toml")
    every = {float(torque_spectrum(got.sheet, test.motions, cell.mass, cell.frequency)) for cell in got.cells}
    assert got.motions[0].torque_excitation == pytest.approx(min(every))


def test_stops_for_the_operator_are_counted(bench):
    test = read_plan(bench / "plan.toml")
    two = replace(test, motions=(*test.motions, replace(test.motions[0], acceleration=1.5)))
    assert any("change 5 times" in note for note in plan(two, axis=bench / "axis.toml").notes)
    assert not any("M0" in note for note in plan(test, axis=bench / "axis.toml").notes)


def test_very_many_repetitions_are_only_too_many_for_two_levels(bench):
    test = replace(read_plan(bench / "plan.toml"), repetitions=60_000)
    assert "60000 repetitions" in plan(test, axis=bench / "axis.toml").levels.reason


def test_a_plan_without_a_jerk_is_noted(bench):
    test = read_plan(bench / "plan.toml")
    noted = {}
    for acceleration_time in (1e-3, 2e-3):
        motion = replace(test.motions[0], jerk=test.motions[0].acceleration / acceleration_time)
        noted[acceleration_time] = plan(replace(test, motions=(motion,)), axis=bench / "axis.toml").notes
    assert any("motion.jerk" in note for note in noted[1e-3])
    assert not any("motion.jerk" in note for note in noted[2e-3])
