"""Data sheets: a small one as text, and the three axes with known numbers."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import pytest

from ballscrew.axis.sheet import Bearing, DataSheet, Drive, Guide, Screw, Table
from ballscrew.axis.sheet_file import read_axis

SHEET: dict[str, Any] = {
    "name": "bench",
    "support": "fixed-free",
    "screw": {
        "lead": "10 mm",
        "root_diameter": "17.6 mm",
        "nominal_diameter": "20 mm",
        "length": "650 mm",
        "bearing_to_zero": "80 mm",
        "dynamic_load_rating": "15 kN",
        "rigidity": "480 N/um",
        "rigidity_preload_ratio": 0.1,
        "preload_ratio": 0.04,
    },
    "bearing": {"stiffness": "160 N/um"},
    "table": {"mass": "32 kg"},
    "drive": {"rotor_inertia": "4.2e-4 kg m^2"},
    "guide": {"friction": "25 N"},
}


def _toml(document: dict[str, Any]) -> str:
    lines = [f"{key} = {_value(v)}" for key, v in document.items() if not isinstance(v, dict)]
    for name, table in document.items():
        if isinstance(table, dict):
            lines += [f"[{name}]", *(f"{key} = {_value(v)}" for key, v in table.items())]
    return "\n".join(lines) + "\n"


def _value(value: Any) -> str:
    return str(value).lower() if isinstance(value, bool) else repr(value).replace("'", '"')


class Sheets:
    """Writes the small sheet with changes, and reads it."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def write(self, **changes: Any) -> Path:
        """Write it; ``screw__lead=…`` changes a field, ``…=None`` takes it out."""
        document = copy.deepcopy(SHEET)
        for path, value in changes.items():
            *tables, field = path.split("__")
            table = document
            for name in tables:
                table = table.setdefault(name, {})
            if value is None:
                del table[field]
            else:
                table[field] = value
        (self.folder / "axis.toml").write_text(_toml(document), encoding="utf-8")
        return self.folder / "axis.toml"

    def read(self, **changes: Any) -> DataSheet:
        return read_axis(self.write(**changes))


@pytest.fixture
def sheets(tmp_path: Path) -> Sheets:
    return Sheets(tmp_path)


def _axis(
    name: str, nominal: float, root: float, lead: float, length: float, zero: float, k: float, ca: float,
    bearing: float, nut: float, inertia: float, table: float,
) -> DataSheet:  # fmt: skip
    return DataSheet(
        name=name,
        support="fixed-free",
        screw=Screw(
            lead=lead * 1e-3,
            root_diameter=root * 1e-3,
            nominal_diameter=nominal * 1e-3,
            length=length,
            bearing_to_zero=zero,
            dynamic_load_rating=ca * 1e3,
            rigidity=k * 1e6,
            rigidity_preload_ratio=0.1,
            preload_ratio=0.04,
        ),
        bearing=Bearing(bearing * 1e6),
        table=Table(table + nut),
        drive=Drive(inertia),
        guide=Guide(0.0),
    )


@pytest.fixture(scope="session")
def axes() -> dict[str, DataSheet]:
    """S 16×5, M 25×10 and L 40×20."""
    return {
        "S": _axis("S", 16, 13.2, 5, 0.60, 0.08, 230, 9, 100, 0.6, 2.2e-5, 12),
        "M": _axis("M", 25, 21.4, 10, 0.90, 0.12, 450, 17, 180, 1.5, 3.0e-4, 100),
        "L": _axis("L", 40, 34.4, 20, 1.10, 0.15, 800, 40, 400, 4.0, 3.3e-3, 150),
    }
