"""Pictures of the page *How to read an FRF of an axis*, and its quotations of the program.

Usage: python -m docs.gallery [--method METHOD] [--only NAME] [--dry-run]

Each entry is three round trips of the testbed with one fault injected, and one cell of the result of
`ballscrew.analyze`. Written are docs/_static/gallery-*.png, and in docs/howto/read-frf.md the
quotations and the table; with --dry-run they are only printed. Check the sentences around them afterwards.
"""

from __future__ import annotations

import argparse
import re
import sys
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import h5py
import numpy as np
from benchmarks.fault_injection import RecordedTrips, inject
from scipy.signal import decimate

import ballscrew
from ballscrew.fcft.plan import Motion
from ballscrew.modal.cell import CellResult
from ballscrew.modal.run import Run
from ballscrew.report.canvas import CONDITION_COLOURS, blank, draw_star, save_figure, styled
from ballscrew.report.frf_figure import draw_phase
from ballscrew.report.measured import COVERAGE, TRUE, Response, cell_of, plain_numbers, response_of, true_at
from ballscrew.testbed.example import LOAD, PLAN, example_rig
from ballscrew.testbed.run import simulate_run, truth
from ballscrew.testbed.trip import Rig

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DOCS = Path(__file__).parent
PAGE = DOCS / "howto" / "read-frf.md"
STOPS = (0.0, 0.135, 0.270, 0.405)
SHOWN = (60.0, 320.0)  # Hz
SENSORS = ("#56B4E9", "#E69F00")
NEW = example_rig()
GOOD = {"color": "0.55", "lw": 1.0, "zorder": 1.5}

Change = Callable[[RecordedTrips, np.random.Generator], RecordedTrips]


@dataclass(frozen=True)
class Entry:
    """One picture of the gallery.

    Parameters
    ----------
    name : str
        Name of the file.
    title : str
        Heading on the page.
    rig : Rig
        Simulated machine and its instruments.
    motion : Motion
        Motion of the test.
    change : callable, optional
        Change of the recordings.
    position : float
        Position of the cell shown, m.
    condition : str
        Condition of the cell shown.
    """

    name: str
    title: str
    rig: Rig = NEW
    motion: Motion = PLAN.motions[0]
    change: Change | None = None
    position: float = 0.135
    condition: str = "PD"

    @property
    def plan(self) -> Any:
        """The test."""
        return replace(PLAN, positions=STOPS, motions=(self.motion,))

    @property
    def truth(self) -> dict[float, float]:
        """True frequencies at rest by position, Hz; a nut without preload has none."""
        known: Any = truth(self.rig, self.plan, LOAD)["axial_natural_frequency_Hz"]
        return {float(x): f for x, f in known.items()}

    @property
    def true(self) -> float | None:
        """True frequency at the cell shown, Hz."""
        return true_at(self.truth, self.position)


def fault(name: str, strength: float) -> Change:
    """Injection of a fault of the catalogue."""
    return lambda recorded, random: inject(name, recorded, strength, random)


