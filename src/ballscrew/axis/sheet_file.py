"""File of a data sheet, axis.toml: read into SI units, and written."""

from __future__ import annotations

import json
import math
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from ballscrew.axis.sheet import (
    CONVENTIONS,
    ORIENTATIONS,
    POSITIVE_DIRECTIONS,
    PRELOADED_BY,
    ROTATING_PARTS,
    STANDARD_GRAVITY,
    STEEL_DENSITY,
    STEEL_E,
    STEEL_G,
    SUPPORTS,
    Bearing,
    DataSheet,
    Drive,
    Guide,
    Limits,
    Screw,
    Table,
)
from ballscrew.base.tomlfile import Fields, read_toml

_TABLES = ("screw", "bearing", "table", "drive", "guide", "tolerances", "limits")
_LARGEST_TOLERANCE = 3.0  # a factor of 20
# Times the weight of the table along the axis, so a load of four tables is carried: more is a wrong unit.
_LARGEST_COUNTERBALANCE = 5.0

# Least and most that is possible, in SI: wide, and still narrow enough to see a unit that was left out.
_LIMITS: dict[str, tuple[str, float, float]] = {
    "lead": ("m", 0.0001, 1),
    "root_diameter": ("m", 0.001, 1),
    "nominal_diameter": ("m", 0.001, 1),
    "length": ("m", 0.01, 100),
    "bearing_to_zero": ("m", 0, 100),
    "dynamic_load_rating": ("N", 1, 1e08),
    "rigidity": ("N/m", 10000, 1e11),
    "rigidity_preload_ratio": ("", 0.001, 1),
    "rigidity_load_ratio": ("", 0.001, 1),
    "preload_ratio": ("", 0.0001, 0.2),
    "youngs_modulus": ("Pa", 1e08, 1e13),
    "shear_modulus": ("Pa", 1e08, 1e13),
    "density": ("kg/m^3", 100, 100000),
    "stiffness": ("N/m", 10000, 1e12),
    "far_stiffness": ("N/m", 10000, 1e12),
    "pretension": ("N", 0, 1e07),
    "mass": ("kg", 0.001, 1e06),
    "counterbalance": ("N", 0, 1e07),
    "friction": ("N", 0, 1e06),
    "rotor_inertia": ("kg m^2", 1e-09, 10000),
    "torque_constant": ("N m/A", 1e-06, 10000),
    "rated_torque": ("N m", 1e-06, 1e06),
    "coupling_stiffness": ("N m/rad", 0.001, 1e09),
    "ratio": ("", 0.001, 1000),
    "belt_stiffness": ("N m/rad", 0.001, 1e09),
}
_MACHINE_LIMITS: dict[str, tuple[str, float, float]] = {
    "lowest_position": ("m", -100, 100),
    "highest_position": ("m", -100, 100),
    "speed": ("m/s", 1e-6, 100),
    "torque": ("N m", 1e-6, 1e6),
}


def read_axis(path: str | Path) -> DataSheet:
    """Read a data sheet.

    Parameters
    ----------
    path : path-like
        TOML; a quantity is a text with its unit, a bare number is SI.

    Returns
    -------
    DataSheet
        Values in SI.

    Raises
    ------
    InputError
        If the file is not TOML, or a field is missing, of the wrong kind or impossible.
    """
    top = read_toml(path)
    top.only(("name", "support", "orientation", "inclination", "positive", *_TABLES))
    name = top.text("name")
    if name.strip().upper().startswith("TODO"):
        raise top.error("name", "the name of the axis; this template is not filled in yet")
    support = top.text("support", choices=SUPPORTS)
    orientation = top.text("orientation", ORIENTATIONS[0], choices=ORIENTATIONS)
    if orientation == ORIENTATIONS[0] and "positive" in top:
        raise top.error("positive", f"left out where orientation is {orientation!r}")
    inclination = _inclination(top, orientation)
    drive = _drive(top.sub("drive"))
    sheet = DataSheet(
        name=name,
        support=support,
        screw=_screw(top.sub("screw")),
        bearing=_bearing(top.sub("bearing"), support, drive),
        table=_table(top.sub("table"), orientation, inclination),
        drive=drive,
        guide=_guide(top.sub("guide", required=False)),
        source=top.source,
        limits=_limits(top.sub("limits", required=False)),
        orientation=orientation,
        inclination=inclination,
        positive=top.text("positive", POSITIVE_DIRECTIONS[0], choices=POSITIVE_DIRECTIONS),
    )
    return replace(sheet, tolerances=_tolerances(top.sub("tolerances", required=False), sheet))


