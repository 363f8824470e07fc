"""A data sheet as TOML, as :func:`~ballscrew.axis.sheet.read_axis` reads it."""

from __future__ import annotations

import json
from dataclasses import asdict

from ballscrew.axis.sheet import DataSheet

__all__ = ["axis_toml"]

_PARTS = ("screw", "bearing", "table", "drive", "guide", "tolerances", "limits")


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
    for part in _PARTS:
        stated = {name: value for name, value in values[part].items() if value is not None}
        if stated:
            lines += ["", f"[{part}]", *(f"{name} = {_value(value)}" for name, value in stated.items())]
    return "\n".join(lines) + "\n"


def _value(value: float | str) -> str:
    return json.dumps(value) if isinstance(value, str) else repr(float(value))
