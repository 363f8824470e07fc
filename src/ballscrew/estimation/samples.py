"""From the fused change of the compliance to the preload, by samples of every uncertain number.

    P = P_ref · (P₀/P_ref) · (P/P₀),  P/P₀ = u⁻³,  u = 1 + (change of the compliance) / (the nut's share)

P_ref is the reference preload of the model and P₀ that of the baseline. P is a power of a ratio, so its
interval is not symmetric. P_ref, the nut's share and P₀/P_ref are sampled together from the posterior of the
calibration, in which the tolerances of the data sheet are limits (:mod:`ballscrew.calibration.tolerances`)
and its rigidity K may be stated in another convention (:mod:`ballscrew.calibration.conventions`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ballscrew.axis.axial import PARAMETERS
from ballscrew.base.arrays import Array
from ballscrew.base.quantity import Quantity
from ballscrew.calibration.assumptions import Assumptions
from ballscrew.calibration.calibrated_axis import CalibratedAxis
from ballscrew.calibration.frequency_table import FrequencyTable
from ballscrew.calibration.tolerances import resample_within_tolerances
from ballscrew.estimation.change import ComplianceChange
from ballscrew.estimation.compliance import change_from_model
from ballscrew.estimation.estimate import PreloadEstimate, UncertaintyPart
from ballscrew.estimation.fusion import FusedChange, fuse
from ballscrew.estimation.nut import NutEvidence, bearing_over_nut, nut_ratios
from ballscrew.estimation.temperature import NO_CORRECTION, TemperatureCorrection

SAMPLES = 10_000
"""Number of samples: they determine the ends of a 95 % interval to 1 % of its width."""

_LEAST_SPREAD = 1e-12  # of u, in a divisor
_SEED = 20_241  # of the random numbers, which are the same in every estimate
_SURPLUS = 4  # samples generated for each that is used, where tolerances exclude some
# Relative standard uncertainty of the bearing's share: half of the ± 30 % to which manufacturers state its
# rigidity.
_BEARING = 0.15
_GOLDEN = (math.sqrt(5) - 1) / 2  # fractional parts of its multiples are spread evenly from 0 to 1
_MOST_RATIO = 1e3  # largest P₀/P_ref, and largest inverse of it, in a sample: no axis has more

_PROBABLE = 0.15
"""Least probability of a convention whose own 95 % interval is part of the interval of the stiffness.

