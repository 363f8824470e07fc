"""A simulated plant of twelve axes: what they are, and what happens to each in two years.

Weeks are counted from 0; the test of the newest, :data:`WEEKS` − 1, is in the days before the present. The
same seed gives the same axes and the same numbers, whenever the plant is made.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from datetime import datetime, timedelta

import numpy as np

from ballscrew.axis.sheet import Bearing, DataSheet
from ballscrew.fcft.plan import Motion, Plan
from ballscrew.testbed.example import AXIS, LOAD, example_rig
from ballscrew.testbed.instruments import Instruments
from ballscrew.testbed.machine import Machine
from ballscrew.testbed.run import channels_toml
from ballscrew.testbed.temperature import warmed
from ballscrew.testbed.trip import Disturbances, Rig

WEEKS = 104
"""Weeks of the history."""

SITE = "simulated plant"
"""Beginning of the name of each site."""

CHANNELS = channels_toml(example_rig())
"""Channel map of every axis."""

_RATE = 5000.0  # Hz, of the recordings
_SPREAD = 0.03  # of rigidity, bearing and preload from axis to axis, relative to the data sheet
_MEAN = 22.0  # °C
_REGULATED = 0.5  # K, of a hall with regulated temperature
_SCREW = 0.1  # K by which a screw is warmer than its nut, for each kelvin of the hall
_YEAR = 52.0  # weeks

Times = dict[int, Instruments]


@dataclass(frozen=True, slots=True)
class AxisType:
    """A type of axes: their data sheet and their test.

    Parameters
    ----------
    sheet : DataSheet
        With another name for each axis.
    plan : Plan
        The test, with its one load.
    """

    sheet: DataSheet
    plan: Plan

    @property
    def load(self) -> float:
        """Load on the table, kg."""
        return self.plan.masses[0]


@dataclass(frozen=True)
class PlantAxis:
    """An axis of the plant, and what happens to it.

    Parameters
    ----------
    name, machine, hall : str
        Name of the axis, of its machine, and of the hall.
    type : AxisType
        Data sheet and test.
    hour : float
        Hours before the present at which the test of the newest week was.
    first, last : int
        Weeks of the first and of the last test.
    worn : tuple of float, optional
        Week in which the nut begins to wear, and weeks in which it would lose its preload.
    replaced : int, optional
        Week in which the nut was replaced, after the test.
    bearing : tuple of float, optional
        Week in which the support bearing begins to lose preload, and the part of it that it loses a week.
    swing : float
        Amplitude of the temperature of the hall, K.
    loose : dict of int to Instruments
        Instruments from a week on.
    recorded : tuple of int
        Weeks whose recordings are stored, besides those of :meth:`templates`.
    like : str, optional
        Axis of the same type, with analysed runs of its own, whose first one is imitated; by default the axis
        itself. Alone in a plant an axis imitates itself.
    calibrated : bool
        Whether there is a model of the axis.
    raised : int, optional
        Week of the test at which the alarm is raised.
    story : tuple of (float, str, str)
        What people did: week, ``acknowledge``, ``close`` or the kind of an event, and a sentence.
    draw : int
        Added to the seed of the plant.
    """

    name: str
    machine: str
    hall: str
    type: AxisType
    hour: float
    first: int = 0
    last: int = WEEKS - 1
    worn: tuple[float, float] | None = None
    replaced: int | None = None
    bearing: tuple[float, float] | None = None
    swing: float = _REGULATED
    loose: Times = field(default_factory=dict)
    recorded: tuple[int, ...] = (WEEKS // 2, WEEKS - 1)
    like: str | None = None
    calibrated: bool = True
    raised: int | None = None
    story: tuple[tuple[float, str, str], ...] = ()
    draw: int = 0

    @property
    def effort(self) -> int:
        """Number of motions that are analysed before the others are imitated."""
        return len(self.templates) * len(self.type.plan.motions)

    @property
    def sheet(self) -> DataSheet:
        """Data sheet of the axis."""
        return replace(self.type.sheet, name=self.name)

    @property
    def templates(self) -> tuple[int, ...]:
        """Weeks whose recordings are analysed before others are imitated by them."""
        if not self.calibrated:
            return ()
        first = () if self.like else (self.first,)
        return (*first, *sorted(self.loose))

    @property
    def weeks(self) -> range:
        """Weeks of its tests."""
        return range(self.first, self.last + 1)

    def measured_at(self, week: int, present: datetime) -> datetime:
        """Time of a test, to the minute."""
        past = timedelta(weeks=WEEKS - 1 - week, hours=self.hour)
        return (present - past).replace(second=0, microsecond=0)


def temperature(axis: PlantAxis, week: int, seed: int) -> float:
    """Temperature of the axis at a test, °C."""
    chance = random_of(axis, seed, week, 1).standard_normal()
    season = math.sin(2 * math.pi * (week - WEEKS) / _YEAR)
    return round(_MEAN + axis.swing * (0.8 * season + 0.3 * float(chance)), 1)


def rig_of(axis: PlantAxis, week: int, seed: int) -> Rig:
    """An axis as it is at a test: its machine and its instruments.

    Parameters
    ----------
    axis : PlantAxis
        The axis.
    week : int
        Of the test.
    seed : int
        Of the plant.

    Returns
    -------
    Rig
        With true values that differ from those of the data sheet.
    """
    machine = _new_machine(axis, seed)
    preload = machine.preload
    if axis.worn is not None:
        begin, life = axis.worn
        lost = min(max(week - begin, 0.0) / life, 0.95)
        if axis.replaced is None or week <= axis.replaced:
            preload *= (1 - lost) ** 1.5
    bearing = 1.0
    if axis.bearing is not None:
        begin, rate = axis.bearing
        bearing = 1 - rate * max(week - begin, 0.0)
    machine = replace(machine, preload=preload, bearing_preload_ratio=bearing)
    machine = warmed(machine, _SCREW * (temperature(axis, week, seed) - _MEAN))
    instruments = Instruments()
    for begin, others in axis.loose.items():
        if week >= begin:
            instruments = others
    ripple = Disturbances(ripple_seed=int(random_of(axis, seed).integers(1000)))
    return Rig(machine, disturbances=ripple, instruments=instruments, sample_rate=_RATE)


def _new_machine(axis: PlantAxis, seed: int) -> Machine:
    """Machine of an axis when new."""
    sheet, screw = axis.sheet, axis.sheet.screw
    rigidity, bearing, preload = 1 + _SPREAD * random_of(axis, seed).uniform(-1, 1, 3)
    screw = replace(screw, rigidity=rigidity * screw.rigidity, preload_ratio=preload * screw.preload_ratio)
    sheet = replace(sheet, screw=screw, bearing=Bearing(bearing * sheet.bearing.stiffness))
    return Machine(sheet, sheet.nominal_preload)


def random_of(axis: PlantAxis, seed: int, *stream: int) -> np.random.Generator:
    """Random numbers of an axis, which do not depend on the other axes.

    Parameters
    ----------
    axis : PlantAxis
        The axis.
    seed : int
        Of the plant.
    *stream : int
        Week and purpose: each has numbers of its own.

    Returns
    -------
    Generator
        In its initial state.
    """
    return np.random.default_rng([seed + axis.draw, *stream, *axis.name.encode()])


def _type(
    positions: tuple[float, ...], load: float, accelerations: tuple[float, ...] = (2.0,), **changes: float
) -> AxisType:
    """A type like the example's axis, with some changes."""
    motions = tuple(Motion(speed=0.15, acceleration=a, jerk=2000.0, dwell=0.3) for a in accelerations)
    screw = replace(AXIS.screw, rigidity=changes.get("rigidity", AXIS.screw.rigidity))
    table = replace(AXIS.table, mass=changes.get("table", AXIS.table.mass))
    return AxisType(replace(AXIS, screw=screw, table=table), Plan(positions, 3, (load,), motions))


