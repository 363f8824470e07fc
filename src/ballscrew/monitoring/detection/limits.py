"""Control limits by simulation: healthy histories with the days, temperatures and uncertainties of an epoch.

At every visit the limits are such that a healthy axis without an alarm so far alarms there with probability
1 − exp(−rate Δt), shared evenly by the two statistics, and by the first run and a repeat. False alarms then
occur at the stated rate whatever the spacing of the runs, from the first run with a statistic on. A limit
depends on the runs up to its own alone.

The first visits are simulated as they were. The histories are then continued once, as the visits went on so
far, and give a table that holds from then on (:mod:`~.limit_table`): judging a visit costs the same however
many there were.
"""

from __future__ import annotations

import hashlib
import math
from collections import OrderedDict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ballscrew.base.arrays import Array
from ballscrew.monitoring.detection.design import SETTLING, Design
from ballscrew.monitoring.detection.growing_design import LEARNT
from ballscrew.monitoring.detection.healthy_simulation import (
    FIRST_SHARE,
    MOST_WATCHES,
    REPEAT_TAIL,
    TAIL,
    HealthySimulation,
    share_of_first,
    spent_at_visit,
)
from ballscrew.monitoring.detection.limit_table import BLOCKS, LimitTable, block_of, quantile_of, quantiles
from ballscrew.monitoring.detection.limit_values import ControlLimits, RunLimits, VisitLimits, stacked_limits
from ballscrew.monitoring.detection.statistics import BEGIN

Floats = NDArray[np.floating[Any]]
_TABLE_SAFETY = 0.85  # of the rate, where a table gives the limits: the same, of pooled visits
_STEP_ODDS = 1.0  # added to limits of odds just after a step, whose size is not known yet
_STEP_VISITS = 40  # until which that falls to 0
_SPAN = 5  # gaps between visits that weigh the onsets of the odds
_CLEAR = 6.0  # standard deviations of a run by which wear during a gap is beyond mistaking
_USUAL_RATE = 1 / 160  # of that wear, of the level per day
_LEAST_SPAN = 0.1  # of the usual one: visits that follow at once
_KNOWN_LIMITS = 4096  # visits whose limits a process remembers


def compute_limits(design: Design) -> ControlLimits:
    """Limits of every visit of an epoch.

    Parameters
    ----------
    design : Design
        The epoch.

    Returns
    -------
    ControlLimits
        Limits before and after a repeat; the same epoch always has the same.
    """
    found, table = [], None
    for number in range(len(design.days)):
        known = design
        if number < LEARNT:
            known = design.until(number)
        steps = [start for start in design.step_starts if start <= number]
        since_step = number - steps[-1] if steps else None
        limits, table = limits_of_visit(known, number, number, table, since_step)
        found.append(limits)
    spent, repeat = [each.spent for each in found], [each.repeat for each in found]
    again = stacked_limits([each.again for each in found], spent, repeat)
    first = stacked_limits([each.first for each in found], spent, repeat)
    return ControlLimits(
        first.ramp, first.odds, first.watch_ramp, first.watch_odds, first.spent, first.repeat, again
    )


def limits_of_visit(
    design: Design, k: int, number: int, table: LimitTable | None, since_step: int | None = None
) -> tuple[VisitLimits, LimitTable | None]:
    """Limits of a visit.

    Parameters
    ----------
    design : Design
        With the visit and, where there is no table, all before it.
    k : int
        Row of the visit.
    number : int
        Its number in the epoch.
    table : LimitTable or None
        As this function returned it at the visit before.
    since_step : int, optional
        Visits since the first after the newest step.

    Returns
    -------
    VisitLimits
        They depend on the visits up to this one alone.
    LimitTable or None
        None until the first visit after those that are simulated.
    """
    if number < BEGIN:
        return VisitLimits(RunLimits(), RunLimits(), 0.0, math.inf), None
    if number < LEARNT:
        return _simulated_limits(design, number), None
    if table is None:
        table = _table_of(design.until(LEARNT - 1))
    shift = _odds_of_span(table, design, k)
    if since_step is not None:
        shift += _STEP_ODDS * max(1 - since_step / _STEP_VISITS, 0.0)
    return _limits_by_table(table, design, k, number, shift), table


