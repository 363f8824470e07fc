"""Settings of the joint estimator."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Literal

from ballscrew.base.errors import InputError

Response = Literal["nut", "motor", "both"]
RESPONSES: tuple[Response, ...] = ("nut", "motor", "both")


@dataclass(frozen=True, slots=True)
class JointSettings:
    """Settings.

    Parameters
    ----------
    band_low, band_high : float
        Of the band, as parts of the mode's frequency in the middle of the axis.
    lowest, highest : float
        Where the mode may lie where no data sheet says, Hz.
    rate : float
        Samples per second, as a multiple of the mode's frequency; more are thinned out.
    floor, motor_floor : float
        White noise added to the residual's spectrum before it is whitened, as a part of its power, where the
        nut answers the torque, and where the motor does.
    slopes : float
        Standard deviation by which the two frequencies' squares may part along the axis, as a part.
    model_floor, rotor_held_floor : float
        Least standard uncertainty with the rotor free and held, as a part of the frequency. The encoder's
        noise is an error of the input there.
    most_unexplained : float
        Part of the power in the band that the model may leave; more is refused.
    most_load : float
        Highest load on the nut over its preload; beyond it the cell is refused.
    most_uncertainty : float
        Standard uncertainty as a part of the frequency, above which a cell is refused.
    """

    band_low: float = 0.5
    band_high: float = 2.6
    lowest: float = 40.0
    highest: float = 500.0
    rate: float = 16.0
    floor: float = 1.0
    motor_floor: float = 0.2
    slopes: float = 0.1
    model_floor: float = 0.000075
    rotor_held_floor: float = 0.0025
    most_unexplained: float = 0.5
    most_load: float = 8.0
    most_uncertainty: float = 0.006

    def __post_init__(self) -> None:
        """Refuse a band without the mode, and values that are not positive."""
        if not 0 < self.band_low < 1 < self.band_high < float("inf"):
            raise InputError(
                f"the band reaches from {self.band_low:g} to {self.band_high:g} times the mode's frequency;"
                " it must contain the mode."
            )
        if not 0 < self.lowest < self.highest < float("inf"):
            raise InputError(
                f"the mode is sought from {self.lowest:g} to {self.highest:g} Hz;"
                " this must rise, from above 0."
            )
        if not 6 <= self.rate < float("inf"):
            raise InputError(f"the rate is {self.rate:g} times the mode's frequency; it must be 6 or more.")
        for name, value in asdict(self).items():
            if not 0 < value < float("inf"):
                raise InputError(f"{name} is {value:g}; it must be more than 0.")
