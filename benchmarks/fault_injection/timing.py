"""Faults of time: samples that are lost, clocks that disagree."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.fault_injection.fault import Array, Channels, needed

__all__ = ["GAP", "declared", "drifting", "dropped", "dropped_in_one", "filled", "late"]

GAP = 32  # samples, a block of a logger's buffer


def declared(stated: float, strength: float) -> float:
    """Declare a rate that is too high by this part."""
    return (1 + strength) * stated


def _lost(n: int, gaps: int, random: np.random.Generator) -> NDArray[np.bool_]:
    """Which samples are lost: so many gaps at random places, which may touch."""
    lost = np.zeros(n, dtype=np.bool_)
    for start in random.integers(1, max(n - GAP, 2), size=gaps):
        lost[start : start + GAP] = True
    return lost


def dropped(channels: Channels, strength: float, random: np.random.Generator) -> dict[str, Array]:
    """Lose so many blocks of 32 samples in all channels at once; the record is shorter by them."""
    n = len(next(iter(channels.values())))
    retained = ~_lost(n, round(strength), random)
    return {name: values[retained] for name, values in channels.items()}


def filled(channels: Channels, strength: float, random: np.random.Generator) -> dict[str, Array]:
    """Lose so many blocks in all channels, and fill them with the last sample before."""
    n = len(next(iter(channels.values())))
    index = np.where(_lost(n, round(strength), random), 0, np.arange(n))
    index = np.maximum.accumulate(index)
    return {name: values[index] for name, values in channels.items()}


def dropped_in_one(
    channels: Channels, strength: float, random: np.random.Generator, channel: str
) -> dict[str, Array]:
    """Lose so many blocks in one channel, the rest of which moves up; all records end where it does."""
    needed(channels, channel)
    retained = channels[channel][~_lost(len(channels[channel]), round(strength), random)]
    return {name: retained if name == channel else x[: len(retained)] for name, x in channels.items()}


def late(channels: Channels, rate: float, strength: float, names: tuple[str, ...]) -> dict[str, Array]:
    """Let channels come this much too late, s; the record begins where all have begun."""
    needed(channels, *names)
    n, shift = len(channels[names[0]]), strength * rate
    first = min(math.ceil(shift), n - 1)
    delayed = _read_at(channels, names, np.arange(n) - shift)
    return {name: values[first:] for name, values in delayed.items()}


def drifting(channels: Channels, strength: float, names: tuple[str, ...]) -> dict[str, Array]:
    """Sample channels by a clock of their own that is faster by this part, from the same start."""
    needed(channels, *names)
    return _read_at(channels, names, np.arange(len(channels[names[0]])) / (1 + strength))


def _read_at(
    channels: Channels, names: tuple[str, ...], index: NDArray[np.floating[Any]]
) -> dict[str, Array]:
    whole = np.arange(len(index))
    return {**channels, **{name: np.interp(index, whole, channels[name]) for name in names}}
