"""Guesses of a file's channels from their names and units."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache

from ballscrew.base.errors import InputError
from ballscrew.recording.channels import PHASES, RADIANS, ROTATIONS, TODO, phase_of
from ballscrew.recording.header import Header, RawChannel
from ballscrew.recording.quantities import INPUTS, SI_UNITS, to_si
from ballscrew.recording.readers.labels import is_unit, split_label
from ballscrew.recording.temperature import is_elsewhere

# In the order of precedence: words of names in English and the languages of the makers of drives. LabVIEW's
# time is X_Value; IL, VL and PL are the loops of current, velocity and position of Kollmorgen's drives.
_WORDS = {
    "time": "time t zeit timestamp zeitstempel temps tiempo tempo sec seconds xvalue",
    "torque": "torque trq tq drehmoment drehmomentistwert momentenistwert moment couple coppia mist",
    "force": "force kraft frc forza",
    "temperature": "temperature temp temperatur celsius",
    "backlash": "backlash umkehrspiel spiel",
    "acceleration": "acceleration accelerometer accel acc acce beschleunigung beschl vib vibration ax ay az",
    "speed": "speed velocity velo vel geschwindigkeit vist vact drehzahl drehzahlistwert rpm nist nact vl v",
    "current": "current strom iq curr courant corrente amps stromistwert il i",
    "position": "position pos posn encoder enc weg lage lageistwert xact xist stroke travel disp pl qm scale "
    "x y z s",
}
_QUANTITY_OF = {word: quantity for quantity, words in reversed(_WORDS.items()) for word in words.split()}
_REFERENCE = re.compile(
    r"ref|reference|set|setpoint|soll|cmd|command|commanded|target|demand|desired|nominal"
)
# What a control loop leaves is no position and no speed, whatever its unit is.
_DEVIATION = re.compile(r"error|err|dev|deviation|dif|diff|lag|schleppabstand|schleppfehler|regeldifferenz")
_TORQUE_CURRENT = {"torque", "current"}  # "torque current": the current that produces the torque
_COMPOUND = re.compile(r"\b(ist|soll|motor)(?=\w{4})")  # of German names: Istposition, Motordrehzahl
_VAGUE = re.compile(r"moment|tq|temp|qm|scale|sec|travel|lage|.")
_DIRECTIONS = ("x", "y", "z")
_ALONG = "x"


@dataclass(frozen=True, slots=True)
class ChannelGuess:
    """Guess of one channel of a file.

    Parameters
    ----------
    channel : str
        Its name in the file.
    quantity : str
        One of :data:`ballscrew.recording.quantities.SI_UNITS`; empty where nothing fits.
    unit : str
        As written; ``"TODO"`` where it has to be filled in.
    why : str
        Reason, in words.
    sure : bool
        Whether name and unit agree, and the analysis uses the channel.
    used : bool
        Whether it is part of the channel map.
    location, direction : str
        Location and direction of an accelerometer.
    derive : str
        ``"second-derivative"`` or ``"derivative"`` for an acceleration derived from position or speed.
    phase : str
        Phase of a current, ``"u"``, ``"v"`` or ``"w"``.
    scaled : bool
        False where the file gives neither scale nor unit, which are then asked for.
    """

    channel: str
    quantity: str
    unit: str
    why: str
    sure: bool
    used: bool = False
    location: str = ""
    direction: str = ""
    derive: str = ""
    phase: str = ""
    scaled: bool = True


def guess_channels(
    header: Header, update_intervals: Mapping[str, int] | None = None
) -> tuple[ChannelGuess, ...]:
    """Guess the quantity and unit of each channel of a file, and choose those for the channel map.

    Parameters
    ----------
    header : Header
        Header of the file.
    update_intervals : mapping of str to int, optional
        Samples between two updates of channels that are updated less often than they are recorded.

    Returns
    -------
    tuple of ChannelGuess
        In the order of the file; at most one input (or the currents of the phases), position, temperature and
        time is used, and every accelerometer along the screw. Without an accelerometer, one derived from the
        position comes last, or from a speed that has a higher rate than the position. In a file of counts
        without any name of a quantity, such as WAV, all are used.
    """
    guesses = _phased([replace(_guess(channel), scaled=channel.scaled) for channel in header.channels])
    if not any(guess.quantity or guess.scaled for guess in guesses):
        return _unknown(guesses)
    used = _used(guesses)
    used.update(_faster_speed(guesses, used, _rates(header, update_intervals or {})))
    for index, guess in enumerate(guesses):
        if index in used:
            guesses[index] = replace(guess, used=True)
        elif guess.quantity:
            why = f"{guess.why}; {_reason_unused(guess, [guesses[i] for i in used])}"
            guesses[index] = replace(guess, sure=False, why=why)
    sources = {guess.quantity: guess.channel for guess in guesses if guess.used}
    if "position" in sources and "acceleration" not in sources:
        guesses.append(_derived(sources))
    return tuple(guesses)


def _unknown(guesses: list[ChannelGuess]) -> tuple[ChannelGuess, ...]:
    """Channels of which the file gives nothing, all to fill in."""
    why = "the file gives neither a name of a quantity nor a scale"
    return tuple(replace(guess, unit=TODO, why=why, used=True) for guess in guesses)


def _used(guesses: list[ChannelGuess]) -> set[int]:
    """Indices of the channels for the channel map."""
    inputs: list[int] = []
    for quantity in INPUTS:
        inputs = inputs or _best(guesses, quantity)
    if inputs and guesses[inputs[0]].phase:
        inputs = _first_of_each_phase(guesses)
    used = set(inputs)
    for quantity in ("position", "temperature", "time"):
        used.update(_best(guesses, quantity))
    for index, guess in enumerate(guesses):
        if guess.quantity == "acceleration" and guess.direction == _ALONG:
            used.add(index)
    return used


def _rates(header: Header, update_intervals: Mapping[str, int]) -> dict[str, float]:
    """Rates of the updates of channels, Hz; relative ones where the file states none."""
    rates = {}
    for channel in header.channels:
        rate = channel.sample_rate or header.sample_rate or 1.0
        rates[channel.name] = rate / update_intervals.get(channel.name, 1)
    return rates


def _faster_speed(guesses: list[ChannelGuess], used: set[int], rates: Mapping[str, float]) -> list[int]:
    """Index of a speed that has a higher rate than the position; none beside an accelerometer."""
    if any(guesses[index].quantity == "acceleration" for index in used):
        return []
    speeds, positions = _best(guesses, "speed"), _best(guesses, "position")
    if not speeds or not positions:
        return []
    speed = guesses[speeds[0]]
    if not rates[speed.channel] > rates[guesses[positions[0]].channel]:
        return []
    known = speed.sure or ROTATIONS.match(speed.unit) or RADIANS.match(speed.unit)
    return speeds if known and not _is_reference(speed.channel) else []


def _reason_unused(guess: ChannelGuess, used: list[ChannelGuess]) -> str:
    """Why a channel of a known quantity is not part of the channel map."""
    if guess.quantity == "temperature" and is_elsewhere(guess.channel):
        return "the temperature of a motor or of the room is not the axis's"
    for other in used:
        if other.quantity == guess.quantity or {other.quantity, guess.quantity} <= set(INPUTS):
            return f"{other.channel!r} is used"
    return "the analysis does not use it"


def _phased(guesses: list[ChannelGuess]) -> list[ChannelGuess]:
    """Guesses with the phases of currents, where two phases or more have one."""
    phases = []
    for guess in guesses:
        leaf = split_label(guess.channel)[0].rsplit("/", 1)[-1]
        phases.append(phase_of(leaf) if guess.quantity == "current" else "")
    if len(set(phases) - {""}) < 2:
        return guesses
    return [replace(guess, phase=phase) for guess, phase in zip(guesses, phases, strict=True)]


def _first_of_each_phase(guesses: list[ChannelGuess]) -> list[int]:
    phases = [guess.phase for guess in guesses]
    return [phases.index(phase) for phase in PHASES if phase in phases]


def _derived(sources: Mapping[str, str]) -> ChannelGuess:
    """Acceleration of the motor, made from its speed where one is used, else from the position."""
    origin, derive = "position", "second-derivative"
    if "speed" in sources:
        origin, derive = "speed", "derivative"
    why = f"no accelerometer was found, so the acceleration is made from the {origin}"
    return ChannelGuess(
        sources[origin],
        "acceleration",
        "m/s^2",
        why,
        sure=False,
        used=True,
        location="motor",
        direction=_ALONG,
        derive=derive,
    )


def _best(guesses: list[ChannelGuess], quantity: str) -> list[int]:
    """Index of the best channel of a quantity; no index without any."""

    def rank(index: int) -> tuple[bool, bool, bool]:
        guess = guesses[index]
        return _is_reference(guess.channel), bool(guess.phase), not guess.sure

    fitting = [index for index, guess in enumerate(guesses) if guess.quantity == quantity]
    if quantity == "temperature":
        fitting = [index for index in fitting if not is_elsewhere(guesses[index].channel)]
    return sorted(fitting, key=rank)[:1]


def _is_reference(name: str) -> bool:
    return any(map(_REFERENCE.fullmatch, _tokens(name)))


def _tokens(name: str) -> list[str]:
    spaced = re.sub(r"(?<=[a-zäöü])(?=[A-Z])", " ", name)
    words = re.sub(r"[\W_\d]+", " ", spaced).casefold()
    return _COMPOUND.sub(r"\1 ", words).split()


def _guess(channel: RawChannel) -> ChannelGuess:
    stem, label_unit = split_label(channel.name)
    unit = channel.unit or label_unit or ""
    leaf = stem.rsplit("/", 1)[-1]
    if not unit:
        leaf, unit = _unit_at_end(leaf)
    tokens = _tokens(leaf)
    direction = ""
    if len(tokens) > 1 and tokens[-1] in _DIRECTIONS:
        direction = tokens[-1]
    if any(map(_DEVIATION.fullmatch, tokens)):
        return ChannelGuess(channel.name, "", unit, "its name is that of a deviation", sure=False)
    if ROTATIONS.match(unit) or RADIANS.match(unit):
        scale = "the lead" if ROTATIONS.match(unit) else "the lead over 2π"
        why = f"its unit is {unit}, of a motor's speed; the scale is {scale}"
        return ChannelGuess(channel.name, "speed", unit, why, sure=False)
    word = _quantity_word(tokens, direction)
    guess = _by_name_and_unit(channel.name, word, unit)
    if guess.quantity == "acceleration":
        return _placed(guess, leaf, direction, word)
    return guess


def _quantity_word(tokens: list[str], direction: str) -> str:
    """Word of a name that is of a quantity, unambiguous words first; empty without any."""
    words = _known_words(tokens)
    if direction in words:
        words.pop()
    joined = "".join(tokens)
    if joined in _QUANTITY_OF:
        words.append(joined)
    for word in words:
        if not _VAGUE.fullmatch(word):
            return word
    if joined in words:
        return joined
    return words[0] if words else ""


def _known_words(tokens: list[str]) -> list[str]:
    """Words of quantities; of a torque current, those of the current."""
    words = [token for token in tokens if token in _QUANTITY_OF]
    quantities = [_QUANTITY_OF[word] for word in words]
    if _TORQUE_CURRENT.issubset(quantities):
        return [word for word, quantity in zip(words, quantities, strict=True) if quantity == "current"]
    return words


def _by_name_and_unit(name: str, word: str, unit: str) -> ChannelGuess:
    """Guess from the word of a quantity in the name, and from the unit."""
    quantity = _QUANTITY_OF.get(word, "")
    by_unit = _quantities_of(unit)
    if quantity == "torque" and by_unit == ("relative torque",):
        quantity = by_unit[0]
    elif by_unit == ("relative torque",):  # of a load, or of an override
        by_unit = ()
    if quantity and quantity in by_unit:
        why = f"its name contains {word!r}, its unit is {unit}"
        return ChannelGuess(name, quantity, unit, why, sure=True)
    if by_unit:
        return ChannelGuess(name, by_unit[0], unit, f"its unit is {unit}", sure=False)
    if not quantity:
        why = "neither its name nor its unit is understood"
        return ChannelGuess(name, "", unit, why, sure=False)
    if unit:
        why = f"its name contains {word!r}, but {unit!r} is not a unit of {quantity}"
        return ChannelGuess(name, "", unit, why, sure=False)
    why = f"its name contains {word!r}; the file gives no unit"
    return ChannelGuess(name, quantity, "s" if quantity == "time" else TODO, why, sure=False)


def _placed(guess: ChannelGuess, leaf: str, direction: str, word: str) -> ChannelGuess:
    """Add location and direction of an accelerometer."""
    if word in ("ax", "ay", "az"):
        direction = direction or word[1]
    if not direction:
        why = f"{guess.why}; its direction is not given; along the screw is assumed"
        return replace(guess, location=leaf.strip(), direction=_ALONG, sure=False, why=why)
    location = re.sub(r"[\W_]*[xyzXYZ]\Z", "", leaf).strip()
    return replace(guess, location=location, direction=direction)


@lru_cache(maxsize=256)
def _quantities_of(unit: str) -> tuple[str, ...]:
    if not unit:
        return ()
    return tuple(quantity for quantity in SI_UNITS if _is_unit_of(unit, quantity))


def _is_unit_of(unit: str, quantity: str) -> bool:
    try:
        to_si(unit, quantity)
    except InputError:
        return False
    return True


def _unit_at_end(leaf: str) -> tuple[str, str]:
    """Split ``pos_mm`` and ``Torque Nm``; a single letter may be an axis and is no unit."""
    match = re.match(r"(.+?)[_ ]+((?:mm|um|µm|m|rad|deg)[_/]s2?|[^\W\d_]{2,4}|°C)\Z", leaf)
    if match is None:
        return leaf, ""
    unit = match[2].replace("_", "/")
    if not is_unit(unit) or unit in ("in", "min", "sec", "inc"):
        return leaf, ""
    return match[1], unit
