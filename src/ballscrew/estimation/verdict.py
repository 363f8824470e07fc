"""Whether a preload that was told is good, why not, and what must be known with it: in words."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ballscrew.calibration.assumptions import Assumptions
from ballscrew.calibration.calibrated_axis import CalibratedAxis
from ballscrew.calibration.method import method_of
from ballscrew.estimation.cause import Cause, possible_beside
from ballscrew.estimation.change import ComplianceChange
from ballscrew.estimation.fusion import FusedChange
from ballscrew.estimation.inflation import LOCAL, UNEXPLAINED
from ballscrew.estimation.local_wear import Along
from ballscrew.estimation.mass_check import MassCheck
from ballscrew.modal.run import Run

__all__ = ["beside", "no_limit", "why_not_good"]

_DOUBTS = 3  # of a calibration, told with each preload
_WIDE = 8.0  # ratio of the interval's ends from which a number is no longer one


def why_not_good(
    run: Run,
    baseline: Run | None,
    assumptions: Assumptions,
    change: ComplianceChange,
    fused: FusedChange,
    found: tuple[Cause, ...],
    mass: MassCheck | None,
    local: Along | None,
    numbers: Mapping[str, Any],
) -> list[str]:
    """Say why a preload is suspect.

    Parameters
    ----------
    run, baseline : Run
        Analysed.
    assumptions : Assumptions
        What is taken for granted.
    change, fused : ComplianceChange, FusedChange
        Of the cells, with the load corrected.
    found : tuple of Cause
        What may explain the change, the most probable first.
    mass : MassCheck, optional
        The load against the baseline's.
    local : Along, optional
        P(x).
    numbers : mapping
        Has the quantities relative_to_baseline and relative_to_model.

    Returns
    -------
    list of str
        Empty where it is good.
    """
    reasons = []
    if run.quality.verdict == "suspect":
        reasons += [f"the measurement is suspect: {reason}" for reason in run.quality.reasons[:3]]
    if baseline is not None and baseline.quality.verdict == "suspect":
        reasons.append("the baseline's measurement is suspect")
    if fused.probability < assumptions.false_alarm:
        widened = fused.terms.keys() & {LOCAL, UNEXPLAINED}
        reasons.append(_misfit(fused, found) + (", and the interval is widened by it" if widened else ""))
    if mass is not None and mass.decision in ("corrected", "torque", "undecided"):
        reasons.append(mass.text)
    if local is not None and local.found:
        reasons.append(local.text)
    main = numbers["relative_to_baseline"] or numbers["relative_to_model"]
    low, high = main.interval
    if mass is not None and mass.unseen and mass.change is not None and not low <= 1 <= high:
        imitating = fused.level / float(fused.weights @ change.mass)
        way = 1.0 if imitating > 0 else -1.0
        if abs(imitating) < way * mass.change.value + mass.unseen:
            reasons.append(
                f"a load {imitating:+.2g} kg off, which the masses would not show, would look the same"
            )
    if high > _WIDE * low:
        reasons.append("the interval is so wide that it tells little")
    return reasons


def beside(
    run: Run,
    baseline: Run | None,
    model: CalibratedAxis,
    assumptions: Assumptions,
    found: tuple[Cause, ...],
    mass: MassCheck | None,
    numbers: Mapping[str, Any],
) -> list[str]:
    """Say what must be known with a preload, good or not.

    Parameters
    ----------
    run, baseline : Run
        Analysed.
    model : CalibratedAxis
        Of the axis.
    assumptions : Assumptions
        What is taken for granted.
    found : tuple of Cause
        What may explain the change.
    mass : MassCheck, optional
        The load against the baseline's.
    numbers : mapping
        Has the quantities that are told.

    Returns
    -------
    list of str
        A sentence each.
    """
    notes = [f"the model was calibrated with a doubt: {reason}" for reason in model.reasons[:_DOUBTS]]
    if mass is not None and mass.unseen:
        notes.append(mass.text)
    if baseline is not None and baseline.id == run.id:
        notes.append("the run is the baseline itself")
    for cause in possible_beside(found):
        if cause.name == "bearing":
            notes += _bearing(cause, assumptions, numbers)
        elif cause.name not in ("local", "torque"):
            notes.append(f"also possible: {cause.text} (probability {cause.probability:.2f})")
    if numbers["preload_N"] is None:
        notes.append("newtons are not told: their interval has no upper end; P/P₀ takes less of the model")
    if method_of(run) == "paper":
        notes.append(
            "by method paper: the frequencies are of a nut under load, which no run tells, and are not "
            "corrected for it; a worn nut reads as up to 10 % less preload than it has. Method "
            "joint corrects it"
        )
    if baseline is None:
        notes.append(
            "told from the model alone; a baseline of the same axis would cancel the errors that repeat"
        )
    elif baseline.id not in {one.id for one in model.runs}:
        notes.append("the model was calibrated without the baseline; its level was read by the model")
    return notes


def no_limit(fused: FusedChange, found: tuple[Cause, ...] = ()) -> str:
    """Say why a preload has no number.

    Parameters
    ----------
    fused : FusedChange
        The change of the nut.
    found : tuple of Cause
        What may explain the change.

    Returns
    -------
    str
        Half a sentence.
    """
    if fused.level <= -1:
        return (
            "the frequencies lie above those of an infinitely stiff nut: no preload belongs to them; the "
            "model, the load or the baseline is wrong"
        )
    if fused.terms.keys() & {LOCAL, UNEXPLAINED}:
        return f"{_misfit(fused, found)}; widened by it, the interval has no upper end"
    return (
        "the interval of the preload has no upper end: within their uncertainty the frequencies may be "
        "those of an infinitely stiff nut"
    )


def _misfit(fused: FusedChange, found: tuple[Cause, ...]) -> str:
    other = next(iter(possible_beside(found)), None)
    likely = f"the likeliest cause is {other.text}" if other else "no cause that is known here does either"
    return (
        f"no preload explains all cells: χ² is {fused.chi2:.1f} where {fused.degrees:.1f} is expected; "
        f"{likely}"
    )


def _bearing(cause: Cause, assumptions: Assumptions, numbers: Mapping[str, Any]) -> list[str]:
    """Name the bearing where a change is beyond what the interval allows it."""
    main = numbers["relative_to_baseline"]
    if main is None or main.interval[0] <= 1 <= main.interval[1]:
        return []
    changed = numbers["relative_if_bearing_changed"]
    if changed is None:
        second = "has no upper end"
    else:
        low, high = changed.interval
        second = f"{low:.2f} to {high:.2f}" + (
            ", holds 1" if low <= 1 <= high else ", does not hold 1 either"
        )
    allowed, changed_by = 100 * assumptions.bearing_drift, 100 * assumptions.bearing_change
    text = (
        f"frequencies alone cannot tell the nut from the bearing: {cause.text} would look the same. The "
        f"interval allows the bearing ± {allowed:g} %; the one that allows it ± {changed_by:g} %, {second}. "
        "Friction, backlash and the frequency's answer to the nut's load can tell"
    )
    return [text]