_RECORDED = (WEEKS // 4, WEEKS // 2, WEEKS - 1)  # of an axis whose first test is imitated
_STOPS = (0.0, 0.13, 0.27, 0.4)
_MORE_STOPS = (0.0, 0.1, 0.2, 0.3, 0.4)
_MILL = _type(_STOPS, LOAD)
_LATHE = _type(_MORE_STOPS, 70.0, (1.0, 5.0), rigidity=480e6)  # two accelerations separate bearing and nut
_GRINDER = _type(_STOPS, 20.0, table=60.0)
_GANTRY = _type((0.0, 0.15, 0.3, 0.45), 40.0, table=55.0)
_LOOSE = Instruments(pitch_frequency=300.0, pitch_damping=0.05, pitch=(0.0, 1.0))
_HANGING = Instruments(pitch_frequency=1.0, pitch_damping=0.3, pitch=(0.0, 1.0))

PLANT = (
    PlantAxis("mill 4 X", "mill 4", "hall 1", _MILL, 20.0, worn=(96.0, 45.0)),
    PlantAxis("mill 4 Y", "mill 4", "hall 1", _MILL, 19.0, recorded=_RECORDED, like="mill 4 X"),
    PlantAxis(
        "mill 4 Z", "mill 4", "hall 1", _MILL, 18.0, worn=(101.0, 180.0), recorded=(26, 52, 78),
        like="mill 4 X", draw=1,
    ),
    PlantAxis(
        "mill 7 X", "mill 7", "hall 1", _MILL, 44.0, worn=(40.0, 30.0), replaced=46, raised=42,
        recorded=_RECORDED, like="mill 4 X",
        story=(
            (42.3, "acknowledge", "A nut is ordered."),
            (46.5, "nut replaced", "New nut with new balls."),
            (47.6, "close", "The old nut had lost a quarter of its preload; its balls were worn."),
        ),
    ),
    PlantAxis("mill 7 Y", "mill 7", "hall 1", _MILL, 43.0, swing=7.0, recorded=_RECORDED, like="mill 4 X"),
    PlantAxis(
        "mill 7 Z", "mill 7", "hall 1", _MILL, 42.0, loose={97: _LOOSE, 101: _HANGING}, like="mill 4 X",
    ),
    PlantAxis(
        "lathe 2 X", "lathe 2", "hall 2", _LATHE, 68.0, bearing=(94.0, 0.03), raised=95,
        story=((95.4, "acknowledge", "The bearing will be adjusted at the next service."),),
    ),
    PlantAxis("lathe 2 Z", "lathe 2", "hall 2", _LATHE, 67.0, recorded=_RECORDED, like="lathe 2 X"),
    PlantAxis("grinder 1 X", "grinder 1", "hall 2", _GRINDER, 120.0, last=101, recorded=(52, 101)),
    PlantAxis("grinder 1 Z", "grinder 1", "hall 2", _GRINDER, 92.0, recorded=_RECORDED, like="grinder 1 X"),
    PlantAxis("gantry 3 X", "gantry 3", "hall 2", _GANTRY, 6.0, first=101, recorded=(102, 103)),
    PlantAxis(
        "gantry 3 Y", "gantry 3", "hall 2", _GANTRY, 5.0, first=101, recorded=(101, 102, 103),
        calibrated=False,
    ),
)  # fmt: skip
"""Its axes: four healthy, the others each with a trouble of its own."""
