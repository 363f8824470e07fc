"""Data of a run that explain the result of one cell."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr

from ballscrew.base.errors import InputError
from ballscrew.modal.cell import CellKey, CellResult, transient_rows
from ballscrew.modal.run import Run

_FEWEST = 4  # cells
_NORMAL = 1.48  # standard deviation of a normal variable over its median absolute deviation
_NEAR = 1e-3  # m: largest distance between the given position and the stop


@dataclass(frozen=True, slots=True, eq=False)
class Evidence:
    """Data that explain the result of a cell.

    Parameters
    ----------
    run : Run
        Of the cell.
    cell : CellResult
        As the run has it.
    paper : CellResult
        The same cell by the paper's method.
    found, whole : int
        Transients of this cell, and those of them that are not cut and of no warm-up.
    siblings : tuple of CellResult
        The other conditions of the same stop and motion.
    scatter : float or None
        Robust standard deviation of the cells' deviations from the run's curve, Hz: the scale of one cell's
        deviation, by noise, motion and friction. None where fewer than four are known.
    """

    run: Run
    cell: CellResult
    paper: CellResult
    found: int
    whole: int
    siblings: tuple[CellResult, ...]
    scatter: float | None = None


def find_cell(run: Run, position: float, condition: str, motion: int) -> CellResult:
    """Find a cell of a run.

    Parameters
    ----------
    run : Run
        The run.
    position : float
        Of the stop, m; the nearest within 1 mm is taken.
    condition : str
        PA, PD, NA or ND.
    motion : int
        Which motion, from 0.

    Returns
    -------
    CellResult
        The cell.

    Raises
    ------
    InputError
        If there is none; it names those that there are.
    """
    wanted = f"{1e3 * position:g}mm:{condition}:{motion}"
    if not run.cells:
        raise InputError(f"the run has no cell {wanted}: no transient was found in it.")
    stops = np.unique([cell.position_m for cell in run.cells])
    stop = float(stops[np.argmin(np.abs(stops - position))])
    if abs(stop - position) > _NEAR:
        places = ", ".join(map(_millimetres, stops))
        raise InputError(f"the run has no cell {wanted}; it has stops at {places} mm.")
    here = {cell.key: cell for cell in run.cells if cell.position_m == stop}
    key = CellKey(stop, condition, motion)
    if key in here:
        return here[key]
    names = [k.condition for k in here]
    if len({cell.motion for cell in run.cells}) > 1:
        names = [f"{k.condition}:{k.motion}" for k in here]
    raise InputError(f"the run has no cell {wanted}; at {_millimetres(stop)} mm it has {', '.join(names)}.")


def _millimetres(position: float) -> str:
    """Position (m) in mm, rounded to 0.1 mm; never ``-0``."""
    return f"{round(1e3 * position, 1) + 0.0:g}"


def evidence(
    run: Run, cell: CellResult, paper: Sequence[CellResult], transients: xr.Dataset | None
) -> Evidence:
    """Gather the data that explain the result of a cell.

    Parameters
    ----------
    run : Run
        By any method.
    cell : CellResult
        One of its cells.
    paper : sequence of CellResult
        The same cells by the paper's method.
    transients : Dataset or None
        The table *Transients* of the run; None where no recording could be used.

    Returns
    -------
    Evidence
        Also of a cell that was refused, or never measured.
    """
    complete: list[bool] = []
    if transients is not None:
        rows = zip(transient_rows(transients), transients["complete"].values.tolist(), strict=True)
        complete = [whole for row, whole in rows if row.key == cell.key]
    (own,) = [c for c in paper if c.key == cell.key]
    stop = [c for c in run.cells if (c.position_m, c.motion) == (cell.position_m, cell.motion)]
    siblings = tuple(c for c in stop if c.condition != cell.condition)
    return Evidence(
        run=run,
        cell=cell,
        paper=own,
        found=len(complete),
        whole=sum(complete),
        siblings=siblings,
        scatter=_scatter(run),
    )


def _scatter(run: Run) -> float | None:
    """Robust standard deviation of the cells' deviations, Hz; None for fewer than four."""
    known = [cell.deviation_Hz for cell in run.cells if cell.deviation_Hz is not None]
    if len(known) < _FEWEST:
        return None
    return _NORMAL * float(np.median(np.abs(np.array(known) - np.median(known))))
