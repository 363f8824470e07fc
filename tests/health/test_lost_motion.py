"""Lost motion: what a scale beside the table shows at a reversal."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import ballscrew
from ballscrew.base.errors import InputError
from ballscrew.health.lost_motion import lost_motion
from ballscrew.recording.channels import read_channels
from ballscrew.testbed.example import AXIS, LOAD, PLAN
from ballscrew.testbed.experiments import bench
from ballscrew.testbed.machine import Machine
from ballscrew.testbed.run import simulate_run

SHORT = replace(PLAN, positions=PLAN.positions[:4], repetitions=3)


def measured(folder, machine):
    files = simulate_run(replace(bench(AXIS), machine=machine), SHORT, LOAD, folder, seed=1)
    channels = read_channels(folder / "channels.toml")
    run = ballscrew.analyze(files.run)
    return lost_motion(run, files.recordings, channels), run, files, channels


def test_backlash_adds_to_what_friction_winds_up(tmp_path):
    backlash = 4e-6
    sound, *_ = measured(tmp_path / "new", Machine(AXIS, AXIS.nominal_preload))
    played, *_ = measured(tmp_path / "old", Machine(AXIS, 0.0, backlash))
    assert [each.position_m for each in sound] == [0.045, 0.090]
    for one, other in zip(sound, played, strict=True):
        # A sound axis has some too: twice the guide's friction over the axis' stiffness, below 1 µm here.
        assert 0.3e-6 < one.lost_m < 1.2e-6
        assert one.standard_uncertainty_m < 0.1e-6
        assert one.repetitions == 3
        # A nut without preload gives way under friction more than a sound one, so more than the backlash.
        assert backlash < other.lost_m - one.lost_m < backlash + 2e-6


def test_an_axis_without_friction_loses_nothing(tmp_path):
    slippery = replace(AXIS, guide=replace(AXIS.guide, friction=0.5))
    lost, *_ = measured(tmp_path, Machine(slippery, AXIS.nominal_preload))
    assert max(abs(each.lost_m) for each in lost) < 0.15e-6


def test_what_is_missing_is_said(tmp_path):
    _, run, files, channels = measured(tmp_path, Machine(AXIS, AXIS.nominal_preload))
    with pytest.raises(InputError, match="3 recordings, 2 were given"):
        lost_motion(run, files.recordings[:2], channels)
    bare = replace(channels, channels=tuple(c for c in channels.channels if c.location != "table"))
    with pytest.raises(InputError, match='location = "table"'):
        lost_motion(run, files.recordings, bare)
    once = lost_motion(replace(run, files=run.files[:1]), files.recordings[:1], channels)
    assert np.isnan(once[0].standard_uncertainty_m)
    assert once[0].repetitions == 1