def slower(factor: int) -> Change:
    """Lower sample rate by a whole factor, with an anti-alias filter."""

    def change(recorded: RecordedTrips, _: np.random.Generator) -> RecordedTrips:
        trips = []
        for trip in recorded.trips:
            for part in (8, factor // 8):
                trip = {name: decimate(x, part, ftype="fir") for name, x in trip.items()}
            trips.append(trip)
        return RecordedTrips(tuple(trips), recorded.rate / factor)

    return change


def instruments(**changed: Any) -> Rig:
    """Example axis with other instruments."""
    return replace(NEW, instruments=replace(NEW.instruments, **changed))


def moved(**changed: float) -> Motion:
    """Motion of the example with some values replaced."""
    return replace(PLAN.motions[0], **changed)


_PERIOD = 1 / 175.5  # of the mode of the cell shown, s

ENTRIES: Mapping[str, Entry] = {
    entry.name: entry
    for entry in (
        Entry("good", "Good measurement"),
        Entry("null", "Torque null at the mode", motion=moved(jerk=2.0 / _PERIOD)),
        Entry("soft", "Too little jerk", motion=moved(acceleration=0.5, jerk=0.5 / (2.5 * _PERIOD))),
        Entry("noise", "Noise", rig=instruments(acceleration_noise=0.6, torque_noise=0.05)),
        Entry("hum", "Mains hum", change=fault("50 Hz hum on torque", 0.3)),
        Entry("pitch", "Second mode", rig=instruments(pitch_frequency=200.0, pitch=(0.15, -0.1))),
        Entry("loose", "Loose sensor", change=fault("loose sensor", 205.0)),
        Entry("slow", "Sample rate too low", change=slower(32)),
        Entry("late", "Delayed torque", change=fault("torque late", 2e-3)),
        Entry("rate", "Wrong sample rate", change=fault("wrong declared rate", 0.01)),
        Entry("loaded", "Loaded nut", rig=example_rig(145.0), condition="PA"),
        Entry("unloaded", "Nut with one flank unloaded", rig=example_rig(60.0), condition="PA"),
        Entry("backlash", "Nut with backlash", rig=example_rig(0.0, 15e-6)),
    )
}


def analysed(entry: Entry, method: str | None = None) -> Run:
    """Simulate an entry and analyse it, by the default method unless another is given."""
    with TemporaryDirectory() as folder:
        when = "2026-01-31T08:00Z"
        files = simulate_run(entry.rig, entry.plan, LOAD, Path(folder), seed=5, measured_at=when, workers=1)
        if entry.change is not None:
            _inject_fault(files.recordings, entry.rig.sample_rate, entry.change)
        chosen: dict[str, Any] = {} if method is None else {"method": method}
        return ballscrew.analyze(files.run, **chosen)


def _inject_fault(paths: tuple[Path, ...], rate: float, change: Change) -> None:
    trips, units = [], {}
    for path in paths:
        with h5py.File(path) as file:
            trips.append({name: data[:].astype(np.float64) for name, data in file.items()})
            units = {name: data.attrs["unit"] for name, data in file.items()}
    recorded = change(RecordedTrips(tuple(trips), rate), np.random.default_rng(0))
    for path, trip in zip(paths, recorded.trips, strict=True):
        with h5py.File(path, "r+") as file:
            file.clear()
            file.attrs["sample_rate"] = recorded.rate
            for name, values in trip.items():
                file.create_dataset(name, data=values).attrs["unit"] = units[name]


def quotation(entry: Entry, run: Run) -> list[str]:
    """Verdicts of the program, a line each; of a cell the first two reasons."""
    cell = cell_of(run, entry.position, entry.condition)
    lines = [_sentence("Measurement", run.quality.verdict, run.quality.reasons)]
    if cell is not None:
        what = f"Cell at {1e3 * entry.position:g} mm, {entry.condition}"
        number = () if cell.frequency_Hz is None else (estimate(entry, run),)
        lines.append(_sentence(what, cell.verdict, (*number, *cell.reasons[:2])))
    return lines


def _sentence(what: str, verdict: str, reasons: tuple[str, ...]) -> str:
    sentence = "; ".join([f"**{what}: {verdict}**", *reasons])
    return sentence if sentence.endswith("?") else f"{sentence}."


def estimate(entry: Entry, run: Run) -> str:
    """Frequency with its 95 % interval; a dash if the cell was refused."""
    cell = cell_of(run, entry.position, entry.condition)
    if cell is None or cell.frequency_Hz is None:
        return "–"
    return f"{cell.frequency_Hz:.1f} ± {COVERAGE * (cell.standard_uncertainty_Hz or 0.0):.1f} Hz"


def row(entry: Entry, run: Run) -> str:
    """A row of the page's table."""
    verdicts = Counter(cell.verdict for cell in run.cells)
    counts = " / ".join(str(verdicts[verdict]) for verdict in ("good", "suspect", "refused"))
    estimated = [cell for cell in run.cells if cell.frequency_Hz is not None]
    inside = sum(_covers(cell, true_at(entry.truth, cell.position_m)) for cell in estimated)
    coverage = f"{inside} of {len(estimated)}" if estimated else "–"
    true = "none" if entry.true is None else f"{entry.true:.1f} Hz"
    cells = (run.quality.verdict, counts, coverage, estimate(entry, run), true)
    return f"| [{entry.title}](#{entry.title.lower().replace(' ', '-')}) | {' | '.join(cells)} |"


def _covers(cell: CellResult, true: float | None) -> bool:
    """Return whether a cell's 95 % interval contains the true value, if there is one."""
    if true is None or cell.frequency_Hz is None:
        return False
    return abs(cell.frequency_Hz - true) <= COVERAGE * (cell.standard_uncertainty_Hz or 0.0)


@styled()
def draw(entry: Entry, run: Run, good: Run) -> Figure:
    """Magnitude, phase and coherence of the cell, and those of the good entry behind them."""
    response = response_of(run, entry.position, entry.condition)
    reference = response_of(good, entry.position, entry.condition)
    cell = cell_of(run, entry.position, entry.condition)
    shown = [each for each in (reference, response) if each is not None]
    top = max(float(each.magnitude[each.within(*SHOWN)].max()) for each in shown)
    figure = blank(6, 5)
    axes = figure.subplots(3, 1, sharex=True, height_ratios=(2.4, 1, 0.8))
    if reference is not None and entry.name != "good":
        _reference(axes, reference)
    if response is not None:
        _curves(axes, response, CONDITION_COLOURS[entry.condition])
    else:
        axes[0].text(0.5, 0.1, "no FRF", transform=axes[0].transAxes, ha="center", color="0.3")
    if entry.true is not None:
        for each in axes:
            each.axvline(entry.true, label=f"true {entry.true:.1f} Hz", ls="--", **TRUE)
    if cell is not None and cell.frequency_Hz is not None and response is not None:
        label = f"estimate {estimate(entry, run)}"
        draw_star(axes[0], cell.frequency_Hz, response.at(cell.frequency_Hz), 13, label)
    axes[0].set(ylabel="|FRF| (m/s² per N m)", xlim=SHOWN, ylim=(top / 300, 1.5 * top))
    axes[0].set_title(entry.title, loc="left")
    if cell is not None:
        axes[0].set_title(cell.verdict, loc="right", fontweight="normal")
    axes[1].set(ylim=(-190, 190), yticks=(-180, -90, 0, 90, 180), ylabel="phase (°)")
    axes[2].set(ylim=(0, 1.05), ylabel="coherence", xlabel="frequency (Hz)")
    plain_numbers(axes[0])
    figure.align_ylabels()
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=3, fontsize=8.5)
    return figure


