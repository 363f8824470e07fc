"""What a fault is, and what it can act on."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ballscrew.base.errors import InputError
from ballscrew.fcft.plan import Motion, Plan
from ballscrew.testbed.trip import Rig

__all__ = ["Array", "Change", "Channels", "Fault", "RecordedTrips", "Setup", "needed"]

Array: TypeAlias = NDArray[np.float64]
Channels: TypeAlias = Mapping[str, Array]
Change: TypeAlias = Callable[[Any, float, np.random.Generator, float], Any]


@dataclass(frozen=True, slots=True)
class Setup:
    """Change of the machine before anything is measured; the declared data stay unchanged.

    Parameters
    ----------
    rig : Rig
        The machine with its drive and its instruments.
    plan : Plan
        Gives the stops.
    motion : Motion
        As it is run.
    load : float
        What lies on the table, kg.
    """

    rig: Rig
    plan: Plan
    motion: Motion
    load: float


@dataclass(frozen=True, slots=True)
class RecordedTrips:
    """What a run leaves behind.

    Parameters
    ----------
    trips : tuple of mapping of str to ndarray
        Channels of each file, in SI.
    rate : float
        Declared, Hz.
    """

    trips: tuple[Channels, ...]
    rate: float


@dataclass(frozen=True, slots=True)
class Fault:
    """One thing that goes wrong.

    Parameters
    ----------
    name : str
        In words: ``"clipped torque"``.
    on : {"setup", "channels", "trips", "rate", "file"}
        What it acts on: the rig before it is simulated, the channels of a trip, the files of a run, the
        declared rate, or the bytes of a file.
    change : callable
        ``change(what, strength, random, rate)`` returns a changed copy.
    strengths : tuple of float
        From hardly to plainly.
    unit : str
        What the strength counts.
    history : bool
        Whether one run cannot show it, so that only runs before and after can.
    hidden : tuple of float
        Strengths at which that is so, where it is not at all of them.
    """

    name: str
    on: Literal["setup", "channels", "trips", "rate", "file"]
    change: Change
    strengths: tuple[float, ...]
    unit: str
    history: bool = False
    hidden: tuple[float, ...] = ()

    def only_history(self, strength: float) -> bool:
        """Whether a single run cannot show this strength."""
        return self.history or strength in self.hidden


def needed(channels: Channels, *names: str) -> None:
    """Raise an error where a trip lacks a channel that a fault acts on.

    Raises
    ------
    InputError
        Naming the channel that is not there.
    """
    for name in names:
        if name not in channels:
            raise InputError(
                f"there is no channel {name} to change; there are {', '.join(sorted(channels))}."
            )
