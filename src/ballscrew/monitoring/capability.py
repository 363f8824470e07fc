"""The smallest loss of preload that an axis can show, before the first alarm can ever come."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ballscrew.axis import axial
from ballscrew.axis.axial import AxialModel, from_vector
from ballscrew.axis.axial_prior import prior
from ballscrew.axis.sheet import DataSheet, read_axis
from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError, shown
from ballscrew.base.jsonfile import SCHEMA
from ballscrew.base.provenance import Made, digest
from ballscrew.base.quantity import NORMAL_95
from ballscrew.base.threads import single_threaded
from ballscrew.calibration.bearing import single_run_note
from ballscrew.calibration.calibrated_axis import CalibratedAxis
from ballscrew.fcft.cells import cells
from ballscrew.fcft.expected import executed
from ballscrew.fcft.nutload import RELEASE, hardest, nut_load
from ballscrew.fcft.plan import Plan, read_plan, validate_plan
from ballscrew.fcft.scatter import DOUBT, Scatter, default_scatter
from ballscrew.modal.run import Run
from ballscrew.monitoring.baseline_scatter import RunScatter, baseline_scatter, load_of, seen_cells
from ballscrew.monitoring.smallest_loss import MOST_LOSS, log_odds_variance, needed_shift, smallest_loss

__all__ = [
    "AFTER",
    "BASELINE",
    "FALSE_ALARM",
    "POWER",
    "Capability",
    "SmallestLoss",
    "capability",
    "known_axis",
]


FALSE_ALARM = 1e-3
"""Chance that a test of an axis that lost nothing calls a loss: every third day, once in eight years."""
POWER = 0.9
"""Chance that the smallest loss is called."""
AFTER = (1, 3, 10)
"""Runs after which it is told."""
BASELINE = 5
"""Runs of a baseline that is not measured yet."""


@dataclass(frozen=True, slots=True)
class SmallestLoss:
    """What can be shown after some runs with one load.

    Parameters
    ----------
    load_kg : float
        On the table.
    runs : int
        Since the loss, their mean held against the baseline's.
    loss : float or None
        Part of the preload that must be gone; None where not even 99 % is seen.
    interval95 : tuple of float or None
        Of it, by what is not known of the axis: above all the nut's share of the compliance.
    change_Hz : float
        By how much the frequency in the middle of the stops is lower then.
    """

    load_kg: float
    runs: int
    loss: float | None
    interval95: tuple[float, float] | None
    change_Hz: float  # noqa: N815  the unit's own letters


@dataclass(frozen=True, slots=True)
class Capability:
    """The smallest loss of preload that an axis can show.

    Parameters
    ----------
    smallest : tuple of SmallestLoss
        By load, then number of runs.
    false_alarm, power : float
        Chances, see :data:`FALSE_ALARM` and :data:`POWER`.
    baseline_runs : int
        Measured, or thought of.
    scatter : tuple of RunScatter
        What one run scatters by, of each load.
    share, share_standard_uncertainty : float
        The nut's part of the compliance, in the middle of the stops.
    known_from : str
        ``"data sheet"`` or ``"model"``.
    notes : tuple of str
        What must be known with it.
    made : Made
        Settings and inputs.
    """

    smallest: tuple[SmallestLoss, ...]
    false_alarm: float
    power: float
    baseline_runs: int
    scatter: tuple[RunScatter, ...]
    share: float
    share_standard_uncertainty: float
    known_from: str
    notes: tuple[str, ...]
    made: Made

    def to_json(self) -> dict[str, Any]:
        """As JSON, with the schema's version."""
        return {"schema": SCHEMA, **asdict(self)}


