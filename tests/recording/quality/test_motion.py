from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import bilinear, lfilter, resample_poly
from tests.recording.quality.conftest import codes, findings_of, moved
from tests.recording.synthetic import PLAN, changed, recorded, redeclared, synthetic_trip

from ballscrew.fcft.plan import Motion
from ballscrew.recording.aligned import align
from ballscrew.recording.channels import read_channels
from ballscrew.recording.kinematics import kinematics
from ballscrew.recording.load import read_recording
from ballscrew.recording.phases import find_phases
from ballscrew.recording.quality.delay import compare_with_encoder, derived_responses
from ballscrew.recording.quality.lowband import low_band
from ballscrew.recording.quality.motion import check_motion
from ballscrew.recording.quality.timebase import Timing, check_timing


def test_good_recordings_pass_with_and_without_a_plan(run):
    for recording in run.recordings:
        assert moved(recording, run.plan) == ()
        assert moved(recording) == ()


@pytest.mark.parametrize("trip", [1, 2, 3])
def test_the_bench_in_its_other_state_passes(bench, run, trip):
    recording = read_recording(
        bench / f"preload-2-percent-trip{trip}.h5", read_channels(bench / "channels.toml")
    )
    assert moved(recording, run.plan if len(run.recordings) > 1 else None) == ()


def test_the_real_drive_passes(emps):
    recording = read_recording(emps / "DATA_EMPS.mat", read_channels(emps / "channels.toml"))
    assert moved(recording) == ()


@pytest.mark.parametrize(
    "change",
    [
        {"encoder": 1e-6},
        {"noise": 3.0},
        {"rate": 5000.0},
        {"rate": 25600.0},
        {"override": 1.005},
        {"override": 0.995},
        {"lead_in": 0.25},
        {"load": 0.0},
        {"held": 60.0},
        {"held": 200.0},
        {"seed": 7},
    ],
    ids=str,
)
def test_good_trips_of_other_kinds_pass(change):
    trip = recorded(synthetic_trip(**change), change.get("rate", 12800.0))
    assert moved(trip, PLAN) == ()
    assert moved(trip) == ()


@pytest.mark.parametrize("encoder", [1e-6, 1e-5])
def test_a_coarse_encoder_passes(run, encoder):
    coarse = changed(run.one, lambda _, x: np.round(x / encoder) * encoder, "position")
    assert moved(coarse, run.plan) == ()


def test_three_times_the_noise_passes(run):
    random = np.random.default_rng(1)

    def noisy(source, x):
        return x + 3 * (0.002 if source == "torque" else 0.02) * random.standard_normal(len(x))

    assert moved(changed(run.one, noisy, "torque", "acc1_x", "acc2_x"), run.plan) == ()


@pytest.mark.parametrize("part", [0.05, 0.2, 0.5])
def test_a_record_that_starts_later_passes(run, part):
    late = changed(run.one, lambda _, x: x[int(part * len(x)) :])
    assert moved(late, run.plan) == ()


@pytest.mark.parametrize(("up", "down"), [(25, 64), (2, 1)])
def test_other_rates_pass(run, up, down):
    def resampled(_, x):
        return resample_poly(x, up, down, padtype="line")

    other = redeclared(changed(run.one, resampled), 12800.0 * up / down)
    assert moved(other, run.plan) == ()


@pytest.mark.parametrize("declared", [6400.0, 10000.0, 12000.0, 13500.0, 25600.0])
def test_a_wrong_rate_is_bad_and_the_right_one_is_reported(run, declared):
    findings = moved(redeclared(run.one, declared), run.plan)
    assert codes(findings)["rate"] == "bad"
    assert "scale" not in codes(findings)
    message = next(f.message for f in findings if f.code == "rate")
    assert float(message.split("fits ")[1].split(" Hz")[0]) == pytest.approx(12800.0, rel=0.005)


@pytest.mark.parametrize("declared", [12600.0, 13010.0])
def test_a_rate_wrong_by_one_and_a_half_per_cent_is_found(run, declared):
    assert codes(moved(redeclared(run.one, declared), run.plan)) == {"rate": "suspect"}


def test_data_resampled_under_a_rate_that_stayed_are_bad(run):
    slower = changed(run.one, lambda _, x: resample_poly(x, 15, 16, padtype="line"))
    assert codes(moved(slower, run.plan))["rate"] == "bad"


