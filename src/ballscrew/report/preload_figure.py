"""How much preload is left: what the cells say, what of the uncertainty is what, and what else it may be."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ballscrew.base.errors import InputError
from ballscrew.estimation.estimate import PreloadEstimate
from ballscrew.report.canvas import blank, styled
from ballscrew.report.measured import COVERAGE, beside
from ballscrew.report.style import ANF, CONDITION_COLOURS, CONDITION_MARKERS, REFUSED

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["draw_preload"]

_TERMS = 8
_RANDOM, _SYSTEMATIC = "#56B4E9", "#999999"


def draw_preload(estimate: PreloadEstimate) -> Figure:
    """Draw the preload of one run.

    Parameters
    ----------
    estimate : PreloadEstimate
        Told, or refused after its cells were fused.

    Returns
    -------
    Figure
        Not yet written. Above the change of the compliance in every cell, with what one preload makes of it;
        below the parts of the uncertainty, and the causes.

    Raises
    ------
    InputError
        If the run was refused before there was anything to draw.
    """
    if estimate.change is None or estimate.fused is None:
        raise InputError(
            f"run {estimate.run[:12]} was refused and has nothing to draw: {estimate.reasons[0]}."
        )
    with styled():
        figure = blank(9.4, 7.2)
        grid = figure.add_gridspec(2, 2, height_ratios=(1.35, 1))
        _cells(figure.add_subplot(grid[0, :]), estimate)
        _parts(figure.add_subplot(grid[1, 0]), estimate)
        _causes(figure.add_subplot(grid[1, 1]), estimate)
        figure.suptitle(_title(estimate), fontsize=11.5, x=0.01, ha="left", fontweight="bold")
    return figure


def _title(estimate: PreloadEstimate) -> str:
    ratio = estimate.relative_to_baseline or estimate.relative_to_model
    if ratio is None:
        return "The preload was not told: " + (estimate.reasons[0] if estimate.reasons else "refused")
    low, high = ratio.interval
    name = "P/P₀" if estimate.relative_to_baseline is not None else "P over the model's"
    force = estimate.preload_N
    newtons = (
        "newtons not told"
        if force is None
        else f"P = {force.value:.0f} N, {force.interval[0]:.0f} to {force.interval[1]:.0f} N"
    )
    return f"{name} = {ratio.value:.2f}, 95 %: {low:.2f} to {high:.2f};  {newtons}  ({estimate.verdict})"


def _cells(axes: Axes, estimate: PreloadEstimate) -> None:
    change, fused = estimate.change, estimate.fused
    assert change is not None and fused is not None  # noqa: S101, PT018  asked for before
    stops = np.unique(change.position)
    spread = np.sqrt(sum(np.sum(t.effects**2, axis=0) for t in change.terms) + change.floor**2)
    for condition, colour in CONDITION_COLOURS.items():
        mine = np.flatnonzero([c == condition for c in change.condition])
        if not mine.size:
            continue
        x = 1e3 * (change.position[mine] + beside(stops.tolist(), condition))
        axes.errorbar(
            x, 100 * change.y[mine], yerr=100 * COVERAGE * spread[mine], fmt=CONDITION_MARKERS[condition],
            color=colour, ms=4.5, lw=1.0, capsize=2, label=condition,
        )  # fmt: skip
    order = np.argsort(change.position)
    x, nut = 1e3 * change.position[order], change.nut[order]
    half = COVERAGE * fused.spread
    axes.plot(x, 100 * fused.level * nut, color=ANF, lw=1.6, label="one preload")
    axes.fill_between(
        x, 100 * (fused.level - half) * nut, 100 * (fused.level + half) * nut, color=ANF, alpha=0.15, lw=0
    )
    if estimate.along is not None and estimate.along.places:
        places = estimate.along.places
        edge = 1e3 * float(np.min(np.diff(stops))) / 2
        axes.axvspan(
            1e3 * places[0] - edge, 1e3 * places[-1] + edge, color="#FCEBDD", zorder=0, label="locally worn"
        )
    axes.axhline(0.0, color="0.4", lw=0.8)
    axes.set(xlabel="position (mm)", ylabel="growth of the compliance (%)")
    against = "the baseline" if estimate.baseline is not None else "the model"
    axes.set_title(f"What the cells say against {against}, with 95 % intervals", loc="left")
    axes.legend(ncols=3, fontsize=9)


def _parts(axes: Axes, estimate: PreloadEstimate) -> None:
    from matplotlib.patches import Patch

    terms = estimate.terms[:_TERMS][::-1]
    axes.barh(
        [term.name for term in terms],
        [term.standard_uncertainty for term in terms],
        color=[_RANDOM if term.random else _SYSTEMATIC for term in terms],
    )
    axes.set_title("What the uncertainty is made of", loc="left")
    axes.locator_params(axis="x", nbins=5)
    axes.set_xlabel("standard uncertainty of P over its reference")
    axes.grid(visible=False, axis="y")
    if terms:
        entries = [Patch(fc=_RANDOM, label="random"), Patch(fc=_SYSTEMATIC, label="in every run")]
        axes.legend(handles=entries, fontsize=9, loc="lower right")


def _causes(axes: Axes, estimate: PreloadEstimate) -> None:
    causes = estimate.causes[::-1]
    axes.barh(
        [cause.name for cause in causes],
        [cause.probability for cause in causes],
        color=[ANF if cause.possible else REFUSED for cause in causes],
    )
    for row, cause in enumerate(causes):
        if cause.possible:
            inside = cause.probability > 0.6
            axes.text(
                cause.probability + (-0.015 if inside else 0.015), row, cause.text, fontsize=8, va="center",
                ha="right" if inside else "left", color="white" if inside else "black",
            )  # fmt: skip
    axes.set(xlim=(0, 1), xlabel="probability")
    axes.set_title("What may explain the change", loc="left")
    axes.grid(visible=False, axis="y")
