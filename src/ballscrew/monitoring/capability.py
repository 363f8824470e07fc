"""Smallest detectable loss of preload of an axis and a plan, before any alarm."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ballscrew.axis import axial
from ballscrew.axis.axial import AxialModel, from_vector
from ballscrew.axis.axial_prior import prior
from ballscrew.axis.rigidity import release_ratio
from ballscrew.axis.sheet import DataSheet
from ballscrew.axis.sheet_file import read_axis
from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError, shown
from ballscrew.base.jsonfile import SCHEMA
from ballscrew.base.provenance import Made, digest
from ballscrew.base.quantity import NORMAL_95
from ballscrew.base.result import PlottedResult, first_sentences
from ballscrew.base.settings import check_setting, check_whole
from ballscrew.base.threads import single_threaded
from ballscrew.base.words import percent, plural
from ballscrew.calibration.bearing import single_run_note
from ballscrew.calibration.calibrated_axis import CalibratedAxis
from ballscrew.calibration.modelfile import read_model
from ballscrew.estimation.verdict import doubts_of_calibration
from ballscrew.fcft.cells import cells
from ballscrew.fcft.expected import executed
from ballscrew.fcft.nutload import hardest, nut_load
from ballscrew.fcft.plan import Plan, read_plan, validate_plan
from ballscrew.fcft.scatter import DOUBT, FrequencyScatter, default_scatter
from ballscrew.modal.run import Run
from ballscrew.monitoring.baseline_scatter import Baseline, RunScatter, read_baseline, run_scatter
from ballscrew.monitoring.smallest_loss import MOST_LOSS, log_odds_variance, needed_shift, smallest_loss

if TYPE_CHECKING:
    import pandas as pd

FALSE_ALARM = 1e-3
"""Probability that a test without a loss detects one: with a test every third day, once in eight years."""
POWER = 0.9
"""Probability that the smallest loss is detected."""
AFTER = (1, 3, 10)
"""Numbers of runs after which it is reported."""
BASELINE = 5
"""Runs of a baseline that is still to be measured."""
_MOST_RUNS = 10_000


@dataclass(frozen=True, slots=True)
class SmallestLoss:
    """Smallest detectable loss after some runs with one load.

    Parameters
    ----------
    load_kg : float
        On the table.
    runs : int
        Runs since the loss; their mean is compared with the baseline's.
    loss : float or None
        Fraction of the preload; None if not even 99 % is detectable.
    interval95 : tuple of float or None
        95 % interval of the loss by the uncertainty of the axis, mainly of the nut's share of the compliance.
    change_Hz : float
        Decrease of the frequency in the middle of the stops.
    """

    load_kg: float
    runs: int
    loss: float | None
    interval95: tuple[float, float] | None
    change_Hz: float  # noqa: N815  the unit's own letters


@dataclass(frozen=True, slots=True, repr=False)
class Capability(PlottedResult):
    """Smallest detectable loss of preload of an axis and a plan.

    Parameters
    ----------
    smallest : tuple of SmallestLoss
        By load, then number of runs.
    false_alarm, power : float
        Probabilities, see :data:`FALSE_ALARM` and :data:`POWER`.
    baseline_runs : int
        Measured, or planned.
    scatter : tuple of RunScatter
        Scatter of one run, for each load.
    share, share_standard_uncertainty : float
        The nut's part of the compliance, in the middle of the stops.
    known_from : str
        ``"data sheet"`` or ``"model"``.
    notes : tuple of str
        Notes, a sentence each.
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

    _drawing = "planning_figure:draw_smallest_loss"

    def _lines(self) -> list[str]:
        known = [row for row in self.smallest if row.loss is not None]
        title = "no loss of preload is detectable"
        if known:
            best = min(known, key=lambda row: row.loss or 0.0)
            after = f"after {plural(best.runs, 'run')} with {best.load_kg:g} kg"
            title = f"smallest detectable loss of preload {percent(best.loss or 0.0)}, {after}"
        return [f"{title}, by the {self.known_from}", *first_sentences(self.notes)]

    def to_dataframe(self) -> pd.DataFrame:
        """Table of the smallest losses, with the names of the JSON's keys."""
        import pandas as pd

        return pd.DataFrame(list(map(asdict, self.smallest)))

    def to_json(self) -> dict[str, Any]:
        """Document with the schema version."""
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
    scatter: FrequencyScatter | None = None,
) -> Capability:
    """Smallest loss of preload that is detectable at a stated rate of false alarms.

    The cells of a run are fused by generalised least squares into one number, the level of ln P. The mean of
    the last n runs is compared with the mean of b baseline runs, one-sided; the scatter of runs is estimated,
    so the limit is Student's and the power that of the noncentral t (Johnson, Kotz and
    Balakrishnan 1995, ch. 31). Errors that repeat from run to run cancel.

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
        Numbers of runs after which it is reported.
    false_alarm, power : float
        Probabilities.
    baseline_runs : int
        Planned number of baseline runs, where none is given.
    scatter : FrequencyScatter, optional
        By default that of axes of this size.

    Returns
    -------
    Capability
        By load and number of runs.

    Raises
    ------
    InputError
        If a file is wrong, the model or a run is of another axis, runs differ in load or share too few cells,
        or a probability is out of range.
    """
    sheet = axis if isinstance(axis, DataSheet) else read_axis(axis)
    test = plan if isinstance(plan, Plan) else read_plan(plan)
    validate_plan(test, sheet)
    _check(after, false_alarm, power, baseline_runs)
    middle = (test.positions[0] + test.positions[-1]) / 2
    known, covariance, origin, doubts = known_axis(model, sheet, middle)
    scatter = scatter or default_scatter(sheet)
    runs = [run if isinstance(run, Run) else Run.read(run) for run in baseline]
    setups = _setups(test, sheet, runs)
    count = len(runs) or baseline_runs
    smallest: list[SmallestLoss] = []
    scatters: list[RunScatter] = []
    for load, positions, measured in setups:
        spread = run_scatter(positions, load, known, scatter, test.repetitions, measured)
        scatters.append(spread)
        errors = needed_shift(spread.degrees, false_alarm, power)
        for n in after:
            shift = errors * spread.log_ratio * math.sqrt(1 / n + 1 / count)
            smallest.append(_smallest(n, shift, spread, known, covariance, positions))
    share, share_uncertainty = _share(known, covariance, middle)
    return Capability(
        smallest=tuple(smallest),
        false_alarm=false_alarm,
        power=power,
        baseline_runs=count,
        scatter=tuple(scatters),
        share=share,
        share_standard_uncertainty=share_uncertainty,
        known_from=origin,
        notes=(
            *doubts,
            single_run_note(sheet, known, share),
            *_baseline_notes(runs, scatters),
            *_load_notes(test, sheet, smallest),
        ),
        made=Made(
            settings={"false_alarm": false_alarm, "power": power, "after": list(after), **asdict(scatter)},
            inputs={"axis": digest(sheet.to_settings()), "plan": digest(test.to_settings())},
        ),
    )


