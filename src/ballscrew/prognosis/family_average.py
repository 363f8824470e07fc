"""Remaining life as an average over families of wear (:mod:`~.families`), weighted by their past forecasts.

No law of wear is known to hold, and a forecast by a wrong one is late where wear speeds up. So families of
different courses are averaged, each by how it predicted every reading one to eight readings ahead (Dawid,
*Statistical theory: the prequential approach*, J. R. Stat. Soc. A 147, 1984, DOI 10.2307/2981683). No weight
falls below a floor, and the pace of wear that has begun may change once more. Where the average's own past
forecasts were too narrow, it is widened.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError
from ballscrew.base.proposals import log_sum
from ballscrew.prognosis.failure import Failure
from ballscrew.prognosis.families import FAMILIES, Family, FamilyPrior, named_laws
from ballscrew.prognosis.family_fit import fit_family
from ballscrew.prognosis.family_process import AHEAD, FamilyFit, Paths, sample_paths
from ballscrew.prognosis.forecast import FAN, Forecast, fan_days, least_begun, reach_of
from ballscrew.prognosis.preload_history import PreloadHistory
from ballscrew.prognosis.readings import Readings, readings_of

_FORGET = 0.99  # of a score, with each reading
_LEAST_WEIGHT = 0.003  # of a family
_STEPS = 36  # days ahead of a path
_FIRST_STEP = 0.25  # day
_FAR_SPANS = np.geomspace(1.0, 300.0, 13)[1:]  # of a forecast: a path that speeds up goes so far within one
_MOST_FOLDS = 20.0  # of the duty of wear, beyond which no change is ahead
_LEAST_WORN = 0.1  # of the duty: wear that has just begun
_RECORD = 5.0  # forecasts of a record that count as much as the belief in the stated width


@dataclass(frozen=True, slots=True)
class FamilyAverage:
    """Average over families of wear.

    Parameters
    ----------
    families : sequence of Family
        Families; those by travel or hours count only where these are given.
    prior : FamilyPrior
        Prior of their parameters.
    travel, hours : callable, optional
        Duty up to each of an array of days, past and ahead (300 times the reach), as that of so many average
        days; by default in proportion to time.
    members : int
        Members of a cloud of a family, see :func:`~.family_fit.fit_family`.
    samples : int
        Paths of a forecast.
    seed : int
        The same seed gives the same forecast.
    most : int
        Readings that are taken singly; of more, older neighbours are pooled.
    alarm : bool
        Whether an alarm stands: the paths are then those whose wear has begun, unless these are too few.
    """

    families: Sequence[Family] = FAMILIES
    prior: FamilyPrior = field(default_factory=FamilyPrior)
    travel: Callable[[Array], Array] | None = None
    hours: Callable[[Array], Array] | None = None
    members: int = 64
    samples: int = 2000
    seed: int = 1
    most: int = 50
    alarm: bool = False

    def __post_init__(self) -> None:
        """Check the numbers."""
        if self.members < 20 or self.samples < 100 or self.most < 10:
            raise InputError(
                f"an average of {self.members} members, {self.samples} samples and {self.most} readings was "
                "requested; it needs at least 20, 100 and 10."
            )

    def forecast(self, history: PreloadHistory, failure: Failure, *, at: float | None = None) -> Forecast:
        """Remaining life as known at the end of a day.

        Parameters
        ----------
        history : PreloadHistory
            Runs after ``at`` are ignored.
        failure : Failure
            End of life.
        at : float, optional
            Day of the epoch; by default that of the last run.

        Returns
        -------
        Forecast
            With families, laws, and the probability that wear has begun.

        Raises
        ------
        InputError
            If no run shows preload, friction or backlash until then, or the day is not finite.
        """
        day = history.last_day if at is None else at
        if not math.isfinite(day):
            raise InputError(f"the day of a forecast is {day}; it must be finite.")
        readings = self._readings(history.until(day))
        reach = reach_of(max(day - float(history.days[0]), 0.0))
        ahead = np.concatenate([[0.0], np.geomspace(_FIRST_STEP, reach, _STEPS)])
        paths, weight, width, laws = self._average(readings, day + ahead)
        begun = float(np.mean(paths.begun))
        if self.alarm and begun >= least_begun(self.alarm):
            paths = paths.part(paths.begun)
        random = np.random.default_rng([self.seed, 2])
        scale = np.maximum(1 + history.scale * random.standard_normal(len(paths.onset)), 0.1)
        end = _apparent_end(failure.remaining(history.approach), scale)
        lives = np.sort(first_below(paths.remaining, end, ahead))
        days = fan_days(lives, reach)
        ratio = np.stack([np.interp(days, ahead, row) for row in _ratio(paths.remaining, scale)])
        mode, text = failure.mode(history.approach)
        return Forecast(
            at=day,
            rul_days=lives,
            reach=reach,
            mode=mode,
            end=text,
            days=days,
            ratio=np.quantile(ratio, FAN, axis=0).T,
            method="average over families of wear",
            begun=begun,
            alarm=self.alarm,
            families=weight,
            laws=laws,
            parameters={"width": width, "ratio_median": float(np.median(ratio[:, 0]))},
        )

    def friction_ahead(self, history: PreloadHistory, days: Array) -> Array:
        """Readings of the friction on days after the last, of a history that has only friction.

        Parameters
        ----------
        history : PreloadHistory
            With friction.
        days : ndarray, shape (k,)
            Ascending, after its last day.

        Returns
        -------
        ndarray, shape (samples, k)
            Equally probable, with the scatter of a reading.

        Raises
        ------
        InputError
            If the days are not finite, ascending and later than the last run, or there is no run.
        """
        days = np.asarray(days, dtype=np.float64)
        steps = np.diff(np.append(history.last_day, days))
        if not len(days) or not (np.isfinite(steps) & (steps > 0)).all():
            raise InputError("the days of a forecast must be finite, ascend, and be later than the last run.")
        readings = self._readings(history)
        paths, *_ = self._average(readings, np.append(history.last_day, days))
        random = np.random.default_rng([self.seed, 4])
        x = paths.remaining[:, 1:]
        scatter = readings.typical * paths.noise[:, None] * random.standard_normal(x.shape)
        return np.asarray(readings.initial_friction * np.maximum(x + scatter, 0.0) ** 1.5)

    def _readings(self, history: PreloadHistory) -> Readings:
        if not len(history):
            raise InputError("there is no run to forecast from; at least one is needed.")
        readings = readings_of(history, self.most)
        if not len(readings.days):
            raise InputError("no run shows the preload, the friction or backlash; at least one must.")
        return readings

    def _applicable(self) -> list[Family]:
        families = [family for family in self.families if self.travel is not None or not family.by_travel]
        return [family for family in families if self.hours is not None or not family.by_hours]

    def _average(
        self, readings: Readings, days: Array
    ) -> tuple[_Averaged, dict[str, float], float, dict[str, float]]:
        """Paths of x on some days, weights of families, factor of the width, and probabilities of laws."""
        families = self._applicable()
        duties = [self._duty(family, readings.days) for family in families]
        fits = [
            fit_family(family, self.prior, duty, readings, members=self.members, seed=self.seed)
            for family, duty in zip(families, duties, strict=True)
        ]
        weight, width = weigh_families(fits)
        edges = np.round(np.cumsum(np.append(0.0, weight)) * self.samples).astype(int)
        sampled = np.append(days, days[0] + (days[-1] - days[0]) * _FAR_SPANS)
        ahead = [self._duty(family, sampled) for family in families]
        paths = []
        for fit, past, later, count in zip(fits, duties, ahead, np.diff(edges).tolist(), strict=True):
            paths.append(
                sample_paths(fit, readings, past, sampled, later, width=width, count=count, seed=self.seed)
            )
        averaged = _change_pace(_join(paths, ahead), self.prior, np.stack(ahead), len(days), self.seed)
        names = [family.name for family in families]
        by_law = np.repeat([family.by_law for family in families], [len(fit.weight) for fit in fits])
        exponent = np.concatenate([fit.cloud.exponent for fit in fits])
        probability = np.concatenate([part * fit.weight for part, fit in zip(weight, fits, strict=True)])
        laws = named_laws(exponent[by_law], probability[by_law])
        return averaged, dict(zip(names, weight.tolist(), strict=True)), width, laws

    def _duty(self, family: Family, days: Array) -> Array:
        if family.by_travel and self.travel is not None:
            return np.asarray(self.travel(days))
        if family.by_hours and self.hours is not None:
            return np.asarray(self.hours(days))
        return days


@dataclass(frozen=True, slots=True, eq=False)
class _Averaged(Paths):
    """Paths of all families, with the number of each path's family, and whether its wear has begun."""

    family: NDArray[np.intp]
    begun: NDArray[np.bool_]

    def part(self, selected: NDArray[np.bool_]) -> _Averaged:
        """Select paths by a mask."""
        return _Averaged(**{item.name: getattr(self, item.name)[selected] for item in fields(self)})


