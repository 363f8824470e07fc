"""Terms of a peak's uncertainty: scatter of repetitions, and errors that all repetitions share."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from ballscrew.fcft.conditions import Condition
from ballscrew.modal.paper.lines import Lines, magnitude
from ballscrew.modal.paper.peak import Peak, highest_point
from ballscrew.modal.paper.settings import PaperSettings
from ballscrew.modal.paper.window import VARIANTS, Extent, blow, extent, tapered

_NEAR = 0.08  # of the frequency: how far from the peak its own scatter may carry it
# Of the frequency: distance of the highest point under one window from the pole. Damping moves it a little;
# what rings on beyond the window, and a servo that goes on pushing, move it more. All repetitions share it:
# only simulated plants determine its size. On two-mass plants with weak to strong servos
# (tests/modal/paper/test_cell.py) it is 0.2 to 1 % high, 0.55 % root mean square.
METHOD_ERROR = 0.006


def repetition_term(lines: Lines, peak: Peak, settings: PaperSettings) -> float:
    """Scatter over repetitions, by the jackknife (B. Efron, DOI 10.1137/1.9781611970319, ch. 3).

    Parameters
    ----------
    lines : Lines
        Of the cell.
    peak : Peak
        Found from all repetitions.
    settings : PaperSettings
        As the peak was found with.

    Returns
    -------
    float
        Standard uncertainty, Hz; 0 for a single repetition, which shows no scatter.
    """
    count = len(lines.input)
    if count < 2:
        return 0.0
    curves = np.stack([magnitude(lines.without(row), settings) for row in range(count)])
    found = highest_point(lines.grid, curves, peak.frequency, _NEAR * peak.frequency)
    return float(np.sqrt((count - 1) / count * np.sum((found - found.mean()) ** 2)))


def window_term(
    cell: xr.Dataset,
    condition: Condition,
    centre: float,
    grid: NDArray[np.float64],
    peak: Peak,
    settings: PaperSettings,
) -> float:
    """Scatter over windows that are as good as the one chosen: 15 % longer or shorter at either side.

    Parameters
    ----------
    cell : Dataset
        The cell's rows of the table *Transients*.
    condition : Condition
        Of the cell.
    centre : float
        Frequency whose period sets the window, Hz.
    grid : ndarray, shape (n,)
        Lines of the band, Hz.
    peak : Peak
        Found with the window chosen.
    settings : PaperSettings
        As the peak was found with.

    Returns
    -------
    float
        Standard uncertainty, Hz.
    """
    rate = float(cell.attrs["sample_rate"])
    found = [peak.frequency]
    for before, after in VARIANTS:
        before, after = before * settings.window_before, after * settings.window_after
        window = extent(cell, condition, 1 / centre, before=before, after=after)
        force, response = tapered(cell, condition, window)
        if len(force):
            curve = magnitude(Lines.of(force, response, rate, grid), settings)
            found.append(float(highest_point(grid, curve, peak.frequency, _NEAR * peak.frequency)))
    return float(np.std(found, ddof=1)) if len(found) > 1 else 0.0


def travelled(cell: xr.Dataset, condition: Condition, window: Extent) -> float:
    """Distance of the table from the stop while it rings, weighted as the window weights its energy, m.

    Parameters
    ----------
    cell : Dataset
        The cell's rows of the table *Transients*.
    condition : Condition
        Of the cell.
    window : Extent
        Of the cell.

    Returns
    -------
    float
        Root mean square distance, m.
    """
    at = blow(cell, condition)
    # What rings, rings after the blow; before it the window holds standstill or the other phase's end.
    after = window.samples >= 0
    index = np.clip(at[:, None] + window.samples[after], 0, cell["length"].values[:, None] - 1)
    place = np.take_along_axis(cell["position"].values, index, axis=1)
    weight = window.hann[after] ** 2
    distance = place - cell["reached_m"].values[:, None]
    return float(np.sqrt((weight * distance**2).sum() / (weight.sum() * len(distance))))


def condition_term(
    position: Sequence[float], frequency: Sequence[float], uncertainty: Sequence[float]
) -> float:
    """Disagreement of the conditions of one stop beyond the uncertainty of each.

    A table that starts, stops or turns meets another friction; repetitions of one condition all share it. So
    the disagreement is pooled over the stops of a run and belongs to every cell.

    Parameters
    ----------
    position : sequence of float
        Stop of each identified cell, m.
    frequency, uncertainty : sequence of float
        Natural frequency and standard uncertainty of each, Hz.

    Returns
    -------
    float
        Standard uncertainty, Hz; 0 where no stop has two conditions.
    """
    stops, values = np.asarray(position), np.asarray(frequency)
    squares, freedom = 0.0, 0
    for stop in np.unique(stops):
        here = values[stops == stop]
        squares += float(((here - here.mean()) ** 2).sum())
        freedom += len(here) - 1
    if freedom == 0:
        return 0.0
    return float(np.sqrt(max(0.0, squares / freedom - float(np.mean(np.square(uncertainty))))))
