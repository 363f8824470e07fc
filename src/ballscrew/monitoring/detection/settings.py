"""What the user may decide of the detection, and what is believed before an axis has shown anything."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields

from ballscrew.base.errors import InputError, shown
from ballscrew.calibration.assumptions import Assumptions

__all__ = ["MonitorSettings"]

_MOST_ALARMS = 52.0
_NUMBERS = ("false_alarms_per_year", "watch", "scale", "scale_degrees", "odd", "odd_size", "clip")
_OTHERS = ("odd_stays", "repeats_per_year", "greased", "remounted", "suspect", "thermometer")
_WHOLE = {"baseline_runs": 3, "calm_runs": 1, "draws": 1000, "seed": 0}


@dataclass(frozen=True, slots=True)
class MonitorSettings:
    """Settings of :func:`ballscrew.monitoring.state.health_state`.

    Parameters
    ----------
    false_alarms_per_year : float
        Of a healthy axis; the limits are computed to it.
    watch : float
        How many times as often a healthy axis may be put under watch.
    repeats_per_year : float
        How often a healthy axis is asked for a second run on the same day; 0 for never.
    baseline_runs : int
        Good runs of an epoch that make its baseline, at most; 3 are enough to begin.
    calm_runs : int
        After how many good runs below the limit of watch an alarm is over.
    suspect : float
        Probability that a good run is left out because it does not fit its epoch.
    scale, scale_degrees : float
        Scatter from run to run over the told one: its typical value, and as of how many runs that is known.
    odd, odd_size : float
        Part of the runs that are off by more than they say, and how many times as much.
    odd_stays : float
        Part of these whose repeat on the same day is off by the same again.
    greased, remounted : float
        Standard deviation of the step of the level that these make.
    thermometer : float
        By how much a temperature that is told may differ from what the nut feels, K.
    clip : float
        Standard deviations by which one run may stand above the one before it and count in full.
    draws, seed : int
        Healthy histories that are simulated for the limits.
    assumptions : Assumptions
        Of ``preload``.

    Raises
    ------
    InputError
        If one cannot be.
    """

    false_alarms_per_year: float = 0.1
    watch: float = 10.0
    repeats_per_year: float = 8.0
    baseline_runs: int = 10
    calm_runs: int = 5
    suspect: float = 0.001
    scale: float = 0.6
    scale_degrees: float = 5.0
    odd: float = 0.03
    odd_size: float = 4.0
    odd_stays: float = 0.25
    greased: float = 0.02
    remounted: float = 0.01
    thermometer: float = 0.2
    clip: float = 3.0
    draws: int = 10_000
    seed: int = 7
    assumptions: Assumptions = field(default_factory=Assumptions)

    def __post_init__(self) -> None:
        """Refuse what cannot be."""
        for one in fields(self):
            value = getattr(self, one.name)
            if one.name == "assumptions":
                continue
            number = isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)
            if one.name in _WHOLE:
                least = _WHOLE[one.name]
                if not (number and isinstance(value, int) and value >= least):
                    raise InputError(
                        f"{one.name} is {shown(value)}; it must be a whole number, {least} or more."
                    )
            elif not number or value < 0 or (value == 0 and one.name in _NUMBERS and one.name != "odd"):
                least_words = "0 or more" if one.name in (*_OTHERS, "odd") else "more than 0"
                raise InputError(f"{one.name} is {shown(value)}; it must be a number, {least_words}.")
        if self.false_alarms_per_year > _MOST_ALARMS:
            raise InputError(
                f"{self.false_alarms_per_year:g} false alarms a year are asked for; nobody heeds more than "
                f"{_MOST_ALARMS:g}."
            )
        if 0 < self.repeats_per_year < 1:
            raise InputError(
                f"{self.repeats_per_year:g} repeats a year are asked for; it must be 0, or 1 at least."
            )
        if self.watch < 1:
            raise InputError(f"watch is {self.watch:g}; it must be 1 or more.")
        for name in ("odd", "odd_stays", "suspect"):
            if not getattr(self, name) < 1:
                raise InputError(f"{name} is {getattr(self, name):g}; it must be less than 1.")
