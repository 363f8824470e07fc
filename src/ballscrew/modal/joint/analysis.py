"""Method ``joint`` for a run: from its recordings to the results of its cells, by one model of all cells."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import starmap

import numpy as np
import xarray as xr

from ballscrew.axis.frequency import predicted_frequency
from ballscrew.axis.model import motor_travel
from ballscrew.axis.sheet import DataSheet
from ballscrew.base.arrays import Array
from ballscrew.base.tables import table_rows
from ballscrew.fcft.expected import executed, least_excitation
from ballscrew.fcft.plan import Motion, Plan
from ballscrew.fcft.trace import SAMPLES_PER_PERIOD
from ballscrew.modal.cell import CellKey, CellResult, SharedError
from ballscrew.modal.joint.identify import identify_jointly
from ballscrew.modal.joint.result import METHOD, JointResult, RippleOrder
from ballscrew.modal.joint.settings import JointSettings, Response
from ballscrew.modal.joint.signals import TripSignals, complete_transients, trip_signals
from ballscrew.modal.reason import Reason
from ballscrew.modal.run import MotorRipple, RigidBodyResult
from ballscrew.recording.aligned import Aligned
from ballscrew.recording.measure import Measurement
from ballscrew.recording.rotation import RotationSums, rotating_modes

# Least spectrum of a jerk phase at the mode, over that of a sudden change of acceleration: a cell with less
# is suspect.
_LEAST_EXCITATION = 0.15
# The spectrum of a jerk phase has a null at a frequency if the phase lasts a whole number of periods of it.
# Up to this difference from a whole number, in periods, the null is given as the reason.
_NULL_WIDTH = 0.25
_LOST_END = Reason("no-mode", "or has an end of the screw, which is fixed at both ends, lost its pretension?")
_NOT_MEASURED = {"measurement", "low-rate"}  # kinds of reason to which _LOST_END is not added
_LARGEST_UNCERTAINTY = 0.5  # relative standard uncertainty above which a ripple torque is not reported


def signal_reducer(
    sheet: DataSheet | None, load: float, settings: JointSettings
) -> Callable[[Aligned], TripSignals]:
    """Return the function that reduces a recording to the channels of the estimator, at the rate it needs.

    Parameters
    ----------
    sheet : DataSheet or None
        Predicts the mode's frequency; without it the rate suffices for every mode that may be found.
    load : float
        Load on the table, kg.
    settings : JointSettings
        Settings of the method.

    Returns
    -------
    callable
        Argument ``extract`` of :func:`ballscrew.recording.measure.measure`.
    """
    rate = min(SAMPLES_PER_PERIOD, settings.rate) * settings.highest  # Hz
    if sheet is not None:
        # The frequency at position 0 is not lower than in the middle, for which the estimator decimates
        # again.
        rate = settings.rate * float(predicted_frequency(sheet, 0.0, load))

    def reduce(aligned: Aligned) -> TripSignals:
        """Decimate the channels of a recording; accelerometers at the motor are omitted."""
        nut = [row for row, name in enumerate(aligned.responses) if ":motor" not in name]
        return trip_signals(replace(aligned, response=aligned.response[nut]), rate)

    return reduce


def analyse_jointly(
    measurement: Measurement,
    cells: Sequence[CellResult],
    response_table: xr.Dataset | None,
    sheet: DataSheet | None,
    load: float,
    settings: JointSettings,
    response: Response,
) -> JointResult:
    """Identify all cells of a run jointly.

    Parameters
    ----------
    measurement : Measurement
        Recordings reduced to signals by :func:`signal_reducer`.
    cells : sequence of CellResult
        All cells of the run, as listed by the paper's method, whose frequencies are not used.
    response_table : Dataset or None
        The table *FrequencyResponse*, for the coherence at the estimated frequencies.
    sheet : DataSheet or None
        As for :func:`~ballscrew.modal.joint.identify.identify_jointly`.
    load : float
        Load on the table, kg.
    settings : JointSettings
        Settings of the method.
    response : {"nut", "motor", "both"}
        As for :func:`~ballscrew.modal.joint.identify.identify_jointly`.

    Returns
    -------
    JointResult
        Cells in the order of ``cells``.
    """
    listed = [replace(cell, method=METHOD) for cell in cells]
    if measurement.quality.verdict == "bad" or measurement.transients is None:
        return JointResult(tuple(listed))
    files = list(measurement.extracts)
    # Replace file numbers of the run by indices among the files that have signals.
    transients = [
        replace(transient, file=files.index(transient.file))
        for transient in complete_transients(measurement.transients)
        if transient.file in files
    ]
    settings = replace(settings, clock=_clock_uncertainty(measurement, settings))
    found = identify_jointly(_named_trips(measurement), transients, sheet, load, settings, response)
    results = {cell.key: cell for cell in found.cells}
    keys = [cell.key for cell in listed]
    coherences = _coherences(response_table)
    out = []
    for cell in listed:
        result = results.get(cell.key, cell)  # unchanged without a complete transient
        coherence = coherences.get(cell.key)
        # The coherence of a single repetition is always 1.
        if coherence is not None and result.frequency_Hz is not None and result.repetitions > 1:
            result = replace(result, coherence=float(np.interp(result.frequency_Hz, *coherence)))
        out.append(result)
    errors = _reordered(found.shared_errors, list(results), keys)
    if sheet is not None and sheet.support == "fixed-fixed":
        out = _with_lost_end(out)
    return replace(found, cells=tuple(out), shared_errors=errors)


def _clock_uncertainty(measurement: Measurement, settings: JointSettings) -> float:
    """Relative standard uncertainty of the clock: not less than its observed deviation from the plan."""
    if measurement.clock is None:
        return settings.clock
    return max(settings.clock, abs(measurement.clock.rate_error))


def _named_trips(measurement: Measurement) -> list[TripSignals]:
    """Signals of the usable recordings with their names."""
    extracts = measurement.extracts.items()
    return [replace(trip, name=measurement.files[index].name) for index, trip in extracts]


def _with_lost_end(cells: Sequence[CellResult]) -> list[CellResult]:
    """Cells of a screw that is fixed at both ends; if none has a frequency, with a further reason.

    An end without its pretension carries load in one direction only: the axis then has two stiffnesses in
    every period of a vibration, which is not a mode of the model. Cells whose measurement was refused have no
    further reason.
    """
    if any(cell.frequency_Hz is not None for cell in cells):
        return list(cells)
    out = []
    for cell in cells:
        if not _NOT_MEASURED & set(cell.reason_kinds):
            cell = cell.with_reasons(_LOST_END)
        out.append(cell)
    return out


def _reordered(
    errors: Sequence[SharedError], given: Sequence[CellKey], wanted: Sequence[CellKey]
) -> tuple[SharedError, ...]:
    """Shared errors with their effects in the order of other cells; 0 for cells without an effect.

    ``given`` are the cells in the order of the effects, ``wanted`` those in the order of the result.
    """
    out = []
    for error in errors:
        effects = dict(zip(given, error.effects_Hz, strict=True))
        out.append(replace(error, effects_Hz=tuple(effects.get(key, 0.0) for key in wanted)))
    return tuple(out)


def _coherences(table: xr.Dataset | None) -> dict[CellKey, tuple[Array, Array]]:
    """Frequency (Hz) and mean coherence of the responses, both of shape (frequencies,), for each cell."""
    if table is None:
        return {}
    frequency = table["frequency"].values
    keys = starmap(CellKey, table_rows(table, "position_m", "condition", "motion"))
    mean = table["coherence"].values.mean(axis=1)
    return {key: (frequency, row) for key, row in zip(keys, mean, strict=True)}


def suspect_unexcited(cells: Sequence[CellResult], plan: Plan | None) -> tuple[CellResult, ...]:
    """Make cells suspect if the torque hardly excites their frequency.

    If the mode nevertheless vibrates, another force excites it. Ripple of the motor is in the model, but
    forces of the guide, for example, are not. The fit attributes their effect to the torque, with an error
    that is not in the scatter of the cells.

    Parameters
    ----------
    cells : sequence of CellResult
        Cells of a run.
    plan : Plan or None
        Plan of the run; if None, the cells are returned unchanged.

    Returns
    -------
    tuple of CellResult
        Suspect, with the reason, where the spectrum of the test's jerk phases falls below 15 % within 5 % of
        the frequency, or within two standard uncertainties if that is more.
    """
    if plan is None:
        return tuple(cells)
    motions = {index: executed(plan, index) for index in range(len(plan.motions))}
    return tuple(_checked_excitation(cell, motions.get(cell.motion, ())) for cell in cells)


def suspect_rotating(
    cells: Sequence[CellResult], rotations: Sequence[Mapping[str, RotationSums]]
) -> tuple[CellResult, ...]:
    """Make cells suspect if the table rotates more at their frequency than it moves along the screw.

    Parameters
    ----------
    cells : sequence of CellResult
        Cells of a run.
    rotations : sequence of mapping
        For each recording of the run, the sums of pitch and yaw, by these names.

    Returns
    -------
    tuple of CellResult
        Suspect, with the reason, where the table rotates more.
    """
    rotating = rotating_modes(rotations, [cell.frequency_Hz for cell in cells])
    checked = []
    for cell, rotation in zip(cells, rotating, strict=True):
        if rotation is None:
            checked.append(cell)
            continue
        direction, ratio = rotation
        text = (
            f"by {direction} the ends of the table move {ratio:.2g} times as much across the screw as along "
            "it: the mode found may not be the axial one"
        )
        checked.append(replace(cell, verdict="suspect").with_reasons(Reason("frame", text)))
    return tuple(checked)


def suspect_delayed(cells: Sequence[CellResult]) -> tuple[CellResult, ...]:
    """Make all cells suspect, since their only response, the motor's motion, is delayed against the torque.

    The model contains a delay alone. A filter that smooths the speed delays it too, but also shifts the
    frequencies.

    Parameters
    ----------
    cells : sequence of CellResult
        Cells of a run.

    Returns
    -------
    tuple of CellResult
        With the reason; cells that were refused are still refused.
    """
    reason = Reason(
        "measurement",
        "the motor's motion is delayed against the torque, as where the drive smooths one of them: declare "
        "the filter by filtered_by in the channel map, or record unsmoothed signals",
    )
    checked = []
    for cell in cells:
        verdict = cell.verdict
        if verdict == "good":
            verdict = "suspect"
        checked.append(replace(cell, verdict=verdict).with_reasons(reason))
    return tuple(checked)


def _checked_excitation(cell: CellResult, motions: Sequence[Motion]) -> CellResult:
    """Cell, suspect if the jerk phases of its motion hardly excite its frequency.

    ``motions`` are the motions as each repetition executes them. The reason states the jerk time of the
    first, which is the nominal one.
    """
    f, u = cell.frequency_Hz, cell.standard_uncertainty_Hz
    if f is None or u is None or not motions:
        return cell
    excitation = float(np.min(least_excitation(np.array([f]), np.array([u]), motions)))
    if excitation >= _LEAST_EXCITATION:
        return cell
    jerk_ms = 1e3 * motions[0].jerk_time
    periods = f * jerk_ms / 1e3
    same_jerk = len({motion.jerk_time for motion in motions}) == 1  # nulls of different jerks do not coincide
    if same_jerk and abs(periods - round(periods)) < _NULL_WIDTH:
        text = (
            f"the jerk lasts {jerk_ms:.1f} ms, about a whole number of the mode's periods: the torque has a "
            "null there, and hardly excites it"
        )
    else:
        text = f"the jerk lasts {jerk_ms:.1f} ms, {periods:.1f} of the mode's periods: too soft to excite it"
    return replace(cell, verdict="suspect").with_reasons(Reason("unexcited", text))


def motor_ripple(
    ripple: Sequence[RippleOrder], body: RigidBodyResult, sheet: DataSheet | None
) -> tuple[MotorRipple, ...]:
    """Convert the ripple of the motor to torques.

    Parameters
    ----------
    ripple : sequence of RippleOrder
        Orders with amplitudes over the equivalent mass, m/s².
    body : RigidBodyResult
        Gives the equivalent mass.
    sheet : DataSheet or None
        Gives the travel per turn of the motor.

    Returns
    -------
    tuple of MotorRipple
        Torques in N m; None if their uncertainty is too large, or if mass or lead are not known.
    """
    mass = body.equivalent_mass_kg
    out = [MotorRipple(fitted.order, None, None) for fitted in ripple]
    if mass is None or sheet is None:
        return tuple(out)
    torque_per_acceleration = mass * motor_travel(sheet)
    mass_uncertainty = body.standard_uncertainty["equivalent_mass_kg"] / mass  # relative
    for i, fitted in enumerate(ripple):
        a, u = fitted.amplitude, fitted.uncertainty
        if a is not None and u is not None and u <= _LARGEST_UNCERTAINTY * a:
            torque = torque_per_acceleration * a
            out[i] = MotorRipple(fitted.order, torque, torque * math.hypot(u / a, mass_uncertainty))
    return tuple(out)
