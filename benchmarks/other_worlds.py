"""Worlds for :mod:`benchmarks.other_machines`: machines as a data sheet describes them, and others.

A *group* is a machine with its recordings: when new, and later. A *world* is a group and what the data sheet
says of it, right or wrong. Groups share the recordings of the new machine, and worlds those of their group,
where these are equal. All ranges and seeds are constants of this file.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from ballscrew.axis.hertz import release_load
from ballscrew.axis.model import guide_friction, weight_on_nut
from ballscrew.axis.sheet import DataSheet
from ballscrew.base.arrays import Array
from ballscrew.fcft.plan import Plan
from ballscrew.testbed.forces import stiffnesses, support_force
from ballscrew.testbed.linear import compliance, true_frequency
from ballscrew.testbed.machine import Constants, Machine
from ballscrew.testbed.temperature import warmed
from ballscrew.testbed.trip import Rig, prepared
from benchmarks.axis_sampling import random_axis

__all__ = [
    "GROUPS",
    "LOW_LOAD",
    "RATIOS",
    "WORLDS",
    "Bench",
    "Truth",
    "World",
    "bench",
    "keeps_contact",
    "truth",
]

STREAM = 0x0DD5  # of the random numbers, besides the axis and the group
RATIOS = (1.0, 0.85, 0.6)  # P/P₀ of the later runs
STOPS, TRIPS = 5, 4
LOW_LOAD = 0.3  # of the load, in the first run of the calibration

BEARING_PRELOAD = (2.0, 5.0)  # over the nut's
BEARING_LOSS = 0.10
FRAME_FREQUENCIES = (0.7, 0.8, 0.9, 1.1, 1.2)  # over the ANF
FRAME_MASS = (4.0, 20.0)  # over table and load
FRAME_DAMPING = (0.02, 0.06)
WEIGHT_OVER_PRELOAD = (
    0.9,
    2.0,
)  # of a new vertical axis without counterbalance, at most; at least as sampled
LARGEST_PRELOAD = 0.10  # of Ca
COUNTERBALANCE = (0.8, 1.0)  # of the table's weight
PRETENSION_K = (2.0, 5.0)  # warmth that the pretension makes up for
FAR_BEARING = (0.7, 1.3)  # stiffness over that of the thrust bearing
EXPANSION = 11.5e-6  # 1/K
GRADIENT_K = 10.0  # over the length of the screw, at the thrust bearing
PITCH_FREQUENCY = (0.8, 1.3)  # over the ANF
PITCH_SHARE = (0.05, 0.20)  # of the moving mass
PITCH_AT_SENSORS = (0.2, 0.5)
OIL_FILM = (0.1e-6, 0.3e-6)  # m, at the speed of the plan

# Rigidity that a catalogue prints for the same nut, over K of a preloaded nut at 0.10 Ca.
CLEARANCE_K = math.cbrt(3) / 3  # nut with clearance, at a load of 0.30 Ca
LIGHT_K = math.cbrt(0.5)  # preloaded nut at 0.05 Ca
ISO_K = 0.8  # R_nu,ar


@dataclass(frozen=True, slots=True)
class Bench:
    """A machine with its test.

    Parameters
    ----------
    rig : Rig
        When new.
    sheet : DataSheet
        That describes it, wrong within the makers' tolerances only.
    plan : Plan
        The test.
    changed : callable
        From the machine with a part of its preload to the machine of the later run.
    new_as : str
        Group whose recordings of the new machine are the same.
    """

    rig: Rig
    sheet: DataSheet
    plan: Plan
    changed: Callable[[Machine], Machine]
    new_as: str

    @property
    def load(self) -> float:
        """On the table, kg."""
        return self.plan.masses[0]

    def later(self, ratio: float) -> Machine:
        """The machine of a later run at a part of its preload."""
        machine = self.rig.machine
        return self.changed(replace(machine, preload=ratio * machine.preload))


@dataclass(frozen=True, slots=True)
class Truth:
    """Axial stiffness as P/P₀, and P/P₀ of the nut, mean over the stops."""

    stiffness: float
    nut: float


@dataclass(frozen=True, slots=True)
class World:
    """A group and what the data sheet says.

    Parameters
    ----------
    name : str
        In the table.
    group : str
        The recordings.
    on_sheet : bool
        Whether the data sheet describes the machine.
    differs : str
        Between baseline and later run, besides the nut's preload.
    stiffness, nut : str
        Expected verdict of each.
    stated : callable
        From the right data sheet to the one that the analysis is given.
    reanalysed : bool
        Whether the recordings are analysed with that sheet; else with the right one.
    ratios : tuple of float
        P/P₀ of its later runs.
    """

    name: str
    group: str
    on_sheet: bool
    differs: str
    stiffness: str
    nut: str
    stated: Callable[[DataSheet], DataSheet]
    reanalysed: bool = False
    ratios: tuple[float, ...] = RATIOS


def unchanged(machine: Machine) -> Machine:
    """A machine of which only the nut changes."""
    return machine


def as_new(seed: int) -> Bench:
    """Random axis with few stops and trips, and a bearing with a preload of its own."""
    sampled = random_axis(seed)
    ends = sampled.plan.positions[0], sampled.plan.positions[-1]
    stops = tuple(round(float(x), 3) for x in np.linspace(*ends, STOPS))
    plan = replace(sampled.plan, positions=stops, repetitions=TRIPS)
    machine = sampled.rig.machine
    bearing = machine.preload * random_of(seed, "as new").uniform(*BEARING_PRELOAD)
    rig = replace(sampled.rig, machine=replace(machine, bearing_preload=bearing))
    return Bench(rig, sampled.data_sheet, plan, unchanged, "as new")


def bearing(seed: int) -> Bench:
    """The support bearing loses preload as well."""
    return replace(as_new(seed), changed=partial(replace, bearing_preload_ratio=1 - BEARING_LOSS))


def frame(seed: int, ratio: float) -> Bench:
    """Frame on its mounts, with a mode near the axial natural frequency."""
    name = f"frame {ratio:g}"
    random, one = random_of(seed, name), as_new(seed)
    mass = one.rig.machine.sheet.table.mass + one.load
    size = math.log(FRAME_MASS[1] / FRAME_MASS[0])
    machine = replace(
        one.rig.machine,
        bed_mass=mass * FRAME_MASS[0] * math.exp(size * random.uniform()),
        bed_frequency=ratio * middle_frequency(one),
        bed_damping=random.uniform(*FRAME_DAMPING),
    )
    return replace(one, rig=replace(one.rig, machine=machine), new_as=name)


def vertical(seed: int, balanced: bool) -> Bench:
    """Vertical axis, whose maker gave the nut a preload that suits its weight."""
    name = "counterbalance" if balanced else "vertical"
    random, one = random_of(seed, name), as_new(seed)
    weight = 9.80665 * (one.sheet.table.mass + one.load)
    counterbalance = 0.0
    if balanced:
        counterbalance = 9.80665 * one.sheet.table.mass * random.uniform(*COUNTERBALANCE)
    direction = str(random.choice(["up", "down"]))
    least = (weight - counterbalance) / random.uniform(*WEIGHT_OVER_PRELOAD)
    rating = one.sheet.screw.dynamic_load_rating
    raised = max(1.0, min(least, LARGEST_PRELOAD * rating) / one.sheet.nominal_preload)

    def turned(sheet: DataSheet) -> DataSheet:
        return replace(
            sheet,
            orientation="vertical",
            inclination=math.pi / 2,
            positive=direction,
            table=replace(sheet.table, counterbalance=counterbalance),
            screw=replace(sheet.screw, preload_ratio=raised * sheet.screw.preload_ratio),
        )

    machine = one.rig.machine
    machine = replace(machine, sheet=turned(machine.sheet), preload=raised * machine.preload)
    return replace(one, rig=replace(one.rig, machine=machine), sheet=turned(one.sheet), new_as=name)


def geared(seed: int) -> Bench:
    """Belt drive of ratio 2."""
    one = as_new(seed)

    def belted(sheet: DataSheet) -> DataSheet:
        drive = sheet.drive
        belt = replace(
            drive,
            ratio=2.0,
            rotor_inertia=drive.rotor_inertia / 4,
            belt_stiffness=drive.coupling_stiffness,
            coupling_stiffness=None,
        )
        return replace(sheet, drive=belt)

    disturbances, instruments = one.rig.disturbances, one.rig.instruments
    rig = replace(  # a motor of half the torque has half the ripple and half the range
        one.rig,
        machine=replace(one.rig.machine, sheet=belted(one.rig.machine.sheet)),
        disturbances=replace(
            disturbances, ripple=disturbances.ripple / 2, torque_noise=disturbances.torque_noise / 2
        ),
        instruments=replace(
            instruments,
            torque_noise=instruments.torque_noise / 2,
            torque_resolution=instruments.torque_resolution / 2,
            hum=instruments.hum / 2,
        ),
    )
    return replace(one, rig=rig, sheet=belted(one.sheet), new_as="ratio 2")


def fixed_fixed(seed: int) -> Bench:
    """Screw stretched between two different bearings that pull only."""
    random, one = random_of(seed, "fixed-fixed"), as_new(seed)
    screw = one.sheet.screw
    section = math.pi / 4 * screw.root_diameter**2 * screw.youngs_modulus
    pretension = section * EXPANSION * random.uniform(*PRETENSION_K)
    far = one.sheet.bearing.stiffness * random.uniform(*FAR_BEARING)
    error = 1 + 0.30 * random.uniform(-1, 1)

    def stretched(sheet: DataSheet, stiffness: float) -> DataSheet:
        ends = replace(sheet.bearing, far_stiffness=stiffness, pretension=pretension)
        return replace(sheet, support="fixed-fixed", bearing=ends)

    machine = one.rig.machine
    machine = replace(machine, sheet=stretched(machine.sheet, far * error), pretension=pretension)
    sheet = stretched(one.sheet, far)
    return replace(one, rig=replace(one.rig, machine=machine), sheet=sheet, new_as="fixed-fixed")


def pretension_lost(seed: int) -> Bench:
    """The same after its pretension is lost: only one end pulls at a time."""
    return replace(fixed_fixed(seed), changed=partial(replace, pretension=0.0))


def gradient(seed: int) -> Bench:
    """Later runs on a screw that is warm at the thrust bearing."""
    one = as_new(seed)
    screw = one.sheet.screw
    slope = -GRADIENT_K / screw.length
    at_zero = GRADIENT_K + slope * screw.bearing_to_zero
    return replace(one, changed=partial(warmed, difference=at_zero, gradient=slope))


def pitching(seed: int) -> Bench:
    """Table that pitches near the axial natural frequency."""
    random, one = random_of(seed, "pitching"), as_new(seed)
    frequency = middle_frequency(one) * random.uniform(*PITCH_FREQUENCY)
    damping = one.rig.instruments.pitch_damping
    machine = replace(
        one.rig.machine,
        pitch_frequency=frequency,
        pitch_damping=damping,
        pitch_share=random.uniform(*PITCH_SHARE),
    )
    sensors = random.uniform(*PITCH_AT_SENSORS), -random.uniform(*PITCH_AT_SENSORS)
    instruments = replace(one.rig.instruments, pitch_frequency=frequency, pitch=sensors)
    return replace(one, rig=replace(one.rig, machine=machine, instruments=instruments), new_as="pitching")


def oiled(seed: int) -> Bench:
    """Fresh oil after the baseline: a film in the contacts of the moving nut."""
    random, one = random_of(seed, "oil film"), as_new(seed)
    speed = one.plan.motions[0].speed
    film = random.uniform(*OIL_FILM) * (0.1 / speed) ** 0.67
    return replace(one, changed=partial(replace, oil_film=film))


GROUPS: Mapping[str, Callable[[int], Bench]] = {
    "as new": as_new,
    "bearing": bearing,
    **{f"frame {ratio:g}": partial(frame, ratio=ratio) for ratio in FRAME_FREQUENCIES},
    "vertical": partial(vertical, balanced=False),
    "counterbalance": partial(vertical, balanced=True),
    "ratio 2": geared,
    "fixed-fixed": fixed_fixed,
    "pretension lost": pretension_lost,
    "gradient": gradient,
    "pitching": pitching,
    "oil film": oiled,
}


def bench(seed: int, group: str) -> Bench:
    """One axis in one group."""
    return GROUPS[group](seed)


def random_of(seed: int, group: str) -> np.random.Generator:
    """A stream for each axis and group."""
    return np.random.default_rng([seed, STREAM, zlib.crc32(group.encode())])


def middle_frequency(one: Bench) -> float:
    """Axial natural frequency in the middle of the stops, the bed blocked, Hz."""
    still = replace(one.rig.machine, bed_mass=1e8, bed_frequency=0.1)
    middle = (one.plan.positions[0] + one.plan.positions[-1]) / 2
    return true_frequency(prepared(still, one.load, one.plan), middle)


def truth(one: Bench, ratio: float) -> Truth:
    """True values of a later run.

    The axial stiffness as P/P₀ is the preload at which the nut alone would give the observed change of
    compliance. The oil film is that of the plan's speed. Ends without pretension pull in turn:
    the mean of both.
    """
    new, later = one.rig.machine, one.later(ratio)
    before, after = (prepared(machine, one.load, one.plan) for machine in (new, later))
    film = after.film * (one.plan.motions[0].speed / 0.1) ** 0.67
    after = after._replace(pressed=after.pressed + film)
    equivalent = []
    for place in one.plan.positions:
        change = _compliance(after, place) - _compliance(before, place)
        nut = float(new.local_preload(place)) ** (1 / 3) * 3 * new.hertz ** (2 / 3)
        equivalent.append((1 + change * nut) ** -3)
    return Truth(float(np.mean(equivalent)), float(_mean_preload(one, later) / _mean_preload(one, new)))


def keeps_contact(one: Bench, ratio: float) -> bool:
    """True if 2.83 P exceeds the test's nut load, so that both flanks carry."""
    sheet, motion = one.rig.machine.sheet, one.plan.motions[0]
    mass = sheet.table.mass + one.load
    constant = float(abs(weight_on_nut(sheet, one.load)) + guide_friction(sheet, one.load))
    most = constant + mass * motion.peak_acceleration
    return bool(release_load(ratio * one.rig.machine.preload) > most)


