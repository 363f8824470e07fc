"""Text of the four TOML files to fill in, from guesses and measurements of the files."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from importlib import resources

from ballscrew.recording.channels import RADIANS, ROTATIONS, TODO
from ballscrew.recording.guess import ChannelGuess
from ballscrew.recording.measured_plan import MeasuredPlan
from ballscrew.recording.quantities import INPUTS, SI_UNITS

_MOST_UNUSED = 100
_MEASURED = "   # measured from the file"
_EXAMPLES = {"speed": "150 mm/s", "acceleration": "2.5 m/s^2", "dwell": "350 ms"}
_PLACE = [  # of a channel that may be an accelerometer
    '# location = "nut"   # of an accelerometer',
    '# axis = "x"   # of an accelerometer; x is along the screw',
]


def axis_text() -> str:
    """Write ``axis.toml``, which is the same for all files."""
    return resources.files("ballscrew.recording").joinpath("axis_template.toml").read_text(encoding="utf-8")


def quoted(text: str) -> str:
    """Write a text as a TOML string."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def channels_text(guesses: Sequence[ChannelGuess], sample_rate: float | None, missing: Sequence[str]) -> str:
    """Write ``channels.toml``.

    Parameters
    ----------
    guesses : sequence of ChannelGuess
        Guesses of the channels.
    sample_rate : float, optional
        Rate that the files state, Hz.
    missing : sequence of str
        Sentences on the entries that have to be filled in.

    Returns
    -------
    str
        TOML; unused and unknown channels are comments.
    """
    used = [guess for guess in guesses if guess.used]
    quantities = {guess.quantity for guess in used}
    lines = [
        "# The quantity of each channel of the files.",
        f"# quantity: {' | '.join(SI_UNITS)}",
        "# scale multiplies the file's value; unit is that of the product. axis: x is along the screw.",
        *(f"# TODO {sentence.removeprefix('channels.toml: ')}" for sentence in missing),
        _rate_line(sample_rate, timed="time" in quantities),
    ]
    order = ["", *SI_UNITS]
    for guess in sorted(used, key=lambda guess: (bool(guess.derive), order.index(guess.quantity))):
        lines += ["", *_block(guess)]
    known = "" not in quantities
    if known and quantities.isdisjoint(INPUTS):
        lines += ["", "[[channel]]", f'source = "{TODO}"   # TODO the channel that drives the axis',
                  'quantity = "torque"   # or force, or current', f'unit = "{TODO}"']  # fmt: skip
    if known and "position" not in quantities:
        lines += ["", "[[channel]]", f'source = "{TODO}"   # TODO the channel of the table\'s position',
                  'quantity = "position"', f'unit = "{TODO}"']  # fmt: skip
    return "\n".join(lines + _unused_lines(guesses)) + "\n"


def _rate_line(sample_rate: float | None, *, timed: bool) -> str:
    if sample_rate is not None:
        return f'# sample_rate = "{sample_rate:g} Hz"   # stated by the files; uncomment to override'
    if timed:
        return '# sample_rate = "1 kHz"   # measured from the time channel; uncomment to override'
    return f'sample_rate = "{TODO}"   # TODO samples per second, such as "12.8 kHz"'


def _unused_lines(guesses: Sequence[ChannelGuess]) -> list[str]:
    """Channels that are not part of the map, as comments."""
    unused = [guess for guess in guesses if not guess.used]
    if not unused:
        return []
    lines = ["", "# In the files, and not used; uncomment a channel to use it."]
    for guess in unused[:_MOST_UNUSED]:
        lines += ["#", *(f"# {line}" for line in _block(guess))]
    if len(unused) > _MOST_UNUSED:
        lines += ["#", f"# and {len(unused) - _MOST_UNUSED} more."]
    return lines


def _block(guess: ChannelGuess) -> list[str]:
    check = ""
    if not guess.sure:
        check = f"   # check: {_single_line(guess.why)}"
    lines = [
        "[[channel]]",
        f"source = {quoted(guess.channel)}{check}",
        f"quantity = {quoted(guess.quantity or TODO)}",
    ]
    lines += _scale(guess)
    if guess.derive:
        lines.append(f"derive = {quoted(guess.derive)}")
    if guess.phase:
        lines.append(f"phase = {quoted(guess.phase)}")
    if guess.location:
        lines.append(f"location = {quoted(guess.location)}")
    if guess.direction:
        lines.append(f"axis = {quoted(guess.direction)}")
    return lines


