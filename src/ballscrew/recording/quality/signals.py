"""First part of the quality gate: faults that the signals show before anything is known of the motion."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ballscrew.base.arrays import Array
from ballscrew.base.words import percent, plural
from ballscrew.recording.aligned import AXIAL, acceleration_by_speed, speeds_of
from ballscrew.recording.drive_input import input_channels
from ballscrew.recording.quality import hum, signal_faults, timebase
from ballscrew.recording.quality.finding import Finding, Severity, severity
from ballscrew.recording.quantities import SI_UNITS
from ballscrew.recording.recording import Recording

# Clipped samples among those above half the limit: 1 % are the tips of the ringing, a tenth is its shape.
_CLIPPED_BAD = 0.1
_MANY_SPIKES = 10  # a few spoil a few transients, many spoil all
_HUM_BAD = 0.5  # of the signal's root mean square
_FASTEST = 10.0  # m/s: diameter times speed of 220,000 mm/min, with a lead of 2.5 diameters, makes 9 m/s
_CRUISE = 99.0  # percentile of the speed, above which are jumps of a counter
_STUCK_BAD = 0.01  # of all samples
_SHORTEST = 64  # samples: fewer cannot be checked
_UNITS = {**SI_UNITS, "acceleration": "m/s²"}


def check_signals(recording: Recording) -> tuple[Finding, ...]:
    """Check the samples of a recording and their times.

    Parameters
    ----------
    recording : Recording
        As read. Channels that are derived from others are not checked.

    Returns
    -------
    tuple of Finding
        NaN, infinite, flat, clipped, overflowed, spikes, stuck, uneven or lost samples, rates that
        contradict each other, mains hum; empty for a good recording.
    """
    with np.errstate(all="ignore"):  # no check accepts a number that overflows here
        return tuple(_check(recording))


def _check(recording: Recording) -> list[Finding]:
    findings = _check_time(recording)
    used = _used_channels(recording)
    measured = [name for name, x in recording.channels.items() if not x.attrs.get("derived")]
    by_speed = acceleration_by_speed(recording)
    speeds = speeds_of(recording, by_speed) if by_speed else []
    whole = []
    for name in measured:
        found = _check_values(recording, name, severity(bad=name in used or name in speeds))
        findings += found
        if not found and name in used:
            whole.append(name)
    return findings + _check_whole(recording, whole)


def _check_whole(recording: Recording, whole: list[str]) -> list[Finding]:
    """Check the channels that the analysis uses, all samples of which are finite and not all equal."""
    findings: list[Finding] = []
    positions = [name for name in whole if _quantity(recording, name) == "position"]
    alive = list(whole)
    for name in whole:
        found = _check_samples(recording, name, positions)
        if "flat" in [finding.code for finding in found]:
            alive.remove(name)
        findings += found
    for name in positions:
        findings += _check_frozen_position(recording, name, alive)
    return findings


def _check_samples(recording: Recording, name: str, positions: list[str]) -> list[Finding]:
    if name not in positions:
        return _check_noise(recording, name, positions[:1])
    x, rate = recording.array(name), recording.rate(name)
    label, cause = f"{recording.file.name}: {name}", "a counter that overflows, or another signal"
    speed = float(np.percentile(np.abs(np.diff(x)), _CRUISE)) * rate
    if speed > _FASTEST:
        text = f"the position is scaled wrongly: it moves at {speed:.3g} m/s, faster than any ball screw"
        return [Finding("bad", "scale", f"{recording.file.name}: {text}; check its unit and scale")]
    return _check_wrapping(label, x, rate, cause)


def _quantity(recording: Recording, name: str) -> str:
    return str(recording.channels[name].attrs["quantity"])


def _used_channels(recording: Recording) -> tuple[str, ...]:
    """Channels that the analysis uses, as :func:`ballscrew.recording.aligned.align` chooses them."""
    names = [*input_channels(recording), *recording.of("position")[:1]]
    for direction in AXIAL:
        names += recording.of("acceleration", direction=direction)
    return tuple(names)


def _check_time(recording: Recording) -> list[Finding]:
    file, time = recording.file.name, recording.time
    findings: list[Finding] = []
    stated = {"the channel map says": recording.declared_rate, "the file says": recording.file_rate}
    if time is not None and len(time) >= _SHORTEST:
        findings += timebase.check_time(file, time)
        if "time" not in [finding.code for finding in findings]:
            stated["its time column has"] = timebase.time_rate(time)
    names = _used_channels(recording) or tuple(recording.channels)
    if names:
        about = recording.channels[names[0]].attrs
        recorded = recording.rate(names[0]) * max(1, about.get("updated_every", 1))
        findings += timebase.check_rates(file, recorded, stated)
    return findings


def _check_values(recording: Recording, name: str, level: Severity) -> list[Finding]:
    x, label = recording.array(name), f"{recording.file.name}: {name}"
    if len(x) < _SHORTEST:
        return [Finding(level, "short", f"{label} has {len(x)} samples only")]
    words = []
    for count, word in zip(signal_faults.not_finite(x), ("NaN", "infinite"), strict=True):
        if count:
            words.append(f"{count} {word}")
    if words:
        return [Finding(level, "nan", f"{label} has {' and '.join(words)} among its {len(x)} samples")]
    if signal_faults.is_flat(x):
        return [Finding(level, "flat", f"{label} is flat: all {len(x)} samples are {x[0]:.6g}")]
    if recording.channels[name].attrs.get("updated_every") == 0:
        text = (
            f"{label} is updated less often than it is recorded, at no constant interval: record it with the "
            "cycle of the drive, or another signal in its place"
        )
        return [Finding(level, "updates", text)]
    return []


def _check_wrapping(label: str, x: Array, rate: float, cause: str) -> list[Finding]:
    wrapped = signal_faults.wraps(x)
    if len(wrapped) == 0:
        return []
    text = (
        f"{label} jumps over three quarters of its range {len(wrapped)} times, first at "
        f"{wrapped[0] / rate:.4g} s: {cause}"
    )
    return [Finding("bad", "wrapped", text)]


def _check_frozen_position(recording: Recording, name: str, alive: Sequence[str]) -> list[Finding]:
    """Check for a constant position while the accelerometers, or without any the torque, show motion."""
    x, rate = recording.array(name), recording.rate(name)
    witnesses, accelerations = [], []
    for other in alive:
        if other != name and recording.rate(other) == rate and len(recording.array(other)) == len(x):
            witnesses.append(other)
            if _quantity(recording, other) == "acceleration":
                accelerations.append(other)
    for other in accelerations or witnesses:
        span = signal_faults.frozen_position(x, recording.array(other), rate, drive=not accelerations)
        if span is not None:
            return [_frozen(recording, name, span)]
    return []


def _frozen(recording: Recording, name: str, span: signal_faults.Span) -> Finding:
    x, rate = recording.array(name), recording.rate(name)
    first, last = span
    text = (
        f"{recording.file.name}: {name} is flat from {first / rate:.4g} to {last / rate:.4g} s, "
        f"while the axis moves: all samples there are {x[first]:.6g}"
    )
    return Finding(severity(bad=last - first > _STUCK_BAD * len(x)), "flat", text)


def _check_noise(recording: Recording, name: str, positions: Sequence[str]) -> list[Finding]:
    """Faults of a torque or an acceleration, which have noise where a position may stand still."""
    x, rate = recording.array(name), recording.rate(name)
    label, unit = f"{recording.file.name}: {name}", _UNITS[_quantity(recording, name)]
    findings = _check_wrapping(label, x, rate, "a whole number that overflowed")
    if not findings:
        findings = _check_spikes(label, x, rate)
    clip = signal_faults.clipping(x)
    if clip is not None:
        findings.append(_clipped(label, unit, clip))
    spans: list[slice] = []
    moving: NDArray[np.bool_] | None = None
    for other in positions:
        if recording.rate(other) != rate:
            continue
        position = recording.array(other)
        spans, moving = hum.steady(position, rate)
        if len(position) != len(x):
            moving = None
            continue
        frozen = signal_faults.frozen_signal(x, position, rate, clip)
        if frozen is not None:
            return [*findings, _frozen(recording, name, frozen)]
    stuck = signal_faults.stuck(x, moving, clip)
    if stuck is not None:
        text = (
            f"{label} has {plural(stuck.count, 'span')}, {stuck.samples} samples in all, that have no noise, "
            f"the first at {stuck.first / rate:.4g} s: dropped samples that were filled in"
        )
        findings.append(Finding(severity(bad=stuck.samples > _STUCK_BAD * len(x)), "stuck", text))
    if signal_faults.has_dead_band(x):
        text = f"{label} ignores small changes: it holds its value until a dead band is left"
        findings.append(Finding("suspect", "dead-band", text))
    line = hum.find_hum(x, rate, spans)
    if line is not None:
        text = (
            f"{label} hums at {line.frequency:.4g} Hz with {line.amplitude:.2g} {unit}, "
            f"{percent(line.share)} of the signal's root mean square"
        )
        findings.append(Finding(severity(bad=line.share > _HUM_BAD), "hum", text))
    return findings


def _clipped(label: str, unit: str, clip: signal_faults.Clip) -> Finding:
    text = " and ".join(f"{limit:.3g}" for limit in (clip.low, clip.high) if limit is not None)
    if clip.low is not None and clip.high is not None and abs(clip.low + clip.high) < 0.01 * clip.high:
        text = f"±{clip.high:.3g}"
    text = (
        f"{label} is clipped at {text} {unit}: {clip.count} samples lie there, "
        f"{percent(clip.share)} of all above half that limit"
    )
    return Finding(severity(bad=clip.share > _CLIPPED_BAD), "clipped", text)


def _check_spikes(label: str, x: Array, rate: float) -> list[Finding]:
    spikes = signal_faults.spikes(x)
    if len(spikes) == 0:
        return []
    text = (
        f"{label} has {len(spikes)} single samples far off their neighbours, the first at "
        f"{spikes[0] / rate:.4g} s"
    )
    return [Finding(severity(bad=len(spikes) > _MANY_SPIKES), "spike", text)]
