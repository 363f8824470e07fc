"""Data sheet of an axis, in SI."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

from ballscrew.base.errors import InputError

SUPPORTS = ("fixed-free", "fixed-supported", "fixed-fixed")
ORIENTATIONS = ("horizontal", "inclined", "vertical")
POSITIVE_DIRECTIONS = ("up", "down")
ROTATING_PARTS = ("screw", "nut")
CONVENTIONS = ("preloaded", "clearance", "iso", "measured", "unknown")
PRELOADED_BY = ("spacer", "offset lead", "oversize balls", "spring")

STANDARD_GRAVITY = 9.80665  # m/s² (CGPM 1901)

STEEL_E, STEEL_G, STEEL_DENSITY = 206e9, 80e9, 7850.0
"""Young's and shear modulus of steel, Pa, and its density, kg/m³: where a sheet states none."""

# Fields that older sheets do not have: left out of the settings at these values, so that digests remain.
_ADDED: dict[str, dict[str, Any]] = {
    "": {"orientation": "horizontal", "inclination": 0.0, "positive": "up"},
    "screw": {"rigidity_convention": "preloaded", "rigidity_load_ratio": None, "preload_by": None},
    "bearing": {"far_stiffness": None, "pretension": None},
    "table": {"counterbalance": 0.0},
    "drive": {
        "ratio": 1.0,
        "belt_stiffness": None,
        "rotating": "screw",
        "pole_pairs": None,
        "rated_torque": None,
    },
}


@dataclass(frozen=True, slots=True)
class Screw:
    """The screw and its nut.

    Parameters
    ----------
    lead : float
        Travel per turn, m.
    root_diameter : float
        Diameter at the bottom of the thread, which carries tension and torsion, m.
    nominal_diameter : float
        Diameter for the screw's own inertia, m.
    length : float
        Whole length, m.
    bearing_to_zero : float
        From the thrust bearing to the nut when the axis reads 0, m.
    dynamic_load_rating : float
        Ca, N.
    rigidity : float
        K, the nut's rigidity by ``rigidity_convention``, N/m.
    rigidity_preload_ratio : float, optional
        Preload at which K is stated, as a part of Ca; ``None`` for a measured K: at the nominal preload.
    preload_ratio : float
        Nominal preload when new, as a part of Ca.
    youngs_modulus, shear_modulus : float
        E and G of the shaft, Pa.
    density : float
        Density of the shaft, kg/m³.
    rigidity_convention : str
        One of ``CONVENTIONS``, see :func:`~ballscrew.axis.rigidity.kappa`.
    rigidity_load_ratio : float, optional
        Load at which the K of a nut with clearance is stated, as a part of Ca.
    preload_by : str, optional
        One of ``PRELOADED_BY``.
    """

    lead: float
    root_diameter: float
    nominal_diameter: float
    length: float
    bearing_to_zero: float
    dynamic_load_rating: float
    rigidity: float
    rigidity_preload_ratio: float | None
    preload_ratio: float
    youngs_modulus: float = STEEL_E
    shear_modulus: float = STEEL_G
    density: float = STEEL_DENSITY
    rigidity_convention: str = "preloaded"
    rigidity_load_ratio: float | None = None
    preload_by: str | None = None


@dataclass(frozen=True, slots=True)
class Bearing:
    """The thrust bearing; both bearings of a fixed-fixed screw.

    Parameters
    ----------
    stiffness : float
        k_b with its housing, axial, N/m. The thrust bearing moves with a nut that rotates.
    far_stiffness : float, optional
        The same of the far end of a fixed-fixed screw, N/m; ``None`` where it equals ``stiffness``.
    pretension : float, optional
        Force that stretches a fixed-fixed screw, N; ``None`` where it is not known.
    """

    stiffness: float
    far_stiffness: float | None = None
    pretension: float | None = None


@dataclass(frozen=True, slots=True)
class Table:
    """Table of the axis.

    Parameters
    ----------
    mass : float
        Table and nut, without load, kg.
    counterbalance : float
        Force that carries a part of the weight, N.
    """

    mass: float
    counterbalance: float = 0.0


