"""Worlds, their true values and the table; no recording is simulated."""

from __future__ import annotations

import json

import numpy as np
import pytest
from benchmarks.other_machines import missing, read
from benchmarks.other_tables import PROMISED, fewest_misses, world_table
from benchmarks.other_worlds import GROUPS, RATIOS, WORLDS, bench, keeps_contact, truth
from scipy.stats import binom

from ballscrew.axis.model import kappa
from ballscrew.testbed.machine import Constants
from ballscrew.testbed.trip import prepared


def _constants(one, machine=None) -> Constants:
    return prepared(machine or one.rig.machine, one.load, one.plan)


def test_every_world_has_its_recordings_and_there_are_fourteen_or_more():
    assert {world.group for world in WORLDS} == set(GROUPS)
    assert len({world.name for world in WORLDS}) == len(WORLDS) >= 14


def _differ(one, machine, other) -> bool:
    same = repr(_constants(one, machine)) == repr(_constants(one, other))
    return not same or machine.motor_ratio != other.motor_ratio


@pytest.mark.parametrize("group", GROUPS)
def test_groups_share_the_recordings_of_equal_machines_only(group):
    one = bench(3, group)
    machine, new = one.rig.machine, bench(3, one.new_as).rig.machine
    assert not _differ(one, machine, new)
    assert _differ(one, machine, bench(3, "as new").rig.machine) == (one.new_as != "as new")
    assert _differ(one, one.later(1.0), machine) == (group != one.new_as)


@pytest.mark.parametrize("group", ["as new", "frame 0.8", "vertical", "ratio 2", "fixed-fixed", "pitching"])
def test_stiffness_is_the_nuts_preload_where_only_the_nut_changes(group):
    for ratio in RATIOS:
        true = truth(bench(1, group), ratio)
        assert (true.stiffness, true.nut) == pytest.approx((ratio, ratio))


def test_a_softer_bearing_is_a_loss_of_stiffness_and_none_of_the_nut():
    one = bench(2, "bearing")
    machine = one.rig.machine
    nut = kappa(machine.sheet) * machine.preload ** (1 / 3)
    softer = (0.9 ** (-1 / 3) - 1) / machine.sheet.bearing.stiffness
    true = truth(one, 1.0)
    assert true.stiffness == pytest.approx((1 + softer * nut) ** -3)
    assert true.nut == 1.0


def test_warmth_and_oil_press_the_nut():
    warm, oiled = (truth(bench(0, group), 0.85) for group in ("gradient", "oil film"))
    assert warm.nut == pytest.approx(warm.stiffness, abs=0.02)
    assert warm.nut > 0.9
    assert oiled.nut == pytest.approx(0.85)
    assert oiled.stiffness > 0.87


def test_an_axis_that_loses_its_pretension_loses_most_of_its_stiffness():
    true = truth(bench(0, "pretension lost"), 1.0)
    assert true.stiffness < 0.3
    assert true.nut == 1.0


def test_rigidity_by_its_convention_is_the_sheets_and_otherwise_another():
    one = bench(0, "as new")
    by_name = {world.name: kappa(world.stated(one.sheet)) / kappa(one.sheet) for world in WORLDS}
    assert by_name["K with clearance, stated so"] == pytest.approx(1.0)
    assert by_name["K with clearance, read as preloaded"] == pytest.approx(3 ** (1 / 3) / 3)
    assert by_name["K preloaded, read as with clearance"] == pytest.approx(3 / 3 ** (1 / 3))
    assert by_name["R_nu,ar, read as preloaded"] == pytest.approx(0.8)
    assert by_name["rigidity of unknown convention"] == pytest.approx(3 ** (-1 / 3))


def test_the_limit_is_the_exact_binomial_one_without_clusters():
    misses = np.zeros(40, dtype=bool)
    misses[:6] = True
    limit = fewest_misses(misses, np.arange(40))
    assert binom.sf(5, 40, limit) == pytest.approx(0.01, rel=1e-6)
    assert fewest_misses(np.zeros(40, dtype=bool), np.arange(40)) == 0.0


def test_misses_of_one_axis_count_less_than_those_of_many():
    together, spread = np.zeros(30, dtype=bool), np.zeros(30, dtype=bool)
    together[:3] = True
    spread[::10] = True
    clusters = np.repeat(np.arange(10), 3)
    assert fewest_misses(together, clusters) < fewest_misses(spread, clusters)


def test_a_weight_beyond_2_83_p_releases_a_flank():
    assert all(keeps_contact(bench(1, "as new"), ratio) for ratio in RATIOS)
    assert [keeps_contact(bench(1, "vertical"), ratio) for ratio in RATIOS] == [True, True, False]


def _row(axis: int, value: float) -> dict:
    result = {
        "true": 0.85,
        "verdict": "good",
        "reasons": [],
        "value": value,
        "interval": [value - 0.05, value + 0.05],
    }
    nut = {"true": 0.85, "verdict": "suspect"}
    return {
        "axis": axis,
        "world": WORLDS[0].name,
        "ratio": 0.85,
        "contact": True,
        "stiffness": result,
        "nut": nut,
    }


def test_the_table_marks_a_world_whose_good_answers_miss():
    lines = world_table([_row(axis, 0.85) for axis in range(10)])
    assert "10 / 0 / 0 | 10 of 10 | 0.000 | ± 0.050" in lines[2]
    assert "0 / 10 / 0 | – | – | –" in lines[2]
    lines = world_table([_row(axis, 0.95) for axis in range(10)])
    assert "**0 of 10**" in lines[2]
    assert PROMISED == 0.05


def test_results_that_are_there_are_not_repeated(tmp_path):
    path = tmp_path / "results.jsonl"
    assert read(path) == []
    path.write_text(json.dumps(_row(0, 0.85)) + "\n", encoding="utf-8")
    jobs = list(missing(read(path), 2, WORLDS[:3]))
    assert [(seed, [world.name for world in worlds]) for seed, worlds in jobs] == [
        (0, [WORLDS[1].name, WORLDS[2].name]),
        (1, [world.name for world in WORLDS[:3]]),
    ]
