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
        Sampling rate over the mode's frequency; recordings with a higher rate are decimated. A recording with
        fewer than :data:`ballscrew.fcft.trace.SAMPLES_PER_PERIOD` samples per period of the mode, or fewer
        than ``rate`` if that is less, is refused.
    floor, motor_floor : float
        Noise floor of the whitening filter: power of the white noise that is added to a residual before the
        filter is computed, over the power of the residual. ``floor`` applies to the response of the nut to
        the torque, ``motor_floor`` to that of the motor. Without it, the frequencies with the least noise
        would have nearly all the weight.
    slopes : float
        Tie between the slopes of the rotor-free and the rotor-held compliance along the axis: standard
        deviation of the relative change, from one end of the axis to the other, of the ratio of the squared
        frequencies. The masses alone determine this ratio, so it should not change along the axis.
    model_floor, rotor_held_floor : float
        Least standard uncertainty of the rotor-free and of the rotor-held frequency, over the frequency. It
        is larger with the rotor held: the drive is then the encoder's acceleration, which contains its noise.
    clock : float
        Relative standard uncertainty of the recorder's clock, and so of every frequency. By default that of a
        tolerance of 0.05 % within which all errors are equally probable. It covers the tolerance of a
        crystal, and a true rate that differs from the nominal one because this is not the crystal's frequency
        over a whole number. If dwell and speed of a run deviate more from the plan, their deviation is used
        instead.
    most_unexplained : float
        Part of the whitened response's power that the model may leave unexplained; a run with more is
        refused.
    most_load : float
        Highest load on the nut during the test over its preload; a cell with more is refused.
    most_uncertainty : float
        Standard uncertainty over the frequency above which a cell is refused: the data sheet predicts the
        frequency nearly as well.
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
                f"the search range is {self.lowest:g} to {self.highest:g} Hz;"
                " the first must be above 0 and below the second."
            )
        if not 6 <= self.rate < float("inf"):
            raise InputError(f"the rate is {self.rate:g} times the mode's frequency; it must be 6 or more.")
        for name, value in asdict(self).items():
            if not 0 < value < float("inf"):
                raise InputError(f"{name} is {value:g}; it must be more than 0.")
