"""``ballscrew reproduce``: the paper's two experiments on a bench in software, its figures and its claims."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np

from ballscrew.base.errors import InputError
from ballscrew.base.files import Progress, ignore_progress, write_text
from ballscrew.base.jsonfile import SCHEMA, write_json
from ballscrew.fcft.levels import gentle_motion
from ballscrew.modal.analyze import analyze
from ballscrew.modal.run import Run
from ballscrew.report.canvas import check_drawing
from ballscrew.report.page import html_page
from ballscrew.reproduction.claims import claims
from ballscrew.reproduction.experiment import Measured, check_space, measured_runs
from ballscrew.reproduction.figures import CELLS, Segments, draw_figures, segments_of
from ballscrew.reproduction.preload_claims import calibrate_bench, last_lines
from ballscrew.reproduction.results import Claim, Experiments, falls_before_backlash, first_backlash
from ballscrew.testbed.example import AXIS, PLAN
from ballscrew.testbed.experiments import PlannedRun, bench, multi_level_mass, run_to_failure
from ballscrew.testbed.run import RunFiles

_LOADS = (0.0, 10.0, 20.0, 30.0, 40.0, 50.0)  # kg, of the multi-level-mass experiment
_LOAD = 100.0  # kg, of the run-to-failure experiment
_INTERVAL = 3.0  # days between two runs
_WORN = 36.0  # day from which on the gentler motion is run too: a sixth of the preload is left somewhere
_REPETITIONS, _QUICK_REPETITIONS = 30, 3


def reproduce(
    out: str | Path,
    *,
    quick: bool = False,
    keep: bool = False,
    seed: int = 0,
    announce: Callable[[str], None] | None = None,
    progress: Progress = ignore_progress,
) -> tuple[Experiments, tuple[Claim, ...]]:
    """Run the multi-level-mass and the run-to-failure experiment, and leave a report in a folder.

    Parameters
    ----------
    out : path-like
        Folder of the report; made if absent.
    quick : bool
        Make three round trips per run instead of thirty, half of the days, and four loads.
    keep : bool
        Whether the recordings stay.
    seed : int
        Seed of all random numbers.
    announce : callable, optional
        Called once before the work with a sentence on the size of the recordings.
    progress : callable, optional
        Called with how many recordings are done, how many there are, and the last one's name.

    Returns
    -------
    experiments : Experiments
        Both experiments, measured.
    compared : tuple of Claim
        The paper's claims beside them.

    Raises
    ------
    InputError
        If the folder cannot be written to, or has too little free space.
    """
    check_drawing()
    out = Path(out)
    masses, life, gentle = _plan_experiments(quick=quick, seed=seed)
    planned = (*masses, *life, *gentle)
    size = check_space(planned, out, keep=keep)
    if announce is not None:
        announce(size)
    segments: list[Segments] = []
    short_runs: list[Run] = []

    def inspect(of: PlannedRun, files: RunFiles, run: Run) -> None:
        if of is life[0]:
            segments.append(segments_of(run, files))
            if len(files.recordings) > _QUICK_REPETITIONS:
                short_runs.append(_analyze_first_recordings(of, files))

    try:
        results = measured_runs(planned, out, progress, keep=keep, inspect=inspect)
        measured = tuple(map(_keep_shown_responses, results))
        short_run = short_runs[0] if short_runs else None
        first, worn = len(masses), len(masses) + len(life)
        experiments = Experiments(AXIS, measured[:first], measured[first:worn], short_run, measured[worn:])
        compared = claims(experiments)
        pictures = draw_figures(experiments, segments[0], out / "figures", progress=progress)
        options = f"{' --quick' if quick else ''} --seed {seed}"
        _write_report(out, experiments, compared, pictures, options)
    except OSError as error:
        raise InputError(f"{out}: cannot be written ({error.strerror or error}).") from None
    return experiments, compared


def reproduction_json(experiments: Experiments, results: Sequence[Claim]) -> dict[str, object]:
    """The document that ``reproduce --json`` prints."""
    falls = []
    for (position, condition), (fall, uncertainty) in falls_before_backlash(experiments.life).items():
        cell = {"position_m": position, "condition": condition}
        falls.append(cell | {"fall_Hz": fall, "standard_uncertainty_Hz": uncertainty})
    return {
        "schema": SCHEMA,
        "claims": [asdict(claim) for claim in results],
        "backlash_day": first_backlash(experiments.life),
        "falls_before_backlash": falls,
        "runs": [
            _run_json(measured) for measured in (*experiments.masses, *experiments.life, *experiments.gentle)
        ],
    }


def _run_json(measured: Measured) -> dict[str, object]:
    return {
        "name": measured.planned.name,
        "day": measured.planned.day,
        "load_kg": measured.planned.load,
        "quality": measured.run.quality.verdict,
        "truth": measured.truth,
        "lost_motion": [asdict(stop) for stop in measured.run.lost_motion],
    }


def _plan_experiments(*, quick: bool, seed: int) -> tuple[tuple[PlannedRun, ...], ...]:
    """Runs of the multi-level-mass and of the run-to-failure experiment, and those with a gentler motion."""
    machine = bench(AXIS)
    plan = replace(PLAN, repetitions=_REPETITIONS)
    loads: Sequence[float] = _LOADS
    interval = _INTERVAL
    if quick:
        plan = replace(PLAN, repetitions=_QUICK_REPETITIONS)
        loads = tuple(sorted({*_LOADS[::2], _LOADS[-1]}))
        interval = 2 * _INTERVAL
    masses = multi_level_mass(machine, plan, loads, seed=seed)
    life = run_to_failure(machine, plan, _LOAD, every=interval, seed=seed)
    gentle = _gentle_runs(run_to_failure(machine, plan, _LOAD, every=interval, seed=seed + 1))
    return tuple(masses), tuple(life), gentle


def _gentle_runs(life: Sequence[PlannedRun]) -> tuple[PlannedRun, ...]:
    """The baseline and the worn axis with a motion whose load unloads the nut later."""
    runs = []
    for run in life:
        if run.day == 0 or run.day >= _WORN:
            motion = gentle_motion(run.plan, AXIS).motion
            assert motion is not None  # noqa: S101  the bench has one
            plan = replace(run.plan, motions=(motion,))
            runs.append(replace(run, name=f"gentle-{run.name}", plan=plan))
    return tuple(runs)


def _analyze_first_recordings(planned: PlannedRun, files: RunFiles) -> Run:
    """Analyse a run as if it had been measured with three repetitions."""
    return analyze(
        files.recordings[:_QUICK_REPETITIONS],
        channels=files.run.parent / "channels.toml",
        axis=AXIS,
        plan=replace(planned.plan, repetitions=_QUICK_REPETITIONS),
        mass=planned.load,
        method="joint",
    )


def _keep_shown_responses(measured: Measured) -> Measured:
    """Keep only the FRFs of the cells that are shown: all of them are 20 MB per run."""
    table = measured.run.frequency_response
    if table is None:
        return measured
    shown = np.zeros(table.sizes["cell"], dtype=bool)
    for position, condition in CELLS:
        there = np.abs(table["position_m"].values - position) < 1e-6
        shown |= there & (table["condition"].values == condition)
    small = table.isel(cell=np.flatnonzero(shown)).copy(deep=True)
    return replace(measured, run=replace(measured.run, frequency_response=small))


def _write_report(
    out: Path,
    experiments: Experiments,
    results: Sequence[Claim],
    pictures: Sequence[tuple[str, str]],
    options: str,
) -> None:
    made = (
        f"Made by: ballscrew reproduce --out DIR{options}, version "
        f"{experiments.life[0].run.made.version}. The RUN.json of each run is in runs/, claims and true "
        "values are in reproduce.json."
    )
    confirmed = [claim.holds for claim in results].count("yes")
    page = html_page(
        "Early detection of preload loss: the paper's experiments on a simulated bench",
        [_description(experiments), made],
        pictures,
        ["the paper's claim", "result", "holds", "remark"],
        [[claim.paper, claim.measured, claim.holds, claim.remark] for claim in results],
        conclusion=f"{confirmed} of {len(results)} claims of the paper hold on the simulated bench.",
        words=True,
    )
    write_text(out / "report.html", page)
    write_text(out / "reproduce.json", write_json(reproduction_json(experiments, results)) + "\n")


def end_of_life(experiments: Experiments) -> list[str]:
    """What ``monitor`` prints first on the days of the last runs."""
    return last_lines(experiments.life, calibrate_bench(experiments))


def _description(experiments: Experiments) -> str:
    screw, motion = AXIS.screw, PLAN.motions[0]
    repetitions = experiments.life[0].planned.plan.repetitions
    return (
        f"A simulated bench with known truth: a {1e3 * screw.nominal_diameter:g} × {1e3 * screw.lead:g} mm "
        f"screw, table {AXIS.table.mass:g} kg, {motion.speed:g} m/s, {motion.acceleration:g} m/s², "
        f"{motion.jerk:g} m/s³, {len(PLAN.positions)} stops from 0 to {1e3 * PLAN.positions[-1]:g} mm, "
        f"12.8 kHz, {repetitions} round trips per run. First {len(experiments.masses)} loads from "
        f"{_LOADS[0]:g} to {_LOADS[-1]:g} kg at a preload of 4 % of Ca; then {len(experiments.life)} runs in "
        f"80 days with {_LOAD:g} kg, while the screw wears, and {len(experiments.gentle)} with a gentler "
        "motion, for the new and the worn axis; the wear is set so that after 75 days some "
        "position has no preload left. Measured values come from the recordings and the bench's data sheet "
        "alone, through ballscrew analyze; true and computed values do not."
    )
