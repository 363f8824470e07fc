"""What the window decides: the paper's method on the bench under windows of several kinds and lengths.

    python -m benchmarks.windows [--data ../shared/data]

For every window: the median and the 90th percentile of |error| in Hz against the bench's truth, departures
(PA, NA) and arrivals (PD, ND) separately, for both states. Only the peak is assessed; no cell is refused.
"""

from __future__ import annotations

import argparse
import json
import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import xarray as xr

from ballscrew.axis.frequency import predicted_frequency
from ballscrew.axis.sheet import DataSheet
from ballscrew.axis.sheet_file import read_axis
from ballscrew.fcft.conditions import Condition
from ballscrew.fcft.plan import read_plan
from ballscrew.modal.paper.lines import Lines, magnitude
from ballscrew.modal.paper.peak import first_peak
from ballscrew.modal.paper.settings import PaperSettings
from ballscrew.modal.paper.window import Extent, extent, tapered
from ballscrew.recording.channels import read_channels
from ballscrew.recording.measure import measure
from benchmarks.machine import heading

STATES = ("preload-4-percent", "preload-2-percent")
LENGTHS = (65, 80, 100, 120, 150, 200, 340)  # ms
Window = Callable[[xr.Dataset, Condition, float], Extent]


def whole_phase(length: float) -> Window:
    """Window of a length in s from 10 ms before the phase: what the paper's words suggest."""

    def window(cell: xr.Dataset, condition: Condition, _expected: float) -> Extent:
        rate = float(cell.attrs["sample_rate"])
        phase = 0 if condition.accelerating else int(np.median(cell["end"].values - cell["onset"].values))
        before = round(0.01 * rate) + phase
        return Extent(before, max(1, round(length * rate) - before))

    return window


def one_blow(before: float, after: float) -> Window:
    """Window of so many periods before and after the jerk phase next to standstill: what analyze uses."""
    return lambda cell, condition, expected: extent(cell, condition, 1 / expected, before=before, after=after)


def errors(
    transients: xr.Dataset,
    sheet: DataSheet,
    truth: dict[str, float],
    window: Window,
    settings: PaperSettings,
) -> dict[bool, np.ndarray]:
    """Errors of all cells, Hz, by whether the condition is a departure."""
    found: dict[bool, list[float]] = {True: [], False: []}
    for position, frequency in truth.items():
        for condition in Condition:
            here = np.isclose(transients["position_m"], float(position)) & (
                transients["condition"] == condition
            )
            cell = transients.isel(transient=np.flatnonzero(here))
            if cell.sizes["transient"] == 0:
                continue
            expected = float(predicted_frequency(sheet, float(position), 100.0))
            force, response = tapered(cell, condition, window(cell, condition, expected))
            grid = np.arange(0.75 * expected, 1.25 * expected, settings.line_spacing)
            lines = Lines.of(force, response, float(cell.attrs["sample_rate"]), grid)
            peak = first_peak(grid, magnitude(lines, settings)) if len(force) else None
            # Without any peak the reader of an FRF is left with the prediction.
            found[condition.accelerating].append((peak.frequency if peak else expected) - frequency)
    return {key: np.abs(values) for key, values in found.items()}


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--data", type=Path, default=Path(os.environ.get("BALLSCREW_DATA", "../shared/data")))
    bench = parser.parse_args().data / "bench"
    sheet, plan = read_axis(bench / "axis.toml"), read_plan(bench / "plan.toml")
    channels = read_channels(bench / "channels.toml")
    truth = json.loads((bench / "truth.json").read_text())
    runs = {}
    for state in STATES:
        files = [bench / f"{state}-trip{trip}.h5" for trip in (1, 2, 3)]
        runs[state] = measure(files, channels, sheet=sheet, plan=plan, mass=100.0).transients
    rows: list[tuple[str, Window, PaperSettings]] = [
        (f"from 10 ms before the phase, {length} ms", whole_phase(length / 1e3), PaperSettings())
        for length in LENGTHS
    ]
    rows += [
        (f"one jerk phase, {before} periods before, {after} after", one_blow(before, after), PaperSettings())
        for before, after in ((5, 12), (6, 12), (7, 9), (7, 12), (7, 16), (9, 12))
    ]
    for name, settings in (
        ("H2", PaperSettings(estimator="H2")),
        ("mean of ratios", PaperSettings(average="ratios")),
    ):
        rows.append((f"one jerk phase, 7 before, 12 after, {name}", one_blow(7, 12), settings))
        rows.append((f"from 10 ms before the phase, 150 ms, {name}", whole_phase(0.15), settings))
    print(heading("python -m benchmarks.windows"), end="\n\n")
    print("| window | 4 %: PA, NA | 4 %: PD, ND | 2 %: PA, NA | 2 %: PD, ND |\n|---|---|---|---|---|")
    for name, window, settings in rows:
        cells = []
        for state in STATES:
            transients = runs[state]
            assert transients is not None
            error = errors(transients, sheet, truth[state]["axial_natural_frequency_Hz"], window, settings)
            cells += [
                f"{np.median(error[key]):.2f} / {np.percentile(error[key], 90):.1f}" for key in (True, False)
            ]
        print(f"| {name} | {' | '.join(cells)} |")


if __name__ == "__main__":
    main()
