"""The fit of a course along the axis, smooth or with single stops that stand out of it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from ballscrew.modal.joint.fit import FEWER, Fit, Prior, fit, with_places
from ballscrew.modal.joint.local import Scatter, placed, priors, scatter, with_local
from ballscrew.modal.joint.model import Block
from ballscrew.modal.joint.shape import Shape
from ballscrew.modal.joint.uncertainty import overdone

__all__ = ["DAMPS", "OVER_LOAD", "UNTOLD", "Course", "everywhere"]

_LOAD_SPREAD = 0.35  # of the logarithm of the load over the preload, about the data sheet's
_WORN_SPREAD = 1.0  # the same where single stops stand out
_TURNS = 3
_SETTLED = 0.25  # of the logarithm of what a turn may still change
DAMPS = Prior((("power", 1.0),), 0.5, 0.7)
"""Of the damping's power of the frequency: springs have 1, hysteresis 0, the guide -1."""
OVER_LOAD = 1000.0
"""Variance of what cells tell of the load over that of white noise, before the run has told."""
UNTOLD = Scatter(0.0, 100.0)
"""What is taken for what a run shows before it has shown anything."""


@dataclass(frozen=True, slots=True)
class Course:
    """What may change along the axis.

    Parameters
    ----------
    curved : bool
        Whether the compliance may have a curve.
    load : float
        On the nut over its preload as the data sheet has it, per m/s² of the table; 0 without a sheet.
    """

    curved: bool
    load: float

    @property
    def fields(self) -> tuple[str, ...]:
        """Of Shape, those that a whole fit frees."""
        own = ("compliance", "damping", "slope", *(("curve",) if self.curved else ()))
        return (*own, *(("load",) if self.load > 0 else ()), "power")

    @property
    def priors(self) -> list[Prior]:
        """What the data sheet says of the load on the nut."""
        return [Prior((("load", 1.0),), math.log(self.load), _LOAD_SPREAD)] if self.load > 0 else []


def everywhere(
    blocks: Sequence[Block], shapes: tuple[Shape, ...], course: Course, seen: Scatter, most: int
) -> tuple[Fit, Scatter]:
    """Fit the smooth course, and what departs from it at single stops where the run shows such.

    Parameters
    ----------
    blocks : sequence of Block
        Data.
    shapes : tuple of Shape
        Where to start.
    course : Course
        What is free.
    seen : Scatter
        What the run has shown so far.
    most : int
        Iterations.

    Returns
    -------
    Fit
        The last.
    Scatter
        What its priors were made of.
    """
    w = blocks[0].windows
    places = tuple(sorted({cell[0] - w.middle for cell in w.cells}))
    curved, fields, known = course.curved, course.fields, course.priors
    before, over = seen, OVER_LOAD
    for _ in range(_TURNS):
        # A screw that is worn here and there is no new one.
        wide = math.sqrt(FEWER / over) * (_WORN_SPREAD / _LOAD_SPREAD if seen.spread > 0 else 1.0)
        weighed = [replace(p, deviation=p.deviation * wide) for p in known] + [DAMPS]
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
