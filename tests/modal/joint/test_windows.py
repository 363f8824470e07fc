from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from tests.modal.joint.conftest import SmallRun, inertia_of

from ballscrew.axis.model import moving_mass, rotor_mass, screw_part
from ballscrew.modal.joint import windows
from ballscrew.modal.joint.initial import find_pitching_mode, inertia_and_viscous_friction
from ballscrew.modal.joint.signals import TripSignals
from ballscrew.modal.joint.windows import average_windows, band_filter, select_cells, subset
from ballscrew.testbed.example import AXIS, LOAD, example_rig


def test_each_cell_is_one_window_of_all_trips(run: SmallRun) -> None:
    w = average_windows(run.trips, run.transients, 1.0, 80.0, 400.0)
    assert w is not None
    assert len(w.cells) == 12
    assert {len(pieces) for pieces in w.pieces} == {3}
    assert (w.in_motion <= w.from_rest).all()
    assert len(w.force) == w.starts[-1] == w.nut.shape[1]


def test_each_sample_has_the_position_of_its_stop(run: SmallRun) -> None:
    w = average_windows(run.trips, run.transients, 1.0, 80.0, 400.0)
    assert w is not None
    for (start, stop), cell in zip(w.spans, w.cells, strict=True):
        assert w.stop_of_sample[start:stop] == pytest.approx(cell.position - 0.15)  # mean of the stops
    assert len(w.stop_of_sample) == w.starts[-1]


def test_a_window_ends_after_the_last_sample_that_may_be_fitted(run: SmallRun) -> None:
    w = average_windows(run.trips, run.transients, 1.0, 80.0, 400.0)
    assert w is not None
    left_out = w.lengths - np.diff(w.starts)
    arrivals = np.array([cell.condition.endswith("D") for cell in w.cells])
    assert (left_out[arrivals] > 100).all()
    assert not left_out[~arrivals].any()
    for start, stop in w.spans:  # two more for second derivatives
        assert np.flatnonzero(w.from_rest[start:stop])[-1] == stop - start - 3


def test_a_trip_that_moves_unlike_the_others_is_left_out(run: SmallRun) -> None:
    odd = replace(run.trips[1], position=0.8 * run.trips[1].position)
    w = average_windows((run.trips[0], odd, run.trips[2]), run.transients, 1.0, 80.0, 400.0)
    assert w is not None
    assert {len(pieces) for pieces in w.pieces} == {2}


def test_no_mark_no_window(run: SmallRun) -> None:
    assert average_windows(run.trips, (), 1.0, 80.0, 400.0) is None


def test_two_accelerometers_determine_the_pitching_mode(run: SmallRun) -> None:
    w = average_windows(run.trips, run.transients, 1.0, 80.0, 450.0)
    assert w is not None
    found = find_pitching_mode(w, 200.0, 450.0)
    assert found is not None
    assert abs(found[0] - 330.0) < 30.0


def test_one_accelerometer_does_not_determine_it(run: SmallRun) -> None:
    w = average_windows(run.trips, run.transients, 1.0, 80.0, 450.0)
    assert w is not None
    assert find_pitching_mode(replace(w, nut=w.nut[:1]), 200.0, 450.0) is None


def test_inertia_and_viscous_friction_follow_from_torque_and_motion(run: SmallRun) -> None:
    found = inertia_and_viscous_friction(run.trips)
    assert found is not None
    mass, viscous = found
    # 91.5 kg of table and load, and the rotor's share, on a lead of 10 mm.
    assert 0.25 < mass < 0.6
    machine = example_rig().machine
    inertia = float(moving_mass(AXIS, LOAD)) + screw_part(AXIS) + rotor_mass(AXIS)  # kg
    assert viscous == pytest.approx((machine.viscous + machine.motor_viscous) / inertia, rel=0.2)


def test_the_drag_is_the_friction_of_the_axis_over_its_inertia(run: SmallRun) -> None:
    """A sinusoidal motion, with a constant force that is subtracted and a vibration that is no friction."""
    rate, inertia, coulomb, viscous = 2000.0, 200.0, 25.0, 300.0
    time = np.arange(0, 4, 1 / rate)
    position = 0.1 * np.cos(math.pi * time) + 2e-6 * np.sin(2 * math.pi * 150 * time)
    motor = np.gradient(np.gradient(position)) * rate**2
    speed = -0.1 * math.pi * np.sin(math.pi * time)
    friction = coulomb * np.sign(speed) + viscous * speed
    trip = TripSignals(rate, inertia * motor + friction + 4.0, position, np.empty((0, len(time))))
    drag = windows._channels(trip, inertia, 0.0, band_filter(70.0, 400.0, rate))[windows._DRAG]
    moving = (np.abs(speed) > 0.05) & (time > 0.1) & (time < 3.9)
    np.testing.assert_allclose(drag[moving], ((friction + 4.0) / inertia)[moving], atol=0.01)
    w = average_windows(run.trips, run.transients, inertia_of(run.trips), 80.0, 400.0)
    assert w is not None
    assert all(abs(w.drag[start : start + 5]).max() < 0.02 for start, _ in w.spans)


