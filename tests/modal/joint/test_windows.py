from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.modal.joint.conftest import SmallRun

from ballscrew.modal.joint.guess import whole_mass
from ballscrew.modal.joint.pitching import pitching_mode
from ballscrew.modal.joint.windows import every_few, of_cells, windows


def test_each_cell_is_one_window_of_all_trips(run: SmallRun) -> None:
    w = windows(run.trips, run.marks, 1.0, 80.0, 400.0)
    assert w is not None
    assert len(w.cells) == 12
    assert (w.repetitions == 3).all()
    assert not any(w.dropped)
    assert (w.late <= w.early).all()
    assert len(w.force) == w.first[-1] == w.nut.shape[1]


def test_a_trip_that_moves_unlike_the_others_is_left_out(run: SmallRun) -> None:
    odd = replace(run.trips[1], position=0.8 * run.trips[1].position)
    w = windows((run.trips[0], odd, run.trips[2]), run.marks, 1.0, 80.0, 400.0)
    assert w is not None
    assert (w.repetitions == 2).all()
    assert all(n == 1 for n in w.dropped)


def test_no_mark_no_window(run: SmallRun) -> None:
    assert windows(run.trips, (), 1.0, 80.0, 400.0) is None


def test_two_accelerometers_tell_the_pitching_mode(run: SmallRun) -> None:
    w = windows(run.trips, run.marks, 1.0, 80.0, 450.0)
    assert w is not None
    told = pitching_mode(w, 200.0, 450.0)
    assert told is not None
    assert abs(told[0] - 330.0) < 30.0


def test_one_accelerometer_or_two_alike_tell_nothing(run: SmallRun) -> None:
    w = windows(run.trips, run.marks, 1.0, 80.0, 450.0)
    assert w is not None
    assert pitching_mode(replace(w, nut=w.nut[:1]), 200.0, 450.0) is None


def test_the_whole_mass_is_told_by_torque_and_motion(run: SmallRun) -> None:
    mass = whole_mass(run.trips)
    assert mass is not None
    # 91.5 kg of table and load, and the rotor's share, on a lead of 10 mm.
    assert 0.25 < mass < 0.6


def test_the_cell_that_departs_against_the_way_it_came_is_marked(run: SmallRun) -> None:
    w = windows(run.trips, run.marks, 1.0, 80.0, 400.0)
    assert w is not None
    assert [cell[:2] for cell, turns in zip(w.cells, w.turning, strict=True) if turns] == [(0.3, "NA")]


def test_trips_of_one_way_tell_it_too(run: SmallRun) -> None:
    whole = whole_mass(run.trips)
    half = [
        replace(t, force=t.force[:n], position=t.position[:n], response=t.response[:, :n])
        for t, n in ((t, int(np.argmax(t.position)) + 1) for t in run.trips)
    ]
    assert whole_mass(half) == pytest.approx(whole, rel=0.03)


def test_a_departure_counts_once_friction_has_fallen(run: SmallRun) -> None:
    w = windows(run.trips, run.marks, 1.0, 80.0, 400.0)
    assert w is not None
    for (start, stop), cell in zip(w.spans, w.cells, strict=True):
        if cell[1].endswith("A"):
            assert np.abs(w.speed[start:stop][w.late[start:stop]][0]) > 0.02


def test_a_first_look_leaves_no_condition_out(run: SmallRun) -> None:
    mass = whole_mass(run.trips)
    assert mass is not None
    w = windows(run.trips, run.marks, mass, 90.0, 450.0)
    assert w is not None
    names = [cell[1] for cell in w.cells]
    many = of_cells(w, [names.index(name) for name in sorted(set(names))] * 6)  # every second has two of four
    assert {cell[1] for cell in every_few(many).cells} == set(names)
    assert len(every_few(many).cells) == 8


def test_some_cells_are_those_of_all(run: SmallRun) -> None:
    w = windows(run.trips, run.marks, 1.0, 80.0, 400.0)
    assert w is not None
    some = of_cells(w, (3, 1))
    assert some.cells == (w.cells[3], w.cells[1])
    assert some.pieces == (w.pieces[3], w.pieces[1])
    assert np.array_equal(some.force[: some.first[1]], w.force[slice(*w.spans[3])])
