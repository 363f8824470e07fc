"""From the files of a run to its transients: read, checked and cut, one recording at a time in memory."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from datetime import datetime
from itertools import chain, islice
from pathlib import Path
from typing import Any, cast

import numpy as np
import xarray as xr

from ballscrew.axis.sheet import DataSheet
from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError, MeasurementError
from ballscrew.base.files import Progress, ignore_progress
from ballscrew.base.provenance import FileRef
from ballscrew.fcft.plan import Plan, validate_plan
from ballscrew.recording.aligned import Aligned, align
from ballscrew.recording.channels import ChannelMap
from ballscrew.recording.drive_input import DriveInput, force_scale
from ballscrew.recording.encoder import interpolation_error
from ballscrew.recording.kinematics import kinematics
from ballscrew.recording.load import read_recording
from ballscrew.recording.lost_motion import LostMotion, lost_motion, table_offsets
from ballscrew.recording.motions import order_matters
from ballscrew.recording.phases import find_phases
from ballscrew.recording.quality.clock import (
    Clock,
    MoveTimes,
    check_clock,
    estimate_clock,
    measure_move_times,
)
from ballscrew.recording.quality.completeness import check_run
from ballscrew.recording.quality.finding import Finding, Quality
from ballscrew.recording.quality.high_pass import check_high_pass, undo_high_pass
from ballscrew.recording.quality.motion import check_motion, derived_from_encoder
from ballscrew.recording.quality.signals import check_signals
from ballscrew.recording.recording import Recording
from ballscrew.recording.rigid_body import (
    CHECK_RANGE,
    NormalEquations,
    RigidBody,
    estimate_rigid_body,
    normal_equations,
)
from ballscrew.recording.rotation import RotationSums, rotation_sums
from ballscrew.recording.temperature import TemperatureCourse, temperature_course, trip_temperatures
from ballscrew.recording.transients import TransientSegment, cut, label

_SLOWEST = 0.5  # of the plan's lowest speed, which a phase must reach
_SAME_RATE = 1e-4  # of a rate: the clocks of two recorders with ordinary quartz, 50 ppm each


@dataclass(frozen=True)
class Measurement:
    """Measurement of a run.

    Parameters
    ----------
    files : tuple of FileRef
        By start time where every file has one, by SHA-256 otherwise; in the order given where that says which
        trip is which, see :func:`~ballscrew.recording.motions.order_matters`.
    started_at : str or None
        Start time of the first file that has one.
    quality : Quality
        Verdict on all files together.
    transients : Dataset or None
        The table *Transients*; None where no recording was usable.
    rigid_body : RigidBody or None
        In N and kg, referred to the table; None where it cannot be estimated.
    reasons : tuple of str
        Reasons for a missing rigid body.
    extracts : mapping of int to object
        Result of ``extract`` for each usable recording, by its index in ``files``.
    drive : DriveInput or None
        Channels of the input; None where no recording was usable.
    rotations : tuple of mapping
        Pitch and yaw of each usable recording, see :func:`~ballscrew.recording.rotation.rotation_sums`.
    lost_motion : tuple of LostMotion
        For each stop, where the channel map names a position of the table beside the motor's.
    temperature : TemperatureCourse or None
        Where it was recorded.
    clock : Clock or None
        Sample rate against the plan; None where it cannot be estimated.
    motor_delayed : bool
        Whether the motor's motion is the only response and is delayed against the torque, as by smoothing.
    """

    files: tuple[FileRef, ...]
    started_at: str | None
    quality: Quality
    transients: xr.Dataset | None
    rigid_body: RigidBody | None
    reasons: tuple[str, ...] = ()
    extracts: Mapping[int, Any] = field(default_factory=dict)
    drive: DriveInput | None = None
    rotations: tuple[Mapping[str, RotationSums], ...] = ()
    lost_motion: tuple[LostMotion, ...] = ()
    temperature: TemperatureCourse | None = None
    clock: Clock | None = None
    motor_delayed: bool = False


@dataclass(frozen=True)
class _Trip:
    """Results of one recording; ``channels`` has no samples, and is None where the recording is bad."""

    file: FileRef
    started_at: str | None
    findings: tuple[Finding, ...]
    channels: Aligned | None = None
    segments: tuple[TransientSegment, ...] = ()
    sums: tuple[NormalEquations, ...] = ()
    check_sums: tuple[NormalEquations, ...] = ()
    extract: Any = None
    offsets: Array = field(default_factory=lambda: np.empty(0))
    temperatures: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)
    rotations: Mapping[str, RotationSums] = field(default_factory=dict)
    moves: MoveTimes | None = None
    notes: tuple[str, ...] = ()


def measure(
    files: Sequence[str | Path | Recording],
    channels: ChannelMap | None,
    *,
    sheet: DataSheet | None = None,
    plan: Plan | None = None,
    mass: float | None = None,
    extract: Callable[[Aligned], Any] | None = None,
    top: float | None = None,
    progress: Progress | None = None,
) -> Measurement:
    """Read, check and cut the files of one run.

    Parameters
    ----------
    files : sequence of path-like or Recording
        Usually one for each round trip.
    channels : ChannelMap or None
        Meaning of the channels of files; None where there are none.
    sheet : DataSheet, optional
        Data sheet of the axis; without it a torque is no force, and no mass can be checked.
    plan : Plan, optional
        Plan of the test; without it stops and speeds are clustered, and completeness is not checked.
    mass : float, optional
        Load on the table, kg; without it the load is not checked.
    extract : callable, optional
        Called with the channels of each usable recording at one rate; its result is stored in ``extracts``.
    top : float, optional
        Highest frequency needed in the transients, Hz, to which they are decimated. By default they are not.
    progress : callable, optional
        Called with the number of files that are done, the number of all files, and the next file's name.

    Returns
    -------
    Measurement
        Bad recordings are set aside; where all are bad, the verdict is bad and there are no transients.

    Raises
    ------
    InputError
        If a file, the channel map, the plan or the load is wrong.
    """
    _check_arguments(files, sheet, plan, mass)

    def read(rate: float | None = None) -> list[_Trip]:
        report = progress or ignore_progress
        trips = []
        for index, file in enumerate(files):
            report(index, len(files), _name(file))
            trips.append(_read_trip(_recording(file, channels), sheet, plan, extract, top, rate))
        report(len(files), len(files), "")
        return trips

    trips = read()
    rate = _common_rate(trips)
    if rate is not None:
        trips = read(rate)
    trips = _in_order(trips, plan)
    _check_same_run(trips)
    refs = tuple(trip.file for trip in trips)
    started_at = next(filter(None, [trip.started_at for trip in trips]), None)
    findings = list(chain.from_iterable(trip.findings for trip in trips))
    notes = list(chain.from_iterable(trip.notes for trip in trips))
    usable = [trip for trip in trips if trip.channels is not None]
    if not usable:
        why = ("no recording is good enough",)
        return Measurement(refs, started_at, Quality.of(findings, notes), None, None, why)
    if len(usable) < len(trips):
        findings = _set_aside(trips)
    like = cast("Aligned", usable[0].channels)
    transients = label(sum((trip.segments for trip in usable), ()), like, mass, plan)
    rigid_body, reasons = _rigid_body(usable, transients, sheet)
    findings += check_run(transients, plan, sheet, mass, rigid_body)
    clock, of_clock = _clock(usable, like.rate, findings)
    findings += of_clock
    return Measurement(
        files=refs,
        started_at=started_at,
        quality=Quality.of(findings, notes),
        transients=transients,
        rigid_body=rigid_body,
        reasons=reasons,
        extracts=_extracts(trips),
        drive=like.drive,
        rotations=tuple(trip.rotations for trip in usable),
        lost_motion=lost_motion(transients, np.concatenate([trip.offsets for trip in usable])),
        temperature=temperature_course([trip.temperatures for trip in usable]),
        clock=clock,
        motor_delayed=_motor_delayed(like, findings),
    )


def _motor_delayed(like: Aligned, findings: Sequence[Finding]) -> bool:
    """Whether the motor's motion is the only response and is delayed against the torque."""
    of_motor = all(":motor" in name for name in like.responses)
    return of_motor and any(finding.code == "delay" for finding in findings)


