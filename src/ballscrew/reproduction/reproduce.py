"""``ballscrew reproduce``: the paper's two experiments on a bench in software, its figures and its claims."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from pathlib import Path

from ballscrew.base.errors import InputError
from ballscrew.base.files import Progress, ignore_progress, write_text
from ballscrew.base.jsonfile import write_json
from ballscrew.modal.analyze import analyze
from ballscrew.modal.run import Run
from ballscrew.report.page import html_page
from ballscrew.report.style import check_drawing
from ballscrew.reproduction.claims import claims
from ballscrew.reproduction.experiment import Measured, check_space, measured_runs
from ballscrew.reproduction.figures import CELLS, Segments, draw_figures, segments_of
from ballscrew.reproduction.results import Claim, Experiments, falls_before_backlash, first_backlash
from ballscrew.testbed.example import AXIS, PLAN
from ballscrew.testbed.experiments import PlannedRun, bench, multi_level_mass, run_to_failure
from ballscrew.testbed.run import RunFiles

__all__ = ["reproduce", "reproduction_json"]

_LOADS = (0.0, 10.0, 20.0, 30.0, 40.0, 50.0)
_LOAD = 100.0
_EVERY = 3.0  # days
_REPETITIONS, _QUICK = 30, 3


def reproduce(
    out: Path,
    *,
    quick: bool = False,
    keep: bool = False,
    seed: int = 0,
    announce: Callable[[str], None] | None = None,
    progress: Progress = ignore_progress,
) -> tuple[Experiments, tuple[Claim, ...]]:
    """Run the multi-level mass and the run-to-failure experiment, and leave a report in a folder.

    Parameters
    ----------
    out : path-like
        Folder of the report; made where it is not there.
    quick : bool
        Three round trips a run, not thirty, every second day of the paper's, and four loads.
    keep : bool
        Whether the recordings stay.
    seed : int
        Of all chance.
    announce : callable, optional
        Called once before the work with a sentence on the size of the recordings.
    progress : callable, optional
        Called with how many recordings are done, how many there are, and the last one's name.

    Returns
    -------
    found : Experiments
        Both, measured.
    judged : tuple of Claim
        The paper's claims beside it.

    Raises
    ------
    InputError
        If the folder cannot be written to, or has too little room.
    """
    check_drawing()
    plan = replace(PLAN, repetitions=_QUICK if quick else _REPETITIONS)
    machine = bench(AXIS)
    loads = tuple(dict.fromkeys((*_LOADS[::2], _LOADS[-1]))) if quick else _LOADS
    masses = multi_level_mass(machine, plan, loads, seed=seed)
    life = run_to_failure(machine, plan, _LOAD, every=2 * _EVERY if quick else _EVERY, seed=seed)
    planned = (*masses, *life)
    size = check_space(planned, out, keep=keep)
    if announce is not None:
        announce(size)
    shown: list[Segments] = []
    few: list[Run] = []

    def look(one: PlannedRun, files: RunFiles, run: Run) -> None:
        if one is life[0]:
            shown.append(segments_of(run, files))
            if len(files.recordings) > _QUICK:
                few.append(_first_few(one, files))

    try:
        every = [_lean(each) for each in measured_runs(planned, out, progress, keep=keep, look=look)]
        found = Experiments(
            AXIS, tuple(every[: len(masses)]), tuple(every[len(masses) :]), next(iter(few), None)
        )
        judged = claims(found)
        pictures = draw_figures(found, shown[0], out / "figures", progress=progress)
        _report(out, found, judged, pictures, quick=quick, seed=seed)
    except OSError as error:
        raise InputError(f"{out}: cannot be written ({error.strerror or error}).") from None
    return found, judged


def _first_few(one: PlannedRun, files: RunFiles) -> Run:
    """The run that would have been measured with three repetitions."""
    folder = files.run.parent
    plan = replace(one.plan, repetitions=_QUICK)
    return analyze(
        files.recordings[:_QUICK],
        channels=folder / "channels.toml",
        axis=AXIS,
        plan=plan,
        mass=one.load,
        method="joint",
    )


def _lean(one: Measured) -> Measured:
    """The same with the FRFs of those cells alone that are drawn: all of them are 20 MB a run."""
    table = one.run.frequency_response
    if table is None:
        return one
    rows = [
        index
        for index, (place, condition) in enumerate(
            zip(table["position_m"].values, table["condition"].values, strict=True)
        )
        if any(abs(place - x) < 1e-6 and condition == other for x, other in CELLS)
    ]
    return replace(one, run=replace(one.run, frequency_response=table.isel(cell=rows).copy(deep=True)))


def reproduction_json(found: Experiments, judged: Sequence[Claim]) -> dict[str, object]:
    """The document that ``reproduce --json`` prints."""
    return {
        "schema": 1,
        "claims": [asdict(claim) for claim in judged],
        "backlash_day": first_backlash(found.life),
        "falls_before_backlash": [
            {"position_m": place, "condition": condition, "fall_Hz": fall, "standard_uncertainty_Hz": u}
            for (place, condition), (fall, u) in falls_before_backlash(found.life).items()
        ],
        "runs": [
            {
                "name": one.planned.name,
                "day": one.planned.day,
                "load_kg": one.planned.load,
                "quality": one.run.quality.verdict,
                "truth": one.truth,
                "lost_motion": [asdict(each) for each in one.run.lost_motion],
            }
            for one in (*found.masses, *found.life)
        ],
    }


def _report(
    out: Path,
    found: Experiments,
    judged: Sequence[Claim],
    pictures: Sequence[tuple[str, str]],
    *,
    quick: bool,
    seed: int,
) -> None:
    screw, motion = AXIS.screw, PLAN.motions[0]
    repetitions = found.life[0].planned.plan.repetitions
    about = (
        f"A bench in software, whose truth is known: a {1e3 * screw.nominal_diameter:g} × "
        f"{1e3 * screw.lead:g} mm screw, table {AXIS.table.mass:g} kg, {motion.speed:g} m/s, "
        f"{motion.acceleration:g} m/s², {motion.jerk:g} m/s³, {len(PLAN.positions)} stops from 0 to "
        f"{1e3 * PLAN.positions[-1]:g} mm, 12.8 kHz, {repetitions} round trips a run. First "
        f"{len(found.masses)} loads from {_LOADS[0]:g} to {_LOADS[-1]:g} kg at a preload of 4 % of Ca; then "
        f"{len(found.life)} runs in 80 days with {_LOAD:g} kg, while it wears; we set the wear so that some "
        "place has no preload left after 75 days. All that is called measured comes from the recordings and "
        "the bench's data sheet, through ballscrew analyze; what is called true or computed does "
        "not."
    )
    made = (
        f"Made by: ballscrew reproduce --out DIR{' --quick' if quick else ''} --seed {seed}, version "
        f"{found.life[0].run.made.version}. What each run said is in runs/, claims and truth in "
        "reproduce.json."
    )
    page = html_page(
        "Early detection of preload loss: the paper's experiments on a bench in software",
        [about, made],
        pictures,
        ["the paper says", "we find", "holds", "where our bench differs, or why"],
        [[claim.paper, claim.measured, claim.holds, claim.differs] for claim in judged],
        words=True,
    )
    write_text(out / "report.html", page)
    text = write_json(reproduction_json(found, judged)) + "\n"
    write_text(out / "reproduce.json", text)
