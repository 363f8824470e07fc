"""A fixed cycle feature test as a plan: where it stops, how it moves, how often."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

from ballscrew.axis.sheet import DataSheet
from ballscrew.base.errors import InputError
from ballscrew.base.tomlfile import Fields, read_toml

_MOST_STOPS = 1000  # a slip in the step's unit must not fill the memory
_LEAST_PRELOAD = 0.1  # N, that of MODEL.json
_LOWEST, _HIGHEST = 0.0001, 0.2  # preload over Ca, as in a data sheet
STEP_TIME = 1e-3  # s, in which a trapezoid's acceleration steps: a short interpolation cycle of controllers
_ROUNDING = 1e-6  # of a step, in which a range may fail to be whole


@dataclass(frozen=True, slots=True)
class Motion:
    """One jerk-limited move between neighbouring stops.

    Parameters
    ----------
    speed : float
        Speed between acceleration and deceleration, m/s.
    acceleration : float
        Highest acceleration, m/s².
    jerk : float
        Highest jerk, m/s³.
    dwell : float
        Standstill at each stop, s.
    jerk_spread : float
        Variation of the jerk between repetitions: from jerk / (1 + spread) to jerk · (1 + spread).
    start_spread : float
        Longest random extension of a stop, different in each repetition, s.
    """

    speed: float
    acceleration: float
    jerk: float
    dwell: float
    jerk_spread: float = 0.0
    start_spread: float = 0.0

    def to_settings(self) -> dict[str, float]:
        """All values by name, without spreads of 0."""
        settings = asdict(self)
        for name in ("jerk_spread", "start_spread"):
            if not settings[name]:
                del settings[name]
        return settings

    @property
    def reaches_acceleration(self) -> bool:
        """True if the speed is large enough for the acceleration to reach its highest value."""
        return self.speed >= self.acceleration * self.acceleration / self.jerk

    @property
    def jerk_time(self) -> float:
        """Time in which the acceleration rises, and again in which it falls, s."""
        if self.reaches_acceleration:
            return self.acceleration / self.jerk
        return math.sqrt(self.speed / self.jerk)

    @property
    def peak_acceleration(self) -> float:
        """Acceleration that is actually reached, m/s²."""
        return self.jerk * self.jerk_time

    @property
    def acceleration_time(self) -> float:
        """Time of one whole acceleration phase, from standstill to speed, s."""
        return self.speed / self.peak_acceleration + self.jerk_time

    @property
    def acceleration_distance(self) -> float:
        """Way of one whole acceleration phase, m: its speed is symmetric about half the speed."""
        return self.speed * self.acceleration_time / 2


@dataclass(frozen=True, slots=True)
class Plan:
    """One fixed cycle feature test (FCFT).

    Parameters
    ----------
    positions : tuple of float
        Stops, ascending, m.
    repetitions : int
        Round trips.
    masses : tuple of float
        Loads on the table, kg.
    motions : tuple of Motion
        Motions of the test; every stop is measured with each.
    source : str
        Name of the file, for messages.
    warm_up : int
        Round trips before the test, not measured.
    temperature : bool
        Whether the temperature of the axis must be given with each run.
    preloads : tuple of float
        Known preloads of an adjustable nut, N, each measured with every load. Empty: the nut stays as it is.
    """

    positions: tuple[float, ...]
    repetitions: int
    masses: tuple[float, ...]
    motions: tuple[Motion, ...]
    source: str = "the plan"
    warm_up: int = 0
    temperature: bool = False
    preloads: tuple[float, ...] = ()

    @property
    def smallest_gap(self) -> float:
        """Smallest distance of two neighbouring stops, m."""
        return min(b - a for a, b in pairwise(self.positions))

    @property
    def run_count(self) -> int:
        """Number of runs: every load at every preload."""
        return len(self.masses) * max(len(self.preloads), 1)

    def to_settings(self) -> dict[str, Any]:
        """All values as plain dicts and lists, without the file's name and without options that are off."""
        settings: dict[str, Any] = {
            "positions": list(self.positions),
            "repetitions": self.repetitions,
            "masses": list(self.masses),
            "motions": [motion.to_settings() for motion in self.motions],
        }
        if self.warm_up:
            settings["warm_up"] = self.warm_up
        if self.temperature:
            settings["temperature"] = self.temperature
        if self.preloads:
            settings["preloads"] = list(self.preloads)
        return settings


def read_plan(path: str | Path) -> Plan:
    """Read a plan.

    Parameters
    ----------
    path : path-like
        TOML; a quantity is a text with its unit, a bare number is SI. ``positions`` is a list or a table of
        start, stop and step; ``[motion]`` is one motion, ``[[motion]]`` several. Without a jerk the
        speed is a trapezoid: the acceleration steps within 1 ms.

    Returns
    -------
    Plan
        In SI.

    Raises
    ------
    InputError
        If the file is not TOML, or a field is missing, of the wrong kind or impossible.
    """
    top = read_toml(path)
    top.only(("positions", "repetitions", "masses", "motion", "warm_up", "temperature", "preloads"))
    masses = top.quantities("masses", "kg", least=0, most=1e6)
    if len(set(masses)) < len(masses):
        raise top.error("masses", "a list in which each mass stands once")
    preloads = top.quantities("preloads", "N", (), least=_LEAST_PRELOAD, most=1e8)
    if len(set(preloads)) < len(preloads):
        raise top.error("preloads", "a list in which each preload stands once")
    return Plan(
        positions=_positions(top),
        repetitions=top.whole("repetitions", least=1),
        masses=tuple(masses),
        motions=_motions(top),
        source=top.source,
        warm_up=top.whole("warm_up", 0, least=0),
        temperature=top.flag("temperature", False),
        preloads=tuple(preloads),
    )