def axis_toml(sheet: DataSheet) -> str:
    """Write a data sheet as TOML in SI; to read it back gives the same axis.

    Parameters
    ----------
    sheet : DataSheet
        The axis.

    Returns
    -------
    str
        The file's text.
    """
    values = asdict(sheet)
    lines = [
        "# The data sheet of one axis, in SI.",
        f"name = {json.dumps(sheet.name, ensure_ascii=False)}",
        f"support = {json.dumps(sheet.support)}",
    ]
    if sheet.orientation != ORIENTATIONS[0]:
        lines += [f'orientation = "{sheet.orientation}"', f'positive = "{sheet.positive}"']
    if sheet.orientation == "inclined":
        lines.append(f"inclination = {sheet.inclination!r}")
    for part in _TABLES:
        stated = []
        for name, value in values[part].items():
            if value is not None:
                stated.append(f"{name} = {_toml_value(value)}")
        if stated:
            lines += ["", f"[{part}]", *stated]
    return "\n".join(lines) + "\n"


def _screw(screw: Fields) -> Screw:
    # "contact" is read from older sheets and has no effect: the maker's K contains it.
    screw.only((*Screw.__dataclass_fields__, "contact"))
    root = _value(screw, "root_diameter")
    read = Screw(
        lead=_value(screw, "lead"),
        root_diameter=root,
        nominal_diameter=_value(screw, "nominal_diameter", root),
        length=_value(screw, "length"),
        bearing_to_zero=_value(screw, "bearing_to_zero"),
        dynamic_load_rating=_value(screw, "dynamic_load_rating"),
        rigidity=_value(screw, "rigidity"),
        preload_ratio=_value(screw, "preload_ratio"),
        youngs_modulus=_value(screw, "youngs_modulus", STEEL_E),
        shear_modulus=_value(screw, "shear_modulus", STEEL_G),
        density=_value(screw, "density", STEEL_DENSITY),
        preload_by=screw.text("preload_by", None, choices=PRELOADED_BY),
        **_convention(screw),
    )
    if read.nominal_diameter < root:
        raise screw.error("nominal_diameter", f"the root diameter ({root:g} m) or more")
    if read.bearing_to_zero >= read.length:
        raise screw.error("bearing_to_zero", f"less than the screw's length ({read.length:g} m)")
    return read


def _inclination(top: Fields, orientation: str) -> float:
    """Inclination of an axis to the horizontal, rad."""
    if orientation == "inclined":
        angle: float = top.quantity("inclination", "rad", above=0.0, most=math.pi / 2)
        return angle
    if "inclination" in top:
        raise top.error("inclination", f"left out where orientation is {orientation!r}")
    return math.pi / 2 if orientation == "vertical" else 0.0


def _bearing(bearing: Fields, support: str, drive: Drive) -> Bearing:
    bearing.only(Bearing.__dataclass_fields__)
    for name in ("far_stiffness", "pretension"):
        if name in bearing and support != "fixed-fixed":
            raise bearing.error(name, f"left out where support is {support!r}")
    if "far_stiffness" in bearing and drive.rotating == "nut":
        raise bearing.error("far_stiffness", "left out where drive.rotating is 'nut': the ends are clamped")
    return Bearing(
        stiffness=_value(bearing, "stiffness"),
        far_stiffness=_value(bearing, "far_stiffness", None),
        pretension=_value(bearing, "pretension", None),
    )


