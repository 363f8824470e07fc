"""What is taken for granted when a preload is told, since no run can show it: stated, and changeable."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

from ballscrew.base.errors import InputError, shown
from ballscrew.calibration.frequency_table import REPEATS
from ballscrew.calibration.priors import Priors

__all__ = ["Assumptions"]


@dataclass(frozen=True, slots=True)
class Assumptions:
    """Settings of ``preload``; standard deviations unless said otherwise.

    Parameters
    ----------
    bearing_drift : float
        Within which the thrust bearing's rigidity has kept since the baseline, with 95 % probability, as a
        part of it. No frequency tells bearing from nut. 1 % is 3 % of the bearing's own preload, which a pair
        that is clamped and run in keeps.
    bearing_change : float
        For a second interval: within which a bearing that is not known to have kept lies, as a part of its
        rigidity; bounds, no deviation.
    load : float
        Of the declared load, as a part of it, from run to run.
    position : float
        Of the axis's zero from run to run, m.
    temperature : float
        Of ln P by a kelvin of the axis against the baseline, where no baseline runs taught it, 1/K.
    temperature_unknown : float
        Of the axis's temperature against the baseline's where a run does not tell it, K: ± 3 K with 95 %
        probability, a hall that is heated and a warm-up that is always the same.
    torque_constant : float
        By how much a torque constant drifts with heat, as a part of it.
    wrong_load : float
        By how much a load that is wrongly declared errs, as a part of all that moves.
    mass_repeats : float
        Of the equivalent mass from run to run beyond what its fits tell, as a part of it.
    mass_friction : float
        Of ln equivalent mass by ln of the Coulomb friction: friction that falls as the nut wears is not quite
        told from mass. On axes worn to a quarter of their preload 0.001 to 0.007.
    friction : float
        Of ln friction from run to run: oil, warmth and the preload itself change it.
    share : float
        Of the nut's share by what the lumped model lacks, as a part of it.
    tilt : float
        By how much the change at either end of the stops differs from the model's, as a part of it.
    form : float
        Of a frequency along the stops against the calibrated model's, as a part of it.
    nut_load, nut_load_spread : float
        A worn nut is read too low, since it is softer under the test's own load than a new one: by ln(P₀/P)
        times so often the term "load" of the reference's uncertainty; and the standard deviation of that. Its
        95 % interval holds no correction at all, see :mod:`ballscrew.calibration.worn_nut`.
    floor : float
        Of each frequency by itself, as a part of it: below it no model is right.
    repeats : float
        Correlation from run to run of an error that repeats.
    torque_trusted : bool or None
        Whether the torque constant is known not to drift; None where the data shall decide.
    false_alarm : float
        Probability that a run which one preload explains is said to be explained by none.
    local_alarm : float
        Probability that an evenly worn axis is called locally worn.
    priors : Priors
        What is believed of each cause.

    Raises
    ------
    InputError
        If one is negative or no number, or a probability or correlation is none.
    """

    bearing_drift: float = 0.01
    bearing_change: float = 0.10
    load: float = 0.001
    position: float = 1e-4
    temperature: float = 0.01
    temperature_unknown: float = 1.5
    torque_constant: float = 0.01
    wrong_load: float = 0.02
    mass_repeats: float = 0.0005
    mass_friction: float = 0.003
    friction: float = 0.10
    share: float = 0.02
    tilt: float = 0.05
    form: float = 3e-4
    nut_load: float = 1.5
    nut_load_spread: float = 0.8
    floor: float = 2e-4
    repeats: float = REPEATS
    torque_trusted: bool | None = None
    false_alarm: float = 0.01
    local_alarm: float = 0.005
    priors: Priors = Priors()  # noqa: RUF009  frozen

    def __post_init__(self) -> None:
        """Refuse what cannot be."""
        for field in fields(self):
            value = getattr(self, field.name)
            if field.name in ("torque_trusted", "priors"):
                continue
            number = isinstance(value, (int, float)) and not isinstance(value, bool)
            if not (number and math.isfinite(value) and value >= 0):
                raise InputError(f"{field.name} is {shown(value)}; it must be a number, 0 or more.")
        for name in ("bearing_drift", "bearing_change", "repeats", "false_alarm", "local_alarm"):
            if not getattr(self, name) <= 1:
                raise InputError(f"{name} is {getattr(self, name):g}; it must be 1 at most.")
        for name in ("floor", "false_alarm", "local_alarm"):
            if not getattr(self, name) > 0:
                raise InputError(f"{name} is 0; it must be more.")
