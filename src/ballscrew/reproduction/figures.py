"""The figures of the paper, drawn from the measurements on the testbed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from ballscrew.axis.sheet import DataSheet
from ballscrew.base.files import Progress, ignore_progress
from ballscrew.fcft.conditions import Condition
from ballscrew.modal.cell import TransientRow
from ballscrew.modal.paper.peak import first_peak
from ballscrew.modal.paper.window import AFTER, BEFORE
from ballscrew.modal.run import Run
from ballscrew.recording.channels import read_channels
from ballscrew.recording.kinematics import kinematics
from ballscrew.recording.load import read_recording
from ballscrew.recording.lost_motion import LostMotion
from ballscrew.recording.recording import Recording
from ballscrew.report.all_cells_figure import draw_all_cells
from ballscrew.report.axis_figures import draw_theory
from ballscrew.report.backlash_figure import WornAxis, draw_backlash
from ballscrew.report.calibration_figure import draw_calibration
from ballscrew.report.canvas import Figure, save_figure
from ballscrew.report.comparison_figure import draw_against_load, draw_against_position
from ballscrew.report.degradation_figure import draw_degradation
from ballscrew.report.frf_figure import draw_frf
from ballscrew.report.levels_figure import draw_levels
from ballscrew.report.measured import response_of
from ballscrew.report.monitor_figure import draw_monitor
from ballscrew.report.segments_figure import TransientSignals, draw_segments
from ballscrew.report.shift_figure import draw_shift
from ballscrew.reproduction.preload_claims import (
    calibrate_bench,
    find_alarm,
    monitor_life,
    preload_ratios,
)
from ballscrew.reproduction.results import (
    Experiments,
    first_backlash,
    frequencies,
    reported_cells,
    true_values,
    value_at,
)
from ballscrew.testbed.experiments import GONE
from ballscrew.testbed.run import RunFiles

CELLS = ((0.0, "PA"), (0.0, "ND"), (0.09, "ND"), (0.225, "PD"), (0.45, "NA"))
"""Position, m, and condition of the cells whose FRFs are drawn."""

_SHIFTED = ((0.0, "PA"), (0.09, "ND"), (0.225, "PD"), (0.45, "NA"))
_STOP = 0.225  # m, position of Fig. 12: in the middle of the travel, where the testbed wears most
_MARGIN = 0.12  # s shown before and after a phase
_DAY = 86400.0
_FORMATS = ("png", "svg")
_RATIOS = (0.04, 0.03, 0.02, 0.01, 0.005)  # preload / Ca of Fig. 2
_FALLS = (1.0, 5.0, 10.0, 20.0)  # Hz, marked in Fig. 1


Segments = tuple[TransientSignals, TransientSignals]  # a PA and an ND transient, as Fig. 5 shows them


def segments_of(run: Run, files: RunFiles) -> Segments:
    """One PA and one ND transient at 0 mm, from the first recording of a run.

    Parameters
    ----------
    run : Run
        Analysed run, which gives the times of its transients.
    files : RunFiles
        Its recordings and channel map.

    Returns
    -------
    Segments
        A departure and an arrival.
    """
    recording = read_recording(files.recordings[0], read_channels(files.run.parent / "channels.toml"))
    period = float(1 / np.mean(list(frequencies(run).values())))
    rows: dict[str, TransientRow] = {}
    for row in run.transients:
        if row.file == 0 and row.position_m == 0 and row.repetition:
            rows[row.condition] = row
    return _segment(recording, rows["PA"], period), _segment(recording, rows["ND"], period)


def draw_figures(
    experiments: Experiments, segments: Segments, folder: Path, *, progress: Progress = ignore_progress
) -> tuple[tuple[str, str], ...]:
    """Draw all figures, each as PNG and SVG.

    Parameters
    ----------
    experiments : Experiments
        Both experiments.
    segments : Segments
        Transients of Fig. 5.
    folder : path-like
        Folder of the figures; made if absent.
    progress : callable, optional
        Called with how many are done, how many there are, and the next one's name.

    Returns
    -------
    tuple of (str, str)
        Path of each PNG, relative to the report, and its caption.
    """
    folder.mkdir(parents=True, exist_ok=True)
    pictures = []
    figures = _figures(experiments, segments)
    for index, (name, caption, draw) in enumerate(figures):
        progress(index, len(figures), name)
        figure = draw()
        for ending in _FORMATS:
            save_figure(figure, folder / f"{name}.{ending}")
        pictures.append((f"{folder.name}/{name}.png", caption))
    return tuple(pictures)


def _figures(experiments: Experiments, segments: Segments) -> Sequence[tuple[str, str, Callable[[], Figure]]]:
    """Name, caption and drawing function of each figure."""
    sheet, life, masses = experiments.sheet, experiments.life, experiments.masses
    days = [measured.planned.day for measured in life]
    runs = [measured.run for measured in life]
    truths = [true_values(measured) for measured in life]
    loads = {measured.planned.load: measured.run for measured in masses}
    true_by_load = {measured.planned.load: true_values(measured) for measured in masses}
    true_at_0 = {load: value_at(true, 0.0) for load, true in true_by_load.items()}
    stops = masses[0].planned.plan.positions
    travel = (stops[0], stops[-1])
    backlash_day = first_backlash(life)
    duration = days[-1] + days[1] - days[0]
    gentle = {measured.planned.day: measured.run for measured in experiments.gentle}
    return (
        ("figure-01", "Fig. 1: preload loss by two wear laws, 100 kg, 0 mm; the testbed wears locally.",
         lambda: _degradation(sheet, duration)),
        ("figure-02", "Fig. 2: natural frequency against position, for preload and load (theory).",
         lambda: draw_theory(sheet, preload_ratios=_RATIOS, loads=sorted(loads), travel=travel)),
        ("figure-03", "Fig. 3: natural frequency in a frequency response: 100 kg, 0 mm, day 0.",
         lambda: draw_frf(runs[0], *CELLS[0], truth=value_at(truths[0], CELLS[0][0]))),
        ("figure-05", "Fig. 5: speed, torque and acceleration of a departure and an arrival.",
         lambda: draw_segments(*segments)),
        ("figure-08", "Fig. 8: frequency responses under several loads, ND, at 0 and 90 mm.",
         lambda: draw_levels(loads, truths=true_by_load)),
        ("figure-09", "Fig. 9: natural frequency against position without load, measured and by theory.",
         lambda: draw_against_position(masses[0].run, sheet, truth=true_values(masses[0]))),
        ("figure-10", "Fig. 10: natural frequency against load at 0 mm, measured and by theory.",
         lambda: draw_against_load(loads, sheet, 0.0, truth=true_at_0)),
        ("figure-09-10", "Figs. 9 and 10 with the calibrated theory, and its residuals.",
         lambda: draw_calibration(calibrate_bench(experiments), [measured.run for measured in masses])),
        ("figure-11", "Fig. 11: frequency responses over the life, with the natural frequency.",
         lambda: draw_shift(
             days, runs, _SHIFTED, truths=truths, backlash_day=backlash_day, gentle=gentle)),
        ("figure-11-cells", "Fig. 11 for every cell: change of the natural frequency since day 0.",
         lambda: draw_all_cells(days, runs, backlash_day=backlash_day)),
        ("figure-12", "Fig. 12: natural frequency, preload, and lost motion beside the true backlash.",
         lambda: _backlash(experiments)),
        ("figure-12-monitor", "The same life as reported by ballscrew monitor.",
         lambda: draw_monitor(monitor_life(experiments))),
    )  # fmt: skip


def _degradation(sheet: DataSheet, days: float) -> Figure:
    return draw_degradation(
        sheet, preload_gone=GONE * days * _DAY, end=1.2 * days * _DAY, position=0.0, load=100.0, falls=_FALLS,
        backlash=0.4e-6,
    )  # fmt: skip


def _backlash(experiments: Experiments) -> Figure:
    """Fig. 12 at one stop: mean of its conditions, and the lost motion at a reversal; and P/P₀."""
    life = experiments.life
    modes = [_mode_at(measured.run, _STOP) for measured in life]
    lost = [_lost_motion_at(measured.run.lost_motion, _STOP) for measured in life]
    alarm = find_alarm(experiments)
    return draw_backlash(
        [measured.planned.day for measured in life],
        [frequency for frequency, _ in modes],
        [uncertainty for _, uncertainty in modes],
        [value for value, _ in lost],
        [uncertainty for _, uncertainty in lost],
        backlash_day=first_backlash(life),
        alarm_day=None if alarm is None else alarm.day,
        truth=[value_at(true_values(measured), _STOP) for measured in life],
        true_backlash=[value_at(true_values(measured, "local_backlash_m"), _STOP) for measured in life],
        cell=f"{1e3 * _STOP:g} mm, mean of the reported conditions",
        what="lost motion at a reversal",
        worn=_worn_axis(experiments),
    )


def _worn_axis(experiments: Experiments) -> WornAxis:
    """Peaks, the gentler motion and P/P₀, for Fig. 12."""
    runs = {measured.planned.day: measured.run for measured in experiments.gentle}
    gentle: list[tuple[float | None, float | None]] = []
    for measured in experiments.life:
        run = runs.get(measured.planned.day)
        gentle.append((None, None) if run is None else _mode_at(run, _STOP))
    peaks = [_peak_at(measured.run, _STOP) for measured in experiments.life]
    return WornAxis(peaks, gentle, *preload_ratios(experiments))


def _peak_at(run: Run, position: float) -> float | None:
    """Mean peak of the FRFs after departures from a stop, Hz; None where it has a frequency or no peak."""
    if _mode_at(run, position)[0] is not None:
        return None
    peaks = []
    for condition in ("PA", "NA"):
        response = response_of(run, position, condition)
        if response is None:
            continue
        band = next(cell.band_Hz for cell in run.cells if cell.condition == condition)
        found = first_peak(response.frequency, response.magnitude, band)
        if found is not None:
            peaks.append(found.frequency)
    return float(np.mean(peaks)) if peaks else None


def _mode_at(run: Run, position: float) -> tuple[float | None, float | None]:
    """Mean frequency of the cells at a stop and its standard uncertainty, Hz; None where all are refused."""
    values, uncertainties = [], []
    for (stop, _), cell in reported_cells(run).items():
        if abs(stop - position) < 1e-6:
            values.append(cell.frequency_Hz or 0.0)
            uncertainties.append(cell.standard_uncertainty_Hz or 0.0)
    if not values:
        return None, None
    # The error of the method is common to the conditions, so averaging does not reduce the uncertainty.
    return float(np.mean(values)), max(uncertainties)


def _lost_motion_at(lost: Sequence[LostMotion], position: float) -> tuple[float, float]:
    """Lost motion at a stop and its standard uncertainty, m; NaN where it was not measured."""
    for stop in lost:
        if abs(stop.position_m - position) < 1e-6:
            return stop.lost_m, stop.standard_uncertainty_m
    return float("nan"), float("nan")


def _segment(recording: Recording, row: TransientRow, period: float) -> TransientSignals:
    position, torque = recording.of("position")[0], recording.of("torque")[0]
    acceleration = recording.of("acceleration")[0]
    rate = recording.rate(torque)
    motion = kinematics(recording.array(position), rate)
    first = max(0, round((row.start_s - _MARGIN) * rate))
    part = slice(first, round((row.stop_s + _MARGIN) * rate))
    time = np.arange(len(motion.speed))[part] / rate - row.start_s
    length = row.stop_s - row.start_s
    before, after = BEFORE * period, AFTER * period
    if Condition(row.condition).accelerating:
        excitation = 0.0
        after = min(after, length)
    else:
        excitation = length
        before = min(before, length)
    return TransientSignals(
        time=time,
        speed=motion.speed[part],
        torque=recording.array(torque)[part],
        acceleration=recording.array(acceleration)[part],
        start=0.0,
        stop=length,
        window=(max(excitation - before, float(time[0])), min(excitation + after, float(time[-1]))),
    )
