"""Accuracy that the default method must reach on third-party recordings."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from statistics import median

import numpy as np
import pytest
from tests.conftest import BENCH_STATES, BenchRun

from ballscrew import Run, analyze
from ballscrew.axis.sheet import Bearing, DataSheet
from ballscrew.axis.sheet_file import read_axis

# Factors of K and of the bearing's stiffness; states, for a wrong sheet the one from which it is farthest.
SHEETS = {
    "as it is": (1.0, 1.0, BENCH_STATES),
    "both softer": (0.75, 0.75, BENCH_STATES[:1]),
    "both stiffer": (1.25, 1.25, BENCH_STATES[1:]),
}


def off(sheet: DataSheet, nut: float, bearing: float) -> DataSheet:
    return replace(
        sheet,
        screw=replace(sheet.screw, rigidity=nut * sheet.screw.rigidity),
        bearing=Bearing(bearing * sheet.bearing.stiffness),
    )


def analysed(bench: Path, state: str, sheet: DataSheet, response: str = "both") -> Run:
    return analyze(
        sorted(bench.glob(f"{state}-trip*.h5")),
        channels=bench / "channels.toml",
        axis=sheet,
        plan=bench / "plan.toml",
        mass="100 kg",
        response=response,  # type: ignore[arg-type]
    )


@pytest.fixture(scope="module")
def truth(bench: Path) -> dict[str, dict[str, dict[str, float]]]:
    found: dict[str, dict[str, dict[str, float]]] = json.loads((bench / "truth.json").read_text())
    return found


@pytest.mark.parametrize(
    "name",
    [
        "as it is",
        pytest.param("both softer", marks=pytest.mark.slow),
        pytest.param("both stiffer", marks=pytest.mark.slow),
    ],
)  # a softer sheet: joint/test_identify.py
def test_frequencies_of_the_bench(
    bench: Path, bench_run: BenchRun, truth: dict[str, dict[str, dict[str, float]]], name: str
) -> None:
    nut, bearing, states = SHEETS[name]
    if name == "as it is":
        runs = [bench_run(state) for state in states]
    else:
        sheet = off(read_axis(bench / "axis.toml"), nut, bearing)
        runs = [analysed(bench, state, sheet) for state in states]
    pairs: list[tuple[float, float]] = []
    for state, run in zip(states, runs, strict=True):
        assert {cell.method for cell in run.cells} == {"joint"}
        true = truth[state]["axial_natural_frequency_Hz"]
        own = [
            (cell.frequency_Hz - true[f"{cell.position_m:.3f}"], cell.standard_uncertainty_Hz or 0.0)
            for cell in run.cells
            if cell.frequency_Hz is not None
        ]
        sizes = [abs(error) for error, _ in own]
        assert len(own) == 40
        assert median(sizes) <= 0.4
        assert np.quantile(sizes, 0.9) <= 1.0
        pairs += own
    assert np.mean([abs(error) <= 1.96 * u for error, u in pairs]) >= 0.85
    assert median(1.96 * u for _, u in pairs) <= 1.2


def test_the_shift_between_the_states(
    bench_run: BenchRun, truth: dict[str, dict[str, dict[str, float]]]
) -> None:
    new, worn = (bench_run(state) for state in BENCH_STATES)
    old, now = (truth[state]["axial_natural_frequency_Hz"] for state in BENCH_STATES)
    errors = []
    for cell, worn_cell in zip(new.cells, worn.cells, strict=True):
        at = f"{cell.position_m:.3f}"
        assert cell.frequency_Hz is not None
        assert worn_cell.frequency_Hz is not None
        errors.append(abs(worn_cell.frequency_Hz - cell.frequency_Hz - (now[at] - old[at])))
    assert median(errors) <= 0.25


@pytest.mark.parametrize("state", [pytest.param(BENCH_STATES[0], marks=pytest.mark.slow), BENCH_STATES[1]])
def test_torque_and_encoder_alone(
    bench: Path, truth: dict[str, dict[str, dict[str, float]]], state: str
) -> None:
    sheet = read_axis(bench / "axis.toml")
    run = analysed(bench, state, sheet, "motor")
    free = truth[state]["axial_natural_frequency_Hz"]
    errors = [abs((cell.frequency_Hz or 0.0) - free[f"{cell.position_m:.3f}"]) for cell in run.cells]
    assert median(errors) <= 1.0
    rotor_held = truth[state]["rotor_held_frequency_Hz"]
    errors = [
        abs((cell.rotor_held_frequency_Hz or 0.0) - rotor_held[f"{cell.position_m:.3f}"])
        for cell in run.cells
    ]
    assert median(errors) <= 1.0
