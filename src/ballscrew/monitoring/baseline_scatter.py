"""What one run of an axis scatters by, as a baseline shows it, or as axes of its size do."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ballscrew.axis import axial
from ballscrew.axis.axial import AxialModel
from ballscrew.axis.sheet import DataSheet
from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError, shown
from ballscrew.calibration.frequency_table import FrequencyTable, frequency_table
from ballscrew.fcft.scatter import DOUBT, Scatter, run_causes
from ballscrew.modal.run import Run

__all__ = ["RunScatter", "baseline_scatter", "load_of", "seen_cells"]

Key = tuple[float, str, int]

_FEWEST = 4  # cells that all runs must share
_SAME_LOAD = 1e-6


@dataclass(frozen=True, slots=True)
class RunScatter:
    """Scatter of the fused number of one run.

    Parameters
    ----------
    load_kg : float
        On the table.
    log_ratio : float
        Standard deviation of ln P of one run, all cells fused.
    level_Hz : float
        The same as a change of all frequencies alike, Hz.
    degrees : float
        Of freedom that it is known with.
    runs : int
        Of a baseline that it was measured from; 0 where it is the default alone.
    excess : float
        The baseline's own standard deviation over the default; 1 where there is none.
    weights : tuple of float
        Of each cell's ln f in the fused ln P.
    """

    load_kg: float
    log_ratio: float
    level_Hz: float  # noqa: N815  the unit's own letters
    degrees: float
    runs: int
    excess: float
    weights: tuple[float, ...]


def load_of(runs: Sequence[Run], sheet: DataSheet) -> float:
    """Return the one load of a baseline, kg, its runs checked to be of one axis and usable.

    Parameters
    ----------
    runs : sequence of Run
        One or more.
    sheet : DataSheet
        The axis.

    Returns
    -------
    float
        kg.

    Raises
    ------
    InputError
        If a run is of another axis or load, stands twice, or was a bad measurement.
    """
    seen = [frequency_table(run) for run in runs]
    for one in seen:
        name = f"run {one.id[:12]}"
        if one.axis is not None and one.axis != sheet.name:
            raise InputError(
                f"{name} is of the axis {shown(one.axis)}; {sheet.source} is that of {shown(sheet.name)}."
            )
        if one.verdict == "bad":
            raise InputError(f"{name} is a bad measurement; a baseline must be made of good runs.")
        if abs(one.load - seen[0].load) > _SAME_LOAD * max(seen[0].load, 1.0):
            raise InputError(
                f"{name} has a load of {one.load:g} kg, run {seen[0].id[:12]} one of {seen[0].load:g} kg; "
                "all runs of a baseline must have the same."
            )
    if len({one.id for one in seen}) < len(seen):
        raise InputError("a run stands twice in the baseline; each must stand once.")
    return seen[0].load


def seen_cells(runs: Sequence[Run]) -> Array:
    """Positions of the cells that all runs of a baseline tell, shape (n,), m.

    Raises
    ------
    InputError
        If they share fewer than four.
    """
    return np.array([key[0] for key in _shared([frequency_table(run) for run in runs])])


def baseline_scatter(
    runs: Sequence[Run], position: Array, load: float, model: AxialModel, scatter: Scatter, repetitions: int
) -> RunScatter:
    """Scatter of one run's fused ln P.

    A baseline of R runs has R − 1 degrees of freedom; the default counts as :data:`DOUBT` more, and the two
    variances are averaged by them.

    Parameters
    ----------
    runs : sequence of Run
        The baseline; may be empty.
    position : ndarray, shape (n,)
        Of the cells, m; with a baseline as :func:`seen_cells` gives them.
    load : float
        kg.
    model : AxialModel
        The axis.
    scatter : Scatter
        The default.
    repetitions : int
        Of a run.

    Returns
    -------
    RunScatter
        With the weights of the cells.
    """
    f = axial.frequency(model, position, load)
    slope = axial.gradient(model, position, load)[:, -1]
    first, last = float(position.min()), float(position.max())
    causes = run_causes(scatter.of_run(repetitions), position, first, last) / f
    spread = causes.T @ causes + np.diag((scatter.own(repetitions) / f) ** 2)
    fused = np.linalg.solve(spread, slope)
    weights = fused / (fused @ slope)
    variance = default = float(weights @ spread @ weights)
    degrees, excess = DOUBT, 1.0
    if len(runs) > 1:
        levels = [float(weights @ row) for row in _levels(runs)]
        measured = float(np.var(levels, ddof=1))
        degrees += len(runs) - 1
        variance = (DOUBT * default + (len(runs) - 1) * measured) / degrees
        excess = float(np.sqrt(measured / default))
    middle = len(f) // 2
    return RunScatter(
        load_kg=load,
        log_ratio=float(np.sqrt(variance)),
        level_Hz=float(np.sqrt(variance) * slope[middle] * f[middle]),
        degrees=degrees,
        runs=len(runs) if len(runs) > 1 else 0,
        excess=excess,
        weights=tuple(float(w) for w in weights),
    )


def _keyed(one: FrequencyTable) -> dict[Key, float]:
    keys = zip(np.round(one.position, 6).tolist(), one.condition, one.motion, strict=True)
    return dict(zip(keys, one.frequency.tolist(), strict=True))


def _shared(seen: Sequence[FrequencyTable]) -> list[Key]:
    tables = [_keyed(one) for one in seen]
    keys = sorted(set(tables[0]).intersection(*tables[1:]))
    if len(keys) < _FEWEST or len({key[0] for key in keys}) < 2:
        raise InputError(
            f"the runs of the baseline share {len(keys)} cells; they must share {_FEWEST} or more at two "
            "stops or more: were they made with one plan?"
        )
    return keys


def _levels(runs: Sequence[Run]) -> list[Array]:
    """Logarithms of the frequencies of the shared cells, run by run."""
    seen = [frequency_table(run) for run in runs]
    keys = _shared(seen)
    return [np.log([_keyed(one)[key] for key in keys]) for one in seen]
