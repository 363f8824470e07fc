"""The course of one epoch, as a life model sees it: plain arrays, one entry a good run."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError, shown

__all__ = ["Course", "course"]

CEILING = 1.5  # the level of a nut that carries a load of half of its new preload on one flank
_ARRAYS = (
    "days",
    "level",
    "random",
    "temperature",
    "backlash",
    "backlash_uncertainty",
    "friction",
    "friction_uncertainty",
)
_MOST_RUNS = 100_000


@dataclass(frozen=True, slots=True, eq=False)
class Course:
    """One epoch's history.

    Parameters
    ----------
    days : ndarray, shape (n,)
        Of the good runs, since the first of them, ascending.
    level : ndarray, shape (n,)
        (P/P₀)^(−1/3) − 1 as each run tells it; NaN where it tells none.
    random : ndarray, shape (n,)
        Standard uncertainty of the level that another run draws anew, as told.
    temperature : ndarray, shape (n,)
        Against the reference, K; NaN where not recorded.
    scale : float
        Relative standard uncertainty of the level that all runs share.
    backlash, backlash_uncertainty : ndarray, shape (n,)
        m; NaN where not observed. What lies below the resolution is known to lie there, no more.
    resolution : float
        The least backlash that can be seen, m.
    friction, friction_uncertainty : ndarray, shape (n,)
        N, or any other unit; NaN where not known.
    pressed : float
        δ₀, the depth of wear at which the preload is gone, m.
    ceiling : float
        The level that is not exceeded, however little preload is left: the test's own nut load F keeps one
        flank as rigid as a preload of F/8 would.

    Raises
    ------
    InputError
        If shapes differ, days do not ascend, or a number cannot be.
    """

    days: Array
    level: Array
    random: Array
    temperature: Array
    scale: float
    backlash: Array
    backlash_uncertainty: Array
    resolution: float
    friction: Array
    friction_uncertainty: Array
    pressed: float
    ceiling: float = CEILING

    def __post_init__(self) -> None:
        """Refuse what cannot be."""
        for name in _ARRAYS:
            object.__setattr__(self, name, _column(name, getattr(self, name)))
        n = len(self.days)
        for name in _ARRAYS:
            if len(getattr(self, name)) != n:
                raise InputError(
                    f"a course has {len(getattr(self, name))} entries of {name} and {n} of days; "
                    "there must be one a run."
                )
        if not np.isfinite(self.days).all() or np.any(np.diff(self.days) < 0):
            raise InputError("the days of a course must be finite and ascend.")
        for told, spread in (
            ("level", "random"),
            ("backlash", "backlash_uncertainty"),
            ("friction", "friction_uncertainty"),
        ):
            values, sure = getattr(self, told), getattr(self, spread)
            seen = ~np.isnan(values)
            if np.isinf(values).any() or not (np.isfinite(sure[seen]) & (sure[seen] > 0)).all():
                raise InputError(
                    f"a {told} of a course is infinite or has no standard uncertainty above 0 ({spread})."
                )
        if np.isinf(self.temperature).any():
            raise InputError("a temperature of a course is infinite; it must be a number of K, or NaN.")
        if (self.level[~np.isnan(self.level)] <= -1).any():
            raise InputError("a level of a course is -1 or less; it is (P/P0)^(-1/3) - 1, more than -1.")
        for name, least in (("scale", 0.0), ("resolution", 0.0), ("pressed", None), ("ceiling", None)):
            value = getattr(self, name)
            good = isinstance(value, (int, float)) and math.isfinite(value)
            if not good or value < 0 or (least is None and value == 0):
                allowed = "0 or more" if least is not None else "more than 0"
                raise InputError(f"the {name} of a course is {shown(value)}; it must be {allowed}.")

    def __len__(self) -> int:
        """Number of runs."""
        return len(self.days)

    def until(self, day: float) -> Course:
        """What was known at the end of a day.

        Parameters
        ----------
        day : float
            Of the epoch.

        Returns
        -------
        Course
            The runs up to it.
        """
        return self.part(self.days <= day)

    def part(self, kept: NDArray[np.bool_]) -> Course:
        """Some of the runs."""
        return replace(self, **{name: getattr(self, name)[kept] for name in _ARRAYS})


def course(
    days: ArrayLike,
    level: ArrayLike | None = None,
    random: ArrayLike | None = None,
    *,
    temperature: ArrayLike | None = None,
    scale: float = 0.1,
    backlash: ArrayLike | None = None,
    backlash_uncertainty: ArrayLike | None = None,
    resolution: float = 0.0,
    friction: ArrayLike | None = None,
    friction_uncertainty: ArrayLike | None = None,
    pressed: float = 1e-5,
    ceiling: float = CEILING,
) -> Course:
    """A course of which not everything was observed; parameters and errors as :class:`Course`.

    Returns
    -------
    Course
        With NaN for what is not given.
    """
    when = _column("days", days)
    given = {
        "level": level,
        "random": random,
        "temperature": temperature,
        "backlash": backlash,
        "backlash_uncertainty": backlash_uncertainty,
        "friction": friction,
        "friction_uncertainty": friction_uncertainty,
    }
    columns = {
        name: np.full(len(when), np.nan) if values is None else _column(name, values, len(when))
        for name, values in given.items()
    }
    rest = {"scale": scale, "resolution": resolution, "pressed": pressed, "ceiling": ceiling}
    assert {f.name for f in fields(Course)} == {"days", *columns, *rest}  # noqa: S101
    return Course(days=when, **columns, **rest)  # type: ignore[arg-type]


def _column(name: str, values: ArrayLike, size: int | None = None) -> Array:
    try:
        array = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"{name} of a course is {shown(values)}; it must be numbers, one a run.") from None
    if array.ndim == 0 and size is not None:
        array = np.full(size, float(array))
    if array.ndim != 1:
        raise InputError(f"{name} of a course has {array.ndim} dimensions; it must be numbers, one a run.")
    if len(array) > _MOST_RUNS:
        raise InputError(f"a course of {len(array)} runs was given; it must be {_MOST_RUNS} or fewer.")
    return array
