from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import trapezoid

from ballscrew.axis.compliance import transmission_ratio
from ballscrew.axis.model import rotor_mass
from ballscrew.base.errors import InputError
from ballscrew.fcft.excitation import (
    blow_spectrum,
    mean_blow_spectrum,
    nulls,
    torque_spectrum,
)
from ballscrew.fcft.expected import executed
from ballscrew.fcft.plan import Motion, Plan
from ballscrew.fcft.profile import planned_transients, profile, set_points

BENCH = Motion(0.15, 2.5, 1500.0, 0.35)
SOFT = Motion(0.15, 2.5, 375.0, 0.35)  # its null is at 150 Hz
TRIANGLE = Motion(0.05, 10.0, 500.0, 0.2)  # too slow for its acceleration
MOTIONS = pytest.mark.parametrize("motion", [BENCH, SOFT, TRIANGLE], ids=["bench", "soft", "triangle"])


def integral(time, value, frequency):
    """∫ value e^(−2πi f t) dt, by trapezoids."""
    waves = np.exp(-2j * np.pi * np.asarray(frequency)[:, None] * time)
    return trapezoid(value * waves, time, axis=1)


def phase_spectrum(frequency, motion):
    """Spectrum of a whole acceleration phase over that at 0 Hz."""
    pulse = np.sinc(np.asarray(frequency) * motion.speed / motion.peak_acceleration)
    return np.abs(pulse) * blow_spectrum(frequency, motion)


def acceleration(motion, condition="PA"):
    """One acceleration phase of a round trip, as the controller is told it."""
    plan = Plan((0.0, 0.1), 1, (0.0,), (motion,))
    phase = next(one for one in planned_transients(plan, motion) if one.condition == condition)
    time = np.linspace(phase.start_s, phase.stop_s, 12_001)
    return time, set_points(profile(plan, motion), time).acceleration


@MOTIONS
@pytest.mark.parametrize("condition", ["PA", "PD", "NA", "ND"])
def test_the_closed_form_is_the_spectrum_of_the_set_points(motion, condition):
    frequency = np.linspace(1.0, 700.0, 90)
    time, value = acceleration(motion, condition)
    numerical = np.abs(integral(time, value, frequency)) / motion.speed  # at 0 Hz it is the speed
    assert numerical == pytest.approx(phase_spectrum(frequency, motion), abs=2e-5)


@MOTIONS
def test_one_blow_is_the_spectrum_of_the_jerk_at_one_end(motion):
    frequency = np.linspace(1.0, 700.0, 90)
    time, value = acceleration(motion)
    first = time <= time[0] + motion.jerk_time * (1 + 1e-9)
    jerk = np.gradient(value[first], time[first])
    numerical = np.abs(integral(time[first], jerk, frequency)) / motion.peak_acceleration
    assert numerical == pytest.approx(blow_spectrum(frequency, motion), abs=2e-3)


@MOTIONS
def test_nulls_lie_at_whole_parts_of_the_jerk_time(motion):
    found = nulls(motion, 1000.0)
    assert found == pytest.approx([k / motion.jerk_time for k in range(1, len(found) + 1)])
    assert found[-1] <= 1000.0 * (1 + 1e-9) < (len(found) + 1) / motion.jerk_time
    assert blow_spectrum(found, motion) == pytest.approx(0.0, abs=1e-12)
    assert blow_spectrum([0.5 / motion.jerk_time], motion) == pytest.approx(2 / math.pi)


def test_the_nulls_of_the_bench():
    assert nulls(BENCH, 1300.0) == pytest.approx((600.0, 1200.0))
    assert nulls(BENCH, 600.0) == pytest.approx((600.0,))
    assert nulls(BENCH, 599.0) == ()


def test_repetitions_that_differ_fill_a_null():
    varied = replace(SOFT, jerk_spread=0.5)
    plan = Plan((0.0, 0.1), 6, (0.0,), (varied,))
    assert blow_spectrum(150.0, SOFT) == pytest.approx(0.0, abs=1e-12)
    assert mean_blow_spectrum(150.0, executed(replace(plan, motions=(SOFT,)), 0)) == pytest.approx(
        0, abs=1e-12
    )
    assert mean_blow_spectrum(150.0, executed(plan, 0)) > 0.1


@given(
    jerks=st.lists(st.floats(10.0, 1e5), min_size=1, max_size=8),
    frequency=st.floats(0.1, 2000.0),
)
def test_the_mean_is_the_root_of_the_mean_square(jerks, frequency):
    motions = [replace(BENCH, jerk=jerk) for jerk in jerks]
    wanted = math.sqrt(sum(float(blow_spectrum(frequency, motion)) ** 2 for motion in motions) / len(jerks))
    assert float(mean_blow_spectrum(frequency, motions)) == pytest.approx(wanted, abs=1e-12)


def test_very_many_repetitions_are_no_more_work_than_many():
    varied = Plan((0.0, 0.1), 5000, (0.0,), (replace(SOFT, jerk_spread=0.5),))
    frequency = np.linspace(50.0, 400.0, 200)
    runs = executed(varied, 0)
    assert len(runs) == 5000
    all_of_them = np.sqrt(np.mean([blow_spectrum(frequency, run) ** 2 for run in runs], axis=0))
    assert mean_blow_spectrum(frequency, runs) == pytest.approx(all_of_them, abs=2e-3)


def test_a_mean_of_nothing_is_refused():
    with pytest.raises(InputError, match="needs one or more"):
        mean_blow_spectrum(100.0, [])


@MOTIONS
def test_the_torque_is_that_of_the_pulse_it_makes(sheet, motion):
    # Two blows of opposite sign, T_a after each other: the whole phase, |2 sin(π f T_a)| times one of them.
    time, value = acceleration(motion)
    mass = sheet.table.mass + 40.0 + rotor_mass(sheet)
    torque = mass * transmission_ratio(sheet.screw.lead) * value
    step = time[1] - time[0]
    padded = np.fft.rfft(torque, 1 << 17) * step
    frequency = np.fft.rfftfreq(1 << 17, step)
    near = (frequency > 20.0) & (frequency < 500.0)
    separation = motion.speed / motion.peak_acceleration
    both = torque_spectrum(sheet, (motion,), 40.0, frequency[near]) * np.abs(
        2 * np.sin(np.pi * frequency[near] * separation)
    )
    assert np.abs(padded[near]) == pytest.approx(both, abs=1e-4 * both.max())


def test_torque_grows_with_load_and_acceleration_and_falls_with_frequency(sheet):
    base = torque_spectrum(sheet, (BENCH,), 0.0, 100.0)
    assert (
        torque_spectrum(sheet, (BENCH,), 100.0, 100.0) > base > torque_spectrum(sheet, (BENCH,), 0.0, 200.0)
    )
    # The same T_j and twice the acceleration: twice the torque.
    twice = replace(BENCH, acceleration=5.0, jerk=3000.0, speed=0.3)
    assert torque_spectrum(sheet, (twice,), 0.0, 100.0) == pytest.approx(2 * base)


@given(frequency=st.floats(0.0, 5000.0), jerk=st.floats(1.0, 1e7))
def test_a_spectrum_is_a_part_of_a_jerk_without_duration(frequency, jerk):
    motion = replace(BENCH, jerk=jerk)
    assert 0.0 <= phase_spectrum(frequency, motion) <= blow_spectrum(frequency, motion) <= 1.0
