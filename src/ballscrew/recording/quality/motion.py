"""The gate's second part: what the motion shows of rate, steps, signs and sensors."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ballscrew.fcft.plan import Plan
from ballscrew.recording.aligned import Aligned
from ballscrew.recording.kinematics import Kinematics
from ballscrew.recording.phases import Phase
from ballscrew.recording.quality.delay import (
    InStep,
    check_step,
    compare,
    derived_responses,
    estimate_delay,
)
from ballscrew.recording.quality.dropped import check_dropped
from ballscrew.recording.quality.finding import Finding
from ballscrew.recording.quality.lowband import low_band
from ballscrew.recording.quality.sensors import check_agreement, check_gains, gain_ratio
from ballscrew.recording.quality.timing import check_timing, measure_timing
from ballscrew.recording.recording import Recording

__all__ = ["check_motion", "estimate_delay"]

_SAME_TRAVEL = 0.05  # of the plan's travel
_OTHER_UNIT = 100.0  # times less than the plan's travel


def check_motion(
    recording: Recording,
    aligned: Aligned,
    motion: Kinematics,
    phases: Sequence[Phase],
    plan: Plan | None = None,
) -> tuple[Finding, ...]:
    """Find what the motion shows to be wrong with one recording.

    Parameters
    ----------
    recording : Recording
        As read.
    aligned : Aligned
        Its input, position and accelerations at one rate.
    motion : Kinematics
        Its motion.
    phases : sequence of Phase
        Its accelerations and decelerations.
    plan : Plan, optional
        What should have been run.

    Returns
    -------
    tuple of Finding
        No motion, a rate that contradicts the plan or the accelerometers, another speed, lost samples,
        torque and acceleration out of step, inverted, of a wrong scale, sensors that disagree.
    """
    file = recording.file.name
    if not phases:
        with np.errstate(all="ignore"):
            return (*check_dropped(file, motion, phases), _no_motion(file, motion, plan))
    band = low_band(aligned, phases)
    with np.errstate(all="ignore"):  # what overflows here is no number that any check believes
        step = InStep(None, ()) if band is None else compare(band, derived=_derived(recording, aligned))
        gain = gain_ratio(step)
        findings: list[Finding] = []
        confirmed = False
        if plan is not None:
            findings, confirmed = check_timing(file, motion.rate, measure_timing(motion, phases, plan), gain)
        findings = [*findings, *check_dropped(file, motion, phases)]
        if band is None:
            return tuple(findings)
        findings += check_step(file, aligned, step)
        scales = check_gains(file, aligned, step, rate_known=confirmed)
        if any(finding.code == "rate" for finding in findings):  # which explains the accelerometers' scale
            scales = [finding for finding in scales if finding.code != "scale"]
        findings += scales
        findings += check_agreement(file, aligned, phases, step)
    return tuple(findings)


def _derived(recording: Recording, aligned: Aligned) -> tuple[bool, ...]:
    """Which responses come from the encoder, as the channel map says or as their values show."""
    seen = derived_responses(aligned)
    told = [
        bool(recording.channels[name].attrs.get("derived")) if name in recording.channels else False
        for name in aligned.responses
    ]
    return tuple(a or b for a, b in zip(told, seen, strict=True))


def _no_motion(file: str, motion: Kinematics, plan: Plan | None) -> Finding:
    travel = float(np.ptp(motion.position)) if len(motion.position) else 0.0
    moved = f"its position covers {1e3 * travel:.4g} mm at up to {1e3 * motion.cruise:.4g} mm/s"
    wanted = ""
    if plan is not None:
        way = 1e3 * (plan.positions[-1] - plan.positions[0])
        speed = 1e3 * max(planned.speed for planned in plan.motions)
        wanted = f", and the plan {way:.4g} mm at {speed:.4g} mm/s"
        if abs(1e3 * travel / way - 1) < _SAME_TRAVEL:
            wanted += ": it ran slower, or the sample rate is wrong"
        elif 1e3 * travel < way / _OTHER_UNIT:
            wanted += ": it stood, or the position's unit is wrong"
    return Finding("bad", "no-motion", f"{file}: no move from a stop to a stop can be seen: {moved}{wanted}")
