"""All that a run knows of one cell: why its number is what it is."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError
from ballscrew.fcft.conditions import Condition
from ballscrew.modal.output_error import Candidate, CellEstimate, identify_cell, over_windows
from ballscrew.modal.output_error.fit import fit
from ballscrew.modal.output_error.lines import cell_lines
from ballscrew.modal.output_error.model import Poles
from ballscrew.modal.run import CellResult, Run
from ballscrew.modal.window import blow, extent

__all__ = ["Evidence", "Trace", "evidence", "find_cell"]

# Periods before and after the blow. All are as good as each other; what they disagree by is uncertainty.
WINDOWS = ((7.0, 12.0), (10.0, 16.0), (5.0, 14.0), (7.0, 9.0), (7.0, 16.0))
_AROUND = 0.25  # of the frequency: where the isolated cell is searched
_SKIRTS = (0.4, 1.4)  # lines from this part of the band's foot to this part of its head
_FEWEST, _NORMAL = 4, 1.48  # cells; standard deviation over the median distance
_NEAR = 1e-3  # m, within which a stop is the one that was asked for


@dataclass(frozen=True, slots=True, eq=False)
class Trace:
    """The averaged acceleration of a cell, and what a model of this cell alone makes of the torque.

    Parameters
    ----------
    time : ndarray, shape (n,)
        From the blow next to standstill, s.
    measured, explained : ndarray, shape (n,)
        Mean over repetitions and responses, m/s².
    left : float
        What the model leaves of all repetitions, one by one: root of its part of the power.
    band : tuple of float
        What passes, Hz.
    """

    time: Array
    measured: Array
    explained: Array
    left: float
    band: tuple[float, float]


@dataclass(frozen=True, slots=True, eq=False)
class Evidence:
    """What speaks for and against the number of a cell.

    Parameters
    ----------
    run : Run
        Of the cell.
    cell : CellResult
        As the run has it.
    paper : CellResult
        The same by the paper's method.
    isolated : CellEstimate
        From this cell's own records alone.
    trace : Trace or None
        None where no model of the cell alone came to rest.
    found, whole : int
        Transients of this cell, and those of them that are not cut and of no warm-up.
    stray : tuple of str
        Files whose transient does not belong to the others.
    siblings : tuple of CellResult
        The other conditions of the same stop and motion.
    scatter : float or None
        By how much cells deviate from the run's curve, robustly, Hz: what one cell's deviation is to be
        measured by. Noise alone is less than motion and friction do. None where fewer than four are known.
    """

    run: Run
    cell: CellResult
    paper: CellResult
    isolated: CellEstimate
    trace: Trace | None
    found: int
    whole: int
    stray: tuple[str, ...]
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
    """Gather what speaks for and against the number of a cell.

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
    whole = None if rows is None else rows.isel(transient=np.flatnonzero(rows["complete"].values))
    isolated, trace = _isolated(whole, cell, own, run.quality.verdict)
    files = [] if whole is None else [run.files[int(k)].name for k in whole["file"].values]
    siblings = tuple(
        c for c in run.cells
        if (c.position_m, c.motion) == (cell.position_m, cell.motion) and c.condition != cell.condition
    )  # fmt: skip
    return Evidence(
        run=run,
        cell=cell,
        paper=own,
        isolated=isolated,
        trace=trace,
        found=0 if rows is None else rows.sizes["transient"],
        whole=len(files),
        stray=tuple(files[k] for k in isolated.dropped if k < len(files)),
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


def _isolated(
    rows: xr.Dataset | None, cell: CellResult, paper: CellResult, verdict: str
) -> tuple[CellEstimate, Trace | None]:
    """The cell from its own records, near where the run says that the mode is."""
    count = 0 if rows is None else rows.sizes["transient"]
    if verdict == "bad":
        return _none("the measurement is bad", count), None
    if rows is None or count < 2:
        return _none("it takes two repetitions or more", count), None
    centre = cell.frequency_Hz or (math.sqrt(math.prod(paper.band_Hz)) if paper.band_Hz else None)
    if centre is None:
        return _none("nobody says where the mode may lie", count), None
    band = (centre * (1 - _AROUND), centre * (1 + _AROUND))
    found: list[CellEstimate] = []
    try:
        for window in WINDOWS:
            force, response, rate, _ = _records(rows, cell, centre, window)
            found.append(identify_cell(force, response, rate, band, expected=centre))
        joined = over_windows(found)
        first = found[0]
        joined = replace(joined, candidates=first.candidates, best=first.best, dropped=first.dropped)
        return joined, _trace(rows, cell, centre, band, first)
    except InputError as error:
        return _none(str(error).rstrip("."), count), None


def _none(reason: str, count: int) -> CellEstimate:
    return CellEstimate(None, None, None, None, "refused", (reason,), None, (), count)


def _records(
    rows: xr.Dataset, cell: CellResult, centre: float, window: tuple[float, float]
) -> tuple[Array, Array, float, int]:
    """Input and responses around the blow next to standstill as recorded, the rate, and where the blow is."""
    condition = Condition(cell.condition)
    part = extent(rows, condition, 1 / centre, before=window[0], after=window[1])
    samples = part.samples
    size = len(samples)
    first = np.clip(blow(rows, condition) + samples[0], 0, np.maximum(rows["length"].values - size, 0))
    index = first[:, None] + np.arange(size)
    force = np.take_along_axis(rows["input"].values.astype(np.float64), index, axis=1)
    response = np.take_along_axis(rows["acceleration"].values.astype(np.float64), index[None], axis=2)
    return force, response, float(rows.attrs["sample_rate"]), -int(samples[0])


def _trace(
    rows: xr.Dataset, cell: CellResult, centre: float, band: tuple[float, float], found: CellEstimate
) -> Trace | None:
    best = found.best or (found.candidates[0] if found.candidates else None)
    if best is None:
        return None
    force, response, rate, before = _records(rows, cell, centre, WINDOWS[0])
    kept = np.setdiff1d(np.arange(len(force)), found.dropped)
    span = (_SKIRTS[0] * band[0], min(_SKIRTS[1] * band[1], 0.45 * rate))
    lines = cell_lines(force[kept], response[:, kept], rate, span)
    residual = fit(lines, _poles(best), rounds=0).residual
    size = round(2 * np.pi * rate / (lines.omega[1] - lines.omega[0]))
    first = round(lines.omega[0] * size / (2 * np.pi * rate))
    measured, missed = (_in_time(each.mean(axis=(0, 1)), first, size) for each in (lines.response, residual))
    power = float(np.sum(np.abs(lines.response) ** 2))
    return Trace(
        time=(np.arange(size) - before) / rate,
        measured=measured,
        explained=measured - missed,
        left=float(np.sqrt(np.sum(np.abs(residual) ** 2) / power)) if power > 0 else 1.0,
        band=span,
    )


def _poles(best: Candidate) -> Poles:
    return Poles(
        np.array([mode.frequency for mode in best.modes]),
        np.array([mode.damping for mode in best.modes]),
        best.delay or 0.0,
        best.structure,
    )


def _in_time(lines: NDArray[np.complex128], first: int, size: int) -> Array:
    """The record that has these lines and no others."""
    whole = np.zeros(size // 2 + 1, np.complex128)
    whole[first : first + len(lines)] = lines / np.sqrt(2 / size)
    return np.fft.irfft(whole, size)
