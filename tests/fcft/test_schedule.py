from __future__ import annotations

import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ballscrew.base.errors import InputError
from ballscrew.fcft.plan import Motion, Plan, read_plan
from ballscrew.fcft.schedule import duration, move_time, trip_time, trips

MOTION = Motion(0.15, 2.5, 1500.0, 0.35)
VARIED = replace(MOTION, jerk_spread=0.5, start_spread=0.2)


def plan(*motions, repetitions=3, warm_up=0):
    return Plan((0.0, 0.045, 0.1), repetitions, (0.0,), motions, warm_up=warm_up)


def test_warm_up_then_each_repetition_with_every_motion():
    fast = replace(MOTION, speed=0.2)
    order = trips(plan(MOTION, fast, repetitions=2, warm_up=2))
    assert [(trip.repetition, trip.motion) for trip in order] == [
        (0, 0), (0, 0), (1, 0), (1, 1), (2, 0), (2, 1)
    ]  # fmt: skip
    assert [trip.executed for trip in order] == [MOTION] * 3 + [fast, MOTION, fast]


def test_without_a_spread_all_are_alike():
    assert {trip.executed for trip in trips(plan(MOTION, repetitions=50))} == {MOTION}


def test_the_first_has_the_nominal_jerk_and_so_has_the_warm_up():
    warm, first, second, third = trips(plan(VARIED, warm_up=1))
    assert warm.executed == VARIED
    assert first.executed.jerk == 1500.0
    # Halton: 1/2, 1/4, 3/4 in base 2 and 1/3, 2/3, 1/9 in base 3.
    assert [trip.executed.jerk / 1500 for trip in (second, third)] == pytest.approx([1.5**-0.5, 1.5**0.5])
    dwells = [trip.executed.dwell - 0.35 for trip in (first, second, third)]
    assert dwells == pytest.approx([0.2 / 3, 0.4 / 3, 0.2 / 9])


@given(
    repetitions=st.integers(2, 200),
    jerk_spread=st.floats(0, 1),
    start_spread=st.floats(0, 60),
    dwell=st.floats(0, 3600),
)
def test_all_lie_within_the_spread(repetitions, jerk_spread, start_spread, dwell):
    motion = Motion(0.1, 2.0, 900.0, dwell, jerk_spread, start_spread)
    executed = [trip.executed for trip in trips(plan(motion, repetitions=repetitions))]
    for each in executed:
        assert 900 / (1 + jerk_spread) * (1 - 1e-12) <= each.jerk <= 900 * (1 + jerk_spread) * (1 + 1e-12)
        assert dwell <= each.dwell <= dwell + start_spread
        assert (each.speed, each.acceleration) == (0.1, 2.0)
    if jerk_spread > 1e-6:
        assert len({each.jerk for each in executed}) == repetitions
    if start_spread > 1e-6:
        assert len({each.dwell for each in executed}) == repetitions


@pytest.mark.parametrize("repetitions", [8, 16, 32])
def test_any_number_of_them_is_spread_evenly(repetitions):
    executed = [trip.executed for trip in trips(plan(VARIED, repetitions=repetitions))]
    places = sorted((1 + math.log(each.jerk / 1500) / math.log(1.5)) / 2 for each in executed)
    gaps = [b - a for a, b in zip([0.0, *places], [*places, 1.0], strict=True)]
    assert max(gaps) <= 2.001 / repetitions
    assert min(gaps) >= 0.499 / repetitions


def test_only_what_is_asked_for_is_varied():
    jerks = trips(plan(replace(MOTION, jerk_spread=0.5)))
    assert {trip.executed.dwell for trip in jerks} == {0.35}
    starts = trips(plan(replace(MOTION, start_spread=0.5)))
    assert {trip.executed.jerk for trip in starts} == {1500.0}


def test_times_by_hand():
    # Way over speed, plus v/a + a/j = 61.7 ms.
    assert move_time(0.045, MOTION) == pytest.approx(0.3 + 0.06 + 1 / 600)
    assert trip_time(plan(MOTION), MOTION) == pytest.approx(0.2 / 0.15 + 4 * (0.06 + 1 / 600) + 5 * 0.35)
    assert duration(plan(MOTION, warm_up=2)) == pytest.approx(5 * trip_time(plan(MOTION), MOTION))


def test_the_duration_of_a_varied_test():
    test = plan(VARIED)
    assert duration(test) == pytest.approx(sum(trip_time(test, trip.executed) for trip in trips(test)))
    assert duration(test) > duration(plan(MOTION))


def test_the_bench_takes_as_long_as_its_recordings(bench):
    h5py = pytest.importorskip("h5py")
    test = read_plan(bench / "plan.toml")
    with h5py.File(bench / "preload-4-percent-trip1.h5") as file:
        names = []
        file.visit(names.append)
        samples = file[next(name for name in names if name.endswith("torque"))].shape[0]
    assert trip_time(test, test.motions[0]) == pytest.approx(samples / 12_800, rel=0.03)


def test_a_slip_in_the_repetitions_fills_no_memory():
    assert len(trips(plan(MOTION, repetitions=99_999, warm_up=1))) == 100_000
    for test in (
        plan(MOTION, repetitions=100_001),
        plan(MOTION, warm_up=10**4000),
        plan(MOTION, VARIED, repetitions=50_001),
    ):
        with pytest.raises(
            InputError, match=r"^the plan: warm_up and repetitions make .* 100000 or fewer\.$"
        ):
            trips(test)
        with pytest.raises(InputError, match="round trips"):
            duration(test)
