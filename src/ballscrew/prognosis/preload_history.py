"""The history of one epoch for the life models: plain arrays, one entry per good run."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ballscrew.base.arrays import Array
from ballscrew.base.blocks import anchored_blocks
from ballscrew.base.errors import InputError, shown
from ballscrew.base.settings import check_setting

CEILING = 1.5  # the level of a nut that carries a load of half of its new preload on one flank
_ARRAYS = (
    "days",
    "level",
    "level_uncertainty",
    "temperature",
    "backlash",
    "backlash_uncertainty",
    "friction",
    "friction_uncertainty",
)
_LONGEST = 100_000  # runs
_MEDIAN = math.sqrt(math.pi / 2)  # standard deviation of a median over that of a mean
_FIRST_FRICTIONS = 5  # runs whose mean friction is that of the new preload
_FEWEST_RATIOS = 3  # runs that a line and its scatter need


@dataclass(frozen=True, slots=True, eq=False)
class PreloadHistory:
    """History of one epoch.

    Parameters
    ----------
    days : ndarray, shape (n,)
        Days of the good runs since the first of them, ascending.
    level : ndarray, shape (n,)
        (P/P₀)^(−1/3) − 1 by each run; NaN where a run does not give it.
    level_uncertainty : ndarray, shape (n,)
        Standard uncertainty of the level, its random part, as the run states it.
    temperature : ndarray, shape (n,)
        Relative to the reference, K; NaN where not recorded.
    scale : float
        Relative standard uncertainty of the level that all runs share.
    backlash, backlash_uncertainty : ndarray, shape (n,)
        m; NaN where not observed. A value below the resolution counts as below the resolution only.
    resolution : float
        The least observable backlash, m.
    friction, friction_uncertainty : ndarray, shape (n,)
        N, or any other unit; NaN where not known.
    approach : float
        δ₀, elastic approach of the flanks by the new preload: the depth of wear at which it is gone, m.
    ceiling : float
        Upper bound of the level, however little preload remains: the test's own nut load F keeps one flank as
        rigid as a preload of F/8 would.

    Raises
    ------
    InputError
        If shapes differ, days do not ascend, or a number is out of range.
    """

    days: Array
    level: Array
    level_uncertainty: Array
    temperature: Array
    scale: float
    backlash: Array
    backlash_uncertainty: Array
    resolution: float
    friction: Array
    friction_uncertainty: Array
    approach: float
    ceiling: float = CEILING

    def __post_init__(self) -> None:
        """Check shapes and ranges."""
        for name in _ARRAYS:
            object.__setattr__(self, name, _column(name, getattr(self, name)))
        self._check_days()
        for name in ("level", "backlash", "friction"):
            self._check_observations(name)
        if np.isinf(self.temperature).any():
            raise InputError("a temperature of a history is infinite; it must be a number of K, or NaN.")
        if (self.level <= -1).any():
            raise InputError("a level of a history is -1 or less; it is (P/P0)^(-1/3) - 1, more than -1.")
        for name in ("scale", "resolution"):
            check_setting(f"the {name} of a history", getattr(self, name), least=0.0)
        for name in ("approach", "ceiling"):
            check_setting(f"the {name} of a history", getattr(self, name), above=0.0)

    def _check_days(self) -> None:
        n = len(self.days)
        for name in _ARRAYS:
            size = len(getattr(self, name))
            if size != n:
                raise InputError(
                    f"a history has {size} entries of {name} and {n} of days; there must be one a run."
                )
        if not np.isfinite(self.days).all() or np.any(np.diff(self.days) < 0):
            raise InputError("the days of a history must be finite and ascend.")

    def _check_observations(self, name: str) -> None:
        values, uncertainty = getattr(self, name), getattr(self, f"{name}_uncertainty")
        uncertainty = uncertainty[~np.isnan(values)]
        certain = np.isfinite(uncertainty) & (uncertainty > 0)
        if np.isinf(values).any() or not certain.all():
            raise InputError(
                f"a {name} of a history is infinite or has no standard uncertainty above 0 "
                f"({name}_uncertainty)."
            )

    def __len__(self) -> int:
        """Number of runs."""
        return len(self.days)

    @property
    def last_day(self) -> float:
        """Day of the last run; 0 where there is none."""
        return float(max(self.days[-1:], default=0.0))

    def until(self, day: float) -> PreloadHistory:
        """History at the end of a day.

        Parameters
        ----------
        day : float
            Day of the epoch.

        Returns
        -------
        PreloadHistory
            The runs up to it.
        """
        return self.part(self.days <= day)

    def part(self, selected: NDArray[np.bool_]) -> PreloadHistory:
        """Select runs by a mask."""
        columns = {name: getattr(self, name)[selected] for name in _ARRAYS}
        return replace(self, **columns)


def preload_history(
    days: ArrayLike,
    level: ArrayLike = math.nan,
    level_uncertainty: ArrayLike = math.nan,
    *,
    temperature: ArrayLike = math.nan,
    scale: float = 0.1,
    backlash: ArrayLike = math.nan,
    backlash_uncertainty: ArrayLike = math.nan,
    resolution: float = 0.0,
    friction: ArrayLike = math.nan,
    friction_uncertainty: ArrayLike = math.nan,
    approach: float = 1e-5,
    ceiling: float = CEILING,
) -> PreloadHistory:
    """Build a history of which not everything was observed; parameters and errors as :class:`PreloadHistory`.

    Returns
    -------
    PreloadHistory
        With NaN for what is not given.
    """
    when = _column("days", days)
    n = len(when)
    return PreloadHistory(
        days=when,
        level=_column("level", level, n),
        level_uncertainty=_column("level_uncertainty", level_uncertainty, n),
        temperature=_column("temperature", temperature, n),
        scale=scale,
        backlash=_column("backlash", backlash, n),
        backlash_uncertainty=_column("backlash_uncertainty", backlash_uncertainty, n),
        resolution=resolution,
        friction=_column("friction", friction, n),
        friction_uncertainty=_column("friction_uncertainty", friction_uncertainty, n),
        approach=approach,
        ceiling=ceiling,
    )


def preload_cube_root(history: PreloadHistory) -> tuple[Array, Array, Array, Array]:
    """(P/P₀)^(1/3) of each run, for models of one quantity.

    Parameters
    ----------
    history : PreloadHistory
        With levels; or else with friction, which is then taken as proportional to the preload.

    Returns
    -------
    days, value, standard_uncertainty, temperature : ndarray, shape (n,)
        Temperature in K, 0 where it is not known.

    Raises
    ------
    InputError
        If fewer than three runs give it.
    """
    observed = np.isfinite(history.level)
    if observed.any():
        value = 1 / (1 + history.level[observed])
        spread = value**2 * history.level_uncertainty[observed]
    else:
        observed = np.isfinite(history.friction) & (history.friction > 0)
        force = history.friction[observed]
        new = np.mean(force[:_FIRST_FRICTIONS]) if len(force) else 1.0
        value = np.cbrt(force / float(new))
        spread = value / 3 * history.friction_uncertainty[observed] / force
    count = int(observed.sum())
    if count < _FEWEST_RATIOS:
        raise InputError(f"{count} runs give the preload; this life model needs {_FEWEST_RATIOS} at least.")
    return history.days[observed], value, spread, np.nan_to_num(history.temperature[observed])


def pool_runs(history: PreloadHistory, most: int) -> PreloadHistory:
    """Pool neighbouring older runs where there are more than a limit; three fifths of it stay single.

    Parameters
    ----------
    history : PreloadHistory
        n runs.
    most : int
        Largest number of runs that are not pooled.

    Returns
    -------
    PreloadHistory
        By :func:`~ballscrew.base.blocks.anchored_blocks`, so that another run changes few of the entries.
        Medians of levels, frictions and backlashes, which are robust against outliers; means of days and
        temperatures; standard uncertainties of a median of so many.
    """
    if len(history) <= most:
        return history
    starts = anchored_blocks(len(history), most * 3 // 5)
    groups = np.split(np.arange(len(history)), starts[1:])

    def reduced(values: Array, statistic: Callable[[Array], Any]) -> Array:
        return np.array([_of_finite(values[group], statistic) for group in groups])

    def pooled(name: str) -> dict[str, Any]:
        values, stated = getattr(history, name), getattr(history, f"{name}_uncertainty")
        count = np.add.reduceat(np.isfinite(values), starts, dtype=int)
        gain = np.where(count > 2, _MEDIAN / np.sqrt(np.maximum(count, 1)), 1.0)
        spread = reduced(np.where(np.isfinite(values), stated, np.nan), np.median)
        return {name: reduced(values, np.median), f"{name}_uncertainty": spread * gain}

    columns: dict[str, Any] = pooled("level") | pooled("backlash") | pooled("friction")
    columns["days"] = reduced(history.days, np.mean)
    columns["temperature"] = reduced(history.temperature, np.mean)
    return replace(history, **columns)


def _of_finite(values: Array, statistic: Callable[[Array], Any]) -> float:
    finite = values[np.isfinite(values)]
    if not len(finite):
        return math.nan
    return float(statistic(finite))


def _column(name: str, values: ArrayLike, size: int | None = None) -> Array:
    try:
        array = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"{name} of a history is {shown(values)}; it must be numbers, one a run.") from None
    if array.ndim == 0 and size is not None:
        array = np.full(size, float(array))
    if array.ndim != 1:
        raise InputError(f"{name} of a history has {array.ndim} dimensions; it must be numbers, one a run.")
    if len(array) > _LONGEST:
        raise InputError(f"a history of {len(array)} runs was given; it must be {_LONGEST} or fewer.")
    return array