def _join(paths: Sequence[Paths], duty: Sequence[Array]) -> _Averaged:
    """Paths of all families together."""
    names = [item.name for item in fields(Paths)]
    columns = {name: np.concatenate([getattr(path, name) for path in paths]) for name in names}
    family = np.repeat(np.arange(len(paths)), [len(path.onset) for path in paths])
    today = np.array([each[0] for each in duty])
    return _Averaged(**columns, family=family, begun=columns["onset"] < today[family])


def _change_pace(paths: _Averaged, prior: FamilyPrior, duty: Array, count: int, seed: int) -> _Averaged:
    """Change the pace of paths whose wear has begun, at a hazard inversely proportional to the duty of wear.

    ``duty`` is that of each family, shape (families, days). Only the first ``count`` days are returned; the
    others are needed for paths that speed up.
    """
    random = np.random.default_rng([seed, 5])
    today = duty[paths.family, 0]
    worn = np.maximum(today - paths.onset, np.maximum(_LEAST_WORN * today, 1.0))
    folds = random.exponential(size=len(worn)) / max(prior.hazard, 1e-9)
    at = np.where(paths.begun, worn * np.expm1(np.minimum(folds, _MOST_FOLDS)), np.inf)
    faster = np.exp(math.log(prior.later) + prior.later_spread * random.standard_normal(len(worn)))
    ahead = duty[paths.family] - today[:, None]
    first = ahead[:, :count]
    reached = first + (faster - 1)[:, None] * np.maximum(first - at[:, None], 0.0)
    rows = zip(reached, ahead, paths.remaining, strict=True)
    return replace(paths, remaining=np.stack([np.interp(*row) for row in rows]))


