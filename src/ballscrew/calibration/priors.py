"""What is believed of each cause before a run is looked at: judgement, stated and changeable."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

from ballscrew.base.errors import InputError, shown

__all__ = ["Priors"]


@dataclass(frozen=True, slots=True)
class Priors:
    """Chances, sizes and odds by which causes are compared.

    Chances and sizes have no source but judgement: a nut wears far more often than a bearing runs in, or
    somebody declares a wrong load. A chance twice as large makes odds twice as large; decisions take odds of
    ten or thirty. The sizes are standard deviations of what is plausible.

    Parameters
    ----------
    nut_chance, bearing_chance, load_chance, torque_chance, position_chance, local_chance, temperature_chance
        Of each cause before the run is seen; only their ratios count.
    nut_size : float
        Of u = (P/P₀)^(−1/3); a loss of half of the preload is 0.26.
    bearing_size : float
        Of the bearing's rigidity, as a part of it.
    position_size : float
        Of a zero that has moved, m.
    local_size : float
        Of the nut's compliance at a stop, as a part of it; a loss of 30 % is 0.13.
    local_length : float
        Over which a change at some stops hangs together, m: two to three nut lengths make 0.06.
    as_good : float
        Of χ², by which a cause may be worse than the nut and still be possible: 95 % of two more numbers.
    plausible : float
        Standard deviations of its size beyond which a cause is too large to be possible.
    odds : float
        From which a wrong load and a drifted torque constant are told apart: about where evidence begins to
        be very strong by Jeffreys (1961), Theory of Probability, 3rd ed., appendix B.
    loud : float
        Odds of a wrong load against all else, from which masses that say nothing are not believed: where
        evidence begins to be strong, ibid.
    apart : float
        Standard uncertainties of the preload between two readings of it, from which one interval for both
        tells nothing.

    Raises
    ------
    InputError
        If one is not above 0.
    """

    nut_chance: float = 0.6
    bearing_chance: float = 0.08
    load_chance: float = 0.08
    torque_chance: float = 0.08
    position_chance: float = 0.04
    local_chance: float = 0.08
    temperature_chance: float = 0.08
    nut_size: float = 0.3
    bearing_size: float = 0.10
    position_size: float = 2e-3
    local_size: float = 0.15
    local_length: float = 0.06
    as_good: float = 6.0
    plausible: float = 2.5
    odds: float = 30.0
    loud: float = 10.0
    apart: float = 6.0

    def __post_init__(self) -> None:
        """Refuse what cannot be."""
        for field in fields(self):
            value = getattr(self, field.name)
            number = isinstance(value, (int, float)) and not isinstance(value, bool)
            if not (number and math.isfinite(value) and value > 0):
                raise InputError(f"{field.name} is {shown(value)}; it must be a number above 0.")

    def chance(self, cause: str) -> float:
        """Of a cause by its name, before the run is seen."""
        return float(getattr(self, f"{cause}_chance"))
