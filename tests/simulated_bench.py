"""The files of the bench, simulated by the testbed: for machines without third-party recordings."""

from __future__ import annotations

import json
from pathlib import Path
from tempfile import TemporaryDirectory

from ballscrew.axis.sheet_file import read_axis
from ballscrew.fcft.plan import read_plan
from ballscrew.testbed.instruments import Instruments
from ballscrew.testbed.machine import Machine
from ballscrew.testbed.run import channels_toml, simulate_run, truth
from ballscrew.testbed.trip import Rig, Variation

LOAD = 100.0
PRELOADS = {"preload-4-percent": 600.0, "preload-2-percent": 300.0}

AXIS = """
name = "bench"
support = "fixed-free"
bearing.stiffness = "160 N/um"
table.mass = "32 kg"
drive.rotor_inertia = "4.2e-4 kg m^2"
guide.friction = "25 N"
[screw]
lead = "10 mm"
root_diameter = "17.6 mm"
length = "650 mm"
bearing_to_zero = "80 mm"
dynamic_load_rating = "15 kN"
rigidity = "480 N/um"
rigidity_preload_ratio = 0.10
preload_ratio = 0.04
"""
PLAN = """
positions = { start = "0 mm", stop = "450 mm", step = "45 mm" }
repetitions = 3
masses = ["100 kg"]
motion = { speed = "150 mm/s", acceleration = "2.5 m/s^2", jerk = "1500 m/s^3", dwell = "350 ms" }
"""


def simulate_bench(folder: Path) -> None:
    """Write recordings of both states, three TOML files and ``truth.json``, named as those of the bench."""
    (folder / "axis.toml").write_text(AXIS, encoding="utf-8")
    (folder / "plan.toml").write_text(PLAN, encoding="utf-8")
    sheet, plan = read_axis(folder / "axis.toml"), read_plan(folder / "plan.toml")
    true = {}
    for seed, (state, preload) in enumerate(PRELOADS.items()):
        rig = Rig(
            Machine(sheet, preload),
            instruments=Instruments(torque_constant=0.45),
            variation=Variation(speed=0.0),
        )
        with TemporaryDirectory(dir=folder) as separate:
            files = simulate_run(rig, plan, LOAD, Path(separate), seed=seed, workers=1)
            for number, path in enumerate(files.recordings, start=1):
                path.rename(folder / f"{state}-trip{number}.h5")
        known = truth(rig, plan, LOAD)
        true[state] = {"preload_N": preload} | {
            name: {f"{float(place):.3f}": frequency for place, frequency in known[name].items()}  # type: ignore[attr-defined]
            for name in ("axial_natural_frequency_Hz", "rotor_held_frequency_Hz")
        }
    channels = 'sample_rate = "12.8 kHz"\n' + channels_toml(rig)
    (folder / "channels.toml").write_text(channels, encoding="utf-8")
    (folder / "truth.json").write_text(json.dumps(true), encoding="utf-8")
