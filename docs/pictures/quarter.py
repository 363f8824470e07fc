"""The picture of what a part of the preload does to the frequency, and how many cells it takes to see."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ballscrew.axis.frequency import Rotor, axial_natural_frequency, nut_share
from ballscrew.axis.given import positive
from ballscrew.axis.sheet import DataSheet
from ballscrew.base.arrays import Array
from ballscrew.base.quantity import NORMAL_95
from ballscrew.fcft.cells import cells
from ballscrew.fcft.plan import Plan
from ballscrew.report.axis_figures import PRELOAD_MAP, ROTOR_COLOURS
from ballscrew.report.canvas import blank, colours_of, note, second_scale, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["draw_quarter", "preload_uncertainty", "smallest_loss"]


_POINTS = 181
_COLOURS = ("#0B3C6F", "#B0470F")  # of the uncertainties


def preload_uncertainty(
    sheet: DataSheet, plan: Plan, frequency_uncertainty: float, count: ArrayLike
) -> Array:
    """u(P)/P from independent cells of a plan, averaged with the weight that each has.

    One cell determines ln P with u(f)/(f s/6), s the nut's share of the compliance. Cells are assumed to be
    spread as those of the plan, so that ``count`` may be any number.

    Parameters
    ----------
    sheet : DataSheet
        The axis, at its nominal preload, rotor free, without twist.
    plan : Plan
        Gives the cells.
    frequency_uncertainty : float
        u(f), the standard uncertainty of one cell's frequency, Hz.
    count : array_like
        How many cells.

    Returns
    -------
    ndarray
        The shape of ``count``.

    Raises
    ------
    InputError
        If uncertainty or number is not more than 0.
    """
    every = cells(plan)
    x, load = np.array([cell.position for cell in every]), np.array([cell.mass for cell in every])
    slope = axial_natural_frequency(sheet, x, load) * nut_share(sheet, x, torsion=False) / 6
    uncertainty = positive("standard uncertainty of a frequency", frequency_uncertainty, "Hz")
    information = np.mean((slope / uncertainty) ** 2)
    return np.asarray(1 / np.sqrt(positive("number of cells", count) * information))


def smallest_loss(sheet: DataSheet, plan: Plan, frequency_uncertainty: float, count: ArrayLike) -> Array:
    """Part of the preload that must be lost for a run to differ from another one at 95 %.

    Parameters
    ----------
    sheet, plan, frequency_uncertainty, count
        As for :func:`preload_uncertainty`; both runs have that many cells and that uncertainty.

    Returns
    -------
    ndarray
        1 − exp(−1.96 √2 u(P)/P), the shape of ``count``.

    Raises
    ------
    InputError
        As :func:`preload_uncertainty`.
    """
    uncertainty = preload_uncertainty(sheet, plan, frequency_uncertainty, count)
    return np.asarray(-np.expm1(-NORMAL_95 * math.sqrt(2) * uncertainty))


def draw_quarter(sheet: DataSheet, plan: Plan, *, left: float, uncertainties: Sequence[float]) -> Figure:
    """Draw the frequency new and worn, their difference, the nut's share, and the detectable loss.

    Parameters
    ----------
    sheet : DataSheet
        The axis.
    plan : Plan
        Gives stops, load (its first) and the number of cells.
    left : float
        P/P₀ of the worn axis.
    uncertainties : sequence of float
        One or two standard uncertainties of one cell's frequency, Hz; the first is drawn as a band.

    Returns
    -------
    Figure
        Not yet written.
    """
    stops = np.array(plan.positions)
    x, load, band = np.linspace(stops[0], stops[-1], _POINTS), plan.masses[0], uncertainties[0]
    with styled():
        figure = blank(8.4, 7)
        ((along, fall), (share, count)) = figure.subplots(2, 2)
        _along(along, sheet, x, load, left, band)
        _fall(fall, sheet, x, load, left, band)
        _share(share, sheet, x)
        for axes in (along, fall, share):
            axes.set(xlabel="position (mm)", xlim=(1e3 * x[0], 1e3 * x[-1]))
        _count(count, sheet, plan, left, uncertainties)
    return figure


def _along(axes: Axes, sheet: DataSheet, x: Array, load: float, left: float, band: float) -> None:
    words = ("new", f"{100 * left:g} % of the preload")
    for part, colour, name, at, offset in zip(
        (1.0, left), colours_of(PRELOAD_MAP, 2, 0.6), words, (0.45, 0.66), ((5, 4), (-5, -4)), strict=True
    ):
        f = axial_natural_frequency(sheet, x, load, part * sheet.nominal_preload)
        axes.fill_between(1e3 * x, f - band, f + band, color=colour, lw=0)
        place = int(at * _POINTS)
        note(axes, name, (1e3 * x[place], f[place]), offset, colour=colour)
    axes.set(ylabel="frequency, rotor free (Hz)")
    axes.set_title(f"Natural frequency ± {band:g} Hz", loc="left")


def _fall(axes: Axes, sheet: DataSheet, x: Array, load: float, left: float, band: float) -> None:
    places: dict[Rotor, tuple[float, tuple[float, float]]] = {"free": (0.6, (4, -4)), "held": (0.5, (-4, 4))}
    for rotor, (at, offset) in places.items():
        new = axial_natural_frequency(sheet, x, load, None, rotor)
        drop = axial_natural_frequency(sheet, x, load, left * sheet.nominal_preload, rotor) - new
        axes.plot(1e3 * x, drop, color=ROTOR_COLOURS[rotor], lw=2)
        place = int(at * _POINTS)
        note(axes, f"rotor {rotor}", (1e3 * x[place], drop[place]), offset, colour=ROTOR_COLOURS[rotor])
    both = math.sqrt(2) * band
    axes.axhspan(-both, both, color="0.88", zorder=0, lw=0)
    middle = 1e3 * (x[0] + x[-1]) / 2
    note(axes, f"two new runs differ by ± {both:.2f} Hz", (middle, 0.0), (0, 0), size=8.5)
    axes.set(ylabel="change of frequency (Hz)")
    axes.set_title(f"Effect of losing {100 * (1 - left):g} % of the preload", loc="left")


def _share(axes: Axes, sheet: DataSheet, x: Array) -> None:
    part = 100 * nut_share(sheet, x, torsion=False)
    axes.plot(1e3 * x, part, color="0.2", lw=2)
    axes.set(ylabel="s (% of the compliance)", ylim=(0, 1.15 * part.max()))
    second_scale(axes, 1 / 600, "s/6 (% of f per % of P)")
    axes.set_title("The nut's share of the compliance", loc="left")


def _count(axes: Axes, sheet: DataSheet, plan: Plan, left: float, uncertainties: Sequence[float]) -> None:
    most, lost = len(cells(plan)), 100 * (1 - left)
    numbers = np.geomspace(1, 2.5 * most, 101)
    middle = math.sqrt(most)
    for u, colour in zip(uncertainties, _COLOURS, strict=False):
        axes.loglog(numbers, 100 * smallest_loss(sheet, plan, u, numbers), color=colour, lw=2)
        for number, offset in ((1, (7, 3)), (most, (5, 4))):
            loss = 100 * float(smallest_loss(sheet, plan, u, number))
            axes.plot(number, loss, "o", color=colour, ms=5, clip_on=False)
            note(axes, f"{loss:.2g} %", (number, loss), offset, colour=colour)
        height = 100 * float(smallest_loss(sheet, plan, u, middle))
        note(axes, f"± {u:g} Hz per cell", (middle, height), (3, 4), colour=colour)
    axes.axhline(lost, color="black", lw=0.9, ls=":")
    note(axes, f"{lost:g} % loss", (numbers[-1], lost), (-3, 3), size=8.5)
    axes.set(xlabel="independent cells", ylabel="smallest detectable loss (% of P)", xlim=(1, numbers[-1]))
    ticks = (1, 3, 10, most), (1, 2, 5, 10, 20, 50)
    axes.set_xticks(ticks[0], [str(tick) for tick in ticks[0]])
    axes.set_yticks(ticks[1], [str(tick) for tick in ticks[1]])
    axes.minorticks_off()
    axes.set_title("Detection between two runs, 95 %", loc="left")
