"""The paper's two experiments: which machine is tested with which load on which day."""

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
from ballscrew.testbed.instruments import Instruments
from ballscrew.testbed.life import Life, wear_states
from ballscrew.testbed.machine import Machine
from ballscrew.testbed.run_to_failure import run_to_failure_life
from ballscrew.testbed.trip import Rig
from ballscrew.testbed.wear_state import worn_machine

__all__ = ["GONE", "PlannedRun", "bench", "multi_level_mass", "recorded", "run_to_failure"]

GONE = 0.9375
"""Part of a run-to-failure after which some place has no preload left; the rest shows backlash."""

_MOST_RUNS, _MOST_DAYS = 10_000, 36_525.0
_BEGIN = datetime(2024, 1, 1, 8, tzinfo=UTC)
# One sample of a trip: torque, three currents, two triaxial accelerometers; encoder and scale twice as wide.
_BYTES = 4 * 10 + 8 * 2


@dataclass(frozen=True, slots=True)
class PlannedRun:
    """One run of an experiment.

    Parameters
    ----------
    name : str
        Also of its folder.
    rig : Rig
        The machine as it is then.
    plan : Plan
        The test.
    load : float
        What lies on the table, kg.
    day : float
        Since the start of the experiment.
    seed : int
        Of its recordings.
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
        Taken as true.

    Returns
    -------
    Rig
        New.
    """
    return Rig(Machine(sheet, sheet.nominal_preload), instruments=Instruments(linear_scale=True))


def multi_level_mass(
    rig: Rig, plan: Plan, loads: Sequence[float], *, seed: int = 0
) -> tuple[PlannedRun, ...]:
    """The multi-level mass experiment: one machine, one run for each load.

    Parameters
    ----------
    rig : Rig
        The machine, the same all along.
    plan : Plan
        Its loads are replaced.
    loads : sequence of float
        kg; each once.
    seed : int
        Of the recordings.

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
        What lies on the table, kg.
    days : float
        Length of the experiment; the preload is gone first somewhere after the part :data:`GONE` of it.
    every : float
        Days from run to run; the first is on day 0.
    seed : int
        Of the recordings.

    Returns
    -------
    tuple of PlannedRun
        In the order of time; the wear is local, as the duty travels.

    Raises
    ------
    InputError
        If a number cannot be.
    """
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
    states = wear_states(_life(rig.machine, plan, load, days), when)
    return tuple(
        PlannedRun(
            f"day-{state.day:0{width}.0f}" if every == round(every) else f"day-{state.day:.12g}",
            replace(rig, machine=worn_machine(rig.machine, state)),
            replace(plan, masses=(load,)),
            load,
            state.day,
            _seed(seed, 2, index),
        )
        for index, state in enumerate(states)
    )


def recorded(runs: Sequence[PlannedRun]) -> tuple[int, int]:
    """How many recordings an experiment makes, and about how many bytes they take.

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


def _life(machine: Machine, plan: Plan, load: float, days: float) -> Life:
    """A life whose duty covers the stops, wherever they lie."""
    first, last = plan.positions[0], plan.positions[-1]
    life = run_to_failure_life(
        machine.sheet, GONE * days, travel=last - first, load=load, preload=machine.preload
    )
    return replace(life, exposure=replace(life.exposure, edges=life.exposure.edges + first))


def _seed(seed: int, experiment: int, index: int) -> int:
    return int(np.random.SeedSequence([seed, experiment, index]).generate_state(1)[0])
