"""A short run of the testbed, as the joint estimator gets it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest

from ballscrew.fcft.plan import Motion, Plan
from ballscrew.fcft.schedule import trips as planned_trips
from ballscrew.modal.cell import TransientRow
from ballscrew.modal.joint.blocks import Block, make_block
from ballscrew.modal.joint.initial import inertia_and_viscous_friction
from ballscrew.modal.joint.signals import TripSignals, complete_transients, trip_signals
from ballscrew.modal.joint.windows import average_windows
from ballscrew.recording.aligned import Aligned
from ballscrew.recording.kinematics import kinematics
from ballscrew.recording.phases import find_phases
from ballscrew.recording.transients import cut, label
from ballscrew.testbed.example import AXIS, LOAD, example_rig
from ballscrew.testbed.linear import true_frequency
from ballscrew.testbed.trip import Rig, prepared, simulate_trip

STOPS = (0.0, 0.1, 0.2, 0.3)
MOTION = Motion(speed=0.15, acceleration=2.0, jerk=1500.0, dwell=0.25)


@dataclass(frozen=True)
class SmallRun:
    """Trips with their transients, and the truth at each stop, Hz."""

    trips: tuple[TripSignals, ...]
    transients: tuple[TransientRow, ...]
    free: dict[float, float]
    held: dict[float, float]


def small_run(rig: Rig, repetitions: int = 3, motion: Motion = MOTION) -> SmallRun:
    """A run over four stops."""
    plan = Plan(STOPS, repetitions, (LOAD,), (motion,), source="the test's plan")
    signals, segments = [], []
    for file, trip in enumerate(t for t in planned_trips(plan) if t.repetition):
        told = simulate_trip(rig, plan, trip.executed, LOAD, seed=file)
        nut = np.stack([told["acc1_x"], told["acc2_x"]])
        aligned = Aligned(rig.sample_rate, told["torque"], "torque", told["position"], nut, ("acc1", "acc2"))
        signals.append(trip_signals(aligned, 3000.0))
        segments += cut(aligned, find_phases(kinematics(aligned.position, aligned.rate)), file)
    table = label(segments, aligned, LOAD, plan)
    c = prepared(rig.machine, LOAD, plan)
    return SmallRun(
        tuple(signals),
        complete_transients(table),
        {x: true_frequency(c, x) for x in STOPS},
        {x: true_frequency(c, x, rotor_fixed=True) for x in STOPS},
    )


def two_stops(run: SmallRun, *, places: tuple[float, ...] = (STOPS[0], STOPS[-1])) -> SmallRun:
    """The run with the transients of two stops alone: four cells, a tenth of the processor time."""
    return replace(run, transients=tuple(row for row in run.transients if row.position_m in places))


def inertia_of(trips: tuple[TripSignals, ...]) -> float:
    """Total inertia."""
    found = inertia_and_viscous_friction(trips)
    assert found is not None
    return found[0]


@pytest.fixture(scope="session")
def rig() -> Rig:
    """The example with a pitching mode at 330 Hz."""
    rig = example_rig()
    return replace(rig, steps=16, instruments=replace(rig.instruments, pitch_frequency=330.0))


@pytest.fixture(scope="session")
def run(rig: Rig) -> SmallRun:
    """Three trips."""
    return small_run(rig)


@pytest.fixture(scope="session")
def blocks(run: SmallRun) -> list[Block]:
    """Blocks of the run without whitening."""
    mass = inertia_of(run.trips)
    w = average_windows(run.trips, run.transients, mass, 90.0, 450.0)
    assert w is not None
    return [make_block(name, w) for name in ("torque-nut", "motor-nut", "torque-motor")]


@pytest.fixture(scope="session")
def sheet() -> object:
    """Its data sheet."""
    return AXIS


@pytest.fixture(scope="session")
def dented(rig: Rig) -> SmallRun:
    """The same with a place where the screw has lost a good part of its preload."""
    machine = rig.machine
    whole = (machine.preload / machine.hertz) ** (2 / 3)
    lost = tuple((x, part * whole) for x, part in ((0.05, 0.0), (0.1, 0.4), (0.2, 0.0)))
    return small_run(replace(rig, machine=replace(machine, lost=lost)))


@pytest.fixture(scope="session")
def unloaded(rig: Rig) -> SmallRun:
    """The same with a nut that the test's own load unloads many times over."""
    return small_run(replace(rig, machine=replace(rig.machine, preload=rig.machine.preload / 60)))
