"""Channels of a recording that an analysis needs, at one rate: input, position, responses."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from fractions import Fraction

import numpy as np

from ballscrew.axis.sheet import DataSheet
from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError
from ballscrew.recording.channels import PHASES
from ballscrew.recording.drive_input import DriveInput, electrical_turns, input_channels, q_current
from ballscrew.recording.encoder import resolution
from ballscrew.recording.filters import undo_and_apply
from ballscrew.recording.recording import Recording

AXIAL = ("x", "")  # directions along the screw
ACROSS = ("y", "z")
_SAME_TIME = 1e-3  # of a sample: times of files are rounded
_STEP_RATIO = 2 * math.pi * 100.0  # 1/s: steps of speed and position are compared at 100 Hz, as of an axis


@dataclass(frozen=True, slots=True)
class Aligned:
    """Input, position and axial accelerations of a recording, at one rate.

    Parameters
    ----------
    rate : float
        Sample rate, Hz: the lowest of input and responses.
    input : ndarray, shape (n,)
        Torque (N m), force (N), torque over the rated one, or current (A).
    quantity : str
        Quantity of the input: torque, force, relative torque or current.
    position : ndarray, shape (n,)
        m.
    response : ndarray, shape (n_responses, n)
        Accelerations, m/s².
    responses : tuple of str
        Names of the responses in the recording.
    drive : DriveInput, optional
        Channels of the input.
    across : mapping of str to ndarray, shape (n,)
        Accelerations in other directions at the responses' locations, m/s², by their names.
    motor : ndarray, shape (n,), optional
        Acceleration of the motor by its measured speed, m/s²; None without one, or where the position is the
        better signal.
    """

    rate: float
    input: Array
    quantity: str
    position: Array
    response: Array
    responses: tuple[str, ...]
    drive: DriveInput | None = None
    across: Mapping[str, Array] = field(default_factory=dict)
    motor: Array | None = None


def align(recording: Recording, sheet: DataSheet | None = None) -> Aligned:
    """Choose the channels that an analysis needs, and resample them to one rate.

    Accelerometers at the nut are preferred to the motor's own acceleration, as in the paper. Declared filters
    are undone or applied.

    Parameters
    ----------
    recording : Recording
        Recording as read.
    sheet : DataSheet, optional
        Gives the number of pole pairs for currents of phases.

    Returns
    -------
    Aligned
        At the lowest rate of input and responses, from the time on when all channels have begun. Faster ones
        are resampled with a zero-phase filter; a slower position is interpolated.

    Raises
    ------
    InputError
        If there is no torque, force or current, no position, or no acceleration along the screw.
    MeasurementError
        If the currents of phases make no torque.
    """
    file = recording.file.name
    inputs = input_channels(recording)
    if not inputs:
        raise InputError(f"{file}: no channel is a torque, force or current; the channel map must name one.")
    places = recording.of("position")
    if not places:
        raise InputError(f"{file}: no channel is a position; the channel map must name one.")
    by_speed = acceleration_by_speed(recording)
    names = _responses(recording, by_speed)
    if not names:
        raise InputError(
            f'{file}: no channel is an acceleration along the screw (axis = "x"); the channel map must name '
            'one, or derive it from the position with derive = "second-derivative".'
        )
    rate = min(map(recording.rate, [*inputs, *names]))
    force, force_rate, drive = _input(recording, inputs, places[0], sheet)
    across = _across(recording, names, rate)
    others = {places[0], *names, *across}
    if by_speed and recording.rate(by_speed) >= rate:
        others.add(by_speed)
    origin = max(_start(recording, name) for name in [inputs[0], *others])
    force = _from(force, force_rate, rate, origin - _start(recording, inputs[0]))
    arrays = {}
    for name in others:
        late = origin - _start(recording, name)
        arrays[name] = _from(_unfiltered(recording, name), recording.rate(name), rate, late)
    size = min(map(len, [force, *arrays.values()]))
    for name in others:
        arrays[name] = arrays[name][:size]
    responses = np.stack([arrays[name] for name in names])
    return Aligned(
        rate=rate,
        input=force[:size],
        quantity=drive.quantity,
        position=arrays[places[0]],
        response=responses,
        responses=tuple(names),
        drive=drive,
        across={name: arrays[name] for name in across},
        motor=arrays.get(by_speed),
    )


def _across(recording: Recording, responses: list[str], rate: float) -> list[str]:
    """Accelerations across the screw that the sensors of the responses measure, at their rate or more."""
    places = {recording.channels[name].attrs["location"] for name in responses}
    names: list[str] = []
    for direction in ACROSS:
        names += recording.of("acceleration", direction=direction)
    at_place = [name for name in names if recording.channels[name].attrs["location"] in places]
    return [name for name in at_place if recording.rate(name) >= rate]


def _unfiltered(recording: Recording, name: str) -> Array:
    """Values of a channel, its declared filters undone, and those that follow it applied."""
    declared = recording.channels[name].attrs
    undone, applied = declared.get("filtered_by", ()), declared.get("followed_by", ())
    return undo_and_apply(recording.array(name), recording.rate(name), undone, applied)


def _input(
    recording: Recording, names: tuple[str, ...], place: str, sheet: DataSheet | None
) -> tuple[Array, float, DriveInput]:
    """Input with its rate and origin."""
    attributes = [recording.channels[name].attrs for name in names]
    origin = DriveInput(attributes[0]["quantity"], tuple(str(each["source"]) for each in attributes))
    if attributes[0].get("phase") not in PHASES:
        return _unfiltered(recording, names[0]), recording.rate(names[0]), origin
    rate = min(map(recording.rate, names))
    arrays = [_at_rate(_unfiltered(recording, name), recording.rate(name), rate) for name in names]
    size = min(map(len, arrays))
    currents = {each["phase"]: array[:size] for each, array in zip(attributes, arrays, strict=True)}
    position = _unfiltered(recording, place)
    index = np.arange(size) * (recording.rate(place) / rate)
    position = np.interp(index, np.arange(len(position)), position)
    turns = electrical_turns(sheet)
    current = q_current(currents, position, rate, turns, recording.file.name)
    return current, rate, replace(origin, commutation="currents" if turns is None else "data sheet")


def _responses(recording: Recording, by_speed: str) -> list[str]:
    """Accelerations along the screw: of the nut, else of the motor by the better of its signals."""
    names: list[str] = []
    for direction in AXIAL:
        names += recording.of("acceleration", direction=direction)
    at_nut = [name for name in names if recording.channels[name].attrs["location"] != "motor"]
    if at_nut:
        return at_nut
    unused = "second-derivative" if by_speed else "derivative"
    return [name for name in names if recording.channels[name].attrs.get("derive") != unused]


def acceleration_by_speed(recording: Recording) -> str:
    """Acceleration that is the derivative of the motor's speed; empty where the position is better.

    A speed is better that is sampled faster, or as fast with smaller steps once the position's are
    differentiated at a frequency of the axis.
    """
    derived = {recording.channels[name].attrs.get("derive"): name for name in recording.channels}
    speed, positions = derived.get("derivative", ""), recording.of("position")
    if not speed or not positions or "second-derivative" not in derived:
        return speed
    rates = recording.rate(speed), recording.rate(positions[0])
    better = rates[0] > rates[1]
    if rates[0] == rates[1]:
        better = _speed_step(recording, speed) < _STEP_RATIO * resolution(recording.array(positions[0]))
    return speed if better else ""


def speeds_of(recording: Recording, derived: str) -> list[str]:
    """Speeds that an acceleration is derived from."""
    source = recording.channels[derived].attrs["source"]
    return [name for name in recording.of("speed") if recording.channels[name].attrs["source"] == source]


def _speed_step(recording: Recording, derived: str) -> float:
    """Smallest step of the speed that an acceleration is derived from, m/s."""
    return min(resolution(recording.array(name)) for name in speeds_of(recording, derived))


def _at_rate(x: Array, rate: float, target: float) -> Array:
    """Resample by a ratio of small whole numbers, without delay and without a step at the ends."""
    if abs(rate / target - 1) < 1e-9:
        return x
    from scipy.signal import resample_poly

    ratio = Fraction(target / rate).limit_denominator(1000)
    return np.asarray(resample_poly(x, ratio.numerator, ratio.denominator, padtype="line"), dtype=np.float64)


def _start(recording: Recording, name: str) -> float:
    """Time of the first sample of a channel, s."""
    start = recording.channels[name].attrs.get("start")
    return 0.0 if start is None else float(start)


def _from(x: Array, rate: float, target: float, late: float) -> Array:
    """Samples at a rate, from a time after the first one on; a lower rate is interpolated."""
    if rate > target:
        x, rate = _at_rate(x, rate, target), target
    first, step = late * rate, rate / target
    if abs(step - 1) < 1e-9 and abs(first - round(first)) < _SAME_TIME:
        return x[round(first) :]
    index = np.arange(len(x))
    rows = first + step * np.arange(max(0, int((len(x) - 1 - first) / step + _SAME_TIME) + 1))
    if not np.isfinite(x).all():  # the quality gate reports it
        return np.asarray(np.interp(rows, index, x))
    from scipy.interpolate import CubicSpline

    return np.asarray(CubicSpline(index, x)(rows))