def _setups(test: Plan, sheet: DataSheet, runs: Sequence[Run]) -> list[tuple[float, Array, Baseline | None]]:
    """Load, positions of the cells and baseline: of each load of the plan, or of the baseline's runs."""
    if runs:
        baseline = read_baseline(runs, sheet)
        return [(baseline.load, baseline.position, baseline)]
    setups: list[tuple[float, Array, Baseline | None]] = []
    for load in test.masses:
        positions = [cell.position for cell in cells(test) if cell.mass == load]
        setups.append((load, np.array(positions), None))
    return setups


def _check(after: Sequence[int], false_alarm: float, power: float, baseline_runs: int) -> None:
    if not after:
        raise InputError("after is empty; it must be one or more numbers of runs.")
    for runs in after:
        check_whole("a number of runs", runs, 1, _MOST_RUNS)
    check_setting("false_alarm", false_alarm, least=1e-9, most=0.9999)
    check_setting("power", power, above=false_alarm, most=0.9999)
    check_whole("baseline_runs", baseline_runs, 1, _MOST_RUNS)


def known_axis(
    model: str | Path | CalibratedAxis | None, sheet: DataSheet, middle: float
) -> tuple[AxialModel, Array, str, list[str]]:
    """Best known model of the axis.

    Parameters
    ----------
    model : path-like or CalibratedAxis or None
        MODEL.json; None for the data sheet with its tolerances.
    sheet : DataSheet
        The axis.
    middle : float
        Position at which the data sheet's compliance is stated, m.

    Returns
    -------
    model : AxialModel
        The axis.
    covariance : ndarray, shape (7, 7)
        Covariance of its working vector.
    known_from : str
        ``"data sheet"`` or ``"model"``.
    doubts : list of str
        Reasons why the calibration of the model is suspect.

    Raises
    ------
    InputError
        If the file is wrong, or the model of another axis.
    """
    if model is None:
        mean, covariance = prior(sheet, middle)
        return from_vector(mean, middle), covariance, "data sheet", []
    source = "the model"
    if not isinstance(model, CalibratedAxis):
        path = Path(model)
        model, source = read_model(path), path.name
    if model.axis != sheet.name:
        raise InputError(
            f"{source}: is the model of the axis {shown(model.axis)}; {sheet.source} is that of "
            f"{shown(sheet.name)}."
        )
    covariance = np.asarray(model.covariance, dtype=np.float64)
    return model.model, covariance, "model", doubts_of_calibration(model, ())


