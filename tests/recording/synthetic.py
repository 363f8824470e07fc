"""A round trip of an axis that is one rotor, one table and the spring between them.

Nothing here is the project's model: the motor follows the plan exactly, the table rings behind it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.signal import bilinear, lfilter

from ballscrew.axis.model import rotor_mass
from ballscrew.axis.sheet import Bearing, DataSheet, Drive, Guide, Screw, Table
from ballscrew.base.provenance import FileRef
from ballscrew.fcft.plan import Motion, Plan
from ballscrew.recording.recording import Recording

Array = NDArray[np.float64]

LOAD = 100.0
SHEET = DataSheet(
    name="synthetic",
    support="fixed-free",
    screw=Screw(0.01, 0.0176, 0.0176, 0.65, 0.08, 15e3, 480e6, 0.1, 0.04),
    bearing=Bearing(160e6),
    table=Table(32.0),
    drive=Drive(4.2e-4),
    guide=Guide(25.0),
)
PLAN = Plan(
    positions=(0.0, 0.03, 0.06, 0.09, 0.12, 0.15),
    repetitions=1,
    masses=(LOAD,),
    motions=(Motion(0.15, 2.5, 1500.0, 0.2),),
)
CHANNELS = {
    "torque": ("torque", "N m", "", ""),
    "position": ("position", "m", "", ""),
    "acc1_x": ("acceleration", "m/s^2", "nut-1", "x"),
    "acc2_x": ("acceleration", "m/s^2", "nut-2", "x"),
}


def path_of(
    plan: Plan, rate: float, override: float = 1.0, lead_in: float = 0.4
) -> tuple[Array, Array, Array]:
    """Position, speed and acceleration of one round trip of the plan's first motion."""
    move = plan.motions[0]
    speed = move.speed * override
    ramp = speed / move.acceleration  # between the middles of the two jerks
    jerk = move.acceleration / move.jerk
    times, values = [0.0], [0.0]
    now = lead_in
    stops = [*plan.positions, *plan.positions[-2::-1]]
    for start, stop in pairwise(stops):
        sign = np.sign(stop - start) * move.acceleration
        cruise = abs(stop - start) / speed - ramp - jerk
        for way in (1, -1):
            times += [now, now + jerk, now + ramp, now + ramp + jerk]
            values += [0.0, way * sign, way * sign, 0.0]
            now += ramp + jerk + (cruise if way == 1 else move.dwell)
    time = np.arange(0.0, now + lead_in, 1 / rate)
    acceleration = np.interp(time, times, values)
    speeds = _integral(acceleration, rate)
    return plan.positions[0] + _integral(speeds, rate), speeds, acceleration


def _integral(x: Array, rate: float) -> Array:
    return np.concatenate([[0.0], np.cumsum(0.5 * (x[1:] + x[:-1]))]) / rate


def synthetic_trip(
    plan: Plan = PLAN,
    *,
    rate: float = 12800.0,
    load: float = LOAD,
    held: float = 120.0,
    damping: float = 0.03,
    noise: float = 1.0,
    encoder: float = 5e-8,
    override: float = 1.0,
    lead_in: float = 0.4,
    seed: int = 0,
) -> dict[str, Array]:
    """Torque, position and two accelerations of one round trip, by the names of CHANNELS.

    ``held`` is the frequency with the rotor held, Hz; ``noise`` scales 2 mN m and 0.02 m/s²; ``encoder`` is
    its step, m; ``override`` scales the speed.
    """
    position, speed, motor = path_of(plan, rate, override, lead_in)
    rotor, table = rotor_mass(SHEET), SHEET.table.mass + load
    friction = SHEET.guide.friction * np.tanh(speed / 1e-3) + 40.0 * speed
    w = 2 * np.pi * held
    poles = [1.0, 2 * damping * w, w * w]
    follows = lfilter(*bilinear(poles[1:], poles, rate), motor)
    pushed = lfilter(*bilinear([1.0, 0.0, 0.0], poles, rate), friction / table)
    acceleration = follows - pushed
    random = np.random.default_rng(seed)

    def noisy(x: Array, size: float) -> Array:
        return np.asarray(x + noise * size * random.standard_normal(len(x)))

    torque = SHEET.screw.lead / (2 * np.pi) * (rotor * motor + table * acceleration + friction)
    return {
        "torque": noisy(torque, 0.002),
        "position": np.round(position / encoder) * encoder,
        "acc1_x": noisy(acceleration, 0.02),
        "acc2_x": noisy(0.98 * acceleration, 0.02),
    }


def recorded(
    signals: Mapping[str, Array], rate: float = 12800.0, name: str = "trip1.h5", **fields: Any
) -> Recording:
    """The signals as a recording, without a file."""
    channels = {}
    for source, values in signals.items():
        quantity, unit, location, direction = CHANNELS[source]
        key = ":".join(part for part in (quantity, location, direction) if part)
        attributes = {"quantity": quantity, "unit": unit, "location": location, "direction": direction}
        attributes |= {"sample_rate": rate, "derived": False, "source": source}
        channels[key] = xr.DataArray(values, dims="time", name=key, attrs=attributes)
    return Recording(channels, FileRef(name, "0" * 64), "synthetic", rate, **fields)


def write_trip(path: Path, signals: Mapping[str, Array], rate: float = 12800.0) -> Path:
    """The signals as an HDF5 file with a rate and units."""
    with h5py.File(path, "w") as file:
        file.attrs["sample_rate"] = rate
        for source, values in signals.items():
            file.create_dataset(source, data=values).attrs["unit"] = CHANNELS[source][1]
    return path


def changed(recording: Recording, change: Callable[[str, Array], Array], *which: str) -> Recording:
    """A recording with channels changed whose source is one of ``which``, or all of them."""
    channels = {}
    for name, values in recording.channels.items():
        x = recording.array(name).copy()
        if not which or values.attrs["source"] in which:
            x = np.asarray(change(str(values.attrs["source"]), x))
        channels[name] = xr.DataArray(x, dims="time", name=name, attrs=values.attrs)
    return replace(recording, channels=channels)


def redeclared(recording: Recording, rate: float) -> Recording:
    """The same samples with another rate, which is stated nowhere else."""
    channels = {name: values.assign_attrs(sample_rate=rate) for name, values in recording.channels.items()}
    return replace(recording, channels=channels, sample_rate=rate, declared_rate=rate, file_rate=None)
