"""The figures of the paper, each from what was measured on our bench."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ballscrew.axis.sheet import DataSheet
from ballscrew.fcft.conditions import Condition
from ballscrew.modal.run import Run, TransientRow
from ballscrew.modal.window import AFTER, BEFORE
from ballscrew.recording.channels import read_channels
from ballscrew.recording.kinematics import kinematics
from ballscrew.recording.load import read_recording
from ballscrew.recording.lost_motion import LostMotion
from ballscrew.recording.recording import Recording
from ballscrew.report.all_cells_figure import draw_all_cells
from ballscrew.report.axis_figures import draw_theory
from ballscrew.report.backlash_figure import draw_backlash
from ballscrew.report.calibration_figure import draw_calibration
from ballscrew.report.canvas import save_figure
from ballscrew.report.comparison_figure import draw_against_load, draw_against_position
from ballscrew.report.degradation_figure import draw_degradation
from ballscrew.report.frf_figure import draw_frf
from ballscrew.report.levels_figure import draw_levels
from ballscrew.report.monitor_figure import draw_monitor
from ballscrew.report.segments_figure import Segment, draw_segments
from ballscrew.report.shift_figure import draw_shift
from ballscrew.reproduction.preload import calibrated
from ballscrew.reproduction.results import Experiments, at, first_backlash, told, truth_by_place
from ballscrew.reproduction.watched import alarm, watched
from ballscrew.testbed.experiments import GONE
from ballscrew.testbed.run import RunFiles

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["CELLS", "Segments", "draw_figures", "segments_of"]

CELLS = ((0.0, "PA"), (0.0, "ND"), (0.09, "ND"), (0.225, "PD"), (0.45, "NA"))
"""Position, m, and condition of the cells whose FRFs are drawn."""

_SHIFTED = ((0.0, "PA"), (0.09, "ND"), (0.225, "PD"), (0.45, "NA"))
_STOP = 0.225  # m, at which Fig. 12 is drawn: amid the places where the bench jitters
_AROUND = 0.12  # s before and after a phase that are shown
_DAY = 86400.0
_FORMATS = ("png", "svg")
_FALLS = (1.0, 5.0, 10.0, 20.0)


@dataclass(frozen=True, slots=True, eq=False)
class Segments:
    """A departure and an arrival, as Fig. 5 shows them."""

    pa: Segment
    nd: Segment


def segments_of(run: Run, files: RunFiles) -> Segments:
    """Cut one PA and one ND out of the first recording of a run.

    Parameters
    ----------
    run : Run
        Says where they lie.
    files : RunFiles
        Its recordings and channel map.

    Returns
    -------
    Segments
        At 0 mm.
    """
    recording = read_recording(files.recordings[0], read_channels(files.run.parent / "channels.toml"))
    period = 1 / np.mean([cell.frequency_Hz for cell in run.cells if cell.frequency_Hz is not None])
    rows = {
        row.condition: row
        for row in run.transients
        if row.file == 0 and row.position_m == 0 and row.repetition
    }
    return Segments(*(_segment(recording, rows[name], float(period)) for name in ("PA", "ND")))


def draw_figures(
    found: Experiments,
    segments: Segments,
    folder: Path,
    *,
    progress: Callable[[int, int, str], None] | None = None,
) -> tuple[tuple[str, str], ...]:
    """Draw all figures, each as PNG and SVG.

    Parameters
    ----------
    found : Experiments
        Both experiments.
    segments : Segments
        For Fig. 5.
    folder : path-like
        Where they go; made where it is not there.
    progress : callable, optional
        Called with how many are done, how many there are, and the next one's name.

    Returns
    -------
    tuple of (str, str)
        Of each PNG its path from the report, and its caption.
    """
    folder.mkdir(parents=True, exist_ok=True)
    drawn = []
    figures = _figures(found, segments)
    for index, (name, caption, draw) in enumerate(figures):
        if progress is not None:
            progress(index, len(figures), name)
        figure = draw()
        for ending in _FORMATS:
            save_figure(figure, folder / f"{name}.{ending}")
        drawn.append((f"{folder.name}/{name}.png", caption))
    return tuple(drawn)


def _figures(found: Experiments, segments: Segments) -> Sequence[tuple[str, str, Callable[[], Figure]]]:
    sheet, life = found.sheet, found.life
    days = [one.planned.day for one in life]
    runs = [one.run for one in life]
    loads = {one.planned.load: one.run for one in found.masses}
    by_load = {one.planned.load: truth_by_place(one) for one in found.masses}
    lightest = found.masses[0]
    travel = lightest.planned.plan.positions[0], lightest.planned.plan.positions[-1]
    end = first_backlash(life)
    length = days[-1] + days[1] - days[0]
    truths = [truth_by_place(one) for one in life]
    unloaded = truth_by_place(lightest)
    near = {load: _near(truth, 0.0) for load, truth in by_load.items()}
    ratios = (0.04, 0.03, 0.02, 0.01, 0.005)
    return (
        ("figure-01", "Fig. 1: loss of preload by two wear laws, 100 kg, 0 mm; our bench wears locally.",
         lambda: _degradation(sheet, length)),
        ("figure-02", "Fig. 2: natural frequency against position, for preload and load (theory).",
         lambda: draw_theory(sheet, preload_ratios=ratios, loads=sorted(loads), travel=travel)),
        ("figure-03", "Fig. 3: the natural frequency in a frequency response: 100 kg, 0 mm, day 0.",
         lambda: draw_frf(runs[0], *CELLS[0], truth=at(truths[0], CELLS[0][0]))),
        ("figure-05", "Fig. 5: speed, torque and acceleration of a departure and an arrival.",
         lambda: draw_segments(segments.pa, segments.nd)),
        ("figure-08", "Fig. 8: frequency responses under several loads, ND, at 0 and 90 mm.",
         lambda: draw_levels(loads, truths=by_load)),
        ("figure-09", "Fig. 9: natural frequency against position without load, measured and by theory.",
         lambda: draw_against_position(lightest.run, sheet, truth=unloaded)),
        ("figure-10", "Fig. 10: natural frequency against load at 0 mm, measured and by theory.",
         lambda: draw_against_load(loads, sheet, 0.0, truth=near)),
        ("figure-09-10", "Figs. 9 and 10 with calibrated theory, and what it leaves.",
         lambda: draw_calibration(calibrated(found), [one.run for one in found.masses])),
        ("figure-11", "Fig. 11: frequency responses over the life, and the natural frequency in them.",
         lambda: draw_shift(days, runs, _SHIFTED, truths=truths, backlash_day=end)),
        ("figure-11-cells", "Fig. 11 for every cell: change of the natural frequency since day 0.",
         lambda: draw_all_cells(days, runs, backlash_day=end)),
        ("figure-12", "Fig. 12: natural frequency, and lost motion beside the true backlash.",
         lambda: _backlash(found)),
        ("figure-12-monitor", "The same life as ballscrew monitor tells it.",
         lambda: draw_monitor(watched(found))),
    )  # fmt: skip


def _degradation(sheet: DataSheet, days: float) -> Figure:
    return draw_degradation(
        sheet, preload_gone=GONE * days * _DAY, end=1.2 * days * _DAY, position=0.0, load=100.0, falls=_FALLS,
        backlash=0.4e-6,
    )  # fmt: skip


def _backlash(found: Experiments) -> Figure:
    """Fig. 12 at one stop: mean of its conditions, and what a scale shows at a reversal."""
    life = found.life
    frequency: list[float | None] = []
    uncertainty: list[float | None] = []
    for one in life:
        cells = [cell for (place, _), cell in told(one.run).items() if abs(place - _STOP) < 1e-6]
        if not cells:
            frequency.append(None)
            uncertainty.append(None)
            continue
        frequency.append(
            float(np.mean([cell.frequency_Hz for cell in cells if cell.frequency_Hz is not None]))
        )
        # The method's own error is common to the four; their scatter is not used, as they are few.
        uncertainty.append(max(cell.standard_uncertainty_Hz or 0.0 for cell in cells))
    first = alarm(found)
    lost = [_lost_at(one.run.lost_motion, _STOP) for one in life]
    return draw_backlash(
        [one.planned.day for one in life],
        frequency,
        uncertainty,
        [each[0] for each in lost],
        [each[1] for each in lost],
        backlash_day=first_backlash(life),
        alarm_day=None if first is None else first.day,
        truth=[_near(truth_by_place(one), _STOP) for one in life],
        true_backlash=[_near(truth_by_place(one, "local_backlash_m"), _STOP) for one in life],
        cell=f"{1e3 * _STOP:g} mm, mean of the conditions that are told",
        what="lost motion at a reversal",
    )


def _near(table: Mapping[float, float], place: float) -> float:
    return next((value for known, value in table.items() if abs(known - place) < 1e-6), float("nan"))


def _lost_at(lost: Sequence[LostMotion], place: float) -> tuple[float, float]:
    found = (each for each in lost if abs(each.position_m - place) < 1e-6)
    one = next(found, None)
    return (float("nan"), float("nan")) if one is None else (one.lost_m, one.standard_uncertainty_m)


def _segment(recording: Recording, row: TransientRow, period: float) -> Segment:
    position, torque = recording.of("position")[0], recording.of("torque")[0]
    acceleration = recording.of("acceleration")[0]
    rate = recording.rate(torque)
    motion = kinematics(recording.array(position), rate)
    first = max(0, round((row.start_s - _AROUND) * rate))
    part = slice(first, round((row.stop_s + _AROUND) * rate))
    time = np.arange(len(motion.speed))[part] / rate - row.start_s
    length = row.stop_s - row.start_s
    blow = 0.0 if Condition(row.condition).accelerating else length
    before, after = BEFORE * period, AFTER * period
    if Condition(row.condition).accelerating:
        after = min(after, length)
    else:
        before = min(before, length)
    return Segment(
        time=time,
        speed=motion.speed[part],
        torque=recording.array(torque)[part],
        acceleration=recording.array(acceleration)[part],
        start=0.0,
        stop=length,
        window=(max(blow - before, float(time[0])), min(blow + after, float(time[-1]))),
    )
