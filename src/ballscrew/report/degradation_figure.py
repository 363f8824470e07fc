"""Loss of preload over time, from the wear laws: Fig. 1 of the paper."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ballscrew.axis.frequency import axial_natural_frequency
from ballscrew.axis.hertz import preload_deflection
from ballscrew.axis.model import kappa
from ballscrew.axis.sheet import DataSheet
from ballscrew.axis.wear import backlash_after_wear, contact_pressure_law, end_of_preload, preload_after_wear
from ballscrew.base.arrays import Array
from ballscrew.report import canvas
from ballscrew.report.backlash_figure import name_stage, shade_stages
from ballscrew.report.canvas import Axes, Figure

_DAY = 86400.0
_POINTS = 801
_COLOURS = {"preload": "#0B3C6F", "backlash": canvas.BACKLASH, "frequency": canvas.ANF}
_DASHED = (0, (4, 2))
_DEEPEST = 0.72  # of the new frequency; below, the formula of a nut without load dives to 0


@canvas.styled()
def draw_degradation(
    sheet: DataSheet,
    *,
    preload_gone: float,
    end: float,
    position: float,
    load: float,
    falls: Sequence[float],
    backlash: float,
) -> Figure:
    """Draw preload, backlash and frequency against time, stage I and stage II.

    Solid: the flanks wear at a constant rate, as under a constant outer load, w = δ₀ t/t_f. Dashed: the
    contact pressure of the preload alone wears them.

    Parameters
    ----------
    sheet : DataSheet
        The axis.
    preload_gone : float
        t_f, the time at which the preload reaches 0, s.
    end : float
        Last time drawn, later than ``preload_gone``, s.
    position, load : float
        Position and load of the frequency, m and kg.
    falls : sequence of float
        Falls of the frequency that are marked, Hz.
    backlash : float
        Backlash that is marked, m.

    Returns
    -------
    Figure
        Not yet written.
    """
    new, stiffness = sheet.nominal_preload, kappa(sheet)
    time = np.linspace(0.0, end, _POINTS)
    wear = float(preload_deflection(new, stiffness)) * time / preload_gone
    preload = preload_after_wear(wear, new, stiffness)
    # That law's own parameter is the time to half of the preload; here both laws end together.
    alone = contact_pressure_law(time, new, preload_gone / float(end_of_preload("contact-pressure", 1.0)))
    days, last = time / _DAY, preload_gone / _DAY
    figure = canvas.blank(8, 7.6)
    rows: Any = figure.subplots(3, 1, sharex=True, height_ratios=(1, 0.7, 1.2))
    for axes in rows:
        shade_stages(axes, 0, last, days[-1])
    _preload(rows[0], sheet, days, preload, alone)
    name_stage(rows[0], last / 2, "Stage I: preload decreases")
    name_stage(rows[0], (last + days[-1]) / 2, "Stage II: backlash")
    _backlash(rows[1], days, backlash_after_wear(wear, new, stiffness), last, backlash)
    f = _frequency(rows[2], sheet, days, (preload, alone), position, load)
    for fall in falls:
        day = float(np.interp(fall, f[0] - f, days[: f.size]))
        _mark(rows[2], day, float(f[0] - fall), f"−{fall:g} Hz")
    rows[2].set_ylim(_DEEPEST * f[0], 1.03 * f[0])
    where = (last + days[-1]) / 2, float(np.mean(rows[2].get_ylim()))
    canvas.note(rows[2], "no preload:\nEq. (3) does\nnot apply", where, (0, 0), colour="0.3")
    rows[2].set(xlabel="time (days)", ylabel="frequency, rotor free (Hz)")
    return figure


def _preload(axes: Axes, sheet: DataSheet, days: Array, preload: Array, alone: Array) -> None:
    new, rating, colour = sheet.nominal_preload, sheet.screw.dynamic_load_rating, _COLOURS["preload"]
    axes.plot(days, preload, color=colour, lw=2)
    axes.plot(days, alone, color=colour, lw=1.3, ls=_DASHED)
    axes.set(ylabel="preload (N)", ylim=(0, 1.06 * new))
    canvas.second_scale(axes, 100 / rating, "preload (% of $C_a$)")
    upper, lower = int(np.argmax(preload < 0.55 * new)), int(np.argmax(alone < 0.28 * new))
    canvas.note(
        axes, "wear at constant rate (outer load)", (days[upper], preload[upper]), (5, 4), colour=colour
    )
    canvas.note(axes, "wear by the\npreload alone", (days[lower], alone[lower]), (-6, -4), colour=colour)


def _backlash(axes: Axes, days: Array, play: Array, last: float, marked: float) -> None:
    axes.plot(days, 1e6 * play, color=_COLOURS["backlash"], lw=2)
    axes.set_ylabel("backlash (µm)")
    late = days >= last
    day = float(np.interp(marked, play[late], days[late]))
    _mark(axes, day, 1e6 * marked, f"{1e6 * marked:g} µm", (-6, 5))
    canvas.note(axes, "none", (last / 2, 0.0), (0, 4), colour=_COLOURS["backlash"])


def _frequency(
    axes: Axes, sheet: DataSheet, days: Array, preloads: tuple[Array, Array], position: float, load: float
) -> Array:
    """Draw both laws, the second dashed; the first is returned as far as there is preload."""
    curves = [axial_natural_frequency(sheet, position, load, part[part > 0]) for part in preloads]
    for f, style, width in zip(curves, ("-", _DASHED), (2.0, 1.3), strict=True):
        axes.plot(days[: f.size], f, color=_COLOURS["frequency"], lw=width, ls=style)
    return curves[0]


def _mark(axes: Axes, day: float, height: float, text: str, offset: tuple[float, float] = (6, 3)) -> None:
    axes.plot(day, height, "o", color="black", ms=4.5, zorder=4)
    canvas.note(axes, f"{text}: day {day:.0f}", (day, height), offset)
