"""``ballscrew init``: inspect recordings and write the four TOML files to complete."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from rich.markup import escape
from rich.table import Table

from ballscrew.base.errors import DONE, InputError
from ballscrew.base.files import write_text
from ballscrew.base.jsonfile import SCHEMA
from ballscrew.cli.output import check_outputs, console, print_json
from ballscrew.recording.channels import RADIANS, ROTATIONS, TODO
from ballscrew.recording.convert import rate_from_time
from ballscrew.recording.guess import ChannelGuess, guess_channels
from ballscrew.recording.header import Header
from ballscrew.recording.measured_plan import MeasuredPlan, measure_plan
from ballscrew.recording.quantities import INPUTS, to_si
from ballscrew.recording.readers.process import opened
from ballscrew.recording.templates import axis_text, channels_text, plan_text, run_text
from ballscrew.recording.updates import update_interval

_MOST_NAMED = 5  # channels listed in a message
_SCALES = {"relative torque": "rated_torque", "current": "torque_constant"}
_NAMES = ("axis.toml", "plan.toml", "channels.toml", "run.toml")


@dataclass(frozen=True, slots=True)
class InitResult:
    """Written files, guessed channels and missing values.

    Parameters
    ----------
    written : tuple of Path
        axis.toml, plan.toml, channels.toml and run.toml.
    guesses : tuple of ChannelGuess
        Quantity and unit of each channel, with the reason.
    missing : tuple of str
        Sentences on values to complete or to check.
    """

    written: tuple[Path, ...]
    guesses: tuple[ChannelGuess, ...]
    missing: tuple[str, ...]


def init(files: Sequence[Path], out: Path, *, force: bool = False) -> InitResult:
    """Inspect recordings and write axis.toml, plan.toml, channels.toml and run.toml to complete.

    Parameters
    ----------
    files : sequence of path-like
        Recordings of one run; the first determines the channels.
    out : path-like
        Folder to write to; made if absent.
    force : bool
        Overwrite existing files.

    Returns
    -------
    InitResult
        Guesses and missing values.

    Raises
    ------
    InputError
        If there is no file, one cannot be read, the first has neither a channel that drives the axis nor a
        position, or a file to be written is there already.
    """
    files, out = [Path(file) for file in files], Path(out)
    if not files:
        raise InputError("no file is given; init needs at least one recording.")
    check_outputs([out / name for name in _NAMES], files)
    headers = [_header(file) for file in files]
    header = headers[0]
    guesses = guess_channels(_writable(header))
    _check_guesses(files[0], header, guesses)
    intervals = _update_intervals(files[0], guesses)
    guesses = guess_channels(_writable(header), intervals)
    measured = _measure_plan(files[0], header, guesses, intervals)
    missing = [*_missing(header, guesses), *_differences(files, headers)]
    texts = (
        axis_text(),
        plan_text(measured, len(files)),
        channels_text(guesses, _stated_rate(header, guesses), missing),
        run_text([_relative_path(file, out) for file in files]),
    )
    written = _write(out, dict(zip(_NAMES, texts, strict=True)), force)
    missing += [_axis_todo(guesses), _plan_todo(measured), "run.toml: load."]
    return InitResult(written, guesses, tuple(missing))


def init_command(files: Sequence[Path], out: Path, *, force: bool, as_json: bool) -> int:
    """Write the four files, print the guesses, and return the exit status."""
    result = init(files, out, force=force)
    if as_json:
        document = {
            "schema": SCHEMA,
            "written": [str(path) for path in result.written],
            "guesses": [asdict(guess) for guess in result.guesses],
            "missing": list(result.missing),
        }
        print_json(document)
        return DONE
    screen = console()
    table = Table("channel", "quantity", "unit", "why", "sure")
    for guess in result.guesses:
        row = (guess.channel, guess.quantity, guess.unit, guess.why)
        table.add_row(*map(escape, row), _certainty(guess))
    screen.print(table)
    for path in result.written:
        screen.print(f"wrote {path}", markup=False)
    if result.missing:
        screen.print("\n[bold]To complete:[/]")
        for sentence in result.missing:
            screen.print(f"  • {sentence}", markup=False)
    screen.print(f"\nThen: ballscrew analyze {result.written[-1]}", markup=False, soft_wrap=True)
    return DONE


def _certainty(guess: ChannelGuess) -> str:
    if guess.quantity and not guess.used:
        return "[dim]not used[/]"
    return "yes" if guess.sure else "[yellow]check[/]"


def _header(path: Path) -> Header:
    with opened(path) as source:
        header = source.header
    if not header.channels:
        raise InputError(
            f"{path}: has no channel, a series of numbers in one dimension; store the columns of a matrix "
            "one by one."
        )
    return header


def _check_guesses(path: Path, header: Header, guesses: Sequence[ChannelGuess]) -> None:
    """Refuse a frequency response, and a file with neither what drives the axis nor its position."""
    if any(guess.used and guess.quantity in ("", *INPUTS, "position") for guess in guesses):
        return
    if header.reader == "sinumerik-response":
        raise InputError(
            f"{path}: is a frequency response that the control measured: analyse it by ballscrew frf."
        )
    named = ", ".join(repr(guess.channel) for guess in guesses[:_MOST_NAMED])
    if len(guesses) > _MOST_NAMED:
        named += f" and {len(guesses) - _MOST_NAMED} more"
    raise InputError(
        f"{path}: no channel looks like a torque, force or current, or like a position; it has {named}. Name "
        'them in the file with units, "torque [Nm]" and "position [mm]", or write channels.toml by hand.'
    )


def _writable(header: Header) -> Header:
    """Header without channels whose names are not Unicode: they cannot be named in a TOML file."""
    channels = tuple(c for c in header.channels if c.name.encode("utf-8", "ignore").decode("utf-8") == c.name)
    return Header(channels, header.sample_rate, header.started_at, header.reader)


def _stated_rate(header: Header, guesses: Sequence[ChannelGuess]) -> float | None:
    """Highest rate of the channels that are used, Hz; None unless the file states that of each."""
    stated = {channel.name: channel.sample_rate or header.sample_rate for channel in header.channels}
    rates = [stated[guess.channel] for guess in guesses if guess.used]
    known = [rate for rate in rates if rate is not None]
    return max(known) if known and len(known) == len(rates) else None


def _update_intervals(path: Path, guesses: Sequence[ChannelGuess]) -> dict[str, int]:
    """Samples between two updates of each position and speed."""
    names = {guess.channel for guess in guesses if guess.quantity in ("position", "speed")}
    with opened(path) as source:
        raw = source.read(sorted(names))
    return {name: max(1, update_interval(values.astype("f8"))[0]) for name, values in raw.items()}


def _measure_plan(
    path: Path, header: Header, guesses: Sequence[ChannelGuess], intervals: Mapping[str, int]
) -> MeasuredPlan | None:
    used = {guess.quantity: guess for guess in guesses if guess.used and not guess.derive}
    if "position" not in used or used["position"].unit == TODO:
        return None
    names = {quantity: used[quantity].channel for quantity in ("position", "time") if quantity in used}
    with opened(path) as source:
        raw = source.read(list(names.values()))
    slope, _ = to_si(used["position"].unit, "position")
    own = {channel.name: channel.sample_rate for channel in header.channels}
    rate = own[names["position"]] or header.sample_rate
    if rate is None and "time" in names:
        rate = rate_from_time(raw[names["time"]].astype("f8") * to_si(used["time"].unit, "time")[0])
    if rate is None or not rate > 0:
        return None
    interval = intervals[names["position"]]
    return measure_plan(raw[names["position"]][::interval].astype("f8") * slope, rate / interval)


def _missing(header: Header, guesses: Sequence[ChannelGuess]) -> list[str]:
    used = [guess for guess in guesses if guess.used]
    quantities = {guess.quantity for guess in used}
    sentences: list[str] = []
    unknown = "" in quantities
    if not unknown and not quantities & set(INPUTS):
        sentences.append(
            "channels.toml: no channel looks like a torque, a force or a current; name the one that is."
        )
    if not unknown and "position" not in quantities:
        sentences.append(
            "channels.toml: no channel looks like the position of the table; name the one that is."
        )
    sentences += _missing_units(used)
    if "time" not in quantities and _stated_rate(header, guesses) is None:
        sentences.append("channels.toml: sample_rate: the files do not give it and have no time channel.")
    return sentences


def _missing_units(used: Sequence[ChannelGuess]) -> list[str]:
    sentences: list[str] = []
    for guess in used:
        if not guess.scaled:
            what = "scale and unit" if guess.quantity else "sensor (quantity), unit and scale"
            sentences.append(f"channels.toml: {what} of {guess.channel!r}.")
        elif guess.unit == TODO:
            sentences.append(f"channels.toml: the unit of {guess.channel!r}.")
        elif guess.quantity == "speed" and ROTATIONS.match(guess.unit):
            sentences.append(f"channels.toml: scale of {guess.channel!r}: the lead, in mm per revolution.")
        elif guess.quantity == "speed" and RADIANS.match(guess.unit):
            sentences.append(
                f"channels.toml: scale of {guess.channel!r}: the lead over 2π, in mm per radian."
            )
    return sentences


def _differences(files: Sequence[Path], headers: Sequence[Header]) -> list[str]:
    first = {channel.name for channel in headers[0].channels}
    sentences: list[str] = []
    for file, header in zip(files[1:], headers[1:], strict=True):
        lacking = sorted(first - {channel.name for channel in header.channels})
        if lacking:
            named = ", ".join(lacking[:_MOST_NAMED])
            sentences.append(f"{file.name}: lacks channels that {files[0].name} has: {named}.")
    return sentences


def _axis_todo(guesses: Sequence[ChannelGuess]) -> str:
    """What the data sheet lacks; no natural frequency needs the scale of the torque."""
    todo = "axis.toml: the data sheet of the axis, every TODO"
    for guess in guesses:
        if guess.used and guess.quantity in _SCALES:
            return f"{todo}; drive.{_SCALES[guess.quantity]} too, for the masses."
    return f"{todo}."


def _plan_todo(measured: MeasuredPlan | None) -> str:
    if measured is None:
        return "plan.toml: positions, repetitions, masses, motion, and the controller's jerk limit, if any."
    return (
        "plan.toml: masses, and the controller's jerk limit, if any; the rest is measured from the "
        "file and should be checked."
    )


def _relative_path(file: Path, out: Path) -> str:
    try:
        return Path(os.path.relpath(file.resolve(), out.resolve())).as_posix()
    except ValueError:  # on another drive
        return file.resolve().as_posix()


def _write(out: Path, texts: dict[str, str], force: bool) -> tuple[Path, ...]:
    existing = [name for name in texts if (out / name).exists()]
    if existing and not force:
        raise InputError(
            f"{out / existing[0]}: exists already; write to another folder, or overwrite it with --force."
        )
    try:
        out.mkdir(parents=True, exist_ok=True)
        for name, text in texts.items():
            write_text(out / name, text)
    except OSError as error:
        raise InputError(f"{out}: cannot be written to ({error.strerror or error}).") from None
    return tuple(out / name for name in texts)
