"""Assessment of a run relative to the reference of its epoch: its level, and its verdict.

A good run has a good measurement and is comparable with the reference (same plan, similar load); its masses
and the mass of its FRF agree with those of the reference; and a change of the nut explains its cells.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from ballscrew.calibration.calibrated_axis import CalibratedAxis
from ballscrew.calibration.frequency_table import FrequencyTable, paired_cells
from ballscrew.estimation.causes import AXIAL, compare_causes, gather_evidence
from ballscrew.estimation.change import ComplianceChange
from ballscrew.estimation.compliance import BASELINE, BASELINE_PART, change_since
from ballscrew.estimation.fusion import FusedChange, fuse_on_worn_nut
from ballscrew.estimation.mass_check import check_mass, mass_changes
from ballscrew.estimation.nut import release_limit
from ballscrew.estimation.samples import load_significance
from ballscrew.estimation.temperature import warm_screw_doubts
from ballscrew.estimation.verdict import describe_misfit, doubts_of_cells, sheet_notes, why_no_frequency
from ballscrew.modal.run import Run
from ballscrew.monitoring.detection.settings import MonitorSettings
from ballscrew.monitoring.reading import Reading

_LARGEST_LOAD_CHANGE = 0.25  # of the moving mass, as ``preload`` allows
_FRF = 0.02  # relative deviation of the FRF's equivalent mass from the rigid body's
_STIFFEST = -0.5  # level of P/P₀ = 8, beyond which the chart counts none
_LEAST_COMPLIANCE = 0.1  # relative to the reference
_SOFTEST = 1.0  # growth of the compliance: beyond it one flank carries the load, and no softer
_WINDUP = 0.5  # relative uncertainty of the additional wind-up of a softer axis: friction changes too
_BASELINE_TERMS = (BASELINE, BASELINE_PART)
_FOLLOWED = (*AXIAL, "local", "gradient", "torque")  # causes of a misfit with which a run counts


@dataclass(frozen=True, slots=True, eq=False)
class MeasuredRun:
    """Run and its table of frequencies."""

    run: Run
    table: FrequencyTable


@dataclass(frozen=True, slots=True, eq=False)
class AssessedRun:
    """Run with its reading and the change since the epoch's reference.

    Parameters
    ----------
    run : Run
        Analysed.
    reading : Reading
        Its quantities.
    change, fused : ComplianceChange, FusedChange or None
        Relative to the epoch's reference; None where it cannot be estimated.
    doubts : tuple of str
        Reasons by which the preload of a good run is suspect, as those of
        :func:`ballscrew.estimation.preload.preload`.
    limit : float or None
        P/P₀ below which the nut's preload is, where the test's own load unloads the nut; one-sided, 95 %.
    """

    run: Run
    reading: Reading
    change: ComplianceChange | None = None
    fused: FusedChange | None = None
    doubts: tuple[str, ...] = ()
    limit: float | None = None


def fused_change(
    table: FrequencyTable, reference: FrequencyTable, model: CalibratedAxis, settings: MonitorSettings
) -> tuple[ComplianceChange, FusedChange]:
    """Change of the nut since the reference, at the test's own load on the worn nut.

    Parameters
    ----------
    table, reference : FrequencyTable
        Two runs with cells in common.
    model : CalibratedAxis
        The axis.
    settings : MonitorSettings
        Assumptions.

    Returns
    -------
    ComplianceChange, FusedChange
        As in :func:`ballscrew.estimation.preload.preload`, without its samples.
    """
    more = table.load - reference.load

    def change_at(ratio: float) -> ComplianceChange:
        return change_since(
            table, reference, model.model, model.bearing_share, 1.0, settings.assumptions, more, ratio,
            model.covariance,
        )  # fmt: skip

    change, fused, _ = fuse_on_worn_nut(change_at)
    return change, fused


def unassessed_reading(run: Run, day: float, epoch: int) -> Reading:
    """Reading of a run with its masses, friction and mean frequency, and without a level.

    Parameters
    ----------
    run : Run
        Analysed.
    day : float
        Since the first run of the history.
    epoch : int
        From 0.

    Returns
    -------
    Reading
        With nan for what is not known.
    """
    rigid, softening = run.rigid_body, run.mass_over_preload_kg_per_N
    reading = Reading(
        run=run.id,
        measured_at=str(run.measured_at),
        day=day,
        epoch=epoch,
        temperature=_number(run.temperature_C),
        level=math.nan,
        random=math.nan,
        verdict="good",
        equivalent_mass=_number(rigid.equivalent_mass_kg),
        friction=_number(rigid.coulomb_N),
        friction_uncertainty=_number(
            rigid.repeatability.get("coulomb_N", rigid.standard_uncertainty.get("coulomb_N"))
        ),
        features=_features(run),
    )
    if softening is None:
        return reading
    return replace(
        reading,
        mass_over_preload=softening.value,
        mass_over_preload_uncertainty=softening.standard_uncertainty,
    )


def _features(run: Run) -> dict[str, float]:
    """Friction, mass of the FRF and mean frequency of a run, where known."""
    features = {}
    for name in ("coulomb_N", "viscous_N_s_per_m", "frf_equivalent_mass_kg"):
        value = getattr(run.rigid_body, name)
        if value is not None:
            features[name] = float(value)
    accepted = [cell.frequency_Hz for cell in run.cells if cell.verdict != "refused"]
    frequencies = [frequency for frequency in accepted if frequency is not None]
    if frequencies:
        features["mean_frequency_Hz"] = float(np.mean(frequencies))
    return features


def assess_run(
    measured: MeasuredRun,
    reading: Reading,
    reference: MeasuredRun | None,
    model: CalibratedAxis,
    settings: MonitorSettings,
) -> AssessedRun:
    """Assess a run by its own verdict and relative to its epoch's reference.

    Parameters
    ----------
    measured : MeasuredRun
        The run and its frequencies.
    reading : Reading
        With its masses.
    reference : MeasuredRun or None
        Reference of the epoch; None before its first good run.
    model : CalibratedAxis
        The axis.
    settings : MonitorSettings
        Limits of plausibility.

    Returns
    -------
    AssessedRun
        With its level if it can be estimated, and with the reasons if the run is not good.
    """
    run, quality = measured.run, measured.run.quality
    if quality.verdict == "bad" or not len(measured.table.frequency):
        if quality.verdict != "bad" and reference is not None:
            # A displacement probe measures lost motion all the same.
            reading = _with_lost_motion(reading, run, reference.run, _SOFTEST)
        reasons = tuple(quality.reasons) or (why_no_frequency(run),)
        limit = _limit(measured, reference, model, settings)
        return AssessedRun(run, replace(reading, verdict="refused", reasons=reasons), limit=limit)
    if reference is None:
        reasons = tuple(quality.reasons) or ("it is suspect",)
        return AssessedRun(run, replace(reading, verdict="suspect", reasons=reasons))
    difference = _why_not_comparable(measured, reference, model)
    if difference:
        return AssessedRun(run, replace(reading, verdict="suspect", reasons=(difference,)))
    change, fused = fused_change(measured.table, reference.table, model, settings)
    reading = replace(
        reading, level=fused.level, random=fused.random, systematic=_systematic_uncertainty(fused)
    )
    softer = float(np.clip(np.mean(change.y), 0.0, _SOFTEST))
    reading = _with_lost_motion(reading, run, reference.run, softer)
    faults, doubts, notes = _disagreements(measured, reference, change, fused, model, settings)
    faults += warm_screw_doubts(measured.table, reference.table, calibrated=True)
    if quality.verdict != "good":
        own = quality.reasons or ("the measurement is suspect",)
        faults = [*own, *faults]
    if faults:
        reading = replace(reading, verdict="suspect", reasons=tuple(faults))
    else:
        reading = replace(reading, verdict="good", reasons=(*doubts, *notes))
    limit = _limit(measured, reference, model, settings)
    return AssessedRun(run, reading, change, fused, tuple(doubts), limit)


def _limit(
    measured: MeasuredRun, reference: MeasuredRun | None, model: CalibratedAxis, settings: MonitorSettings
) -> float | None:
    """P/P₀ below which the test unloads the nut; None where it does not, or something else has changed."""
    run = measured.run
    if reference is None or run.quality.verdict != "good":
        return None
    if _another_test(measured, reference, model) or _frf_fault(run, reference.run, settings.deviations):
        return None
    masses = mass_changes(run, reference.run, model.model, settings.assumptions)
    if masses is not None and abs(masses.log_mass) > settings.deviations * masses.log_mass_spread:
        return None
    limit = release_limit(run, reference.run, model)
    return limit if limit is not None and limit < 1 else None


def _systematic_uncertainty(fused: FusedChange) -> float:
    squares = 0.0
    for name, (uncertainty, random) in fused.terms.items():
        if not random and name not in _BASELINE_TERMS:
            squares += uncertainty**2
    return math.sqrt(squares)


def _why_not_comparable(measured: MeasuredRun, reference: MeasuredRun, model: CalibratedAxis) -> str | None:
    difference = _another_test(measured, reference, model)
    if difference is None and not paired_cells(measured.table, reference.table)[0]:
        difference = "it has no cell with a frequency in common with the epoch's reference"
    return difference


def _another_test(measured: MeasuredRun, reference: MeasuredRun, model: CalibratedAxis) -> str | None:
    plan = measured.run.made.inputs.get("plan")
    reference_plan = reference.run.made.inputs.get("plan")
    if plan is not None and reference_plan is not None and plan != reference_plan:
        return "its plan is not that of the epoch's reference"
    load, reference_load = measured.table.load, reference.table.load
    if abs(load - reference_load) > _LARGEST_LOAD_CHANGE * (model.model.mass + reference_load):
        return f"it was measured with {load:g} kg, the epoch's reference with {reference_load:g} kg"
    return None


def _disagreements(
    measured: MeasuredRun,
    reference: MeasuredRun,
    change: ComplianceChange,
    fused: FusedChange,
    model: CalibratedAxis,
    settings: MonitorSettings,
) -> tuple[list[str], list[str], list[str]]:
    """Faults of a run relative to the epoch's reference, doubts with which it counts all the same, and notes.

    Cells that one preload does not explain are a doubt where wear is or may be the cause: what a screw warmer
    at one end does to them, uneven wear does too, and it must raise the alarm.
    """
    assumptions, limit = settings.assumptions, settings.deviations
    masses = mass_changes(measured.run, reference.run, model.model, assumptions)
    other_mass = masses is not None and abs(masses.log_mass) > limit * masses.log_mass_spread
    misfit = fused.probability < max(assumptions.false_alarm, settings.suspect)
    faults: list[str] = []
    notes = sheet_notes(measured.run, reference.run)
    doubts: list[str] = []
    if other_mass or misfit:
        causes = compare_causes(gather_evidence(change, masses, assumptions), assumptions)
        if other_mass:
            sensitivity = load_significance(change, fused, model, assumptions)
            check = check_mass(masses, causes, sensitivity, assumptions)
            if check.decision in ("torque", "declared"):
                notes.append(check.text)
            else:
                faults.append(check.text)
        if misfit:
            text = describe_misfit(fused, causes)
            if fused.probability < settings.suspect and causes[0].name not in _FOLLOWED:
                faults.append(text)
            else:
                doubts.append(text)
    faults += _too_stiff(fused, limit)
    faults += _frf_fault(measured.run, reference.run, limit)
    faults += doubts_of_cells(measured.run, reference.run, in_history=True)
    return faults, doubts, notes


def _too_stiff(fused: FusedChange, limit: float) -> list[str]:
    """Fault of a run whose frequencies no preload of this nut gives; a soft one may be worn."""
    if not fused.level + limit * fused.spread < _STIFFEST:
        return []
    ratio = max(1 + fused.level, _LEAST_COMPLIANCE) ** -3
    fault = f"it is as stiff as with {ratio:.0f} times the preload of the epoch's reference"
    return [f"{fault}, more than a nut can have: is it a run of another axis?"]


def _frf_fault(run: Run, reference: Run, limit: float) -> list[str]:
    """Fault by a change of the FRF's equivalent mass over the rigid body's, which the accelerometer causes.

    Friction that was not removed also changes the FRF's mass as the nut wears; the stated uncertainty
    includes that.
    """
    now, then = _frf_ratio(run), _frf_ratio(reference)
    if now is None or then is None:
        return []
    change = now[0] - then[0]
    spread = max(now[1], then[1])
    if not spread > 0:
        spread = 0.0
    if not abs(change) > max(_FRF, limit * spread):
        return []
    size = "smaller" if change > 0 else "larger"
    fault = (
        f"its FRF is {100 * abs(change):.1f} % {size} than that of its rigid body, relative to the epoch's"
    )
    return [f"{fault} reference: has the accelerometer moved or come loose?"]


def _frf_ratio(run: Run) -> tuple[float, float] | None:
    """Logarithm of the FRF's equivalent mass over the rigid body's, and its standard uncertainty."""
    body = run.rigid_body
    frf_mass, mass = body.frf_equivalent_mass_kg, body.equivalent_mass_kg
    if frf_mass is None or mass is None or not (frf_mass > 0 and mass > 0):
        return None
    return math.log(frf_mass / mass), _number(
        body.standard_uncertainty.get("frf_equivalent_mass_kg")
    ) / frf_mass


def _with_lost_motion(reading: Reading, run: Run, reference: Run, softer: float) -> Reading:
    """Reading with the lost motion in excess of the wind-up by friction, mean over the common stops.

    A softer axis winds up more without any backlash. The wind-up is the reference's lost motion, scaled by
    the growth ``softer`` of the compliance, which the frequencies give.
    """
    now, then = _lost_motion(run), _lost_motion(reference)
    common = sorted(now.keys() & then.keys())
    if not common:
        return reading
    lost, own = np.array([now[stop] for stop in common]).T
    windup, own_then = np.array([then[stop] for stop in common]).T
    excess = lost - windup * (1 + softer)
    spread = math.sqrt(float(np.nansum(np.concatenate([own, own_then]) ** 2))) / len(common)
    if len(common) > 1:
        spread = max(spread, float(np.std(excess, ddof=1)) / math.sqrt(len(common)))
    spread = math.hypot(spread, _WINDUP * softer * abs(float(windup.mean())))
    if not spread > 0:
        return reading
    return replace(reading, backlash=float(excess.mean()), backlash_uncertainty=spread)


def _lost_motion(run: Run) -> dict[float, tuple[float, float]]:
    """Lost motion and its standard uncertainty by stop, m."""
    stops = {}
    for stop in run.lost_motion:
        stops[round(stop.position_m, 6)] = stop.lost_m, stop.standard_uncertainty_m
    return stops


def _number(value: float | None) -> float:
    return math.nan if value is None else float(value)


def agree(
    measured: MeasuredRun, other: MeasuredRun, model: CalibratedAxis, settings: MonitorSettings
) -> bool:
    """Check whether two runs belong to one state of the axis.

    Parameters
    ----------
    measured, other : MeasuredRun
        Two good runs.
    model : CalibratedAxis
        The axis.
    settings : MonitorSettings
        Limits of plausibility.

    Returns
    -------
    bool
        False if masses, FRF or cells show that something other than the nut has changed.
    """
    if _why_not_comparable(measured, other, model):
        return False
    change, fused = fused_change(measured.table, other.table, model, settings)
    faults, *_ = _disagreements(measured, other, change, fused, model, settings)
    return not faults