def _extracts(trips: Sequence[_Trip]) -> dict[int, Any]:
    return {index: trip.extract for index, trip in enumerate(trips) if trip.extract is not None}


def _check_arguments(
    files: Sequence[object], sheet: DataSheet | None, plan: Plan | None, mass: float | None
) -> None:
    if not files:
        raise InputError("no file is given; a run takes one recording or more.")
    if mass is not None and not (math.isfinite(mass) and mass >= 0):
        raise InputError(f"the load on the table is {mass:g} kg; it must be 0 kg or more.")
    if plan is not None and sheet is not None:
        validate_plan(plan, sheet)


def _name(file: str | Path | Recording) -> str:
    return file.file.name if isinstance(file, Recording) else Path(file).name


def _recording(file: str | Path | Recording, channels: ChannelMap | None) -> Recording:
    """A recording as given, or read from its file."""
    if isinstance(file, Recording):
        return file
    if channels is None:
        raise InputError(f"{file}: no channel map is given (channels), which a file requires.")
    return read_recording(file, channels)


def _read_trip(
    recording: Recording,
    sheet: DataSheet | None,
    plan: Plan | None,
    extract: Callable[[Aligned], Any] | None,
    top: float | None,
    rate: float | None,
) -> _Trip:
    """Check one recording, at a rate other than its own if given; only its transients are retained."""
    trip = _Trip(recording.file, recording.started_at, check_signals(recording), notes=recording.notes)
    try:
        aligned = align(recording, sheet)
    except MeasurementError as error:
        return replace(trip, findings=(*trip.findings, Finding("bad", "currents", str(error))))
    if _is_bad(trip.findings):
        return trip
    if rate is not None:
        aligned = replace(aligned, rate=rate)
    derived = derived_from_encoder(recording, aligned)
    aligned = _without_encoder_error(aligned, derived)
    motion = kinematics(aligned.position, aligned.rate)
    least_speed = None
    if plan is not None:
        least_speed = _SLOWEST * min(planned.speed for planned in plan.motions)
    phases = find_phases(motion, least_speed=least_speed)
    aligned, corners = undo_high_pass(aligned, phases, derived)
    found = check_motion(recording, aligned, motion, phases, plan)
    coupled = check_high_pass(recording.file.name, aligned.responses, corners)
    trip = replace(trip, findings=(*trip.findings, *coupled, *found))
    if _is_bad(trip.findings):
        return trip
    nothing = np.empty(0)
    return replace(
        trip,
        channels=replace(
            aligned, input=nothing, position=nothing, response=np.empty((0, 0)), across={}, motor=None
        ),
        segments=cut(aligned, phases, 0, top),
        sums=normal_equations(motion, aligned.input, phases),
        check_sums=normal_equations(motion, aligned.input, used=CHECK_RANGE),
        extract=None if extract is None else extract(aligned),
        offsets=table_offsets(recording, phases, aligned.rate),
        temperatures=trip_temperatures(recording),
        rotations=rotation_sums(aligned, phases),
        moves=None if plan is None else measure_move_times(motion, phases, plan),
    )


