"""How long an analysis takes and what it holds in memory.

The testbed makes a run of 30 round trips (11 stops, 40 cells, 12.8 kHz, 11 channels), a file each. Then

- ``ballscrew analyze`` on all of them, by the default method and the paper's, as a whole process: time by the
  clock, time of the processor, largest memory; each the median of a few runs after one that is not counted;
- the joint estimator alone, from arrays in memory;
- the memory of a process that analyses 3 of the files, and so what a file more takes.

Processor time is the one to trust where others use the machine too. Needs ``os.wait4``, which Windows lacks.

    python -m benchmarks.speed [--trips 30] [--rounds 3] [--folder FOLDER]
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ballscrew.modal.analyze import highest
from ballscrew.modal.job import Job
from ballscrew.modal.joint.analysis import signal_reducer
from ballscrew.modal.joint.identify import identify_jointly
from ballscrew.modal.joint.settings import JointSettings
from ballscrew.modal.joint.signals import complete_transients
from ballscrew.modal.paper.settings import PaperSettings
from ballscrew.recording.measure import measure
from ballscrew.testbed.example import AXIS, PLAN
from ballscrew.testbed.machine import Machine
from ballscrew.testbed.run import simulate_run
from ballscrew.testbed.trip import Rig
from benchmarks.machine import heading

FEW = 3
_UNIT = 2**20 if sys.platform == "darwin" else 2**10  # of ru_maxrss, in a MiB


@dataclass(frozen=True, slots=True)
class Spent:
    """What a process took: s by the clock, s of the processor, MiB at most."""

    clock: float
    processor: float
    memory: float


def whole_process(command: Sequence[str]) -> Spent:
    """Run a command and ask the operating system what it took."""
    start = time.perf_counter()
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)  # noqa: S603  ours
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise SystemExit(f"{' '.join(command)}: exit status {process.returncode}")
    clock = time.perf_counter() - start
    return Spent(clock, usage.ru_utime + usage.ru_stime, usage.ru_maxrss / _UNIT)


def median_of(command: Sequence[str], rounds: int) -> Spent:
    """Medians over a few runs, after one that fills caches."""
    whole_process(command)
    runs = [whole_process(command) for _ in range(rounds)]
    clock, processor, memory = np.median([(r.clock, r.processor, r.memory) for r in runs], axis=0).tolist()
    return Spent(clock, processor, memory)


def joint_alone(run: Path, rounds: int) -> list[float]:
    """The joint estimator on a run's signals, all in memory: s by the clock and of the processor."""
    job = Job.read(run)
    load, settings = job.mass or 0.0, JointSettings()
    measured = measure(
        job.files,
        job.channels,
        sheet=job.sheet,
        plan=job.plan,
        mass=load,
        extract=signal_reducer(job.sheet, load, settings),
        top=highest(job.sheet, load, PaperSettings()),
    )
    assert measured.transients is not None, "no recording could be used"
    trips, transients = list(measured.extracts.values()), complete_transients(measured.transients)
    took = []
    for _ in range(rounds + 1):
        start, begun = time.perf_counter(), time.process_time()
        identify_jointly(trips, transients, job.sheet, load, settings)
        took.append((time.perf_counter() - start, time.process_time() - begun))
    medians: list[float] = np.median(took[1:], axis=0).tolist()
    return medians


def run_of(folder: Path, trips: int) -> Path:
    """RUN.toml of a simulated run."""
    plan = replace(PLAN, repetitions=trips)
    return simulate_run(Rig(Machine(AXIS, AXIS.nominal_preload)), plan, PLAN.masses[0], folder, seed=1).run


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--trips", type=int, default=30)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--folder", type=Path, help="Keeps the recordings. [default: made and removed]")
    parser.add_argument("--joint", type=Path, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.joint is not None:
        print(json.dumps(joint_alone(given.joint, given.rounds)))
        return
    # As the command line has it: threads of the linear algebra would wait for each other. It is read when
    # numpy is loaded, so that only new processes see it.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    folder = given.folder or Path(tempfile.mkdtemp())
    try:
        table(folder, given.trips, given.rounds)
    finally:
        if given.folder is None:
            shutil.rmtree(folder)


def table(folder: Path, trips: int, rounds: int) -> None:
    """Make the recordings, measure, print."""
    many, few = (run_of(folder / str(count), count) for count in (trips, FEW))
    command = [sys.executable, "-m", "ballscrew", "analyze", "--json"]
    alone = [sys.executable, "-m", "benchmarks.speed", "--joint", str(many), "--rounds", str(rounds)]
    printed = subprocess.run(alone, capture_output=True, check=True, text=True).stdout  # noqa: S603
    clock, processor = json.loads(printed)
    whole = f"`ballscrew analyze`, {trips} files"
    rows = {
        whole: median_of([*command, str(many)], rounds),
        f"`ballscrew analyze --method paper`, {trips} files": median_of(
            [*command, "--method", "paper", str(many)], rounds
        ),
        f"`ballscrew analyze`, {FEW} files": median_of([*command, str(few)], rounds),
        f"the joint estimator alone, 40 cells × {trips}": Spent(clock, processor, float("nan")),
    }
    print(heading(f"python -m benchmarks.speed --trips {trips}"), end="\n\n")
    print("| what | s by the clock | s of the processor | MiB |\n|---|---|---|---|")
    for name, took in rows.items():
        memory = "–" if np.isnan(took.memory) else f"{took.memory:.0f}"
        print(f"| {name} | {took.clock:.1f} | {took.processor:.1f} | {memory} |")
    size = np.mean([path.stat().st_size for path in many.parent.glob("*.h5")]) / 2**20
    least = rows[f"`ballscrew analyze`, {FEW} files"].memory
    more = (rows[whole].memory - least) / (trips - FEW)
    print(f"\nA file of {size:.1f} MiB more takes {more:.1f} MiB more.")


if __name__ == "__main__":
    main()
