"""Plans and an axis for them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from ballscrew.axis.sheet import Bearing, DataSheet, Drive, Guide, Screw, Table
from ballscrew.fcft.plan import Plan, read_plan

PLAN = """
positions = { start = "0 mm", stop = "450 mm", step = "45 mm" }
repetitions = 3
masses = ["100 kg"]

[motion]
speed = "150 mm/s"
acceleration = "2.5 m/s^2"
jerk = "1500 m/s^3"
dwell = "350 ms"
"""


@pytest.fixture
def read(tmp_path: Path) -> Callable[..., Plan]:
    """Reads the plan with pieces of its text replaced: ``read(("old", "new"), …)``."""

    def reader(*changes: tuple[str, str]) -> Plan:
        text = PLAN
        for old, new in changes:
            assert old in text
            text = text.replace(old, new)
        (tmp_path / "plan.toml").write_text(text, encoding="utf-8")
        return read_plan(tmp_path / "plan.toml")

    return reader


@pytest.fixture
def sheet() -> DataSheet:
    return DataSheet(
        name="bench",
        support="fixed-free",
        screw=Screw(0.01, 0.0176, 0.0176, 0.65, 0.08, 15e3, 480e6, 0.1, 0.04),
        bearing=Bearing(160e6),
        table=Table(32.0),
        drive=Drive(4.2e-4),
        guide=Guide(25.0),
        source="axis.toml",
    )
