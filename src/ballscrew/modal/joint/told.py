"""What a fit tells of every cell, how sure it is, and what the cells' errors have in common."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ballscrew.base.arrays import Array
from ballscrew.modal.joint.fit import Fit
from ballscrew.modal.joint.local import kinks, shrinkage
from ballscrew.modal.joint.merge import Merged, merged
from ballscrew.modal.joint.model import block, linear
from ballscrew.modal.joint.result import Cause, CellEstimate, JointResult
from ballscrew.modal.joint.search import Found
from ballscrew.modal.joint.settings import JointSettings
from ballscrew.modal.joint.shape import damping, frequency
from ballscrew.modal.joint.signals import Mark
from ballscrew.modal.joint.softening import held_to_new, mass_over_preload
from ballscrew.modal.joint.uncertainty import deviations, nut_loads
from ballscrew.modal.unsure import unsure

__all__ = ["refused", "told"]

_CERTAIN = 0.003  # of the frequency: a larger standard uncertainty makes a cell suspect
_LEAST_DAMPING, _MOST_DAMPING = 0.004, 0.25
_FOREIGN, _KNOWN = 0.1, 0.1  # of the response, left by the torque; of that, left by the motor's motion too
_MOST_FOREIGN, _TONE = 0.3, 0.015  # of the response; ratio of damping of a mode that may then be no tone
_DROWNED = 1.0  # power of what the ripple does, over that of what the torque does
_ASTRAY = 0.025  # of the frequency, by the part in amplitude: what whole orders miss of one between them
_SEEN = 1e-4  # of the response: less that is missed counts for nothing
_UNLOADED = 2.0  # load on the nut over its preload from which a cell is suspect
_LEFT = 0.5  # of the half-width, by the part of the power that is left
_ENCODER = 0.6  # of what the motor's motion leaves: forces, and not noise
_BETWEEN = 0.06  # of how far a stop stands out of those beside it
_CELLS = math.sqrt(0.5)  # of what the scatter of cells tells: that of conditions has most of it too
_WORN = 0.008  # of the frequency, by the share and the square of the load
_LAW = 5e-4  # of the frequency, by the nut's share and its load, or its square above the preload: of the law

_ENOUGH = 3  # repetitions: of two, what they share by chance is told by no scatter
_ONCE = "it was measured once: what comes by chance in all cells alike cannot be told from the axis"
_TWICE = "it was measured twice: what both share by chance in all cells alike cannot be told from the axis"


@dataclass(frozen=True, slots=True)
class _Term:
    """A part of the uncertainty: effects on every cell, shape (causes, cells), Hz."""

    name: str
    repeats: bool
    effects: Array

    @property
    def size(self) -> Array:
        return np.asarray(np.sqrt(np.sum(self.effects**2, axis=0)))


def refused(marks: Sequence[Mark], reason: str) -> JointResult:
    """Every cell of a run, refused for one reason.

    Parameters
    ----------
    marks : sequence of Mark
        The run.
    reason : str
        In words.

    Returns
    -------
    JointResult
        Without a frequency.
    """
    counts: dict[tuple[float, str, int], int] = {}
    for m in marks:
        key = (m.position, str(m.condition), m.motion)
        counts[key] = counts.get(key, 0) + 1
    return JointResult(tuple(_empty(k, n, reason) for k, n in sorted(counts.items())), (reason,))


def _empty(key: tuple[float, str, int], count: int, reason: str) -> CellEstimate:
    return CellEstimate(*key, count, *(None,) * 7, (), "refused", (reason,))


def told(
    found: Found, marks: Sequence[Mark], settings: JointSettings, response: str, least: float
) -> JointResult:
    """Every cell of a run, with its uncertainty or the reason why there is none.

    Parameters
    ----------
    found : Found
        The fit.
    marks : sequence of Mark
        The run.
    settings : JointSettings
        Settings.
    response : str
        What answers.
    least : float
        Least load on the nut over its preload that the data sheet allows at this frequency, per m/s².

    Returns
    -------
    JointResult
        All cells that were marked.
    """
    last = found.fit
    w = last.blocks[0].windows
    shape = last.shapes[0]
    lost = tuple((b.name, last.unexplained(i)) for i, b in enumerate(last.blocks))
    refusal = _why_not(found, settings)
    if refusal:
        return _refused(marks, refusal, found)
    place = np.array([cell[0] for cell in w.cells]) - w.middle
    reach = max(float(np.ptp(place)), 0.05)
    whole, plain = (merged(f, shrinkage(f, found.seen), settings.slopes, reach) for f in (last, found.plain))
    free, terms = _curve(whole, plain, 0, place, settings)
    zero, zero_sd = _zero(found, free)
    ratios = damping(shape, free)
    if len(last.blocks) > 1:
        held, held_terms = _curve(whole, plain, 1, place, settings)
        # The encoder's noise is an error of the motor's motion as a drive; the torque's zero has it not.
        held_sd = np.hypot(_total(held_terms), np.abs(held - zero) / 3)
    else:
        held, held_sd = zero, np.sqrt(zero_sd**2 + (_total(terms) * zero / free) ** 2)
        held_sd = np.hypot(held_sd, settings.held_floor * held)
    # Where the motor's own motion is mostly noise, as by a coarse encoder, neither way tells the zero.
    if any(
        found.plain.unexplained(i) > settings.most_unexplained
        for i, b in enumerate(last.blocks)
        if b.name != "torque-nut"
    ):
        held_sd = np.full_like(held, np.inf)
    off, off_sd = deviations(last, 0)
    # Every cell says how far it alone is off the smooth course.
    off = off + frequency(shape, place) - frequency(replace(shape, places=(), local=()), place)
    loads, shares = nut_loads(last)
    loads = loads * max(1.0, least / shape.load if shape.load > 0 else 0.0)
    # A nut may be worn evenly and the load on it too small to tell: that would soften by its square.
    worn = _WORN * held_to_new(last, found.seen) * loads**2
    law = _LAW * loads * np.maximum(loads, 1.0)
    terms.append(_Term("load", False, (np.hypot(law, worn) * shares * free)[None]))
    if any(push.between for push in found.pushes) and _missed(found.plain) > _SEEN:
        terms.append(_Term("ripple", False, _ASTRAY * math.sqrt(_missed(found.plain)) * free[None]))
    total = _total(terms)
    wide = (total > settings.most_uncertainty * free) | (loads > settings.most_load)
    if np.mean(wide) > 0.5:
        worst = int(
            np.argmax(np.maximum(total / settings.most_uncertainty / free, loads / settings.most_load))
        )
        doubt = _doubts(float(loads[worst]), float(total[worst]), float(free[worst]), settings)[0]
        return _refused(marks, doubt, found)
    cells, foreign = {}, (*_foreign(found.plain), *_drowned(found.plain))
    for i, key in enumerate(w.cells):
        u = float(total[i])
        parts = tuple((t.name, float(t.size[i])) for t in terms)
        base = (*key, int(w.repetitions[i]))
        why = _doubts(float(loads[i]), u, float(free[i]), settings)
        if w.repetitions[i] < _ENOUGH:
            why = (*why, _ONCE if w.repetitions[i] == 1 else _TWICE)
        why = (*why, *foreign)
        if wide[i]:
            cells[key] = CellEstimate(*base, *(None,) * 7, parts, "refused", why)
            continue
        cells[key] = CellEstimate(
            *base,
            float(free[i]),
            u,
            float(held[i]) if np.isfinite(held_sd[i]) else None,
            float(held_sd[i]) if np.isfinite(held_sd[i]) else None,
            float(ratios[i]),
            None if w.turning[i] else float(off[i]),
            None if w.turning[i] else float(off_sd[i]),
            parts,
            "suspect" if why else "good",
            why,
        )
    for cell in refused(marks, "no two of its transients could be laid on one another").cells:
        cells.setdefault((cell.position, cell.condition, cell.motion), cell)
    order = sorted(cells)
    row = {key: i for i, key in enumerate(w.cells) if not wide[i]}
    return JointResult(
        tuple(cells[key] for key in order),
        (),
        shape.damping,
        None if response == "motor" or len(last.blocks) == 1 else shape.pitch,
        lost,
        (w.band.low, w.band.high),
        tuple(
            Cause(t.name, t.repeats, tuple(float(e[row[key]]) if key in row else 0.0 for key in order))
            for t in terms
            for e in t.effects
        ),
        mass_over_preload(last, found.seen, found.load),
        found.pushes,
    )


def _refused(marks: Sequence[Mark], reason: str, found: Found) -> JointResult:
    """A run that was fitted, refused: its orders are told, and no sizes."""
    orders = tuple(replace(push, size=None, uncertainty=None) for push in found.pushes)
    return replace(refused(marks, reason), pushes=orders)


def _doubts(load: float, u: float, f: float, settings: JointSettings) -> tuple[str, ...]:
    why = []
    if load > min(_UNLOADED, settings.most_load):
        why.append(f"the test's own load unloads the nut: it is {load:.1f} times the preload left")
    passed = [most for most in (settings.most_uncertainty, _CERTAIN) if u > most * f]
    if passed:
        why.append(unsure(u, passed[0]))
    return tuple(why)


def _missed(found: Fit) -> float:
    """Part of the response that the torque leaves and the motor's motion, where it tells, does not."""
    lost = {b.name: found.unexplained(i) for i, b in enumerate(found.blocks)}
    return max(found.unexplained(0) - lost.get("motor-nut", 0.0), 0.0)


