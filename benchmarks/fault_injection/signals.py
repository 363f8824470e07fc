"""Faults of a channel's values: what sensor, amplifier, converter and cable do to them."""

from __future__ import annotations

import math

import numpy as np
from scipy.signal import bilinear, lfilter

from ballscrew.base.errors import InputError
from benchmarks.fault_injection.fault import Array, Channels, needed

__all__ = [
    "clipped",
    "flat",
    "hum",
    "infinite",
    "inverted",
    "loose",
    "missing",
    "not_a_number",
    "remounted",
    "scaled",
    "swapped",
    "wrapped",
]

_THIRD_HARMONIC = 0.3  # of rectifiers


def clipped(channels: Channels, strength: float, channel: str) -> dict[str, Array]:
    """Cut this part off a channel's range: 0.2 leaves 80 % of its largest value."""
    needed(channels, channel)
    limit = (1 - strength) * np.max(np.abs(channels[channel]))
    return {**channels, channel: np.clip(channels[channel], -limit, limit)}


def flat(channels: Channels, strength: float, channel: str) -> dict[str, Array]:
    """Hold a channel at its value from the point where this part of the record is still to come."""
    needed(channels, channel)
    x = channels[channel].copy()
    start = round((1 - strength) * len(x))
    x[start:] = x[max(start - 1, 0)]
    return {**channels, channel: x}


def not_a_number(
    channels: Channels, strength: float, random: np.random.Generator, channel: str, value: float = math.nan
) -> dict[str, Array]:
    """Put so many values that are none into a channel, at random places."""
    needed(channels, channel)
    x = channels[channel].copy()
    x[random.choice(len(x), size=min(round(strength), len(x)), replace=False)] = value
    return {**channels, channel: x}


def infinite(
    channels: Channels, strength: float, random: np.random.Generator, channel: str
) -> dict[str, Array]:
    """Put so many infinite values into a channel."""
    return not_a_number(channels, strength, random, channel, math.inf)


def wrapped(channels: Channels, strength: float, channel: str) -> dict[str, Array]:
    """Let a channel run over the range of its whole number: it is so many times as large as that allows."""
    needed(channels, channel)
    half = np.max(np.abs(channels[channel])) / strength
    return {**channels, channel: (channels[channel] + half) % (2 * half) - half}


def swapped(channels: Channels, strength: float, other: str) -> dict[str, Array]:
    """Exchange the x axis of so many accelerometers for another of their axes, y or z."""
    found = dict(channels)
    for index in range(1, round(strength) + 1):
        one, two = f"acc{index}_x", f"acc{index}_{other}"
        needed(channels, one, two)
        found[one], found[two] = channels[two], channels[one]
    return found


def inverted(channels: Channels, names: tuple[str, ...]) -> dict[str, Array]:
    """Turn the sign of channels."""
    needed(channels, *names)
    return {**channels, **{name: -channels[name] for name in names}}


def scaled(channels: Channels, strength: float, names: tuple[str, ...]) -> dict[str, Array]:
    """Make channels larger by this part: 0.02 for 2 %."""
    needed(channels, *names)
    return {**channels, **{name: (1 + strength) * channels[name] for name in names}}


def hum(
    channels: Channels, rate: float, strength: float, random: np.random.Generator, channel: str, mains: float
) -> dict[str, Array]:
    """Add mains hum and its third harmonic to a channel; the strength is its rms over the channel's own."""
    needed(channels, channel)
    x = channels[channel]
    angle = 2 * math.pi * mains * np.arange(len(x)) / rate + random.uniform(0, 2 * math.pi)
    wave = np.sin(angle) + _THIRD_HARMONIC * np.sin(3 * angle)
    size = strength * np.std(x) * math.sqrt(2 / (1 + _THIRD_HARMONIC**2))
    return {**channels, channel: x + size * wave}


def missing(channels: Channels, channel: str) -> dict[str, Array]:
    """Leave a channel out."""
    needed(channels, channel)
    return {name: values for name, values in channels.items() if name != channel}


def loose(
    channels: Channels, rate: float, strength: float, sensors: tuple[int, ...], damping: float = 0.05
) -> dict[str, Array]:
    """Let accelerometers ring on their mounts, whose natural frequency is the strength, Hz."""
    names = tuple(f"acc{index}_{axis}" for index in sensors for axis in "xyz")
    needed(channels, *names)
    if strength >= rate / 2:
        raise InputError(f"a mount of {strength:g} Hz cannot be sampled at {rate:g} Hz.")
    w = 2 * math.pi * strength
    # The frequency is bent back, so that the mode lies where it shall although the filter is a sampled one.
    w = 2 * rate * math.tan(w / (2 * rate))
    b, a = bilinear([2 * damping * w, w * w], [1.0, 2 * damping * w, w * w], rate)
    return {**channels, **{name: np.asarray(lfilter(b, a, channels[name])) for name in names}}


def remounted(
    channels: Channels, strength: float, random: np.random.Generator, sensor: int = 1
) -> dict[str, Array]:
    """Put an accelerometer back turned by this angle, rad, its sensitivity a per cent off."""
    x, z = f"acc{sensor}_x", f"acc{sensor}_z"
    needed(channels, x, z)
    gain = 1 + 0.01 * random.choice([-1.0, 1.0])
    sin, cos = math.sin(strength), math.cos(strength)
    return {
        **channels,
        x: gain * (cos * channels[x] + sin * channels[z]),
        z: gain * (cos * channels[z] - sin * channels[x]),
    }
