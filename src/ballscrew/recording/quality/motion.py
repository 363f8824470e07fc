"""Second part of the quality gate: faults that show in the motion."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from ballscrew.fcft.plan import Plan
from ballscrew.recording.aligned import Aligned
from ballscrew.recording.kinematics import Kinematics
from ballscrew.recording.phases import MotionPhase, pauses
from ballscrew.recording.quality.delay import (
    Synchronisation,
    check_synchronisation,
    compare_with_encoder,
    derived_responses,
)
from ballscrew.recording.quality.finding import Finding, severity
from ballscrew.recording.quality.lowband import low_band
from ballscrew.recording.quality.sensors import check_agreement, check_gains, crosswise_gains, gain_ratio
from ballscrew.recording.quality.timebase import check_timing, measure_timing
from ballscrew.recording.recording import Recording

_SAME_TRAVEL = 0.05  # of the plan's travel
_OTHER_UNIT = 100.0  # times less than the plan's travel

_JUMP = 0.6  # of the way in a sample interval: a lost sample adds 1
_QUIET = 0.3  # of the same way: where the encoder's steps scatter more, single samples cannot be checked
_NEIGHBOURS = 9  # samples, whose median is the expected way
_FAST = 0.3  # of the cruising speed: below, the encoder's steps are as large as the way
_OFTEN = 98.0  # percentile of the speed that the cruising speed may not exceed
_MANY_JUMPS = 10  # a few jumps spoil a few transients, many spoil all
_PAUSE = 6e-3  # s: a controller's cycle, and the effect of friction on the last micrometres
_PAUSE_SAMPLES = 2.0  # its ends are found to a sample each
_PAUSE_TYPICAL = 10.0  # times the median deviation of all pauses
_FEW_PAUSES = 0.1  # of all pauses: more odd ones are a property of the machine


def check_motion(
    recording: Recording,
    aligned: Aligned,
    motion: Kinematics,
    phases: Sequence[MotionPhase],
    plan: Plan | None = None,
) -> tuple[Finding, ...]:
    """Check the motion of a recording against the plan, and its channels against each other.

    Parameters
    ----------
    recording : Recording
        As read.
    aligned : Aligned
        Input, position and accelerations of the recording at one rate.
    motion : Kinematics
        Motion of the recording.
    phases : sequence of MotionPhase
        Accelerations and decelerations of the recording.
    plan : Plan, optional
        Plan of the run.

    Returns
    -------
    tuple of Finding
        No motion, a rate that contradicts the plan or the accelerometers, another speed, lost samples,
        torque and acceleration not synchronous, inverted, of a wrong scale, sensors that disagree.
    """
    file = recording.file.name
    with np.errstate(all="ignore"):  # no check accepts a number that overflows here
        if not phases:
            return (*check_dropped(file, motion, phases), _no_motion(file, motion, plan))
        band = low_band(aligned, phases)
        found = Synchronisation(None, ())
        if band is not None:
            speeds = [_is_speed(recording, name) for name in aligned.responses]
            derived = derived_from_encoder(recording, aligned)
            found = compare_with_encoder(band, derived=derived, rotor=speeds)
        findings: list[Finding] = []
        confirmed = False
        if plan is not None:
            timing = measure_timing(motion, phases, plan)
            findings, confirmed = check_timing(file, motion.rate, timing, gain_ratio(found))
        findings += check_dropped(file, motion, phases)
        if band is None:
            return tuple(findings)
        findings += check_synchronisation(file, aligned, found)
        rate_is_wrong = "rate" in [finding.code for finding in findings]
        across = crosswise_gains(aligned, phases)
        for finding in check_gains(file, aligned, found, rate_known=confirmed, across=across):
            if not (finding.code == "scale" and rate_is_wrong):  # a wrong rate explains the scale
                findings.append(finding)
        findings += check_agreement(file, aligned, phases, found)
    return tuple(findings)


def derived_from_encoder(recording: Recording, aligned: Aligned) -> tuple[bool, ...]:
    """Responses that come from the encoder, by the channel map or by their values."""
    derived = list(derived_responses(aligned))
    for index, name in enumerate(aligned.responses):
        if name in recording.channels and recording.channels[name].attrs.get("derived"):
            derived[index] = not _is_speed(recording, name)
    return tuple(derived)


def _is_speed(recording: Recording, name: str) -> bool:
    """Whether a response is the derivative of the motor's measured speed."""
    return name in recording.channels and recording.channels[name].attrs.get("derive") == "derivative"