def _drowned(found: Fit) -> tuple[str, ...]:
    """The doubt of a run in which ripple moves more than the torque does."""
    solved, count = found.solved[0], found.blocks[0].ripple.shape[1]
    if not count:
        return ()
    some = slice(solved.columns.shape[1] - count, None)
    pushed = float(np.sum((solved.columns[:, some] @ solved.weights[some]) ** 2))
    made = float(np.sum((solved.columns[:, :-count] @ solved.weights[:-count]) ** 2))
    if pushed < _DROWNED * made:
        return ()
    return ("what repeats with every turn moves the axis more than the torque does",)


def _foreign(found: Fit) -> tuple[str, ...]:
    """The doubt of a run in which the nut follows the motor, and the motor not the torque."""
    lost = {b.name: found.unexplained(i) for i, b in enumerate(found.blocks)}
    torque, motion = lost.get("torque-nut", 0.0), lost.get("motor-nut", math.inf)
    if torque < _FOREIGN or motion > _KNOWN * torque:
        return ()
    said = (
        f"the torque leaves {100 * torque:.0f} % of the nut's response unexplained, the motor's own motion "
        f"{100 * motion:.1f} %: a force at the motor was not measured, or the torque holds what is none"
    )
    return (said,)


def _why_not(found: Found, settings: JointSettings) -> str | None:
    last = found.fit
    shape, w = last.shapes[0], last.blocks[0].windows
    lost = last.unexplained(0)
    if not math.isfinite(lost) or lost > settings.most_unexplained:
        share = 100 * (1 - min(lost, 1)) if math.isfinite(lost) else 0.0
        return f"a mode along the axis explains only {share:.0f} % of the response in the band"
    ends = frequency(shape, np.array([w.place.min(), w.place.max()]))
    if not (ends > 1.05 * w.band.low).all() or not (ends < 0.8 * w.band.high).all():
        return f"the mode found, {ends[1]:.0f} to {ends[0]:.0f} Hz, lies at the edge of where it was sought"
    if shape.damping > _MOST_DAMPING:
        return f"the mode found has a damping ratio of {shape.damping:.2f}: that is none"
    foreign = _foreign(found.plain)
    if foreign and (found.plain.unexplained(0) > _MOST_FOREIGN or shape.damping < _TONE):
        return foreign[0]
    if shape.damping < _LEAST_DAMPING:
        return (
            f"the mode found has a damping ratio of {shape.damping:.4f}: that is a force which repeats, as "
            "the motor's ripple does, and not the axis"
        )
    return None


