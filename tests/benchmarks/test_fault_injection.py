from __future__ import annotations

import math

import numpy as np
import pytest
from benchmarks.fault_injection import FAULTS, RecordedTrips, Setup, inject
from hypothesis import given
from hypothesis import strategies as st

from ballscrew.axis.sheet import Bearing, DataSheet, Drive, Guide, Screw, Table
from ballscrew.base.errors import InputError
from ballscrew.fcft.plan import Motion, Plan
from ballscrew.testbed.machine import Machine
from ballscrew.testbed.trip import Rig

RATE = 12800.0
N = 6400
SHEET = DataSheet(
    name="M",
    support="fixed-free",
    screw=Screw(0.01, 0.0176, 0.0176, 0.65, 0.08, 15e3, 480e6, 0.1, 0.04),
    bearing=Bearing(160e6),
    table=Table(32.0),
    drive=Drive(4.2e-4),
    guide=Guide(25.0),
)
MOTION = Motion(0.15, 2.5, 1500.0, 0.35)
PLAN = Plan((0.0, 0.1, 0.2), 3, (100.0,), (MOTION,))
SETUP = Setup(Rig(Machine(SHEET, 600.0)), PLAN, MOTION, 100.0)


def trip(seed: int) -> dict[str, np.ndarray]:
    random = np.random.default_rng(seed)
    names = ["torque", "position", "current_u"] + [f"acc{i}_{a}" for i in (1, 2) for a in "xyz"]
    return {name: random.standard_normal(N) for name in names}


def run() -> RecordedTrips:
    return RecordedTrips(tuple(trip(seed) for seed in range(3)), RATE)


def with_fault(name: str, strength: float | None = None) -> tuple[RecordedTrips, RecordedTrips]:
    good = run()
    return good, inject(name, good, strength or FAULTS[name].strengths[-1], np.random.default_rng(1))


def generator() -> np.random.Generator:
    return np.random.default_rng(1)


AFTER = [fault.name for fault in FAULTS.values() if fault.on in ("channels", "trips", "rate")]
BEFORE = [fault.name for fault in FAULTS.values() if fault.on == "setup"]


def test_every_fault_of_the_promise_is_in_the_catalogue() -> None:
    promised = (
        "clipped,flat,NaN,Inf,integer wrap,dropped samples,wrong declared rate,swapped axes,inverted,"
        "wrong scale,50 Hz hum,60 Hz hum,missing,torque late,acceleration late,missed repetition,"
        "position not reached,speed override,changed mass,remounted sensor,loose sensor,changed servo gains,"
        "warm axis,cold axis,just greased,two runs in one file,cut file"
    )
    assert [start for start in promised.split(",") if not any(n.startswith(start) for n in FAULTS)] == []


@pytest.mark.parametrize("name", FAULTS)
def test_a_name_is_its_own_and_strengths_are_there(name: str) -> None:
    assert FAULTS[name].name == name
    assert FAULTS[name].strengths


@pytest.mark.parametrize("name", AFTER)
def test_changes_something_and_nothing_in_place(name: str) -> None:
    good, bad = with_fault(name)
    for original, seed in zip(good.trips, range(3), strict=True):
        for channel, values in trip(seed).items():
            assert np.array_equal(original[channel], values)
    same = good.rate == bad.rate and len(good.trips) == len(bad.trips)
    assert not same or any(
        one.keys() != two.keys() or any(not np.array_equal(one[k], two[k]) for k in one)
        for one, two in zip(good.trips, bad.trips, strict=True)
    )


@pytest.mark.parametrize("name", AFTER)
def test_the_same_generator_strikes_the_same_place(name: str) -> None:
    (_, one), (_, two) = with_fault(name), with_fault(name)
    assert one.rate == two.rate
    for a, b in zip(one.trips, two.trips, strict=True):
        assert all(np.array_equal(a[k], b[k], equal_nan=True) for k in a)


@pytest.mark.parametrize("name", AFTER)
def test_all_channels_of_a_trip_stay_of_one_length(name: str) -> None:
    for channels in with_fault(name)[1].trips:
        assert len({len(values) for values in channels.values()}) == 1


@pytest.mark.parametrize("name", [n for n in AFTER if FAULTS[n].on == "channels"])
def test_strikes_only_the_trips_that_are_named(name: str) -> None:
    good = run()
    bad = inject(name, good, FAULTS[name].strengths[-1], generator(), only=[1])
    assert bad.trips[0] is good.trips[0]
    assert bad.trips[2] is good.trips[2]
    assert bad.trips[1] is not good.trips[1]


@pytest.mark.parametrize("name", BEFORE)
def test_a_fault_of_the_setup_changes_the_setup(name: str) -> None:
    assert all(inject(name, SETUP, s, generator()) != SETUP for s in FAULTS[name].strengths)