def _compliance(c: Constants, place: float) -> float:
    if c.pretension > 0:
        return compliance(c, place)
    ends = [1 / support_force(c, place, way)[1] for way in (1e-6, -1e-6)]
    return compliance(c, place) - 1 / stiffnesses(c, place)[1] + float(np.mean(ends))


def _mean_preload(one: Bench, machine: Machine) -> Array:
    return np.asarray(np.mean(machine.local_preload(one.plan.positions)))


def _right(sheet: DataSheet) -> DataSheet:
    return sheet


def _rigidity(sheet: DataSheet, part: float, convention: str = "preloaded") -> DataSheet:
    screw = sheet.screw
    screw = replace(screw, rigidity=part * screw.rigidity, rigidity_convention=convention)
    if convention in ("clearance", "unknown"):
        screw = replace(screw, rigidity_preload_ratio=None)
    return replace(sheet, screw=screw)


def _horizontal(sheet: DataSheet) -> DataSheet:
    table = replace(sheet.table, counterbalance=0.0)
    return replace(sheet, orientation="horizontal", inclination=0.0, positive="up", table=table)


def _ungeared(sheet: DataSheet) -> DataSheet:
    drive = sheet.drive
    direct = replace(drive, ratio=1.0, belt_stiffness=None, coupling_stiffness=drive.belt_stiffness)
    return replace(sheet, drive=direct)


