"""The picture of the nut under load: force, rigidity, and what its frequency reads as."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ballscrew.axis.hertz import (
    RELEASE,
    apparent_preload,
    hertz_constant,
    nut_force,
    nut_rigidity_under_load,
    preload_deflection,
    tangent_ratio,
)
from ballscrew.axis.model import kappa
from ballscrew.axis.sheet import DataSheet
from ballscrew.base.arrays import Array
from ballscrew.fcft.nutload import ADVISED
from ballscrew.report.axis_figures import PRELOAD_MAP
from ballscrew.report.canvas import blank, colours_of, note, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["draw_nut"]


_POINTS = 801
_BLUE, _GREEN, _RED = "#0B3C6F", "#117733", "#9C3A12"


def draw_nut(sheet: DataSheet, *, parts: Sequence[float], furthest: float, heaviest: float) -> Figure:
    """Draw force against deflection, rigidity against load, and what a loaded nut reads as.

    Parameters
    ----------
    sheet : DataSheet
        Gives κ and the preload when new.
    parts : sequence of float
        P/P₀ of the nuts whose rigidity is drawn in N/µm.
    furthest : float
        Largest F/P.
    heaviest : float
        Largest nut load of the rigidities in N/µm, N.

    Returns
    -------
    Figure
        Not yet written.
    """
    with styled():
        figure = blank(8.4, 7)
        ((force, ratio), (rigidity, reading)) = figure.subplots(2, 2)
        _force(force, sheet)
        _against(ratio, tangent_ratio, furthest, 1.0, "{:.3f}")
        ratio.set(ylabel="rigidity k(F)/k(0)")
        ratio.set_title("Rigidity falls until one flank unloads", loc="left", fontsize=10)
        _rigidity(rigidity, sheet, parts, np.linspace(0.0, heaviest, _POINTS))
        _against(reading, apparent_preload, furthest, 100.0, "{:.0f} %")
        reading.set(ylabel="apparent preload (% of P)")
        reading.set_title("Preload that the frequency indicates", loc="left", fontsize=10)
    return figure


def _against(
    axes: Axes, law: Callable[[ArrayLike, ArrayLike], Array], furthest: float, scale: float, written: str
) -> None:
    """Draw a law against F/P, with the advised limit and the release."""
    load = np.append(np.linspace(0.0, furthest, _POINTS), RELEASE)
    load.sort()
    values = scale * law(load, 1.0)
    axes.plot(load, values, color=_BLUE, lw=2)
    axes.set(xlabel="nut load F over preload P", xlim=(0, furthest), ylim=(0, 1.1 * values.max()))
    axes.axvspan(0, ADVISED, color="#E6F2E6", zorder=0, lw=0)
    for at, colour, offset in ((ADVISED, _GREEN, (6, 5)), (RELEASE, _RED, (6, -5))):
        height = scale * float(law(at, 1.0))
        axes.plot(at, height, "o", color=colour, ms=5)
        note(axes, f"{at:.3g} P: {written.format(height)}", (at, height), offset, colour=colour)


def _force(axes: Axes, sheet: DataSheet) -> None:
    preload, stiffness = sheet.nominal_preload, kappa(sheet)
    pressed, constant = float(preload_deflection(preload, stiffness)), float(hertz_constant(stiffness))
    way = np.linspace(-1.45 * pressed, 1.45 * pressed, _POINTS)
    near = constant * np.maximum(pressed + way, 0.0) ** 1.5
    far = -constant * np.maximum(pressed - way, 0.0) ** 1.5
    for flank in (near, far):
        axes.plot(1e6 * way, flank, color="0.55", lw=1.1, ls=(0, (4, 2)))
    axes.plot(1e6 * way, nut_force(way, preload, stiffness), color=_BLUE, lw=2.2)
    limit = RELEASE * preload
    axes.plot([1e6 * pressed, -1e6 * pressed], [limit, -limit], "o", color=_RED, ms=5)
    words = f"one flank unloads:\n{RELEASE:.3g} P = {limit:.0f} N"
    note(axes, words, (1e6 * pressed, limit), (-8, 10), colour=_RED)
    axes.plot([0, 0], [preload, -preload], "o", color="0.45", ms=4)
    note(axes, f"P = {preload:.0f} N", (0, preload), (-5, 5), colour="0.35")
    note(axes, "each flank alone", (0.2e6 * pressed, -preload), (6, -8), colour="0.35")
    axes.set(xlabel="deflection δ (µm)", ylabel="nut load F (N)", xlim=(1e6 * way[0], 1e6 * way[-1]))
    axes.set_title("Two flanks, each in compression only", loc="left", fontsize=10)


def _rigidity(axes: Axes, sheet: DataSheet, parts: Sequence[float], load: Array) -> None:
    stiffness = kappa(sheet)
    colours = colours_of(PRELOAD_MAP, len(parts), 0.75)
    one_flank = nut_rigidity_under_load(load, 0.0, stiffness) / 1e6
    axes.plot(load, one_flank, color="0.6", lw=1.8)
    at = int(0.7 * load.size)
    note(axes, "one flank,\nany P", (float(load[at]), float(one_flank[at])), (6, -6), colour="0.4")
    for part, colour in zip(parts, colours, strict=True):
        preload = part * sheet.nominal_preload
        load_range = np.linspace(0.0, RELEASE * preload, _POINTS)
        values = nut_rigidity_under_load(load_range, preload, stiffness) / 1e6
        axes.plot(load_range, values, color=colour, lw=2)
        axes.plot(load_range[-1], values[-1], "o", color=_RED, ms=4)
        note(axes, f"P = {preload:.0f} N", (0.0, float(values[0])), (4, 3), colour=colour)
    axes.set(xlabel="nut load F (N)", ylabel="rigidity (N/µm)", xlim=(0, load[-1]))
    axes.set_ylim(0, 1.1 * axes.get_ylim()[1])
    axes.set_title("Beyond unloading, independent of P", loc="left", fontsize=10)
