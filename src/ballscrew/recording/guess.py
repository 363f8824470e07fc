"""What a file's channels probably are, from their names and units."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from functools import lru_cache

from ballscrew.base.errors import InputError
from ballscrew.recording.header import Header, RawChannel
from ballscrew.recording.quantities import INPUTS, SI_UNITS, to_si
from ballscrew.recording.readers.labels import is_unit, split_label

__all__ = ["Guess", "guess_channels"]

# In the order of asking. Words of a name in English and in the languages of the drives' makers.
_WORDS = {
    "time": "time t zeit timestamp temps tiempo tempo sec seconds",
    "torque": "torque trq tq drehmoment moment couple coppia mist",
    "force": "force kraft frc forza",
    "temperature": "temperature temp temperatur celsius",
    "backlash": "backlash umkehrspiel spiel",
    "acceleration": "acceleration accelerometer accel acc acce beschleunigung beschl vib vibration ax ay az",
    "speed": "speed velocity vel geschwindigkeit vist vact drehzahl v",
    "current": "current strom iq curr courant corrente amps i",
    "position": "position pos posn encoder enc weg lage xact xist stroke travel disp qm scale x y z s",
}
_QUANTITY_OF = {word: quantity for quantity, words in reversed(_WORDS.items()) for word in words.split()}
_WISHED = re.compile(r"ref|reference|set|setpoint|soll|cmd|command|commanded|target|demand|desired|nominal")
_VAGUE = re.compile(r"moment|tq|temp|qm|scale|sec|travel|lage|.")
_DIRECTIONS = ("x", "y", "z")
_ALONG = "x"


@dataclass(frozen=True, slots=True)
class Guess:
    """What one channel of a file probably is.

    Parameters
    ----------
    channel : str
        Its name in the file.
    quantity : str
        One of :data:`ballscrew.recording.quantities.SI_UNITS`; empty where nothing fits.
    unit : str
        As written; ``"TODO"`` where it has to be filled in.
    why : str
        What speaks for it, in words.
    sure : bool
        Whether name and unit say the same.
    used : bool
        Whether it goes into the channel map.
    location, direction : str
        Of a sensor of acceleration.
    derive : str
        ``"second-derivative"`` where an acceleration has to be made from the position.
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


def guess_channels(header: Header) -> tuple[Guess, ...]:
    """Guess what the channels of a file are and choose those for the channel map.

    Parameters
    ----------
    header : Header
        Of the file.

    Returns
    -------
    tuple of Guess
        In the order of the file; at most one input, position, temperature and time is used, and every
        accelerometer along the screw. Without an accelerometer, one derived from the position comes last.
    """
    guesses = [_guess(channel) for channel in header.channels]
    chosen: set[int] = set()
    inputs = [_best(guesses, quantity) for quantity in INPUTS]
    chosen.update([i for i in inputs if i is not None][:1])
    chosen.update(
        i for i in (_best(guesses, q) for q in ("position", "temperature", "time")) if i is not None
    )
    chosen.update(i for i, g in enumerate(guesses) if g.quantity == "acceleration" and g.direction == _ALONG)
    rows = [replace(guess, used=i in chosen) for i, guess in enumerate(guesses)]
    position = next((row for row in rows if row.used and row.quantity == "position"), None)
    if position and not any(row.used and row.quantity == "acceleration" for row in rows):
        rows.append(_derived(position.channel))
    return tuple(rows)


def _derived(position: str) -> Guess:
    why = "no accelerometer was found, so the acceleration is made from the position"
    return Guess(
        position,
        "acceleration",
        "m/s^2",
        why,
        sure=False,
        used=True,
        location="motor",
        direction=_ALONG,
        derive="second-derivative",
    )


def _best(guesses: list[Guess], quantity: str) -> int | None:
    fitting = [i for i, guess in enumerate(guesses) if guess.quantity == quantity]
    return min(fitting, key=lambda i: (_is_wished(guesses[i].channel), not guesses[i].sure, i), default=None)


def _is_wished(name: str) -> bool:
    return any(_WISHED.fullmatch(token) for token in _tokens(name))


def _tokens(name: str) -> list[str]:
    spaced = re.sub(r"(?<=[a-zäöü])(?=[A-Z])", " ", name)
    return [token.casefold() for token in re.split(r"[\W_\d]+", spaced) if token]


def _guess(channel: RawChannel) -> Guess:
    stem, labelled = split_label(channel.name)
    unit = channel.unit or labelled or ""
    leaf = stem.rsplit("/", 1)[-1]
    if not unit:
        leaf, unit = _unit_at_end(leaf)
    tokens = _tokens(leaf)
    direction = tokens[-1] if len(tokens) > 1 and tokens[-1] in _DIRECTIONS else ""
    words = tokens[:-1] if direction else tokens
    word = next(
        (word for word in words if word in _QUANTITY_OF and not _VAGUE.fullmatch(word)), None
    ) or next((word for word in words if word in _QUANTITY_OF), None)
    joined = "".join(tokens)
    if joined in _QUANTITY_OF and (word is None or _VAGUE.fullmatch(word)):
        word = joined
    named = _QUANTITY_OF[word] if word else ""
    by_unit = _quantities_of(unit)
    if named and named in by_unit:
        guess = Guess(channel.name, named, unit, f"its name has {word!r} and its unit is {unit}", sure=True)
    elif by_unit:
        guess = Guess(channel.name, by_unit[0], unit, f"its unit is {unit}", sure=False)
    elif named and not unit:
        why = f"its name has {word!r}; the file gives no unit"
        guess = Guess(channel.name, named, "s" if named == "time" else "TODO", why, sure=False)
    elif named:
        why = f"its name has {word!r}, but {unit!r} is no unit of {named}"
        guess = Guess(channel.name, "", unit, why, sure=False)
    else:
        guess = Guess(channel.name, "", unit, "neither its name nor its unit is understood", sure=False)
    return _placed(guess, leaf, direction, word) if guess.quantity == "acceleration" else guess


def _placed(guess: Guess, leaf: str, direction: str, word: str | None) -> Guess:
    direction = direction or (word[1] if word in ("ax", "ay", "az") else "")
    location = re.sub(r"[\W_]*[xyzXYZ]\Z", "", leaf).strip() if direction else leaf.strip()
    if not direction:
        why = f"{guess.why}; its direction is not said and taken as along the screw"
        return replace(guess, location=location, direction=_ALONG, sure=False, why=why)
    return replace(guess, location=location, direction=direction)


@lru_cache(maxsize=256)
def _quantities_of(unit: str) -> tuple[str, ...]:
    return tuple(quantity for quantity in SI_UNITS if unit and _is_of(unit, quantity))


def _is_of(unit: str, quantity: str) -> bool:
    try:
        to_si(unit, quantity)
    except InputError:
        return False
    return True


def _unit_at_end(leaf: str) -> tuple[str, str]:
    """Part ``pos_mm`` and ``Torque Nm``; one letter is too little, since it may be an axis."""
    match = re.match(r"(.+?)[_ ]+((?:mm|um|µm|m|rad|deg)[_/]s2?|[^\W\d_]{2,4}|°C)\Z", leaf)
    unit = match[2].replace("_", "/") if match else ""
    return (
        (match[1], unit)
        if match and is_unit(unit) and unit not in ("in", "min", "sec", "inc")
        else (leaf, "")
    )
