"""Estimate of the remaining preload from a run, a calibrated model, and a baseline where there is one.

With a baseline, the change of the frequencies gives P/P₀, and only the nut's share of the compliance is taken
from the model; errors that repeat from run to run cancel. Without a baseline the model's own frequencies are
the reference, and all its errors count.

P is the preload of the run, and P₀ that of its reference: the baseline, or the model where there is none.
P_ref is the preload at which the model states the nut's share. The unknown of the fit is u = (P/P₀)^(−1/3),
the nut's compliance over that in the state of the reference (Hertz).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from ballscrew.base.errors import InputError, shown
from ballscrew.base.provenance import Made
from ballscrew.base.threads import single_threaded
from ballscrew.calibration.assumptions import DEFAULT_ASSUMPTIONS, Assumptions
from ballscrew.calibration.calibrated_axis import CalibratedAxis
from ballscrew.calibration.frequency_table import FrequencyTable, frequency_table, paired_cells
from ballscrew.calibration.method import common_method
from ballscrew.calibration.modelfile import model_of
from ballscrew.estimation.causes import (
    CauseEvidence,
    MassChanges,
    PossibleCause,
    compare_causes,
    gather_evidence,
)
from ballscrew.estimation.change import DECLARED_LOAD, ComplianceChange
from ballscrew.estimation.compliance import WORN_NUT, change_from_model, change_since
from ballscrew.estimation.estimate import PreloadEstimate
from ballscrew.estimation.fusion import FusedChange, fuse, fuse_on_worn_nut
from ballscrew.estimation.inflation import inflate_uncertainty, with_misfit_of
from ballscrew.estimation.local_wear import preload_profile
from ballscrew.estimation.mass_check import MassCheck, check_mass, mass_changes
from ballscrew.estimation.nut import (
    NutEvidence,
    attribute_change,
    bearing_over_nut,
    merge_nut_and_bearing,
    nut_evidence,
)
from ballscrew.estimation.samples import PosteriorSamples, load_significance, share_uncertainty
from ballscrew.estimation.support import lost_end
from ballscrew.estimation.temperature import (
    NO_CORRECTION,
    TemperatureCorrection,
    further_baselines,
    temperature_correction,
    temperature_notes,
    warm_screw_doubts,
)
from ballscrew.estimation.verdict import (
    apply_release_limit,
    doubts_of_calibration,
    estimate_notes,
    why_no_frequency,
    why_not_good,
    why_nut_uncertain,
    why_unbounded,
)
from ballscrew.modal.run import Run

_LEAST_CORRECTION = 0.05  # % of the preload, below which a correction is not reported
# Curve of the model times the square of the travel, up to which the compliance along the axis is a line and
# not a parabola.
_LEAST_CURVATURE = 1e-3
# Largest difference of the loads of run and baseline, as a part of the moving mass: with a larger one the
# result depends on the model's mass more than on the nut.
_MOST_LOAD_CHANGE = 0.25


@single_threaded
def preload(
    run: Run | str | Path,
    model: CalibratedAxis | str | Path,
    baseline: Run | str | Path | None = None,
    *,
    more: Sequence[Run | str | Path] = (),
    assumptions: Assumptions = DEFAULT_ASSUMPTIONS,
    accept: Sequence[str] = (),
) -> PreloadEstimate:
    """Estimate the preload of a run.

    Parameters
    ----------
    run : Run or path-like
        Analysed.
    model : CalibratedAxis or path-like
        Of the same axis.
    baseline : Run or path-like, optional
        Run that the change of the preload refers to, with the same plan and about the same load.
    more : sequence of Run or path-like
        Further baselines, to which the effect of the temperature is fitted.
    assumptions : Assumptions
        Settings that no run determines.
    accept : sequence of str
        Names of reasons to doubt the calibration that the user has checked and accepts. A reason that is not
        accepted makes every estimate suspect.

    Returns
    -------
    PreloadEstimate
        Its verdict is refused where the run does not determine the preload.

    Raises
    ------
    InputError
        If run, model and baseline are not of one axis, one plan and about one load, a cell of a run is not
        on the screw, or a number is impossible; or if an accepted reason is none of the model's.
    """
    run, model = Run.of(run), model_of(model)
    baseline = None if baseline is None else Run.of(baseline)
    further = [Run.of(other) for other in more]
    model.check_accepted(accept)
    check_comparable(run, model, baseline, further)
    inputs = {"run": run.id}
    if baseline is not None:
        inputs["baseline"] = baseline.id
    for number, other in enumerate(further, 2):
        inputs[f"baseline {number}"] = other.id
    refusal = PreloadEstimate(
        run=run.id,
        baseline=inputs.get("baseline"),
        axis=run.axis,
        measured_at=run.measured_at,
        verdict="refused",
        reasons=(),
        made=Made(inputs=inputs, settings=asdict(assumptions) | {"accept": sorted(set(accept))}),
    )
    reason = _why_refused(run, baseline)
    if reason:
        refusal = _refuse(refusal, reason, *doubts_of_calibration(model, accept))
        # The test's own load may still give an upper limit of P/P₀, if the measurement is good and that of
        # the baseline is not bad.
        bad_baseline = baseline is not None and baseline.quality.verdict == "bad"
        if run.quality.verdict == "good" and not bad_baseline:
            return apply_release_limit(refusal, run, baseline, model)
        return refusal
    table, base = frequency_table(run), None if baseline is None else frequency_table(baseline)
    _check_stops([run, baseline, *further], model)
    comparison = _RunComparison(table, base, model, assumptions)
    return _estimate(refusal, comparison, run, baseline, further)


def _check_stops(runs: Sequence[Run | None], model: CalibratedAxis) -> None:
    """Check that the stops of the runs are on the screw."""
    for run in runs:
        if run is not None:
            model.check_positions(frequency_table(run).position.tolist(), run.name, "stop")


def _why_refused(run: Run, baseline: Run | None) -> str:
    """Reason to refuse the estimate without computing it; empty if there is none."""
    if run.quality.verdict == "bad":
        return "the measurement is bad: " + "; ".join(run.quality.reasons or ("it was refused",))
    table = frequency_table(run)
    if not len(table.frequency):
        return why_no_frequency(run)
    if baseline is None:
        return ""
    base = frequency_table(baseline)
    if baseline.quality.verdict == "bad":
        return "the measurement of the baseline is bad"
    if not len(base.frequency):
        return "the baseline has no cell with a frequency"
    if not paired_cells(table, base)[0]:
        return "run and baseline have no cell with a frequency in common"
    return ""


def check_comparable(run: Run, model: CalibratedAxis, baseline: Run | None, more: Sequence[Run]) -> None:
    """Check that runs and model can be compared.

    Parameters
    ----------
    run, model, baseline, more
        As for :func:`preload`.

    Raises
    ------
    InputError
        If they are not of one axis, method, plan and about one load.
    """
    named_runs = [(run, "the run")]
    if baseline is not None:
        named_runs.append((baseline, "the baseline"))
    named_runs += [(other, "a baseline") for other in more]
    method = common_method([other for other, _ in named_runs])
    for used in model.runs:
        if method is not None and used.method not in (None, method):
            raise InputError(
                f"the run is by method {method}, the model was calibrated with runs by method {used.method}; "
                "all must be by the same method: analyse them again."
            )
    for other, name in named_runs:
        _check_same_test(other, name, run, model)


def _check_same_test(other: Run, name: str, run: Run, model: CalibratedAxis) -> None:
    """Check that ``other``, ``name`` in messages, has the model's axis, the run's plan and about its load."""
    if other.axis is not None and model.axis and other.axis != model.axis:
        raise InputError(
            f"{name} is of the axis {shown(other.axis)}, the model of {shown(model.axis)}; they must be of "
            "one axis."
        )
    if other.mass_kg is None:
        raise InputError(f"{name}, {other.name}, has no load; add it with 'ballscrew amend --mass'.")
    plan, plan_of_run = other.made.inputs.get("plan"), run.made.inputs.get("plan")
    if plan is not None and plan_of_run is not None and plan != plan_of_run:
        raise InputError(
            f"{name} was measured with another plan than the run; a change requires one plan for both."
        )
    load = run.mass_kg or 0.0
    if abs(other.mass_kg - load) > _MOST_LOAD_CHANGE * (model.model.mass + load):
        raise InputError(
            f"{name} was measured with {other.mass_kg:g} kg, the run with {load:g} kg; a change requires "
            "about the same load."
        )


@dataclass(frozen=True)
class _ExplainedChange:
    """Change of a run against its reference, and its possible causes.

    ``ratio`` is the P/P₀ for which the load on a worn nut is corrected, and ``bearing_over_nut`` the
    compliance of the bearing over the nut's.
    """

    change: ComplianceChange
    fused: FusedChange
    ratio: float
    bearing_over_nut: float
    evidence_of_nut: NutEvidence
    observations: CauseEvidence
    causes: tuple[PossibleCause, ...]


@dataclass(frozen=True)
class _RunComparison:
    """Frequencies of a run, ``table``, and of its reference: ``base``, or the model where that is None."""

    table: FrequencyTable
    base: FrequencyTable | None
    model: CalibratedAxis
    assumptions: Assumptions

    @property
    def temperature_difference(self) -> float | None:
        """Temperature of the run less the baseline's, K."""
        if self.base is None or self.table.temperature is None or self.base.temperature is None:
            return None
        return self.table.temperature - self.base.temperature

    def change(self, reference_ratio: float, correction: float, ratio: float) -> ComplianceChange:
        """Change of the compliance in each cell of the run against its reference.

        ``reference_ratio`` is P₀/P_ref, which has no effect without a baseline, ``correction`` is added to
        the declared load (kg), and ``ratio`` is the P/P₀ for which the softening of a worn nut by the test's
        own load is corrected.
        """
        model, bearing_share = self.model.model, self.model.bearing_share
        if self.base is None:
            table = replace(self.table, load=self.table.load + correction)
            return change_from_model(table, model, bearing_share, self.assumptions, ratio)
        load_change = self.table.load - self.base.load + correction
        return change_since(
            self.table, self.base, model, bearing_share, reference_ratio, self.assumptions, load_change,
            ratio, self.model.covariance,
        )  # fmt: skip

    def fuse(
        self, reference_ratio: float, mass: MassCheck | None = None
    ) -> tuple[ComplianceChange, FusedChange, float]:
        """Change in each cell, the same fused, and the P/P₀ for which the load on a worn nut is corrected.

        The declared load is corrected as ``mass`` states, and has the uncertainty that it states.
        """
        correction = 0.0
        if mass is not None:
            correction = mass.correction
        change, fused, ratio = fuse_on_worn_nut(
            partial(self.change, reference_ratio, correction), self.model.covariance
        )
        if mass is not None and mass.standard_uncertainty:
            change = _with_load_uncertainty(change, mass.standard_uncertainty)
            fused = fuse(change, self.model.covariance)
        return change, fused, ratio

    def explain(
        self,
        reference_ratio: float,
        run: Run,
        baseline: Run | None,
        masses: MassChanges | None,
        load_check: MassCheck | None = None,
    ) -> _ExplainedChange:
        """Change of the whole run and its possible causes.

        With ``load_check`` the load is corrected. ``masses`` is then None, since the correction was estimated
        from these observations.
        """
        change, fused, ratio = self.fuse(reference_ratio, load_check)
        if load_check is not None:
            run = replace(run, mass_kg=(run.mass_kg or 0.0) + load_check.correction)
        baselines = () if baseline is None else (baseline,)
        compliance_ratio = bearing_over_nut(change, fused)
        evidence_of_nut = nut_evidence(run, baselines, self.model, self.assumptions, compliance_ratio)
        observations = gather_evidence(
            change,
            masses,
            self.assumptions,
            temperature_difference=self.temperature_difference,
            model_covariance=self.model.covariance,
            softening=evidence_of_nut.softening,
            load_corrected=load_check is not None,
        )
        causes = compare_causes(observations, self.assumptions)
        return _ExplainedChange(change, fused, ratio, compliance_ratio, evidence_of_nut, observations, causes)

    def fuse_by_model(
        self, mass: MassCheck | None, fused: FusedChange
    ) -> tuple[ComplianceChange, FusedChange]:
        """Change against the model in each cell, and the same fused.

        Where the uncertainty of ``fused``, the change against the baseline, contains a misfit of the cells,
        so does that of the result.
        """
        change, by_model, _ = replace(self, base=None).fuse(1.0, mass)
        return change, with_misfit_of(by_model, fused)


