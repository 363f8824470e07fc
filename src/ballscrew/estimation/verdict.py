"""Reasons why an estimate of the preload is suspect or refused, and further notes on it."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import replace

from ballscrew.base.words import plural
from ballscrew.calibration.assumptions import Assumptions
from ballscrew.calibration.calibrated_axis import CalibratedAxis
from ballscrew.calibration.frequency_table import common_doubts
from ballscrew.calibration.method import method_of
from ballscrew.estimation.causes import PossibleCause, other_possible_causes
from ballscrew.estimation.change import ComplianceChange
from ballscrew.estimation.estimate import PreloadEstimate
from ballscrew.estimation.fusion import FusedChange
from ballscrew.estimation.inflation import is_inflated
from ballscrew.estimation.mass_check import MassCheck
from ballscrew.estimation.nut import (
    NutEvidence,
    describe_contradiction,
    describe_release,
    describe_unidentifiable,
    ratio_below,
    release_limit,
)
from ballscrew.modal.run import Run
from ballscrew.recording.quality.clock import clock_difference

# Largest number of reasons of a measurement, and of notes of a calibration, that are repeated with a preload.
_MOST_REASONS = 3
_ID_LENGTH = 12  # characters of a run's id in the sentences on a calibration
_TIME_WIDTH = 16  # characters of a run's time, to the minute
# Kinds of doubt whose errors repeat in every run of a test, so that they cancel in a change. Those of the
# other kinds (by chance, a lost contact, another mode) do not repeat.
_CANCELLED = frozenset(("measurement", "low-rate", "unexcited", "unmeasured-force"))
_LEAST_PRINTED = 0.005  # probability of another cause: a smaller one would be printed as 0.00
_WIDEST = 8.0  # upper over lower end of an interval, above which an estimate is suspect


def why_not_good(
    estimate: PreloadEstimate,
    run: Run,
    baseline: Run | None,
    change: ComplianceChange,
    fused: FusedChange,
    causes: Sequence[PossibleCause],
    assumptions: Assumptions,
) -> list[str]:
    """Reasons why a preload is suspect.

    Parameters
    ----------
    estimate : PreloadEstimate
        With its quantities, mass check and profile.
    run : Run
        Analysed.
    baseline : Run or None
        Likewise.
    change, fused : ComplianceChange, FusedChange
        Of the cells, with the load corrected.
    causes : sequence of PossibleCause
        Of this change, the most probable first.
    assumptions : Assumptions
        With ``false_alarm``, the probability of a misfit below which the misfit is a reason.

    Returns
    -------
    list of str
        Empty where it is good.
    """
    mass, profile = estimate.mass, estimate.profile
    reasons = _suspect_measurements(run, baseline)
    if fused.probability < assumptions.false_alarm:
        consequence = ""
        if is_inflated(fused):
            consequence = ", and the interval includes this misfit"
        reasons.append(describe_misfit(fused, causes) + consequence)
    if mass is not None and mass.decision in ("corrected", "torque", "undecided"):
        reasons.append(mass.text)
    if profile is not None and profile.found:
        reasons.append(profile.text)
    if mass is not None:
        reasons += _undetectable_load(change, fused, mass, estimate)
    if _is_too_wide(estimate.relative_interval):
        reasons.append("the interval is too wide to be useful")
    return reasons


def doubts_of_cells(run: Run, baseline: Run | None, *, in_history: bool = False) -> list[str]:
    """Reasons why half of the cells of a run or its baseline are suspect, unless they cancel in a change.

    Further reasons are a mode of the frame in one of the runs, and clocks that differ.

    Parameters
    ----------
    run : Run
        Analysed.
    baseline : Run or None
        Likewise.
    in_history : bool
        Whether the run belongs to a history. Few repetitions in both runs are then no reason, since the
        history's scatter contains their errors; nor is a nut that the test unloads, which is a sign of wear.

    Returns
    -------
    list of str
        A sentence for each reason; one that both runs have is listed once.
    """
    of_run = common_doubts(run)
    of_baseline = {} if baseline is None else common_doubts(baseline)
    cancelled = of_run.keys() & of_baseline.keys() & _CANCELLED
    if in_history:
        cancelled |= of_run.keys() & of_baseline.keys() & {"few-repetitions"}
        cancelled |= of_run.keys() & {"unloaded"}
    reasons = []
    for kind, (count, text) in of_run.items():
        if kind not in cancelled:
            reasons.append(f"{count} cells are suspect: {text}")
    for kind, (count, text) in of_baseline.items():
        if kind not in of_run:
            reasons.append(f"{count} cells of the baseline are suspect: {text}")
    if baseline is not None and (run.frame_mode is None) != (baseline.frame_mode is None):
        with_frame, other = "run", "baseline"
        if run.frame_mode is None:
            with_frame, other = "baseline", "run"
        reasons.append(
            f"a mode of the machine's frame or of the pitching table was found in the {with_frame} and not "
            f"in the {other}: their frequencies are not of the same mode"
        )
    clocks = clock_difference(run.clock, None if baseline is None else baseline.clock)
    if clocks is not None:
        reasons.append(clocks)
    return reasons


def why_nut_uncertain(estimate: PreloadEstimate, evidence: NutEvidence, bearing_over_nut: float) -> list[str]:
    """Reasons why the nut's preload is suspect, besides those of the axial stiffness.

    Parameters
    ----------
    estimate : PreloadEstimate
        With its quantities.
    evidence : NutEvidence
        Of nut and support bearing.
    bearing_over_nut : float
        Compliance of the bearing over the nut's.

    Returns
    -------
    list of str
        Empty where the nut's preload is as good as the stiffness.
    """
    nut = estimate.relative_to_baseline or estimate.relative_to_model
    if nut is None:
        return ["within the support bearing's possible change the nut's preload has no upper end"]
    reasons = []
    low, high = estimate.relative_interval
    if not evidence.separates and not low <= 1 <= high:
        reasons.append(describe_unidentifiable(bearing_over_nut))
    stiffness = estimate.stiffness_relative_to_baseline
    if stiffness is not None:
        reason = describe_contradiction(stiffness, bearing_over_nut, evidence)
        if reason:
            reasons.append(reason)
    if _is_too_wide(nut.interval):
        reasons.append("the interval of the nut's preload is too wide to be useful")
    elif estimate.preload_N is not None and _is_too_wide(estimate.preload_N.interval):
        reasons.append(
            "the interval of the preload in newtons is too wide to be useful: calibrate with a known preload"
        )
    return reasons


def _is_too_wide(interval: tuple[float, float]) -> bool:
    """Whether an interval of a preload or of a ratio of preloads is too wide to be useful."""
    low, high = interval
    return high > _WIDEST * low


def apply_release_limit(
    estimate: PreloadEstimate, run: Run, baseline: Run | None, model: CalibratedAxis
) -> PreloadEstimate:
    """Replace the nut's preload by an upper limit where the test's own load unloads most cells of a run.

    Parameters
    ----------
    estimate : PreloadEstimate
        With its verdicts; a refused one where the run has no frequency.
    run : Run
        Analysed.
    baseline : Run or None
        Likewise.
    model : CalibratedAxis
        Of the axis.

    Returns
    -------
    PreloadEstimate
        Unchanged where :func:`~ballscrew.estimation.nut.release_limit` gives no limit, or where the stiffness
        is known and the nut's preload is refused, as it has no upper end.
    """
    nut = estimate.relative_to_baseline
    limit = release_limit(run, baseline, model)
    if limit is None or (nut is None and estimate.verdict != "refused"):
        return estimate
    return replace(
        estimate,
        nut_verdict="suspect",
        nut_reasons=(*estimate.nut_reasons, describe_release(limit)),
        relative_to_baseline=ratio_below(limit, nut),
        relative_to_model=None,
        preload_N=None,
        preload_ratio=None,
        random_N=None,
        systematic_N=None,
    )


def doubts_of_calibration(model: CalibratedAxis, accepted: Sequence[str]) -> list[str]:
    """Reasons to doubt a calibration, which make every result of its model suspect.

    Parameters
    ----------
    model : CalibratedAxis
        With the reasons of its calibration.
    accepted : sequence of str
        Names of those that the user accepts.

    Returns
    -------
    list of str
        A sentence for each name, in which runs are named by their times. Empty where the calibration is good
        or all its reasons are accepted.
    """
    texts: dict[str, list[str]] = {}
    for doubt in model.reasons:
        if doubt.name not in accepted:
            texts.setdefault(doubt.name, []).append(_with_times(doubt.text, model))
    reasons = []
    for name, (first, *others) in texts.items():
        further = ""
        if others:
            further = f" ({plural(len(others), 'further reason')} of this name)"
        reasons.append(f"the calibration is suspect ({name}): {first}{further}")
    return reasons


def _with_times(text: str, model: CalibratedAxis) -> str:
    """Sentence on a calibration with its runs named by their times, where these are known."""
    for run in model.runs:
        if run.measured_at is not None:
            name = re.escape(run.id[:_ID_LENGTH])
            text = re.sub(rf"\b{name}\b", f"of {run.measured_at[:_TIME_WIDTH]}", text)
    return text


def notes_of_calibration(model: CalibratedAxis, accepted: Sequence[str]) -> list[str]:
    """Accepted reasons to doubt a calibration, and its notes.

    Parameters
    ----------
    model, accepted
        As for :func:`doubts_of_calibration`.

    Returns
    -------
    list of str
        A sentence for each, in which runs are named by their times.
    """
    notes = [f"accepted ({doubt.name}): {doubt.text}" for doubt in model.reasons if doubt.name in accepted]
    notes += [f"of the calibration: {note}" for note in model.notes[:_MOST_REASONS]]
    return [_with_times(note, model) for note in notes]


def sheet_notes(run: Run, baseline: Run | None) -> list[str]:
    """Note on a run that was analysed with another data sheet than its baseline.

    Parameters
    ----------
    run : Run
        Analysed.
    baseline : Run or None
        Likewise.

    Returns
    -------
    list of str
        Empty where the sheets are the same.
    """
    sheets = {each.made.inputs.get("axis") for each in (run, baseline) if each is not None}
    if len(sheets) == 1 or None in sheets:
        return []
    return ["it was analysed with another data sheet than the baseline: analyse both with one"]


def estimate_notes(
    estimate: PreloadEstimate,
    run: Run,
    baseline: Run | None,
    model: CalibratedAxis,
) -> list[str]:
    """Notes on a preload, good or not.

    Parameters
    ----------
    estimate : PreloadEstimate
        With its quantities, causes and mass check.
    run : Run
        Analysed.
    baseline : Run or None
        Likewise.
    model : CalibratedAxis
        Of the axis.

    Returns
    -------
    list of str
        A sentence for each note.
    """
    notes = notes_of_calibration(model, estimate.made.settings["accept"])
    if estimate.mass is not None and estimate.mass.undetectable:
        notes.append(estimate.mass.text)
    if baseline is not None and baseline.id == run.id:
        notes.append("the run is the baseline itself")
    notes += _cause_notes(estimate) + sheet_notes(run, baseline)
    if estimate.preload_N is None:
        notes.append(
            "no preload in newtons: its interval has no upper end; P/P₀ depends less on the calibration"
        )
    if method_of(run) == "paper":
        notes.append(
            "by method paper: the frequencies are those of a nut under load, and are not corrected for it; "
            "the preload of a worn nut is estimated up to 10 % too low. Method joint corrects the load"
        )
    if baseline is None:
        notes.append(
            "estimated from the model alone; a baseline of the same axis would cancel the errors that repeat"
        )
    elif model.group_of(baseline.id) is None:
        notes.append("the baseline is not a run of the calibration; its preload was estimated with the model")
    return notes


def why_no_frequency(run: Run) -> str:
    """Reason to refuse a run without a frequency, with the reasons of the first cell that states any."""
    text = "no cell of the run has a frequency"
    for cell in run.cells:
        if cell.reasons:
            return f"{text}: {'; '.join(cell.reasons)}"
    return text


def why_unbounded(fused: FusedChange, causes: Sequence[PossibleCause]) -> str:
    """Reason why the interval of a preload has no upper end.

    Parameters
    ----------
    fused : FusedChange
        The change of the nut.
    causes : sequence of PossibleCause
        Of this change, the most probable first.

    Returns
    -------
    str
        A sentence without full stop.
    """
    if fused.u <= 0:
        return (
            "the frequencies lie above those of an infinitely stiff nut, which no preload can cause; the "
            "model, the load or the baseline is wrong"
        )
    if is_inflated(fused):
        return f"{describe_misfit(fused, causes)}; with this misfit the interval has no upper end"
    return (
        "the interval of the preload has no upper end: within their uncertainty the frequencies may be "
        "those of an infinitely stiff nut"
    )


def _undetectable_load(
    change: ComplianceChange, fused: FusedChange, mass: MassCheck, estimate: PreloadEstimate
) -> list[str]:
    """A sentence if an error of the load that the masses do not detect may be the whole change; else none."""
    if not mass.undetectable or mass.change is None:
        return []
    low, high = estimate.relative_interval
    if low <= 1 <= high:
        return []
    # The load error that alone would cause the change, kg, is compared with the largest error of the same
    # sign that the masses do not exclude. Such errors lie about the observed change of the equivalent mass.
    same_effect = fused.level / float(fused.weights @ change.by_load)
    possible = mass.undetectable + math.copysign(1.0, same_effect) * mass.change.value
    if abs(same_effect) >= possible:
        return []
    return [f"a load error of {same_effect:+.2g} kg, which the masses would not show, has the same effect"]


def _suspect_measurements(run: Run, baseline: Run | None) -> list[str]:
    """Reasons from the quality of the two measurements."""
    reasons = []
    if run.quality.verdict == "suspect":
        reasons = [f"the measurement is suspect: {reason}" for reason in run.quality.reasons[:_MOST_REASONS]]
    if baseline is not None and baseline.quality.verdict == "suspect":
        reasons.append("the measurement of the baseline is suspect")
    return reasons + doubts_of_cells(run, baseline)


def _cause_notes(estimate: PreloadEstimate) -> list[str]:
    """Notes on other possible causes, except those for which other sentences are reported."""
    reported = ["local", "torque"]
    if estimate.mass is not None and estimate.mass.correction:
        reported.append("load")
    return [
        f"also possible: {cause.text} (probability {cause.probability:.2f})"
        for cause in other_possible_causes(estimate.causes)
        if cause.name not in reported and cause.probability >= _LEAST_PRINTED
    ]


def describe_misfit(fused: FusedChange, causes: Sequence[PossibleCause]) -> str:
    """Misfit of the cells and its most probable cause, in words.

    Parameters
    ----------
    fused : FusedChange
        Of the cells.
    causes : sequence of PossibleCause
        Of the change, the most probable first.

    Returns
    -------
    str
        A sentence without full stop.
    """
    others = other_possible_causes(causes)
    likely = "no known cause does either"
    if others:
        likely = f"the likeliest cause is {others[0].text}"
        if others[0].name == "gradient":
            likely += "; if it stays after the same warm-up, it is uneven wear"
    return (
        f"no preload explains all cells: χ² is {fused.chi2:.1f} where {fused.degrees:.1f} is expected; "
        f"{likely}"
    )
