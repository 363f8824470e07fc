"""From a first guess to the fit of a run."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ballscrew.modal.joint.fit import FEWER, Fit, Prior, fit, with_places
from ballscrew.modal.joint.guess import Guess
from ballscrew.modal.joint.local import Scatter, placed, priors, scatter, with_local
from ballscrew.modal.joint.model import Block, block, linear, raw_columns, whitened
from ballscrew.modal.joint.pitching import pitching_mode
from ballscrew.modal.joint.ripple import of_orders, orders, turning
from ballscrew.modal.joint.settings import JointSettings
from ballscrew.modal.joint.shape import Shape, frequency
from ballscrew.modal.joint.signals import Mark, TripSignals
from ballscrew.modal.joint.start import starts
from ballscrew.modal.joint.uncertainty import overdone
from ballscrew.modal.joint.windows import Windows, of_cells, windows

__all__ = ["Found", "search"]

Array = NDArray[np.float64]
_FIRST_DAMPING = 0.03
_PITCHES = np.geomspace(1.25, 2.5, 15)  # pitching mode over the axial one
_NEAR = np.array([0.92, 0.95, 0.975, 1.0, 1.025, 1.05, 1.08])
_KICK = 2.0  # residual after a departure over that elsewhere: friction is seen there
_AFTER_KICK = (0.006, 0.015)  # s before and after it
_START_CELLS = 12
_LOAD_SPREAD = 0.35  # of the logarithm of the load over the preload, about the data sheet's
_WORN_SPREAD = 1.0  # the same where single stops stand out
_TURNS = 3
_SETTLED = 0.25  # of the logarithm of what a turn may still change
_DAMPS = Prior((("power", 1.0),), 0.5, 0.7)  # springs 1, hysteresis 0, the guide -1
_WORN = 10.0  # times the load over the preload of a new nut
_CLEARLY = 0.8  # of the residual: less is taken for a nut that has no preload to speak of
_OVER, _OVER_LOAD = 100.0, 1000.0  # before the run has told


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
    """

    fit: Fit
    plain: Fit
    whole: bool
    seen: Scatter
    load: float


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
            _compliance(f),
            guessed.slope,
            0.0,
            _FIRST_DAMPING,
            guessed.load,
            guessed.nut,
            guessed.rubbing,
            1.8 * centre,
            0.03,
        )
        for f in (guessed.held if name == "motor-nut" else guessed.free for name in _first(names))
    )
    fields = ("compliance", "damping", "slope", *(("curve",) if curved else ()))
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
            few = _some(w)
            shapes = starts([block(name, few, whole=False) for name in _first(names)], shapes, told)
            if told:
                ratios = told[0] / centre * _NEAR
        now = fit(blocks, shapes, fields[:3], most=6)
        centre = float(frequency(now.shapes[0], np.zeros(1))[0])
        shapes = _repitched(blocks, now.shapes, ratios * (1 if turn or not told else guessed.free / centre))
        ratios = shapes[0].pitch / centre * _NEAR
    assert w is not None  # noqa: S101  two turns were made
    blocks = [block(name, w, whole=False) for name in names]
    shapes = _worn_or_not([block(name, _some(w), whole=False) for name in names], shapes, fields, guessed)
    now, seen = _everywhere(blocks, shapes, fields, Scatter(0.0, _OVER), guessed, 8)
    whole = all(
        _kick(b, s.weights, shape) < _KICK for b, s, shape in zip(blocks, now.solved, now.shapes, strict=True)
    )
    turns = turning(trips, w, guessed.lead)
    pushing: tuple[int, ...] = ()
    for turn in range(_TURNS):
        known, pushing = pushing, orders(names[0], w, whole, now.shapes[0], turns)
        if pushing == known and (turn or not whole):
            break
        pushes = of_orders(turns, pushing)
        blocks = [block(name, w, whole, pushes) for name in names]
        now, seen = _everywhere(blocks, now.shapes, fields, seen, guessed, 6)
    blocks = [
        whitened(b, s.residual, settings.motor_floor if b.name == "torque-motor" else settings.floor)
        if b.name != "motor-nut"
        else b
        for b, s in zip(blocks, now.solved, strict=True)
    ]
    last, seen = _everywhere(blocks, now.shapes, fields, seen, guessed, 8)
    return Found(last, now, whole, seen, guessed.load)


def _first(names: Sequence[str]) -> Sequence[str]:
    """The blocks that find the modes, one for each."""
    return names[:2]


