"""Random axes between S and L through ``analyze`` as it is: python -m benchmarks.random_axes [COUNT]."""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import numpy as np

from ballscrew.modal.analyze import analyze
from ballscrew.testbed.linear import true_frequency
from ballscrew.testbed.run import simulate_run
from ballscrew.testbed.trip import prepared
from benchmarks.axis_sampling import random_axis
from benchmarks.machine import heading

_COUNT = 20


def row(seed: int, folder: Path) -> tuple[str, list[float]]:
    """One axis: what it is, what ``analyze`` says, and by how much it errs, Hz."""
    axis = random_axis(seed)
    files = simulate_run(axis.rig, axis.plan, axis.load, folder, seed=seed, sheet=axis.data_sheet)
    run = analyze(files.run)
    c = prepared(axis.rig.machine, axis.load, axis.plan)
    errors = [
        cell.frequency_Hz - true_frequency(c, cell.position_m)
        for cell in run.cells
        if cell.frequency_Hz is not None
    ]
    screw, machine = axis.data_sheet.screw, axis.rig.machine
    off = 100 * (machine.sheet.screw.rigidity / screw.rigidity - 1)
    bearing = 100 * (machine.sheet.bearing.stiffness / axis.data_sheet.bearing.stiffness - 1)
    error = f"{np.median(np.abs(errors)):.2f}" if errors else "–"
    line = (
        f"| {seed} | {1e3 * screw.nominal_diameter:.0f} × {1e3 * screw.lead:.0f} "
        f"| {off:+.0f} %, {bearing:+.0f} % | {100 * machine.damping_ratio:.1f} % "
        f"| {axis.plan.motions[0].jerk:.0f} | {axis.rig.instruments.pitch_frequency / axis.frequency:.2f} "
        f"| {axis.frequency:.0f} | {run.quality.verdict} | {len(errors)} of {len(run.cells)} | {error} |"
    )
    return line, errors


def main(count: int) -> None:
    """Print the table."""
    print(heading("python -m benchmarks.random_axes"))
    print(
        "\n| axis | screw, mm | K, k_b off | damping | jerk, m/s³ | pitching mode | true, Hz | measurement "
        "| cells reported | median error, Hz |\n|---|---|---|---|---|---|---|---|---|---|"
    )
    every: list[float] = []
    for seed in range(count):
        with tempfile.TemporaryDirectory() as folder:
            line, errors = row(seed, Path(folder))
        every += errors
        print(line, flush=True)
    off = np.abs(every)
    print(
        f"\nOver all reported cells: median {np.median(off):.2f} Hz, "
        f"90th percentile {np.quantile(off, 0.9):.2f} Hz."
    )


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else _COUNT)
