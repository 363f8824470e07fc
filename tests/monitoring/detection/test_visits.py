"""An outlying run is repeated on the same day: when a repeat is requested, and its effect."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import multivariate_normal

from ballscrew.monitoring.detection import kernels as module
from ballscrew.monitoring.detection.chart import Chart, chart_of
from ballscrew.monitoring.detection.chart_state import State, _phase_after
from ballscrew.monitoring.detection.design import Design, LevelStep, design_of
from ballscrew.monitoring.detection.healthy_axes import simulate_healthy
from ballscrew.monitoring.detection.limit_values import RunLimits, VisitLimits
from ballscrew.monitoring.detection.limits import compute_limits
from ballscrew.monitoring.detection.settings import MonitorSettings
from ballscrew.monitoring.detection.statistics import BEGIN, statistics

Array = NDArray[np.float64]
FEW = MonitorSettings(draws=4000)
NEVER = MonitorSettings(draws=4000, repeats_per_year=0)
UNCERTAINTY = 0.003


def repeat_asked(chart: Chart) -> bool:
    return chart.repeat_asked


def epoch(count: int, every: float, settings: MonitorSettings) -> Design:
    days = every * np.arange(count, dtype=np.float64)
    return design_of(days, np.full(count, UNCERTAINTY), 20 + 4 * np.sin(days / 6), (), settings)


def charted(days: Array, level: Array, settings: MonitorSettings = FEW) -> Chart:
    return chart_of(days, level, np.full(len(days), UNCERTAINTY), np.full(len(days), np.nan), (), settings)


def noise(count: int, seed: int = 5) -> Array:
    return 0.45 * UNCERTAINTY * np.random.default_rng(seed).standard_normal(count)


@pytest.mark.parametrize(
    ("days", "first", "again"),
    [
        ([0.0, 1.0, 1.2, 2.0], [0, 1, 3], [-1, 2, -1]),
        ([0.0, 0.1, 0.2, 0.3, 0.4], [0, 2, 4], [1, 3, -1]),
        ([0.0, 0.5, 1.0], [0, 1, 2], [-1, -1, -1]),
        ([3.0], [0], [-1]),
        ([], [], []),
    ],
)
def test_a_visit_is_a_run_or_two_on_one_day(days: list[float], first: list[int], again: list[int]) -> None:
    when, count = np.array(days), len(days)
    found = charted(when, np.zeros(count)).visits
    assert (found.first.tolist(), found.again.tolist()) == (first, again)
    assert len(found.of_run) == count
    assert found.runs(np.arange(len(first))).tolist() == list(range(count))
    assert charted(when, np.zeros(count), NEVER).visits.first.tolist() == list(range(count))


def test_a_run_after_an_event_or_of_another_kind_is_no_repeat() -> None:
    def repeated(*steps: LevelStep, uncertainty: float = 1e-3, warm: float = np.nan) -> bool:
        spread, read = np.array([1e-3, uncertainty]), np.array([np.nan, warm])
        found = chart_of(np.array([0.0, 0.2]), np.zeros(2), spread, read, steps, FEW)
        return bool(found.visits.repeated.any())

    assert repeated()
    assert not repeated(LevelStep(0.1, 0.02))
    assert repeated(LevelStep(0.3, 0.02))
    assert not repeated(uncertainty=3e-3)
    assert not repeated(warm=20.0)


@pytest.mark.parametrize("stays", [0.0, 0.25])
def test_the_density_of_a_pair_is_that_of_a_mixture(stays: float, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_ANYTHING", 0.0)
    size, odd, noise_, doubt = FEW.odd_size**2, FEW.odd, 0.7, 0.3
    expected = 0.0
    for a, b, both in ((0, 0, 0), (1, 0, 0), (0, 1, 0), (1, 1, 0), (1, 1, 1)):
        weight = (odd if a else 1 - odd) * (1.0 if both else odd if b else 1 - odd)
        weight *= (stays if both else 1 - stays) if a else 1.0
        common = doubt + (size - 1) * noise_ if both else doubt
        own = [noise_ if both else noise_ * size**outlying for outlying in (a, b)]
        expected += weight * multivariate_normal.pdf([1.3, 0.4], np.zeros(2), np.diag(own) + common)
    first, repeat = np.array([[1.3]], np.float32), np.array([[0.4]], np.float32)
    settings, found = MonitorSettings(odd_stays=stays), np.empty_like(first)
    module.pair_density(
        first,
        repeat,
        module.run_mixture(noise_, doubt, settings),
        module.pair_mixture(noise_, doubt, settings),
        found,
    )
    assert found[0, 0] / (2 * np.pi) == pytest.approx(expected, rel=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize(("count", "every"), [(60, 1.0), (30, 3.0)])
def test_repeats_and_false_alarms_occur_at_the_stated_rates(count: int, every: float) -> None:
    design = epoch(count, every, MonitorSettings(draws=8000))
    known = compute_limits(design)
    levels, again = simulate_healthy(design, 8000, (5,))
    years = (count - 1) * every / 365.25
    simulated = statistics(design, levels, again, lambda k, _: float(known.repeat[k]))
    # Eight by the odds, and the runs that are far off whatever the odds.
    assert 8 * 0.85 < simulated.repeated.sum() / 8000 / years < 8 * 1.3
    stated = -np.expm1(-0.1 * years)
    alarmed, alone = (
        known.alarms(found).any(axis=0).mean() for found in (simulated, statistics(design, levels))
    )
    assert 0.6 * stated < alarmed < 1.25 * stated
    assert 0.2 * stated < alone < 0.7 * stated  # without repeats half of the allowed probability is not spent


@pytest.mark.parametrize(("rate", "repeats"), [(0.1, 1.0), (50.0, 8.0), (50.0, 300.0), (1.0, 1e6)])
def test_limits_exist_for_any_two_rates(rate: float, repeats: float) -> None:
    settings = MonitorSettings(draws=6000, false_alarms_per_year=rate, repeats_per_year=repeats)
    design = epoch(20, 1.0, settings)
    known = compute_limits(design)
    assert not np.isnan(known.odds).any()
    assert (known.odds[BEGIN:] >= known.watch_odds[BEGIN:]).all()
    levels, again = simulate_healthy(design, 4000, (7,))
    simulated = statistics(design, levels, again, lambda k, _: float(known.repeat[k]))
    stated = -np.expm1(-rate * 19 / 365.25)
    assert known.alarms(simulated).any(axis=0).mean() < 1.3 * stated + 0.003


def test_a_repeat_without_a_request_changes_nothing() -> None:
    days = np.arange(25.0)
    y = noise(25)
    plain = charted(days, y)
    calm = [k for k in range(4, 25) if not repeat_asked(charted(days[: k + 1], y[: k + 1]))]
    when = np.sort(np.concatenate([days, days[calm] + 0.1]))
    level = np.concatenate([y, y[calm] + 0.002])[np.argsort(np.concatenate([days, days[calm] + 0.1]))]
    twice = charted(when, level)
    assert len(calm) > 15
    assert twice.odds[twice.visits.first] == pytest.approx(plain.odds, rel=0.05, abs=0.05)
    assert [twice.states[k] for k in twice.visits.first] == list(plain.states)
    assert set(twice.states[4:]) == set(plain.states[4:])


def test_a_simulated_repeat_agrees_with_the_chart_of_its_runs() -> None:
    days = np.arange(26.0)
    y = noise(26) + 0.004 * np.maximum(days - 18, 0)
    again = noise(26, 6) + 0.004 * np.maximum(days - 18, 0)
    design = design_of(days, np.full(26, UNCERTAINTY), np.full(26, np.nan), (), FEW)
    known = compute_limits(design)
    simulated = statistics(design, y[:, None], again[:, None], lambda k, _: float(known.repeat[k]))
    made = np.flatnonzero(simulated.repeated[:, 0])
    assert len(made)
    order = np.argsort(np.concatenate([days, days[made] + 0.1]))
    when = np.concatenate([days, days[made] + 0.1])[order]
    lost = np.concatenate([y, again[made]])[order]
    found = chart_of(
        when, 1 / (1 - lost) - 1, np.full(len(when), UNCERTAINTY), np.full(len(when), np.nan), (), FEW
    )
    assert found.odds[found.visits.first] == pytest.approx(simulated.odds_first[:, 0], rel=0.05, abs=0.05)
    last = np.maximum(found.visits.first, found.visits.again)
    assert found.odds[last] == pytest.approx(simulated.odds[:, 0], rel=0.05, abs=0.05)
    assert found.ramp[last] == pytest.approx(simulated.ramp[:, 0], rel=0.05, abs=0.1)


def odd_at_the_end(*repeats: float, settings: MonitorSettings = FEW) -> Chart:
    days = np.concatenate([np.arange(21.0), 20 + 0.1 * np.arange(1, 1 + len(repeats))])
    level = np.concatenate([noise(21), repeats])
    level[20] = 0.009
    return charted(days, level, settings)


def test_a_repeat_is_requested_of_an_outlying_run_only() -> None:
    found = odd_at_the_end()
    assert repeat_asked(found)
    assert found.states[-1] in ("normal", "watch")
    assert not repeat_asked(charted(np.arange(20.0), noise(21)[:20]))
    assert not repeat_asked(charted(np.arange(2.0), np.array([0.0, 0.1])))
    assert not repeat_asked(charted(np.zeros(0), np.zeros(0)))


def test_a_repeat_clears_or_confirms_an_outlying_run() -> None:
    first, cleared, confirmed = odd_at_the_end(), odd_at_the_end(0.0), odd_at_the_end(0.0088)
    for chart in (cleared, confirmed):
        assert chart.states[:-1] == first.states
        assert not repeat_asked(chart)
        assert chart.odds[:-1] == pytest.approx(first.odds, rel=1e-4, abs=1e-4)
        assert chart.ramp[:-1] == pytest.approx(first.ramp, rel=1e-6)
    assert cleared.states[-1] == "normal"
    assert cleared.odds[-1] < first.odds[-1] < confirmed.odds[-1]
    assert confirmed.states[-1] == "watch"  # a quarter of the outliers persist: no alarm yet
    assert confirmed.lost[-1] == pytest.approx(1 - 1 / 1.0089, rel=0.01)  # not limited


def test_a_third_run_on_the_day_is_a_visit_of_its_own() -> None:
    found = odd_at_the_end(0.0, 0.0)
    assert found.visits.first[-1] == 22
    assert found.states[-1] == "normal"


def test_no_repeat_is_requested_at_a_rate_of_zero() -> None:
    assert not repeat_asked(odd_at_the_end(settings=NEVER))
    found = odd_at_the_end(0.0088, settings=NEVER)
    assert not found.visits.repeated.any()
    assert np.isinf(found.limits.repeat).all()


# The least is nine times the prior scatter: of nearer outliers a quarter persist in the repeat.
@pytest.mark.parametrize("size", [0.016, 0.05, 1.0, 100.0])
def test_a_repeat_is_requested_of_a_run_far_beyond_wear(size: float) -> None:
    level = noise(21)
    level[20] = size
    assert repeat_asked(charted(np.arange(21.0), level))
    level[20] = -min(size, 0.5)  # wear does not make an axis stiffer
    assert not repeat_asked(charted(np.arange(21.0), level))
    both = charted(np.append(np.arange(21.0), 20.1), np.append(noise(21)[:20], [size, size]))
    assert both.states[-1] == "alarm"
    assert "alarm" not in both.states[:-1]


def test_an_alarm_requests_no_repeat() -> None:
    days = np.arange(30.0)
    found = charted(days, noise(30) + 0.006 * np.maximum(days - 19.5, 0))
    assert found.states[-1] == "alarm"
    assert not repeat_asked(found)


def phase_after(first: float, again: float | None, number: int = 4) -> tuple[State, int]:
    """State after a normal one, given the statistics of a run and its repeat."""
    limits = RunLimits(5.0, 5.0, 2.5, 2.5)
    last = first if again is None else again
    found = SimpleNamespace(
        ramp_first=[first], odds_first=[first], ramp=[last], odds=[last], repeated=[again is not None]
    )
    known = VisitLimits(limits, limits, 0.0, 0.0)
    return _phase_after(("normal", 1), number, found, known, FEW, repeat=again is not None)  # type: ignore[arg-type]


def test_a_repeat_replaces_its_run_in_the_states() -> None:
    assert phase_after(3.0, None) == ("watch", 0)
    assert phase_after(3.0, 0.0) == ("normal", 2)
    assert phase_after(9.0, 0.0) == ("alarm", 1)
    assert phase_after(9.0, 9.0, number=2) == ("learning", 0)


def test_repeats_change_no_earlier_state() -> None:
    random = np.random.default_rng(8)
    days = np.sort(np.concatenate([np.arange(24.0), np.arange(0, 24, 4) + 0.2]))
    level = (
        noise(len(days), 9)
        + 0.003 * np.maximum(days - 16, 0)
        + 0.006 * (random.uniform(size=len(days)) < 0.1)
    )
    whole = charted(days, level)
    for count in (3, 8, 14, 19, 26):
        part = charted(days[:count], level[:count])
        assert part.states == whole.states[:count]
        assert part.limits.odds == pytest.approx(whole.limits.odds[:count])
        assert part.limits.ramp == pytest.approx(whole.limits.ramp[:count])


def test_wear_is_found_sooner_with_repeats_than_without() -> None:
    """Each with limits for the same rate of false alarms."""
    sooner, days = [], np.arange(30.0)
    with_them, without = (
        design_of(days, np.full(30, UNCERTAINTY), np.full(30, np.nan), (), settings)
        for settings in (FEW, NEVER)
    )
    known, alone = compute_limits(with_them), compute_limits(without)
    for seed in range(24):
        change = 0.0028 * np.maximum(days - 19.6, 0)
        y, again = noise(30, seed) + change, noise(30, 100 + seed) + change
        simulated = statistics(with_them, y[:, None], again[:, None], lambda k, _: float(known.repeat[k]))
        plain = statistics(without, y[:, None])
        first = [int(np.argmax(row)) for row in (known.alarms(simulated)[:, 0], alone.alarms(plain)[:, 0])]
        assert min(first) >= 20
        sooner.append(first[1] - first[0])
    assert np.mean(sooner) > 0


def test_no_state_before_three_visits() -> None:
    days = np.array([0.0, 0.1, 1.0, 1.1, 2.0, 2.1])
    assert charted(days, noise(6)).states == ("learning",) * 6
    assert BEGIN == 3
