"""Statistics and their limits: false alarms at the stated rate, found ramps, and one odd run is none."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from ballscrew.base.errors import InputError
from ballscrew.health.detection.chart import chart, states
from ballscrew.health.detection.cusum import cusum
from ballscrew.health.detection.design import Design, Step, design
from ballscrew.health.detection.limits import BEGIN, Limits, healthy, limits, statistics
from ballscrew.health.detection.ramp import onsets, ramp
from ballscrew.health.detection.settings import MonitorSettings

Array = NDArray[np.float64]
FEW = MonitorSettings(draws=4000)


def epoch(
    count: int, every: float = 1.0, settings: MonitorSettings = FEW, steps: tuple[Step, ...] = ()
) -> Design:
    days = every * np.arange(count, dtype=np.float64)
    return design(days, np.full(count, 0.003), 20 + 4 * np.sin(days / 6), steps, settings)


@pytest.mark.parametrize(("count", "every"), [(60, 1.0), (27, 3.0)])
def test_false_alarms_come_at_the_stated_rate(count: int, every: float) -> None:
    settings = MonitorSettings(draws=4000, false_alarms_per_year=1.0)
    of = epoch(count, every, settings)
    known = limits(of)
    grown, summed, _ = statistics(of, healthy(of, 6000, np.random.default_rng(5)))
    alarmed = ((grown > known.ramp[:, None]) | (summed > known.cusum[:, None])).any(axis=0)
    stated = -np.expm1(-(count - 1) * every / 365.25)
    assert 0.5 * stated < alarmed.mean() < 1.2 * stated


def test_limits_of_the_first_runs_do_not_know_the_later_ones() -> None:
    long, short = limits(epoch(30)), limits(epoch(20))
    for name in ("ramp", "cusum", "watch_ramp", "watch_cusum", "spent"):
        assert np.array_equal(getattr(long, name)[:20], getattr(short, name))


def test_fewer_runs_of_a_baseline_make_wider_limits() -> None:
    at = [limits(epoch(30, settings=MonitorSettings(draws=4000, baseline_runs=n))) for n in (3, 10)]
    assert np.median(at[0].cusum[15:]) > np.median(at[1].cusum[15:])


def test_watch_lies_below_alarm_and_nothing_is_judged_while_it_learns() -> None:
    known = limits(epoch(25))
    assert np.isinf(known.ramp[:BEGIN]).all()
    assert (known.watch_ramp[BEGIN:] <= known.ramp[BEGIN:]).all()
    assert np.median(known.watch_ramp[BEGIN:]) < 0.9 * np.median(known.ramp[BEGIN:])
    assert (known.watch_cusum[BEGIN:] <= known.cusum[BEGIN:]).all()


def test_the_ramp_is_that_of_generalised_least_squares() -> None:
    """Against a fit written out: level, temperature and slope, priors as rows."""
    of, random = epoch(12), np.random.default_rng(3)
    y = random.normal(size=12) * 0.002 + 0.001 * np.maximum(of.days - 6, 0)
    found, _ = ramp(of, y[:, None], np.full((12, 1), FEW.scale), BEGIN)
    best = []
    for onset in onsets(11):
        slope = np.maximum(of.days - of.days[onset], 0)
        rows = np.column_stack([of.columns, slope]) / np.sqrt(of.noise)[:, None]
        rows = np.vstack([rows, [0, 1 / of.sizes[1], 0, 0], [0, 0, 1 / of.sizes[2], 0]])
        value = np.append(y / np.sqrt(of.noise), [0.0, 0.0])
        covariance = np.linalg.inv(rows.T @ rows)
        best.append((covariance @ rows.T @ value)[-1] / np.sqrt(covariance[-1, -1]))
    assert found[-1, 0] == pytest.approx(max(best), rel=1e-5)


def test_onsets_are_dense_near_today_and_begin_at_the_first_run() -> None:
    assert onsets(1).tolist() == [0]
    assert onsets(10).tolist() == [9, 8, 7, 6, 4, 2, 0]


def test_cusum_by_hand() -> None:
    assert cusum(np.array([1.0, 2.0, -5.0, 1.5]), np.full(4, 0.5)).tolist() == [0.5, 2.0, 0.0, 1.0]


def drawn(change: Array, count: int = 30, seed: int = 1, steps: tuple[Step, ...] = ()) -> tuple[str, ...]:
    random = np.random.default_rng(seed)
    days = np.arange(float(count))
    warm = 20 + 4 * np.sin(days / 6)
    level = 0.0012 * random.standard_normal(count) + 0.003 * (warm - 20) + change
    return chart(days, level, np.full(count, 0.003), warm, steps, FEW).states


def test_a_ramp_alarms_soon_and_stays() -> None:
    found = drawn(0.006 * np.maximum(np.arange(30) - 19.5, 0))
    first = found.index("alarm")
    assert 20 <= first <= 23
    assert set(found[first:]) == {"alarm"}
    assert "alarm" not in found[:20]


def test_warmth_alone_does_not_alarm() -> None:
    assert not {"alarm", "watch"} & set(drawn(np.zeros(30)))


@pytest.mark.parametrize("where", [12, 20, 29])
def test_one_odd_run_does_not_alarm(where: int) -> None:
    change = np.zeros(30)
    change[where] = 0.02
    assert "alarm" not in drawn(change)


def test_a_known_step_does_not_alarm_and_an_unknown_one_does() -> None:
    change = np.where(np.arange(30) >= 18, 0.012, 0.0)
    assert "alarm" not in drawn(change, steps=(Step(17.5, 0.01),))
    assert "alarm" in drawn(change)


def test_wear_within_the_baseline_is_found_too() -> None:
    assert "alarm" in drawn(0.01 * np.arange(30.0, dtype=np.float64))[:10]


def test_missing_temperatures_are_allowed() -> None:
    days = np.arange(20.0)
    warm = np.where(days % 3 == 0, np.nan, 20 + days % 5)
    found = chart(days, np.zeros(20), np.full(20, 0.003), warm, (), FEW)
    assert set(found.states) == {"learning", "normal"}
    assert found.design.loose[3] > 0 == found.design.loose[0]


def test_an_alarm_is_over_after_some_calm_runs() -> None:
    value = np.array([0, 0, 0, 0, 9, 0, 0, 0, 0, 0], dtype=float)
    one = np.full(10, 5.0)
    found = states(value, np.zeros(10), Limits(one, one, one / 2, one / 2, one), 3)
    assert found == ("learning",) * 3 + ("normal",) + ("alarm",) * 3 + ("normal",) * 3


def test_the_same_history_gives_the_same_chart() -> None:
    assert drawn(np.zeros(20), 20) == drawn(np.zeros(20), 20)


@pytest.mark.parametrize("count", [1, 2, 3, 4])
def test_short_epochs(count: int) -> None:
    found = chart(
        np.arange(float(count)), np.zeros(count), np.full(count, 0.003), np.full(count, np.nan), (), FEW
    )
    assert found.states == ("learning", "learning", "learning", "normal")[:count]


def test_two_runs_at_one_moment_are_two_runs() -> None:
    days = np.repeat(np.arange(6.0), 2)
    found = chart(days, np.zeros(12), np.full(12, 0.003), np.full(12, 20.0), (), FEW)
    assert np.isfinite(found.ramp).all()
    assert "alarm" not in found.states


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("false_alarms_per_year", 0.0), ("false_alarms_per_year", float("nan")), ("watch", 0.5),
        ("baseline_runs", 2), ("baseline_runs", 3.5), ("draws", 10), ("odd", 1.0), ("scale", -1.0),
        ("calm_runs", True), ("clip", "3"),
    ],
)  # fmt: skip
def test_settings_that_cannot_be(name: str, value: object) -> None:
    with pytest.raises(InputError, match=name):
        MonitorSettings(**{name: value})  # type: ignore[arg-type]
