"""The joint estimator: from a run's signals to the axial mode in every cell."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ballscrew.axis.sheet import DataSheet
from ballscrew.base.errors import InputError
from ballscrew.modal.joint.guess import Guess, guess, least_load, whole_mass
from ballscrew.modal.joint.local import held_to_new, kinks, shrinkage
from ballscrew.modal.joint.merge import Merged, merged
from ballscrew.modal.joint.model import frequency
from ballscrew.modal.joint.result import CellEstimate, JointResult
from ballscrew.modal.joint.search import Found, search
from ballscrew.modal.joint.settings import RESPONSES, JointSettings, Response
from ballscrew.modal.joint.signals import Mark, TripSignals, thinned
from ballscrew.modal.joint.uncertainty import deviations, nut_loads

__all__ = ["identify_jointly"]

Array = NDArray[np.float64]
_CERTAIN = 0.003  # of the frequency: a larger standard uncertainty makes a cell suspect
_MOST_DAMPING = 0.25
_LEAST_CELLS = 3
_UNLOADED = 2.0  # load on the nut over its preload from which a cell is suspect
_BETWEEN = 0.06  # of how far a stop stands out of those beside it
_WORN = 0.012  # of the frequency, by the share and the square of the load
_LAW = 9e-4  # of the frequency, by the nut's share and its load: what its law may err


def identify_jointly(
    trips: Sequence[TripSignals],
    marks: Sequence[Mark],
    sheet: DataSheet | None = None,
    load: float = 0.0,
    settings: JointSettings | None = None,
    response: Response = "both",
) -> JointResult:
    """Identify all cells of a run as one.

    The compliance along the axis is one line, so that every cell tells of all others. The table's
    acceleration is explained twice: from the motor's torque, whose mode is the one with the rotor free, and
    from the motor's own motion, whose mode is the one with the rotor held.

    Parameters
    ----------
    trips : sequence of TripSignals
        The run, one a recording.
    marks : sequence of Mark
        Where the acceleration phases lie.
    sheet : DataSheet, optional
        Says where to look first; it does not decide.
    load : float
        On the table, kg.
    settings : JointSettings, optional
        Settings.
    response : {"nut", "motor", "both"}
        What answers: the nut's accelerometers, the motor's encoder, or what there is.

    Returns
    -------
    JointResult
        Every cell that was marked, with a frequency and its uncertainty, or refused with a reason.

    Raises
    ------
    InputError
        If trips and marks do not fit together, or the response asked for was not measured.
    """
    settings = settings or JointSettings()
    _check(trips, marks, response)
    if not marks:
        return JointResult((), ("no acceleration phase was found",))
    bad = next((i for i, t in enumerate(trips) if not _finite(t)), None)
    if bad is not None:
        return _refused(marks, f"trip {bad + 1} has samples that are no numbers")
    low = min(float(t.position.min()) for t in trips)
    high = max(float(t.position.max()) for t in trips)
    mass = whole_mass(trips)
    if mass is None or not high > low:
        return _refused(marks, "the axis does not move")
    guessed = guess(sheet, load, low, high) if sheet else Guess(*_looked(settings), 1.0)
    trips = [thinned(t, settings.rate * guessed.free) for t in trips]
    if trips[0].rate < 5 * guessed.free:
        return _refused(
            marks, f"{trips[0].rate:.0f} samples per second are too few for a mode near {guessed.free:.0f} Hz"
        )
    nut = response != "motor" and all(len(t.response) for t in trips)
    names = ("torque-nut", "motor-nut") if nut else ("torque-motor",)
    curved = sheet is not None and sheet.support == "fixed-fixed"
    found = search(trips, marks, mass, guessed, names, settings, curved)
    if found is None or len(found.fit.blocks[0].windows.cells) < _LEAST_CELLS:
        return _refused(marks, "too few transients of one kind to average")
    at = found.fit.blocks[0].windows.middle
    centre = float(frequency(found.fit.shapes[0], np.zeros(1))[0])
    least = least_load(sheet, load, at, centre) if sheet else 0.0
    return _result(found, marks, settings, response, least)


def _looked(settings: JointSettings) -> tuple[float, float]:
    middle = math.sqrt(settings.lowest * settings.highest)
    return middle, 0.8 * middle


def _check(trips: Sequence[TripSignals], marks: Sequence[Mark], response: str) -> None:
    if response not in RESPONSES:
        raise InputError(f"the response is {response!r}; it must be one of {', '.join(RESPONSES)}.")
    if not trips:
        raise InputError("no trip was given; a run has one or more.")
    if len({(t.rate, len(t.response)) for t in trips}) > 1:
        raise InputError("the trips have different rates or accelerometers; a run has one set of channels.")
    for i, t in enumerate(trips):
        if len({len(t.force), len(t.position), t.response.shape[-1]} - {0}) > 1:
            raise InputError(f"trip {i + 1} has channels of different lengths.")
    if any(not 0 <= m.trip < len(trips) for m in marks):
        raise InputError(f"a mark names a trip that is not among the {len(trips)}.")
    if response == "nut" and not all(len(t.response) for t in trips):
        raise InputError("the response is 'nut', but no accelerometer at the nut was measured.")


def _finite(trip: TripSignals) -> bool:
    return all(bool(np.all(np.isfinite(x))) for x in (trip.force, trip.position, trip.response))


def _refused(marks: Sequence[Mark], reason: str) -> JointResult:
    counts: dict[tuple[float, str, int], int] = {}
    for m in marks:
        key = (m.position, str(m.condition), m.motion)
        counts[key] = counts.get(key, 0) + 1
    return JointResult(tuple(_empty(k, n, reason) for k, n in sorted(counts.items())), (reason,))


def _empty(key: tuple[float, str, int], count: int, reason: str) -> CellEstimate:
    return CellEstimate(*key, count, *(None,) * 7, (), "refused", (reason,))


def _result(
    found: Found, marks: Sequence[Mark], settings: JointSettings, response: str, least: float
) -> JointResult:
    last = found.fit
    w = last.blocks[0].windows
    shape = last.shapes[0]
    lost = tuple((b.name, last.unexplained(i)) for i, b in enumerate(last.blocks))
    refusal = _why_not(found, settings)
    if refusal:
        return _refused(marks, refusal)
    place = np.array([cell[0] for cell in w.cells]) - w.middle
    reach = max(float(np.ptp(place)), 0.05)
    whole, plain = (merged(f, shrinkage(f, found.seen), settings.slopes, reach) for f in (last, found.plain))
    free, terms = _curve(whole, plain, 0, place, settings)
    if len(last.blocks) > 1:
        held, held_terms = _curve(whole, plain, 1, place, settings)
        held_sd = _total(held_terms)
    else:
        held, held_sd = _held_by_weights(found, free, _total(terms))
        held_sd = np.hypot(held_sd, settings.held_floor * held)
    off, off_sd = deviations(last, 0)
    # Every cell says how far it alone is off the smooth course.
    off = off + frequency(shape, place) - frequency(replace(shape, places=(), local=()), place)
    loads, shares = nut_loads(last)
    loads = loads * max(1.0, least / shape.load if shape.load > 0 else 0.0)
    # A nut may be worn evenly and the load on it too small to tell: that would soften by its square.
    worn = _WORN * held_to_new(last, found.seen) * loads**2
    terms.append(("load", np.hypot(_LAW * loads, worn) * shares * free))
    total = _total(terms)
    wide = total > settings.most_uncertainty * free
    if np.mean(wide) > 0.5:
        return _refused(marks, f"the standard uncertainty is ± {np.median(total):.1f} Hz")
    cells = {}
    for i, key in enumerate(w.cells):
        u = float(total[i])
        parts = tuple((name, float(t[i])) for name, t in terms)
        base = (*key, int(w.repetitions[i]))
        why = []
        if loads[i] > _UNLOADED:
            why.append(f"the test's own load unloads the nut: it is {loads[i]:.1f} times the preload left")
        if u > _CERTAIN * free[i]:
            why.append(f"the standard uncertainty is ± {u:.1f} Hz")
        if wide[i] or loads[i] > settings.most_load:
            cells[key] = CellEstimate(*base, *(None,) * 7, parts, "refused", tuple(why))
            continue
        cells[key] = CellEstimate(
            *base,
            float(free[i]),
            u,
            float(held[i]),
            float(held_sd[i]),
            shape.damping,
            None if w.turning[i] else float(off[i]),
            None if w.turning[i] else float(off_sd[i]),
            parts,
            "suspect" if why else "good",
            tuple(why),
        )
    for cell in _refused(marks, "no two of its transients could be laid on one another").cells:
        cells.setdefault((cell.position, cell.condition, cell.motion), cell)
    return JointResult(
        tuple(cells[key] for key in sorted(cells)),
        (),
        shape.damping,
        None if response == "motor" or len(last.blocks) == 1 else shape.pitch,
        lost,
        found.whole,
        (w.band.low, w.band.high),
    )


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
    return None


def _curve(
    whole: Merged, plain: Merged, block: int, place: Array, settings: JointSettings
) -> tuple[Array, list[tuple[str, Array]]]:
    f = whole.curve(block, place)
    return f, [
        ("noise", whole.deviation(block, place, "noise")),
        ("conditions", whole.deviation(block, place, "conditions")),
        ("weights", np.abs(f - plain.curve(block, place)) / 2),
        ("drives", np.abs(f - frequency(whole.fit.shapes[block], place)) / 2),
        ("model", (settings.held_floor if block else settings.model_floor) * f),
        # Between stops the course of a local part is not known, and a cell's window moves there.
        ("local", _BETWEEN / 2 * f * kinks(whole.fit.shapes[0], place)),
    ]


def _total(terms: Sequence[tuple[str, Array]]) -> Array:
    named = dict(terms)
    spread = np.maximum(named["noise"], named["conditions"])  # two views of one scatter
    shared = sum((named[n] ** 2 for n in named if n not in ("noise", "conditions")), 0.0)
    return np.asarray(np.sqrt(spread**2 + shared))


def _held_by_weights(found: Found, free: Array, free_sd: Array) -> tuple[Array, Array]:
    """The zero: where the motor stands still, since the spring takes all the force."""
    solved = found.fit.solved[0]
    weights, columns = solved.weights[:, 0], solved.columns
    ratio = 1 + weights[2] / weights[0]
    noise = 5.0 * float(np.mean(solved.residual**2))
    spread = noise * np.linalg.pinv(columns.T @ columns)
    slope = np.array([-weights[2] / weights[0] ** 2, 0, 1 / weights[0], 0])
    if not 0 < ratio < 1:
        return np.full_like(free, np.nan), np.full_like(free, np.inf)
    held = free * math.sqrt(ratio)
    part = math.sqrt(max(float(slope @ spread @ slope), 0.0)) / (2 * ratio)
    return held, np.hypot(free_sd * math.sqrt(ratio), held * part)