@dataclass(frozen=True, slots=True)
class Drive:
    """The motor, its transmission and its coupling.

    Parameters
    ----------
    rotor_inertia : float
        Motor and coupling without the screw, at the motor, kg m².
    torque_constant : float, optional
        Torque of the motor per current of the q axis, N m/A; the peak of a phase's, if phases are recorded.
    coupling_stiffness : float, optional
        Torsional, at the screw, N m/rad; ``None`` where it is not known and taken as rigid.
    ratio : float
        Turns of the motor per turn of the screw.
    belt_stiffness : float, optional
        Torsional, of belt or gear, at the screw, N m/rad; ``None`` where there is none or it is rigid.
    rotating : str
        ``"screw"``, or ``"nut"`` where the screw stands still.
    pole_pairs : int, optional
        Of the motor.
    rated_torque : float, optional
        Of the motor, to which a torque in percent refers, N m.
    """

    rotor_inertia: float
    torque_constant: float | None = None
    coupling_stiffness: float | None = None
    ratio: float = 1.0
    belt_stiffness: float | None = None
    rotating: str = "screw"
    pole_pairs: int | None = None
    rated_torque: float | None = None


@dataclass(frozen=True, slots=True)
class Guide:
    """The guideways.

    Parameters
    ----------
    friction : float, optional
        Coulomb friction, N; ``None`` where it is not known, see
        :func:`~ballscrew.axis.model.guide_friction`.
    """

    friction: float | None = None


@dataclass(frozen=True, slots=True)
class Limits:
    """Limits of the machine; ``None`` if not stated.

    Parameters
    ----------
    lowest_position, highest_position : float, optional
        Soft limits of the axis, m.
    speed : float, optional
        Highest speed, m/s.
    torque : float, optional
        Highest torque of the motor, N m.
    """

    lowest_position: float | None = None
    highest_position: float | None = None
    speed: float | None = None
    torque: float | None = None


@dataclass(frozen=True, slots=True)
class DataSheet:
    """Data sheet of one axis.

    Parameters
    ----------
    name : str
        The axis.
    support : str
        ``"fixed-free"``, ``"fixed-supported"`` or ``"fixed-fixed"``.
    screw, bearing, table, drive, guide
        Its parts.
    source : str
        The file that it was read from, for messages.
    tolerances : mapping
        Field to tolerance t, ``{"rigidity": 0.2}``, where the sheet states any: the value lies between e^−t
        and e^t times the sheet's, which for a small t is ± t.
    limits : Limits
        Limits of the machine.
    orientation : str
        ``"horizontal"``, ``"inclined"`` or ``"vertical"``.
    inclination : float
        Of the axis to the horizontal, rad; π/2 if vertical.
    positive : str
        Where the position of an axis that is not horizontal increases: ``"up"`` or ``"down"``.
    """

    name: str
    support: str
    screw: Screw
    bearing: Bearing
    table: Table
    drive: Drive
    guide: Guide
    source: str = "the data sheet"
    tolerances: Mapping[str, float] = field(default_factory=dict, hash=False)
    limits: Limits = Limits()
    orientation: str = ORIENTATIONS[0]
    inclination: float = 0.0
    positive: str = POSITIVE_DIRECTIONS[0]

    @property
    def travel_limit(self) -> float:
        """The axis position at which the nut reaches the screw's far end, m."""
        return self.screw.length - self.screw.bearing_to_zero

    @property
    def nominal_preload(self) -> float:
        """Preload when new, N."""
        return self.screw.preload_ratio * self.screw.dynamic_load_rating

    def check_position(self, position: float, name: str = "position", source: object = None) -> None:
        """Refuse a position that is not on the screw.

        Parameters and error are those of :func:`check_on_screw`; by default the source is the sheet's file.
        """
        ends = (-self.screw.bearing_to_zero, self.travel_limit)
        check_on_screw(position, ends, source or self.source, name)

    def to_settings(self) -> dict[str, Any]:
        """All values that results depend on as plain dicts, without the file's name and the limits."""
        settings = asdict(self)
        del settings["source"], settings["limits"]
        for part, fields in _ADDED.items():
            table = settings[part] if part else settings
            for name, default in fields.items():
                if table[name] == default:
                    del table[name]
        return settings


def check_on_screw(
    position: float, ends: tuple[float, float], source: object, name: str = "position"
) -> None:
    """Refuse a position that is not on the screw.

    Parameters
    ----------
    position : float
        m.
    ends : tuple of float
        Positions of the screw's near and far end, m.
    source : object
        What states the position, or its file, for the message.
    name : str
        Of the position, for the message.

    Raises
    ------
    InputError
        If the position is beyond an end of the screw.
    """
    near, far = ends
    if not near <= position <= far:
        raise InputError(
            f"{source}: the {name} is {position:.9g} m; it must be on the screw, which ends at {near:g} and "
            f"{far:g} m."
        )