def _smallest(
    runs: int, shift: float, scatter: RunScatter, model: AxialModel, covariance: Array, x: Array
) -> SmallestLoss:
    load, weights = scatter.load_kg, np.asarray(scatter.weights)
    loss = smallest_loss(model, load, x, weights, shift)
    if loss is None:
        return SmallestLoss(load, runs, None, None, math.nan)
    middle = (x.min() + x.max()) / 2
    before, then = axial.frequency(model, middle, load, np.array([1.0, 1 - loss]))
    spread = math.sqrt(log_odds_variance(model, covariance, load, x, weights, shift))
    odds = loss / (1 - loss) * np.exp(np.array([-NORMAL_95, NORMAL_95]) * spread)
    low, high = (1 - 1 / (1 + odds)).tolist()
    return SmallestLoss(load, runs, loss, (low, high), float(before - then))


def _share(model: AxialModel, covariance: Array, x: float) -> tuple[float, float]:
    """Nut's share at a position, and its standard uncertainty by that of the share at the centre."""
    at = axial.PARAMETERS.index("share")
    local = 6 * float(axial.gradient(model, x, 0.0)[..., -1])
    return local, local * (1 - model.share) * math.sqrt(covariance[at, at])


def _baseline_notes(runs: Sequence[Run], scatters: Sequence[RunScatter]) -> list[str]:
    if not runs:
        typical = "the scatter of runs is that of typical axes of this size"
        return [f"no baseline was given: {typical}; that of this axis may be half or twice of it"]
    if len(runs) == 1:
        typical = "that of typical axes of this size is used"
        return [f"one run has no scatter: {typical}; give a second run of the new axis"]
    excessive = [scatter.excess for scatter in scatters if _excessive(scatter)]
    return [
        f"the baseline scatters {excess:.1f} times as much as axes of this size do: look for what changed "
        "between its runs (temperature, grease, the load, a loose sensor)"
        for excess in excessive
    ]


def _load_notes(test: Plan, sheet: DataSheet, smallest: Sequence[SmallestLoss]) -> list[str]:
    """Notes on loads of the plan with which the test itself unloads a worn nut, and on missing losses."""
    largest: dict[float, float] = {}
    for result in smallest:
        loss = MOST_LOSS if result.loss is None else result.loss
        largest[result.load_kg] = max(loss, largest.get(result.load_kg, 0.0))
    notes = []
    for load, loss in largest.items():
        force = 0.0
        for cell in cells(test):
            motion = hardest(executed(test, cell.motion))
            force = max(force, abs(nut_load(sheet, motion, load, cell.condition)))
        if force > release_ratio(sheet.screw) * (1 - loss) * sheet.nominal_preload:
            notes.append(
                f"with {load:g} kg the test's own load of {force:.0f} N unloads the nut before the loss of a "
                "single run is detectable: use a lower acceleration"
            )
    if any(result.loss is None for result in smallest):
        notes.append("a dash means that not even a loss of 99 % is detectable")
    return notes


def _excessive(scatter: RunScatter) -> bool:
    """Test at 1 % whether a baseline scatters by more than the default (Fisher's F)."""
    from scipy.stats import f

    if scatter.runs < 2:
        return False
    return bool(scatter.excess**2 > f.isf(0.01, scatter.runs - 1, DOUBT))
