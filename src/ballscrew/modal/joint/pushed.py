"""Ripple beside the mode: its orders are chosen and all is fitted, until the choice stays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ballscrew.base.arrays import Array
from ballscrew.modal.joint.course import UNTOLD, Course, everywhere
from ballscrew.modal.joint.fit import CLEARLY, Fit
from ballscrew.modal.joint.guess import Guess
from ballscrew.modal.joint.local import Scatter
from ballscrew.modal.joint.model import block, linear
from ballscrew.modal.joint.ripple import of_orders, orders, turning
from ballscrew.modal.joint.shape import FIRST_DAMPING, Shape, compliance
from ballscrew.modal.joint.signals import TripSignals
from ballscrew.modal.joint.start import SCALES
from ballscrew.modal.joint.windows import Windows, every_few

__all__ = ["pushed"]

Told = tuple[Fit, Scatter, tuple[int, ...]]
_TURNS = 3
_MOST = 6  # iterations of a fit
_POORLY = 0.05  # of the power of the response: where more is left, the mode may be a wrong one


def pushed(
    trips: Sequence[TripSignals],
    names: Sequence[str],
    whole: bool,
    guessed: Guess,
    course: Course,
    now: Fit,
    seen: Scatter,
) -> Told:
    """Fit a run with what its motor's ripple does.

    Parameters
    ----------
    trips : sequence of TripSignals
        The run.
    names : sequence of str
        Blocks.
    whole : bool
        Whether departures count from standstill on.
    guessed : Guess
        The lead, and where the mode is sought again if a push was taken for it.
    course : Course
        What is free.
    now, seen : Fit, Scatter
        The run without ripple.

    Returns
    -------
    Fit, Scatter, tuple of int
        The fit, what its priors were made of, and the orders in it.
    """
    w = now.blocks[0].windows
    turns = turning(trips, w, guessed.lead)
    told = _until_they_stay(w, names, whole, turns, course, now.shapes, seen, now)
    if not turns.size or told[0].unexplained(0) < _POORLY:
        return told
    # At constant speed a push is a tone, and may have been taken for the mode.
    few = every_few(w)
    shapes = _hidden(few, names[0], whole, turning(trips, few, guessed.lead), now.shapes, guessed)
    other = _until_they_stay(w, names, whole, turns, course, shapes, UNTOLD, None)
    return other if other[0].left < told[0].left + CLEARLY else told


def _until_they_stay(
    w: Windows,
    names: Sequence[str],
    whole: bool,
    turns: Array,
    course: Course,
    shapes: tuple[Shape, ...],
    seen: Scatter,
    now: Fit | None,
) -> Told:
    chosen: tuple[int, ...] = ()
    for turn in range(_TURNS):
        known, chosen = chosen, orders(names[0], w, whole, shapes[0], turns)
        if now is not None and chosen == known and (turn or not whole):
            break
        forces = of_orders(turns, chosen)
        now, seen = everywhere([block(name, w, whole, forces) for name in names], shapes, course, seen, _MOST)
        shapes = now.shapes
    assert now is not None  # noqa: S101  the first turn fits where nothing was
    return now, seen, chosen


def _hidden(
    w: Windows, name: str, whole: bool, turns: Array, shapes: tuple[Shape, ...], guessed: Guess
) -> tuple[Shape, ...]:
    """The mode that leaves least, wherever it is, each beside the orders that are best there.

    The motor's motion has the ripple in it: what follows it keeps its slope and damping.
    """
    own = shapes[1] if len(shapes) > 1 else replace(shapes[0], slope=guessed.slope, curve=0.0)
    own = replace(own, damping=FIRST_DAMPING, power=0.0, load=guessed.load, places=(), local=())

    def left(one: Shape) -> float:
        forces = of_orders(turns, orders(name, w, whole, one, turns))
        return float(np.sum(linear(block(name, w, whole, forces), one).residual ** 2))

    tried = [replace(own, compliance=compliance(guessed.free * s)) for s in SCALES]
    return (min(tried, key=left), *shapes[1:])
