from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from tests.recording.quality.conftest import codes
from tests.recording.synthetic import changed, recorded, synthetic_trip

from ballscrew.recording.channels import read_channels
from ballscrew.recording.load import read_recording
from ballscrew.recording.quality import hum
from ballscrew.recording.quality.signal_faults import clipping, wraps
from ballscrew.recording.quality.signals import _check_noise, check_signals


def test_good_recordings_pass(run):
    for recording in run.recordings:
        assert check_signals(recording) == ()


@pytest.mark.parametrize("state", [2, 4])
@pytest.mark.parametrize("trip", [1, 2, 3])
def test_all_six_bench_files_pass(bench, state, trip):
    channels = read_channels(bench / "channels.toml")
    assert check_signals(read_recording(bench / f"preload-{state}-percent-trip{trip}.h5", channels)) == ()


def test_the_real_drive_passes_with_its_faint_hum(emps):
    assert check_signals(read_recording(emps / "DATA_EMPS.mat", read_channels(emps / "channels.toml"))) == ()


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("source", ["torque", "position", "acc1_x"])
def test_one_sample_that_is_no_number_is_bad(run, value, source):
    def broken(_, x):
        x[len(x) // 3] = value
        return x

    findings = check_signals(changed(run.one, broken, source))
    assert codes(findings)["nan"] == "bad"
    assert run.one.file.name in findings[0].message


def test_nan_and_infinity_are_counted(run):
    def broken(_, x):
        x[:3], x[-2:] = np.nan, np.inf
        return x

    (finding,) = check_signals(changed(run.one, broken, "acc2_x"))
    assert "acceleration:nut-2:x has 3 NaN and 2 infinite among" in finding.message


@pytest.mark.parametrize("source", ["torque", "position", "acc1_x"])
@pytest.mark.parametrize("level", [0.0, 0.7])
def test_a_flat_channel_is_bad(run, source, level):
    findings = check_signals(changed(run.one, lambda _, x: np.full_like(x, level), source))
    assert codes(findings) == {"flat": "bad"}


@pytest.mark.parametrize("part", [0.5, 0.6, 0.7, 0.8, 0.9, 0.95])
@pytest.mark.parametrize("source", ["torque", "acc1_x"])
def test_clipping_is_found_and_reported_with_its_limit(run, part, source):
    limit = part * np.abs(run.one.array("torque" if source == "torque" else "acceleration:nut-1:x")).max()
    findings = check_signals(changed(run.one, lambda _, x: np.clip(x, -limit, limit), source))
    assert set(codes(findings)) == {"clipped"}
    assert f"±{limit:.3g}" in findings[0].message
    if part <= 0.7:
        assert findings[0].severity == "bad"


def test_clipping_on_one_side_is_found(run):
    top = 0.8 * run.one.array("torque").max()
    findings = check_signals(changed(run.one, lambda _, x: np.minimum(x, top), "torque"))
    assert f"clipped at {top:.3g} N m" in findings[0].message


def test_clipping_survives_a_scale_that_was_put_on_it(run):
    def scaled(_, x):
        limit = 0.8 * np.abs(x).max()
        return np.clip(x, -limit, limit).astype(np.float32) * 0.1234567

    assert "clipped" in codes(check_signals(changed(run.one, scaled, "acc1_x")))


@pytest.mark.parametrize("bits", [8, 12, 16])
def test_a_coarse_converter_is_not_clipping(run, bits):
    def quantised(_, x):
        step = np.ptp(x) / 2**bits
        return np.round(x / step) * step

    assert check_signals(changed(run.one, quantised, "torque", "acc1_x", "acc2_x")) == ()


def test_a_whole_number_that_overflows_is_bad(run):
    def wrapped(_, x):
        limit = 0.8 * np.abs(x).max()
        return (x + limit) % (2 * limit) - limit

    for source in ("torque", "acc1_x"):
        assert codes(check_signals(changed(run.one, wrapped, source)))["wrapped"] == "bad"


def test_a_position_counter_that_overflows_is_bad(run):
    def wrapped(_, x):
        return x % (0.6 * x.max())

    assert codes(check_signals(changed(run.one, wrapped, "position")))["wrapped"] == "bad"


@pytest.mark.parametrize("count", [1, 5, 40])
def test_single_samples_that_jump_are_found(run, count):
    def spiked(_, x):
        at = np.linspace(1000, len(x) - 1000, count).astype(int)
        x[at] += 0.8 * np.ptp(x)
        return x

    found = codes(check_signals(changed(run.one, spiked, "acc1_x")))
    assert "spike" in found or "wrapped" in found


@pytest.mark.parametrize("fill", ["hold", "zero", "line"])
@pytest.mark.parametrize("source", ["torque", "acc1_x"])
def test_lost_samples_that_were_filled_in_are_found(run, fill, source):
    def filled(_, x):
        gap = slice(len(x) // 3, len(x) // 3 + 40)
        x[gap] = {"hold": x[gap.start], "zero": 0.0, "line": np.linspace(x[gap.start], x[gap.stop], 40)}[fill]
        return x

    findings = check_signals(changed(run.one, filled, source))
    assert codes(findings)["stuck"] == "suspect"
    assert "has 1 span," in next(f.message for f in findings if f.code == "stuck")


def test_many_lost_samples_are_bad(run):
    def filled(_, x):
        for start in range(5000, len(x) - 5000, 4000):
            x[start : start + 100] = x[start]
        return x

    assert codes(check_signals(changed(run.one, filled, "acc1_x")))["stuck"] == "bad"


def test_a_quiet_torque_at_standstill_is_not_stuck():
    signals = synthetic_trip(noise=1.0)
    moves = np.abs(np.gradient(signals["position"])) > 1e-7
    quiet = {**signals, "torque": np.where(moves, signals["torque"], 0.123)}
    assert "stuck" not in codes(check_signals(recorded(quiet)))


@pytest.mark.parametrize("width", [0.01, 0.05])
def test_a_torque_that_ignores_small_changes_is_suspect(run, width):
    def behind_a_dead_band(_, x):
        last = x[0]
        for index, value in enumerate(x.tolist()):
            last = min(max(last, value - width / 2), value + width / 2)
            x[index] = last
        return x

    findings = check_signals(changed(run.one, behind_a_dead_band, "torque"))
    assert codes(findings)["dead-band"] == "suspect"


@pytest.mark.parametrize("change", ["rounded", "slow"])
def test_coarse_and_slow_torques_have_no_dead_band(run, change):
    def coarse(_, x):
        return np.round(x / 0.05) * 0.05 if change == "rounded" else x[np.arange(len(x)) // 5 * 5]

    assert "dead-band" not in codes(check_signals(changed(run.one, coarse, "torque")))


def test_a_torque_that_the_drive_updates_slowly_is_not_stuck(run):
    def held(_, x):
        return np.repeat(x[::8], 8)[: len(x)]

    assert "stuck" not in codes(check_signals(changed(run.one, held, "torque")))


@pytest.mark.parametrize("frequency", [50.0, 49.95, 60.02, 100.0, 149.9, 180.0])
@pytest.mark.parametrize("part", [0.05, 0.3])
@pytest.mark.parametrize("source", ["torque", "acc1_x"])
def test_mains_hum_is_found_with_its_frequency(run, frequency, part, source):
    def humming(_, x):
        return x + part * x.std() * np.sin(2 * np.pi * frequency * np.arange(len(x)) / 12800 + 1)

    findings = check_signals(changed(run.one, humming, source))
    assert set(codes(findings)) == {"hum"}
    reported = float(findings[0].message.split("hums at ")[1].split(" Hz")[0])
    assert abs(reported - frequency) < 0.1


@pytest.mark.parametrize("frequency", [46.0, 55.0, 70.0, 137.0])
def test_a_line_that_is_not_the_mains_is_no_hum(run, frequency):
    def humming(_, x):
        return x + 0.1 * x.std() * np.sin(2 * np.pi * frequency * np.arange(len(x)) / 12800)

    assert "hum" not in codes(check_signals(changed(run.one, humming, "torque", "acc1_x")))


@pytest.mark.parametrize("held", [96.3, 99.0, 100.0, 118.0, 119.6, 120.0, 150.0])
@pytest.mark.parametrize("override", [1.0, 1.005, 1.03])
@pytest.mark.parametrize("damping", [0.01, 0.03])
def test_an_axis_that_rings_at_a_harmonic_of_the_mains_does_not_hum(held, override, damping):
    signals = synthetic_trip(held=held, override=override, damping=damping)
    assert check_signals(recorded(signals)) == ()


@pytest.mark.parametrize(
    "change",
    [
        {"encoder": 1e-6},
        {"noise": 3.0},
        {"rate": 5000.0},
        {"rate": 25600.0},
        {"override": 1.005},
        {"lead_in": 0.25},
        {"load": 0.0},
        {"held": 60.0},
    ],
    ids=str,
)
def test_good_trips_of_other_kinds_pass(change):
    assert check_signals(recorded(synthetic_trip(**change), change.get("rate", 12800.0))) == ()


def test_rates_that_contradict_each_other_are_bad(run):
    findings = check_signals(replace(run.one, declared_rate=12000.0, file_rate=12800.0))
    assert codes(findings) == {"rate": "bad"}
    assert "12000 Hz" in findings[0].message
    assert "12800 Hz" in findings[0].message


def test_rates_that_differ_by_a_rounding_pass(run):
    assert check_signals(replace(run.one, declared_rate=12800.0, file_rate=12800.9)) == ()


def test_a_time_column_that_shows_another_rate_is_bad(run):
    time = np.arange(len(run.one.array("torque"))) / 12000.0
    findings = check_signals(replace(run.one, declared_rate=12800.0, file_rate=None, time=time))
    assert codes(findings) == {"rate": "bad"}


def test_channels_that_are_not_used_are_suspect_only(run):
    trip = run.one
    extra = trip.channels["torque"].copy(data=np.full(len(trip.array("torque")), np.nan))
    extra.attrs.update(quantity="temperature", unit="kelvin", source="T1")
    findings = check_signals(replace(trip, channels={**trip.channels, "temperature": extra}))
    assert codes(findings) == {"nan": "suspect"}


def test_a_derived_channel_is_checked_by_its_origin(run):
    trip = run.one
    derived = trip.channels["acceleration:nut-1:x"].copy(data=np.zeros(len(trip.array("torque"))))
    derived.attrs.update(derived=True)
    assert check_signals(replace(trip, channels={**trip.channels, "acceleration:nut-1:x": derived})) == ()


@pytest.mark.parametrize("size", [1, 2, 3, 16, 63, 64, 65, 200])
def test_a_short_record_is_reported_not_raised(size):
    signals = {name: x[:size] for name, x in synthetic_trip().items()}
    findings = check_signals(recorded(signals, time=np.arange(size) / 12800))
    assert any(f.severity == "bad" for f in findings)


@given(arrays(np.float64, st.integers(1, 300), elements=st.floats(), fill=st.nothing()))
def test_any_numbers_are_checked_without_raising(x):
    for finding in check_signals(recorded(dict.fromkeys(("torque", "position", "acc1_x"), x))):
        assert finding.message.startswith("trip1.h5: ")


@given(arrays(np.float64, st.integers(64, 300), elements=st.sampled_from([0.0, 1.0, -1.0, 0.5])))
def test_signals_of_few_levels_are_checked_without_raising(x):
    check_signals(recorded(dict.fromkeys(("torque", "position", "acc1_x"), x)))


@pytest.mark.parametrize("size", [1e300, 1e-300])
def test_numbers_at_the_edge_of_what_a_number_can_be_raise_nothing(size):
    signals = {name: x * size for name, x in synthetic_trip().items()}
    check_signals(recorded(signals))


def test_noise_that_is_rounded_touches_its_largest_value_and_is_not_clipped(run):
    """Five samples of the highest level, each alone, where the levels below have one each."""

    def touched(_, x):
        top = 1.01 * np.abs(x).max()
        x[np.linspace(2000, len(x) - 2000, 7).astype(int)] = top
        return x

    assert clipping(touched("", run.one.array("torque").copy())) is None


def test_a_highest_level_that_is_met_a_few_times_by_chance_is_not_clipped():
    """As in a good trip of a thousand: five samples on it, three in a row, and one on each of five below."""
    step = 5e-4
    x = np.sin(np.linspace(0, 60, 20_000)) + step * 40
    x = step * np.round(x / step)
    levels = np.array([2, 2, 4, 2, 2, 2, 1, 1, 1, 1, 1])
    high = float(x.max()) + step
    for k, count in enumerate(levels):
        x[500 * (k + 1) : 500 * (k + 1) + 7 * count : 7] = high + k * step
    top = float(x.max()) + 2 * step
    x[[9000, 9008]] = top
    x[9900:9903] = top
    assert clipping(x) is None
    x[9900:9930] = top
    assert clipping(x) is not None


def test_what_stays_at_its_limit_only_now_and_then_is_clipped(run):
    x = run.one.array("torque").copy()
    limit = 0.97 * np.abs(x).max()
    found = clipping(np.clip(x, -limit, limit))
    assert found is not None
    assert found.high == pytest.approx(limit) or found.low == pytest.approx(-limit)


@pytest.mark.parametrize("times", [1.2, 1.5, 3.0])
@pytest.mark.parametrize("source", ["torque", "acc1_x"])
def test_what_overflows_often_is_wrapped_all_the_same(run, times, source):
    def wrapped(_, x):
        half = np.abs(x).max() / times
        return (x + half) % (2 * half) - half

    assert codes(check_signals(changed(run.one, wrapped, source)))["wrapped"] == "bad"


def test_noise_about_a_limit_at_which_it_overflows_is_wrapped():
    x = 1.0 + 0.01 * np.random.default_rng(0).standard_normal(5000)
    assert len(wraps((x + 1) % 2 - 1)) > 1000


def test_a_position_faster_than_any_ball_screw_is_scaled_wrongly():
    """Millimetres taken for metres need neither plan nor data sheet."""
    found = check_signals(changed(recorded(synthetic_trip()), lambda _, x: 1e3 * x, "position"))
    assert codes(found) == {"scale": "bad"}
    assert "moves at 150 m/s, faster than any ball screw; check its unit and scale" in found[0].message


def test_a_position_of_another_length_says_nothing_of_a_standing_torque():
    """Where the axis moves is then not known for each sample."""
    trip = recorded(synthetic_trip())
    x = trip.channels["torque"]
    values = x.to_numpy().copy()
    values[20_000:24_000] = values[20_000]
    channels = {**trip.channels, "torque": x.copy(data=values)}
    whole = replace(trip, channels=channels)
    assert "flat" in [finding.code for finding in _check_noise(whole, "torque", ["position"])]
    place = trip.channels["position"]
    short = replace(trip, channels={**channels, "position": place[:-5]})
    assert "flat" not in [finding.code for finding in _check_noise(short, "torque", ["position"])]


def test_a_line_of_the_mains_between_two_lines_of_a_spectrum_is_none():
    frequency = np.arange(0.0, 100.0, 0.5) + 0.25
    assert hum._line(frequency, np.ones_like(frequency), 50.0, 1.0) == []
