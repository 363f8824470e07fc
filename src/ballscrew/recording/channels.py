"""Channel map: quantity, location and unit of each channel of a file."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from ballscrew.base.errors import InputError, shown
from ballscrew.base.tomlfile import Fields, read_toml
from ballscrew.recording.filters import Filter, filters_of
from ballscrew.recording.quantities import INPUTS, SI_UNITS, to_si

TODO = "TODO"  # written by `init` where the user has to fill something in
RATES = (1e-3, 1e9)  # Hz: a slow thermometer, the fastest oscilloscopes
_LARGEST = 1e15  # scale: more than the steps of a 48-bit counter
ROTATIONS = re.compile(  # units of a motor's speed
    r"(?:rpm|(?:1|r|rev|u|umdr\.?|tr|giri) ?/ ?min|min ?(?:\^? ?-1|⁻¹))\Z", re.IGNORECASE
)
RADIANS = re.compile(r"rad ?/ ?s\Z", re.IGNORECASE)  # the same by angle
DERIVED_FROM = {"second-derivative": "position", "derivative": "speed"}  # an acceleration
_ANGLES = ("deg", "°", "rad", "rev", "turn", "turns", "revolution", "degree", "degrees", "radian")
# Fields of a channel and their defaults, which are omitted from settings.
_SETTINGS: dict[str, Any] = {
    "source": "", "quantity": "", "unit": "", "scale": None, "offset": 0.0, "location": "", "axis": "",
    "derive": None, "sample_rate": None, "phase": "", "filtered_by": [], "followed_by": [],
}  # fmt: skip
PHASES = ("u", "v", "w")
_PHASE_LETTERS = dict(zip("uvwabcrst", 3 * PHASES, strict=True))
_PHASE_CURRENT = re.compile(r"(?:.*[\W_\d]|.*[a-z](?=[A-Z]\Z)|[iI])([a-cr-wA-CR-W])\Z")


@dataclass(frozen=True, slots=True)
class Channel:
    """One channel of a recording, and its source in the file.

    Parameters
    ----------
    source : str
        The channel's name in the file.
    quantity : str
        One of :data:`ballscrew.recording.quantities.SI_UNITS`.
    unit : str
        As written; empty for the unit that the file gives, or SI where it gives none.
    scale : float, optional
        ``scale * raw + offset`` is the value in ``unit``; 1 without.
    offset : float
        In ``unit``.
    location : str
        Location of the sensor, ``"nut-1"``.
    direction : str
        Direction of the sensor, ``"x"`` along the screw.
    derive : str, optional
        ``"second-derivative"`` or ``"derivative"``: an acceleration made from the position or the speed
        channel of the same source.
    sample_rate : float, optional
        The channel's own rate, Hz.
    phase : str
        Phase of a current: ``"u"``, ``"v"`` or ``"w"``, or ``"q"`` for the q axis, the default.
    filtered_by : tuple of Filter
        Filters between the quantity and its record, which are undone.
    followed_by : tuple of Filter
        Filters between a recorded command and the motor, which are applied.
    suffix : str
        Number of a channel among those of the same name, ``"#2"``; set by the map.
    """

    source: str
    quantity: str
    unit: str = ""
    scale: float | None = None
    offset: float = 0.0
    location: str = ""
    direction: str = ""
    derive: str | None = None
    sample_rate: float | None = None
    phase: str = ""
    filtered_by: tuple[Filter, ...] = ()
    followed_by: tuple[Filter, ...] = ()
    suffix: str = field(default="", compare=False)

    @property
    def name(self) -> str:
        """Name in the recording, ``"acceleration:nut-1:x"``."""
        parts = (self.quantity, self.location, self.direction, self.phase)
        return ":".join(filter(None, parts)) + self.suffix


@dataclass(frozen=True, slots=True)
class ChannelMap:
    """Meaning of the channels of the files.

    Parameters
    ----------
    channels : tuple of Channel
        In the order of the file.
    sample_rate : float, optional
        Declared rate of all channels that declare none, Hz.
    source : str
        Name of the file.

    Raises
    ------
    InputError
        If there is no channel, a channel is mapped twice, or a derived one has no position or speed.
    """

    channels: tuple[Channel, ...]
    sample_rate: float | None = None
    source: str = "channels"

    def __post_init__(self) -> None:
        """Check the channels against each other and make their names unique."""
        if not self.channels:
            raise InputError(
                f"{self.source}: has no channel; it must have at least one table headed [[channel]]."
            )
        measured = {(channel.source, channel.quantity) for channel in self.channels}
        mapped: set[tuple[str, str, str | None]] = set()
        for i, channel in enumerate(self.channels):
            key = (channel.source, channel.quantity, channel.derive)
            if key in mapped:
                raise InputError(
                    f"{self.source}: channel[{i}] maps {channel.source!r} to {channel.quantity} again."
                )
            mapped.add(key)
            if channel.derive and (channel.source, DERIVED_FROM[channel.derive]) not in measured:
                raise InputError(
                    f"{self.source}: channel[{i}].source is {channel.source!r}; to be derived from, it must"
                    f" be mapped as a {DERIVED_FROM[channel.derive]} by another [[channel]], which gives its"
                    " unit."
                )
        if [channel.quantity for channel in self.channels].count("time") > 1:
            raise InputError(
                f"{self.source}: has more than one channel of the quantity time; it must have one or none."
            )
        object.__setattr__(self, "channels", _with_suffixes(_with_phases(self.channels)))

    def to_settings(self) -> dict[str, Any]:
        """All settings that are not defaults, in the form of :meth:`from_settings`."""
        rows: list[dict[str, Any]] = []
        for channel in self.channels:
            values = asdict(channel) | {"axis": channel.direction}
            for name in ("filtered_by", "followed_by"):
                values[name] = [each.to_settings() for each in getattr(channel, name)]
            rows.append({key: values[key] for key, default in _SETTINGS.items() if values[key] != default})
        if self.sample_rate is None:
            return {"channel": rows}
        return {"sample_rate": self.sample_rate, "channel": rows}

    @classmethod
    def from_settings(cls, settings: Mapping[str, Any], source: str = "channels") -> ChannelMap:
        """Make a map from the settings of a TOML file or of :meth:`to_settings`, checked in the same way.

        Raises
        ------
        InputError
            If a field is not known, is missing or has an impossible value.
        """
        fields = Fields(settings, source)
        fields.only(("sample_rate", "channel"))
        rate = fields.quantity("sample_rate", "Hz", None, least=RATES[0], most=RATES[1])
        return cls(tuple(_channel(row) for row in fields.subs("channel")), rate, source)


def phase_of(name: str) -> str:
    """Phase that the name of a current states at its end, ``"u"`` of ``current_u`` and ``Iu``; else empty."""
    match = _PHASE_CURRENT.match(name.strip(" )]"))
    return _PHASE_LETTERS[match[1].lower()] if match else ""


def _with_phases(channels: Iterable[Channel]) -> tuple[Channel, ...]:
    """Channels with the phases of currents by their names, where two or more are of a phase."""
    phased = []
    for channel in channels:
        phase = channel.phase
        if channel.quantity == "current" and not phase:
            phase = phase_of(channel.source)
        phased.append(replace(channel, phase=phase))
    found = {channel.phase for channel in phased}.intersection(PHASES)
    return tuple(phased if len(found) > 1 else channels)


def _with_suffixes(channels: Iterable[Channel]) -> tuple[Channel, ...]:
    """Channels with numbers where names are equal."""
    count: Counter[str] = Counter()
    named = []
    for channel in channels:
        bare = replace(channel, suffix="")
        count[bare.name] += 1
        if count[bare.name] > 1:
            bare = replace(channel, suffix=f"#{count[bare.name]}")
        named.append(bare)
    return tuple(named)


def read_channels(path: str | Path) -> ChannelMap:
    """Read a channel map.

    Parameters
    ----------
    path : path-like
        ``channels.toml``.

    Returns
    -------
    ChannelMap
        Checked, but not yet against a recording.

    Raises
    ------
    InputError
        If the file cannot be read, a field is not known, is missing or has an impossible value.
    """
    fields = read_toml(path)
    return ChannelMap.from_settings(fields.table, fields.source)


def _channel(row: Fields) -> Channel:
    row.only((*_SETTINGS, "direction"))
    _check_complete(row)
    source = row.text("source")
    quantity = row.text("quantity", choices=tuple(SI_UNITS))
    if quantity == "torque" and row.text("unit", "").strip().startswith("%"):
        quantity = "relative torque"
    unit = _unit(row, quantity)
    derive = row.text("derive", None, choices=tuple(DERIVED_FROM))
    scale = row.quantity("scale", "", None, least=-_LARGEST, most=_LARGEST)
    offset = row.quantity("offset", "", 0.0, least=-_LARGEST, most=_LARGEST)
    if scale is not None and abs(scale) < 1 / _LARGEST:
        raise row.error("scale", f"a plain number other than 0, {1 / _LARGEST:g} or more in size")
    if derive is not None:
        _check_derived(row, quantity)
    if "axis" in row and "direction" in row:
        raise row.error("direction", "left out where axis says the same")
    direction = row.text("axis", "") or row.text("direction", "")
    rate = row.quantity("sample_rate", "Hz", None, least=RATES[0], most=RATES[1])
    read = Channel(source, quantity, unit, scale, offset, row.text("location", ""), direction, derive, rate)
    undone, applied = _filters(row, read, "filtered_by"), _filters(row, read, "followed_by")
    if applied and (quantity not in INPUTS or row.text("phase", "q") in PHASES):
        raise row.error("followed_by", "left out: only a torque, a force or a q-axis current is a command")
    return replace(read, phase=_phase(row, quantity), filtered_by=undone, followed_by=applied)


def _check_complete(row: Fields) -> None:
    """Refuse a field that `init` has left to fill in, by the channel that it is of."""
    source, quantity = (str(row.table.get(name, TODO)) for name in ("source", "quantity"))
    of = "the channel" if quantity == TODO else f"the {quantity}"
    allowed = {
        "source": f"filled in: the name of {of} in the files",
        "quantity": f"filled in: what {shown(source)} is, one of {', '.join(SI_UNITS)}",
        "unit": f"a unit of {quantity}, that of {shown(source)}",
        "scale": f"filled in: a number, the {row.table.get('unit', 'unit')} per unit of {shown(source)}",
    }
    for name, what in allowed.items():
        if row.table.get(name) == TODO:
            raise row.error(name, what)


def _phase(row: Fields, quantity: str) -> str:
    if "phase" in row and quantity != "current":
        raise row.error("phase", "left out: only a current has one")
    phase: str = row.text("phase", "", choices=(*PHASES, "q"))
    return phase


def _filters(row: Fields, channel: Channel, name: str) -> tuple[Filter, ...]:
    filters = filters_of(row, name)
    if filters and (channel.derive or channel.quantity == "time"):
        raise row.error(name, "left out for a time and for an acceleration that is derived")
    return filters


def _unit(row: Fields, quantity: str) -> str:
    unit: str = row.text("unit", "")
    if quantity == "position" and unit.strip().casefold() in _ANGLES:
        raise row.error(
            "unit",
            "a length, the table's; for a motor's angle give the travel per unit as scale, and its unit",
        )
    by_turn, by_angle = ROTATIONS.match(unit.strip()), RADIANS.match(unit.strip())
    if quantity == "speed" and (by_turn or by_angle):
        per = "revolution" if by_turn else "radian"
        travel = f"for a motor's speed give the travel per {per} as scale"
        raise row.error("unit", f'the table\'s, such as "mm/min"; {travel}')
    try:
        to_si(unit, quantity)
    except InputError as error:
        kind = f"a unit of {quantity}, one that can be turned into {SI_UNITS[quantity]}"
        raise InputError(
            f"{row.source}: {row.name('unit')} is {unit!r}; it must be {kind} ({error})."
        ) from None
    return unit


def _check_derived(row: Fields, quantity: str) -> None:
    if quantity != "acceleration":
        raise row.error("derive", "left out: only an acceleration can be derived, from a position or a speed")
    if to_si(row.text("unit", ""), quantity) != (1.0, 0.0):
        raise row.error(
            "unit", "m/s^2 or left out: what is derived is in SI, whatever the unit of its source is"
        )
    for name in ("scale", "offset", "sample_rate"):
        if name in row:
            raise row.error(
                name, "left out here and given for the channel that the acceleration is derived from"
            )
