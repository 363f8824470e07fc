"""Tables of :mod:`benchmarks.early`."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtri

from ballscrew.monitoring.detection.settings import MonitorSettings

__all__ = ["Alarm", "baseline_table", "check_table", "paper_table", "rate", "replaced_table", "table"]

QUARTER = 0.25
YEAR = 365.25


@dataclass(frozen=True, slots=True)
class Alarm:
    """The first alarm of an axis.

    Parameters
    ----------
    day : float or None
        Of the history; None where there was none.
    run : int or None
        Which.
    lost : float
        Of the preload by then.
    onset : float
        Day on which wear begins; infinite where it does not.
    until : float
        Day up to which it was followed.
    repeats : int
        Runs that were made again on the same day, by then.
    """

    day: float | None
    run: int | None
    lost: float
    onset: float
    until: float
    repeats: int = 0

    @property
    def false(self) -> bool:
        """Whether nothing was worn."""
        return self.day is not None and self.day <= self.onset


def rate(sound: Sequence[Alarm]) -> tuple[int, float, tuple[float, float]]:
    """False alarms a year: how many, in how many years at risk, and the exact 95 % interval of their rate."""
    risk = sum(min(alarm.until if alarm.day is None else alarm.day, alarm.onset) for alarm in sound) / YEAR
    count = sum(alarm.false for alarm in sound)
    low = float(chdtri(2 * count, 0.975)) / 2 if count else 0.0
    return count, risk, (low / risk, float(chdtri(2 * count + 2, 0.025)) / 2 / risk)


def _losses(worn: Sequence[Alarm]) -> list[float]:
    """Of lives that were not alarmed before they wore; a life that never alarms has lost all."""
    return [1.0 if alarm.day is None else alarm.lost for alarm in worn if not alarm.false]


def _row(worn: Sequence[Alarm], sound: Sequence[Alarm]) -> str:
    lost = _losses(worn)
    middle, high = np.quantile(lost, [0.5, 0.95], method="inverted_cdf")
    early = 100 * np.mean(np.array(lost) < QUARTER)
    count, risk, (least, most) = rate(sound)
    late = sum(value >= 1 for value in lost)
    return (
        f"{len(lost)} | {_percent(middle)} % | {_percent(high)} % | {early:.0f} % | {late} | "
        f"{count} in {risk:.0f} | {count / risk:.2f} ({least:.2f} to {most:.2f})"
    )


def _repeats(sound: Sequence[Alarm]) -> str:
    count, risk = sum(alarm.repeats for alarm in sound), rate(sound)[1]
    return f"{count / risk:.1f}" if count else "–"


def _percent(part: float) -> str:
    return "> 55" if part >= 1 else f"{100 * part:.1f}"


_HEAD = (
    "lives | lost at the alarm: median | 95 % | before a quarter | not by 55 % | "
    "false alarms in axis-years | a year (95 %) |"
)


def table(by: Mapping[str, tuple[Sequence[Alarm], Sequence[Alarm]]]) -> list[str]:
    """Methods beside each other."""
    stated = MonitorSettings().false_alarms_per_year
    rows = [f"| {name} | {_row(*of)} | {_repeats(of[1])} |" for name, of in by.items()]
    return [
        f"| method | {_HEAD} repeats a year |",
        "|---|---|---|---|---|---|---|---|---|",
        *rows,
        "",
        f"Stated: {stated:g} false alarms a year of a healthy axis.",
    ]


def baseline_table(by: Mapping[int, tuple[Sequence[Alarm], Sequence[Alarm]]]) -> list[str]:
    """By the number of runs that make the baseline."""
    rows = [f"| {count} | {_row(*of)} |" for count, of in by.items()]
    return [f"| baseline runs | {_HEAD}", "|---|---|---|---|---|---|---|---|", *rows]


def paper_table(found: Sequence[Alarm]) -> list[str]:
    """Which run after the baseline of three alarms."""
    after = np.array([math.inf if alarm.run is None else alarm.run - 2 for alarm in found])
    lost = [1.0 if alarm.day is None else alarm.lost for alarm in found]
    shares = " | ".join(f"{100 * np.mean(after == k):.0f} %" for k in (1, 2, 3))
    return [
        "| axes | alarm at run 1 after the baseline | 2 | 3 | later | median run | lost, median | 95 % |",
        "|---|---|---|---|---|---|---|---|",
        (
            f"| {len(found)} | {shares} | {100 * np.mean(after > 3):.0f} % | {np.median(after):.0f} | "
            f"{100 * np.median(lost):.0f} % | {100 * np.quantile(lost, 0.95):.0f} % |"
        ),
    ]


def _text(alarm: Alarm) -> str:
    if alarm.day is None:
        return "none"
    return f"day {alarm.day:.0f}, {100 * alarm.lost:.1f} %" + (" (false)" if alarm.false else "")


def check_table(both: Sequence[Mapping[str, Alarm]]) -> list[str]:
    """Lives by the whole way and at the level of levels, each with its own scatter."""
    rows = [
        f"| {i} | {life['levels'].onset:.1f} | {_text(life['mode tables'])} | {_text(life['levels'])} |"
        for i, life in enumerate(both)
    ]
    middle = [
        f"{100 * np.median(_losses([life[name] for life in both])):.1f} %"
        for name in ("mode tables", "levels")
    ]
    return [
        "| life | wear begins on day | from mode tables: alarm, lost | from levels |",
        "|---|---|---|---|",
        *rows,
        f"| median | | {middle[0]} | {middle[1]} |",
    ]


def _alarms(alarms: Sequence[Alarm]) -> int:
    return sum(alarm.day is not None for alarm in alarms)


def replaced_table(found: Sequence[Mapping[str, Alarm]]) -> list[str]:
    """A nut that is replaced: alarms before and after."""
    first, second = ([life[f"epoch {k}"] for life in found] for k in (0, 1))
    lost = _losses(first)
    return [
        "| axes | alarm before the new nut | lost by then, median | alarms in 30 days of the new nut |",
        "|---|---|---|---|",
        (f"| {len(found)} | {_alarms(first)} | {100 * np.median(lost):.1f} % | {_alarms(second)} |"),
    ]
