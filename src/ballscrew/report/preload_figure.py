"""The preload of one run: its cells, the terms of its uncertainty, and possible causes of the change."""

from __future__ import annotations

import numpy as np

from ballscrew.base.errors import InputError
from ballscrew.base.quantity import Quantity
from ballscrew.estimation.estimate import PreloadEstimate
from ballscrew.report import canvas
from ballscrew.report.canvas import Axes, Figure
from ballscrew.report.measured import COVERAGE, beside, draw_bars
from ballscrew.report.monitor_figure import labelled_bars

_TERMS = 8
_RANDOM, _SYSTEMATIC = "#56B4E9", "#999999"


@canvas.styled()
def draw_preload(estimate: PreloadEstimate) -> Figure:
    """Draw the preload of one run.

    Parameters
    ----------
    estimate : PreloadEstimate
        An estimate, or a refusal after the cells were combined.

    Returns
    -------
    Figure
        Not yet written. Above the change of the compliance in every cell, with the fit of one preload; below
        the terms of the uncertainty, and the causes.

    Raises
    ------
    InputError
        If the run was refused before there was anything to draw.
    """
    _check_drawable(estimate)
    figure = canvas.blank(9.4, 7.2)
    grid = figure.add_gridspec(2, 2, height_ratios=(1.35, 1), width_ratios=(1, 1.5))
    draw_change(figure.add_subplot(grid[0, :]), estimate)
    _terms(figure.add_subplot(grid[1, 0]), estimate)
    _causes(figure.add_subplot(grid[1, 1]), estimate)
    title = f"{_name(estimate)}\n{_result(estimate)}"
    figure.suptitle(canvas.escape_dollars(title), fontsize=11.5, x=0.01, ha="left", fontweight="bold")
    return figure


def draw_change(axes: Axes, estimate: PreloadEstimate) -> None:
    """Draw the change of the compliance in every cell, with the fit of one preload.

    Parameters
    ----------
    axes : Axes
        Axes to draw on.
    estimate : PreloadEstimate
        An estimate, or a refusal after the cells were combined.

    Raises
    ------
    InputError
        If the run was refused before there was anything to draw, or the estimate is read from its document.
    """
    _check_drawable(estimate)
    _cells(axes, estimate)
    _fit(axes, estimate)


def _check_drawable(estimate: PreloadEstimate) -> None:
    """Refuse an estimate without cells."""
    if estimate.change is None or estimate.fused is None:
        why = "was read from its document, which does not contain the cells"
        if estimate.verdict == "refused":
            why = f"was refused and has nothing to draw: {(*estimate.reasons, 'no reason given')[0]}"
        raise InputError(f"run {estimate.run[:12]} {why}.")


def _name(estimate: PreloadEstimate) -> str:
    """Axis and time of the run, ``"bench, 2026-01-31 08:00"``."""
    name = estimate.axis or "axis"
    if estimate.measured_at:
        name += f", {estimate.measured_at[:16].replace('T', ' ')}"
    return name


def _result(estimate: PreloadEstimate) -> str:
    """Axial stiffness, and the nut's preload relative to the baseline or the model, with their verdicts."""
    stiffness, nut = estimate.stiffness_relative_to_baseline, estimate.relative_to_baseline
    texts, reference = [], "the baseline"
    if stiffness is None:
        nut, reference = estimate.relative_to_model, "the calibrated preload"
    else:
        texts.append(f"axial stiffness as with {_percent(stiffness)} of the preload: {estimate.verdict}")
    if nut is not None:
        texts.append(f"preload of the nut {_percent(nut)} of {reference}: {estimate.nut_verdict}")
    if not texts:
        return f"no preload estimate: {(*estimate.reasons, 'refused')[0]}"
    return "\n".join(texts)


def _percent(ratio: Quantity) -> str:
    """Ratio and its interval in per cent."""
    low, high = ratio.interval
    return f"{100 * ratio.value:.0f} % ({100 * low:.0f} to {100 * high:.0f} %)"


def _cells(axes: Axes, estimate: PreloadEstimate) -> None:
    """Draw the change of the compliance in each cell."""
    change = estimate.change
    assert change is not None  # noqa: S101  checked by the caller
    stops = np.unique(change.position)
    spread = np.sqrt(sum(np.sum(t.effects**2, axis=0) for t in change.terms) + change.floor**2)
    conditions = np.array(change.condition)
    for condition, colour in canvas.CONDITION_COLOURS.items():
        own = conditions == condition
        if not own.any():
            continue
        x = 1e3 * (change.position[own] + beside(stops.tolist(), condition))
        look = {"color": colour, "lw": 1.0, "label": condition}
        half = 100 * COVERAGE * spread[own]
        draw_bars(axes, x, 100 * change.y[own], half, canvas.CONDITION_MARKERS[condition], **look)
    axes.axhline(0.0, color="0.4", lw=0.8)
    axes.set(xlabel="position (mm)", ylabel="change of compliance (%)")
    reference = "the model"
    if estimate.baseline is not None:
        reference = "the baseline"
    axes.set_title(f"Change of each cell from {reference}, 95 % intervals", loc="left")


def _fit(axes: Axes, estimate: PreloadEstimate) -> None:
    """Draw the fit of one preload, and where wear is local."""
    change, fused = estimate.change, estimate.fused
    assert change is not None and fused is not None  # noqa: S101, PT018  checked by the caller
    order = np.argsort(change.position)
    x, nut = 1e3 * change.position[order], 100 * change.nut_share[order]
    half = COVERAGE * fused.spread
    axes.plot(x, fused.level * nut, color=canvas.ANF, lw=1.6, label="fit of one preload")
    axes.fill_between(
        x, (fused.level - half) * nut, (fused.level + half) * nut, color=canvas.ANF, alpha=0.15, lw=0
    )  # fmt: skip
    if estimate.profile is not None and estimate.profile.places:
        places = estimate.profile.places
        edge = np.diff(np.unique(change.position)).min() / 2
        first, last = 1e3 * (places[0] - edge), 1e3 * (places[-1] + edge)
        axes.axvspan(first, last, color="#FCEBDD", zorder=0, label="locally worn")
    axes.legend(ncols=3, fontsize=9)


def _terms(axes: Axes, estimate: PreloadEstimate) -> None:
    for term in estimate.terms[:_TERMS]:
        colour = _SYSTEMATIC
        if term.random:
            colour = _RANDOM
        axes.barh(term.name, term.standard_uncertainty, color=colour)
    axes.invert_yaxis()
    axes.set_title("Terms of the uncertainty", loc="left")
    axes.locator_params(axis="x", nbins=5)
    axes.set_xlabel("standard uncertainty of the stiffness as P/P₀ (1)")
    axes.grid(visible=False, axis="y")
    if estimate.terms:
        entries = [
            canvas.legend_patch("random", fc=_RANDOM),
            canvas.legend_patch("common to all runs", fc=_SYSTEMATIC),
        ]
        axes.legend(handles=entries, fontsize=9, loc="lower right")


def _causes(axes: Axes, estimate: PreloadEstimate) -> None:
    names, values, colours, words = [], [], [], []
    for cause in estimate.causes:
        names.append(cause.name)
        values.append(cause.probability)
        colours.append(canvas.ANF if cause.possible else canvas.REFUSED)
        words.append(cause.text if cause.possible else f"unlikely: {cause.text}")
    labelled_bars(axes, names, values, colours, words)
    axes.set_title("Possible causes of the change", loc="left")
