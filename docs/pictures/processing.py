"""The way from signals to a frequency: Fig. 6 of the paper, and beside it this package."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from docs.pictures.sketch import arrow, bare, box

from ballscrew.report.canvas import CONDITION_COLOURS, blank, styled

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["STEPS", "Step", "draw_processing"]


@dataclass(frozen=True, slots=True)
class Step:
    """One step of the processing.

    Parameters
    ----------
    paper : str
        What the paper does; empty where it has no such step.
    here : str
        Step of this package.
    why : str
        Why that differs; empty where it does not.
    """

    paper: str
    here: str
    why: str = ""


STEPS = (
    Step("torque, acceleration\nat the nut", "torque, position, accelerations\nat the nut, with their units"),
    Step("", "quality: good, suspect or bad", "a bad measurement\ngives no frequency"),
    Step(
        "transients:\ncut off the steady state",
        "transients, sorted into cells:\nposition, condition, motion",
        "labels come from\nthe measurement",
    ),
    Step(
        "",
        "one jerk phase in the window,\nthe one next to standstill",
        "two jerk phases cause\nnulls in the torque",
    ),
    Step("Hann window", "mean removed, Hann window"),
    Step("zero-padding, FFT", "spectra on a fine grid of lines"),
    Step(
        "FRF of each repetition,\nmean of 30 FRFs",
        "$S_{uu}$, $S_{uy}$, $S_{yy}$: mean over repetitions,\nthen FRF $H_1$ and coherence",
        "a ratio diverges where\nthe torque has little power",
    ),
    Step(
        "first peak: $f_a$",
        "first peak in the band that the\ndata sheet predicts, rotor free",
        "a pole of torque to\nacceleration: the motor turns",
    ),
    Step(
        "",
        "checked by phase, coherence\nand the curve along the axis",
        "other peaks are refused,\nwith a reason",
    ),
    Step(
        "",
        "$f_a$ with its uncertainty: repetitions, window,\nmoving table, method, conditions",
        "0.1 % of $f_a$ is about\n2 % of the preload",
    ),
)
_PITCH, _HEIGHT = 0.86, 0.62
_HEAD = 0.5
_LEFT, _MIDDLE, _RIGHT = 1.55, 5.0, 7.25
_WIDTHS = (2.5, 3.6)
_PAPER, _SAME, _CHANGED = "0.94", "white", "#FFF3D6"


def draw_processing() -> Figure:
    """Draw the steps of the paper and of this package side by side.

    Returns
    -------
    Figure
        Not yet written. A step that the paper lacks or does otherwise is yellow and says why.
    """
    height = _PITCH * len(STEPS) + _HEAD
    with styled():
        figure = blank(9.4, 9.4 * height / 9.6)
        axes = figure.subplots()
        bare(axes, 9.6, height)
        heads = ((_LEFT, "The paper, Fig. 6"), (_MIDDLE, "This package"), (_RIGHT + 1.05, "Why it differs"))
        for x, words in heads:
            axes.text(
                x, height - 0.6 * _HEAD, words, ha="center", va="center", fontweight="bold", fontsize=10.5
            )
        above: dict[float, float] = {}
        for index, step in enumerate(STEPS):
            y = height - _HEAD - _PITCH * (index + 0.5)
            for x, width, text in ((_LEFT, _WIDTHS[0], step.paper), (_MIDDLE, _WIDTHS[1], step.here)):
                if not text:
                    continue
                changed = x == _MIDDLE and bool(step.why)
                face = _PAPER if x == _LEFT else _CHANGED if changed else _SAME
                edge = "0.55" if x == _LEFT else CONDITION_COLOURS["NA"] if changed else "0.3"
                box(axes, (x, y), (width, _HEIGHT), text, face=face, edge=edge)
                if x in above:
                    arrow(axes, (x, above[x]), (x, y + _HEIGHT / 2))
                above[x] = y - _HEIGHT / 2
            if step.why:
                axes.text(_RIGHT, y, step.why, fontsize=8.5, va="center", color="0.25", linespacing=1.3)
    return figure