def weigh_families(fits: Sequence[FamilyFit]) -> tuple[Array, float]:
    """Weights of families by their past forecasts, and the width that those of their average demand.

    Parameters
    ----------
    fits : sequence of FamilyFit
        One per family.

    Returns
    -------
    weight : ndarray, shape (k,)
        Sum to 1.
    width : float
        Root mean square of the normal scores of the average's past forecasts, 1 at least; the largest of
        those one to eight readings ahead.
    """
    known = np.isfinite(fits[0].score)
    share = known / np.array(AHEAD)  # forecasts k readings ahead overlap
    share /= np.maximum(share.sum(axis=1, keepdims=True), 1e-12)
    gain = np.stack([np.sum(share * np.where(known, fit.score, 0.0), axis=1) for fit in fits])
    log_weight = np.tile(np.log([fit.family.weight for fit in fits]), (len(known) + 1, 1))
    total = np.zeros(len(fits))
    for reading in range(len(known)):
        total = _FORGET * total + gain[:, reading]
        log_weight[reading + 1] += total
    weight = np.exp(log_weight - log_sum(log_weight, axis=1)[:, None])
    weight = _LEAST_WEIGHT + (1 - len(fits) * _LEAST_WEIGHT) * weight
    widths = [1.0]
    for column, k in enumerate(AHEAD):
        target = np.flatnonzero(known[:, column])
        below = np.stack([fit.below[target, column] for fit in fits], axis=1)
        normal = ndtri(np.clip(np.sum(weight[target - k + 1] * below, axis=1), 1e-3, 1 - 1e-3))
        # Forecasts of so many readings ahead overlap: every k-th of them is independent.
        widths.append(math.sqrt((_RECORD + np.sum(normal**2) / k) / (_RECORD + len(target) / k)))
    return weight[-1], max(widths)


def _apparent_end(remaining: float, scale: Array) -> Array:
    """X at the end of life as readings show it, whose levels are too large by a scale."""
    if remaining <= 0:
        return np.full(len(scale), remaining)
    return np.asarray((1 + scale * (remaining**-0.5 - 1)) ** -2.0)


def _ratio(remaining: Array, scale: Array) -> Array:
    """P/P₀ of paths of the apparent x; 0 with backlash."""
    level = np.maximum(remaining, 1e-6) ** -0.5 - 1
    true = np.maximum(1 + level / scale[:, None], 0.5) ** -3.0
    return np.asarray(np.where(remaining > 0, true, 0.0))


def first_below(remaining: Array, end: Array, ahead: Array) -> Array:
    """Days until each path first falls to its end, linear between the days of the path.

    Parameters
    ----------
    remaining : ndarray, shape (m, k)
        x.
    end : ndarray, shape (m,)
        x at the end of life.
    ahead : ndarray, shape (k,)
        Days.

    Returns
    -------
    ndarray, shape (m,)
        0 where the end is past, infinite where it is not reached.
    """
    gap = remaining - end[:, None]
    under = gap <= 0
    index = np.argmax(under, axis=1)
    rows, before = np.arange(len(gap)), np.maximum(index - 1, 0)
    high, low = gap[rows, before], gap[rows, index]
    part = np.where(index > 0, high / np.maximum(high - low, 1e-300), 0.0)
    days = ahead[before] + part * (ahead[index] - ahead[before])
    return np.asarray(np.where(under.any(axis=1), days, np.inf))