def _estimate(
    refusal: PreloadEstimate, comparison: _RunComparison, run: Run, baseline: Run | None, more: Sequence[Run]
) -> PreloadEstimate:
    """Estimate of a run that has frequencies; ``refusal`` is a refused estimate without results."""
    model, assumptions = comparison.model, comparison.assumptions
    doubts = doubts_of_calibration(model, refusal.made.settings["accept"])
    samples = PosteriorSamples(model, comparison.base, assumptions)
    reference_ratio = samples.reference_ratio
    if not math.isfinite(reference_ratio):
        reason = (
            "the frequencies of the baseline lie above those of an infinitely stiff nut: it belongs to "
            "another axis or load, or the model does"
        )
        return _refuse(refusal, reason, *doubts)
    # The change and its causes, one of which may be a wrongly declared load. Where the load is wrong or
    # uncertain, the change is estimated anew without its effect, and so are the causes of what remains.
    masses = mass_changes(run, baseline, model.model, assumptions)
    declared = comparison.explain(reference_ratio, run, baseline, masses)
    doubts = [*lost_end(declared.change, declared.fused, model.model, assumptions), *doubts]
    load_check = _check_load(comparison, masses, declared)
    corrected = declared
    if load_check is not None and (load_check.correction or load_check.standard_uncertainty):
        corrected = comparison.explain(reference_ratio, run, baseline, None, load_check)
    change, evidence_of_nut = corrected.change, corrected.evidence_of_nut
    corrections = _describe_corrections(comparison, reference_ratio, corrected, load_check)
    fused = inflate_uncertainty(corrected.fused, corrected.observations, corrected.causes, assumptions)
    temperature = _temperature_correction(comparison, more)
    by_model = None
    if not samples.has_known_baseline:
        by_model = comparison.fuse_by_model(load_check, fused)
    refusal = replace(
        refusal,
        chi2=fused.chi2,
        degrees=fused.degrees,
        probability=fused.probability,
        causes=merge_nut_and_bearing(declared.causes, evidence_of_nut),
        mass=load_check,
        corrections=(*corrections, *temperature.corrections),
        change=change,
        fused=fused,
    )
    if load_check is not None and load_check.refused:
        return _refuse(refusal, load_check.text, *doubts)
    estimate = samples.estimate(refusal, change, fused, temperature, evidence_of_nut, by_model)
    if estimate is None:
        return _refuse(refusal, why_unbounded(fused, corrected.causes), *doubts)
    # Local wear, nut or bearing, and the verdict.
    curved = abs(model.model.curve) * float(np.ptp(change.position)) ** 2 > _LEAST_CURVATURE
    share_spread = share_uncertainty(model, assumptions)
    profile = preload_profile(run, baseline, change, fused, share_spread, curved, assumptions)
    low, high = estimate.relative_interval
    changed = not low <= 1 <= high  # since the baseline, or from the model's reference preload
    nut_or_bearing = attribute_change(corrected.observations, evidence_of_nut, assumptions, changed=changed)
    estimate = replace(estimate, profile=profile, nut_or_bearing=nut_or_bearing)
    reasons = why_not_good(estimate, run, baseline, change, fused, corrected.causes, assumptions)
    screw_doubts = warm_screw_doubts(comparison.table, comparison.base, calibrated=samples.has_known_baseline)
    reasons += [*temperature.reasons, *screw_doubts, *doubts]
    notes = estimate_notes(estimate, run, baseline, model)
    nut_reasons = reasons + why_nut_uncertain(estimate, evidence_of_nut, corrected.bearing_over_nut)
    estimate = replace(
        estimate,
        verdict=_verdict(reasons),
        reasons=tuple(reasons),
        nut_verdict=_nut_verdict(estimate, nut_reasons),
        nut_reasons=tuple(nut_reasons),
        notes=(*notes, *temperature.notes, *temperature_notes(run, baseline)),
    )
    return apply_release_limit(estimate, run, baseline, model)