def _no_motion(file: str, motion: Kinematics, plan: Plan | None) -> Finding:
    travel = 0.0
    if len(motion.position):
        travel = float(np.ptp(motion.position))
    text = (
        f"{file}: no move from stop to stop was found: "
        f"its position covers {1e3 * travel:.4g} mm at up to {1e3 * motion.cruise:.4g} mm/s"
    )
    if plan is not None:
        way = 1e3 * (plan.positions[-1] - plan.positions[0])
        speed = 1e3 * max(planned.speed for planned in plan.motions)
        text += f", and the plan {way:.4g} mm at {speed:.4g} mm/s"
        if abs(1e3 * travel / way - 1) < _SAME_TRAVEL:
            text += ": it ran slower, or the sample rate is wrong"
        elif 1e3 * travel < way / _OTHER_UNIT:
            text += ": the axis did not move, or the position's unit is wrong"
    return Finding("bad", "no-motion", text)


def position_jumps(motion: Kinematics) -> tuple[NDArray[np.intp], float] | None:
    """Samples at which the position jumps or halts in full motion.

    Parameters
    ----------
    motion : Kinematics
        Motion of one recording.

    Returns
    -------
    at : ndarray of int
        First sample after each jump or halt.
    lost : float
        Sum of the jumps in sample intervals; halts are not counted.
        None instead of both where the encoder is too coarse or too slow.
    """
    step = np.diff(motion.position)
    # A jump changes a smoothed speed around it, but not a median.
    usual = median_filter(step, _NEIGHBOURS, mode="nearest")
    # Many jumps make a speed of their own, but not in the median of their neighbours.
    cruise = min(motion.cruise, float(np.percentile(np.abs(usual), _OFTEN)) * motion.rate)
    fast = np.abs(usual) * motion.rate > _FAST * cruise
    if cruise <= 0 or np.count_nonzero(fast) < 4 * _NEIGHBOURS:
        return None
    off = np.zeros_like(step)
    off[fast] = np.abs(step[fast] / usual[fast] - 1)
    if np.percentile(off[fast], 98) > _QUIET:
        return None
    at = np.flatnonzero(off > _JUMP)
    ahead = (step[at] - usual[at]) * np.sign(usual[at]) > 0
    return at + 1, float(np.sum(off[at][ahead]))


def odd_pauses(motion: Kinematics, phases: Sequence[MotionPhase]) -> list[tuple[float, float, float]]:
    """Pauses between two moves that differ from all others.

    Parameters
    ----------
    motion : Kinematics
        Motion of one recording.
    phases : sequence of MotionPhase
        Phases of the recording.

    Returns
    -------
    list of (start, duration, usual duration)
        s; empty where there are few pauses, or many odd ones.
    """
    found = np.array(pauses(phases))
    if len(found) < 8:
        return []
    start, length = found[:, 0], np.diff(found)[:, 0]
    usual = float(np.median(length))
    off = np.abs(length - usual)
    odd = off > max(_PAUSE * motion.rate, _PAUSE_SAMPLES, _PAUSE_TYPICAL * float(np.median(off)))
    if np.count_nonzero(odd) > max(1.0, _FEW_PAUSES * len(found)):
        return []
    seconds = np.stack([start[odd], length[odd], np.full(np.count_nonzero(odd), usual)]) / motion.rate
    return list(map(tuple, seconds.T.tolist()))


def check_dropped(file: str, motion: Kinematics, phases: Sequence[MotionPhase]) -> list[Finding]:
    """Findings on lost samples.

    Parameters
    ----------
    file : str
        Name of the file, for the messages.
    motion : Kinematics
        Motion of one recording.
    phases : sequence of MotionPhase
        Phases of the recording.

    Returns
    -------
    list of Finding
        Empty where no samples are lost.
    """
    findings = []
    found = position_jumps(motion)
    if found is not None and len(found[0]):
        at, lost = found
        text = (
            f"{file}: the position jumps at {len(at)} samples in full motion, the first at "
            f"{at[0] / motion.rate:.4g} s, over {lost:.3g} sample intervals in all: samples were dropped"
        )
        findings.append(Finding(severity(bad=len(at) > _MANY_JUMPS), "dropped", text))
    odd = odd_pauses(motion, phases)
    if odd:
        start, length, usual = odd[0]
        text = (
            f"{file}: the pause at {start:.4g} s takes {1e3 * length:.4g} ms, all others "
            f"{1e3 * usual:.4g} ms: samples were dropped, or the axis waited"
        )
        findings.append(Finding("suspect", "pause", text))
    return findings
