"""Full run-to-failure experiments, from raw recordings to the remaining life: python -m benchmarks.lives.

Ten random axes of the testbed, each with a wrong data sheet, tested every third day with three trips. Half of
them wear from the first day on, as the paper's; half are new for twelve days. Every run is simulated, read by
``analyze`` and deleted; the model comes from the first three runs and the sheet; the rest is ``monitor``.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ballscrew.base.jsonfile import write_json
from ballscrew.calibration.calibration import calibrate
from ballscrew.modal.analyze import analyze
from ballscrew.modal.run import Run
from ballscrew.prognosis.failure import HALF
from ballscrew.prognosis.monitor import Monitored, monitor
from ballscrew.reproduction.experiment import Measured
from ballscrew.reproduction.results import first_backlash, mean_preload, true_values
from ballscrew.testbed.experiments import PlannedRun, run_to_failure
from ballscrew.testbed.run import simulate_run, truth
from benchmarks.axis_sampling import RandomAxis, random_axis
from benchmarks.identification_tables import write
from benchmarks.machine import heading

_FIRST = 400  # seeds that nothing was tuned on
_EVERY, _HEALTHY, _TRIPS = 3.0, 12.0, 3
_COLUMNS = (
    "axis | screw, mm | mode, Hz | new for, days | alarm on day | lost by then, mean of the stops "
    "| at the worst stop | first backlash on day | lead, days | half of the preload forecast for "
    "| and came on day | runs set aside before backlash"
)


@dataclass(frozen=True, slots=True)
class Life:
    """Result of a life, and its row of the table."""

    line: str
    lost: float
    lead: float
    covered: bool | None


def experiment(axis: RandomAxis, healthy: float, seed: int) -> tuple[PlannedRun, ...]:
    """Runs of a machine that is new for some days and then wears for eighty."""
    plan = replace(axis.plan, repetitions=_TRIPS)
    rig = replace(axis.rig, instruments=replace(axis.rig.instruments, linear_scale=True))
    worn = run_to_failure(rig, plan, axis.load, every=_EVERY, seed=seed)
    new = [
        replace(worn[0], name=f"new-{day:02.0f}", day=float(day), seed=worn[0].seed + 1 + index)
        for index, day in enumerate(np.arange(0.0, healthy, _EVERY))
    ]
    return (*new, *(replace(run, day=run.day + healthy) for run in worn))


def measured(axis: RandomAxis, planned: PlannedRun, keep: Path | None) -> Measured:
    """Simulate and analyse a run, without its recordings; a stored result is not made again."""
    known = None if keep is None else keep / f"{planned.name}.json"
    true = truth(planned.rig, planned.plan, planned.load)
    if known is not None and known.is_file():
        return Measured(planned, Run.read(known), true)
    with tempfile.TemporaryDirectory() as folder:
        files = simulate_run(
            planned.rig, planned.plan, planned.load, Path(folder), seed=planned.seed,
            measured_at=planned.measured_at, sheet=axis.data_sheet,
        )  # fmt: skip
        run = replace(analyze(files.run), frequency_response=None)
    if known is not None:
        known.parent.mkdir(parents=True, exist_ok=True)
        known.write_text(write_json(run.to_json()), encoding="utf-8")
    return Measured(planned, run, true)


def life_row(axis: RandomAxis, life: Sequence[Measured], seed: int, healthy: float) -> Life:
    """The row of one life."""
    runs = [each.run for each in life]
    good = [run for run in runs if run.quality.verdict != "bad" and any(c.frequency_Hz for c in run.cells)]
    model = calibrate(good[:3], axis.data_sheet)
    whole = monitor(runs, model)
    states = {state.reading.run: state.state for state in whole.state.runs}
    at = next((i for i, each in enumerate(life) if states[each.run.id] == "alarm"), None)
    end = first_backlash(life)
    begun = mean_preload(life[0])
    half = next((each.planned.day for each in life if mean_preload(each) < HALF * begun), None)
    suspect = sum(
        1 for each in life if states[each.run.id] == "suspect" and (end is None or each.planned.day < end)
    )
    screw = axis.data_sheet.screw
    head = (
        f"{seed} | {1e3 * screw.nominal_diameter:.0f} × {1e3 * screw.lead:.0f} "
        f"| {axis.frequency:.0f} | {healthy:.0f}"
    )
    if at is None:
        return Life(
            f"| {head} | none | – | – | {end or '–'} | – | – | {half or '–'} | {suspect} |", 1.0, 0.0, None
        )
    day = life[at].planned.day
    lost = 1 - mean_preload(life[at]) / begun
    local, new = (true_values(each, "local_preload_N") for each in (life[at], life[0]))
    worst = max(1 - local[place] / new[place] for place in local)
    forecast, covered = _forecast(monitor(runs[: at + 1], model), day, half)
    lead = float("nan") if end is None else end - day
    gap = "–" if end is None else f"{end:g}"
    return Life(
        f"| {head} | {day:g} | {100 * lost:.1f} % | {100 * worst:.1f} % | {gap} "
        f"| {lead:g} | {forecast} | {'–' if half is None else f'{half:g}'} | {suspect} |",
        lost, lead, covered,
    )  # fmt: skip


def _forecast(then: Monitored, day: float, half: float | None) -> tuple[str, bool | None]:
    if then.prognosis is None:
        return "–", None
    low, middle, high = (then.prognosis.rul_days[p] for p in (0.05, 0.5, 0.95))
    words = "day {} ({} to {})".format(
        *("open" if d is None else f"{day + d:.0f}" for d in (middle, low, high))
    )
    if half is None or low is None:
        return words, None
    # The day is known to the run on which it was first so.
    return words, low <= half - day and (high is None or half - day - _EVERY <= high)


def main() -> None:
    """Print the table, and write it into the page."""
    parser = argparse.ArgumentParser(description="Full run-to-failure experiments.")
    parser.add_argument("--lives", type=int, default=10)
    parser.add_argument("--first", type=int, default=_FIRST, help="seed of the first axis")
    parser.add_argument("--results", type=Path, help="store every RUN.json here, and reuse it")
    parser.add_argument("--page", type=Path, help="write the table into this page")
    given = parser.parse_args()
    rows = []
    for seed in range(given.first, given.first + given.lives):
        axis = random_axis(seed)
        healthy = _HEALTHY if seed % 2 else 0.0
        keep = None if given.results is None else given.results / f"{seed}"
        life = [measured(axis, planned, keep) for planned in experiment(axis, healthy, seed)]
        rows.append(life_row(axis, life, seed, healthy))
        print(rows[-1].line, flush=True)
    covered = [row.covered for row in rows if row.covered is not None]
    leads, lost = [row.lead for row in rows], float(np.median([row.lost for row in rows]))
    summary = (
        f"Lost at the alarm, mean of the stops: {100 * lost:.1f} % in "
        f"the median. Lead over the first run with backlash: {min(leads):g} to {max(leads):g} days. The 90 % "
        "interval of the day with half of the preload, as forecast on the day of the alarm, contains it in "
        f"{sum(covered)} of {len(covered)}."
    )
    lines = [
        heading(f"python -m benchmarks.lives --lives {given.lives}"),
        "",
        f"| {_COLUMNS} |",
        "|" + "---|" * len(_COLUMNS.split(" | ")),
        *(row.line for row in rows),
        "",
        summary,
    ]
    print("\n".join(lines))
    if given.page is not None:
        write(given.page, "full lives", lines)


if __name__ == "__main__":
    main()