def _refuse(refusal: PreloadEstimate, *reasons: str) -> PreloadEstimate:
    """The refused estimate with its reasons, which are the nut's too."""
    return replace(refusal, reasons=reasons, nut_reasons=reasons)


def _verdict(reasons: Sequence[str]) -> str:
    """Suspect if there are reasons, else good."""
    return "suspect" if reasons else "good"


def _nut_verdict(estimate: PreloadEstimate, reasons: Sequence[str]) -> str:
    """Verdict on the nut's preload: refused where it has no value, since its interval has no upper end."""
    if estimate.relative_to_baseline is None and estimate.relative_to_model is None:
        return "refused"
    return _verdict(reasons)


def _check_load(
    comparison: _RunComparison,
    masses: MassChanges | None,
    declared: _ExplainedChange,
) -> MassCheck | None:
    """Check of the declared load; None without a baseline. ``declared`` is the change with this load."""
    if comparison.base is None:
        return None
    sensitivity = load_significance(declared.change, declared.fused, comparison.model, comparison.assumptions)
    return check_mass(masses, declared.causes, sensitivity, comparison.assumptions)


def _describe_corrections(
    comparison: _RunComparison,
    reference_ratio: float,
    corrected: _ExplainedChange,
    mass: MassCheck | None,
) -> list[str]:
    """The corrections for the load on the table (kg) and on a worn nut (% of the preload), in words."""
    fused = corrected.fused
    corrections = []
    load = 0.0
    if mass is not None and mass.correction:
        load = mass.correction
        corrections.append(f"load: {load:+.2f} kg")
    # The same change without the correction for the load on a worn nut.
    uncorrected = replace(comparison, assumptions=replace(comparison.assumptions, nut_load=0.0))
    change = uncorrected.change(reference_ratio, load, corrected.ratio)
    u_uncorrected = 1 + float(fused.weights @ change.y)
    if fused.u > 0 and u_uncorrected > 0:
        percent = 100 * ((u_uncorrected / fused.u) ** 3 - 1)  # change of P = u⁻³ P₀ by the correction
        worn_nut_spread, _ = fused.terms[WORN_NUT]
        spread = 100 * 3 * worn_nut_spread / fused.u  # %, d ln P = −3 du/u
        if abs(percent) >= _LEAST_CORRECTION:
            corrections.append(f"load on a worn nut: {percent:+.1f} % ± {spread:.1f} % of the preload")
    return corrections


