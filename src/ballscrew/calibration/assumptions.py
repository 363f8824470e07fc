"""Settings of ``calibrate`` and ``preload`` that no measurement of the axis determines."""

from __future__ import annotations

from dataclasses import dataclass, fields

from ballscrew.base.quantity import NORMAL_95
from ballscrew.base.settings import check_setting

REPEATS = 0.9
"""Correlation from run to run of a repeating error: a tenth of its variance is new in each run."""

FORM = 3e-4
"""Relative standard uncertainty of a frequency by the form of the model, along the travel and over the load.

A third of the screw moves with the table only on average: near the bearing less of it moves. Fitted to the
exact modes of 30 axes with a bed, a distributed screw and a coupling, the model leaves residuals of 1.5 to
4e-4 (root mean square) where its curve is free. Fixed at one end it has no curve, and 8e-4, up to 2.6e-3,
remain on the 60 axes of ``benchmarks.finite_elements``: a calibration adds
:func:`ballscrew.axis.axial_prior.form_error` of its sheet.
"""

LOAD = 1e-3
"""Relative standard uncertainty of a declared load."""

LOCAL_ALARM = 0.005
"""Probability that an evenly worn axis is reported as locally worn: 1 in 200."""


# The support bearing has two priors, for two questions. A preloaded pair is Hertzian, k_b ∝ P_b^(1/3), and
# its preload goes with the 3/2 power of the approach δ₀ = 3 P_b/k_b of its rings, 10 to 15 µm.

BEARING_PRELOAD = 0.10
"""Standard deviation of ln P_b, the bearing's own preload, since the baseline, where nothing is stated.

What may have happened to any bearing, and that no frequency separates from the nut: the prior of the nut's
preload. A tenth of P_b is 7 % of δ₀, 0.7 to 1 µm, which run-in, wear of the races, or a few kelvin between
the rings change; by the law it is 3.3 % of k_b.
"""

BEARING_DAILY_DRIFT = 0.01
"""Half-width of the 95 % interval of the relative change of k_b of a healthy bearing.

What it does between warmed-up runs, as it settles and as the temperatures of its rings repeat: 1 % of k_b is
3 % of P_b and 2 % of δ₀, 0.2 to 0.3 µm, about a kelvin between rings of 50 mm. It is the prior between the
days of a calibration, and of a healthy axis in the detection: the alarm is about the axial stiffness, so a
bearing that changes by more is a finding and no false alarm.
"""


@dataclass(frozen=True, slots=True)
class Priors:
    """Prior probabilities, sizes and odds for the comparison of causes.

    Probabilities and sizes are judgement: a nut wears far more often than a bearing runs in, or a load is
    declared wrongly. A probability twice as large doubles the odds; decisions take odds of ten or thirty.
    Sizes are standard deviations.

    Parameters
    ----------
    nut_chance, bearing_chance, both_chance, load_chance, torque_chance, position_chance, local_chance,
    temperature_chance, gradient_chance : float
        Prior probability of each cause; only their ratios count. ``both`` is the nut and the bearing.
    nut_size : float
        Change of u = (P/P₀)^(−1/3); a loss of half of the preload is 0.26.
    bearing_size : float
        Relative change of the bearing's rigidity, of a worn bearing; where a drift is stated, that counts.
    position_size : float
        Shift of the axis's zero, m.
    local_size : float
        Relative change of the nut's compliance at a stop; a loss of 30 % is 0.13.
    gradient_size : float
        Change of ln P from the first stop to the last by a screw that is warmer at one end: 2.8 % by each of
        10 K.
    local_length : float
        Correlation length of a local change, m: two to three nut lengths are 0.06.
    as_good : float
        Excess of a cause's χ² over the least of nut, bearing and both, below which the cause is possible:
        95 % quantile of χ² for two parameters.
    plausible : float
        Size of a cause, in its standard deviations, from which it is not possible.
    odds : float
        Odds that decide between a wrong load and a drifted torque constant: about where Jeffreys (1961),
        Theory of Probability, 3rd ed., appendix B, calls evidence very strong.
    load_odds : float
        Odds of a wrong load against all other causes, above which the run is refused although its equivalent
        mass has not changed: strong evidence, ibid.
    separation : float
        Difference of the preloads with and without a correction of the load, in standard uncertainties, above
        which one interval for both is of no use.

    Raises
    ------
    InputError
        If a value is not above 0.
    """

    nut_chance: float = 0.6
    bearing_chance: float = 0.08
    both_chance: float = 0.05
    load_chance: float = 0.08
    torque_chance: float = 0.08
    position_chance: float = 0.04
    local_chance: float = 0.08
    temperature_chance: float = 0.08
    gradient_chance: float = 0.03
    nut_size: float = 0.3
    bearing_size: float = 0.10
    position_size: float = 2e-3
    local_size: float = 0.15
    gradient_size: float = 0.28
    local_length: float = 0.06
    as_good: float = 6.0
    plausible: float = 2.5
    odds: float = 30.0
    load_odds: float = 10.0
    separation: float = 6.0

    def __post_init__(self) -> None:
        """Refuse values that are not above 0."""
        for field in fields(self):
            check_setting(field.name, getattr(self, field.name), above=0.0)

    @property
    def chances(self) -> dict[str, float]:
        """Prior probability of each cause, by its name."""
        return {
            "nut": self.nut_chance,
            "bearing": self.bearing_chance,
            "both": self.both_chance,
            "load": self.load_chance,
            "torque": self.torque_chance,
            "position": self.position_chance,
            "local": self.local_chance,
            "temperature": self.temperature_chance,
            "gradient": self.gradient_chance,
        }


