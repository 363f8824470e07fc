"""The gate's first part: what the signals show before anything is known of the motion."""

from __future__ import annotations

import numpy as np

from ballscrew.base.arrays import Array
from ballscrew.base.percent import percent
from ballscrew.recording.aligned import AXIAL, INPUTS, SI_UNIT
from ballscrew.recording.quality import clock, hum, samples
from ballscrew.recording.quality.finding import Finding, Severity
from ballscrew.recording.quality.held import held_position, held_signal
from ballscrew.recording.recording import Recording

__all__ = ["check_signals"]


# Clipped samples among those above half the limit: 1 % are the tips of the ringing, a tenth is its shape.
_CLIPPED_BAD = 0.1
_MANY_SPIKES = 10  # a few spoil a few transients, many spoil all
_HUM_BAD = 0.5  # of the signal's root mean square
_STUCK_BAD = 0.01  # of all samples
_SHORTEST = 64  # samples: nothing can be said of less
_UNITS = {**SI_UNIT, "acceleration": "m/s²", "position": "m"}


def check_signals(recording: Recording) -> tuple[Finding, ...]:
    """Find what is wrong with the samples and their times.

    Parameters
    ----------
    recording : Recording
        As read. Channels that were derived from others are judged by those.

    Returns
    -------
    tuple of Finding
        NaN, infinite, flat, clipped, overflowed, spikes, stuck, uneven or lost samples, rates that
        contradict each other, mains hum; empty for a good recording.
    """
    with np.errstate(all="ignore"):  # what overflows here is no number that any check believes
        return tuple(_check(recording))


def _check(recording: Recording) -> list[Finding]:
    file = recording.file.name
    findings = _check_clock(recording)
    needed = _needed(recording)
    whole = []
    for name, channel in recording.channels.items():
        if channel.attrs.get("derived"):
            continue
        x = recording.array(name)
        found = _check_values(file, name, x, "bad" if name in needed else "suspect")
        findings += found
        if not found and name in needed:
            whole.append(name)
    positions = [name for name in whole if recording.channels[name].attrs["quantity"] == "position"]
    place = (recording.array(positions[0]), recording.rate(positions[0])) if positions else None
    dead: set[str] = set()
    for name in whole:
        quantity = str(recording.channels[name].attrs["quantity"])
        if quantity == "position":
            own = _check_position(file, name, recording.array(name), recording.rate(name))
        else:
            own = _check_noise(
                file, name, _UNITS[quantity], recording.array(name), recording.rate(name), place
            )
        if any(finding.code == "flat" for finding in own):
            dead.add(name)
        findings += own
    for name in positions:
        findings += _check_held_position(recording, name, [other for other in whole if other not in dead])
    return findings


def _needed(recording: Recording) -> tuple[str, ...]:
    """Channels that the analysis uses, as :func:`ballscrew.recording.aligned.align` picks them."""
    drive = [name for quantity in INPUTS for name in recording.of(quantity)][:1]
    axial = [name for side in AXIAL for name in recording.of("acceleration", direction=side)]
    return (*drive, *recording.of("position")[:1], *axial)


def _check_clock(recording: Recording) -> list[Finding]:
    file, time = recording.file.name, recording.time
    findings: list[Finding] = []
    stated = {"the channel map says": recording.declared_rate, "the file says": recording.file_rate}
    if time is not None and len(time) >= _SHORTEST:
        findings += clock.check_time(file, time)
        if not any(finding.code == "time" for finding in findings):
            stated["its time column has"] = clock.time_rate(time)
    names = _needed(recording) or tuple(recording.channels)
    if names:
        findings += clock.check_rates(file, recording.rate(names[0]), stated)
    return findings


def _check_values(file: str, name: str, x: Array, severity: Severity) -> list[Finding]:
    if len(x) < _SHORTEST:
        return [Finding(severity, "short", f"{file}: {name} has {len(x)} samples only")]
    nans, infinite = samples.not_finite(x)
    if nans or infinite:
        words = [f"{count} {word}" for count, word in ((nans, "NaN"), (infinite, "infinite")) if count]
        return [
            Finding(severity, "nan", f"{file}: {name} has {' and '.join(words)} among its {len(x)} samples")
        ]
    if samples.is_flat(x):
        return [Finding(severity, "flat", f"{file}: {name} is flat: all {len(x)} samples are {x[0]:.6g}")]
    return []


