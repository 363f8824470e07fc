"""Lost motion: what a scale beside the table shows at a reversal."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import ballscrew
from ballscrew.base.errors import InputError
from ballscrew.modal.run import Run
from ballscrew.recording.channels import read_channels
from ballscrew.testbed.example import AXIS, LOAD, PLAN
from ballscrew.testbed.experiments import bench
from ballscrew.testbed.machine import Machine
from ballscrew.testbed.run import simulate_run

SHORT = replace(PLAN, positions=PLAN.positions[:4], repetitions=3)


def simulated(folder, machine):
    return simulate_run(replace(bench(AXIS), machine=machine), SHORT, LOAD, folder, seed=1)


def measured(files):
    """Analysed by the faster method: lost motion has nothing to do with the frequencies."""
    return ballscrew.analyze(files.run, method="paper")


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """Recordings of a sound axis."""
    return simulated(tmp_path_factory.mktemp("sound"), Machine(AXIS, AXIS.nominal_preload))


def test_backlash_adds_to_what_friction_winds_up(files, tmp_path):
    backlash = 4e-6
    sound = measured(files)
    played = measured(simulated(tmp_path, Machine(AXIS, 0.0, backlash)))
    assert [each.position_m for each in sound.lost_motion] == [0.045, 0.090]
    for item, other in zip(sound.lost_motion, played.lost_motion, strict=True):
        # A sound axis has some too: twice the guide's friction over the axis' stiffness, below 1 µm here.
        assert 0.3e-6 < item.lost_m < 1.2e-6
        assert item.standard_uncertainty_m < 0.1e-6
        assert item.repetitions == 3
        # A nut without preload gives way under friction more than a sound one, so more than the backlash.
        assert backlash < other.lost_m - item.lost_m < backlash + 2e-6


def test_an_axis_without_friction_loses_nothing(tmp_path):
    slippery = replace(AXIS, guide=replace(AXIS.guide, friction=0.5))
    run = measured(simulated(tmp_path, Machine(slippery, AXIS.nominal_preload)))
    assert max(abs(each.lost_m) for each in run.lost_motion) < 0.15e-6


def test_without_a_scale_nothing_is_reported(files):
    run, folder = ballscrew.analyze(files.run), files.run.parent
    channels = read_channels(folder / "channels.toml")
    bare = replace(channels, channels=tuple(c for c in channels.channels if c.location != "table"))
    plan, axis = folder / "plan.toml", folder / "axis.toml"
    without = ballscrew.analyze(files.recordings, channels=bare, axis=axis, plan=plan, mass=LOAD)
    assert without.lost_motion == ()
    assert [c.frequency_Hz for c in without.cells] == [c.frequency_Hz for c in run.cells]


def test_one_trip_shows_no_scatter_and_is_read_back(files):
    given = {name: files.run.parent / f"{name}.toml" for name in ("channels", "axis", "plan")}
    once = ballscrew.analyze(files.recordings[:1], **given, mass=LOAD, method="paper")
    assert np.isnan(once.lost_motion[0].standard_uncertainty_m)
    assert once.lost_motion[0].repetitions == 1
    document = once.to_json()
    assert document["lost_motion"][0]["standard_uncertainty_m"] is None
    assert np.isnan(Run.from_json(document).lost_motion[0].standard_uncertainty_m)
    document["lost_motion"][0]["lost_m"] = "x"
    with pytest.raises(InputError, match="not a run of ballscrew"):
        Run.from_json(document)
