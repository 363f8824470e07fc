"""A good run, once simulated here and once from the bench: what holds for one must hold for the other."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import pytest
from tests.recording import synthetic

from ballscrew.axis.sheet import DataSheet
from ballscrew.axis.sheet_file import read_axis
from ballscrew.base.errors import MeasurementError
from ballscrew.fcft.plan import Plan, read_plan
from ballscrew.recording.aligned import align
from ballscrew.recording.channels import read_channels
from ballscrew.recording.kinematics import kinematics
from ballscrew.recording.load import read_recording
from ballscrew.recording.phases import find_phases
from ballscrew.recording.quality.completeness import check_run
from ballscrew.recording.quality.finding import Finding
from ballscrew.recording.quality.motion import check_motion
from ballscrew.recording.quality.signals import check_signals
from ballscrew.recording.recording import Recording
from ballscrew.recording.rigid_body import normal_equations, solve
from ballscrew.recording.transients import cut, label


@dataclass(frozen=True)
class Run:
    """Recordings that belong together, and what is said of them."""

    recordings: tuple[Recording, ...]
    plan: Plan
    sheet: DataSheet
    load: float

    @property
    def one(self) -> Recording:
        return self.recordings[0]

    @property
    def short(self) -> Run:
        """The first recording as a run of its own."""
        return replace(self, recordings=self.recordings[:1], plan=replace(self.plan, repetitions=1))


@pytest.fixture(scope="session", params=["synthetic", "bench"])
def run(request: pytest.FixtureRequest) -> Run:
    if request.param == "synthetic":
        trip = synthetic.recorded(synthetic.synthetic_trip())
        return Run((trip,), synthetic.PLAN, synthetic.SHEET, synthetic.LOAD)
    bench = request.getfixturevalue("bench")
    channels = read_channels(bench / "channels.toml")
    files = [bench / f"preload-4-percent-trip{trip}.h5" for trip in (1, 2, 3)]
    recordings = tuple(read_recording(file, channels) for file in files)
    return Run(recordings, read_plan(bench / "plan.toml"), read_axis(bench / "axis.toml"), 100.0)


def moved(recording: Recording, plan: Plan | None = None) -> tuple[Finding, ...]:
    """Findings of the second part."""
    aligned = align(recording)
    motion = kinematics(aligned.position, aligned.rate)
    return check_motion(recording, aligned, motion, find_phases(motion), plan)


def findings_of(recording: Recording, plan: Plan | None = None) -> tuple[Finding, ...]:
    """Findings of the first two parts; the second only where the first lets a recording through."""
    first = check_signals(recording)
    return first if any(f.severity == "bad" for f in first) else first + moved(recording, plan)


_CUT: dict[int, tuple[Recording, Any]] = {}


def _cut(recording: Recording) -> Any:
    """Measured parts of a recording; the last few are cached, since many tests use the same."""
    known = _CUT.get(id(recording))
    if known is None or known[0] is not recording:
        aligned = align(recording)
        motion = kinematics(aligned.position, aligned.rate)
        known = recording, (aligned, find_phases(motion), normal_equations(motion, aligned.input)[0])
        if len(_CUT) < 8:
            _CUT[id(recording)] = known
    return known[1]


def ran(
    recordings: tuple[Recording, ...], plan: Plan | None, sheet: DataSheet | None, load: float | None
) -> tuple[Finding, ...]:
    """Findings of the third part."""
    segments, sums = [], None
    for index, recording in enumerate(recordings):
        aligned, phases, own = _cut(recording)
        segments += cut(aligned, phases, index)
        sums = own if sums is None else sums + own
    assert sums is not None
    table = label(segments, aligned, load or 0.0, plan)
    lead = 0.01 if sheet is None else sheet.screw.lead
    try:
        rigid = solve(sums).scaled(2 * math.pi / lead)
    except MeasurementError:
        rigid = None
    return check_run(table, plan, sheet, load, rigid)


def codes(findings: tuple[Finding, ...]) -> dict[str, str]:
    """Code to severity, the worst where one occurs twice."""
    ordered = sorted(findings, key=lambda f: f.severity, reverse=True)
    return {finding.code: finding.severity for finding in ordered}