def _curve(
    whole: Merged, plain: Merged, mode: int, place: Array, settings: JointSettings
) -> tuple[Array, list[_Term]]:
    f = whole.curve(mode, place)
    shape = whole.fit.shapes[mode]
    blocks = whole.fit.blocks
    # What the motor's motion leaves is in part the noise of its encoder.
    most = max(
        (_ENCODER if b.mode else 1.0) * whole.fit.unexplained(i)
        for i, b in enumerate(blocks)
        if i == 0 or b.mode
    )
    left = _LEFT * most * shape.damping
    return f, [
        # The scatter of cells does not show what conditions share, nor theirs what cells do: both count.
        _Term("noise", False, _CELLS * whole.effects(mode, place, "noise")),
        _Term("conditions", False, whole.effects(mode, place, "conditions")),
        _Term("weights", True, (f - plain.curve(mode, place))[None] / 2),
        _Term("drives", True, (f - frequency(shape, place))[None] / 2),
        _Term("model", True, (settings.held_floor if mode else settings.model_floor) * f[None]),
        # What is left may be a force that nobody measured, which rings as the mode does.
        _Term("left", False, left * f[None]),
        # Between stops the course of a local part is not known, and a cell's window moves there.
        _Term("local", False, _BETWEEN / 2 * f[None] * kinks(whole.fit.shapes[0], place)),
    ]