@dataclass(frozen=True, slots=True)
class Assumptions:
    """Settings of ``preload`` and ``calibrate``: standard deviations unless stated otherwise.

    Parameters
    ----------
    bearing_drift : float or None
        Half-width of the 95 % interval of the relative change of the support bearing's rigidity since the
        baseline, by a statement of the user; 1 % is 3 % of the bearing's own preload. None where nothing is
        stated: the bearing's preload may then have changed by :data:`BEARING_PRELOAD`, and between the days
        of a calibration its rigidity by :data:`BEARING_DAILY_DRIFT`.
    load : float
        Relative error of the declared load from run to run.
    position : float
        Shift of the axis's zero from run to run, m.
    temperature : float
        Change of ln P per kelvin, 0 on average, where neither calibration nor baselines determine it, 1/K.
    temperature_unknown : float
        Temperature difference to the baseline where it was not recorded, K: ± 3 K with 95 % probability, a
        heated hall and a constant warm-up.
    torque_constant : float
        Relative change of the torque constant from run to run, as the motor warms up.
    wrong_load : float
        Error of a wrongly declared load, as a part of the moving mass.
    mass_repeats : float
        Relative change of the equivalent mass from run to run beyond the uncertainty of its fits.
    mass_friction : float
        Change of ln equivalent mass per change of ln Coulomb friction: the rigid-body fit does not separate
        the falling friction of a worn nut from mass completely. 0.001 to 0.007 on axes worn to a quarter of
        their preload.
    friction : float
        Change of ln friction from run to run: oil, temperature and the preload itself change it.
    share : float
        Relative error of the nut's share of the compliance by the lumped model.
    tilt : float
        Relative deviation of the change of the compliance from the model's at either end of the travel.
    form : float
        Relative error of a frequency along the travel, see :data:`FORM`.
    nut_load, nut_load_spread : float
        The test's own load softens a worn nut more than a new one, so the frequency of a worn nut is
        estimated too low: by ln(P₀/P) times ``nut_load`` times the term "load" of the reference's
        uncertainty. ``nut_load_spread`` is the standard deviation of ``nut_load``, the 95 % interval of which
        contains 0, see :mod:`ballscrew.calibration.worn_nut`.
    floor : float
        Relative error of each frequency that every model has.
    repeats : float
        Correlation of a repeating error from run to run, except for that by the place of the dampers, which
        is the same in all runs.
    torque_trusted : bool or None
        Whether the torque constant is constant; None where the data decide.
    false_alarm : float
        Probability that the cells of a run with one preload are reported to contradict each other.
    local_alarm : float
        Probability that an evenly worn axis is reported as locally worn.
    priors : Priors
        Of the causes.

    Raises
    ------
    InputError
        If a value is negative or not a number, or a probability or correlation above 1.
    """

    bearing_drift: float | None = None
    load: float = LOAD
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
    form: float = FORM
    nut_load: float = 1.5
    nut_load_spread: float = 0.8
    floor: float = 2e-4
    repeats: float = REPEATS
    torque_trusted: bool | None = None
    false_alarm: float = 0.01
    local_alarm: float = LOCAL_ALARM
    priors: Priors = Priors()

    def __post_init__(self) -> None:
        """Refuse values outside their limits."""
        for field in fields(self):
            if field.name not in ("torque_trusted", "priors", "bearing_drift"):
                check_setting(field.name, getattr(self, field.name), least=0.0)
        check_setting("repeats", self.repeats, least=0.0, most=1.0)
        if self.bearing_drift is not None:
            check_setting("bearing_drift", self.bearing_drift, least=0.0, most=1.0)
        for name in ("false_alarm", "local_alarm"):
            check_setting(name, getattr(self, name), above=0.0, most=1.0)
        check_setting("floor", self.floor, above=0.0)

    @property
    def bearing_spread(self) -> float:
        """Standard deviation of ln k_b since the baseline."""
        if self.bearing_drift is None:
            return BEARING_PRELOAD / 3
        return self.bearing_drift / NORMAL_95

    @property
    def bearing_daily_spread(self) -> float:
        """Standard deviation of ln k_b of a healthy bearing."""
        return self.bearing_daily_drift / NORMAL_95

    @property
    def bearing_size(self) -> float:
        """Plausible size of a change of the bearing as the cause, relative."""
        if self.bearing_drift is None:
            return self.priors.bearing_size
        return self.bearing_spread

    @property
    def bearing_daily_drift(self) -> float:
        """Half-width of the 95 % interval of the relative change of a healthy bearing's k_b."""
        if self.bearing_drift is None:
            return BEARING_DAILY_DRIFT
        return self.bearing_drift


DEFAULT_ASSUMPTIONS = Assumptions()
"""Settings of calibrate and preload where none are given."""
