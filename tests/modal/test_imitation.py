"""Imitations of a loss of preload in a measured signal: faults put on the transients of a known axis.

The axis is the M axis of the axial model: 102.35 kg on the table's side, 226 kg of rotor, free pole at
181 Hz. A fault is put on what was recorded, and the pipeline reads it: phases, cells, the paper's method,
masses. What is asserted is what was measured so; that coherence stays high is the point of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import bilinear, lfilter
from tests.modal.conftest import STOPS, cell_of, estimate
from tests.modal.plant import Plant, trip, way

from ballscrew.fcft.conditions import Condition
from ballscrew.modal.cell import CellResult
from ballscrew.modal.masses import frf_equivalent_mass
from ballscrew.modal.spectra import frf
from ballscrew.recording.aligned import Aligned
from ballscrew.recording.kinematics import kinematics
from ballscrew.recording.phases import find_phases
from ballscrew.recording.rigid_body import normal_equations, solve
from ballscrew.recording.transients import cut, label

RATE = 12_800.0
POLE = 181.0
M = Plant(rotor=226.0, table=102.35, frequency=POLE, damping=0.03, servo=0.5)
DEPARTURES = (Condition.PA, Condition.NA)


def measured(plant: Plant = M, rate: float = RATE) -> list[Aligned]:
    """Three round trips."""
    return [plant.run(way(trip(STOPS), rate), seed) for seed in range(3)]


def table(trips: Sequence[Aligned]):
    segments = []
    for file, aligned in enumerate(trips):
        segments += cut(aligned, find_phases(kinematics(aligned.position, aligned.rate)), file)
    return label(segments, trips[0], 100.0, None)


def read(trips: Sequence[Aligned], conditions=DEPARTURES) -> list[CellResult]:
    rows = table(trips)
    return [estimate(cell_of(rows, c), c, POLE)[0] for c in conditions]


def frequencies(trips: Sequence[Aligned], conditions=DEPARTURES) -> np.ndarray:
    modes = read(trips, conditions)
    assert [mode.verdict for mode in modes] == ["good"] * len(modes)
    assert min(mode.coherence for mode in modes) > 0.99
    return np.array([mode.frequency_Hz for mode in modes])


def masses(trips: Sequence[Aligned]) -> np.ndarray:
    """From the moving record, and from the FRF below the mode."""
    sums = [normal_equations(kinematics(a.position, a.rate), a.input)[0] for a in trips]
    moving = solve(sums[0] + sums[1] + sums[2]).equivalent_mass
    return np.array([moving, frf_equivalent_mass(table(trips), 1.0, POLE).value])


@pytest.fixture(scope="module")
def sound() -> list[Aligned]:
    return measured()


@pytest.fixture(scope="module")
def true(sound) -> np.ndarray:
    return frequencies(sound)


def test_the_axis_without_a_fault(sound, true):
    np.testing.assert_allclose(true, POLE, rtol=2e-3)
    np.testing.assert_allclose(masses(sound), M.mass, rtol=2e-3)


def late(aligned: Aligned, samples: int) -> Aligned:
    """Every second sample, the force later by so many of the fine ones."""
    size = len(aligned.input) // 2 * 2
    force = np.concatenate([np.full(samples, aligned.input[0]), aligned.input])
    return replace(
        aligned,
        rate=aligned.rate / 2,
        input=force[:size:2],
        position=aligned.position[:size:2],
        response=aligned.response[:, :size:2],
    )


@pytest.mark.parametrize("servo", [0.5, 40.0])
def test_torque_that_comes_half_a_sample_late(servo):
    """39 µs: the highest point of |H| hardly cares."""
    fine = measured(replace(M, servo=servo).quiet, 2 * RATE)
    in_step, behind = (frequencies([late(a, samples) for a in fine]) for samples in (0, 1))
    shift = np.abs(behind - in_step)
    assert shift.max() < 0.05
    assert shift.max() > 0


def test_a_rate_that_is_declared_wrong():
    """6.7 % more of frequency, and coherence has nothing against it; the two masses do, in squares of it."""
    slow = measured(rate=12_000.0)
    declared = [replace(aligned, rate=RATE) for aligned in slow]
    right, wrong = read(slow), read(declared)
    for a, b in zip(right, wrong, strict=True):
        assert b.frequency_Hz / a.frequency_Hz == pytest.approx(RATE / 12e3, abs=1e-3)
        assert b.coherence > 0.999
        assert b.verdict == "good"
    (moving, low), (moving_declared, low_declared) = masses(slow), masses(declared)
    assert moving_declared / moving == pytest.approx((12e3 / RATE) ** 2, rel=1e-3)
    assert low_declared / low == pytest.approx(1.0, abs=5e-3)


def loose(aligned: Aligned, frequency: float, damping: float) -> Aligned:
    """The sensor rides on a spring and a damper of its own."""
    w = 2 * np.pi * frequency
    b, a = bilinear([2 * damping * w, w * w], [1, 2 * damping * w, w * w], aligned.rate)
    return replace(aligned, response=lfilter(b, a, aligned.response))


def test_a_loose_sensor_moves_the_peak_and_not_the_coherence(sound):
    """On a mount at 205 Hz the peak stands 9 % higher. Coherence is blind to it, the phase is not."""
    rows = table([loose(a, 205.0, 0.01) for a in sound])
    for condition in DEPARTURES:
        mode, spectra = estimate(cell_of(rows, condition), condition, POLE)
        curve, f = np.abs(frf(spectra))[0], spectra.frequency
        band = (f > mode.band_Hz[0]) & (f < mode.band_Hz[1])
        peak = f[band][np.argmax(curve[band])]
        assert peak / POLE - 1 == pytest.approx(0.09, abs=0.01)
        assert mode.coherence > 0.99
        assert mode.verdict == "refused"
        assert "the phase at" in mode.reasons[0]


def test_a_loose_sensor_without_a_sign_in_the_result():
    """Under a servo, one on a mount at 205 Hz passes for good, 1.6 % higher than the sensor that is tight."""
    driven = measured(replace(M, servo=40.0))
    tight, on_mount = (
        frequencies(trips, [Condition.PA])[0] for trips in (driven, [loose(a, 205.0, 0.005) for a in driven])
    )
    assert on_mount / tight - 1 == pytest.approx(0.016, abs=0.003)


def test_a_mount_far_above_the_mode_does_nothing(sound, true):
    np.testing.assert_allclose(frequencies([loose(a, 1200.0, 0.1) for a in sound]), true, rtol=5e-4)


@pytest.mark.parametrize("part", [0.95, 1.05])
def test_a_torque_constant_that_is_not_what_it_was(sound, true, part):
    """Nothing on the pole; both equivalent masses change by the same part."""
    other = [replace(aligned, input=part * aligned.input) for aligned in sound]
    np.testing.assert_allclose(frequencies(other), true, rtol=1e-6)
    np.testing.assert_allclose(masses(other), part * masses(sound), rtol=1e-6)


def test_a_torque_constant_that_drifts_while_it_is_measured(sound, true):
    """5 % from trip to trip, as a motor warms: a hundredth of a hertz; the mass is the middle's."""
    warming = [replace(a, input=part * a.input) for a, part in zip(sound, (1.0, 1.05, 1.1), strict=True)]
    np.testing.assert_allclose(frequencies(warming), true, atol=0.02)
    np.testing.assert_allclose(masses(warming), 1.05 * masses(sound), rtol=2e-3)


@pytest.mark.parametrize("signal", ["input", "response"])
def test_a_polarity_that_is_inverted(sound, true, signal):
    other = [replace(aligned, **{signal: -getattr(aligned, signal)}) for aligned in sound]
    np.testing.assert_allclose(frequencies(other), true, rtol=1e-6)
    sign = [-1.0 if signal == "input" else 1.0, 1.0]  # the FRF's mass has no sign
    np.testing.assert_allclose(masses(other), sign * masses(sound), rtol=1e-6)


@pytest.mark.parametrize("scale", [1 / 9.80665, 9.80665, 1e-3])
def test_a_sensor_with_a_wrong_scale(sound, true, scale):
    """The frequency stays. The FRF's mass changes, that of the moving record does not know the sensor."""
    other = [replace(aligned, response=scale * aligned.response) for aligned in sound]
    np.testing.assert_allclose(frequencies(other), true, rtol=1e-6)
    np.testing.assert_allclose(masses(other) / masses(sound), [1.0, 1 / scale], rtol=1e-6)
