"""The paper's two experiments: machine, load and day of each run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta

import numpy as np

from ballscrew.axis.given import not_negative, positive
from ballscrew.axis.sheet import DataSheet
from ballscrew.base.errors import InputError
from ballscrew.fcft.plan import Plan
from ballscrew.fcft.schedule import duration, trips
from ballscrew.testbed.duty import Stroke, exposure, jitter, production
from ballscrew.testbed.instruments import Instruments
from ballscrew.testbed.machine import Machine
from ballscrew.testbed.pace import Pace
from ballscrew.testbed.trip import Rig
from ballscrew.testbed.wear_life import Life, calibrated, worn_machines

GONE = 0.9375
"""Part of a run-to-failure after which the first place has lost its preload and has backlash."""

_MOST_RUNS, _MOST_DAYS = 10_000, 36_525.0
_SCREW_SHARE = 0.2  # part of the wear that differs from place to place; jittering wears balls and nut most
_CELLS = 45  # of the grid over the travel
_BEGIN = datetime(2024, 1, 1, 8, tzinfo=UTC)
# One sample of a trip: torque, three currents, two triaxial accelerometers; encoder and scale twice as wide.
_BYTES = 4 * 10 + 8 * 2


@dataclass(frozen=True, slots=True)
class PlannedRun:
    """One run of an experiment.

    Parameters
    ----------
    name : str
        Name of the run and of its folder.
    rig : Rig
        Machine in its state on that day.
    plan : Plan
        The test.
    load : float
        Load on the table, kg.
    day : float
        Day since the start of the experiment.
    seed : int
        Seed of its recordings.
    """

    name: str
    rig: Rig
    plan: Plan
    load: float
    day: float
    seed: int

    @property
    def measured_at(self) -> str:
        """The day as a date, ISO 8601; the experiments begin on the first of January 2024."""
        return (_BEGIN + timedelta(days=self.day)).strftime("%Y-%m-%dT%H:%MZ")


def bench(sheet: DataSheet) -> Rig:
    """A machine with its nominal preload and a linear scale beside its table, as the experiments need it.

    Parameters
    ----------
    sheet : DataSheet
        Data sheet with the true values.

    Returns
    -------
    Rig
        New machine.
    """
    return Rig(Machine(sheet, sheet.nominal_preload), instruments=Instruments(linear_scale=True))


def multi_level_mass(
    rig: Rig, plan: Plan, loads: Sequence[float], *, seed: int = 0
) -> tuple[PlannedRun, ...]:
    """The multi-level mass experiment: one machine, one run for each load.

    Parameters
    ----------
    rig : Rig
        The machine, the same in all runs.
    plan : Plan
        Its loads are replaced.
    loads : sequence of float
        kg; each once.
    seed : int
        Seed of the recordings.

    Returns
    -------
    tuple of PlannedRun
        In the order of the loads.

    Raises
    ------
    InputError
        If there is no load, one is negative or given twice.
    """
    if not loads or len(set(loads)) < len(loads):
        raise InputError("the loads must be one or more, each given once.")
    not_negative("load", list(loads), "kg")
    return tuple(
        PlannedRun(
            f"load-{load:.12g}kg", rig, replace(plan, masses=(load,)), load, 0.0, _seed(seed, 1, index)
        )
        for index, load in enumerate(loads)
    )


def run_to_failure(
    rig: Rig, plan: Plan, load: float, days: float = 80.0, every: float = 3.0, *, seed: int = 0
) -> tuple[PlannedRun, ...]:
    """The run-to-failure experiment: one load, a machine that wears, a run every few days.

    Parameters
    ----------
    rig : Rig
        The machine when new.
    plan : Plan
        Its loads are replaced.
    load : float
        Load on the table, kg.
    days : float
        Length of the experiment; the first place loses its preload after its part :data:`GONE`.
    every : float
        Days from run to run; the first is on day 0.
    seed : int
        Seed of the recordings.

    Returns
    -------
    tuple of PlannedRun
        In the order of time; the wear is local, according to the duty.

    Raises
    ------
    InputError
        If a number is impossible.
    """
    not_negative("load", load, "kg")
    positive("number of days", days, "d")
    if not float(positive("number of days from run to run", every, "d")) <= days:
        raise InputError(
            f"a run every {every:g} days was asked for in {days:g} days; there would be one only."
        )
    if days / every > _MOST_RUNS or days > _MOST_DAYS:
        raise InputError(
            f"a run every {every:g} days for {days:g} days was asked for; there may be {_MOST_RUNS} runs "
            f"in {_MOST_DAYS:g} days at most."
        )
    when = np.arange(0.0, days, every)
    width = len(f"{when[-1]:.0f}")
    life = run_to_failure_life(rig.machine, plan, load, GONE * days)
    runs = []
    machines = worn_machines(rig.machine, life, when)
    for index, (day, machine) in enumerate(zip(when.tolist(), machines, strict=True)):
        name = f"day-{day:.12g}"
        if every == round(every):
            name = f"day-{day:0{width}.0f}"
        worn_rig, test = replace(rig, machine=machine), replace(plan, masses=(load,))
        runs.append(PlannedRun(name, worn_rig, test, load, day, _seed(seed, 2, index)))
    return tuple(runs)


def run_to_failure_duty(travel: float, load: float) -> tuple[Stroke, ...]:
    """A day of production over the whole travel, and of jittering about a few places.

    The paper does not describe its jittering motion: strokes, places and numbers are the testbed's own.

    Parameters
    ----------
    travel : float
        Travel from 0, m.
    load : float
        Load on the table, kg.

    Returns
    -------
    tuple of Stroke
        About ten hours of motion per day.
    """
    stops = [0.0, 0.25 * travel, 0.6 * travel, travel]
    moves = production(stops, 0.2, 2.0, 4000.0, load)
    places = [0.3 * travel, 0.5 * travel, 0.7 * travel]
    return moves + jitter(places, 0.03 * travel, 0.1, 2.0, 50_000.0, load)


def run_to_failure_life(machine: Machine, plan: Plan, load: float, days: float) -> Life:
    """Life in which the preload decreases to zero, under a duty that covers the stops.

    Parameters
    ----------
    machine : Machine
        New machine.
    plan : Plan
        Gives the stops.
    load : float
        Load on the table, kg.
    days : float
        Days until the first place has lost its preload.

    Returns
    -------
    Life
        Greased every 28 days.

    Raises
    ------
    InputError
        If a number is impossible.
    """
    first, travel = plan.positions[0], plan.positions[-1] - plan.positions[0]
    duty = exposure(run_to_failure_duty(travel, load), machine.sheet, np.linspace(0, travel, _CELLS + 1))
    pace = Pace(greased=tuple(np.arange(28.0, max(days, 28.0) + 1, 28.0).tolist()))
    life = Life(machine.sheet, duty, machine.preload, pace=pace, screw_share=_SCREW_SHARE)
    return replace(calibrated(life, days), exposure=replace(duty, edges=duty.edges + first))


def recorded(runs: Sequence[PlannedRun]) -> tuple[int, int]:
    """Number of recordings of an experiment, and their approximate size in bytes.

    Parameters
    ----------
    runs : sequence of PlannedRun
        The experiment.

    Returns
    -------
    recordings, size : int
        Files, and bytes.
    """
    files = size = 0
    for run in runs:
        count = sum(1 for trip in trips(run.plan) if trip.repetition)
        seconds = duration(run.plan) + count * run.rig.variation.start / 2
        files += count
        size += round(seconds * run.rig.sample_rate) * _BYTES
    return files, size


def _seed(seed: int, experiment: int, index: int) -> int:
    return int(np.random.SeedSequence([seed, experiment, index]).generate_state(1)[0])