def _clock(
    usable: Sequence[_Trip], rate: float, found: Sequence[Finding]
) -> tuple[Clock | None, list[Finding]]:
    """Clock of a run with its findings, unless the rate is known to be wrong."""
    clock = estimate_clock([trip.moves for trip in usable if trip.moves is not None])
    if "rate" in [finding.code for finding in found]:
        return clock, []
    return clock, check_clock(clock, rate)


def _without_encoder_error(aligned: Aligned, derived: Sequence[bool]) -> Aligned:
    """Channels without the interpolation error of the encoder, also in responses derived from it."""
    error = interpolation_error(aligned.position, aligned.rate)
    if not error.any():
        return aligned
    response = aligned.response.copy()
    response[np.array(derived), 1:-1] -= np.diff(error, 2) * aligned.rate**2
    return replace(aligned, position=aligned.position - error, response=response)


def _is_bad(findings: Sequence[Finding]) -> bool:
    return "bad" in [finding.severity for finding in findings]


def _in_order(trips: Sequence[_Trip], plan: Plan | None) -> list[_Trip]:
    """Trips in an order that does not depend on how the files were given, with their segments numbered."""
    ordered = list(trips)
    if not order_matters(plan):
        ordered.sort(key=lambda trip: trip.file.sha256)
    # Fails where a time is missing or invalid, or where only some have a time zone.
    with suppress(TypeError, ValueError):
        ordered = sorted(ordered, key=lambda trip: datetime.fromisoformat(trip.started_at or ""))
    numbered = []
    for index, trip in enumerate(ordered):
        segments = tuple(replace(segment, file=index) for segment in trip.segments)
        numbered.append(replace(trip, segments=segments))
    return numbered


