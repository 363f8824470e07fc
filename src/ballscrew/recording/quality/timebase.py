"""The time base of a recording: its time column, the stated rates, and the plan's motion times as a clock.

A rate that is declared r times too high makes the speed r times, the encoder's acceleration r² times and
every time 1/r times as large, and the accelerometer 1/r² times the encoder. A speed override changes neither
the dwell nor the accelerometer over the encoder; a wrong scale of the position changes no time.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ballscrew.base.arrays import Array
from ballscrew.base.words import percent, plural
from ballscrew.fcft.plan import Motion, Plan
from ballscrew.recording.kinematics import Kinematics
from ballscrew.recording.motions import nearest_motion
from ballscrew.recording.phases import MotionPhase
from ballscrew.recording.quality.finding import Finding, severity

# 0.1 % of the rate is 0.1 % of the frequency, and 1 to 4 % of the preload: more than a test can tolerate.
_RATE = 1e-3
_RATE_BAD = 5e-3
_GAP = 1.5  # sample intervals: more than that, and a sample or more is missing
_COARSE = 0.01  # share of equal times above which the clock is coarser than the samples
_JITTER = 0.5  # sample intervals off a straight line
_JITTER_BAD = 5.0
_MANY_GAPS = 10  # a few gaps spoil a few transients, many spoil all

# On good records speed agrees with the plan to 0.2 %, acceleration to 0.3 %, the time of an acceleration to
# 2 %, the dwell to 0.5 %; a drive's own overshoot and its wait for position add to that. All are logarithms.
_PLAN_RATE = 0.008  # 1 % of the frequency is 12 to 35 % of the preload; trips differ by 0.5 %
_PLAN_RATE_BAD = 0.02
_SPEED = 0.02
_SPEED_NOISE = 0.005
_TIME_NOISE = 0.04
_DWELL_NOISE = 0.01
_WAY_NOISE = 2e-3  # a drive stops within some hundredths of a millimetre
_SCALE_NOISE = 0.01
_GAIN_TRUE = 0.06  # a calibrated accelerometer's gain is within half of that
_GAIN_NOISE = 0.02  # of an accelerometer's scale as a part of the rate, which is its square root
_PART = 0.35  # of an effect by which its witnesses may differ
_ACCELERATION = 0.10
_SCALE_BAD = 0.2
_OTHER_UNIT = math.log(9)  # m for mm, or revolutions for mm: then the deviations in per cent say no more
_CRUISE = 0.2  # of a cruise left out at either end, where the speed still settles
_LEAST_CRUISE = 0.03  # s


def time_rate(time: Array) -> float | None:
    """Sample rate of a time column between its gaps, Hz; None where the times do not increase."""
    step = max(1, (len(time) - 1) // 16)
    with np.errstate(invalid="ignore"):  # of times that are not finite
        spans = time[step:] - time[:-step]
    spans = spans[np.isfinite(spans)]
    if not len(spans):
        return None
    span = float(np.median(spans))
    return step / span if span > 0 else None


def check_rates(file: str, used: float, stated: dict[str, float | None]) -> list[Finding]:
    """Compare all stated sample rates with the rate in use.

    Parameters
    ----------
    file : str
        Name of the file, for the message.
    used : float
        Rate of the recording, Hz.
    stated : dict
        Source of each stated rate, in words, and the rate in Hz or None.

    Returns
    -------
    list of Finding
        A finding where any two differ by more than 0.1 %.
    """
    known = [used]
    texts = []
    for source, rate in stated.items():
        if rate is not None and np.isfinite(rate) and rate > 0:
            known.append(rate)
            texts.append(f"{source} {rate:.7g} Hz")
    difference = max(known) / min(known) - 1
    if difference <= _RATE:
        return []
    text = (
        f"{file}: the sample rate is stated twice and differently: {', '.join(texts)}; "
        f"one of them makes every frequency wrong by {percent(difference)}"
    )
    return [Finding(severity(bad=difference > _RATE_BAD), "rate", text)]


def check_time(file: str, time: Array) -> list[Finding]:
    """Check that the times increase evenly.

    Parameters
    ----------
    file : str
        Name of the file, for the messages.
    time : ndarray, shape (n,)
        Times of the samples, s.

    Returns
    -------
    list of Finding
        Not finite, not increasing, gaps (dropped samples) or uneven.
    """
    wrong = int(np.count_nonzero(~np.isfinite(time)))
    if wrong:
        return [Finding("bad", "time", f"{file}: the time column has {wrong} samples that are not times")]
    rate = time_rate(time)
    steps = np.diff(time)
    back = np.flatnonzero(steps < 0)
    if rate is None or len(back):
        text = f"{file}: the time column does not increase"
        if len(back):
            text += f" and goes back {plural(len(back), 'time')}, first at {time[back[0]]:.4g} s"
        return [Finding("bad", "time", text)]
    tick = _tick(steps)
    gaps = np.flatnonzero(steps > _GAP / rate + tick)
    if len(gaps):
        lost = round(float(np.sum(steps[gaps] * rate - 1)))
        text = (
            f"{file}: about {lost} samples are missing in {len(gaps)} gaps of the time column, "
            f"the first at {time[gaps[0]]:.4g} s"
        )
        return [Finding(severity(bad=len(gaps) > _MANY_GAPS), "dropped", text)]
    return _jitter(file, time, rate, tick)


def _tick(steps: Array) -> float:
    """Resolution of a clock that is coarser than the samples; 0 for a fine clock."""
    if np.count_nonzero(steps == 0) <= _COARSE * len(steps):
        return 0.0
    return float(steps[steps > 0].min())


def _jitter(file: str, time: Array, rate: float, tick: float) -> list[Finding]:
    index = np.arange(len(time), dtype=np.float64)
    residual = time - np.polynomial.Polynomial.fit(index, time, 1)(index)
    off = (float(np.abs(residual).max()) - tick) * rate
    if off <= _JITTER:
        return []
    text = (
        f"{file}: the time column is not uniform: up to {1e3 * off / rate:.3g} ms, "
        f"{off:.2g} sample intervals, off a straight line"
    )
    return [Finding(severity(bad=off > _JITTER_BAD), "time", text)]


@dataclass(frozen=True, slots=True)
class Timing:
    """Measured over planned motion, as natural logarithms; None where it cannot be measured.

    Parameters
    ----------
    speed : float, optional
        Speed between two stops.
    acceleration : float, optional
        Highest acceleration.
    duration : float, optional
        Duration of an acceleration.
    dwell : float, optional
        Standstill between two moves.
    way : float, optional
        Distance from stop to stop, over the nearest distance of the plan.
    """

    speed: float | None
    acceleration: float | None
    duration: float | None
    dwell: float | None
    way: float | None = None

    def __str__(self) -> str:
        """All that differ from the plan, in per cent."""
        parts = []
        for name, field in (
            ("speed", self.speed),
            ("acceleration", self.acceleration),
            ("acceleration time", self.duration),
            ("dwell", self.dwell),
        ):
            if field is not None:
                parts.append(f"{name} {100 * np.expm1(field):+.1f} %")
        return ", ".join(parts)


def measure_timing(motion: Kinematics, phases: Sequence[MotionPhase], plan: Plan) -> Timing:
    """Compare a recording's motion with the plan's.

    Parameters
    ----------
    motion : Kinematics
        Motion of the recording.
    phases : sequence of MotionPhase
        Phases of the recording.
    plan : Plan
        A phase is compared with the motion that is nearest in speed and acceleration.

    Returns
    -------
    Timing
        Medians over all phases.
    """
    motions = [plan.motions[nearest_motion(phase, plan)] for phase in phases]
    moves, pauses = [], []
    for (phase, following), planned in zip(pairwise(phases), motions, strict=False):
        if phase.condition.accelerating and not following.condition.accelerating:
            moves.append((phase, following, planned))
        elif following.condition.accelerating and not phase.condition.accelerating:
            pauses.append((following.start - phase.stop, planned))
    accelerations, durations = _acceleration_ratios(motion, phases, motions)
    dwells = []
    for samples, planned in pauses:
        if planned.dwell > planned.acceleration_time:
            dwells.append(samples / motion.rate / planned.dwell)
    return Timing(
        speed=_log(_speed_ratios(motion, moves)),
        acceleration=_log(accelerations),
        duration=_log(durations),
        dwell=_log(dwells),
        way=_log(_way_ratios(moves, np.diff(np.array(plan.positions)))),
    )


_Move = tuple[MotionPhase, MotionPhase, Motion]


def _acceleration_ratios(
    motion: Kinematics, phases: Sequence[MotionPhase], motions: Sequence[Motion]
) -> tuple[list[float], list[float]]:
    """Accelerations and durations of the phases over those of their motions."""
    accelerations, durations = [], []
    for phase, planned in zip(phases, motions, strict=True):
        if not phase.complete or phase.stop <= phase.start:
            continue
        durations.append((phase.stop - phase.start) / motion.rate / planned.acceleration_time)
        if planned.jerk_time < planned.acceleration_time / 4 and phase.acceleration > 0:
            accelerations.append(phase.acceleration / planned.peak_acceleration)
    return accelerations, durations


def _speed_ratios(motion: Kinematics, moves: Sequence[_Move]) -> list[float]:
    """Cruising speeds over those of the motions."""
    ratios = []
    for start, end, planned in moves:
        skip = int(_CRUISE * (end.start - start.stop))
        first, last = start.stop + skip, end.start - skip
        if last - first > _LEAST_CRUISE * motion.rate:
            way = abs(float(motion.position[last] - motion.position[first]))
            ratios.append(way * motion.rate / (last - first) / planned.speed)
    return ratios


def _way_ratios(moves: Sequence[_Move], distances: Array) -> list[float]:
    """Distances from stop to stop over the nearest distances of the plan."""
    ratios = []
    for start, end, _ in moves:
        if start.complete and end.complete:
            way = abs(end.stop_position - start.stop_position)
            ratios.append(way / float(distances[np.argmin(np.abs(distances - way))]))
    return ratios


def _log(ratios: list[float]) -> float | None:
    values = np.array(ratios)
    values = values[values > 0]
    return float(np.log(np.median(values))) if len(values) >= 2 else None


def check_timing(file: str, rate: float, timing: Timing, gain: float | None) -> tuple[list[Finding], bool]:
    """Check the sample rate, the speed and the position's scale by the plan's times.

    Parameters
    ----------
    file : str
        Name of the file, for the message.
    rate : float
        Sample rate of the recording, Hz.
    timing : Timing
        From :func:`measure_timing`.
    gain : float, optional
        Gain of the accelerometers over the encoder.

    Returns
    -------
    findings : list of Finding
        At most one.
    confirmed : bool
        Whether the plan's times determine the rate, right or wrong.
    """
    if timing.speed is None:
        return [], False
    found = _check_plan_rate(file, rate, timing, timing.speed, gain)
    if found is not None:
        return found
    if abs(timing.speed) > _SPEED:
        return [_speed_or_scale(file, timing, timing.speed, gain)], True
    if timing.acceleration is not None and abs(timing.acceleration) > _ACCELERATION:
        text = f"{file}: the acceleration is not the plan's: {timing}"
        return [Finding("suspect", "acceleration", text)], True
    return [], True


def _check_plan_rate(
    file: str, rate: float, timing: Timing, speed: float, gain: float | None
) -> tuple[list[Finding], bool] | None:
    """Finding on the sample rate, and whether the rate is determined; None where it is not the cause."""
    witnesses = _witnesses(timing, speed, gain)
    # A soft servo smears the time of an acceleration; dwell and accelerometer together need no third witness.
    two_agree = len(witnesses) == 2 and all(witnesses)
    if abs(speed) <= _PLAN_RATE or not (two_agree or _scales_time(timing, speed)):
        return None
    wrong = 100 * abs(np.expm1(speed))
    if any(witnesses):
        beside = "" if gain is None else f", accelerometer over encoder is {gain:.3g}"
        text = (
            f"{file}: the sample rate contradicts the plan: {timing}{beside}; the motion fits "
            f"{rate / np.exp(speed):.5g} Hz, not {rate:.5g} Hz; every frequency is wrong by {wrong:.3g} %"
        )
        return [Finding(severity(bad=abs(speed) > _PLAN_RATE_BAD), "rate", text)], True
    if witnesses:
        return None
    text = f"{file}: {timing}: the sample rate is wrong by {wrong:.3g} %, or another motion was run"
    return [Finding("suspect", "rate", text)], False


def _witnesses(timing: Timing, speed: float, gain: float | None) -> list[bool]:
    """True if dwell and accelerometers, where known, confirm a wrong rate."""
    if timing.way is not None and _confirms(speed, timing.way, _WAY_NOISE):  # which no rate changes
        return [False]
    witnesses = []
    if timing.dwell is not None:
        witnesses.append(_confirms(speed, -timing.dwell, _DWELL_NOISE))
    if gain is not None:
        witnesses.append(_confirms(speed, -float(np.log(gain)) / 2, _GAIN_NOISE))
    return witnesses


def _speed_or_scale(file: str, timing: Timing, speed: float, gain: float | None) -> Finding:
    if not _scales_way(timing, speed, gain):
        text = f"{file}: the speed is not the plan's; a speed override may be set: {timing}"
        return Finding("suspect", "speed", text)
    factor = speed if timing.way is None else timing.way
    text = f"{file}: the position is scaled wrongly by {np.exp(factor):.4g}: check its unit and scale"
    if abs(factor) < _OTHER_UNIT:
        text += f" ({timing})"
    return Finding(severity(bad=abs(speed) > _SCALE_BAD), "scale", text)


def _scales_time(timing: Timing, speed: float) -> bool:
    """True if speed, acceleration and duration all agree on a factor of the time."""
    tests = []
    if timing.acceleration is not None:
        tests.append(_agrees(speed, timing.acceleration / 2, _SPEED_NOISE))
    if timing.duration is not None:
        tests.append(_agrees(speed, -timing.duration, _TIME_NOISE))
    return bool(tests) and all(tests)


def _scales_way(timing: Timing, speed: float, gain: float | None) -> bool:
    """True if speed and acceleration are wrong by a common factor, and the times are right.

    The distances from stop to stop show it best: neither override nor rate change them. Without them,
    accelerometers do, which follow the encoder at any override; the times are smeared by the servo.
    """
    if timing.way is not None:
        return _confirms(speed, timing.way, _WAY_NOISE)
    if gain is not None and timing.dwell is not None:
        dwell_is_right = abs(timing.dwell) < max(_DWELL_NOISE, _PART * abs(speed))
        if dwell_is_right and abs(speed) > _GAIN_TRUE:
            return _confirms(speed, -float(np.log(gain)), _GAIN_NOISE)
    if timing.acceleration is None or timing.duration is None or _scales_time(timing, speed):
        return False
    return _agrees(speed, timing.acceleration, _SCALE_NOISE) and abs(timing.duration) < _TIME_NOISE


def _agrees(effect: float, witness: float, noise: float) -> bool:
    return abs(witness - effect) < max(_PART * abs(effect), noise)


def _confirms(effect: float, witness: float, noise: float) -> bool:
    """True if a witness agrees with an effect, and better than with no effect."""
    return _agrees(effect, witness, noise) and abs(witness - effect) < abs(witness)