The interval excludes 2.5 % of all samples at either end: 17 % of the samples of a convention with this
probability, if all of these lie at one end. On 82 random axes whose K is of a
preloaded nut but stated as R_nu,ar or as of a nut with clearance, 10 and 9 % of the good intervals miss the
true value without this extension, and 4 and 5 % with it (``benchmarks.conventions``, seeds 500 to 581).
Neither the nut's interval, which contains the bearing's possible change, nor that of newtons is extended.
"""

_SHARE = PARAMETERS.index("share")
_PRELOAD = PARAMETERS.index("preload")
_PARAMETER_COUNT = len(PARAMETERS)
# Columns of standard-normal numbers for the errors of the run's u, of the nut's share by the lumped model, of
# the temperature's slope, and of a P₀/P_ref that is estimated by the model. One column for each tolerance
# follows.
_OWN, _SHARE_ERROR, _TEMPERATURE, _BASELINE = range(4)
_COLUMNS = 4
# Columns of those for the nut alone: the bearing's change, and the errors of softening and bearing's share.
_DRIFT, _SOFTENING, _BEARING_SHARE = range(3)


class PosteriorSamples:
    """Samples of the model's parameters and of P₀/P_ref.

    Parameters
    ----------
    model : CalibratedAxis
        Of the axis.
    base : FrequencyTable or None
        Of the baseline; None where the model is the reference.
    assumptions : Assumptions
        Sizes of the errors that no run determines.

    Attributes
    ----------
    reference_ratio : float
        P₀/P_ref: by the calibration where the baseline is one of its runs, else estimated from the
        frequencies of the baseline by the model. 1 without a baseline; NaN if the frequencies of the baseline
        lie above those of an infinitely stiff nut.
    has_known_baseline : bool
        Whether P₀/P_ref is known without such an estimate: the baseline is a run of the calibration, or there
        is none.
    """

    def __init__(self, model: CalibratedAxis, base: FrequencyTable | None, assumptions: Assumptions) -> None:
        self._model, self._base, self._assumptions = model, base, assumptions
        deviations, self._normal, convention = _calibration_samples(model)
        # Masks of the samples of each convention of K that is probable enough, shape (n,).
        masks = [convention == number for number in np.unique(convention)]
        self._conventions = [mask for mask in masks if mask.mean() >= _PROBABLE]
        self._nut_normal = _standard_normal(_SEED + 1, SAMPLES, 3)
        # Samples of the working vector, shape (n, 7), and of each group's ln(P/P_ref), shape (n, groups), as
        # deviations from the calibration; of the nut's share, and of P_ref, N, both of shape (n,).
        self._vector = deviations[:, :_PARAMETER_COUNT]
        log_ratios = deviations[:, _PARAMETER_COUNT:]
        self._share = 1 / (1 + np.exp(-(model.vector[_SHARE] + self._vector[:, _SHARE])))
        self._reference_preloads = model.model.preload * np.exp(self._vector[:, _PRELOAD])
        group = None if base is None else model.group_of(base.id)
        # Change, against the model, of a baseline that is not a run of the calibration.
        self._base_by_model: tuple[ComplianceChange, FusedChange] | None = None
        self.has_known_baseline = base is None or group is not None
        if base is None:
            self.reference_ratio = 1.0
            self._reference_ratios = np.ones(len(deviations))
        elif group is not None:
            self.reference_ratio = math.exp(model.log_ratios[group])
            self._reference_ratios = self.reference_ratio * np.exp(log_ratios[:, group])
        else:
            self.reference_ratio, self._reference_ratios = self._reference_ratio_by_model(base)

    def estimate(
        self,
        refusal: PreloadEstimate,
        change: ComplianceChange,
        fused: FusedChange,
        temperature: TemperatureCorrection,
        evidence: NutEvidence,
        by_model: tuple[ComplianceChange, FusedChange] | None = None,
    ) -> PreloadEstimate | None:
        """Preload with its uncertainty.

        Parameters
        ----------
        refusal : PreloadEstimate
            The estimate without quantities.
        change, fused : ComplianceChange, FusedChange
            Of the run against its reference.
        temperature : TemperatureCorrection
            Of the run.
        evidence : NutEvidence
            Of nut and support bearing.
        by_model : tuple of ComplianceChange and FusedChange, optional
            Of the run against the model, where the baseline is not a run of the calibration. The preload in
            newtons is then estimated from it, so that errors of the baseline do not affect it. Where the
            nut's softening separates nut and bearing, it is that of the baseline by the model times the nut's
            P/P₀, and the errors of the two factors are assumed to be the same, which widens its interval.

        Returns
        -------
        PreloadEstimate or None
            With the quantities; None where P over its reference has no upper end.
        """
        if not fused.u > 0:
            return None
        # P over its reference by the axial stiffness.
        ratios = self._ratios(change, fused, self._reference_ratios, temperature)
        ratio = fused.u**-3 * math.exp(-temperature.shift)
        stiffness = quantity_from_samples(ratio, ratios, parts=self._conventions)
        if stiffness is None:
            return None
        nut_ratio, nut_samples = self._nut(ratio, ratios, change, fused, evidence, temperature)
        model_ratio, model_samples, random_part = self._relative_to_model(
            nut_ratio, nut_samples, fused, temperature, evidence, by_model
        )
        to_model = force = None
        if model_ratio > 0:
            to_model = quantity_from_samples(model_ratio, model_samples)
        if to_model is not None:
            preload = model_ratio * self._model.model.preload
            force = quantity_from_samples(preload, model_samples * self._reference_preloads, "N")
        # ``relative`` is the ratio whose uncertainty is reported in parts and terms.
        to_baseline, relative = None, to_model
        if self._base is not None:
            to_baseline = quantity_from_samples(nut_ratio, nut_samples)
            relative = stiffness
        if relative is None:
            return None
        # The random parts are linear approximations, and may exceed the standard uncertainty by samples.
        random_ratio = min(3 * ratio / fused.u * fused.random, relative.standard_uncertainty)
        preload_ratio = random_force = systematic_force = None
        if force is not None:
            preload_ratio = _divided(force, self._model.load_rating)
            random_force = min(random_part * force.value, force.standard_uncertainty)
            systematic_force = _remaining(force.standard_uncertainty, random_force)
        return replace(
            refusal,
            preload_N=force,
            preload_ratio=preload_ratio,
            stiffness_relative_to_baseline=None if self._base is None else stiffness,
            relative_to_baseline=to_baseline,
            relative_to_model=to_model,
            random_N=random_force,
            systematic_N=systematic_force,
            random_ratio=random_ratio,
            systematic_ratio=_remaining(relative.standard_uncertainty, random_ratio),
            terms=self._terms(change, fused, ratio, temperature),
        )

    def _nut(
        self,
        ratio: float,
        ratios: Array,
        change: ComplianceChange,
        fused: FusedChange,
        evidence: NutEvidence,
        temperature: TemperatureCorrection,
    ) -> tuple[float, Array]:
        """P/P₀ of the nut and its samples, shape (n,).

        ``ratio`` and ``ratios`` are those of the axial stiffness, the latter of shape (n,).
        """
        # Of the compliance besides the nut's, 1 − s, the bearing has a fixed part by the data sheet: bearing
        # over nut is in proportion to (1 − s)/s.
        rest_factor = (1 - self._share) / (1 - self._model.model.share)
        nut_factor = self._share / self._model.model.share
        bearing_factor = 1 + _BEARING * self._nut_normal[:, _BEARING_SHARE]
        bearing = bearing_over_nut(change, fused) * rest_factor / nut_factor * np.maximum(bearing_factor, 0.0)
        normal = self._nut_normal[:, [_DRIFT, _SOFTENING]]
        samples, weight = nut_ratios(ratios, bearing, evidence, normal, temperature.shift)
        u = ratio ** (-1 / 3)
        if evidence.log_ratio is not None:
            u_by_softening = math.exp((temperature.shift - evidence.log_ratio) / 3)
            u += weight * (u_by_softening - u)
        return u**-3, samples

    def _relative_to_model(
        self,
        nut_ratio: float,
        nut_samples: Array,
        fused: FusedChange,
        temperature: TemperatureCorrection,
        evidence: NutEvidence,
        by_model: tuple[ComplianceChange, FusedChange] | None,
    ) -> tuple[float, Array, float]:
        """P/P_ref of the nut, its samples, shape (n,), and the random part of the uncertainty of ln P.

        ``nut_ratio`` and ``nut_samples`` are P/P₀ of the nut and its samples; the others are as for
        :meth:`estimate`.
        """
        random_part = fused.log_preload_spread(fused.random)
        if by_model is None:
            return nut_ratio * self.reference_ratio, nut_samples * self._reference_ratios, random_part
        if evidence.log_ratio is None or self._base_by_model is None:
            ratio, ratios = self._against_model(*by_model, temperature, evidence)
            _, fused_by_model = by_model
            return ratio, ratios, fused_by_model.log_preload_spread(fused_by_model.random)
        base_ratio, base_ratios = self._against_model(*self._base_by_model, NO_CORRECTION, evidence)
        return nut_ratio * base_ratio, nut_samples * base_ratios, random_part

    def _reference_ratio_by_model(self, base: FrequencyTable) -> tuple[float, Array]:
        """P₀/P_ref of a baseline that is not a run of the calibration, and its samples, shape (n,)."""
        model = self._model
        change = change_from_model(base, model.model, model.bearing_share, self._assumptions)
        fused = fuse(change, model.covariance)
        self._base_by_model = change, fused
        noise = self._normal[:, _BASELINE] * fused.spread
        # The error of the share by the lumped model is already part of the change since the baseline.
        u = self._u_samples(change, fused, np.ones(len(noise)), noise, share_error=0.0)
        ratio = math.nan
        if fused.u > 0:
            ratio = fused.u**-3
        return ratio, _preload_ratios(u)

    def _u_samples(
        self,
        change: ComplianceChange,
        fused: FusedChange,
        reference_ratios: Array,
        noise: Array,
        share_error: float,
    ) -> Array:
        """Samples of u = (P/P₀)^(−1/3), shape (n,).

        ``reference_ratios`` are samples of P₀/P_ref and ``noise`` of the error of u, both of shape (n,);
        ``share_error`` is the relative standard uncertainty of the nut's share by the lumped model.
        """
        model = self._model.model
        from_centre = change.position - model.centre
        u0 = np.cbrt(1 / np.clip(reference_ratios, 1 / _MOST_RATIO, _MOST_RATIO))[:, None]
        share = (self._share * (1 + share_error * self._normal[:, _SHARE_ERROR]))[:, None]
        compliance = 1 + model.slope * from_centre + model.curve * from_centre**2 + share * (u0 - 1)
        # weights · Y = (weights · s)(u − 1), where s are the nut's shares in a sample; weights · s is 1 for
        # those of the model.
        nut = (share * u0 / compliance) @ fused.weights
        return np.asarray(1 + (fused.level + noise + self._vector @ fused.by_parameters) / nut)

    def _ratios(
        self,
        change: ComplianceChange,
        fused: FusedChange,
        reference_ratios: Array,
        temperature: TemperatureCorrection,
    ) -> Array:
        """Samples of P/P₀, shape (n,), corrected to the temperature of the baseline.

        ``reference_ratios`` are samples of P₀/P_ref, shape (n,).
        """
        own = self._normal[:, _OWN]
        u = self._u_samples(change, fused, reference_ratios, fused.spread * own, self._assumptions.share)
        log_error = np.zeros_like(own)  # of the temperature's shift of ln P
        if temperature.spread:
            own_spread = fused.log_preload_spread(fused.spread)
            # The change of ln P and the slope by temperature refer to the same baseline, so the errors of
            # ln(P/P₀) and of −shift are correlated. A positive ``own`` decreases the former, a positive
            # ``log_error`` the latter, so that these two have the same correlation.
            correlation = 0.0
            if own_spread:
                correlation = float(np.clip(temperature.shared / (own_spread * temperature.spread), -1, 1))
            independent = math.sqrt(1 - correlation**2) * self._normal[:, _TEMPERATURE]
            log_error = temperature.spread * (correlation * own + independent)
        return _preload_ratios(u) * np.exp(-temperature.shift - log_error)

    def _against_model(
        self,
        change: ComplianceChange,
        fused: FusedChange,
        temperature: TemperatureCorrection,
        evidence: NutEvidence,
    ) -> tuple[float, Array]:
        """P/P_ref of the nut by a change against the model, and its samples, shape (n,)."""
        at_reference = np.ones(len(self._reference_ratios))
        independent = replace(temperature, shared=0.0)  # the model contains no error of the baseline
        ratios = self._ratios(change, fused, at_reference, independent)
        if not fused.u > 0:
            return 0.0, ratios
        # The softening gives the nut's preload relative to the baseline's, and not relative to the model's.
        without_softening = NutEvidence(self._assumptions.bearing_spread, evidence.stated)
        ratio = fused.u**-3 * math.exp(-temperature.shift)
        return self._nut(ratio, ratios, change, fused, without_softening, temperature)

    def _terms(
        self, change: ComplianceChange, fused: FusedChange, ratio: float, temperature: TemperatureCorrection
    ) -> tuple[UncertaintyPart, ...]:
        """Standard uncertainty of P over its reference by each term, the largest first.

        ``ratio`` is P over its reference by the axial stiffness. Without a baseline it is the nut's too, so
        that the support bearing is a term.
        """
        per_u = 3 * ratio / fused.u  # |d(P/P₀)/du|
        terms = []
        for name, (spread, random) in fused.terms.items():
            terms.append(UncertaintyPart(name, per_u * spread, random))
        by_share = abs(fused.level) * share_uncertainty(self._model, self._assumptions)
        terms.append(UncertaintyPart("the nut's share", per_u * by_share, False))
        by_model = float(np.sqrt(fused.by_parameters @ self._model.covariance @ fused.by_parameters))
        if by_model:
            terms.append(UncertaintyPart("the model's frequencies", per_u * by_model, False))
        if self._base is None:
            by_bearing = bearing_over_nut(change, fused) * self._assumptions.bearing_spread
            terms.append(UncertaintyPart("support bearing", per_u * by_bearing, False))
        if temperature.spread:
            terms.append(UncertaintyPart(temperature.name, ratio * temperature.spread, False))
        return tuple(sorted(terms, key=lambda term: -term.standard_uncertainty))


def share_uncertainty(model: CalibratedAxis, assumptions: Assumptions) -> float:
    """Relative standard uncertainty of the nut's share: by calibration, conventions of K and lumped model.

    Parameters
    ----------
    model : CalibratedAxis
        With the covariance of its parameters and the other possible conventions of K.
    assumptions : Assumptions
        With ``share``, the relative error of the share by the lumped model.

    Returns
    -------
    float
        As a part of the share.
    """
    probability = np.array([other.probability for other in model.conventions])
    change = np.array([other.change[_SHARE] for other in model.conventions])
    # Variance of logit share over all conventions. The stated one is not among those of the model, and its
    # change is 0.
    by_convention = math.sqrt(max(float(probability @ change**2 - (probability @ change) ** 2), 0.0))
    logit_spread = math.hypot(model.standard_uncertainty("share"), by_convention)
    return math.hypot((1 - model.model.share) * logit_spread, assumptions.share)  # d ln s = (1 − s) d logit s


def normal_samples(covariance: Array, others: int, count: int = SAMPLES) -> tuple[Array, Array]:
    """Samples of a normal distribution of mean 0, and standard-normal numbers independent of them.

    Every call with the same parameters returns the same numbers.

    Parameters
    ----------
    covariance : ndarray, shape (m, m)
        Positive semi-definite.
    others : int
        Number of columns of standard-normal numbers.
    count : int
        Number of samples, even.

    Returns
    -------
    ndarray, shape (count, m)
        Deviations from the mean.
    ndarray, shape (count, others)
        Standard-normal numbers.
    """
    numbers = _standard_normal(_SEED, count, len(covariance) + others)
    eigenvalues, eigenvectors = np.linalg.eigh((covariance + covariance.T) / 2)
    root = eigenvectors * np.sqrt(np.clip(eigenvalues, 0.0, None))  # the covariance is root @ root.T
    return numbers[:, : len(covariance)] @ root.T, numbers[:, len(covariance) :]


def _standard_normal(seed: int, count: int, columns: int) -> Array:
    """Standard-normal numbers, shape (count, columns); antithetic, so that their means are exactly 0."""
    half = np.random.default_rng(seed).standard_normal((count // 2, columns))
    return np.concatenate([half, -half])


def quantity_from_samples(
    value: float, samples: Array, unit: str = "", parts: Sequence[NDArray[np.bool_]] = ()
) -> Quantity | None:
    """Quantity with a given value and the uncertainty and interval of samples.

    Parameters
    ----------
    value : float
        Best estimate, in ``unit``.
    samples : ndarray, shape (n,)
        Of the quantity, in ``unit``; infinite where nothing bounds it.
    unit : str
        Of the quantity.
    parts : sequence of ndarray of bool, shape (n,)
        Masks of samples; the interval is extended so that it contains the 95 % interval of each mask.

    Returns
    -------
    Quantity or None
        None where the 95 % interval, from the 2.5 % to the 97.5 % quantile, has no upper end. The interval is
        extended where it does not contain ``value``. The standard uncertainty is the standard deviation of
        the samples, those outside the 0.5 % and 99.5 % quantiles being moved to these. Where the upper one is
        infinite, it is half of the distance between the 15.9 % and 84.1 % quantiles.
    """
    quantiles = [0.005, 0.15866, 0.84134, 0.995]  # the inner two at ± 1 standard deviation of a normal one
    lowest, below, above, highest = np.quantile(samples, quantiles, method="nearest")
    whole_and_parts = [samples, *(samples[mask] for mask in parts)]
    ends = [np.quantile(values, [0.025, 0.975], method="nearest") for values in whole_and_parts]
    low, high = float(np.min(ends)), float(np.max(ends))
    if not np.isfinite([value, low, below, above, high]).all():
        return None
    spread = float(above - below) / 2
    if np.isfinite(highest):
        spread = float(np.std(np.clip(samples, lowest, highest)))
    return Quantity(value, spread, unit, (min(low, value), max(high, value)))


def _calibration_samples(model: CalibratedAxis) -> tuple[Array, Array, NDArray[np.intp]]:
    """Samples of the calibration's posterior, standard-normal numbers, and the convention of each sample.

    The samples are deviations of the working vector and of ln(P/P_ref) of each group of runs from the most
    probable values, shape (n, 7 + groups); those that the tolerances of the data sheet exclude are replaced
    by others. Each other convention of the sheet's K has samples in proportion to its probability: its change
    is added to them, and its estimates of the sheet's numbers are compared with the tolerances instead of
    those of the stated convention. The convention of a sample, shape (n,), is its index in
    ``model.conventions``; the stated one, which is not among them, has the index ``len(model.conventions)``.
    """
    covariance = np.block(
        [[model.covariance, model.cross_covariance], [model.cross_covariance.T, model.log_ratio_covariance]]
    )
    count = SAMPLES
    if model.tolerances:
        count = _SURPLUS * SAMPLES
    deviations, normal = normal_samples(covariance, _COLUMNS + len(model.tolerances), count)
    # Numbers from 0 to 1, spread evenly in every part of the samples, assign the conventions to them.
    even = np.arange(SAMPLES) * _GOLDEN % 1
    ends = np.cumsum([other.probability for other in model.conventions])
    convention = np.searchsorted(ends, even, side="right")
    chosen = np.empty(SAMPLES, dtype=np.intp)
    change = np.zeros((SAMPLES, deviations.shape[1]))
    for number, other in enumerate([*model.conventions, None]):  # None is the stated convention
        mask = convention == number
        tolerances = model.tolerances
        if other is not None:
            change[mask] = other.change
            pairs = zip(tolerances, other.estimates.tolist(), strict=True)
            tolerances = tuple(replace(row, estimate=estimate) for row, estimate in pairs)
        rows = resample_within_tolerances(
            tolerances,
            model.prior_covariance,
            deviations[:, :_PARAMETER_COUNT],
            normal[:, _COLUMNS:],
            SAMPLES,
        )
        chosen[mask] = rows[mask]
    return deviations[chosen] + change, normal[chosen], convention


def _preload_ratios(u: Array) -> Array:
    """P/P₀ = u⁻³; infinite where u is not above 0."""
    return np.power(u, -3.0, out=np.full_like(u, np.inf), where=u > 0)


def _remaining(whole: float, part: float) -> float:
    """Standard uncertainty that remains of ``whole`` without ``part``, which is independent of the rest."""
    return math.sqrt(max(whole**2 - part**2, 0.0))


def _divided(quantity: Quantity, divisor: float) -> Quantity:
    """A quantity divided by an exactly known value of the same unit."""
    low, high = quantity.interval
    spread = quantity.standard_uncertainty / divisor
    return Quantity(quantity.value / divisor, spread, "", (low / divisor, high / divisor))


def load_significance(
    change: ComplianceChange, fused: FusedChange, model: CalibratedAxis, assumptions: Assumptions
) -> float:
    """Effect of one kilogram on the table on u, over the standard uncertainty of u.

    Parameters
    ----------
    change : ComplianceChange
        Of the cells.
    fused : FusedChange
        Of the run: u, its standard uncertainty, and the weights of the cells.
    model : CalibratedAxis
        Of the axis; the uncertainty of the nut's share is part of that of u.
    assumptions : Assumptions
        With the relative error of the share by the lumped model.

    Returns
    -------
    float
        1/kg.
    """
    by_share = abs(fused.level) * share_uncertainty(model, assumptions)
    uncertainty = max(math.hypot(fused.spread, by_share), _LEAST_SPREAD)
    return abs(float(fused.weights @ change.by_load)) / uncertainty
