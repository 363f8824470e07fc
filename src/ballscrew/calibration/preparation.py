"""Input of a calibration, checked: runs, groups of one preload, anchors and forms of the model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import block_diag

from ballscrew.axis.axial import from_vector
from ballscrew.axis.axial_prior import form_error
from ballscrew.axis.sheet import DataSheet
from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError, MeasurementError, shown
from ballscrew.base.quantity import Quantity
from ballscrew.calibration.anchors import AnchorRow, anchor_covariance, anchor_rows
from ballscrew.calibration.assumptions import Assumptions
from ballscrew.calibration.bearing import bearing_share
from ballscrew.calibration.calibrated_axis import Doubt
from ballscrew.calibration.covariance import ExperimentVariation, relative_covariance, worn_nut_slopes
from ballscrew.calibration.fit import Problem
from ballscrew.calibration.frequency_table import FrequencyTable, frequency_table
from ballscrew.calibration.method import common_method
from ballscrew.calibration.model_forms import ModelForm, model_forms
from ballscrew.calibration.preload_groups import grouping_notes, preload_groups
from ballscrew.calibration.temperature import temperature_effects, warm_screw_doubts
from ballscrew.modal.run import Run

_MOST_RUNS = 200
# Largest relative error of the torque's scale: motors' torque constants are stated to within 10 %, the rest
# is a margin.
_SCALE = 0.15
_SIGMAS = 3.0  # standard uncertainties of a slope that are significant
_LOG_RATIO = 1.5  # prior standard deviation of ln(P/P_ref) of another preload: a factor of 4.5


@dataclass(frozen=True, slots=True, eq=False)
class CalibrationInput:
    """A calibration before it is fitted.

    Parameters
    ----------
    runs : tuple of FrequencyTable
        Runs with usable cells.
    groups : tuple of int
        Group of each run's preload.
    anchors : tuple of AnchorRow
        Known preloads, and the nut's softening under load.
    centre : float
        Position where the compliance is stated, m.
    forms : tuple of ModelForm
        Forms to compare; the sheet's own first.
    covariance : ndarray, shape (n, n)
        Of ln f of all n cells.
    reasons : tuple of Doubt
        Doubts of runs that were left out or are suspect, and of the loads, method and frame mode of all.
    notes : tuple of str
        Assumptions of the grouping.
    variation : ExperimentVariation
        Between experiments.
    temperature_error : ndarray, shape (n,)
        Effect on ln f by one standard deviation of the temperature's slope; ``covariance`` contains it.
    """

    runs: tuple[FrequencyTable, ...]
    groups: tuple[int, ...]
    anchors: tuple[AnchorRow, ...]
    centre: float
    forms: tuple[ModelForm, ...]
    covariance: Array
    reasons: tuple[Doubt, ...]
    notes: tuple[str, ...]
    variation: ExperimentVariation
    temperature_error: Array

    def problem(self, form: ModelForm) -> Problem:
        """Rows and prior of one form: the cells of all runs, one after the other, then the anchors."""
        counts = [len(run.frequency) for run in self.runs]
        mean = np.pad(form.mean, (0, max(self.groups)))
        log_frequency = np.log(np.concatenate([run.frequency for run in self.runs]))
        anchor_slopes = [anchor.slopes(len(mean)) for anchor in self.anchors]
        return Problem(
            centre=self.centre,
            position=np.concatenate([run.position for run in self.runs]),
            load=np.repeat([run.load for run in self.runs], counts).astype(float),
            group=np.repeat(np.asarray(self.groups, dtype=np.intp), counts),
            run=np.repeat(np.arange(len(self.runs), dtype=np.intp), counts),
            observed=np.concatenate([log_frequency, [anchor.log_preload for anchor in self.anchors]]),
            covariance=block_diag(self.covariance, anchor_covariance(self.anchors)),
            anchors=np.array(anchor_slopes).reshape(-1, len(mean)),
            mean=mean,
            prior=block_diag(form.covariance, _LOG_RATIO**2 * np.eye(max(self.groups))),
            worn_nut=worn_nut_slopes(self.runs, self.variation.assumptions),
        )


def prepare(
    runs: Sequence[Run], sheet: DataSheet, known: Mapping[str, Quantity], assumptions: Assumptions
) -> CalibrationInput:
    """Check the input of a calibration; parameters and errors as ``calibrate``."""
    _check_runs(runs, sheet, known)
    method = common_method(runs)
    tables, reasons = _usable_tables(runs)
    if method == "paper":
        text = (
            "runs by method paper: their frequencies are those of a nut under load, which corresponds to up "
            "to 10 % less preload, and the runs do not contain the accelerations of their plan; method joint "
            "corrects the load"
        )
        reasons.append(Doubt("method", text))
    with_frame = sum(run.frame_mode is not None for run in runs)
    if 0 < with_frame < len(runs):
        text = (
            "a mode of the machine's frame or of the pitching table was found in "
            f"{with_frame} of {len(runs)} runs: the frequencies of these are without its motion, those of "
            "the others are not"
        )
        reasons.append(Doubt("frame-mode", text))
    reasons += transmission_doubts(tables) + warm_screw_doubts(tables)
    _check_stops(runs, tables, sheet)
    positions = np.concatenate([table.position for table in tables])
    centre = float(positions.min() + positions.max()) / 2
    loads = [table.load for table in tables]
    forms = model_forms(sheet, centre, (min(loads) + max(loads)) / 2)
    ids, times = [table.id for table in tables], [table.measured_at for table in tables]
    groups = preload_groups(ids, times, known)
    model = from_vector(forms[0].mean, centre)
    variation = ExperimentVariation(bearing_share(sheet, model), assumptions)
    # Error of the lumped form that the sheet predicts for a distributed screw: bed and housings change its
    # size, so it is multiplied by 0 ± 1.
    cell_loads = np.repeat(loads, [len(table.frequency) for table in tables])
    form = form_error(sheet, centre, positions, cell_loads)
    by_slope, _ = temperature_effects(tables, groups, model)
    temperature_error = assumptions.temperature * by_slope
    covariance = relative_covariance(tables, groups, model, variation)
    return CalibrationInput(
        runs=tables,
        groups=groups,
        anchors=anchor_rows(tables, groups, known, sheet.table.mass),
        centre=centre,
        forms=forms,
        covariance=covariance + np.outer(form, form) + np.outer(temperature_error, temperature_error),
        reasons=tuple(reasons),
        notes=grouping_notes(ids, times, known),
        variation=variation,
        temperature_error=temperature_error,
    )


def _check_runs(runs: Sequence[Run], sheet: DataSheet, known: Mapping[str, Quantity]) -> None:
    """Refuse too few or too many runs, runs given twice or of another axis, and preloads of no run."""
    if not 1 <= len(runs) <= _MOST_RUNS:
        raise InputError(f"{len(runs)} runs were given; a calibration takes 1 to {_MOST_RUNS}.")
    ids: set[str] = set()
    for run in runs:
        if run.id in ids:
            raise InputError(f"{run.name} was given twice; each run counts once.")
        ids.add(run.id)
        if run.axis is not None and run.axis != sheet.name:
            raise InputError(
                f"{run.name} is of the axis {shown(run.axis)}; it must be of {shown(sheet.name)}, the "
                f"axis of {sheet.source}."
            )
    for key in known:
        if key not in ids:
            raise InputError(f"a known preload belongs to run {key[:12]}, which was not given.")


def _check_stops(runs: Sequence[Run], tables: Sequence[FrequencyTable], sheet: DataSheet) -> None:
    """Check that the stops of the runs with these tables are on the screw."""
    names = {run.id: run.name for run in runs}
    for table in tables:
        for position in table.position.tolist():
            sheet.check_position(position, "stop", names[table.id])


def _usable_tables(runs: Sequence[Run]) -> tuple[tuple[FrequencyTable, ...], list[Doubt]]:
    """Tables of the runs with usable frequencies, and doubts by the other runs and by suspect ones."""
    usable, omitted, suspect = [], [], []
    for table in map(frequency_table, runs):
        name = f"run {table.id[:12]}"
        if not len(table.frequency) or table.verdict == "bad":
            reason = next(iter(table.reasons), "it is bad")
            omitted.append(Doubt("omitted-run", f"{name} was left out: {reason}"))
            continue
        usable.append(table)
        if table.verdict == "suspect" and table.reasons:
            suspect.append(Doubt("suspect-run", f"{name} is suspect: {table.reasons[0]}"))
    if not usable:
        reasons = "; ".join(doubt.text for doubt in omitted[:1])
        raise MeasurementError(f"no run has a usable frequency: all cells were refused ({reasons}).")
    return tuple(usable), omitted + suspect


def transmission_doubts(tables: Sequence[FrequencyTable]) -> list[Doubt]:
    """Doubt of the transmission or of the loads, by the slope of the equivalent mass over the load.

    The slope should be 1. If the torque is that of the motor, a belt or gear of i motor turns per screw turn
    that the sheet does not state makes it 1/i, whatever the inertias are.

    Parameters
    ----------
    tables : sequence of FrequencyTable
        Runs with their loads and equivalent masses.

    Returns
    -------
    list of Doubt
        Empty for fewer than two loads with a mass, or where the slope is 1 within the error of the torque's
        scale.
    """
    known = [table for table in tables if table.equivalent_mass is not None]
    loads = np.array([table.load for table in known])
    if len(known) < 2 or not np.ptp(loads) > 0:
        return []
    masses = np.array([table.equivalent_mass.value for table in known if table.equivalent_mass])
    spreads = np.array(
        [table.equivalent_mass.standard_uncertainty for table in known if table.equivalent_mass]
    )
    from_mean = loads - loads.mean()
    weights = from_mean / float(from_mean @ from_mean)  # least squares: the slope is weights @ masses
    slope, spread = float(weights @ masses), float(np.linalg.norm(weights * spreads))
    if not abs(slope - 1) > max(_SCALE, _SIGMAS * spread):
        return []
    if slope <= _SIGMAS * spread:
        text = (
            f"each kilogram of declared load adds {slope:.2f} kg to the equivalent mass: are the loads of "
            "the runs exchanged, or was the load not on the table?"
        )
        return [Doubt("loads", text)]
    text = (
        f"each kilogram of load adds {slope:.2f} kg to the equivalent mass: is there a belt or gear of "
        f"{1 / slope:.2g} times the sheet's motor turns per screw turn (drive.ratio)? Else the loads or the "
        "scale of the torque are wrong"
    )
    return [Doubt("transmission", text)]