_LATEST: dict[bytes, HealthySimulation] = {}
"""Simulation of the newest visit, by its design: the next visit of the same epoch continues it."""

_KNOWN: OrderedDict[bytes, VisitLimits | LimitTable] = OrderedDict()
"""Limits of visits, and tables, by the design."""


def _key(design: Design) -> bytes:
    """Digest of all that the limits of a design's newest visit depend on."""
    numbers = (design.days, design.uncertainty, design.columns, design.sizes)
    others = (design.unknown_temperature, design.temperature_known)
    digest = hashlib.sha256(repr((design.settings, design.step_starts, design.layout)).encode())
    for array in (*numbers, *others):
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.digest()


def _remember(key: bytes, found: VisitLimits | LimitTable) -> None:
    _KNOWN[key] = found
    while len(_KNOWN) > _KNOWN_LIMITS:
        _KNOWN.popitem(last=False)


def _simulated_limits(design: Design, number: int) -> VisitLimits:
    """Limits of one of the first visits, of which the design has all."""
    key = _key(design)
    known = _KNOWN.get(key)
    if isinstance(known, VisitLimits):
        return known
    return _simulate(design, number)[1]


def _simulate(design: Design, number: int) -> tuple[HealthySimulation, VisitLimits]:
    """Simulation up to a visit and its limits, from that of the visit before if it is the latest one."""
    simulation = _LATEST.pop(_key(design.until(number - 1)), None)
    _LATEST.clear()
    if simulation is None:
        simulation = HealthySimulation(design.until(0))
    limits = VisitLimits(RunLimits(), RunLimits(), 0.0, math.inf)
    while simulation.count <= number:
        known = design.until(simulation.count)
        limits, _ = simulation.add(known)
        _remember(_key(known), limits)
    _LATEST[_key(design)] = simulation
    return simulation, limits


def _table_of(design: Design) -> LimitTable:
    """Table of limits after the visits of a design."""
    key = _key(design) + b"table"
    known = _KNOWN.get(key)
    if isinstance(known, LimitTable):
        return known
    simulation = _LATEST.pop(_key(design), None)
    if simulation is None:
        simulation = _simulate(design, len(design.days) - 1)[0]
    _LATEST.clear()
    table = _continued(simulation, design)
    _remember(key, table)
    return table


def _continued(simulation: HealthySimulation, design: Design) -> LimitTable:
    """Quantiles of the statistics of histories that go on as they did."""
    later = _continued_design(design, BLOCKS[-1])
    columns: list[list[Any]] = [[] for _ in range(7)]
    begin = 0
    for end in BLOCKS:
        firsts, seconds, counts = [], [], np.zeros(2)
        for _ in range(begin, end):
            alive = simulation.alive
            limits, found = simulation.add(later)
            first = np.stack([found.ramp_first, found.odds_first])[:, alive]
            repeated = found.repeated & alive
            firsts.append(first)
            seconds.append(np.stack([found.ramp, found.odds])[:, repeated])
            counts += alive.sum(), (repeated & ~(found.odds_first > limits.repeat)).sum()
        first, second = np.concatenate(firsts, axis=1), np.concatenate(seconds, axis=1)
        row = (
            quantiles(first[0], counts[0]),
            quantiles(first[1], counts[0]),
            quantiles(second[0], counts[0]),
            quantiles(second[1], counts[0]),
            _either(first, TAIL),
            _either(second, REPEAT_TAIL),
            counts[1] / counts[0],
        )
        for column, value in zip(columns, row, strict=True):
            column.append(value)
        begin = end
    span = _SPAN * float(design.days[-1] - design.days[0]) / (len(design.days) - 1)
    noise = design.settings.scale * float(np.median(design.uncertainty))
    ramp, odds, ramp_again, odds_again, either, either_again, far_off = map(np.array, columns)
    return LimitTable(
        ramp=ramp,
        odds=odds,
        ramp_again=ramp_again,
        odds_again=odds_again,
        either=either,
        either_again=either_again,
        far_off=far_off,
        span=span,
        longest=_SPAN * _CLEAR * noise / _USUAL_RATE,
    )