@pytest.mark.parametrize("declared", [10000.0, 12000.0, 13500.0])
def test_without_a_plan_the_accelerometer_sees_a_wrong_rate(run, declared):
    findings = moved(redeclared(run.one, declared))
    assert codes(findings) == {"scale": "suspect"}
    assert "or the sample rate by" in findings[0].message


@pytest.mark.parametrize("override", [0.8, 0.9, 1.05])
def test_a_speed_override_is_not_taken_for_a_wrong_rate(override):
    findings = moved(recorded(synthetic_trip(override=override)), PLAN)
    assert codes(findings) == {"speed": "suspect"}
    assert f"speed {100 * (override - 1):+.1f} %" in findings[0].message


def test_another_acceleration_than_planned_is_reported():
    (motion,) = PLAN.motions
    other = replace(PLAN, motions=(replace(motion, acceleration=2.0, jerk=1200.0),))
    assert codes(moved(recorded(synthetic_trip(other)), PLAN)) == {"acceleration": "suspect"}


@pytest.mark.parametrize(("factor", "severity"), [(1.1, "suspect"), (1e-3, "bad"), (1e3, "bad")])
def test_a_position_in_another_unit_is_reported(run, factor, severity):
    findings = moved(changed(run.one, lambda _, x: factor * x, "position"), run.plan)
    assert ("bad" if any(f.severity == "bad" for f in findings) else "suspect") == severity
    assert any("position is scaled wrongly" in f.message for f in findings)


def test_an_accelerometer_in_another_unit_does_not_move_the_frequency(run):
    findings = moved(changed(run.one, lambda _, x: x / 9.80665, "acc1_x", "acc2_x"), run.plan)
    assert codes(findings) == {"scale": "suspect"}
    assert "as if its unit were g, which does not move the frequency" in findings[0].message


@pytest.mark.parametrize("shift", [3, -3, 5, -5, 10, 40, -40, 100, -100])
def test_a_shifted_torque_is_out_of_step_and_by_how_much(run, shift):
    late = changed(run.one, lambda _, x: np.roll(x, shift), "torque")
    findings = [f for f in moved(late, run.plan) if f.code == "delay"]
    assert findings[0].severity == ("bad" if abs(shift) >= 40 else "suspect")
    assert ("the torque comes" if shift > 0 else "the acceleration comes") in findings[0].message
    reported = float(findings[0].message.split("comes ")[1].split(" ms")[0])
    assert reported == pytest.approx(abs(shift) / 12.8, abs=0.08)


@pytest.mark.parametrize("shift", [2, -2])
def test_two_samples_are_found(run, shift):
    late = changed(run.one, lambda _, x: np.roll(x, shift), "torque")
    assert codes(moved(late, run.plan)) == {"delay": "suspect"}


def delay_of(recording):
    aligned = align(recording)
    band = low_band(aligned, find_phases(kinematics(aligned.position, aligned.rate)))
    return compare_with_encoder(band, derived=derived_responses(aligned)).delay


@pytest.mark.parametrize(
    "change", [{}, {"held": 60.0}, {"rate": 5000.0}, {"noise": 5.0}, {"damping": 0.08}], ids=str
)
def test_the_delay_of_an_axis_in_step_is_none(change):
    late, scatter = delay_of(recorded(synthetic_trip(**change), change.get("rate", 12800.0)))
    assert abs(late) < 0.05e-3
    assert 0 < scatter < 0.1e-3


def test_the_delay_follows_a_shift_of_either_channel(run):
    late, _ = delay_of(run.one)
    assert abs(late) < 0.06e-3
    torque, _ = delay_of(changed(run.one, lambda _, x: np.roll(x, 20), "torque"))
    response, _ = delay_of(changed(run.one, lambda _, x: np.roll(x, 20), "acc1_x", "acc2_x"))
    assert torque - late == pytest.approx(-20 / 12800, abs=5e-6)
    assert response - late == pytest.approx(20 / 12800, abs=5e-6)


