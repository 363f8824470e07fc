from __future__ import annotations

from dataclasses import replace

import pytest

from ballscrew.axis.sheet import Limits, read_axis
from ballscrew.axis.sheetfile import axis_toml


def back(sheet, folder):
    (folder / "axis.toml").write_text(axis_toml(sheet), encoding="utf-8")
    return replace(read_axis(folder / "axis.toml"), source=sheet.source)


@pytest.mark.parametrize("name", ["S", "M", "L"])
def test_what_is_written_is_read_back(axes, tmp_path, name):
    assert back(axes[name], tmp_path) == axes[name]


def test_with_all_that_may_be_left_out(axes, tmp_path):
    sheet = axes["M"]
    full = replace(
        sheet,
        name='x "y" \\ ü',
        support="fixed-fixed",
        drive=replace(sheet.drive, coupling_stiffness=5000.0, torque_constant=0.5),
        tolerances={"rigidity": 0.1},
        limits=Limits(-0.01, 0.5, 0.3, 8.0),
    )
    assert back(full, tmp_path) == full