@single_threaded
def capability(
    plan: str | Path | Plan,
    *,
    axis: str | Path | DataSheet,
    model: str | Path | CalibratedAxis | None = None,
    baseline: Sequence[str | Path | Run] = (),
    after: Sequence[int] = AFTER,
    false_alarm: float = FALSE_ALARM,
    power: float = POWER,
    baseline_runs: int = BASELINE,
    scatter: Scatter | None = None,
) -> Capability:
    """Smallest loss of preload that an axis can show at a stated rate of false alarms.

    The cells of a run are fused by generalised least squares into one number, the level of ln P. The mean of
    the last n runs is held against the mean of b baseline runs, one-sided; run-to-run scatter is estimated,
    not known, so the limit is Student's and the power that of the noncentral t (Johnson, Kotz and
    Balakrishnan 1995, ch. 31). What repeats from run to run cancels.

    Parameters
    ----------
    plan : path-like or Plan
        The test.
    axis : path-like or DataSheet
        The axis.
    model : path-like or CalibratedAxis, optional
        MODEL.json; by default the data sheet with its tolerances.
    baseline : sequence of path-like or Run
        Runs of the new axis with one load, RUN.json; without them scatter is the default of that size.
    after : sequence of int
        Numbers of runs after which it is told.
    false_alarm, power : float
        Chances.
    baseline_runs : int
        How many the baseline will have, where none is given.
    scatter : Scatter, optional
        In place of the default of that size.

    Returns
    -------
    Capability
        By load and number of runs.

    Raises
    ------
    InputError
        If a file is wrong, the model or a run is of another axis, runs differ in load or share too few cells,
        or a chance is none.
    """
    sheet = axis if isinstance(axis, DataSheet) else read_axis(axis)
    test = plan if isinstance(plan, Plan) else read_plan(plan)
    validate_plan(test, sheet)
    _check(after, false_alarm, power, baseline_runs)
    middle = (test.positions[0] + test.positions[-1]) / 2
    known, covariance, origin = known_axis(model, sheet, middle)
    taken = default_scatter(sheet) if scatter is None else scatter
    runs = [run if isinstance(run, Run) else Run.read(run) for run in baseline]
    loads = (load_of(runs, sheet),) if runs else test.masses
    count = len(runs) or baseline_runs
    found: list[SmallestLoss] = []
    scatters: list[RunScatter] = []
    for load in loads:
        places = seen_cells(runs) if runs else np.array([c.position for c in cells(test) if c.mass == load])
        one = baseline_scatter(runs, places, load, known, taken, test.repetitions)
        scatters.append(one)
        for n in after:
            shift = (
                needed_shift(one.degrees, false_alarm, power) * one.log_ratio * math.sqrt(1 / n + 1 / count)
            )
            found.append(_smallest(load, n, shift, one, known, covariance, places))
    share, spread = _share(known, covariance, middle)
    return Capability(
        smallest=tuple(found),
        false_alarm=false_alarm,
        power=power,
        baseline_runs=count,
        scatter=tuple(scatters),
        share=share,
        share_standard_uncertainty=spread,
        known_from=origin,
        notes=(single_run_note(sheet, known, share), *_notes(test, sheet, found, scatters, runs)),
        made=Made(
            settings={"false_alarm": false_alarm, "power": power, "after": list(after), **asdict(taken)},
            inputs={"axis": digest(sheet.to_settings()), "plan": digest(test.to_settings())},
        ),
    )


def _check(after: Sequence[int], false_alarm: float, power: float, baseline_runs: int) -> None:
    if not after or not all(isinstance(n, int) and 1 <= n <= 10_000 for n in after):
        raise InputError(f"runs {tuple(after)} were given; each must be a whole number from 1 to 10000.")
    if not 1e-9 <= false_alarm < power <= 0.9999:
        raise InputError(
            f"a false alarm rate of {false_alarm:g} and a power of {power:g} were given; the first must be "
            "1e-9 or more, the second 0.9999 or less and more than the first."
        )
    if not 1 <= baseline_runs <= 10_000:
        raise InputError(f"a baseline of {baseline_runs} runs was given; it must be from 1 to 10000.")