@pytest.mark.parametrize("milliseconds", [-45, 45])
def test_a_long_delay_of_a_channel_is_found(run, milliseconds):
    shift = round(12.8 * milliseconds)
    aligned = align(changed(run.one, lambda _, x: np.roll(x, shift), "acc1_x", "acc2_x"))
    band = low_band(aligned, find_phases(kinematics(aligned.position, aligned.rate)))
    responses = compare_with_encoder(band, derived=(False, False)).responses
    assert [fit.late for fit in responses] == pytest.approx(2 * [milliseconds * 1e-3], abs=0.1e-3)


def test_a_position_that_comes_late_shifts_neither(run):
    late, _ = delay_of(run.one)
    encoder, _ = delay_of(
        changed(run.one, lambda _, x: np.concatenate([x[:1].repeat(26), x[:-26]]), "position")
    )
    assert encoder == pytest.approx(late, abs=0.1e-3)


@pytest.mark.parametrize(
    ("source", "words"),
    [
        ("torque", "torque pushes against"),
        ("acc1_x", "polarity of acceleration:nut-1:x"),
        ("position", "position's polarity"),
    ],
)
def test_an_inverted_channel_is_named(run, source, words):
    findings = moved(changed(run.one, lambda _, x: -x, source), run.plan)
    assert codes(findings) == {"polarity": "suspect"}
    assert len(findings) == 1
    assert words in findings[0].message


@pytest.mark.parametrize("lost", [1, 5, 100, 1000])
def test_samples_dropped_in_motion_are_found(run, lost):
    aligned = align(run.one)
    phases = find_phases(kinematics(aligned.position, aligned.rate))
    at = (phases[4].stop + phases[5].start) // 2 - lost // 2
    findings = moved(changed(run.one, lambda _, x: np.delete(x, slice(at, at + lost))), run.plan)
    assert codes(findings)["dropped"] == "suspect"
    assert "1 samples in full motion" in next(f.message for f in findings if f.code == "dropped")


def test_samples_dropped_at_a_standstill_shorten_a_pause(run):
    aligned = align(run.one)
    phases = find_phases(kinematics(aligned.position, aligned.rate))
    at = (phases[5].stop + phases[6].start) // 2
    findings = moved(changed(run.one, lambda _, x: np.delete(x, slice(at, at + 150))), run.plan)
    assert codes(findings) == {"pause": "suspect"}


def test_samples_dropped_from_one_channel_shift_it_in_the_middle_of_the_record(run):
    def lost(_, x):
        middle = len(x) // 2
        return np.concatenate([x[:middle], x[middle + 30 :], x[-30:]])

    assert "delay-changes" in codes(moved(changed(run.one, lost, "torque"), run.plan))


@pytest.mark.parametrize("frequency", [150.0, 200.0, 300.0])
def test_a_loose_accelerometer_disagrees_with_the_other(run, frequency):
    w = 2 * np.pi * frequency
    mount = bilinear([0.2 * w, w * w], [1.0, 0.2 * w, w * w], 12800.0)
    findings = moved(changed(run.one, lambda _, x: lfilter(*mount, x), "acc1_x"), run.plan)
    assert codes(findings) == {"sensors-disagree": "suspect"}


@pytest.mark.parametrize("source", ["torque", "acc1_x"])
def test_a_channel_of_noise_is_bad(run, source):
    random = np.random.default_rng(2)
    findings = moved(changed(run.one, lambda _, x: 0.02 * random.standard_normal(len(x)), source), run.plan)
    assert codes(findings)["unrelated"] == "bad"


def test_an_exchange_of_torque_and_position_is_named(run):
    values = {str(x.attrs["source"]): run.one.array(name) for name, x in run.one.channels.items()}
    other = {"torque": values["position"], "position": 1e-3 * values["torque"]}
    found = moved(changed(run.one, lambda source, _: other[source], *other), run.plan)
    (finding,) = [each for each in found if each.code == "exchanged"]
    assert finding.severity == "bad"
    assert "torque and position are exchanged: exchange their sources in the channel map" in finding.message


@pytest.mark.parametrize(
    ("one", "other"), [("torque", "acc1_x"), ("torque", "position"), ("acc1_x", "position")]
)
def test_swapped_channels_are_found(run, one, other):
    values = {str(x.attrs["source"]): run.one.array(name) for name, x in run.one.channels.items()}
    swapped = changed(run.one, lambda source, _: values[other if source == one else one], one, other)
    assert findings_of(swapped, run.plan) != ()


