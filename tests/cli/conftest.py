"""A small run on disk: two synthetic round trips and the four TOML files."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.recording.synthetic import synthetic_trip, write_trip

from ballscrew import Run, analyze
from ballscrew.cli.shell import run
from ballscrew.modal.joint.result import JointResult

RATE = 6400.0
FILES = {
    "axis.toml": """
name = "synthetic"
support = "fixed-free"
screw = { lead = "10 mm", root_diameter = "17.6 mm", length = "650 mm", bearing_to_zero = "80 mm", \
dynamic_load_rating = "15 kN", rigidity = "480 N/um", rigidity_preload_ratio = 0.1, preload_ratio = 0.04 }
bearing.stiffness = "160 N/um"
table.mass = "32 kg"
drive.rotor_inertia = "4.2e-4 kg m^2"
guide.friction = "25 N"
""",
    "plan.toml": """
positions = { start = "0 mm", stop = "150 mm", step = "30 mm" }
repetitions = 2
masses = ["100 kg"]
motion = { speed = "150 mm/s", acceleration = "2.5 m/s^2", jerk = "1500 m/s^3", dwell = "200 ms" }
""",
    "channels.toml": """
[[channel]]
source = "torque"
quantity = "torque"
unit = "N m"
[[channel]]
source = "position"
quantity = "position"
unit = "m"
[[channel]]
source = "acc1_x"
quantity = "acceleration"
unit = "m/s^2"
location = "nut-1"
axis = "x"
""",
    "run.toml": """
axis = "axis.toml"
plan = "plan.toml"
channels = "channels.toml"
load = "100 kg"
measured_at = 2026-01-31T08:00:00Z
temperature = "21 degC"
files = ["trip1.h5", "trip2.h5"]
""",
}


@pytest.fixture(scope="session")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder; nothing in it is changed."""
    folder = tmp_path_factory.mktemp("rig")
    for name, text in FILES.items():
        (folder / name).write_text(text, encoding="utf-8")
    for index in (1, 2):
        write_trip(folder / f"trip{index}.h5", synthetic_trip(rate=RATE, seed=index), RATE)
    bad = synthetic_trip(rate=RATE, seed=3)
    bad["torque"][2000:2010] = np.nan
    write_trip(folder / "bad.h5", bad, RATE)
    return folder


@pytest.fixture(scope="session")
def result(rig: Path, joint_fit: Callable[..., JointResult]) -> Run:
    """Run of that folder, analysed by the default method."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr("ballscrew.modal.joint.analysis.identify_jointly", joint_fit)
        return analyze(rig / "run.toml")


@dataclass(frozen=True)
class Outcome:
    """Exit status and output of a command."""

    status: int
    out: str
    err: str

    @property
    def document(self) -> dict[str, Any]:
        return json.loads(self.out)


@pytest.fixture
def ballscrew(capsys: pytest.CaptureFixture[str]) -> Callable[..., Outcome]:
    """Runs a command in this process: ``ballscrew("quality", "trip.h5")``."""

    def call(*arguments: object) -> Outcome:
        capsys.readouterr()
        status = run([str(argument) for argument in arguments])
        return Outcome(status, *capsys.readouterr())

    return call


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A data sheet and a plan in a folder that a test may change."""
    for name in ("axis.toml", "plan.toml"):
        (tmp_path / name).write_text(FILES[name], encoding="utf-8")
    return tmp_path


@pytest.fixture
def say(
    ballscrew: Callable[..., Outcome], folder: Path, monkeypatch: pytest.MonkeyPatch
) -> Callable[..., Outcome]:
    """Runs ``ballscrew plan`` in that folder."""
    monkeypatch.chdir(folder)
    return lambda *arguments: ballscrew("plan", *arguments)