@given(strength=st.floats(0.01, 0.99))
def test_clipped_keeps_the_remaining_range(strength: float) -> None:
    good, bad = with_fault("clipped torque", strength)
    top = np.max(np.abs(good.trips[0]["torque"]))
    assert np.max(np.abs(bad.trips[0]["torque"])) == pytest.approx((1 - strength) * top)
    assert np.sum(good.trips[0]["torque"] != bad.trips[0]["torque"]) >= 1


def test_flat_has_one_value_to_its_end() -> None:
    x = with_fault("flat torque", 0.25)[1].trips[0]["torque"]
    assert np.ptp(x[-N // 4 :]) == 0
    assert np.ptp(x[: N // 2]) > 1


@given(count=st.integers(1, 500))
def test_so_many_values_are_none(count: int) -> None:
    assert np.isnan(with_fault("NaN", count)[1].trips[0]["torque"]).sum() == count
    assert np.isinf(with_fault("Inf", count)[1].trips[0]["acc1_x"]).sum() == count


def test_a_wrap_is_off_by_whole_ranges() -> None:
    good, bad = with_fault("integer wrap of torque", 4.0)
    x, y = good.trips[0]["torque"], bad.trips[0]["torque"]
    whole = 2 * np.max(np.abs(x)) / 4
    assert np.max(np.abs(y)) <= whole / 2 + 1e-12
    assert np.allclose((x - y) / whole, np.round((x - y) / whole), atol=1e-9)


def test_swapped_axes_are_exchanged() -> None:
    good, bad = with_fault("swapped axes, x and y", 2.0)
    assert np.array_equal(bad.trips[0]["acc2_x"], good.trips[0]["acc2_y"])
    assert np.array_equal(bad.trips[0]["acc2_y"], good.trips[0]["acc2_x"])


def test_polarity_and_scale_are_a_factor() -> None:
    good, bad = with_fault("inverted position")
    assert np.array_equal(bad.trips[0]["position"], -good.trips[0]["position"])
    good, bad = with_fault("wrong scale of both accelerations", 0.1)
    assert np.allclose(bad.trips[0]["acc2_x"], 1.1 * good.trips[0]["acc2_x"])


@pytest.mark.parametrize(("name", "mains"), [("50 Hz hum on torque", 50.0), ("60 Hz hum on torque", 60.0)])
def test_hum_has_its_frequency_and_size(name: str, mains: float) -> None:
    good, bad = with_fault(name, 0.5)
    added = bad.trips[0]["torque"] - good.trips[0]["torque"]
    assert np.std(added) == pytest.approx(0.5 * np.std(good.trips[0]["torque"]), rel=1e-3)
    assert np.argmax(np.abs(np.fft.rfft(added))) * RATE / N == pytest.approx(mains)


def test_a_loose_sensor_rings_at_its_mount() -> None:
    x = {name: np.zeros(N) for name in trip(0)}
    x["acc1_x"][0] = 1.0
    bad = inject("loose sensor", RecordedTrips((x,), RATE), 205.0, generator())
    gain = np.abs(np.fft.rfft(bad.trips[0]["acc1_x"]))
    assert np.argmax(gain) * RATE / N == pytest.approx(205.0, abs=2.1)
    assert gain[0] == pytest.approx(1.0, rel=1e-3)
    assert gain.max() == pytest.approx(10.0, rel=0.02)  # 1 / (2 · 0.05)


def test_a_remounted_sensor_sees_the_other_axis() -> None:
    x = {name: np.zeros(N) for name in trip(0)}
    x["acc1_z"][:] = 1.0
    bad = inject("remounted sensor", RecordedTrips((x,), RATE), math.pi / 6, generator())
    assert bad.trips[0]["acc1_x"][0] == pytest.approx(0.5, rel=0.011)


@given(gaps=st.integers(1, 40))
def test_dropped_samples_shorten_the_record_or_hold_it(gaps: int) -> None:
    good, bad = with_fault("dropped samples", gaps)
    lost = N - len(bad.trips[0]["torque"])
    assert 32 <= lost <= 32 * gaps
    assert set(bad.trips[0]["torque"]) <= set(good.trips[0]["torque"])
    filled = with_fault("dropped samples, filled", gaps)[1].trips[0]["torque"]
    assert len(filled) == N
    assert np.sum(np.diff(filled) == 0) >= 32


def test_dropped_samples_in_one_channel_leave_the_others() -> None:
    good, bad = with_fault("dropped samples in acceleration", 3.0)
    remaining = len(bad.trips[0]["torque"])
    assert remaining < N
    assert np.array_equal(good.trips[0]["torque"][:remaining], bad.trips[0]["torque"])
    assert not np.array_equal(good.trips[0]["acc1_x"][:remaining], bad.trips[0]["acc1_x"])


def test_late_is_late_by_so_much() -> None:
    good, bad = with_fault("torque late", 10 / RATE)
    assert np.allclose(bad.trips[0]["torque"], good.trips[0]["torque"][:-10])
    assert np.array_equal(bad.trips[0]["acc1_x"], good.trips[0]["acc1_x"][10:])


def test_another_clock_drifts_away() -> None:
    x = {name: np.arange(N, dtype=float) for name in trip(0)}
    bad = inject("acceleration on another clock", RecordedTrips((x,), RATE), 1e-3, generator())
    assert bad.trips[0]["acc2_x"][-1] == pytest.approx((N - 1) / 1.001)
    assert bad.trips[0]["torque"][-1] == N - 1


def test_the_rate_is_declared_wrongly_and_the_samples_stay() -> None:
    good, bad = with_fault("wrong declared rate", 0.01)
    assert bad.rate == pytest.approx(1.01 * RATE)
    assert bad.trips is good.trips


def test_trips_are_missed_but_one() -> None:
    assert len(with_fault("missed repetition", 1.0)[1].trips) == 2
    assert len(with_fault("missed repetition", 9.0)[1].trips) == 1


def test_two_runs_follow_one_another() -> None:
    good, bad = with_fault("two runs in one file", 1.0)
    both = np.concatenate([good.trips[0]["torque"], good.trips[1]["torque"]])
    assert np.array_equal(bad.trips[0]["torque"], both)
    assert bad.trips[1] is good.trips[1]


def test_a_cut_record_and_a_cut_file_are_shorter() -> None:
    assert len(with_fault("cut record", 0.25)[1].trips[0]["torque"]) == N * 3 // 4
    assert inject("cut file", b"12345678", 0.5, generator()) == b"1234"


def test_what_runs_is_another_test() -> None:
    assert inject("speed override", SETUP, 0.1, generator()).motion.speed == pytest.approx(0.135)
    assert inject("changed mass", SETUP, -20.0, generator()).load == 80.0
    assert inject("position not reached", SETUP, 0.01, generator()).plan.positions == pytest.approx(
        (0.0, 0.1, 0.19)
    )
    assert inject("position not reached", SETUP, 0.12, generator()).plan.positions == pytest.approx(
        (0.0, 0.08)
    )
    assert inject("changed servo gains", SETUP, 0.5, generator()).rig.servo.speed_bandwidth == 20.0


def test_warmth_cold_and_grease_press_the_nut() -> None:
    warm, cold, greased = (
        inject(name, SETUP, strength, generator()).rig.machine
        for name, strength in (("warm axis", 5.0), ("cold axis", 5.0), ("just greased", 3e-7))
    )
    assert float(cold.local_preload(0.0)) < 600 < float(warm.local_preload(0.0)) < 700
    assert warm.viscous < 120 < cold.viscous
    assert float(greased.local_preload(0.0)) > 600
    assert greased.viscous > 120
    assert float(inject("cold axis", SETUP, 500.0, generator()).rig.machine.local_preload(0.0)) < 1e-6


def test_a_worn_out_nut_stays_one() -> None:
    loose = Setup(Rig(Machine(SHEET, 0.0, backlash=4e-6)), PLAN, MOTION, 100.0)
    machine = inject("just greased", loose, 3e-7, generator()).rig.machine
    assert float(machine.local_preload(0.0)) == 0
    assert 0 < float(machine.local_backlash(0.0)) < 4e-6  # the film takes a part of it


@pytest.mark.parametrize(
    ("name", "strength"),
    [
        ("no such fault", 1.0),
        ("clipped torque", 0.0),
        ("clipped torque", -1.0),
        ("clipped torque", math.nan),
        ("clipped torque", math.inf),
        ("clipped torque", 2.0),
        ("cut record", 1.5),
        ("cut file", 0.5),
        ("speed override", 0.5),
        ("loose sensor", 6400.0),
    ],
)
def test_impossible_options_are_one_sentence(name: str, strength: float) -> None:
    with pytest.raises(InputError) as error:
        inject(name, run(), strength, generator())
    assert str(error.value).endswith(".")


@pytest.mark.parametrize(
    ("name", "strength"),
    [("speed override", 1.0), ("changed mass", -101.0), ("position not reached", 0.2), ("NaN", 1.0)],
)
def test_a_setup_that_cannot_run_is_refused(name: str, strength: float) -> None:
    with pytest.raises(InputError):
        inject(name, SETUP, strength, generator())


def test_a_channel_that_is_not_there_is_named() -> None:
    with pytest.raises(InputError, match="no channel torque to change"):
        inject("clipped torque", RecordedTrips(({"position": np.zeros(9)},), RATE), 0.2, generator())


def test_a_trip_that_is_not_there_is_refused() -> None:
    with pytest.raises(InputError, match="there are 3 trips"):
        inject("NaN", run(), 1.0, generator(), only=[3])


def test_only_the_history_shows_some_strengths() -> None:
    assert FAULTS["changed mass"].only_history(1.0)
    assert not FAULTS["changed mass"].only_history(20.0)
    assert FAULTS["warm axis"].only_history(5.0)
    assert not any(FAULTS["clipped torque"].only_history(x) for x in FAULTS["clipped torque"].strengths)


@pytest.mark.parametrize("name", FAULTS)
def test_hidden_strengths_are_some_of_the_faults_own(name: str) -> None:
    fault = FAULTS[name]
    assert set(fault.hidden) < set(fault.strengths) or not fault.hidden
