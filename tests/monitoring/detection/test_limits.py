"""Statistics and their limits: false alarms at the stated rate, detected ramps, bounded outliers."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from ballscrew.base.errors import InputError
from ballscrew.monitoring.detection.chart import chart_of
from ballscrew.monitoring.detection.chart_state import BaselineVisits, State, _next_phase
from ballscrew.monitoring.detection.design import Design, LevelStep, design_of
from ballscrew.monitoring.detection.healthy_axes import simulate_healthy
from ballscrew.monitoring.detection.limit_values import ControlLimits, RunLimits
from ballscrew.monitoring.detection.limits import compute_limits
from ballscrew.monitoring.detection.ramp import add_ramp, no_ramp, onsets
from ballscrew.monitoring.detection.settings import MonitorSettings
from ballscrew.monitoring.detection.statistics import BEGIN, Statistics, statistics

Array = NDArray[np.float64]
FEW = MonitorSettings(draws=4000)


def epoch(
    count: int, every: float = 1.0, settings: MonitorSettings = FEW, steps: tuple[LevelStep, ...] = ()
) -> Design:
    days = every * np.arange(count, dtype=np.float64)
    return design_of(days, np.full(count, 0.003), 20 + 4 * np.sin(days / 6), steps, settings)


def alarms(
    design: Design, known: ControlLimits, *, all_repeated: bool = False
) -> tuple[NDArray[np.bool_], Statistics]:
    """Alarms of healthy histories with repeats as requested, or always."""
    levels, again = simulate_healthy(design, 6000, (5,))
    found = statistics(design, levels, again, None if all_repeated else lambda k, _: float(known.repeat[k]))
    return known.alarms(found), found


@pytest.mark.parametrize(("count", "every"), [(60, 1.0), (27, 3.0)])
def test_false_alarms_come_at_the_stated_rate(count: int, every: float) -> None:
    settings = MonitorSettings(draws=4000, false_alarms_per_year=1.0)
    design = epoch(count, every, settings)
    known = compute_limits(design)
    alarmed = alarms(design, known)[0].any(axis=0)
    stated = -np.expm1(-(count - 1) * every / 365.25)
    assert 0.5 * stated < alarmed.mean() < 1.2 * stated


def test_limits_of_the_first_runs_do_not_depend_on_later_ones() -> None:
    long, short = compute_limits(epoch(30)), compute_limits(epoch(20))
    for name in ("ramp", "odds", "watch_ramp", "watch_odds", "spent"):
        assert np.array_equal(getattr(long, name)[:20], getattr(short, name))


def late(n: int, change: Array, *, step: bool, warm: bool) -> tuple[str, ...]:
    """States of the first n of 17 runs; a step or the first temperature comes with run 14."""
    random = np.random.default_rng(3)
    days = np.arange(17.0)
    level = 1.2e-4 * random.standard_normal(17) + change
    read = np.where((days >= 14) & warm, 20 + days, np.nan)
    steps = (LevelStep(13.5, 0.02),) if step else ()
    return chart_of(days[:n], level[:n], np.full(n, 3e-4), read[:n], steps, FEW).states


@pytest.mark.parametrize(("step", "warm"), [(True, False), (False, True), (True, True)])
@pytest.mark.parametrize("slope", [0.7e-4, 1e-4, 1.5e-4, 2e-4])
def test_the_first_run_after_a_step_or_with_a_temperature_changes_no_earlier_state(
    step: bool, warm: bool, slope: float
) -> None:
    change = slope * np.maximum(np.arange(17.0) - 6, 0)
    assert late(14, change, step=step, warm=warm) == late(17, change, step=step, warm=warm)[:14]


def test_a_later_step_or_temperature_leaves_earlier_limits_as_they_were() -> None:
    days = np.arange(17.0)
    read = np.where(days >= 14, 20 + days, np.nan)
    uncertainty = np.full(17, 3e-4)
    plain, other = (
        compute_limits(design_of(days, uncertainty, warm, steps, FEW))
        for warm, steps in ((np.full(17, np.nan), ()), (read, (LevelStep(13.5, 0.02), LevelStep(15.5, 0.01))))
    )
    assert np.allclose(plain.ramp[3:14], other.ramp[3:14], rtol=1e-4)
    assert np.allclose(plain.odds[3:14], other.odds[3:14], rtol=1e-4)
    assert not np.allclose(plain.ramp[14:], other.ramp[14:], rtol=1e-2)


def test_watch_lies_below_alarm_and_limits_are_infinite_while_learning() -> None:
    known = compute_limits(epoch(25))
    assert np.isinf(known.ramp[:BEGIN]).all()
    assert (known.watch_ramp[BEGIN:] <= known.ramp[BEGIN:]).all()
    assert np.median(known.watch_ramp[BEGIN:]) < 0.9 * np.median(known.ramp[BEGIN:])
    assert (known.watch_odds[BEGIN:] <= known.odds[BEGIN:]).all()


def test_the_ramp_is_that_of_generalised_least_squares() -> None:
    """Explicit fit of level, temperature and slope, with priors as rows."""
    design, random = epoch(12), np.random.default_rng(3)
    y = random.normal(size=12) * 0.002 + 0.001 * np.maximum(design.days - 6, 0)
    state, found = no_ramp(design, 1), None
    for k in range(12):
        state, found = add_ramp(design, k, state, y[k : k + 1], np.array([FEW.scale]))
    best = []
    for onset in onsets(11):
        slope = np.maximum(design.days - design.days[onset], 0)
        rows = np.column_stack([design.columns, slope]) / np.sqrt(design.noise)[:, None]
        rows = np.vstack([rows, [0, 1 / design.sizes[1], 0, 0], [0, 0, 1 / design.sizes[2], 0]])
        value = np.append(y / np.sqrt(design.noise), [0.0, 0.0])
        covariance = np.linalg.inv(rows.T @ rows)
        best.append((covariance @ rows.T @ value)[-1] / np.sqrt(covariance[-1, -1]))
    assert found is not None
    assert found.largest[0] == pytest.approx(max(best), rel=1e-5)
    assert found.smallest[0] == pytest.approx(min(best), rel=1e-5)
    assert found.onset[0] == onsets(11)[int(np.argmax(best))]


def test_onsets_are_dense_near_today_and_begin_at_the_first_run() -> None:
    assert onsets(1).tolist() == [0]
    assert onsets(10).tolist() == [0, 2, 4, 6, 7, 8, 9]


def test_onsets_are_anchored_and_few() -> None:
    """None is added later, and none is further from the next than half of its age."""
    for k in range(2, 400):
        assert set(onsets(k)) - {k - 1} <= set(onsets(k - 1))
        assert (np.diff(onsets(k)) <= np.maximum((k - onsets(k)[:-1]) / 2, 1)).all()
    assert len(onsets(20_000)) < 45


def states_of(
    change: Array, count: int = 30, seed: int = 1, steps: tuple[LevelStep, ...] = ()
) -> tuple[str, ...]:
    random = np.random.default_rng(seed)
    days = np.arange(float(count))
    warm = 20 + 4 * np.sin(days / 6)
    level = 0.0012 * random.standard_normal(count) + 0.003 * (warm - 20) + change
    return chart_of(days, level, np.full(count, 0.003), warm, steps, FEW).states


def test_a_ramp_alarms_soon_and_stays() -> None:
    found = states_of(0.006 * np.maximum(np.arange(30) - 19.5, 0))
    first = found.index("alarm")
    assert 20 <= first <= 23
    assert set(found[first:]) == {"alarm"}
    assert "alarm" not in found[:20]


def test_warmth_alone_does_not_alarm() -> None:
    assert not {"alarm", "watch"} & set(states_of(np.zeros(30)))


@pytest.mark.parametrize("where", [12, 20, 29])
def test_one_outlier_does_not_alarm(where: int) -> None:
    change = np.zeros(30)
    change[where] = 0.012
    assert "alarm" not in states_of(change)


def test_a_known_step_does_not_alarm_and_an_unknown_one_does() -> None:
    change = np.where(np.arange(30) >= 18, 0.012, 0.0)
    assert "alarm" not in states_of(change, steps=(LevelStep(17.5, 0.01),))
    assert "alarm" in states_of(change)


@pytest.mark.parametrize(
    "when", [9.5, 17.5, *(pytest.param(when, marks=pytest.mark.slow) for when in (7.5, 12.5, 22.5))]
)
def test_a_step_does_not_include_the_loss_by_wear(when: float) -> None:
    days = np.arange(30.0)
    lost = 0.005 * np.maximum(days - 4.5, 0) if when > 20 else 0.005 * np.maximum(days - 12, 0)
    noise = 3e-4 * np.random.default_rng(4).standard_normal(30)
    for true in (0.0, 0.015):
        y = lost + true * (days > when) + noise
        steps = (LevelStep(when, 0.02),)
        found = chart_of(days, 1 / (1 - y) - 1, np.full(30, 5e-4), np.full(30, np.nan), steps, FEW)
        spread = np.sqrt(found.covariance[1, 1])
        assert abs(found.coefficients[1] - true) < max(3 * spread, 0.005)  # a day of wear
        assert spread < 0.004


def test_the_excess_of_a_large_step_is_wear() -> None:
    days = np.arange(30.0)
    y = 0.3 * (days > 17.5) + 3e-4 * np.random.default_rng(4).standard_normal(30)
    found = chart_of(
        days, 1 / (1 - y) - 1, np.full(30, 5e-4), np.full(30, np.nan), (LevelStep(17.5, 0.02),), FEW
    )
    assert found.coefficients[1] == pytest.approx(0.06)
    assert found.states[-1] == "alarm"


@pytest.mark.slow
@pytest.mark.parametrize("when", [6.5, 10.5, 20.5])
def test_a_healthy_greased_axis_alarms_at_the_stated_rate(when: float) -> None:
    settings = MonitorSettings(draws=4000, false_alarms_per_year=1.0)
    design = epoch(40, 1.0, settings, (LevelStep(when, 0.02),))
    known = compute_limits(design)
    alarmed = alarms(design, known)[0].any(axis=0)
    assert alarmed.mean() < 1.2 * -np.expm1(-39 / 365.25)


def test_wear_within_the_baseline_is_detected() -> None:
    assert "alarm" in states_of(0.01 * np.arange(30.0, dtype=np.float64))[:10]


def test_missing_temperatures_are_allowed() -> None:
    days = np.arange(20.0)
    warm = np.where(days % 3 == 0, np.nan, 20 + days % 5)
    found = chart_of(days, np.zeros(20), np.full(20, 0.003), warm, (), FEW)
    assert set(found.states) == {"learning", "normal"}
    assert found.design.unknown_temperature[3] > 0 == found.design.unknown_temperature[0]


def test_an_alarm_ends_after_calm_runs() -> None:
    limits = RunLimits(5.0, 5.0, 2.5, 2.5)
    phase: tuple[State, int] = ("learning", 0)
    found = []
    for value in (0, 9, 0, 0, 0, 0, 0):
        phase = _next_phase(phase, float(value), 0.0, limits, 3)
        found.append(phase[0])
    assert found == ["normal"] + ["alarm"] * 3 + ["normal"] * 3


def test_an_alarm_ends_when_its_cause_does() -> None:
    days = np.arange(60.0)
    level = np.where((days >= 20) & (days < 30), 0.05, 0.0)
    level = level + 0.0012 * np.random.default_rng(1).standard_normal(60)
    found = chart_of(days, level, np.full(60, 0.003), np.full(60, np.nan), (), FEW).states
    assert found[22:30] == ("alarm",) * 8
    assert set(found[56:]) == {"normal"}


def baseline(*states: State) -> list[int]:
    found = BaselineVisits(10)
    for number, state in enumerate(states):
        found = found.after(number, state, 0)
    return list(found.visits)


def test_a_watch_alone_does_not_shrink_the_baseline() -> None:
    watched: tuple[State, ...] = ("learning",) * 3 + ("normal", "watch", "watch") + ("normal",) * 6
    assert baseline(*watched) == list(range(10))
    assert baseline(*watched[:-1], "alarm") == list(range(10))
    alarmed: tuple[State, ...] = ("learning",) * 3 + ("normal", "watch", "watch") + ("alarm",) * 6
    assert baseline(*alarmed) == [0]
    late: tuple[State, ...] = ("learning",) * 3 + ("normal",) * 6 + ("watch", "watch", "alarm")
    assert baseline(*late) == [0]
    assert baseline(*late[:-1]) == list(range(10))


def test_a_stiffer_axis_does_not_alarm_but_is_reported() -> None:
    days, noise = np.arange(30.0), 0.0012 * np.random.default_rng(2).standard_normal(30)
    inputs = np.full(30, 0.003), np.full(30, np.nan)
    for change, stiffer in ((-0.05, True), (0.0, False)):
        found = chart_of(days, noise + np.where(days > 19, change, 0.0), *inputs, (), FEW)
        assert "alarm" not in found.states
        assert bool(found.stiffer[-1]) is stiffer
        assert not found.stiffer[:20].any()


def test_the_same_history_gives_the_same_chart() -> None:
    assert states_of(np.zeros(20), 20) == states_of(np.zeros(20), 20)


@pytest.mark.parametrize("count", [1, 2, 3, 4])
def test_short_epochs(count: int) -> None:
    found = chart_of(
        np.arange(float(count)), np.zeros(count), np.full(count, 0.003), np.full(count, np.nan), (), FEW
    )
    assert found.states == ("learning", "learning", "learning", "normal")[:count]


def test_two_runs_at_the_same_time_are_allowed() -> None:
    days = np.repeat(np.arange(6.0), 2)
    found = chart_of(days, np.zeros(12), np.full(12, 0.003), np.full(12, 20.0), (), FEW)
    assert np.isfinite(found.ramp).all()
    assert "alarm" not in found.states


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("false_alarms_per_year", 0.0), ("false_alarms_per_year", float("nan")), ("watch", 0.5),
        ("baseline_runs", 2), ("baseline_runs", 3.5), ("draws", 10), ("odd", 1.0), ("scale", -1.0),
        ("odd_stays", 1.0), ("repeats_per_year", -1.0), ("calm_runs", True), ("clip", "3"),
    ],
)  # fmt: skip
def test_settings_out_of_range_are_refused(name: str, value: object) -> None:
    with pytest.raises(InputError, match=name):
        MonitorSettings(**{name: value})  # type: ignore[arg-type]


def test_a_bearing_that_settles_within_its_prior_is_no_alarm_and_beyond_it_is() -> None:
    days, plain = np.arange(60.0), np.full(60, np.nan)
    settled = days / (days + 60)
    for drift, size, alarms in ((0.0, 0.01, True), (0.01, 0.01, False), (0.01, 0.1, True)):
        noise = 3e-4 * np.random.default_rng(3).standard_normal(60)
        found = chart_of(days, size * settled + noise, np.full(60, 5e-4), plain, (), FEW, drift)
        assert ("alarm" in found.states) is alarms
        # The stiffness contains the drift: it is relative to the baseline as measured.
        assert len(found.coefficients) == 1


@pytest.mark.parametrize(("rate", "valid"), [(0.0, True), (0.5, False), (0.99, False), (1.0, True)])
def test_a_rate_of_repeats_is_zero_or_one_or_more(rate: float, valid: bool) -> None:
    if valid:
        assert MonitorSettings(repeats_per_year=rate).repeats_per_year == rate
    else:
        with pytest.raises(InputError, match=f"repeats_per_year is {rate:g}; it must be 0, or 1 or more"):
            MonitorSettings(repeats_per_year=rate)
