"""The picture of a life: frequency, preload and backlash against time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from ballscrew.report.canvas import save_figure, styled
from ballscrew.report.style import ANF, BACKLASH, check_target

__all__ = ["LifePoint", "draw_life"]

_PRELOAD = "#0B3C6F"


@dataclass(frozen=True, slots=True)
class LifePoint:
    """One test in the life of an axis.

    Parameters
    ----------
    day : float
        When.
    shift_Hz : float or None
        Mean change of the natural frequency against the baseline; None where no cell could be read.
    standard_uncertainty_Hz : float
        Of it.
    cells : int
        That it is the mean of.
    preload_ratio : float
        True preload over Ca.
    backlash_m : float
        True backlash.
    """

    day: float
    shift_Hz: float | None  # noqa: N815  the key of the JSON
    standard_uncertainty_Hz: float  # noqa: N815
    cells: int
    preload_ratio: float
    backlash_m: float


def draw_life(points: Sequence[LifePoint], path: Path, *, alarm_day: float | None) -> None:
    """Draw what was measured above what was true.

    Parameters
    ----------
    points : sequence of LifePoint
        In the order of time.
    path : path-like
        PNG, SVG or PDF.
    alarm_day : float, optional
        When the change was first sure; marked.

    Raises
    ------
    InputError
        If the picture cannot be written.
    """
    check_target(path)
    with styled():
        save_figure(_figure(points, alarm_day), path)


def _figure(points: Sequence[LifePoint], alarm_day: float | None):  # type: ignore[no-untyped-def]
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.4, 7.6), dpi=150)
    measured, preload, backlash = figure.subplots(3, 1, sharex=True, height_ratios=(2, 1, 1))
    read = [point for point in points if point.shift_Hz is not None]
    days = [point.day for point in read]
    measured.errorbar(
        days,
        [point.shift_Hz for point in read],
        yerr=[1.96 * point.standard_uncertainty_Hz for point in read],
        fmt="o",
        ms=4.5,
        lw=1.2,
        color=ANF,
        capsize=2,
    )
    refused = [point.day for point in points if point.shift_Hz is None]
    if refused:
        low = measured.get_ylim()[0]
        measured.plot(refused, [low] * len(refused), "x", color="0.5", clip_on=False)
        measured.annotate(
            "not told: the test's own load unloads the nut", (refused[0], low), xytext=(-6, -3),
            textcoords="offset points", ha="right", color="0.4", fontsize=8.5,
        )  # fmt: skip
    measured.axhline(0, color="0.6", lw=0.8)
    measured.set_ylabel("change of the\nnatural frequency (Hz)")
    measured.set_title("Measured: mean of all good cells; bars: 95 % of the baseline's scatter")
    preload.plot([p.day for p in points], [100 * p.preload_ratio for p in points], "o-", ms=3, color=_PRELOAD)
    preload.set_ylabel("preload\n(% of $C_a$)")
    preload.set_title("True: preload, which nobody can see")
    backlash.plot([p.day for p in points], [1e6 * p.backlash_m for p in points], "o-", ms=3, color=BACKLASH)
    backlash.set_ylabel("backlash (µm)")
    backlash.set_title("True: backlash, which everybody sees at last")
    backlash.set_xlabel("time (days)")
    first = next((point.day for point in points if point.backlash_m > 0), None)
    for axes in (measured, preload, backlash):
        if alarm_day is not None:
            axes.axvline(alarm_day, color="black", lw=1.1)
        if first is not None:
            axes.axvline(first, color=BACKLASH, lw=1.1, ls="--")
    # Room for the words above the line at 0.
    low, top = measured.get_ylim()
    top += 0.12 * (top - low)
    measured.set_ylim(low, top)
    if alarm_day is not None:
        measured.annotate(
            f"sure: day {alarm_day:g}", (alarm_day, top), xytext=(4, -12), textcoords="offset points"
        )
    if first is not None:
        measured.annotate(
            f"backlash: day {first:g}", (first, top), xytext=(-4, -12), textcoords="offset points",
            ha="right", color=BACKLASH,
        )  # fmt: skip
    figure.subplots_adjust(left=0.13, right=0.965, top=0.955, bottom=0.07, hspace=0.3)
    return figure
