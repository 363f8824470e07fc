"""The paper's experiments: which machine, which load, which day."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import pytest

from ballscrew.base.errors import InputError
from ballscrew.testbed.example import AXIS, PLAN
from ballscrew.testbed.experiments import bench, multi_level_mass, recorded, run_to_failure
from ballscrew.testbed.run import simulate_run
from ballscrew.testbed.trip import prepared

BENCH = bench(AXIS)


def test_the_papers_run_to_failure():
    runs = run_to_failure(BENCH, replace(PLAN, repetitions=30), 100.0)
    assert [run.day for run in runs] == [3.0 * index for index in range(27)]
    assert [run.name for run in runs[:2]] == ["day-00", "day-03"]
    assert len({run.seed for run in runs}) == 27
    assert runs[0].measured_at == "2024-01-01T08:00Z"
    assert runs[1].measured_at == "2024-01-04T08:00Z"
    least = [float(run.rig.machine.local_preload(PLAN.positions).min()) for run in runs]
    assert least[0] == pytest.approx(AXIS.nominal_preload)
    assert all(a > b for a, b in pairwise(least[:-1]))
    most = [float(run.rig.machine.local_backlash(PLAN.positions).max()) for run in runs]
    # Stage I for fifteen sixteenths of it, then stage II; about the paper's size at the end.
    assert all(value == 0 for run, value in zip(runs, most, strict=True) if run.day < 75)
    assert 0.1e-6 < most[-1] < 0.6e-6
    files, size = recorded(runs)
    assert files == 810
    assert 8e9 < size < 10e9


def test_what_is_announced_is_what_is_written(tmp_path):
    (run,) = multi_level_mass(BENCH, replace(PLAN, positions=PLAN.positions[:3], repetitions=2), [10.0])
    files = simulate_run(run.rig, run.plan, run.load, tmp_path, seed=run.seed)
    count, size = recorded([run])
    assert count == len(files.recordings)
    assert sum(path.stat().st_size for path in files.recordings) == pytest.approx(size, rel=0.05)


def test_the_masses():
    runs = multi_level_mass(BENCH, PLAN, [0.0, 12.5, 50.0], seed=4)
    assert [run.name for run in runs] == ["load-0kg", "load-12.5kg", "load-50kg"]
    assert [run.plan.masses for run in runs] == [(0.0,), (12.5,), (50.0,)]
    assert {run.rig for run in runs} == {BENCH}


def test_days_that_are_no_whole_numbers_have_names_of_their_own():
    runs = run_to_failure(BENCH, PLAN, 0.0, days=2.0, every=0.25)
    assert len({run.name for run in runs}) == len(runs) == 8


@pytest.mark.parametrize(
    "call",
    [
        lambda: multi_level_mass(BENCH, PLAN, []),
        lambda: multi_level_mass(BENCH, PLAN, [1.0, 1.0]),
        lambda: multi_level_mass(BENCH, PLAN, [-1.0]),
        lambda: run_to_failure(BENCH, PLAN, -1.0),
        lambda: run_to_failure(BENCH, PLAN, 1.0, days=float("nan")),
        lambda: run_to_failure(BENCH, PLAN, 1.0, every=0.0),
        lambda: run_to_failure(BENCH, PLAN, 1.0, days=3.0, every=4.0),
    ],
)
def test_numbers_that_cannot_be(call):
    with pytest.raises(InputError):
        call()


def test_wear_lies_where_the_stops_are():
    plan = replace(PLAN, positions=tuple(x + 0.1 for x in PLAN.positions[:8]))
    run = run_to_failure(BENCH, plan, 50.0)[10]
    local = run.rig.machine.local_preload(plan.positions)
    assert local.argmin() not in (0, len(local) - 1)
    assert local.max() / local.min() > 1.2


def test_damping_does_not_change_as_it_wears():
    runs = run_to_failure(BENCH, PLAN, 100.0)
    betas = {prepared(run.rig.machine, run.load, run.plan).structural for run in runs}
    assert len(betas) == 1


@pytest.mark.parametrize(("days", "every"), [(80.0, 1e-9), (1e9, 3.0), (1e5, 1e4)])
def test_more_runs_than_anybody_wants(days, every):
    with pytest.raises(InputError, match="at most"):
        run_to_failure(BENCH, PLAN, 100.0, days=days, every=every)


def test_loads_that_are_nearly_the_same_have_folders_of_their_own():
    runs = multi_level_mass(BENCH, PLAN, [10.000001, 10.000002])
    assert len({run.name for run in runs}) == 2


def test_an_axis_that_no_drive_moves(tmp_path):
    (run,) = multi_level_mass(BENCH, replace(PLAN, repetitions=1), [1e7])
    with pytest.raises(InputError, match="does not follow its set-points"):
        simulate_run(run.rig, run.plan, run.load, tmp_path)