def _continued_design(design: Design, more: int) -> Design:
    """Design with more visits, whose days, uncertainties and temperatures repeat those so far."""
    count = len(design.days)
    rows = 1 + np.arange(more) % (count - 1)
    days = design.days[-1] + np.cumsum(np.diff(design.days)[rows - 1])
    columns = design.columns[rows].copy()
    columns[:, design.step_columns] = 1.0
    if design.layout.drift:
        since = days - design.days[0]
        columns[:, 1 + 2 * design.has_temperature] = since / (since + SETTLING)
    return Design(
        days=np.concatenate([design.days, days]),
        uncertainty=np.concatenate([design.uncertainty, design.uncertainty[rows]]),
        columns=np.concatenate([design.columns, columns]),
        sizes=design.sizes,
        unknown_temperature=np.concatenate([design.unknown_temperature, design.unknown_temperature[rows]]),
        temperature_known=np.concatenate([design.temperature_known, design.temperature_known[rows]]),
        has_temperature=design.has_temperature,
        step_starts=design.step_starts,
        settings=design.settings,
    )


def _either(values: Floats, part: float) -> float:
    """Probability that any of two statistics is in its tail, over that of one of them."""
    if not values.shape[1]:
        return 1.0
    top = np.quantile(values, 1 - part, axis=1)
    return min(max(float(np.mean((values > top[:, None]).any(axis=0))) / part, 1.0), 2.0)


def _odds_of_span(table: LimitTable, design: Design, k: int) -> float:
    """Excess of the odds over those of the table where the newest visits are further apart.

    The longer the axis was not tested, the more probable is it that wear has begun meanwhile, but the rarer
    are levels that look like it. Where visits come closer the limits remain: lower ones alarm too often.
    """
    span = float(design.days[k] - design.days[k - _SPAN])
    return max(math.log(_effective(span, table) / _effective(table.span, table)), 0.0)


def _effective(span: float, table: LimitTable) -> float:
    span = max(span, _LEAST_SPAN * table.span, 1e-9)
    return span / (1 + span / table.longest)


def _limits_by_table(table: LimitTable, design: Design, k: int, number: int, shift: float) -> VisitLimits:
    """Limits of a visit after those that were simulated; those of the odds are shifted."""
    settings, row = design.settings, block_of(number - LEARNT)
    spent, repeats = spent_at_visit(design, k, number, _TABLE_SAFETY)
    share = share_of_first(spent, repeats)
    first = share * spent / float(table.either[row])
    odds, odds_again = table.odds[row] + shift, table.odds_again[row] + shift
    threshold = max(quantile_of(odds, repeats), 0.0)
    most = FIRST_SHARE * (repeats + float(table.far_off[row]))
    again = min((1 - share) * spent, most) / float(table.either_again[row])
    return VisitLimits(
        _two_limits(table.ramp[row], odds, first, settings.watch, MOST_WATCHES),
        _two_limits(table.ramp_again[row], odds_again, again, settings.watch, most),
        spent,
        threshold,
    )


def _two_limits(ramp: Array, odds: Array, probability: float, watch: float, most: float) -> RunLimits:
    """Limits of alarm and watch, each statistic with a probability."""
    watched = min(probability * watch, most)
    alarm = quantile_of(ramp, probability), quantile_of(odds, probability)
    return RunLimits(
        *alarm, min(quantile_of(ramp, watched), alarm[0]), min(quantile_of(odds, watched), alarm[1])
    )
