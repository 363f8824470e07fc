"""What a calibration is given, checked: its runs, groups, anchors and forms."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from ballscrew.axis.axial import from_vector
from ballscrew.axis.sheet import DataSheet
from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError, MeasurementError, shown
from ballscrew.base.quantity import Quantity
from ballscrew.calibration.anchors import Row, anchor_rows
from ballscrew.calibration.assumptions import Assumptions
from ballscrew.calibration.bearing import bearing_share
from ballscrew.calibration.between import Between
from ballscrew.calibration.fit import Problem
from ballscrew.calibration.frequency_table import REPEATS, FrequencyTable, frequency_table
from ballscrew.calibration.method import common_method
from ballscrew.calibration.model_forms import ModelForm, model_forms
from ballscrew.calibration.preload_groups import groups, said_of_groups
from ballscrew.calibration.rows import problem, relative_covariance
from ballscrew.modal.run import Run

__all__ = ["NOTHING", "Prepared", "prepare"]


NOTHING: Mapping[str, Quantity] = MappingProxyType({})
"""No known preload."""

_MOST_RUNS = 200


@dataclass(frozen=True, slots=True, eq=False)
class Prepared:
    """A calibration before it is fitted.

    Parameters
    ----------
    runs : tuple of FrequencyTable
        Those that have cells.
    groups : tuple of int
        Of each its preload.
    rows : tuple of Row
        Anchors.
    centre : float
        m.
    forms : tuple of ModelForm
        Candidates, the sheet's own first.
    covariance : ndarray
        Of ln f.
    reasons : tuple of str
        What was left out.
    between : Between
        What is taken for granted between experiments.
    """

    runs: tuple[FrequencyTable, ...]
    groups: tuple[int, ...]
    rows: tuple[Row, ...]
    centre: float
    forms: tuple[ModelForm, ...]
    covariance: Array
    reasons: tuple[str, ...]
    between: Between

    def problem(self, form: ModelForm) -> Problem:
        """Rows and prior of one form."""
        return problem(
            self.runs,
            self.groups,
            self.rows,
            (form.mean, form.covariance),
            self.centre,
            self.covariance,
            self.between,
        )


def prepare(
    runs: Sequence[Run],
    sheet: DataSheet,
    *,
    known: Mapping[str, Quantity] = NOTHING,
    correlation: float = REPEATS,
    centre: float | None = None,
    assumptions: Assumptions | None = None,
) -> Prepared:
    """Check what a calibration is given, and make rows of it; parameters and errors as ``calibrate``."""
    if not 1 <= len(runs) <= _MOST_RUNS:
        raise InputError(f"{len(runs)} runs were given; a calibration takes 1 to {_MOST_RUNS}.")
    for index, run in enumerate(runs):
        if run.id in {other.id for other in runs[:index]}:
            raise InputError(f"run {run.id[:12]} was given twice; each run counts once.")
        if run.axis is not None and run.axis != sheet.name:
            raise InputError(
                f"run {run.id[:12]} is of the axis {shown(run.axis)}; it must be of {shown(sheet.name)}, the "
                f"axis of {sheet.source}."
            )
    for key in known:
        if key not in {run.id for run in runs}:
            raise InputError(f"a known preload belongs to run {key[:12]}, which was not given.")
    method = common_method(runs)
    seen = [frequency_table(run) for run in runs]
    used = tuple(one for one in seen if len(one.frequency) and one.verdict != "bad")
    reasons = [
        f"run {one.id[:12]} was left out: {(one.reasons or ('it is bad',))[0]}"
        for one in seen if one not in used
    ]  # fmt: skip
    if not used:
        raise MeasurementError("no run has a frequency that can be used: all cells were refused.")
    reasons += [
        f"run {one.id[:12]} is suspect: {one.reasons[0]}"
        for one in used
        if one.verdict == "suspect" and one.reasons
    ]
    if method == "paper":
        reasons.append(
            "runs by method paper: their frequencies are of a nut under load, which reads as up to 10 % less "
            "preload, and no run tells the accelerations of its plan; method joint corrects it"
        )
    positions, loads = np.concatenate([one.position for one in used]), [one.load for one in used]
    low, high = -sheet.screw.bearing_to_zero, sheet.travel_limit
    for place in positions[(positions < low) | (positions > high)][:1]:
        raise InputError(
            f"a run has a stop at {place:g} m; it must lie between {low:g} and {high:g} m, on the screw of "
            f"{sheet.source}."
        )
    middle = float(positions.min() + positions.max()) / 2 if centre is None else centre
    candidates = model_forms(sheet, middle, (min(loads) + max(loads)) / 2)
    ids, times = [one.id for one in used], [one.measured_at for one in used]
    share = groups(ids, times, known)
    model = from_vector(candidates[0].mean, middle)
    between = Between(bearing_share(sheet, model), assumptions or Assumptions())
    return Prepared(
        runs=used,
        groups=share,
        rows=anchor_rows(used, share, known, sheet.table.mass),
        centre=middle,
        forms=candidates,
        covariance=relative_covariance(used, share, model, correlation, between),
        reasons=(*reasons, *said_of_groups(ids, times, known)),
        between=between,
    )
