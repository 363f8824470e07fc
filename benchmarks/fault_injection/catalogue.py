"""The catalogue: every fault by its name, and what puts one on."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from inspect import signature
from types import MappingProxyType
from typing import Any, TypeVar, cast

import numpy as np

from ballscrew.base.errors import InputError, shown
from benchmarks.fault_injection import files, setups, signals, timing
from benchmarks.fault_injection.fault import Change, Channels, Fault, RecordedTrips, Setup

__all__ = ["FAULTS", "inject"]

T = TypeVar("T", Setup, RecordedTrips, bytes)

_TORQUE = ("torque",)
_SENSORS = tuple(f"acc{index}_{axis}" for index in (1, 2) for axis in "xyz")
# Units of which there is no more than the whole.
_WITHIN = ("part of", "part lost", "part slower")
_MAIN = (("torque", "torque"), ("acceleration", "acc1_x"), ("position", "position"))


def _made(function: Callable[..., Any], **fixed: object) -> Change:
    """Give a function what it asks for of strength, random and rate, and the rest that is fixed."""
    asked = signature(function).parameters

    def change(what: Any, strength: float, random: np.random.Generator, rate: float) -> Any:
        given = {"strength": strength, "random": random, "rate": rate}
        return function(what, **{name: value for name, value in given.items() if name in asked}, **fixed)

    return change


def _channels(
    name: str, strengths: tuple[float, ...], unit: str, function: Callable[..., Any], **fixed: object
) -> Fault:
    return Fault(name, "channels", _made(function, **fixed), strengths, unit)


def _setup(
    name: str,
    strengths: tuple[float, ...],
    unit: str,
    function: Callable[..., Any],
    *,
    history: bool = False,
    **fixed: object,
) -> Fault:
    return Fault(name, "setup", _made(function, **fixed), strengths, unit, history)


def _signal_faults() -> Iterator[Fault]:
    for name, channel in (("torque", "torque"), ("acceleration", "acc1_x")):
        cut = "part of the largest value cut off"
        yield _channels(f"clipped {name}", (0.05, 0.2, 0.5), cut, signals.clipped, channel=channel)
    for name, channel in _MAIN:
        fraction = "part of the record, to its end"
        yield _channels(f"flat {name}", (0.05, 0.3, 1.0), fraction, signals.flat, channel=channel)
    yield _channels("NaN", (1.0, 100.0), "samples", signals.not_a_number, channel="torque")
    yield _channels("Inf", (1.0, 100.0), "samples", signals.infinite, channel="acc1_x")
    for name, channel in _MAIN:
        times = "times the range"
        yield _channels(f"integer wrap of {name}", (1.05, 1.5, 4.0), times, signals.wrapped, channel=channel)
    for other in "yz":
        yield _channels(f"swapped axes, x and {other}", (1.0, 2.0), "sensors", signals.swapped, other=other)
    for name, channel in _MAIN:
        yield _channels(f"inverted {name}", (1.0,), "", signals.inverted, names=(channel,))
    for name, names, strengths in (
        ("torque", _TORQUE, (0.02, 0.1, 0.4)),
        ("acceleration", ("acc1_x",), (0.02, 0.1, 8.81)),
        ("both accelerations", ("acc1_x", "acc2_x"), (0.02, 0.1, 8.81)),
        ("position", ("position",), (0.005, 0.02, 0.1)),
    ):
        yield _channels(f"wrong scale of {name}", strengths, "part too large", signals.scaled, names=names)
    for mains, name, channel in (
        (50.0, "torque", "torque"),
        (60.0, "torque", "torque"),
        (50.0, "acceleration", "acc1_x"),
    ):
        title, size = f"{mains:.0f} Hz hum on {name}", "rms over the signal's"
        yield _channels(title, (0.01, 0.05, 0.5), size, signals.hum, channel=channel, mains=mains)
    for name, channel in _MAIN:
        yield _channels(f"missing {name}", (1.0,), "", signals.missing, channel=channel)
    turned = _channels(
        "remounted sensor", tuple(math.radians(x) for x in (3, 15, 45)), "rad", signals.remounted
    )
    yield replace(turned, history=True)
    mount = (1500.0, 600.0, 205.0)
    yield _channels("loose sensor", mount, "Hz of its mount", signals.loose, sensors=(1,))
    both = _channels("both sensors loose", mount, "Hz of their mounts", signals.loose, sensors=(1, 2))
    # To its accelerometers, a table on a soft nut and sensors on soft mounts are one and the same.
    yield replace(both, hidden=(205.0,))


def _time_faults() -> Iterator[Fault]:
    counts, gaps = (1.0, 5.0, 30.0), f"gaps of {timing.GAP} samples"
    yield _channels("dropped samples", counts, gaps, timing.dropped)
    yield _channels("dropped samples, filled", counts, gaps, timing.filled)
    yield _channels("dropped samples in acceleration", counts, gaps, timing.dropped_in_one, channel="acc1_x")
    wrong, late = (0.002, 0.01, 0.8 / 12), (39e-6, 3e-4, 2e-3)
    rate = Fault("wrong declared rate", "rate", _made(timing.declared), wrong, "part too high")
    yield replace(rate, hidden=(0.002,))  # a drive's own speed is no better
    yield _channels("acceleration late", late, "s", timing.late, names=_SENSORS)
    yield _channels("torque late", late, "s", timing.late, names=_TORQUE)
    clock = "part too fast"
    yield _channels(
        "acceleration on another clock", (2e-5, 1e-4, 1e-3), clock, timing.drifting, names=_SENSORS
    )


def _file_faults() -> Iterator[Fault]:
    yield Fault("missed repetition", "trips", _made(files.missed), (1.0, 2.0), "trips")
    yield Fault("two runs in one file", "trips", _made(files.two_in_one), (1.0, 3.0), "files")
    yield _channels("cut record", (0.05, 0.3, 0.95), "part lost", files.cut_short)
    yield Fault("cut file", "file", _made(files.cut_bytes), (0.001, 0.5), "part lost")


def _setup_faults() -> Iterator[Fault]:
    yield _setup("position not reached", (0.001, 0.01, 0.1), "m short", setups.short_of_the_end)
    yield _setup("speed override", (0.02, 0.1, 0.5), "part slower", setups.overridden)
    heavier = _setup("changed mass", (1.0, 5.0, 20.0, -20.0), "kg more", setups.heavier)
    yield replace(heavier, hidden=(1.0, 5.0))  # below what a sheet knows of its own inertias
    yield _setup("changed servo gains", (0.5, 1.5), "times", setups.tuned, history=True)
    yield _setup("warm axis", (5.0, 15.0), "K over the nut", setups.tempered, history=True, sign=1)
    yield _setup("cold axis", (5.0, 15.0), "K under the nut", setups.tempered, history=True, sign=-1)
    yield _setup("just greased", (1e-7, 3e-7), "m of film", setups.greased, history=True)


_ALL = (_signal_faults, _time_faults, _file_faults, _setup_faults)

FAULTS: Mapping[str, Fault] = MappingProxyType({fault.name: fault for part in _ALL for fault in part()})


def inject(
    name: str, what: T, strength: float, random: np.random.Generator, *, only: Sequence[int] | None = None
) -> T:
    """Put a fault on what it acts on.

    Parameters
    ----------
    name : str
        One of :data:`FAULTS`.
    what : Setup, RecordedTrips or bytes
        Before the simulation, what a run leaves behind, or the content of a file. It stays as it is.
    strength : float
        In the fault's own unit.
    random : Generator
        Of where it strikes.
    only : sequence of int, optional
        Which trips a fault of the channels strikes; by default all of them.

    Returns
    -------
    Setup, RecordedTrips or bytes
        Of the kind that was given.

    Raises
    ------
    InputError
        If there is no such fault, it acts on something else, or its strength or a channel is impossible.
    """
    if name not in FAULTS:
        raise InputError(f"there is no fault {shown(name)}; there are {', '.join(FAULTS)}.")
    fault = FAULTS[name]
    if not math.isfinite(strength) or (strength <= 0 and min(fault.strengths) > 0):
        raise InputError(f"the strength of {name!r} is {strength:g}; it must be finite and above 0.")
    if strength > 1 and fault.unit.startswith(_WITHIN):
        raise InputError(f"the strength of {name!r} is {strength:g}; there is no more than 1 to lose.")
    acts: dict[str, type] = {"setup": Setup, "file": bytes}
    if not isinstance(what, acts.get(fault.on, RecordedTrips)):
        wanted = {"setup": "a Setup", "file": "the bytes of a file"}.get(fault.on, "RecordedTrips")
        raise InputError(f"the fault {name!r} acts on {wanted}; it was given {type(what).__name__}.")
    if not isinstance(what, RecordedTrips):
        return cast("T", fault.change(what, strength, random, 0.0))
    return _on_trips(fault, what, strength, random, only)


def _on_trips(
    fault: Fault, run: RecordedTrips, strength: float, random: np.random.Generator, only: Sequence[int] | None
) -> RecordedTrips:
    if fault.on == "rate":
        return replace(run, rate=fault.change(run.rate, strength, random, run.rate))
    if fault.on == "trips":
        return replace(run, trips=fault.change(run.trips, strength, random, run.rate))
    struck = set(range(len(run.trips)) if only is None else only)
    if not struck <= set(range(len(run.trips))):
        raise InputError(f"there are {len(run.trips)} trips; trips {sorted(struck)} cannot be changed.")
    trips: list[Channels] = [
        fault.change(trip, strength, random, run.rate) if index in struck else trip
        for index, trip in enumerate(run.trips)
    ]
    return replace(run, trips=tuple(trips))
