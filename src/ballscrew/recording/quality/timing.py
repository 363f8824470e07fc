"""The plan's motion times as a clock: a wrong sample rate, told from a speed override and a wrong scale."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ballscrew.fcft.plan import Plan
from ballscrew.recording.kinematics import Kinematics
from ballscrew.recording.motions import nearest_motion
from ballscrew.recording.phases import Phase
from ballscrew.recording.quality.finding import Finding

__all__ = ["Timing", "check_timing", "measure_timing"]

# On good records speed agrees with the plan to 0.2 %, acceleration to 0.3 %, the time of an acceleration to
# 2 %, the dwell to 0.5 %; a drive's own overshoot and its wait for position add to that.
_RATE = 0.008  # in the logarithm: 1 % of the frequency is 12 to 35 % of the preload; trips differ by 0.5 %
_RATE_BAD = 0.02
_SPEED = 0.02
_SPEED_NOISE = 0.005
_TIME_NOISE = 0.04
_DWELL_NOISE = 0.01
_WAY_NOISE = 2e-3  # a drive stops within some hundredths of a millimetre
_GAIN_TRUE = 0.06  # a calibrated accelerometer's gain is within half of it
_GAIN_NOISE = 0.02  # an accelerometer's scale, as a part of the rate, that is its square root
_PART = 0.35  # of an effect by which its witnesses may differ
_ACCELERATION = 0.10
_SCALE_BAD = 0.2
_CRUISE = 0.2  # of a cruise left out at either end, where the speed still settles
_LEAST_CRUISE = 0.03  # s


@dataclass(frozen=True, slots=True)
class Timing:
    """Measured over planned, as natural logarithms; None where it cannot be told.

    Parameters
    ----------
    speed : float, optional
        Held between two stops.
    acceleration : float, optional
        Highest.
    duration : float, optional
        Time that an acceleration takes.
    dwell : float, optional
        Standstill between two moves.
    way : float, optional
        From stop to stop, over the nearest of the plan's.
    """

    speed: float | None
    acceleration: float | None
    duration: float | None
    dwell: float | None
    way: float | None = None


def measure_timing(motion: Kinematics, phases: Sequence[Phase], plan: Plan) -> Timing:
    """Compare a recording's motion with the plan's.

    Parameters
    ----------
    motion : Kinematics
        Of the recording.
    phases : sequence of Phase
        Of it.
    plan : Plan
        A phase is compared with the motion that is nearest to it in speed and acceleration.

    Returns
    -------
    Timing
        Medians over all phases.
    """
    speeds, accelerations, durations, dwells, ways = [], [], [], [], []
    planned_ways = np.diff(np.array(plan.positions))
    for phase in phases:
        planned = plan.motions[nearest_motion(phase, plan)]
        if phase.complete and phase.stop > phase.start:
            durations.append((phase.stop - phase.start) / motion.rate / planned.acceleration_time)
            if planned.jerk_time < planned.acceleration_time / 4 and phase.acceleration > 0:
                accelerations.append(phase.acceleration / planned.peak_acceleration)
    for one, other in pairwise(phases):
        gap = other.start - one.stop
        if one.condition.accelerating and not other.condition.accelerating:
            if one.complete and other.complete:
                moved = abs(other.stop_position - one.stop_position)
                ways.append(moved / float(planned_ways[np.argmin(np.abs(planned_ways - moved))]))
            skip = int(_CRUISE * gap)
            first, last = one.stop + skip, other.start - skip
            if last - first > _LEAST_CRUISE * motion.rate:
                way = abs(float(motion.position[last] - motion.position[first]))
                speeds.append(
                    way * motion.rate / (last - first) / plan.motions[nearest_motion(one, plan)].speed
                )
        elif other.condition.accelerating and not one.condition.accelerating and gap > 0:
            planned = plan.motions[nearest_motion(one, plan)]
            if planned.dwell > planned.acceleration_time:
                dwells.append(gap / motion.rate / planned.dwell)
    return Timing(_log(speeds), _log(accelerations), _log(durations), _log(dwells), _log(ways))


def _log(ratios: list[float]) -> float | None:
    good = [ratio for ratio in ratios if ratio > 0]
    return float(np.log(np.median(good))) if len(good) >= 2 else None


def check_timing(file: str, rate: float, timing: Timing, gain: float | None) -> tuple[list[Finding], bool]:
    """Judge the sample rate, the speed and the position's scale by the plan's times.

    A rate that is declared r times too high makes the speed r times, the encoder's acceleration r² times and
    every time 1/r times what it was, and the accelerometer 1/r² times the encoder. A speed override leaves
    the dwell alone and the accelerometer at the encoder's acceleration; a wrong scale of the position leaves
    all times alone.

    Parameters
    ----------
    file : str
        For the message.
    rate : float
        Sample rate of the recording, Hz.
    timing : Timing
        From :func:`measure_timing`.
    gain : float, optional
        Accelerometers over the encoder.

    Returns
    -------
    findings : list of Finding
        One at most.
    confirmed : bool
        Whether the plan's times tell what the rate is, right or wrong.
    """
    speed, acceleration, dwell = timing.speed, timing.acceleration, timing.dwell
    if speed is None:
        return [], False
    told = _told(timing)
    witnesses = [
        _confirms(speed, value, noise)
        for value, noise in (
            (None if dwell is None else -dwell, _DWELL_NOISE),
            (None if gain is None else -np.log(gain) / 2, _GAIN_NOISE),
        )
        if value is not None
    ]
    if timing.way is not None and _confirms(speed, timing.way, _WAY_NOISE):  # which no rate changes
        witnesses = [False]
    # A soft servo smears the time of an acceleration; dwell and accelerometer together need no third.
    if abs(speed) > _RATE and (_scales_time(timing) or (len(witnesses) == 2 and all(witnesses))):
        wrong = 100 * abs(np.expm1(speed))
        if any(witnesses):
            beside = "" if gain is None else f", accelerometer over encoder is {gain:.3g}"
            text = (
                f"{file}: the sample rate contradicts the plan: {told}{beside}; the motion fits "
                f"{rate / np.exp(speed):.5g} Hz, not {rate:.5g} Hz; every frequency is wrong by {wrong:.3g} %"
            )
            return [Finding("bad" if abs(speed) > _RATE_BAD else "suspect", "rate", text)], True
        if not witnesses:
            text = f"{file}: {told}: the sample rate is wrong by {wrong:.3g} %, or another motion was run"
            return [Finding("suspect", "rate", text)], False
    if abs(speed) > _SPEED:
        if _scales_way(timing, gain):
            factor = speed if timing.way is None else timing.way
            text = f"{file}: the position is scaled wrongly by {np.exp(factor):.4g}: {told}"
            return [Finding("bad" if abs(speed) > _SCALE_BAD else "suspect", "scale", text)], True
        text = f"{file}: the speed is not the plan's, as with an override: {told}"
        return [Finding("suspect", "speed", text)], True
    if acceleration is not None and abs(acceleration) > _ACCELERATION:
        return [
            Finding("suspect", "acceleration", f"{file}: the acceleration is not the plan's: {told}")
        ], True
    return [], True


def _scales_time(timing: Timing) -> bool:
    """Whether speed, acceleration and duration all tell one and the same factor of the time."""
    speed = timing.speed
    if speed is None:
        return False
    tests = []
    if timing.acceleration is not None:
        tests.append(_agrees(speed, timing.acceleration / 2, _SPEED_NOISE))
    if timing.duration is not None:
        tests.append(_agrees(speed, -timing.duration, _TIME_NOISE))
    return bool(tests) and all(tests)


def _scales_way(timing: Timing, gain: float | None) -> bool:
    """Whether speed and acceleration are off by one factor, and the times by none.

    The ways from stop to stop tell it best: no override and no rate changes them. Without them accelerometers
    do, which an override leaves at the encoder's; the times are smeared by the servo.
    """
    if timing.speed is not None and timing.way is not None:
        return _confirms(timing.speed, timing.way, _WAY_NOISE)
    if gain is not None and timing.speed is not None and timing.dwell is not None:
        stays = abs(timing.dwell) < max(_DWELL_NOISE, _PART * abs(timing.speed))
        if stays and abs(timing.speed) > _GAIN_TRUE:
            return _confirms(timing.speed, -float(np.log(gain)), _GAIN_NOISE)
    speed, acceleration, duration = timing.speed, timing.acceleration, timing.duration
    if speed is None or acceleration is None or duration is None or _scales_time(timing):
        return False
    return _agrees(speed, acceleration, 0.01) and abs(duration) < _TIME_NOISE


def _agrees(effect: float, witness: float, noise: float) -> bool:
    return bool(abs(witness - effect) < max(_PART * abs(effect), noise))


def _confirms(effect: float, witness: float, noise: float) -> bool:
    """Whether a witness agrees with an effect, and better than with there being none."""
    return _agrees(effect, witness, noise) and abs(witness - effect) < abs(witness)


def _told(timing: Timing) -> str:
    parts = (
        ("speed", timing.speed),
        ("acceleration", timing.acceleration),
        ("acceleration time", timing.duration),
        ("dwell", timing.dwell),
    )
    return ", ".join(f"{name} {100 * np.expm1(value):+.1f} %" for name, value in parts if value is not None)
