"""Frequencies of the bench by its phase currents in place of its torque.

python -m benchmarks.phase_currents [--data FOLDER] [--state preload-2-percent ...]

Each cell is compared with its frequency by the torque, as a part of its 95 % interval, and with the true one.
"""

from __future__ import annotations

import argparse
import json
import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import ballscrew
from ballscrew.axis.sheet import DataSheet
from ballscrew.axis.sheet_file import read_axis
from ballscrew.base.quantity import NORMAL_95
from ballscrew.base.threads import single_threaded
from ballscrew.modal.run import Run
from ballscrew.recording.channels import ChannelMap, read_channels

TORQUE_CONSTANT, POLE_PAIRS = 0.45, 4  # of the bench
INPUTS: dict[str, tuple[str, int | None]] = {
    "three currents": ("uvw", POLE_PAIRS),
    "three, pole pairs from the currents": ("uvw", None),
    "two currents": ("uv", POLE_PAIRS),
    "two, pole pairs from the currents": ("vw", None),
    "current of the q axis": ("", None),
}


def channels_of(known: ChannelMap, phases: str) -> ChannelMap:
    """Channel map of the bench with currents in place of the torque."""
    settings = known.to_settings()
    rows: list[dict[str, Any]] = [row for row in settings["channel"] if row["quantity"] != "torque"]
    current = {"quantity": "current", "unit": "A"}
    rows += [current | {"source": f"current_{phase}", "phase": phase} for phase in phases]
    if not phases:  # as a drive would compute it
        rows.append(current | {"source": "torque", "scale": 1 / TORQUE_CONSTANT})
    return ChannelMap.from_settings({**settings, "channel": rows})


def measured(folder: Path, state: str, channels: ChannelMap, sheet: DataSheet) -> Run:
    """Run of a state of the bench."""
    files = sorted(folder.glob(f"{state}-trip*.h5"))
    return ballscrew.analyze(files, channels=channels, axis=sheet, plan=folder / "plan.toml", mass="100 kg")


def row_of(name: str, run: Run, torque: Run, truth: dict[str, float]) -> str:
    """Row of the table: differences of the cells that both runs have."""
    ratios, outside = [], 0
    for cell, other in zip(run.cells, torque.cells, strict=True):
        f, u, by_torque = cell.frequency_Hz, cell.standard_uncertainty_Hz, other.frequency_Hz
        if f is None or u is None or by_torque is None:
            continue
        ratios.append(abs(f - by_torque) / (NORMAL_95 * u))
        outside += abs(f - truth[f"{cell.position_m:.3f}"]) > NORMAL_95 * u
    return (
        f"| {name} | {run.quality.verdict} | {len(ratios)} | {np.median(ratios):.2f} | {max(ratios):.2f} "
        f"| {outside} |"
    )


@single_threaded
def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    folder = Path(os.environ.get("BALLSCREW_DATA", "../shared/data")) / "bench"
    parser.add_argument("--data", type=Path, default=folder)
    parser.add_argument("--state", nargs="+", default=["preload-4-percent", "preload-2-percent"])
    options = parser.parse_args()
    known, sheet = read_channels(options.data / "channels.toml"), read_axis(options.data / "axis.toml")
    true = json.loads((options.data / "truth.json").read_text(encoding="utf-8"))
    for state in options.state:
        truth = true[state]["axial_natural_frequency_Hz"]
        torque = measured(options.data, state, known, sheet)
        print(f"\n{state}\n")
        print("| input | verdict | cells | difference / interval, median | highest | true value outside |")
        print("|---|---|---|---|---|---|")
        print(row_of("torque", torque, torque, truth), flush=True)
        for name, (phases, pole_pairs) in INPUTS.items():
            drive = replace(sheet.drive, torque_constant=TORQUE_CONSTANT, pole_pairs=pole_pairs)
            run = measured(options.data, state, channels_of(known, phases), replace(sheet, drive=drive))
            print(row_of(name, run, torque, truth), flush=True)


if __name__ == "__main__":
    main()
