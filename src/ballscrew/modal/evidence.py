"""Data of a run that explain the result of one cell."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr

from ballscrew.base.errors import InputError
from ballscrew.modal.run import CellResult, Run

__all__ = ["Evidence", "evidence", "find_cell"]

_FEWEST, _NORMAL = 4, 1.48  # cells; standard deviation over the median distance
_NEAR = 1e-3  # m, within which a stop is the one that was asked for


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
        The same by the paper's method.
    found, whole : int
        Transients of this cell, and those of them that are not cut and of no warm-up.
    siblings : tuple of CellResult
        The other conditions of the same stop and motion.
    scatter : float or None
        By how much cells deviate from the run's curve, robustly, Hz: what one cell's deviation is to be
        measured by. Noise alone is less than motion and friction do. None where fewer than four are known.
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
    asked = f"{1e3 * position:g}mm:{condition}:{motion}"
    if not run.cells:
        raise InputError(f"the run has no cell {asked}: no transient was found in it.")
    place = min({cell.position_m for cell in run.cells}, key=lambda x: abs(x - position))
    here = [cell for cell in run.cells if cell.position_m == place]
    if abs(place - position) > _NEAR:
        stops = ", ".join(f"{round(1e3 * x, 1) + 0.0:g}" for x in sorted({c.position_m for c in run.cells}))
        raise InputError(f"the run has no cell {asked}; it has stops at {stops} mm.")
    for cell in here:
        if (cell.condition, cell.motion) == (condition, motion):
            return cell
    motions = len({cell.motion for cell in run.cells}) > 1
    names = ", ".join(f"{c.condition}:{c.motion}" if motions else c.condition for c in here)
    raise InputError(f"the run has no cell {asked}; at {round(1e3 * place, 1) + 0.0:g} mm it has {names}.")


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
    own = _same(paper, cell)
    rows = _rows(transients, cell)
    siblings = tuple(
        c for c in run.cells
        if (c.position_m, c.motion) == (cell.position_m, cell.motion) and c.condition != cell.condition
    )  # fmt: skip
    return Evidence(
        run=run,
        cell=cell,
        paper=own,
        found=0 if rows is None else rows.sizes["transient"],
        whole=0 if rows is None else int(np.count_nonzero(rows["complete"].values)),
        siblings=siblings,
        scatter=_scatter(run),
    )


def _scatter(run: Run) -> float | None:
    known = [cell.deviation_Hz for cell in run.cells if cell.deviation_Hz is not None]
    if len(known) < _FEWEST:
        return None
    return _NORMAL * float(np.median(np.abs(np.array(known) - np.median(known))))


def _same(cells: Sequence[CellResult], cell: CellResult) -> CellResult:
    key = (cell.position_m, cell.condition, cell.motion)
    return next(c for c in cells if (c.position_m, c.condition, c.motion) == key)


def _rows(transients: xr.Dataset | None, cell: CellResult) -> xr.Dataset | None:
    if transients is None:
        return None
    mine = (
        (transients["position_m"].values == cell.position_m)
        & (transients["condition"].values == cell.condition)
        & (transients["motion"].values == cell.motion)
    )
    return transients.isel(transient=np.flatnonzero(mine))