def test_an_axis_that_stands_is_bad(run):
    random = np.random.default_rng(3)
    still = changed(run.one, lambda _, x: x[0] + 5e-8 * np.round(random.standard_normal(len(x))), "position")
    findings = moved(still, run.plan)
    assert any(f.severity == "bad" for f in findings)
    assert moved(changed(run.one, lambda _, x: 0 * x, "position"), run.plan)[0].code == "no-motion"


@pytest.mark.parametrize(("factor", "words"), [(1.0, "the sample rate is wrong"), (1e-3, "unit is wrong")])
def test_a_motion_in_which_no_phase_is_found_is_reported_with_a_guess(run, factor, words):
    aligned = align(changed(run.one, lambda _, x: factor * x, "position"))
    motion = kinematics(aligned.position, aligned.rate)
    (finding,) = check_motion(run.one, aligned, motion, (), run.plan)
    assert (finding.severity, finding.code) == ("bad", "no-motion")
    assert words in finding.message


def test_two_trips_in_one_file_pass(run):
    def twice(source, x):
        return np.concatenate([x, x]) if source != "position" else np.concatenate([x, x - x[0] + x[-1]])

    assert codes(moved(changed(run.one, twice), run.plan)) in ({}, {"pause": "suspect"})


@pytest.mark.parametrize("size", [20, 100, 1000, 5000, 9000, 12000, 20000])
def test_a_short_record_raises_nothing(run, size):
    moved(changed(run.one, lambda _, x: x[:size]), run.plan)


@pytest.mark.parametrize("rate", [10.0, 50.0, 200.0, 60000.0])
def test_any_rate_raises_nothing(run, rate):
    moved(redeclared(run.one, rate), run.plan)


@pytest.mark.parametrize("value", [np.nan, np.inf, 1e200])
def test_samples_that_the_first_part_refuses_raise_nothing(run, value):
    recording = run.one
    aligned = align(recording)
    motion = kinematics(aligned.position, aligned.rate)
    phases = find_phases(motion)
    broken = aligned.input.copy()
    broken[5000] = value
    check_motion(recording, replace(aligned, input=broken), motion, phases, run.plan)


@pytest.mark.parametrize("source", ["torque", "acc1_x"])
def test_flat_channels_raise_nothing(run, source):
    moved(changed(run.one, lambda _, x: 0 * x, source), run.plan)


def test_a_single_derived_response_and_a_current_are_enough(run):
    trip = run.one
    position, rate = trip.array("position"), trip.rate("position")
    own = np.concatenate([[0.0], np.diff(position, 2), [0.0]]) * rate**2
    derived = trip.channels["acceleration:nut-1:x"].copy(data=own)
    derived.attrs.update(derived=True, location="motor")
    current = trip.channels["torque"].copy(data=trip.array("torque") / 0.6)
    current.attrs.update(quantity="current", unit="A")
    channels = {"current": current, "position": trip.channels["position"], "acceleration:motor:x": derived}
    other = replace(trip, channels=channels)
    assert moved(other, run.plan) == ()
    assert "unrelated" not in codes(moved(redeclared(other, 12000.0), run.plan))
    assert codes(moved(redeclared(other, 12000.0), run.plan))["rate"] == "bad"


def test_several_motions_are_each_compared_with_their_own():
    slow = Motion(0.08, 1.2, 700.0, 0.2)
    both = replace(PLAN, motions=(*PLAN.motions, slow))
    for motion in both.motions:
        trip = recorded(synthetic_trip(replace(PLAN, motions=(motion,))))
        assert moved(trip, both) == ()


def test_dwell_and_accelerometer_show_a_wrong_rate_where_a_soft_servo_smears_the_phases():
    """12.8 kHz declared, 12.0 true: the speed is 6.7 % high, the acceleration's time hardly short."""
    timing = Timing(speed=0.0645, acceleration=0.12, duration=-0.011, dwell=-0.064)
    (finding,), sure = check_timing("f", 12800.0, timing, 0.879)
    assert (finding.severity, finding.code, sure) == ("bad", "rate", True)
    # One of the two alone, beside phases that contradict, is not enough.
    (finding,), _ = check_timing("f", 12800.0, timing, 1.0)
    assert finding.code != "rate"


