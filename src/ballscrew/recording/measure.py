"""From the files of a run to its transients: read, checked, cut, one recording at a time in memory."""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from datetime import datetime
from functools import reduce
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from ballscrew.axis.sheet import DataSheet
from ballscrew.base.errors import InputError, MeasurementError
from ballscrew.base.files import Progress
from ballscrew.base.provenance import FileRef
from ballscrew.fcft.plan import Plan, validate_plan
from ballscrew.recording.aligned import Aligned, align
from ballscrew.recording.channels import ChannelMap
from ballscrew.recording.kinematics import kinematics
from ballscrew.recording.load import read_recording
from ballscrew.recording.lost_motion import LostMotion, lost_motion, table_offsets
from ballscrew.recording.motions import order_matters
from ballscrew.recording.phases import find_phases
from ballscrew.recording.quality.completeness import check_run
from ballscrew.recording.quality.finding import Finding, Quality
from ballscrew.recording.quality.motion import check_motion
from ballscrew.recording.quality.signals import check_signals
from ballscrew.recording.rigid_body import (
    CHECK_CUTOFF,
    CUTOFF,
    NormalEquations,
    RigidBody,
    normal_equations,
    solve,
)
from ballscrew.recording.transients import Segment, cut, label

__all__ = ["Measurement", "force_scale", "measure"]

_SLOWEST = 0.5  # of the plan's lowest speed that a phase must reach


@dataclass(frozen=True)
class Measurement:
    """What the files of a run hold.

    Parameters
    ----------
    files : tuple of FileRef
        By start time where every file has one, by SHA-256 otherwise; in the order given where that says which
        trip is which, see :func:`~ballscrew.recording.motions.order_matters`.
    started_at : str or None
        Start time of the first file that has one.
    quality : Quality
        Verdict on all of them together.
    transients : Dataset or None
        The table *Transients*; None where no recording could be used.
    rigid_body : RigidBody or None
        In N and kg, referred to the table; None where it cannot be known.
    reasons : tuple of str
        Why there is no rigid body.
    kept : mapping of int to object
        What was asked to be kept of each recording that could be used, by its place in ``files``.
    lost_motion : tuple of LostMotion
        By stop, where the channel map names a position of the table beside the motor's.
    """

    files: tuple[FileRef, ...]
    started_at: str | None
    quality: Quality
    transients: xr.Dataset | None
    rigid_body: RigidBody | None
    reasons: tuple[str, ...] = ()
    kept: Mapping[int, Any] = field(default_factory=dict)
    lost_motion: tuple[LostMotion, ...] = ()


@dataclass(frozen=True)
class _Trip:
    """What is kept of one recording."""

    file: FileRef
    started_at: str | None
    findings: tuple[Finding, ...]
    like: Aligned | None
    segments: tuple[Segment, ...]
    sums: tuple[NormalEquations, ...]
    kept: Any = None
    offsets: NDArray[np.float64] = field(default_factory=lambda: np.empty(0))


def measure(
    files: Sequence[str | Path],
    channels: ChannelMap,
    *,
    sheet: DataSheet | None = None,
    plan: Plan | None = None,
    mass: float | None = None,
    keep: Callable[[Aligned], Any] | None = None,
    top: float | None = None,
    progress: Progress | None = None,
) -> Measurement:
    """Read, check and cut the files of one run.

    Parameters
    ----------
    files : sequence of path-like
        Recordings, usually one a round trip.
    channels : ChannelMap
        What each channel of the files is.
    sheet : DataSheet, optional
        The axis; without it a torque is no force, and no mass can be checked.
    plan : Plan, optional
        The test; without it stops and speeds are found by clustering, and nothing is known to be missing.
    mass : float, optional
        Load on the table, kg; without it the load is not checked.
    keep : callable, optional
        What is to be kept of a recording once it is let go; called with its channels at one rate.
    top : float, optional
        Highest frequency wanted of the transients, Hz: no more samples than that takes are kept of them. By
        default all are.
    progress : callable, optional
        Called with how many files are done, how many there are, and which comes next.

    Returns
    -------
    Measurement
        Recordings that are bad are set aside; where all are, the verdict is bad and there are no transients.

    Raises
    ------
    InputError
        If a file, the channel map, the plan or the load is wrong.
    """
    if not files:
        raise InputError("no file is given; a run takes one recording or more.")
    if mass is not None and not (math.isfinite(mass) and mass >= 0):
        raise InputError(f"the load on the table is {mass:g} kg; it must be 0 kg or more.")
    if plan is not None and sheet is not None:
        validate_plan(plan, sheet)
    trips = []
    for index, file in enumerate(files):
        if progress:
            progress(index, len(files), Path(file).name)
        trips.append(_trip(Path(file), channels, plan, keep, top))
    if progress:
        progress(len(files), len(files), "")
    trips = _in_order(trips, plan)
    _belong_together(trips)
    started_at = next((trip.started_at for trip in trips if trip.started_at), None)
    findings = tuple(finding for trip in trips for finding in trip.findings)
    used = [trip for trip in trips if trip.like is not None]
    refs = tuple(trip.file for trip in trips)
    if not used:
        why = ("no recording is good enough",)
        return Measurement(refs, started_at, Quality.of(findings), None, None, why)
    if len(used) < len(trips):
        findings = _set_aside(trips)
    like = used[0].like
    assert like is not None  # noqa: S101  for the type checker: used holds only such
    transients = label([s for trip in used for s in trip.segments], like, mass, plan)
    fit, reasons = _rigid_body([trip.sums for trip in used], like.quantity, sheet)
    findings = (*findings, *check_run(transients, plan, sheet, mass, fit))
    kept = {index: trip.kept for index, trip in enumerate(trips) if trip.kept is not None}
    lost = lost_motion(transients, np.concatenate([trip.offsets for trip in used]))
    return Measurement(refs, started_at, Quality.of(findings), transients, fit, reasons, kept, lost)


