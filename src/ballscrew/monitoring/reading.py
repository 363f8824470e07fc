"""Quantities of one run for its history."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True, slots=True, eq=False)
class Reading:
    """Quantities of one run relative to its epoch; nan where not known.

    Parameters
    ----------
    run : str
        Id.
    measured_at : str
        ISO 8601.
    day : float
        Since the first run of the history.
    epoch : int
        From 0.
    temperature : float
        °C.
    level : float
        u − 1 against the epoch's reference, u = (P/P₀)^(−1/3).
    random : float
        Random part of the level's standard uncertainty, as stated.
    verdict : str
        good, suspect or refused.
    reasons : tuple of str
        Why it is not good; notes on a good run.
    equivalent_mass : float
        kg.
    friction, friction_uncertainty : float
        Coulomb, N.
    backlash, backlash_uncertainty : float
        Lost motion in excess of the baseline's, m.
    features : mapping of str to float
        Other quantities of the run, where known, in SI.
    systematic : float
        Systematic part of the level's standard uncertainty, without that of the nut's share.
    mass_over_preload, mass_over_preload_uncertainty : float
        kg/N.
    """

    run: str
    measured_at: str
    day: float
    epoch: int
    temperature: float
    level: float
    random: float
    verdict: str
    reasons: tuple[str, ...] = ()
    equivalent_mass: float = math.nan
    friction: float = math.nan
    friction_uncertainty: float = math.nan
    backlash: float = math.nan
    backlash_uncertainty: float = math.nan
    features: Mapping[str, float] = field(default_factory=dict)
    systematic: float = 0.0
    mass_over_preload: float = math.nan
    mass_over_preload_uncertainty: float = math.nan
