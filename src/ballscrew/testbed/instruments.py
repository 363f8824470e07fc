"""Instruments: torque, currents, two accelerometers with three axes each, encoder, probes."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ballscrew.base.arrays import Array
from ballscrew.testbed.machine import Machine


@dataclass(frozen=True, slots=True)
class Instruments:
    """Noise (rms), resolution, range and delay of the instruments, as of good real ones.

    Parameters
    ----------
    torque_noise, torque_resolution : float
        Noise and resolution of the torque, N m.
    torque_constant : float
        Torque constant of the motor, N m/A (peak of a phase).
    current_noise : float
        Noise of the currents, A.
    poles : int
        Pole pairs of the motor.
    acceleration_noise, acceleration_range : float
        Noise and range of the accelerometers, m/s².
    cross_talk : float
        Sensitivity of an accelerometer's other axes.
    pitch_frequency, pitch_damping : float
        Frequency and damping ratio of the pitching mode of table and sensors, Hz; 0 Hz for none.
    pitch : tuple of float
        Share of the pitching mode in each accelerometer.
    mount_frequency, mount_damping : float
        Frequency and damping ratio of the accelerometers' mounts, Hz.
    hum, hum_frequency : float
        Amplitude and frequency of mains hum on the torque, N m and Hz.
    torque_delay : float
        Delay of the torque that the drive reports, s.
    linear_scale, backlash_probe : bool
        Whether the rig has a linear scale and a backlash probe.
    scale_noise, probe_noise : float
        Noise of scale and probe, m.
    """

    torque_noise: float = 0.002
    torque_resolution: float = 5e-4
    torque_constant: float = 0.5
    current_noise: float = 0.01
    poles: int = 4
    acceleration_noise: float = 0.02
    acceleration_range: float = 100.0
    cross_talk: float = 0.02
    pitch_frequency: float = 0.0
    pitch_damping: float = 0.03
    pitch: tuple[float, float] = (0.15, -0.10)
    mount_frequency: float = 3200.0
    mount_damping: float = 0.05
    hum: float = 5e-4
    hum_frequency: float = 50.0
    torque_delay: float = 0.0
    linear_scale: bool = False
    backlash_probe: bool = False
    scale_noise: float = 2e-8
    probe_noise: float = 3e-8


def measured(
    instruments: Instruments, machine: Machine, records: Array, rate: float, random: np.random.Generator
) -> dict[str, Array]:
    """Channels of one trip.

    Parameters
    ----------
    instruments : Instruments
        The instruments.
    machine : Machine
        The machine.
    records : ndarray, shape (n, 8)
        From :func:`~ballscrew.testbed.integrator.integrate`.
    rate : float
        Samples per second, Hz.
    random : Generator
        Generator of the noise.

    Returns
    -------
    dict of str to ndarray, shape (n,)
        In N m, m, m/s² and A, by the channel's name.
    """
    n = len(records)
    beta = machine.motor_ratio

    def noisy(x: Array, size: float) -> Array:
        return np.asarray(x + size * random.standard_normal(n))

    torque = records[:, 0] * beta
    time = np.arange(n) / rate
    angle = instruments.poles * records[:, 4] / beta
    phase = random.uniform(0, 2 * math.pi)
    hum = instruments.hum * np.sin(2 * math.pi * instruments.hum_frequency * time + phase)
    reported = noisy(_delayed(torque, instruments.torque_delay * rate) + hum, instruments.torque_noise)
    channels = {
        "torque": np.round(reported / instruments.torque_resolution) * instruments.torque_resolution,
        "position": records[:, 4].copy(),
    }
    for name, shift in (("current_u", 0.0), ("current_v", -2.0), ("current_w", 2.0)):
        current = torque / instruments.torque_constant * np.cos(angle + shift * math.pi / 3)
        channels[name] = noisy(current, instruments.current_noise)
    along = records[:, 1]
    pitching = _resonance(along, instruments.pitch_frequency, instruments.pitch_damping, rate)
    for index, part in enumerate(instruments.pitch, start=1):
        motion = _mounted(along + part * pitching, instruments, rate)
        for axis, share in (("x", 1.0), ("y", instruments.cross_talk), ("z", instruments.cross_talk / 2)):
            values = noisy(share * motion, instruments.acceleration_noise)
            limit = instruments.acceleration_range
            channels[f"acc{index}_{axis}"] = np.clip(values, -limit, limit)
    if instruments.linear_scale:
        channels["scale"] = noisy(records[:, 5], instruments.scale_noise)
    if instruments.backlash_probe:
        channels["backlash"] = noisy(machine.local_backlash(records[:, 5]), instruments.probe_noise)
    return channels


def _delayed(x: Array, samples: float) -> Array:
    if samples == 0:
        return x
    index = np.arange(len(x)) - samples
    return np.asarray(np.interp(index, np.arange(len(x)), x))


def _resonance(x: Array, frequency: float, damping: float, rate: float) -> Array:
    """Acceleration of a small mass on a spring relative to its support."""
    from scipy.signal import bilinear, lfilter

    if frequency <= 0:
        return np.zeros_like(x)
    w = 2 * math.pi * frequency
    b, a = bilinear([-1.0, 0.0, 0.0], [1.0, 2 * damping * w, w * w], rate)
    return np.asarray(lfilter(b, a, x))


def _mounted(x: Array, instruments: Instruments, rate: float) -> Array:
    from scipy.signal import bilinear, lfilter

    w = 2 * math.pi * instruments.mount_frequency
    damping = 2 * instruments.mount_damping * w
    b, a = bilinear([damping, w * w], [1.0, damping, w * w], rate)
    return np.asarray(lfilter(b, a, x))