def force_scale(quantity: str, sheet: DataSheet | None) -> float | None:
    """What takes the input to a force at the table, in N per unit of the input.

    Parameters
    ----------
    quantity : str
        torque, force or current.
    sheet : DataSheet or None
        Gives the lead, and the torque constant if it knows one.

    Returns
    -------
    float or None
        None where it cannot be known.
    """
    if quantity == "force":
        return 1.0
    if sheet is None:
        return None
    per_torque = 2 * math.pi / sheet.screw.lead
    if quantity == "torque":
        return per_torque
    return per_torque * sheet.drive.torque_constant if sheet.drive.torque_constant else None


def _trip(
    path: Path,
    channels: ChannelMap,
    plan: Plan | None,
    keep: Callable[[Aligned], Any] | None,
    top: float | None,
) -> _Trip:
    """Read one recording, check it, and keep only its transients and sums."""
    recording = read_recording(path, channels)
    aligned = align(recording)
    found = check_signals(recording)
    if any(finding.severity == "bad" for finding in found):
        return _Trip(recording.file, recording.started_at, found, None, (), ())
    motion = kinematics(aligned.position, aligned.rate)
    least = _SLOWEST * min(m.speed for m in plan.motions) if plan else None
    phases = find_phases(motion, least_speed=least)
    found = (*found, *check_motion(recording, aligned, motion, phases, plan))
    if any(finding.severity == "bad" for finding in found):
        return _Trip(recording.file, recording.started_at, found, None, (), ())
    none = np.empty(0)
    head = replace(aligned, input=none, position=none, response=np.empty((0, 0)))
    sums = tuple(normal_equations(motion, aligned.input, cutoff) for cutoff in (CUTOFF, CHECK_CUTOFF))
    kept = keep(aligned) if keep is not None else None
    segments = cut(aligned, phases, 0, top)
    offsets = table_offsets(recording, phases, aligned.rate)
    return _Trip(recording.file, recording.started_at, found, head, segments, sums, kept, offsets)


def _in_order(trips: Sequence[_Trip], plan: Plan | None) -> list[_Trip]:
    """Trips in an order that does not depend on how the files were given, and their segments numbered so."""
    ordered = list(trips)
    if not order_matters(plan):
        ordered.sort(key=lambda trip: trip.file.sha256)
    # Fails where a time is missing or invalid, or where only some have a time zone.
    with suppress(TypeError, ValueError):
        ordered = sorted(ordered, key=lambda trip: datetime.fromisoformat(trip.started_at or ""))
    return [
        replace(trip, segments=tuple(replace(segment, file=index) for segment in trip.segments))
        for index, trip in enumerate(ordered)
    ]


def _belong_together(trips: Sequence[_Trip]) -> None:
    """Refuse twins, whose scatter would be a lie, and files of different rates or channels."""
    seen: dict[str, str] = {}
    for trip in trips:
        if trip.file.sha256 in seen:
            twin = seen[trip.file.sha256]
            raise InputError(f"{trip.file.name}: has the same content as {twin}; give each recording once.")
        seen[trip.file.sha256] = trip.file.name
    kinds = {(t.like.rate, t.like.quantity, t.like.responses): t.file.name for t in trips if t.like}
    if len(kinds) > 1:
        first, second, *_ = kinds.items()
        raise InputError(
            f"{second[1]}: does not belong to one run with {first[1]}: rate, input and responses are "
            f"{second[0]} and {first[0]}; they must be the same."
        )


def _set_aside(trips: Sequence[_Trip]) -> tuple[Finding, ...]:
    """Findings of a run that goes on without its bad recordings: suspect, and says which."""
    lost = [trip.file.name for trip in trips if trip.like is None]
    aside = Finding("suspect", "set-aside", f"set aside, since bad: {', '.join(lost)}")
    return (aside, *(Finding("suspect", f.code, f.message) for trip in trips for f in trip.findings))


def _rigid_body(
    sums: Sequence[tuple[NormalEquations, ...]], quantity: str, sheet: DataSheet | None
) -> tuple[RigidBody | None, tuple[str, ...]]:
    scale = force_scale(quantity, sheet)
    if scale is None:
        missing = "the lead" if sheet is None else "drive.torque_constant"
        return None, (f"a {quantity} is no force without {missing} of a data sheet (--axis)",)
    try:
        fit, check = (solve(reduce(operator.add, parts)) for parts in zip(*sums, strict=True))
        return fit.checked(check).scaled(scale), ()
    except MeasurementError as error:
        return None, (str(error),)