def test_an_override_is_no_wrong_rate():
    timing = Timing(speed=-0.2, acceleration=-0.4, duration=0.2, dwell=0.0)
    (finding,), _ = check_timing("f", 12800.0, timing, 1.0)
    assert finding.code == "speed"


@pytest.mark.parametrize("part", [0.01, 0.02, 0.25, -0.02])
@pytest.mark.parametrize("sources", [("acc1_x",), ("acc1_x", "acc2_x")])
def test_an_accelerometer_across_the_screw_is_bad_and_not_scaled(run, part, sources):
    findings = moved(changed(run.one, lambda _, x: part * x, *sources), run.plan)
    assert codes(findings) == {"unrelated": "bad"}
    assert len(findings) == len(sources)
    assert "of another direction, or swapped" in findings[0].message


@pytest.mark.parametrize("part", [0.5, 0.9, 1.1, 3.0, 1 / 9.80665, 100.0])
def test_a_scale_that_may_be_one_stays_suspect(run, part):
    findings = moved(changed(run.one, lambda _, x: part * x, "acc1_x", "acc2_x"), run.plan)
    assert codes(findings) == {"scale": "suspect"}


@pytest.mark.parametrize("scale", [0.9, 1.1])
def test_a_scale_of_the_position_is_separated_from_an_override_by_the_accelerometer(scale):
    """A soft servo smears the time of an acceleration, so that it agrees with neither."""
    timing = Timing(speed=np.log(scale), acceleration=0.3, duration=-0.2, dwell=0.002)
    (finding,), _ = check_timing("f", 12800.0, timing, 1 / scale)
    assert (finding.code, "position is scaled wrongly" in finding.message) == ("scale", True)
    (finding,), _ = check_timing("f", 12800.0, timing, 1.0)
    assert finding.code == "speed"


def test_a_rate_that_is_wrong_by_a_per_cent_needs_dwell_and_accelerometer():
    timing = Timing(speed=0.0095, acceleration=0.03, duration=0.01, dwell=-0.0098)
    (finding,), _ = check_timing("f", 12928.0, timing, 0.981)
    assert (finding.severity, finding.code) == ("suspect", "rate")
    assert check_timing("f", 12928.0, timing, 1.0)[0] == []


def test_an_override_of_half_a_per_cent_is_none():
    """Good drives and good accelerometers err as much."""
    timing = Timing(speed=0.005, acceleration=0.01, duration=-0.005, dwell=-0.005)
    assert check_timing("f", 12800.0, timing, 0.985)[0] == []


@pytest.mark.parametrize("scale", [0.97, 1.03, 1.1])
def test_the_ways_show_a_scale_of_the_position_from_override_and_rate(scale):
    """An accelerometer 1 % off and a soft servo make two per cent of scale look like two of the rate."""
    speed = np.log(scale)
    timing = Timing(speed=speed, acceleration=2 * speed, duration=-speed, dwell=0.003, way=speed)
    (finding,), _ = check_timing("f", 12800.0, timing, 1 / scale)
    assert (finding.severity, finding.code) == ("suspect", "scale")
    (finding,), _ = check_timing("f", 12800.0, replace(timing, way=0.0, dwell=-speed), scale**-2)
    assert finding.code == "rate"
    (finding,), _ = check_timing("f", 12800.0, replace(timing, way=0.0, duration=speed), 1.0)
    assert finding.code == "speed"


@pytest.mark.parametrize("scale", [0.96, 1.03])
def test_a_scale_of_the_position_by_some_per_cent_is_one(run, scale):
    findings = moved(changed(run.one, lambda _, x: scale * x, "position"), run.plan)
    assert findings[0].code == "scale"
    assert f"scaled wrongly by {scale:.4g}" in findings[0].message


def test_many_lost_samples_are_reported_where_they_hide_every_move(run):
    random = np.random.default_rng(0)
    size = len(run.one.array("torque"))
    lost = np.zeros(size, bool)
    for start in random.integers(1, size - 200, size=60):
        lost[start : start + 150] = True
    broken = changed(run.one, lambda _, x: x[~lost])
    aligned = align(broken)
    motion = kinematics(aligned.position, aligned.rate)
    assert codes(check_motion(broken, aligned, motion, (), run.plan)) == {
        "dropped": "bad",
        "no-motion": "bad",
    }