def _common_rate(trips: Sequence[_Trip]) -> float | None:
    """Rate of all trips, Hz, where theirs differ and agree to 100 ppm: of the fewest digits among them."""
    rates = sorted(trip.channels.rate for trip in trips if trip.channels is not None)
    if not rates or not rates[0] < rates[-1] <= (1 + _SAME_RATE) * rates[0]:
        return None
    middle = (rates[0] + rates[-1]) / 2
    rounded = (float(f"{middle:.{digits}g}") for digits in range(1, 17))
    return next((rate for rate in rounded if rates[0] <= rate <= rates[-1]), middle)


def _check_same_run(trips: Sequence[_Trip]) -> None:
    """Refuse copies of a recording, whose scatter would be too small, and different rates or channels."""
    names: dict[str, str] = {}
    kinds: dict[tuple[Any, ...], str] = {}
    for trip in trips:
        name, content = trip.file.name, trip.file.sha256
        if content in names:
            raise InputError(f"{name}: has the same content as {names[content]}; give each recording once.")
        names[content] = name
        if trip.channels is not None:
            kinds[trip.channels.rate, trip.channels.quantity, trip.channels.responses] = name
    if len(kinds) > 1:
        (kind, name), (other_kind, other_name), *_ = kinds.items()
        raise InputError(
            f"{other_name}: does not belong to one run with {name}: {_difference(kind, other_kind)}"
        )


def _difference(kind: tuple[Any, ...], other: tuple[Any, ...]) -> str:
    """How rate, input or responses of two recordings differ, and what to do."""
    if kind[1:] != other[1:]:
        return f"input and responses are {other[1:]} and {kind[1:]}; they must be the same."
    return (
        f"the sample rates are {other[0]:.7g} Hz and {kind[0]:.7g} Hz, which differ by more than 100 ppm; if "
        "they are one rate, declare it as sample_rate in channels.toml."
    )


def _set_aside(trips: Sequence[_Trip]) -> list[Finding]:
    """Findings of a run without its bad recordings: suspect, with the names of these."""
    names = ", ".join(trip.file.name for trip in trips if trip.channels is None)
    findings = [Finding("suspect", "set-aside", f"excluded because they are bad: {names}")]
    for trip in trips:
        findings += [replace(finding, severity="suspect") for finding in trip.findings]
    return findings


def _rigid_body(
    trips: Sequence[_Trip], transients: xr.Dataset, sheet: DataSheet | None
) -> tuple[RigidBody | None, tuple[str, ...]]:
    """Rigid-body fit of a run, or the reason why there is none."""
    quantity = str(transients["input"].attrs["quantity"])
    scale = force_scale(quantity, sheet)
    if scale is None:
        missing = "drive.torque_constant" if quantity == "current" else "drive.rated_torque"
        if sheet is None:
            missing = "the lead"
        return None, (f"a {quantity} is no force without {missing} of a data sheet (--axis)",)
    sums = tuple(chain.from_iterable(trip.sums for trip in trips))
    check_sums = tuple(chain.from_iterable(trip.check_sums for trip in trips))
    try:
        return estimate_rigid_body(sums, check_sums, _cells(trips, transients)).scaled(scale), ()
    except MeasurementError as error:
        return None, (str(error),)


def _cells(trips: Sequence[_Trip], transients: xr.Dataset) -> list[tuple[object, ...]]:
    """Stop, condition and motion of each phase; a recording without phases is one group."""
    columns = [transients[name].values.tolist() for name in ("position_m", "condition", "motion")]
    rows = zip(*columns, strict=True)
    cells: list[tuple[object, ...]] = []
    for trip in trips:
        own = list(islice(rows, len(trip.segments)))
        cells += own or [()]
    return cells