def _scale(guess: ChannelGuess) -> list[str]:
    """Lines of unit and scale; of a channel that may be an accelerometer, also of its place."""
    if guess.quantity == "speed" and ROTATIONS.match(guess.unit):
        why = f"TODO the lead, mm per revolution of the motor, such as 10 (no quotes): {guess.unit} to mm/min"
        return ['unit = "mm/min"', f'scale = "{TODO}"   # {why}']
    if guess.quantity == "speed" and RADIANS.match(guess.unit):
        why = "TODO the lead over 2π, mm per radian of the motor, such as 1.5915 (no quotes): rad/s to mm/s"
        return ['unit = "mm/s"', f'scale = "{TODO}"   # {why}']
    lines = []
    if guess.unit == TODO:
        lines.append(f'unit = "{TODO}"   # TODO the unit of this channel')
    elif guess.unit:
        lines.append(f"unit = {quoted(guess.unit)}")
    if not guess.scaled:
        lines.append(f'scale = "{TODO}"   # TODO this unit per count, such as 0.0012 (no quotes)')
    if guess.used and not guess.quantity:
        lines += _PLACE
    return lines


def _single_line(text: str) -> str:
    """Text without line breaks and other characters that cannot be printed."""
    for character in set(text):
        if not character.isprintable():
            text = text.replace(character, " ")
    return " ".join(text.split())


def plan_text(measured: MeasuredPlan | None, files: int) -> str:
    """Write ``plan.toml``, with the plan that the position shows.

    Parameters
    ----------
    measured : MeasuredPlan, optional
        Plan measured from the first file.
    files : int
        Number of files, each taken to have the same motions.
    """
    lines = ["# One fixed cycle feature test (FCFT): stops, motion and number of round trips."]
    motion = dict.fromkeys(_EXAMPLES, "")
    if measured is None:
        lines += [
            f'positions = {{ start = "0 mm", stop = "{TODO}", step = "{TODO}" }}   # TODO',
            f'repetitions = "{TODO}"   # TODO round trips in all files together, such as 3 (no quotes)',
        ]
    else:
        lines += [
            f"positions = {_stops_text(measured)}{_MEASURED}",
            f"repetitions = {measured.repetitions * files}{_MEASURED}; round trips",
        ]
        motion["speed"] = f"{_mm(measured.speed)}/s"
        motion["acceleration"] = f"{measured.acceleration:g} m/s^2"
        if math.isfinite(measured.dwell):
            motion["dwell"] = f"{measured.dwell * 1e3:g} ms"
    lines += [f'masses = ["{TODO}"]   # TODO load on the table, such as "100 kg", or "0 kg"', "", "[motion]"]
    for field, value in motion.items():
        if value:
            lines.append(f'{field} = "{value}"{_MEASURED}')
        else:
            lines.append(f'{field} = "{TODO}"   # TODO such as "{_EXAMPLES[field]}"')
    lines.append('# jerk = "1500 m/s^3"   # limit of the controller, unless the speed is a trapezoid')
    return "\n".join(lines) + "\n"


def _stops_text(measured: MeasuredPlan) -> str:
    """Stops of a measured plan as a TOML value."""
    if measured.step is None:
        return "[" + ", ".join(f'"{_mm(stop)}"' for stop in measured.stops) + "]"
    # A whole number of steps, so that the last stop is not missed by rounding.
    start, step = round(measured.stops[0], 4), round(measured.step, 4)
    stop = start + step * (len(measured.stops) - 1)
    return f'{{ start = "{_mm(start)}", stop = "{_mm(stop)}", step = "{_mm(step)}" }}'


def _mm(metres: float) -> str:
    return f"{round(metres * 1e3, 4) + 0.0:g} mm"


def run_text(files: Sequence[str]) -> str:
    """Write ``run.toml``, with the files' names relative to it."""
    listed = "\n".join(f"    {quoted(name)}," for name in files)
    return f"""\
# One run: its recordings, and the conditions of the measurement.
axis = "axis.toml"
plan = "plan.toml"
channels = "channels.toml"
load = "{TODO}"                       # TODO load on the table, such as "100 kg", or "0 kg"
# measured_at = "2026-01-31T08:00:00Z"
# temperature = "23 degC"   # of the axis; default: the mean of a temperature channel
files = [
{listed}
]
"""