def _total(terms: Sequence[_Term]) -> Array:
    return np.asarray(np.sqrt(sum((t.size**2 for t in terms), np.zeros(()))))


def _zero(found: Found, free: Array) -> tuple[Array, Array]:
    """The zero from torque to motor, where the spring takes all the force, and its standard uncertainty.

    Modes above the band shift it, and so does noise of the torque, which looks like them: it is read without
    them, and what they would shift it by counts as uncertainty.
    """
    last = found.fit
    first, shape = last.blocks[0], last.shapes[0]
    own = (s for b, s in zip(last.blocks, last.solved, strict=True) if b.name == "torque-motor")
    solved = next(own, None) or linear(block("torque-motor", first.windows, found.whole, first.ripple), shape)
    angle = 2 * math.pi * float(np.mean(free)) / first.windows.rate
    whole = _ratio(solved.weights[:5, 0], angle, shape.damping)
    columns = solved.columns[:, :4]
    mode = solved.columns[:, :5] @ solved.weights[:5] + solved.residual
    weights = np.linalg.lstsq(columns, mode, rcond=None)[0][:, 0]
    ratio = _ratio(np.append(weights, 0.0), angle, shape.damping)
    if ratio is None or whole is None:
        return np.full_like(free, np.nan), np.full_like(free, np.inf)
    noise = 5.0 * float(np.mean(solved.residual**2))
    spread = noise * np.linalg.pinv(columns.T @ columns)
    slope = np.array([1 / weights[2], 0, -weights[0] / weights[2] ** 2, 0])
    part = math.sqrt(max(float(slope @ spread @ slope), 0.0)) / (2 * ratio)
    held = free * math.sqrt(ratio)
    return held, np.hypot(held * part, free * abs(math.sqrt(whole) - math.sqrt(ratio)))


def _ratio(weights: Array, angle: float, damping: float) -> float | None:
    """Square of the zero over that of the pole; None where there is no zero below the pole.

    Of the mode, what follows from it with a delay, and the same of the force, in a variable s per sample.
    """
    mode = np.array([1.0, 2 * damping * angle, angle**2])
    through = np.polymul([weights[4], weights[3], weights[2]], mode)
    taken = np.polymul([weights[1], weights[0]], mode * (0.0, 1.0, 1.0))
    roots = np.roots(np.polyadd(through, taken))
    good = [
        abs(r) ** 2 / angle**2 for r in roots if r.imag > 0 and abs(r) < angle and abs(r.real) < 0.3 * abs(r)
    ]
    return max(good) if good else None