def test_a_constant_force_is_no_drag_where_a_recording_begins_shortly_before_a_motion(run: SmallRun) -> None:
    first = min(row.start_s for row in run.transients if row.file == 0)
    trip = run.trips[0]
    begin = round((first - 0.031) * trip.rate)
    short = replace(
        trip, force=trip.force[begin:], position=trip.position[begin:], response=trip.response[:, begin:]
    )
    rows = tuple(
        replace(row, start_s=row.start_s - begin / trip.rate, stop_s=row.stop_s - begin / trip.rate)
        for row in run.transients
        if row.file == 0
    )
    inertia = inertia_of(run.trips)
    without = average_windows([short], rows, inertia, 80.0, 400.0)
    offset = average_windows([replace(short, force=short.force + 9.0 * inertia)], rows, inertia, 80.0, 400.0)
    assert without is not None
    assert offset is not None
    np.testing.assert_allclose(offset.drag, without.drag, atol=1e-9)


def test_the_cell_that_departs_against_the_way_it_came_is_marked(run: SmallRun) -> None:
    w = average_windows(run.trips, run.transients, 1.0, 80.0, 400.0)
    assert w is not None
    assert [cell[:2] for cell, turns in zip(w.cells, w.reversing, strict=True) if turns] == [(0.3, "NA")]


def test_trips_in_one_direction_determine_the_inertia(run: SmallRun) -> None:
    whole = inertia_and_viscous_friction(run.trips)
    assert whole is not None
    half = [
        replace(t, force=t.force[:n], position=t.position[:n], response=t.response[:, :n])
        for t, n in ((t, int(np.argmax(t.position)) + 1) for t in run.trips)
    ]
    by_half = inertia_and_viscous_friction(half)
    assert by_half is not None
    assert by_half[0] == pytest.approx(whole[0], rel=0.03)


def test_a_departure_counts_once_friction_has_fallen(run: SmallRun) -> None:
    w = average_windows(run.trips, run.transients, 1.0, 80.0, 400.0)
    assert w is not None
    for (start, stop), cell in zip(w.spans, w.cells, strict=True):
        if cell.condition.endswith("A"):
            assert np.abs(w.speed[start:stop][w.in_motion[start:stop]][0]) > 0.02


def test_a_first_look_leaves_no_condition_out(run: SmallRun) -> None:
    mass = inertia_of(run.trips)
    w = average_windows(run.trips, run.transients, mass, 90.0, 450.0)
    assert w is not None
    names = [cell.condition for cell in w.cells]
    many = select_cells(
        w, [names.index(name) for name in sorted(set(names))] * 6
    )  # every second has two of four
    assert {cell.condition for cell in subset(many).cells} == set(names)
    assert len(subset(many).cells) == 8


def test_some_cells_are_those_of_all(run: SmallRun) -> None:
    w = average_windows(run.trips, run.transients, 1.0, 80.0, 400.0)
    assert w is not None
    some = select_cells(w, (3, 1))
    assert some.cells == (w.cells[3], w.cells[1])
    assert some.pieces == (w.pieces[3], w.pieces[1])
    assert np.array_equal(some.force[: some.starts[1]], w.force[slice(*w.spans[3])])


def test_a_window_beyond_the_end_of_a_trip_is_none(run: SmallRun) -> None:
    first, *others = run.transients
    later = replace(first, start_s=1e3, stop_s=1e3 + first.stop_s - first.start_s)
    assert average_windows(run.trips, [later], 1.0, 80.0, 400.0) is None
    w = average_windows(run.trips, [later, *others], 1.0, 80.0, 400.0)
    assert w is not None
    assert len(w.cells) == 12
    assert sorted({len(pieces) for pieces in w.pieces}) == [2, 3]


def test_an_arrival_of_a_table_that_hardly_moves_has_no_window(run: SmallRun) -> None:
    still = [replace(trip, position=1e-6 * trip.position) for trip in run.trips]
    w = average_windows(still, run.transients, 1.0, 80.0, 400.0)
    assert w is not None
    assert {cell.condition for cell in w.cells} == {"PA", "NA"}
    arrivals = [row for row in run.transients if row.condition.endswith("D")]
    assert average_windows(still, arrivals, 1.0, 80.0, 400.0) is None


def test_two_trips_that_move_unlike_each_other_have_no_window(run: SmallRun) -> None:
    odd = replace(run.trips[1], position=0.5 * run.trips[1].position)
    transients = [row for row in run.transients if row.file < 2]
    assert average_windows((run.trips[0], odd), transients, 1.0, 80.0, 400.0) is None
    assert average_windows(run.trips[:2], transients, 1.0, 80.0, 400.0) is not None
