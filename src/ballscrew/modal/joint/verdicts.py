"""Results of all cells of a run from its final fit: verdicts with reasons, uncertainties, shared errors."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ballscrew.axis.hertz import RELEASE
from ballscrew.modal.cell import CellKey, CellResult, SharedError, TransientRow
from ballscrew.modal.joint.blocks import ROTOR_HELD
from ballscrew.modal.joint.fit import JointFit
from ballscrew.modal.joint.frame import is_far_above
from ballscrew.modal.joint.frequencies import CellFrequencies, estimate_frequencies, unexplained_power
from ballscrew.modal.joint.mode import damping_ratio, mode_frequency
from ballscrew.modal.joint.result import METHOD, JointResult, RippleOrder
from ballscrew.modal.joint.search import AMBIGUOUS_LOAD_RATIO, SearchResult
from ballscrew.modal.joint.settings import JointSettings
from ballscrew.modal.joint.trips import trips_differ
from ballscrew.modal.joint.uncertainty import (
    cell_deviations,
    mass_over_preload,
    parameter_deviation,
    response_difference,
)
from ballscrew.modal.reason import Reason, ReasonKind, large_uncertainty
from ballscrew.modal.run import FrameMode

# A cell is suspect above these.
_SUSPECT_UNCERTAINTY = 0.003  # standard uncertainty over the frequency
_SUSPECT_LOAD = 2.0  # load on the nut over its preload

# A cell with fewer repetitions is suspect: errors common to all cells of a repetition are not in the scatter.
_REPETITIONS = 3
# Limits of the damping ratio of an axial mode.
_LEAST_DAMPING = 0.004
_MOST_DAMPING = 0.25
# Limits of the mode's frequency at both ends of the axis.
_EDGE_LOW = 1.05  # over the lower limit of the band
_EDGE_HIGH = 0.8  # over the upper limit of the band

# A force at the motor that was not measured, or a disturbed torque signal: much of the nut's response is
# unexplained by the torque, and nearly all of it is explained by the motor's own motion. Parts of the power
# of the response:
_UNEXPLAINED = 0.1  # part unexplained by the torque from which on all cells are suspect
_BY_MOTION_TOO = 0.1  # largest part unexplained by the motor's motion, over that unexplained by the torque
_MOST_UNEXPLAINED = 0.3  # part unexplained by the torque above which all cells are refused
# Damping ratio below which, with such a force, the mode may be a tone of the motor: all cells are refused.
_TONE_DAMPING = 0.015
# Power of the response to ripple over that to the torque, from which on all cells are suspect.
_MOST_RIPPLE = 1.0

# All cells are suspect if, at a stop, the frequency by the motor's response differs from that by the nut's by
# more than each of these. The first ratio is 2.6 at most on the bench, on 33 good random axes and on twelve
# of them at 0.6 of their preload. On another axis it is 2.8, and the true values lie outside the intervals in
# 18 of 40 cells. With both sensors loose, their mounts at 1.2 to 1.4 times the axial mode, it is 2.7 to 4.8
# in the five runs (of 22, on ten axes and the bench) in which the true values would lie outside the intervals
# of good cells, and the second ratio is 3.6 at least.
_DIFFERENCE = 2.75  # over the standard uncertainty of the result
_CLEAR_DIFFERENCE = 3.0  # over the standard uncertainty of the difference
# Over the frequency times the square root of the part of the motor's power that is not explained. On ten axes
# of four trips this ratio is 0.009 at most on the small ones, where ripple is as strong as the torque; with
# loose sensors (the mounts at 1.2, 1.3 and 1.4 times the mode), 0.024 at least in the 11 runs of 27 that
# exceed the other two. On 14 further axes, too, it is 0.024 at least in the 22 such runs of 41, and no run
# without loose sensors exceeds any of the three.
_UNEXPLAINED_DIFFERENCE = 0.012

_ONCE = Reason(
    "few-repetitions",
    "it was measured once: chance effects common to all cells cannot be separated from the axis",
)
_TWICE = Reason(
    "few-repetitions",
    "it was measured twice: chance effects common to both cannot be separated from the axis",
)
_NOT_AVERAGED = Reason(
    "measurement", "its transients cannot be averaged: they are cut off, too short or unlike each other"
)
_MOVED_BY_RIPPLE = Reason(
    "ripple", "forces of motor ripple or passing balls move the axis more than the torque does"
)


def refused_run(
    transients: Sequence[TransientRow], reason: Reason, ripple: Sequence[RippleOrder] = ()
) -> JointResult:
    """Refuse every cell of a run for one reason.

    Parameters
    ----------
    transients : sequence of TransientRow
        Transients of the run.
    reason : Reason
        Why all cells are refused.
    ripple : sequence of RippleOrder
        Orders that were found; their amplitudes are not reported.

    Returns
    -------
    JointResult
        All cells of the transients, without frequencies.
    """
    counts = Counter(transient.key for transient in transients)
    cells = tuple(CellResult.refused(key, counts[key], METHOD, (reason,)) for key in sorted(counts))
    orders = tuple(replace(order, amplitude=None, uncertainty=None) for order in ripple)
    return JointResult(cells, (reason,), ripple=orders)


def joint_result(
    found: SearchResult,
    transients: Sequence[TransientRow],
    settings: JointSettings,
    rounding: float = 0.0,
) -> JointResult:
    """Report every cell of a run, with its frequency and uncertainty or the reason for its refusal.

    Parameters
    ----------
    found : SearchResult
        The final fit.
    transients : sequence of TransientRow
        Transients of the run.
    settings : JointSettings
        Settings of the method.
    rounding : float
        Power spectral density of the rounding error of the force over the total inertia, (m/s²)²/Hz.

    Returns
    -------
    JointResult
        All cells of the transients.
    """
    refusal = _run_refusal(found, settings)
    differing = trips_differ(found.trips)
    if refusal is not None:
        return refused_run(transients, differing or refusal, found.ripple)
    fit, w = found.fit, found.fit.blocks[0].windows
    frequencies = estimate_frequencies(found, settings, rounding)
    relative_uncertainty = frequencies.uncertainty / frequencies.rotor_free
    uncertain = relative_uncertainty > settings.most_uncertainty
    overloaded = frequencies.nut_load > settings.most_load
    refused = uncertain | overloaded
    if np.mean(refused) > 0.5:
        refusal = differing or _reason_of_worst_cell(frequencies, settings)
        result = refused_run(transients, refusal, found.ripple)
        loads = dict(zip(w.cells, frequencies.nut_load.tolist(), strict=True))
        cells = [replace(cell, nut_load_over_preload=loads.get(cell.key)) for cell in result.cells]
        return replace(result, cells=tuple(cells))
    not_averaged = refused_run(transients, _NOT_AVERAGED).cells
    results = {cell.key: cell for cell in not_averaged}
    results.update(_cell_results(found, frequencies, refused, settings))
    order = sorted(results)
    accepted = {w.cells[i]: i for i in np.flatnonzero(~refused).tolist()}
    band = (w.band.low, w.band.high)
    return JointResult(
        tuple(replace(results[key], band_Hz=band) for key in order),
        shared_errors=_shared_errors(frequencies, order, accepted),
        mass_over_preload=mass_over_preload(
            fit,
            found.profile.load_information(found.variation.prior_inflation),
            found.profile.mass_over_preload,
        ),
        ripple=found.ripple,
        frame_mode=_frame_mode(found),
    )


def _frame_mode(found: SearchResult) -> FrameMode | None:
    """Mode of the frame that was fitted with the axial one; None if none was."""
    if found.frame is None:
        return None
    fit, mode = found.fit, found.fit.modes[0]
    relative_deviation = parameter_deviation(fit, fit.parameters.index(("frame", None)))
    mass_ratio = None  # without the rotor-held mode, the factor ``rotor_part`` of the coupling is not known
    if any(b.mode_index == ROTOR_HELD for b in fit.blocks) and not found.frame.pitching:
        mass_ratio = 1 / mode.coupling
    # The log residual is a sum over the blocks: geometric mean of the ratios of their rms residuals.
    residual_ratio = math.exp(-found.frame.reduction / len(found.frame.modes))
    return FrameMode(
        mode.frame,
        mode.frame * relative_deviation,
        mode.frame_damping,
        mass_ratio,
        residual_ratio,
        found.frame.distinct,
        found.frame.pitching,
    )


def _cell_results(
    found: SearchResult, frequencies: CellFrequencies, refused: NDArray[np.bool_], settings: JointSettings
) -> dict[CellKey, CellResult]:
    """Results of the cells that have a window; ``refused``, shape (cells,), are those that are refused."""
    fit = found.fit
    w, mode = fit.blocks[0].windows, fit.modes[0]
    # Deviation from the smooth profile: that from the fitted profile, and the effect of local wear in the
    # latter.
    deviation, deviation_uncertainty = cell_deviations(fit, 0)
    smooth = replace(mode, stops=(), local=())
    deviation = deviation + mode_frequency(mode, w.stops) - mode_frequency(smooth, w.stops)
    damping = damping_ratio(mode, frequencies.rotor_free)
    run_reasons = _run_reasons(found, frequencies)
    out = {}
    for i, key in enumerate(w.cells):
        repetitions = len(w.pieces[i])
        reasons = _cell_reasons(frequencies, i, settings)
        if repetitions < _REPETITIONS:
            reasons.append(_ONCE if repetitions == 1 else _TWICE)
        reasons += run_reasons
        values: dict[str, Any] = {"nut_load_over_preload": float(frequencies.nut_load[i])}
        if not refused[i]:
            values["verdict"] = "suspect" if reasons else "good"
            values["frequency_Hz"] = float(frequencies.rotor_free[i])
            values["standard_uncertainty_Hz"] = float(frequencies.uncertainty[i])
            values["damping_ratio"] = float(damping[i])
            if np.isfinite(frequencies.rotor_held_uncertainty[i]):
                values["rotor_held_frequency_Hz"] = float(frequencies.rotor_held[i])
                values["rotor_held_standard_uncertainty_Hz"] = float(frequencies.rotor_held_uncertainty[i])
            # In most runs a departure against the arrival has no data: the fit begins with the sliding.
            if not w.reversing[i]:
                values["deviation_Hz"] = float(deviation[i])
                values["deviation_standard_uncertainty_Hz"] = float(deviation_uncertainty[i])
        terms = {term.name: float(term.standard_uncertainty[i]) for term in frequencies.terms}
        refusal = CellResult.refused(key, repetitions, METHOD, reasons)
        out[key] = replace(refusal, uncertainty_terms_Hz=terms, **values)
    return out


def _shared_errors(
    frequencies: CellFrequencies, order: Sequence[CellKey], accepted: dict[CellKey, int]
) -> tuple[SharedError, ...]:
    """Effects (Hz) of every independent cause on the cells in the given order; 0 for cells that are refused.

    ``accepted`` is the index of each accepted cell among those with a window.
    """
    rows = [order.index(key) for key in accepted]
    out = []
    for term in frequencies.terms:
        effects = np.zeros((len(term.effects), len(order)))
        effects[:, rows] = term.effects[:, list(accepted.values())]
        out += [SharedError(term.name, term.repeats, tuple(row)) for row in effects.tolist()]
    return tuple(out)


def _cell_reasons(frequencies: CellFrequencies, cell: int, settings: JointSettings) -> list[Reason]:
    """Reasons for a cell, given by its index, to be suspect or refused; the load on the nut comes first."""
    load, u = float(frequencies.nut_load[cell]), float(frequencies.uncertainty[cell])
    f = float(frequencies.rotor_free[cell])
    reasons = []
    if load > min(_SUSPECT_LOAD, settings.most_load):
        kind: ReasonKind = "nearly-unloaded"
        effect, measure = "nearly unloads", ""
        if load > RELEASE:
            kind, effect, measure = "unloaded", "unloads", "; test with a lower acceleration"
        text = f"the test's own load {effect} the nut: it is {load:.1f} times the remaining preload{measure}"
        reasons.append(Reason(kind, text))
    if u > settings.most_uncertainty * f:
        reasons.append(large_uncertainty(u, settings.most_uncertainty))
    elif u > _SUSPECT_UNCERTAINTY * f:
        reasons.append(large_uncertainty(u, _SUSPECT_UNCERTAINTY))
    return reasons


def _reason_of_worst_cell(frequencies: CellFrequencies, settings: JointSettings) -> Reason:
    """Reason to refuse the cell that exceeds a limit by the largest factor."""
    by_load = frequencies.nut_load / settings.most_load
    by_uncertainty = frequencies.uncertainty / frequencies.rotor_free / settings.most_uncertainty
    worst = int(np.argmax(np.maximum(by_load, by_uncertainty)))
    reasons = _cell_reasons(frequencies, worst, settings)
    if by_load[worst] >= by_uncertainty[worst]:
        return reasons[0]  # that of the load
    return reasons[-1]  # that of the uncertainty


def _run_reasons(found: SearchResult, frequencies: CellFrequencies) -> list[Reason]:
    """Reasons for all cells of a run to be suspect."""
    fit = found.unwhitened
    possible = (
        _uncertain_frame(found),
        trips_differ(found.trips),
        _unmeasured_force(fit),
        _ambiguous_load(found, frequencies),
        _responses_differ(found.fit, frequencies),
    )
    out = [reason for reason in possible if reason is not None]
    if _moved_by_ripple(fit):
        out.append(_MOVED_BY_RIPPLE)
    return out


def _uncertain_frame(found: SearchResult) -> Reason | None:
    """The reason, if the frame's mode may be that of the axis, or is far above it."""
    if found.frame is None:
        return None
    mode = found.fit.modes[0]
    named = f"the machine's frame has a mode near {mode.frame:.0f} Hz"
    if found.frame.pitching:
        named = f"the table pitches near {mode.frame:.0f} Hz"
    if not found.frame.distinct:
        text = (
            f"{named}, and it is uncertain which of the two modes is that of the axis: "
            "test stops farther from each other, or another load"
        )
        return Reason("frame", text)
    if is_far_above(mode) and not found.frame.pitching:
        text = f"{named}, far above that of the axis: the frequencies of the axis may be wrong by up to 1 %"
        return Reason("frame", text)
    return None


