"""The axis and the test of the demonstration: a 25 × 10 mm screw, eleven stops, as the paper's bench has."""

from __future__ import annotations

from ballscrew.axis.sheet import Bearing, DataSheet, Drive, Guide, Screw, Table
from ballscrew.fcft.plan import Motion, Plan
from ballscrew.testbed.machine import Machine
from ballscrew.testbed.trip import Rig

LOAD = 50.0
AXIS = DataSheet(
    name="example axis",
    support="fixed-free",
    screw=Screw(
        lead=0.010,
        root_diameter=0.0214,
        nominal_diameter=0.025,
        length=0.90,
        bearing_to_zero=0.12,
        dynamic_load_rating=17e3,
        rigidity=450e6,
        rigidity_preload_ratio=0.10,
        preload_ratio=0.04,
    ),
    bearing=Bearing(180e6),
    table=Table(41.5),
    drive=Drive(rotor_inertia=3.0e-4, coupling_stiffness=5000.0),
    guide=Guide(25.0),
)
PLAN = Plan(
    positions=tuple(round(0.045 * index, 3) for index in range(11)),
    repetitions=3,
    masses=(LOAD,),
    motions=(Motion(speed=0.150, acceleration=2.0, jerk=2000.0, dwell=0.350),),
    source="the example's plan",
)


def example_rig(preload: float | None = None, backlash: float = 0.0) -> Rig:
    """The machine of the example with a preload, new where none is given, N; or with backlash, m."""
    return Rig(Machine(AXIS, AXIS.nominal_preload if preload is None else preload, backlash))