def _worn_or_not(
    blocks: Sequence[Block], shapes: tuple[Shape, ...], fields: tuple[str, ...], guessed: Guess
) -> tuple[Shape, ...]:
    """Where to start: a nut that the test unloads is stiffer at its peaks than at rest, and no small step of
    a fit that begins with a new nut leads there.
    """
    if not guessed.load > 0:
        return shapes
    fields, known = _as_built(fields, guessed)
    wide = [replace(p, deviation=p.deviation * math.sqrt(FEWER / _OVER_LOAD)) for p in known]
    worn = tuple(replace(s, load=_WORN * s.load) for s in shapes)
    new, then = (fit(blocks, one, fields, [*wide, _DAMPS]) for one in (shapes, worn))
    return (then if _left(then) < _left(new) + math.log(_CLEARLY) else new).shapes


def _as_built(fields: tuple[str, ...], guessed: Guess) -> tuple[tuple[str, ...], list[Prior]]:
    """The fields of a whole fit, and what the data sheet says of the load on the nut."""
    if not guessed.load > 0:
        return (*fields, "power"), []
    return (*fields, "load", "power"), [Prior((("load", 1.0),), math.log(guessed.load), _LOAD_SPREAD)]


def _everywhere(
    blocks: Sequence[Block],
    shapes: tuple[Shape, ...],
    fields: tuple[str, ...],
    seen: Scatter,
    guessed: Guess,
    most: int,
) -> tuple[Fit, Scatter]:
    """Fit the smooth course, and what departs from it at single stops where the run shows such."""
    w = blocks[0].windows
    places = tuple(sorted({cell[0] - w.middle for cell in w.cells}))
    curved = "curve" in fields
    fields, known = _as_built(fields, guessed)
    before, over = seen, _OVER_LOAD
    for _ in range(_TURNS):
        # A screw that is worn here and there is no new one.
        wide = math.sqrt(FEWER / over) * (_WORN_SPREAD / _LOAD_SPREAD if seen.spread > 0 else 1.0)
        weighed = [replace(p, deviation=p.deviation * wide) for p in known] + [_DAMPS]
        if seen.spread > 0:
            shapes = shapes if shapes[0].local else placed(shapes, places)
            now = fit(
                blocks, shapes, with_local(fields, places), weighed + priors(seen, places, curved), most=4
            )
        else:
            shapes = tuple(replace(s, places=(), local=()) for s in shapes)
            now = fit(blocks, shapes, fields, weighed, most=most)
        shapes, before = now.shapes, seen
        held = over
        if known:
            over = overdone(now, now.keys.index(("load", None)))
        parts = now
        if before.spread == 0:
            parts = with_places(now, placed(now.shapes, places), with_local((), places))
        seen = scatter(parts, curved)
        even = seen.spread == 0 or abs(math.log(seen.spread / max(before.spread, 1e-9))) < _SETTLED
        if even and abs(math.log(over / held)) < 2 * _SETTLED:
            break
    return now, replace(before, tied=FEWER / weighed[0].deviation ** 2 if known else 0.0)


def _left(found: Fit) -> float:
    """Logarithm of what is left, over all blocks."""
    return sum(math.log(max(found.unexplained(i), 1e-300)) / 2 for i in range(len(found.blocks)))


def _compliance(f: float) -> float:
    return 1 / (2 * math.pi * f) ** 2


def _some(w: Windows) -> Windows:
    """Every so many cells, for a first look."""
    step = max(1, len(w.cells) // _START_CELLS)
    if step % 2 == 0:
        step += 1  # or conditions would be left out
    picked = range(0, len(w.cells), step)
    return of_cells(w, picked)


def _repitched(blocks: Sequence[Block], shapes: Sequence[Shape], ratios: Array) -> tuple[Shape, ...]:
    """The pitching mode that leaves least, with the axial one as it is."""
    centre = float(frequency(shapes[0], np.zeros(1))[0])

    def left(f: float) -> float:
        tried = [linear(b, replace(s, pitch=f)) for b, s in zip(blocks, shapes, strict=True)]
        return sum(math.log(max(float(np.sum(t.residual**2)), 1e-300)) for t in tried)

    best = min((float(r) * centre for r in ratios), key=left)
    return tuple(replace(s, pitch=best) for s in shapes)


def _kick(b: Block, weights: Array, shape: Shape) -> float:
    """What departures from standstill leave unexplained, over what is left elsewhere."""
    w = b.windows
    missed = b.target - raw_columns(b, shape) @ weights
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