def _ambiguous_load(found: SearchResult, frequencies: CellFrequencies) -> Reason | None:
    """The reason, if the expected load unloads the nut, and is much larger than the fitted one.

    The load is expected from data sheet and frequency. A nut softens until the load unloads it and stiffens
    beyond, so two ratios of load to preload can explain the responses about equally well. If the fit found
    the wrong ratio, the frequencies of all cells have errors, since they lie on the same curve. The loads of
    ``frequencies`` were raised to the data sheet's lower limit where they were lower; this is undone here.
    """
    fitted, highest = found.fit.modes[0].mass_over_preload, float(frequencies.nut_load.max())
    if not fitted > 0:
        return None
    ratio = found.profile.mass_over_preload / fitted
    highest /= max(1.0, found.profile.least_mass_over_preload / fitted)
    if ratio < AMBIGUOUS_LOAD_RATIO or ratio * highest <= RELEASE:
        return None
    text = (
        f"the test's load is at most {highest:.1f} times the preload from the run, but {ratio * highest:.1f} "
        "times from data sheet and frequency, and may unload the nut: test with a lower acceleration"
    )
    return Reason("unloaded", text)


def _responses_differ(fit: JointFit, frequencies: CellFrequencies) -> Reason | None:
    """The reason, if the frequencies by motor and nut differ by more than their uncertainties explain."""
    compared = response_difference(fit)
    if compared is None:
        return None
    difference, deviation = compared
    limit = np.maximum(_DIFFERENCE * frequencies.uncertainty, _CLEAR_DIFFERENCE * deviation)
    (motor,) = (p for b, p in zip(fit.blocks, fit.projections, strict=True) if b.name == "torque-motor")
    by_model = _UNEXPLAINED_DIFFERENCE * math.sqrt(motor.unexplained) * frequencies.rotor_free
    limit = np.maximum(limit, by_model)
    worst = int(np.argmax(np.abs(difference) / limit))
    if not abs(difference[worst]) > limit[worst]:
        return None
    to_percent = 100 / frequencies.rotor_free[worst]
    text = (
        f"the frequencies from the motor's and the nut's response differ by up to "
        f"{to_percent * difference[worst]:+.2f} ± {to_percent * deviation[worst]:.2f} %: is a sensor loose, "
        "or the torque filtered?"
    )
    return Reason("responses-differ", text)


