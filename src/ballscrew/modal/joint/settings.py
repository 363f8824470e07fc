"""Settings of the joint estimator."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Literal

from ballscrew.base.errors import InputError

Response = Literal["nut", "motor", "both"]
RESPONSES: tuple[Response, ...] = ("nut", "motor", "both")


@dataclass(frozen=True, slots=True)
class JointSettings:
    """Settings of the joint estimator.

    Parameters
    ----------
    band_low, band_high : float
        Limits of the frequency band that is fitted, over the mode's frequency in the middle of the axis.
    lowest, highest : float
        Range in which the mode is searched for without a data sheet, Hz.
    rate : float
        Sampling rate over the mode's frequency; recordings with a higher one are decimated. The least rate is
        :data:`ballscrew.fcft.trace.SAMPLES_PER_PERIOD` samples per period of the mode.
    floor, motor_floor : float
        Power of the white noise that is added to the residual's spectrum before the whitening filter is
        computed, over the power of the residual: for the response of the nut to the torque, and for that of
        the motor. It keeps frequencies with little noise from deciding the fit.
    slopes : float
        Standard deviation of the relative change, from one end of the axis to the other, of the ratio of the
        squared rotor-free and rotor-held frequencies. The masses alone determine the ratio, so it should be
        the same along the axis.
    model_floor, rotor_held_floor : float
        Least standard uncertainty of the rotor-free and of the rotor-held frequency, over the frequency. It
        is larger with the rotor held: the input is then the encoder's acceleration, which contains its noise.
    clock : float
        Standard uncertainty of the recorder's clock, over the frequency. By default that of a tolerance of
        0.05 %, within which all errors are equally probable: of crystals, and of rates that are no whole
        division of one. A run whose dwell and speed deviate more from the plan has their deviation instead.
    most_unexplained : float
        Part of the response's power in the band that the model may leave unexplained; a run with more is
        refused.
    most_load : float
        Highest load on the nut during the test over its preload; a cell with more is refused.
    most_uncertainty : float
        Standard uncertainty over the frequency above which a cell is refused, since it adds little to what a
        data sheet predicts.
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
    clock: float = 0.00029
    most_unexplained: float = 0.5
    most_load: float = 8.0
    most_uncertainty: float = 0.03

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
                " the first must be above 0 and below the second."
            )
        if not 6 <= self.rate < float("inf"):
            raise InputError(f"the rate is {self.rate:g} times the mode's frequency; it must be 6 or more.")
        for name, value in asdict(self).items():
            if not 0 < value < float("inf"):
                raise InputError(f"{name} is {value:g}; it must be more than 0.")