def _reference(axes: Any, response: Response) -> None:
    """Draw the good entry: mean of its sensors, phase and coherence of the first."""
    shown = response.within(*SHOWN)
    f = response.frequency[shown]
    axes[0].semilogy(f, response.magnitude[shown], label="good cell", **GOOD)
    draw_phase(axes[1], f, response.each[0, shown], **GOOD)
    axes[2].plot(f, response.coherence[0, shown], **GOOD)


def _curves(axes: Any, response: Response, colour: str) -> None:
    """Draw each sensor of a cell, and the mean of both."""
    shown = response.within(*SHOWN)
    f = response.frequency[shown]
    for index, name in enumerate(response.names):
        look: Any = {"color": SENSORS[index % 2], "lw": 1.1, "ls": ("-", (0, (4, 1.5)))[index % 2]}
        axes[0].semilogy(f, np.abs(response.each[index, shown]), label=name, **look)
        draw_phase(axes[1], f, response.each[index, shown], **look)
        axes[2].plot(f, response.coherence[index, shown], **look)
    axes[0].semilogy(f, response.magnitude[shown], color=colour, lw=1.9, label="both")


def quoted(lines: list[str]) -> str:
    """Markdown quotation of lines, a paragraph each."""
    return "\n>\n".join(f"> {line}" for line in lines)


def written(text: str, quotations: Mapping[str, list[str]], rows: Mapping[str, str]) -> str:
    """The page with its quotations and rows replaced."""
    for name, lines in quotations.items():
        title = re.escape(ENTRIES[name].title)
        within = r"(?:(?!^## ).)*?"
        pattern = rf"(?s:(?<=^## {title}\n)({within})^>{within}(?=\n\n[^>]))"
        text = _once(pattern, r"\1" + _plain(quoted(lines)), text)
        text = _once(rf"^\| \[{title}\]\(.*$", _plain(rows[name]), text)
    return text


def _plain(text: str) -> str:
    return text.replace("\\", r"\\")


def _once(pattern: str, new: str, text: str) -> str:
    changed, count = re.subn(pattern, new, text, flags=re.M)
    if count != 1:
        raise ValueError(f"{PAGE.name} has {count} places for {pattern}, not one")
    return changed


def main(method: str | None, only: list[str], dry_run: bool) -> None:
    """Draw the pictures and write the page."""
    good = analysed(ENTRIES["good"], method)
    quotations, rows = {}, {}
    for name in only or list(ENTRIES):
        entry = ENTRIES[name]
        run = good if name == "good" else analysed(entry, method)
        quotations[name], rows[name] = quotation(entry, run), row(entry, run)
        sys.stdout.write("\n".join((rows[name], *quotations[name], "\n")))
        if not dry_run:
            save_figure(draw(entry, run, good), DOCS / "_static" / f"gallery-{name}.png")
    if not dry_run:
        text = written(PAGE.read_text(encoding="utf-8"), quotations, rows)
        PAGE.write_text(text, encoding="utf-8", newline="\n")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--method", help="of ballscrew.analyze; by default its own default")
    parser.add_argument("--only", action="append", default=[], choices=list(ENTRIES), help="this entry")
    parser.add_argument("--dry-run", action="store_true", help="print, and write nothing")
    given = parser.parse_args()
    main(given.method, given.only, given.dry_run)