def _moved_by_ripple(fit: JointFit) -> bool:
    """True if ripple and passing balls move the axis more than the torque does."""
    # The last columns are the ripple in the band, then the response of the mode to it.
    projection, count = fit.projections[0], 2 * fit.blocks[0].ripple.shape[1]
    if count == 0:
        return False
    by_ripple = float(np.sum((projection.columns[:, -count:] @ projection.weights[-count:]) ** 2))
    by_torque = float(np.sum((projection.columns[:, :-count] @ projection.weights[:-count]) ** 2))
    return by_ripple >= _MOST_RIPPLE * by_torque


def _unmeasured_force(fit: JointFit) -> Reason | None:
    """The reason, if the nut follows the motor's motion but not the torque."""
    unexplained = unexplained_power(fit)
    torque, motion = unexplained.get("torque-nut", 0.0), unexplained.get("motor-nut", math.inf)
    if torque < _UNEXPLAINED or motion > _BY_MOTION_TOO * torque:
        return None
    text = (
        f"the torque leaves {100 * torque:.0f} % of the nut's response unexplained, the motor's own motion "
        f"{100 * motion:.1f} %: a force at the motor was not measured, or the torque signal contains a "
        "disturbance"
    )
    return Reason("unmeasured-force", text)


def _run_refusal(found: SearchResult, settings: JointSettings) -> Reason | None:
    """The reason to refuse all cells of a run; None if there is none."""
    fit = found.fit
    mode, w = fit.modes[0], fit.blocks[0].windows
    unexplained = fit.projections[0].unexplained
    if not math.isfinite(unexplained):
        return Reason("no-mode", "a mode along the axis explains only 0 % of the response in the band")
    if unexplained > settings.most_unexplained:
        share = 100 * (1 - min(unexplained, 1))
        return Reason(
            "no-mode", f"a mode along the axis explains only {share:.0f} % of the response in the band"
        )
    ends = mode_frequency(mode, np.array([w.centred_position.min(), w.centred_position.max()]))
    if not (ends > _EDGE_LOW * w.band.low).all() or not (ends < _EDGE_HIGH * w.band.high).all():
        text = f"the mode found, {ends.min():.0f} to {ends.max():.0f} Hz, lies at the edge of the search band"
        return Reason("no-mode", text)
    if mode.damping > _MOST_DAMPING:
        text = f"the mode found has a damping ratio of {mode.damping:.2f}: too high for a resonance"
        return Reason("no-mode", text)
    unmeasured_force = _unmeasured_force(found.unwhitened)
    largely = found.unwhitened.projections[0].unexplained > _MOST_UNEXPLAINED
    if unmeasured_force is not None and (largely or mode.damping < _TONE_DAMPING):
        return unmeasured_force
    if mode.damping < _LEAST_DAMPING:
        text = (
            f"the mode found has a damping ratio of {mode.damping:.4f}: it is a periodic force, such as "
            "the motor's ripple, and not a mode of the axis"
        )
        return Reason("tone", text)
    return None