def _temperature_correction(comparison: _RunComparison, more: Sequence[Run]) -> TemperatureCorrection:
    """Correction for the temperature, the effect of which is fitted to the baselines ``more`` too."""
    base, table, assumptions = comparison.base, comparison.table, comparison.assumptions
    if base is None:
        return NO_CORRECTION
    ranges = math.hypot(table.temperature_range, base.temperature_range)
    if comparison.temperature_difference == 0 and not ranges:
        return NO_CORRECTION
    model = comparison.model
    tables = []
    for other in map(frequency_table, more):
        # Not the run itself, and no run of the calibration, to which the prior slope was fitted already.
        is_run = other.id == table.id
        in_prior = model.temperature is not None and model.group_of(other.id) is not None
        common_rows, _ = paired_cells(other, base)
        temperatures_known = base.temperature is not None and other.temperature is not None
        if temperatures_known and common_rows and not is_run and not in_prior:
            tables.append(other)

    def change_of(other: FrequencyTable) -> ComplianceChange:
        """Change of another baseline since the first, at P₀/P_ref = 1, on which the slope hardly depends."""
        return replace(comparison, table=other).change(reference_ratio=1.0, correction=0.0, ratio=1.0)

    baselines = further_baselines(base, tables, change_of, assumptions)
    return temperature_correction(
        table.temperature,
        base.temperature,
        baselines,
        assumptions,
        prior=model.temperature,
        within=ranges / math.sqrt(12),  # standard deviation of a uniform distribution of this range
    )


def _with_load_uncertainty(change: ComplianceChange, spread: float) -> ComplianceChange:
    """The change with ``spread``, kg, as the uncertainty of the load instead of that of the assumptions."""
    terms = []
    for term in change.terms:
        if term.name == DECLARED_LOAD:
            terms.append(replace(term, effects=(change.by_load * spread)[None]))
        else:
            terms.append(term)
    return replace(change, terms=tuple(terms))
