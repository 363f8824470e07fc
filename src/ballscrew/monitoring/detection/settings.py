"""Settings of the detection: rates that the user chooses, and priors of a typical axis."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from scipy.special import ndtri

from ballscrew.base.errors import InputError
from ballscrew.base.settings import check_setting, check_whole
from ballscrew.calibration.assumptions import Assumptions

_MOST_ALARMS = 52.0  # a year: more than one a week would be ignored
_POSITIVE = ("scale", "scale_degrees", "odd_size", "clip")
_NOT_NEGATIVE = ("odd", "odd_stays", "repeats_per_year", "greased", "remounted", "suspect", "thermometer")
_LEAST_WHOLE = {"baseline_runs": 3, "calm_runs": 1, "draws": 1000, "seed": 0}


@dataclass(frozen=True, slots=True)
class MonitorSettings:
    """Settings of :func:`ballscrew.monitoring.health.health_state`.

    Parameters
    ----------
    false_alarms_per_year : float
        False alarms of a healthy axis; the limits are computed from it.
    watch : float
        Rate of false watches over that of false alarms.
    repeats_per_year : float
        Requests for a second run on the same day, of a healthy axis; 0 for never.
    baseline_runs : int
        Largest number of good runs in the baseline of an epoch; detection begins after 3.
    calm_runs : int
        Good runs in a row below the limit of watch that end an alarm.
    suspect : float
        Probability that a good run is excluded because it does not fit its epoch.
    scale, scale_degrees : float
        Scatter from run to run over the stated uncertainty: its typical value, and the degrees of freedom of
        that.
    odd, odd_size : float
        Part of the runs that are outliers, and their scatter over that of the others.
    odd_stays : float
        Part of the outliers whose repeat on the same day has the same error.
    greased, remounted : float
        Standard deviation of the step of the level by grease, and by a remounted sensor.
    thermometer : float
        Standard deviation of the recorded temperature from that of the nut, K.
    clip : float
        Standard deviations by which a run may exceed the one before it and count in full.
    draws, seed : int
        Number of healthy histories that are simulated for the limits, and their seed.
    assumptions : Assumptions
        Assumptions of ``preload``.

    Raises
    ------
    InputError
        If a number is out of range.
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
        """Check the numbers."""
        check_setting("false_alarms_per_year", self.false_alarms_per_year, above=0.0, most=_MOST_ALARMS)
        check_setting("watch", self.watch, least=1.0)
        for name in _POSITIVE:
            check_setting(name, getattr(self, name), above=0.0)
        for name in _NOT_NEGATIVE:
            check_setting(name, getattr(self, name), least=0.0)
        for name, least in _LEAST_WHOLE.items():
            check_whole(name, getattr(self, name), least)
        if 0 < self.repeats_per_year < 1:
            raise InputError(f"repeats_per_year is {self.repeats_per_year:g}; it must be 0, or 1 or more.")
        for name in ("odd", "odd_stays", "suspect"):
            if not getattr(self, name) < 1:
                raise InputError(f"{name} is {getattr(self, name):g}; it must be less than 1.")

    @property
    def deviations(self) -> float:
        """Standard deviations that a good run exceeds with the probability ``suspect``."""
        return float(-ndtri(self.suspect / 2)) if self.suspect > 0 else math.inf