NOTHING = "nothing"
WORLDS: tuple[World, ...] = (
    World("as the sheet says", "as new", True, NOTHING, "good", "good", _right),
    World("rigidity of unknown convention", "as new", True, NOTHING, "good", "good",
          partial(_rigidity, part=CLEARANCE_K, convention="unknown")),
    World("K with clearance, stated so", "as new", True, NOTHING, "good", "good",
          partial(_rigidity, part=CLEARANCE_K, convention="clearance")),
    World("K with clearance, read as preloaded", "as new", False, NOTHING,
          "good or suspect", "good or suspect",
          partial(_rigidity, part=CLEARANCE_K)),
    World("K at 0.05 Ca, read as at 0.10 Ca", "as new", False, NOTHING, "good or suspect", "good or suspect",
          partial(_rigidity, part=LIGHT_K)),
    World("R_nu,ar, read as preloaded", "as new", False, NOTHING, "good or suspect", "good or suspect",
          partial(_rigidity, part=ISO_K)),
    World("K preloaded, read as with clearance", "as new", False, NOTHING,
          "good or suspect", "good or suspect",
          partial(_rigidity, part=1.0, convention="clearance")),
    World("K preloaded, read as R_nu,ar", "as new", False, NOTHING, "good or suspect", "good or suspect",
          partial(_rigidity, part=1.0, convention="iso")),
    World("bearing −10 %, sound nut", "bearing", False, "bearing preload −10 %", "good", "suspect",
          _right, ratios=(1.0,)),
    World("bearing −10 %, worn nut", "bearing", False, "bearing preload −10 %", "good", "suspect",
          _right, ratios=(0.85, 0.6)),
    *(
        World(f"frame mode at {ratio:g} of the ANF", f"frame {ratio:g}", False, NOTHING,
              "good or suspect", "good or suspect", _right)
        for ratio in FRAME_FREQUENCIES
    ),
    World("vertical", "vertical", True, NOTHING, "good", "good", _right),
    World("vertical, sheet silent", "vertical", False, NOTHING, "suspect", "suspect",
          _horizontal, reanalysed=True),
    World("vertical with counterbalance", "counterbalance", True, NOTHING, "good", "good", _right),
    World("vertical with counterbalance, sheet silent", "counterbalance", False, NOTHING,
          "good or suspect", "good or suspect", _horizontal, reanalysed=True),
    World("transmission 2", "ratio 2", True, NOTHING, "good", "good", _right),
    World("transmission 2, sheet silent", "ratio 2", False, NOTHING, "suspect", "suspect",
          _ungeared, reanalysed=True),
    World("fixed-fixed with pretension", "fixed-fixed", True, NOTHING, "good", "good", _right),
    World("pretension lost", "pretension lost", False, "no pretension", "suspect", "suspect", _right),
    World("gradient of 10 K", "gradient", False, "screw warm at the bearing", "suspect", "suspect", _right),
    World("pitching mode near the ANF", "pitching", False, NOTHING,
          "good or suspect", "good or suspect", _right),
    World("thin oil film", "oil film", False, "oil in the contacts", "good", "suspect", _right),
)  # fmt: skip
