"""Trips of one run are compared with each other."""

from __future__ import annotations

from dataclasses import replace

from tests.modal.joint.conftest import SmallRun, small_run
from tests.modal.joint.test_ripple import LEAD, first_fit

from ballscrew.modal.joint.ripple import ForceOrders
from ballscrew.modal.joint.trips import TripShift, trip_shifts, trips_differ
from ballscrew.testbed.trip import Rig


def test_a_trip_of_another_preload_is_named(rig: Rig, run: SmallRun) -> None:
    half = small_run(replace(rig, machine=replace(rig.machine, preload=0.5 * rig.machine.preload)), 1)
    last = tuple(replace(transient, file=3) for transient in half.transients)
    trips = (*run.trips, replace(half.trips[0], name="half.h5"))
    now, mass = first_fit(run)
    reason = trips_differ(trip_shifts(trips, (*run.transients, *last), mass, now, ForceOrders(LEAD)))
    assert reason is not None
    assert reason.kind == "trips-differ"
    assert "half.h5 by -" in reason.text


def test_trips_of_one_state_agree(run: SmallRun) -> None:
    now, mass = first_fit(run)
    shifts = trip_shifts(run.trips, run.transients, mass, now, ForceOrders(LEAD))
    assert [shift.name for shift in shifts] == ["trip 1", "trip 2", "trip 3"]
    assert trips_differ(shifts) is None
    assert trip_shifts(run.trips[:1], run.transients, mass, now, ForceOrders(LEAD)) == ()


def test_a_difference_is_reported_if_it_is_clear_and_not_small() -> None:
    one = TripShift("one", 0.0, 0.001)
    assert trips_differ([one, TripShift("other", 0.002, 1e-5)]) is None
    assert trips_differ([one, TripShift("other", 0.010, 0.004)]) is None
    reason = trips_differ([one, TripShift("other", 0.010, 0.001)])
    assert reason is not None
    assert "one by -1.0 ± 0.1 %, other by +1.0 ± 0.1 %" in reason.text
    assert trips_differ([one]) is None


def test_a_trip_without_transients_is_not_compared(run: SmallRun) -> None:
    now, mass = first_fit(run)
    trips = (*run.trips, replace(run.trips[0], name="aborted"))
    shifts = trip_shifts(trips, run.transients, mass, now, ForceOrders(LEAD))
    assert [shift.name for shift in shifts] == ["trip 1", "trip 2", "trip 3"]
