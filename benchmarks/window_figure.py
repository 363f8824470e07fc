"""Picture of the effect of the window, for one cell of the bench.

python -m benchmarks.window_figure docs/_static/window.png [--data ../shared/data]
"""

from __future__ import annotations

import argparse
import json
import os
from pathlib import Path

import matplotlib as mpl
import numpy as np

from ballscrew.axis.frequency import predicted_frequency
from ballscrew.axis.sheet_file import read_axis
from ballscrew.fcft.conditions import Condition
from ballscrew.fcft.plan import read_plan
from ballscrew.modal.paper.lines import Lines, magnitude
from ballscrew.modal.paper.settings import PaperSettings
from ballscrew.modal.paper.window import AFTER, BEFORE, blow, tapered
from ballscrew.recording.channels import read_channels
from ballscrew.recording.measure import measure
from ballscrew.report.canvas import RC, STAR
from benchmarks.windows import one_blow, whole_phase

POSITION, CONDITION, LENGTH = 0.135, Condition.PA, 0.120


def main() -> None:
    """Draw the figure."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("target", type=Path)
    parser.add_argument("--data", type=Path, default=Path(os.environ.get("BALLSCREW_DATA", "../shared/data")))
    given = parser.parse_args()
    bench = given.data / "bench"
    sheet = read_axis(bench / "axis.toml")
    state = "preload-4-percent"
    files = [bench / f"{state}-trip{trip}.h5" for trip in (1, 2, 3)]
    channels, plan = read_channels(bench / "channels.toml"), read_plan(bench / "plan.toml")
    transients = measure(files, channels, sheet=sheet, plan=plan, mass=100.0).transients
    assert transients is not None
    truth = json.loads((bench / "truth.json").read_text())[state]["axial_natural_frequency_Hz"]
    here = np.isclose(transients["position_m"], POSITION) & (transients["condition"] == CONDITION)
    cell = transients.isel(transient=np.flatnonzero(here))
    rate = float(cell.attrs["sample_rate"])
    expected = float(predicted_frequency(sheet, POSITION, 100.0))
    grid = np.arange(20.0, 260.0, 0.2)
    mpl.use("Agg")
    from matplotlib import pyplot as plt

    with plt.rc_context(RC):
        figure, (time, torque, response) = plt.subplots(1, 3, figsize=(13, 4.2), layout="constrained")
        at = int(blow(cell, CONDITION)[0])
        t = (np.arange(cell.sizes["sample"]) - at) / rate * 1e3
        shown = slice(0, int(cell["length"].values[0]))
        time.plot(t[shown], cell["input"].values[0][shown], color="0.55", lw=0.9)
        for name, colour, window in (
            (f"both jerk phases ({LENGTH * 1e3:.0f} ms)", "#D55E00", whole_phase(LENGTH)),
            ("one jerk phase (as in analyze)", "#0072B2", one_blow(BEFORE, AFTER)),
        ):
            extent = window(cell, CONDITION, expected)
            size = extent.before + extent.after
            hann = 0.5 - 0.5 * np.cos(2 * np.pi * np.arange(size) / size)
            time.plot(
                (np.arange(size) - extent.before) / rate * 1e3, 1.8 * hann, color=colour, lw=1.8, label=name
            )
            lines = Lines.of(*tapered(cell, CONDITION, extent), rate, grid)
            torque.semilogy(grid, np.sqrt(lines.averages().uu) * 1e3, color=colour)
            curve = magnitude(lines, PaperSettings())
            response.semilogy(grid, curve, color=colour)
            band = np.abs(grid / expected - 1) <= 0.25
            top = int(np.flatnonzero(band)[np.argmax(curve[band])])
            response.plot([grid[top]], [curve[top]], linestyle="none", **STAR)
        true = truth[f"{POSITION:.3f}"]
        response.axvline(true, color="black", lw=1, ls=":", label=f"true {true:.1f} Hz")
        response.legend(loc="upper left", fontsize=8)
        time.set(
            title="Torque and two windows",
            xlabel="time from the first jerk phase (ms)",
            ylabel="torque (N m)",
        )
        time.set_xlim(-90, 160)
        time.set_ylim(-0.45, 2.35)
        time.legend(loc="upper right", fontsize=8)
        torque.set(title="Torque spectrum", xlabel="frequency (Hz)", ylabel="magnitude (mN m s)")
        response.set(title="FRF and its peak (star)", xlabel="frequency (Hz)", ylabel="|FRF| (m/s² per N m)")
        figure.savefig(given.target, dpi=120)


if __name__ == "__main__":
    main()
