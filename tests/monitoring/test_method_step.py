"""Simulated differences between two revisions of a method: the step is estimated, and monitored across."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from tests.estimation.made_runs import calibrated, run_of
from tests.monitoring.histories import at, history, worn

from ballscrew.modal.run import Run
from ballscrew.monitoring.epochs import METHOD_CHANGED, Event
from ballscrew.monitoring.health import health_state
from ballscrew.monitoring.method_step import LEAST_RUNS, MethodStep, method_step
from ballscrew.monitoring.state import HealthState

MODEL = calibrated()
DIFFERENCE = 3e-3  # of all frequencies, by the newer revision: as about 7 % more preload
SWITCH = 9  # first run by the newer revision


def with_difference(run: Run, difference: float) -> Run:
    """The run as another revision would give it."""
    cells = []
    for cell in run.cells:
        frequency = None if cell.frequency_Hz is None else cell.frequency_Hz * (1 + difference)
        cells.append(replace(cell, frequency_Hz=frequency))
    return replace(run, cells=tuple(cells))


def pairs_of(count: int, scatter: float, seed: int, wear: float = 1.0) -> list[tuple[Run, Run]]:
    """Runs by both revisions, whose differences scatter."""
    random = np.random.default_rng([seed, count])
    pairs = []
    for number in range(count):
        run = run_of(wear, level=1e-4 * random.standard_normal(), seed=number, name=f"{seed} {number}")
        pairs.append((run, with_difference(run, DIFFERENCE + scatter * random.standard_normal())))
    return pairs


def true_step(wear: float = 1.0) -> float:
    """Step by many runs without scatter."""
    step = method_step(pairs_of(LEAST_RUNS, 0.0, 0, wear), MODEL)
    assert step is not None
    return step.value


def estimated(count: int, scatter: float, seed: int) -> MethodStep:
    step = method_step(pairs_of(count, scatter, seed), MODEL)
    assert step is not None
    return step


def changed(step: MethodStep, run: int = SWITCH) -> Event:
    return Event(at(float(run)), METHOD_CHANGED, "", step.value, step.standard_uncertainty)


def switched(runs: Sequence[Run]) -> list[Run]:
    """A history of which the newer runs are by the newer revision."""
    return [*runs[:SWITCH], *[with_difference(run, DIFFERENCE) for run in runs[SWITCH:]]]


def test_a_step_without_scatter_is_that_of_the_levels_of_a_history() -> None:
    plain = history([float(day) for day in range(6)], seed=5)
    mixed = [*plain[:3], *[with_difference(run, DIFFERENCE) for run in plain[3:]]]
    levels = [[run.reading.level for run in state_of(runs).runs[3:]] for runs in (mixed, plain)]
    assert np.subtract(*levels) == pytest.approx(true_step(), rel=0.02)
    step = method_step(pairs_of(5, 0.0, 1), MODEL)
    assert step is not None
    assert step.standard_uncertainty < 1e-6
    assert step.runs == 5


@pytest.mark.parametrize(
    ("count", "trials"), [(3, 40), *[pytest.param(n, 400, marks=pytest.mark.slow) for n in (3, 5, 10)]]
)
def test_the_interval_of_a_step_contains_it_as_often_as_stated(count: int, trials: int) -> None:
    """Also by few runs; and the mean is not biased."""
    true, scatter = true_step(), 2e-4
    steps = [estimated(count, scatter, seed) for seed in range(trials)]
    off = np.array([step.value - true for step in steps])
    inside = np.abs(off) <= 1.96 * np.array([step.standard_uncertainty for step in steps])
    assert abs(np.mean(inside) - 0.95) <= 3 * math.sqrt(0.95 * 0.05 / trials)
    assert abs(np.mean(off)) < 3 * scatter / DIFFERENCE * abs(true) / math.sqrt(count * trials)


def test_bad_and_suspect_runs_and_too_few_give_no_step() -> None:
    pairs = pairs_of(LEAST_RUNS, 1e-4, 1)
    assert method_step(pairs, MODEL) is not None
    suspect = replace(pairs[0][1], quality=replace(pairs[0][1].quality, verdict="suspect"))
    assert method_step([(pairs[0][0], suspect), *pairs[1:]], MODEL) is None
    assert method_step(pairs[1:], MODEL) is None
    assert method_step([], MODEL) is None


def state_of(runs: Sequence[Run], *events: Event) -> HealthState:
    return health_state(runs, MODEL, events=events)


def test_a_change_of_the_method_raises_no_alarm() -> None:
    healthy = history([float(day) for day in range(16)], seed=4)
    unknown = state_of([*[with_difference(run, DIFFERENCE) for run in healthy[:SWITCH]], *healthy[SWITCH:]])
    assert unknown.alarm_at is not None  # the newer results are those of a softer nut, as by wear
    state = state_of(switched(healthy), changed(estimated(6, 1e-4, 3)))
    assert state.alarm_at is None
    assert {run.state for run in state.runs[SWITCH:]} <= {"normal", "watch"}


@pytest.mark.slow
def test_a_change_of_the_method_hides_no_loss() -> None:
    """The alarm is raised within three days of that without a change, and P/P₀ is the same."""
    step = estimated(6, 1e-4, 3)
    wearing = history([float(day) for day in range(45)], worn(25.0, 400.0), seed=4)
    expected, found = state_of(wearing), state_of(switched(wearing), changed(step))
    assert abs(alarm_day(found) - alarm_day(expected)) <= 3
    ratio, true = found.assessed, expected.assessed
    assert ratio is not None
    assert true is not None
    assert ratio.stiffness is not None
    assert true.stiffness is not None
    within = 3 * 3 * step.standard_uncertainty
    assert ratio.stiffness.value == pytest.approx(true.stiffness.value, abs=within)
    assert len(found.epochs) == 1


def alarm_day(state: HealthState) -> int:
    return [run.reading.measured_at for run in state.runs].index(str(state.alarm_at))


def test_the_baseline_may_be_on_either_side_of_a_change() -> None:
    """The reference of an epoch is among its first three runs."""
    runs = history([float(day) for day in range(6)], seed=5)
    step, levels = estimated(8, 0.0, 2), []
    for first in (1, 2, 4):
        mixed = [*runs[:first], *[with_difference(run, DIFFERENCE) for run in runs[first:]]]
        state = state_of(mixed, changed(step, first))
        levels.append([run.reading.level for run in state.runs[3:]])
    plain = [run.reading.level for run in state_of(runs).runs[3:]]
    for each in levels:
        assert each == pytest.approx(plain, abs=5e-4)


def test_a_state_with_a_change_is_read_back() -> None:
    runs = history([float(day) for day in range(4)], seed=6)
    event = changed(MethodStep(-0.02, 1e-3, 4), 2)
    document = state_of(runs, event).to_json()
    (epoch,) = document["epochs"]
    assert epoch["events"] == [event.to_json()]
    assert HealthState.from_json(document).epochs[0].events == (event,)