def _table(table: Fields, orientation: str, inclination: float) -> Table:
    table.only(Table.__dataclass_fields__)
    mass, counterbalance = _value(table, "mass"), _value(table, "counterbalance", 0.0)
    if counterbalance > 0 and orientation == "horizontal":
        raise table.error("counterbalance", "left out where orientation is 'horizontal'")
    weight = mass * STANDARD_GRAVITY * math.sin(inclination)
    if counterbalance > _LARGEST_COUNTERBALANCE * weight:
        limit = f"at most {_LARGEST_COUNTERBALANCE:g} times the weight of the table along the axis"
        raise table.error("counterbalance", f"{limit} ({weight:.3g} N)")
    return Table(mass=mass, counterbalance=counterbalance)


def _convention(screw: Fields) -> dict[str, Any]:
    """Convention of K with the preload or the load at which it is stated."""
    usual = "preloaded" if "rigidity_preload_ratio" in screw else "unknown"
    convention = screw.text("rigidity_convention", usual, choices=CONVENTIONS)
    required = convention in ("preloaded", "iso")
    preload = _value(screw, "rigidity_preload_ratio", *(() if required else (None,)))
    load = _value(screw, "rigidity_load_ratio", 0.30 if convention == "clearance" else None)
    if preload is not None and convention in ("clearance", "unknown"):
        raise screw.error("rigidity_preload_ratio", f"left out where rigidity_convention is {convention!r}")
    if load is not None and convention != "clearance":
        raise screw.error("rigidity_load_ratio", "left out unless rigidity_convention is 'clearance'")
    return {
        "rigidity_convention": convention,
        "rigidity_preload_ratio": preload,
        "rigidity_load_ratio": load,
    }


def _drive(drive: Fields) -> Drive:
    drive.only(Drive.__dataclass_fields__)
    return Drive(
        rotor_inertia=_value(drive, "rotor_inertia"),
        torque_constant=_value(drive, "torque_constant", None),
        coupling_stiffness=_value(drive, "coupling_stiffness", None),
        ratio=_value(drive, "ratio", 1.0),
        belt_stiffness=_value(drive, "belt_stiffness", None),
        rotating=drive.text("rotating", ROTATING_PARTS[0], choices=ROTATING_PARTS),
        pole_pairs=drive.whole("pole_pairs", None, least=1),
        rated_torque=_value(drive, "rated_torque", None),
    )


def _value(table: Fields, name: str, *default: float | None) -> Any:
    unit, least, most = _LIMITS[name]
    return table.quantity(name, unit, *default, least=least, most=most)


def _guide(guide: Fields) -> Guide:
    guide.only(Guide.__dataclass_fields__)
    return Guide(_value(guide, "friction", None))


def _tolerances(table: Fields, sheet: DataSheet) -> dict[str, float]:
    table.only(_LIMITS)
    for name in table.table:
        parts = (sheet.screw, sheet.bearing, sheet.table, sheet.drive, sheet.guide)
        if not any(getattr(part, name, None) for part in parts):
            raise table.error(name, f"left out: the data sheet does not state {name}")
    return {name: _tolerance(table, name) for name in table.table}


def _tolerance(table: Fields, name: str) -> float:
    """Tolerance as a natural logarithm: a number, or ``"factor 1.8"``."""
    raw = table.table[name]
    if not isinstance(raw, str) or not raw.startswith("factor "):
        return float(table.quantity(name, "", least=0, most=_LARGEST_TOLERANCE))
    try:
        factor = float(raw.removeprefix("factor "))
    except ValueError:
        factor = math.nan
    if not 1 <= factor <= math.exp(_LARGEST_TOLERANCE):
        raise table.error(name, f"'factor' and a number from 1 to {math.exp(_LARGEST_TOLERANCE):.0f}")
    return math.log(factor)


def _limits(table: Fields) -> Limits:
    table.only(_MACHINE_LIMITS)
    limits = Limits(
        **{
            name: table.quantity(name, unit, None, least=least, most=most)
            for name, (unit, least, most) in _MACHINE_LIMITS.items()
        }
    )
    low, high = limits.lowest_position, limits.highest_position
    if low is not None and high is not None and not low < high:
        raise table.error("highest_position", f"more than lowest_position ({low:g} m)")
    return limits


def _toml_value(value: float | str) -> str:
    if isinstance(value, int | str):
        return json.dumps(value)
    return repr(float(value))