def known_axis(
    model: str | Path | CalibratedAxis | None, sheet: DataSheet, middle: float
) -> tuple[AxialModel, Array, str]:
    """Take the axis as it is known best.

    Parameters
    ----------
    model : path-like or CalibratedAxis or None
        MODEL.json; None for the data sheet with its tolerances.
    sheet : DataSheet
        The axis.
    middle : float
        Where the data sheet's compliance is stated, m.

    Returns
    -------
    model : AxialModel
        The axis.
    covariance : ndarray, shape (7, 7)
        Of its working vector.
    known_from : str
        ``"data sheet"`` or ``"model"``.

    Raises
    ------
    InputError
        If the file is wrong, or the model of another axis.
    """
    if model is None:
        mean, covariance = prior(sheet, middle)
        return from_vector(mean, middle), covariance, "data sheet"
    calibrated, source = (model, "the model") if isinstance(model, CalibratedAxis) else _read(Path(model))
    if calibrated.axis != sheet.name:
        raise InputError(
            f"{source}: is the model of the axis {shown(calibrated.axis)}; {sheet.source} is that of "
            f"{shown(sheet.name)}."
        )
    return calibrated.model, np.asarray(calibrated.covariance, dtype=np.float64), "model"


def _read(path: Path) -> tuple[CalibratedAxis, str]:
    from ballscrew.calibration.modelfile import read_model

    return read_model(path), path.name


def _smallest(
    load: float, runs: int, shift: float, one: RunScatter, model: AxialModel, covariance: Array, x: Array
) -> SmallestLoss:
    weights = np.asarray(one.weights)
    loss = smallest_loss(model, load, x, weights, shift)
    if loss is None:
        return SmallestLoss(load, runs, None, None, math.nan)
    middle = (x.min() + x.max()) / 2
    before, then = axial.frequency(model, middle, load, np.array([1.0, 1 - loss]))
    spread = math.sqrt(log_odds_variance(model, covariance, load, x, weights, shift))
    odds = loss / (1 - loss)
    low, high = (1 - 1 / (1 + odds * math.exp(k * NORMAL_95 * spread)) for k in (-1, 1))
    return SmallestLoss(load, runs, loss, (low, high), float(before - then))


def _share(model: AxialModel, covariance: Array, x: float) -> tuple[float, float]:
    """Nut's share at a position, and its standard uncertainty by that of the share at the centre."""
    at = axial.PARAMETERS.index("share")
    local = 6 * float(axial.gradient(model, x, 0.0)[..., -1])
    return local, local * (1 - model.share) * math.sqrt(covariance[at, at])


def _notes(
    test: Plan,
    sheet: DataSheet,
    found: Sequence[SmallestLoss],
    scatters: Sequence[RunScatter],
    runs: Sequence[Run],
) -> tuple[str, ...]:
    notes = []
    if not runs:
        notes.append(
            "no baseline was given: the scatter of runs is what axes of this size were found to have, and "
            "this axis's own may be half or twice of it"
        )
    elif len(runs) == 1:
        notes.append(
            "one run has no scatter: that of its size is taken; a second run of the new axis tells more"
        )
    for one in scatters:
        if not _restless(one):
            continue
        notes.append(
            f"the baseline scatters {one.excess:.1f} times as much as axes of this size do: look for what "
            "changed between its runs (warmth, grease, the load, a loose sensor)"
        )
    for load in dict.fromkeys(one.load_kg for one in found):
        told = [one.loss for one in found if one.load_kg == load]
        least = 1 - max(MOST_LOSS if loss is None else loss for loss in told)
        force = max(
            abs(nut_load(sheet, hardest(executed(test, cell.motion)), load, cell.condition))
            for cell in cells(test)
        )
        if force > RELEASE * least * sheet.nominal_preload:
            notes.append(
                f"with {load:g} kg the test's own load of {force:.0f} N unloads the nut before the loss of a "
                "single run is seen: take a lower acceleration"
            )
    if any(one.loss is None for one in found):
        notes.append("a dash: not even a loss of 99 % is seen")
    return tuple(notes)


def _restless(one: RunScatter) -> bool:
    """Whether a baseline scatters by more than one of a hundred of its size would (Fisher's F)."""
    from scipy.stats import f

    if one.runs < 2:
        return False
    return bool(one.excess**2 > f.isf(0.01, one.runs - 1, DOUBT))
