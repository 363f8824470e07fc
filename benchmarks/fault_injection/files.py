"""Faults of the files of a run: what is missing, cut, or too much."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from benchmarks.fault_injection.fault import Array, Channels

__all__ = ["cut_bytes", "cut_short", "missed", "two_in_one"]


def missed(trips: Sequence[Channels], strength: float, random: np.random.Generator) -> tuple[Channels, ...]:
    """Leave out so many trips, whichever, but one."""
    left = max(len(trips) - round(strength), 1)
    retained = sorted(random.choice(len(trips), size=left, replace=False))
    return tuple(trips[index] for index in retained)


def two_in_one(trips: Sequence[Channels], strength: float) -> tuple[Channels, ...]:
    """Let so many files go on with another trip, as where a logger was not stopped between two runs."""
    found = list(trips)
    for index in range(min(round(strength), len(trips))):
        after = trips[(index + 1) % len(trips)]
        found[index] = {name: np.concatenate([x, after[name]]) for name, x in trips[index].items()}
    return tuple(found)


def cut_short(channels: Channels, strength: float) -> dict[str, Array]:
    """End a record when this part of it is still to come."""
    return {name: values[: round((1 - strength) * len(values))] for name, values in channels.items()}


def cut_bytes(content: bytes, strength: float) -> bytes:
    """Cut this part off the end of a file, as where a copy broke off."""
    return content[: round((1 - strength) * len(content))]
