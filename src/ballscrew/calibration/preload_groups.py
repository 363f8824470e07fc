"""Groups of runs that share one preload."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime, timedelta
from itertools import combinations

import numpy as np
from scipy.special import ndtri

from ballscrew.base.arrays import Array
from ballscrew.base.quantity import NORMAL_95, Quantity
from ballscrew.calibration.assumptions import Assumptions
from ballscrew.calibration.calibrated_axis import Doubt
from ballscrew.calibration.frequency_table import FrequencyTable

SAME_DAY = timedelta(days=1)
"""Runs that begin within it of the earliest are one experiment: no screw wears measurably in a day."""

# Standard uncertainties of the difference of two known preloads, up to which they are the same.
_SAME_PRELOAD = 2.0


def preload_groups(
    ids: Sequence[str], measured_at: Sequence[str | None], known: Mapping[str, Quantity]
) -> tuple[int, ...]:
    """Group of each run: runs of one group share one preload.

    Runs within a day of the earliest of them share one. So do runs without a time: they are taken as one
    experiment. Known preloads of one experiment that differ by more than twice their uncertainty are groups
    of their own, and runs without a known preload belong to the first.

    Parameters
    ----------
    ids : sequence of str
        Of the runs.
    measured_at : sequence of str or None
        ISO 8601.
    known : mapping of str to Quantity
        Known preloads by id, N.

    Returns
    -------
    tuple of int
        Number of each run's group: 0 for that of the first run, the others in the order of appearance.
    """
    days = _days(measured_at)
    preloads: dict[int, list[Quantity]] = {}
    for run, day in zip(ids, days, strict=True):
        if run in known:
            of_day = preloads.setdefault(day, [])
            if _same_preload(known[run], of_day) is None:
                of_day.append(known[run])
    keys: list[tuple[int, float | None]] = []
    for run, day in zip(ids, days, strict=True):
        preload = None
        if day in preloads:
            preload = preloads[day][0].value
        if run in known:
            preload = _same_preload(known[run], preloads[day])
        keys.append((day, preload))
    order = list(dict.fromkeys(keys))
    return tuple(order.index(key) for key in keys)


def grouping_notes(
    ids: Sequence[str], measured_at: Sequence[str | None], known: Mapping[str, Quantity]
) -> tuple[str, ...]:
    """Sentences on the assumptions of the grouping; parameters as :func:`preload_groups`."""
    notes = []
    timeless = [run[:12] for run, text in zip(ids, measured_at, strict=True) if _time(text) is None]
    if len(timeless) > 1:
        names = ", ".join(timeless[:3])
        if len(timeless) > 3:
            names += ", …"
        notes.append(
            f"{len(timeless)} runs have no time ({names}) and were assumed to be of one day and one preload: "
            "state their times (analyze --measured-at)"
        )
    days, groups = preload_groups(ids, measured_at, {}), preload_groups(ids, measured_at, known)
    for day in sorted(set(days)):
        preloads: dict[int, float] = {}
        others = []
        for run, group, day_of_run in zip(ids, groups, days, strict=True):
            if day_of_run != day:
                continue
            if run in known:
                preloads.setdefault(group, known[run].value)
            else:
                others.append(run[:12])
        if len(preloads) > 1:
            notes.append(_describe_preloads(preloads, others))
    return tuple(notes)


def preload_doubts(
    runs: Sequence[FrequencyTable],
    groups: Sequence[int],
    log_ratios: Array,
    covariance: Array,
    known: Mapping[str, Quantity],
    assumptions: Assumptions,
) -> list[Doubt]:
    """Doubt of runs without a known preload whose preloads differ, by the most significant difference.

    Parameters
    ----------
    runs, groups : sequence
        Of the calibration, and the group of each run's preload.
    log_ratios : ndarray, shape (groups,)
        ln(P/P_ref) of each group.
    covariance : ndarray, shape (groups, groups)
        Of these.
    known : mapping of str to Quantity
        Known preloads by id, N; their groups may differ.
    assumptions : Assumptions
        Effect of the temperature; probability of a false doubt.

    Returns
    -------
    list of Doubt
        One or none.
    """
    stated = {group for run, group in zip(runs, groups, strict=True) if run.id in known}
    unstated = [group for group in dict.fromkeys(groups) if group not in stated]
    celsius = {group: _mean_temperature(runs, groups, group) for group in unstated}
    differences = []
    for pair in combinations(unstated, 2):
        first, second = pair
        change = abs(float(log_ratios[second] - log_ratios[first]))
        variance = covariance[first, first] + covariance[second, second] - 2 * covariance[first, second]
        warmer = np.nan_to_num(celsius[second] - celsius[first])  # 0 where a temperature is not known
        spread = math.hypot(math.sqrt(max(variance, 0.0)), assumptions.temperature * warmer)
        differences.append((change / spread, change, spread, pair))
    if not differences:
        return []
    significance, change, spread, pair = max(differences)
    # Two-sided limit of a normal distribution, by Bonferroni for the number of pairs.
    if significance <= -ndtri(assumptions.false_alarm / 2 / len(differences)):
        return []
    names = [runs[list(groups).index(group)].id[:12] for group in pair]
    ratio = math.exp(-change)
    return [
        Doubt(
            "differing-preloads",
            f"the preloads of run {names[0]} and run {names[1]} differ by {100 * (1 - ratio):.0f} % "
            f"(± {100 * NORMAL_95 * spread * ratio:.0f} %, 95 %), more than runs of one state: has one "
            "another load, nut or temperature, or is it worn? State their known preloads, or leave one out",
        )
    ]


def _mean_temperature(runs: Sequence[FrequencyTable], groups: Sequence[int], group: int) -> float:
    """Mean temperature of a group's runs, °C; NaN where none is known."""
    known = []
    for run, number in zip(runs, groups, strict=True):
        if number == group and run.temperature is not None:
            known.append(run.temperature)
    if not known:
        return math.nan
    return float(np.mean(known))


