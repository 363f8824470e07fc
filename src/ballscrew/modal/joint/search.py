"""From a first guess to the fit of a run."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ballscrew.base.arrays import Array
from ballscrew.modal.joint.course import DAMPS, OVER_LOAD, UNTOLD, Course, everywhere
from ballscrew.modal.joint.fit import CLEARLY, FEWER, Fit, fit
from ballscrew.modal.joint.guess import Guess
from ballscrew.modal.joint.local import Scatter
from ballscrew.modal.joint.model import Block, Linear, block, left_over, linear, whitened
from ballscrew.modal.joint.pitching import pitching_mode
from ballscrew.modal.joint.pushed import pushed
from ballscrew.modal.joint.result import Push
from ballscrew.modal.joint.settings import JointSettings
from ballscrew.modal.joint.shape import FIRST_DAMPING, Shape, compliance, frequency
from ballscrew.modal.joint.signals import Mark, TripSignals
from ballscrew.modal.joint.sizes import pushes
from ballscrew.modal.joint.start import starts
from ballscrew.modal.joint.windows import every_few, windows

__all__ = ["Found", "search"]

_PITCHES = np.geomspace(1.25, 2.5, 15)  # pitching mode over the axial one
_NEAR = np.array([0.92, 0.95, 0.975, 1.0, 1.025, 1.05, 1.08])
_KICK = 2.0  # residual after a departure over that elsewhere: friction is seen there
_AFTER_KICK = (0.006, 0.015)  # s before and after it
_WORN = 10.0  # times the load over the preload of a new nut


@dataclass(frozen=True, slots=True)
class Found:
    """The last fit and what led to it.

    Parameters
    ----------
    fit, plain : Fit
        The last one, and the one before its residual was whitened.
    whole : bool
        Whether departures count from standstill on.
    seen : Scatter
        What the last fit's priors were made of.
    load : float
        Load on the nut over its preload as the data sheet has it, per m/s² of the table; 0 without a sheet.
    pushes : tuple of Push
        Forces of the motor that were told beside the mode.
    """

    fit: Fit
    plain: Fit
    whole: bool
    seen: Scatter
    load: float
    pushes: tuple[Push, ...] = ()


def search(
    trips: Sequence[TripSignals],
    marks: Sequence[Mark],
    mass: float,
    guessed: Guess,
    names: Sequence[str],
    settings: JointSettings,
    curved: bool,
) -> Found | None:
    """Fit a run.

    Parameters
    ----------
    trips, marks
        The run.
    mass : float
        Whole mass, in units of force per m/s².
    guessed : Guess
        Where to begin.
    names : sequence of str
        Blocks.
    settings : JointSettings
        Settings.
    curved : bool
        Whether the compliance may have a curve, as on a screw that both ends hold.

    Returns
    -------
    Found or None
        None where no window is left.
    """
    centre = guessed.free
    shapes: tuple[Shape, ...] = tuple(
        Shape(
            compliance(f),
            guessed.slope,
            0.0,
            FIRST_DAMPING,
            guessed.load,
            guessed.nut,
            guessed.rubbing,
            1.8 * centre,
            0.03,
        )
        for f in (guessed.held if name == "motor-nut" else guessed.free for name in _first(names))
    )
    ratios = _PITCHES
    blocks: list[Block] = []
    w = None
    for turn in range(2):
        w = windows(trips, marks, mass, settings.band_low * centre, settings.band_high * centre)
        if w is None:
            return None
        blocks = [block(name, w, whole=False) for name in _first(names)]
        if turn == 0:
            told = pitching_mode(w, 1.2 * centre, settings.band_high * centre)
            few = every_few(w)
            shapes = starts([block(name, few, whole=False) for name in _first(names)], shapes, told)
            if told:
                ratios = told[0] / centre * _NEAR
        now = fit(blocks, shapes, ("compliance", "damping", "slope"), most=6)
        centre = float(frequency(now.shapes[0], np.zeros(1))[0])
        shapes = _repitched(blocks, now.shapes, ratios * (1 if turn or not told else guessed.free / centre))
        ratios = shapes[0].pitch / centre * _NEAR
    assert w is not None  # noqa: S101  two turns were made
    blocks = [block(name, w, whole=False) for name in names]
    course = Course(curved, guessed.load)
    shapes = _worn_or_not([block(name, every_few(w), whole=False) for name in names], shapes, course)
    now, seen = everywhere(blocks, shapes, course, UNTOLD, 8)
    whole = all(_kick(b, s) < _KICK for b, s in zip(blocks, now.solved, strict=True))
    now, seen, chosen = pushed(trips, names, whole, guessed, course, now, seen)
    blocks = [
        whitened(b, s.residual, settings.motor_floor if b.name == "torque-motor" else settings.floor)
        if b.name != "motor-nut"
        else b
        for b, s in zip(now.blocks, now.solved, strict=True)
    ]
    last, seen = everywhere(blocks, now.shapes, course, seen, 8)
    return Found(last, now, whole, seen, guessed.load, pushes(last, chosen, guessed.lead))


def _first(names: Sequence[str]) -> Sequence[str]:
    """The blocks that find the modes, one for each."""
    return names[:2]


def _worn_or_not(blocks: Sequence[Block], shapes: tuple[Shape, ...], course: Course) -> tuple[Shape, ...]:
    """Where to start.

    A nut that the test unloads is stiffer at its peaks than at rest, and no small step of a fit that begins
    with a new nut leads there.
    """
    if not course.load > 0:
        return shapes
    wide = math.sqrt(FEWER / OVER_LOAD)
    priors = [*(replace(p, deviation=p.deviation * wide) for p in course.priors), DAMPS]
    worn = tuple(replace(s, load=_WORN * s.load) for s in shapes)
    new, then = (fit(blocks, one, course.fields, priors) for one in (shapes, worn))
    return (then if then.left < new.left + CLEARLY else new).shapes


def _repitched(blocks: Sequence[Block], shapes: Sequence[Shape], ratios: Array) -> tuple[Shape, ...]:
    """The pitching mode that leaves least, with the axial one as it is."""
    centre = float(frequency(shapes[0], np.zeros(1))[0])
    solved = [linear(b, shape) for b, shape in zip(blocks, shapes, strict=True)]

    def left(f: float) -> float:
        tried = [replace(shape, pitch=f) for shape in shapes]
        parts = [left_over(*one)[0] for one in zip(blocks, tried, solved, strict=True)]
        return sum(math.log(max(part, 1e-300)) for part in parts)

    best = min((float(r) * centre for r in ratios), key=left)
    return tuple(replace(s, pitch=best) for s in shapes)


def _kick(b: Block, solved: Linear) -> float:
    """What departures from standstill leave unexplained, over what is left elsewhere."""
    w = b.windows
    missed = b.target - solved.model
    departing = np.zeros(len(w.place), bool)
    for (start, stop), cell in zip(w.spans, w.cells, strict=True):
        if cell[1].endswith("A"):
            gone = start + int(np.argmax(w.late[start:stop]))
            first, last = (round(t * w.rate) for t in _AFTER_KICK)
            departing[max(start, gone - first) : min(stop, gone + last)] = True
    there, elsewhere = departing & w.early, w.late & ~departing
    if not there.any() or not elsewhere.any():
        return math.inf
    return float(np.sqrt(np.mean(missed[there] ** 2) / max(float(np.mean(missed[elsewhere] ** 2)), 1e-300)))
