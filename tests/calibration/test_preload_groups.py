"""Which runs share one preload."""

from __future__ import annotations

from ballscrew.base.quantity import Quantity
from ballscrew.calibration.preload_groups import grouping_notes, preload_groups


def stated(newtons: float) -> Quantity:
    return Quantity(newtons, 1.0, "N")


def test_runs_of_a_day_share_a_preload() -> None:
    times = ["2026-01-01T08:00+00:00", "2026-01-01T17:00+00:00", "2026-02-01T08:00+00:00"]
    assert preload_groups(["a", "b", "c"], times, {}) == (0, 0, 1)


def test_a_day_begins_with_its_earliest_run_in_any_order() -> None:
    times = ["2026-01-02T12:00Z", "2026-01-01T13:00Z", "2026-01-03T11:00Z"]
    assert preload_groups(["a", "b", "c"], times, {}) == (0, 0, 1)
    assert preload_groups(["b", "a", "c"], [times[1], times[0], times[2]], {}) == (0, 0, 1)


def test_runs_without_a_time_are_one_experiment() -> None:
    assert preload_groups(["a", "b", "c"], [None, None, "2026-01-01"], {}) == (0, 0, 1)


def test_a_known_preload_counts_for_its_day() -> None:
    times = [None, None, None]
    assert preload_groups(["a", "b", "c"], times, {"b": stated(600)}) == (0, 0, 0)
    assert preload_groups(["a", "b", "c"], times, {"b": stated(600), "c": stated(300)}) == (0, 0, 1)


def test_times_with_and_without_a_zone_compare() -> None:
    assert preload_groups(["a", "b"], ["2026-01-01T08:00", "2026-01-01T09:00Z"], {}) == (0, 0)
    assert preload_groups(["a", "b"], ["no time", None], {}) == (0, 0)


def test_statements_that_agree_are_one_preload() -> None:
    """Within twice what their difference may err: a preload that was typed twice, or measured twice."""
    near = {"a": Quantity(600.0, 12.0, "N"), "b": Quantity(610.0, 12.0, "N")}
    assert preload_groups(["a", "b", "c"], [None] * 3, near) == (0, 0, 0)
    far = {"a": Quantity(600.0, 12.0, "N"), "b": Quantity(640.0, 12.0, "N")}
    assert preload_groups(["a", "b", "c"], [None] * 3, far) == (0, 1, 0)


def test_assumptions_are_reported() -> None:
    day = ["2026-01-01T08:00Z"] * 3
    assert grouping_notes(["a", "b", "c"], day, {}) == ()
    assert grouping_notes(["a"], [None], {}) == ()
    (timeless,) = grouping_notes(["a", "b"], [None, "yesterday"], {})
    assert "2 runs have no time (a, b)" in timeless
    (parted,) = grouping_notes(["a", "b", "c"], day, {"b": stated(600), "c": stated(300)})
    assert "have preloads of 600 N and 300 N" in parted
    assert "; a assumed to have 600 N" in parted