def _check_position(file: str, name: str, x: Array, rate: float) -> list[Finding]:
    wrapped = samples.wraps(x)
    if len(wrapped) == 0:
        return []
    return [
        Finding(
            "bad",
            "wrapped",
            f"{file}: {name} jumps over three quarters of its range {len(wrapped)} times, first at "
            f"{wrapped[0] / rate:.4g} s: a counter that overflows, or another signal",
        )
    ]


def _check_held_position(recording: Recording, name: str, whole: list[str]) -> list[Finding]:
    """A position that stays where it is while the accelerometers, or without any the torque, move."""
    x, rate = recording.array(name), recording.rate(name)
    others = [
        other
        for other in whole
        if other != name and recording.rate(other) == rate and len(recording.array(other)) == len(x)
    ]
    quantity = {other: str(recording.channels[other].attrs["quantity"]) for other in others}
    witnesses = [other for other in others if quantity[other] == "acceleration"] or others
    for other in witnesses:
        span = held_position(x, recording.array(other), rate, drive=quantity[other] != "acceleration")
        if span is not None:
            return [_held(recording.file.name, name, x, rate, span)]
    return []


def _held(file: str, name: str, x: Array, rate: float, span: tuple[int, int]) -> Finding:
    first, last = span
    return Finding(
        "bad" if last - first > _STUCK_BAD * len(x) else "suspect",
        "flat",
        f"{file}: {name} is flat from {first / rate:.4g} to {last / rate:.4g} s, while the axis moves: "
        f"all samples there are {x[first]:.6g}",
    )


def _check_noise(
    file: str, name: str, unit: str, x: Array, rate: float, place: tuple[Array, float] | None
) -> list[Finding]:
    """Faults of a torque or an acceleration, which have noise where a position may stand still."""
    clip = samples.clipping(x)
    findings = [*_check_jumps(file, name, x, rate)]
    if clip is not None:
        findings.append(_clipped(file, name, unit, clip))
    spans, moving = hum.steady(*place) if place is not None and place[1] == rate else ([], None)
    if moving is not None and len(moving) != len(x):
        moving = None
    same = place is not None and place[1] == rate and len(place[0]) == len(x)
    flat = held_signal(x, place[0], rate, clip) if same and place is not None else None
    if flat is not None:
        return [*findings, _held(file, name, x, rate, flat)]
    held = samples.stuck(x, moving, clip)
    if held is not None:
        findings.append(
            Finding(
                "bad" if held.samples > _STUCK_BAD * len(x) else "suspect",
                "stuck",
                f"{file}: {name} has {held.count} spans, {held.samples} samples in all, without any noise, "
                f"the first at {held.first / rate:.4g} s: dropped samples that were filled in",
            )
        )
    line = hum.find_hum(x, rate, spans)
    if line is not None:
        findings.append(
            Finding(
                "bad" if line.share > _HUM_BAD else "suspect",
                "hum",
                f"{file}: {name} hums at {line.frequency:.4g} Hz with {line.amplitude:.2g} {unit}, "
                f"{percent(line.share)} of the signal's root mean square",
            )
        )
    return findings


def _clipped(file: str, name: str, unit: str, clip: samples.Clip) -> Finding:
    low, high = clip.low, clip.high
    if low is not None and high is not None and abs(low + high) < 0.01 * high:
        limit = f"±{high:.3g}"
    else:
        limit = " and ".join(f"{side:.3g}" for side in (low, high) if side is not None)
    return Finding(
        "bad" if clip.share > _CLIPPED_BAD else "suspect",
        "clipped",
        f"{file}: {name} is clipped at {limit} {unit}: {clip.count} samples lie there, "
        f"{percent(clip.share)} of all above half that limit",
    )


def _check_jumps(file: str, name: str, x: Array, rate: float) -> list[Finding]:
    wrapped = samples.wraps(x)
    if len(wrapped) > 0:
        return [
            Finding(
                "bad",
                "wrapped",
                f"{file}: {name} jumps over three quarters of its range {len(wrapped)} times, first at "
                f"{wrapped[0] / rate:.4g} s: a whole number that overflowed",
            )
        ]
    single = samples.spikes(x)
    if len(single) == 0:
        return []
    return [
        Finding(
            "bad" if len(single) > _MANY_SPIKES else "suspect",
            "spike",
            f"{file}: {name} has {len(single)} single samples far off their neighbours, the first at "
            f"{single[0] / rate:.4g} s",
        )
    ]