def _describe_preloads(preloads: Mapping[int, float], others: Sequence[str]) -> str:
    """Preloads of one day by their groups, and the runs that belong to the first of them."""
    stated = " and ".join(f"{preload:g} N" for _, preload in sorted(preloads.items()))
    note = f"runs of one day have preloads of {stated}, as stated"
    if others:
        note += f"; {', '.join(others)} assumed to have {next(iter(preloads.values())):g} N"
    return note


def sort_key(measured_at: str | None) -> datetime:
    """Time of a run for sorting; runs without one come last."""
    return _time(measured_at) or datetime.max.replace(tzinfo=UTC)


def _days(measured_at: Sequence[str | None]) -> list[int]:
    """Number of each run's day, from 1 in the order of time; 0 for runs without a time.

    A day begins with its earliest run, whatever the order of the runs: it would span almost two days if it
    contained runs before and after the first in a list.
    """
    times = [_time(text) for text in measured_at]
    day_of_time: dict[datetime, int] = {}
    begin = None
    day = 0
    for time in sorted(time for time in times if time is not None):
        if begin is None or time - begin >= SAME_DAY:
            begin = time
            day += 1
        day_of_time[time] = day
    return [0 if time is None else day_of_time[time] for time in times]


def _same_preload(preload: Quantity, others: Sequence[Quantity]) -> float | None:
    """Value of the first of other preloads that agrees with this one, N; None if none does."""
    for other in others:
        spread = math.hypot(preload.standard_uncertainty, other.standard_uncertainty)
        if abs(preload.value - other.value) <= _SAME_PRELOAD * spread:
            return other.value
    return None


def _time(text: str | None) -> datetime | None:
    """Time of a text in ISO 8601, in UTC where it states no zone; None for another text."""
    if text is None:
        return None
    try:
        time = datetime.fromisoformat(text)
    except (ValueError, TypeError):
        return None
    if time.tzinfo is None:
        return time.replace(tzinfo=UTC)
    return time