def validate_plan(plan: Plan, sheet: DataSheet) -> None:
    """Check that an axis can do what a plan asks.

    Parameters
    ----------
    plan : Plan
        The test.
    sheet : DataSheet
        The axis.

    Raises
    ------
    InputError
        If a stop is not on the screw, two neighbours lie too close to reach the speed and stop again, or a
        preload is none that this screw can have.
    """
    low, high = -sheet.screw.bearing_to_zero, sheet.travel_limit
    for position in plan.positions:
        # At -bearing_to_zero the nut would touch the thrust bearing.
        if not low < position <= high * (1 + 1e-9):
            raise InputError(
                f"{plan.source}: positions has {position:g} m, which is not on the screw of "
                f"{sheet.source}; it must be more than {low:g} m and {high:g} m or less."
            )
    rating = sheet.screw.dynamic_load_rating
    for preload in plan.preloads:
        if not _LOWEST * rating <= preload <= _HIGHEST * rating:
            raise InputError(
                f"{plan.source}: preloads has {preload:g} N, which the nut of {sheet.source} cannot have; it "
                f"must be from {_LOWEST * rating:g} N to {_HIGHEST * rating:g} N ({_HIGHEST:.0%} of Ca)."
            )
    for index, motion in enumerate(plan.motions):
        distance = 2 * motion.acceleration_distance
        if plan.smallest_gap < distance * (1 - 1e-9):
            field = "motion.speed" if len(plan.motions) == 1 else f"motion[{index}].speed"
            raise InputError(
                f"{plan.source}: {field} is {motion.speed:g} m/s, for which the axis of {sheet.source} needs "
                f"{distance:g} m to accelerate and stop again, but positions has stops {plan.smallest_gap:g} "
                f"m apart; they must be {distance:g} m apart or more, or the speed lower."
            )


def _positions(top: Fields) -> tuple[float, ...]:
    given = top.table.get("positions")
    if isinstance(given, dict):
        return _stepped(top, top.sub("positions"))
    allowed = "a list of two stops or more in ascending order, or a table { start, stop, step }"
    if not isinstance(given, list):
        raise top.error("positions", allowed)
    stops = top.quantities("positions", "m")
    if not 2 <= len(stops) <= _MOST_STOPS or not _ascending(stops):
        raise top.error("positions", allowed)
    return tuple(stops)


def _stepped(top: Fields, table: Fields) -> tuple[float, ...]:
    table.only(("start", "stop", "step"))
    start = table.quantity("start", "m")
    stop = table.quantity("stop", "m")
    if not stop > start:
        raise table.error("stop", f"more than the start ({start:g} m)")
    step = table.quantity("step", "m", above=0)
    steps = (stop - start) / step
    if steps > _MOST_STOPS - 1:
        raise table.error("step", f"so large that there are {_MOST_STOPS} stops or fewer")
    count = round(steps)
    if not count or abs(steps - count) > _ROUNDING:
        raise table.error("step", f"a whole part of the range from {start:g} m to {stop:g} m")
    # From both ends, rounded to a nanometre: 0.135 and not 0.13499999999999998.
    stops = [round(start + (stop - start) * index / count, 9) for index in range(count + 1)]
    if not _ascending(stops):
        raise top.error("positions", "a range in which neighbouring stops are 1 nm apart or more")
    return tuple(stops)


def _ascending(stops: Sequence[float]) -> bool:
    return all(a < b for a, b in pairwise(stops))


def _motions(top: Fields) -> tuple[Motion, ...]:
    given = top.table.get("motion")
    if not isinstance(given, list):
        return (_motion(top.sub("motion")),)
    if not given:
        raise top.error("motion", "one table [motion], or several headed [[motion]]")
    motions = tuple(_motion(table) for table in top.subs("motion"))
    if len(set(motions)) < len(motions):
        raise top.error("motion", "a list in which each motion stands once (its repetitions are repetitions)")
    return motions


def _motion(table: Fields) -> Motion:
    table.only(Motion.__dataclass_fields__)
    speed = table.quantity("speed", "m/s", least=1e-6, most=100)
    acceleration = table.quantity("acceleration", "m/s^2", least=1e-4, most=1e4)
    return Motion(
        speed=speed,
        acceleration=acceleration,
        jerk=table.quantity("jerk", "m/s^3", acceleration / STEP_TIME, least=1e-3, most=1e9),
        dwell=table.quantity("dwell", "s", least=0, most=3600),
        jerk_spread=table.quantity("jerk_spread", "", 0.0, least=0, most=1),
        start_spread=table.quantity("start_spread", "s", 0.0, least=0, most=60),
    )
