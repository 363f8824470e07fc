"""Runs to readings: in time order, parted into epochs, each against its epoch's reference and judged twice.

The first verdict is the run's own. The second is against the epoch's reference: its masses, its whole FRF
against its own rigid body, and whether any change of the nut explains its cells. Runs that fail are shown,
and nothing is learnt from them.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from ballscrew.base.errors import InputError, shown
from ballscrew.health.calibrated import Calibrated
from ballscrew.health.causes import causes, seen
from ballscrew.health.change import Change
from ballscrew.health.detection.settings import MonitorSettings
from ballscrew.health.epochs import Epoch, Event, epochs_of, moment
from ballscrew.health.features import of_run
from ballscrew.health.fusion import Fused, fuse
from ballscrew.health.mass_check import check_mass, masses_of
from ballscrew.health.method import one_method
from ballscrew.health.observed import Observed, observed
from ballscrew.health.reading import Reading
from ballscrew.health.relative import change_since, paired
from ballscrew.modal.run import Run

__all__ = ["History", "Judged", "fused_change", "read_history"]

Array = NDArray[np.float64]
_DAY = 86400.0
_FIRST = 3  # good runs of an epoch that choose its reference: as many as there are before one is judged
_TURNS = 12
_SETTLED = 1e-3  # of P/P₀, which moves what is told by a hundredth of that
_MOST_LOAD = 0.25  # of all that moves, as ``preload`` allows
_FRF = 0.02  # by which the FRF's equivalent mass may part from the rigid body's, of it
_SOFTEST = 1.0  # growth of the compliance: beyond it one flank carries the load, and no softer
_WOUND = 0.5  # of what a softer axis is wound up by more: friction changes too
_OF_REFERENCE = ("noise of the baseline", "the baseline's part")


@dataclass(frozen=True, slots=True, eq=False)
class Judged:
    """A run, its reading, and what it was told from.

    Parameters
    ----------
    run : Run
        Analysed.
    reading : Reading
        Of it.
    change, fused : Change, Fused or None
        Against the epoch's reference; None where it cannot be told.
    """

    run: Run
    reading: Reading
    change: Change | None = None
    fused: Fused | None = None


@dataclass(frozen=True, slots=True, eq=False)
class History:
    """All runs of an axis.

    Parameters
    ----------
    runs : tuple of Judged
        In time order, each once.
    epochs : tuple of Epoch
        With their references.
    references : tuple of Run or None
        Of each epoch.
    begin : datetime
        Of day 0.
    """

    runs: tuple[Judged, ...]
    epochs: tuple[Epoch, ...]
    references: tuple[Run | None, ...]
    begin: datetime


def read_history(
    runs: Sequence[Run], model: Calibrated, events: Sequence[Event], settings: MonitorSettings
) -> History:
    """Read runs of one axis, in any order.

    Parameters
    ----------
    runs : sequence of Run
        Analysed by one method; one that is given twice counts once.
    model : Calibrated
        Of the axis.
    events : sequence of Event
        What was done to it.
    settings : MonitorSettings
        What is plausible.

    Returns
    -------
    History
        The same whatever the order.

    Raises
    ------
    InputError
        If there is none, one tells no time, they are not of one axis and method, or two that differ have one
        id.
    """
    if not runs:
        raise InputError("no run was given; a history takes one or more.")
    one_method(runs)
    timed = sorted(((_when(one, model), one.id, one) for one in _once(runs)), key=lambda t: t[:2])
    epochs = list(epochs_of(events, timed[-1][0]))
    begins = [None if one.begins is None else moment(one.begins, "an event: at") for one in epochs]
    begin = timed[0][0]
    tables = [observed(run, rotor=model.rotor) for _, _, run in timed]
    within = [
        max(i for i, start in enumerate(begins) if start is None or when >= start) for when, _, _ in timed
    ]
    firsts: list[list[tuple[Run, Observed]]] = [[] for _ in epochs]
    for (_, _, run), table, number in zip(timed, tables, within, strict=True):
        if len(firsts[number]) < _FIRST and run.quality.verdict == "good" and len(table.frequency):
            firsts[number].append((run, table))
    chosen = [_reference(some, model, settings) for some in firsts]
    epochs = [
        one if of is None else replace(one, reference=of[0].id, reference_at=of[0].measured_at)
        for one, of in zip(epochs, chosen, strict=True)
    ]
    references: list[tuple[Run, Observed] | None] = [None] * len(epochs)
    judged = []
    for (when, _, run), table, number in zip(timed, tables, within, strict=True):
        if firsts[number] and run is firsts[number][0][0]:
            references[number] = chosen[number]
        start = Reading(
            run=run.id,
            measured_at=str(run.measured_at),
            day=(when - begin).total_seconds() / _DAY,
            epoch=number,
            temperature=math.nan if run.temperature_C is None else float(run.temperature_C),
            level=math.nan,
            random=math.nan,
            verdict="good",
        )
        judged.append(_judge(run, table, _told(start, run), references[number], model, settings))
    return History(
        tuple(judged), tuple(epochs), tuple(None if one is None else one[0] for one in chosen), begin
    )


def _reference(
    firsts: Sequence[tuple[Run, Observed]], model: Calibrated, settings: MonitorSettings
) -> tuple[Run, Observed] | None:
    """The first good run, but where the next two agree with each other and neither with it.

    No run is judged before there are three, so this knows nothing that an alarm could have waited for.
    """
    if len(firsts) < _FIRST:
        return firsts[0] if firsts else None
    odd, second, third = firsts[:_FIRST]
    if _agree(second, odd, model, settings) or _agree(third, odd, model, settings):
        return odd
    return second if _agree(third, second, model, settings) else odd


def _agree(
    one: tuple[Run, Observed], other: tuple[Run, Observed], model: Calibrated, settings: MonitorSettings
) -> bool:
    if _not_comparable(*one, *other, model):
        return False
    change, fused = fused_change(one[1], other[1], model, settings)
    return not _against_the_epoch(one[0], other[0], change, fused, model, settings)[0]


def fused_change(
    table: Observed, reference: Observed, model: Calibrated, settings: MonitorSettings
) -> tuple[Change, Fused]:
    """Change of the nut since the reference; the load on a worn nut counts by the preload that is sought.

    Parameters
    ----------
    table, reference : Observed
        Two runs with cells in common.
    model : Calibrated
        Of the axis.
    settings : MonitorSettings
        What is taken for granted.

    Returns
    -------
    Change, Fused
        Told as :func:`ballscrew.health.preload.preload` tells them, without its draws.
    """
    ratio, more = 1.0, table.load - reference.load
    last: tuple[float, float] | None = None
    for _ in range(_TURNS):
        change = change_since(
            table, reference, model.model, model.bearing_share, 1.0, settings.assumptions, more, ratio
        )
        fused = fuse(change)
        off = min(max(1 + fused.level, 0.5), 2.0) ** -3 - ratio
        if abs(off) < _SETTLED:
            break
        # By the secant, at first half way: the two pull each other, and would swing.
        slope = -2.0 if last is None or ratio == last[0] else (off - last[1]) / (ratio - last[0])
        last, ratio = (ratio, off), min(max(ratio - off / min(slope, -0.5), 0.1), 10.0)
    return change, fused


def _once(runs: Sequence[Run]) -> tuple[Run, ...]:
    found: dict[str, Run] = {}
    for one in runs:
        known = found.setdefault(one.id, one)
        if known is not one and known.to_json() != one.to_json():
            raise InputError(
                f"run {shown(one.id)[1:13]} was given twice and says two things; give one of the two files."
            )
    return tuple(found.values())


def _when(run: Run, model: Calibrated) -> datetime:
    name = f"run {shown(run.id)[1:13]}"
    if run.axis is not None and model.axis and run.axis != model.axis:
        raise InputError(
            f"{name} is of the axis {shown(run.axis)}, the model of {shown(model.axis)}; they must be of one "
            "axis."
        )
    if run.measured_at is None:
        raise InputError(f"{name} tells no time; analyse it with --measured-at, a history goes by time.")
    return moment(run.measured_at, f"{name}: measured_at")


def _told(reading: Reading, run: Run) -> Reading:
    rigid, over = run.rigid_body, run.mass_over_preload_kg_per_N
    return replace(
        reading,
        equivalent_mass=_number(rigid.equivalent_mass_kg),
        friction=_number(rigid.coulomb_N),
        friction_uncertainty=_number(rigid.standard_uncertainty.get("coulomb_N")),
        features=MappingProxyType(dict(of_run(run))),
        mass_over_preload=math.nan if over is None else over.value,
        mass_over_preload_uncertainty=math.nan if over is None else over.standard_uncertainty,
    )


def _judge(
    run: Run,
    table: Observed,
    reading: Reading,
    reference: tuple[Run, Observed] | None,
    model: Calibrated,
    settings: MonitorSettings,
) -> Judged:
    own = tuple(run.quality.reasons)
    if run.quality.verdict == "bad" or not len(table.frequency):
        if run.quality.verdict != "bad" and reference is not None:
            # What a probe shows is there all the same.
            lost, spread = _lost_motion(run, reference[0], _SOFTEST)
            reading = replace(reading, backlash=lost, backlash_uncertainty=spread)
        return Judged(run, replace(reading, verdict="refused", reasons=own or (_unread(run),)))
    if reference is None:
        return Judged(run, replace(reading, verdict="suspect", reasons=own or ("it is suspect",)))
    apart = _not_comparable(run, table, *reference, model)
    if apart:
        return Judged(run, replace(reading, verdict="suspect", reasons=(apart,)))
    change, fused = fused_change(table, reference[1], model, settings)
    reading = replace(
        reading,
        level=fused.level,
        random=fused.random,
        systematic=math.sqrt(
            sum(u**2 for name, (u, random) in fused.terms.items() if not random and name not in _OF_REFERENCE)
        ),
    )
    lost, spread = _lost_motion(run, reference[0], float(np.clip(np.mean(change.y), 0.0, _SOFTEST)))
    reading = replace(reading, backlash=lost, backlash_uncertainty=spread)
    wrong, notes = _against_the_epoch(run, reference[0], change, fused, model, settings)
    if run.quality.verdict != "good":
        wrong = [*(own or ("the measurement is suspect",)), *wrong]
    verdict = "suspect" if wrong else "good"
    return Judged(run, replace(reading, verdict=verdict, reasons=tuple(wrong or notes)), change, fused)


def _unread(run: Run) -> str:
    """Why a good measurement gave no frequency, in the words of most of its cells."""
    reasons = Counter(reason.split(":")[0] for cell in run.cells for reason in cell.reasons[:1])
    why = f": {reasons.most_common(1)[0][0]}" if reasons else ""
    return f"no cell of the run has a frequency{why}"


def _not_comparable(
    run: Run, table: Observed, reference: Run, other: Observed, model: Calibrated
) -> str | None:
    plans = run.made.inputs.get("plan"), reference.made.inputs.get("plan")
    if None not in plans and plans[0] != plans[1]:
        return "it was measured by another plan than the epoch's reference"
    if abs(table.load - other.load) > _MOST_LOAD * (model.model.mass + other.load):
        return f"it was measured with {table.load:g} kg, the epoch's reference with {other.load:g} kg"
    if not paired(table, other)[0]:
        return "no cell of it has a frequency in the epoch's reference too"
    return None


def _against_the_epoch(
    run: Run, reference: Run, change: Change, fused: Fused, model: Calibrated, settings: MonitorSettings
) -> tuple[list[str], list[str]]:
    """What is wrong with a run, and what must be known with it."""
    kept = settings.assumptions
    far = float(-ndtri(settings.suspect / 2)) if settings.suspect > 0 else math.inf
    masses = masses_of(run, reference, model.model, kept)
    heavy = masses is not None and abs(masses.inertia) > far * masses.inertia_spread
    misfit = fused.probability < settings.suspect
    wrong: list[str] = []
    notes: list[str] = []
    if heavy or misfit:
        found = causes(seen(change, masses, kept))
        if heavy:
            by_kilogram = abs(float(fused.weights @ change.mass))
            spread = math.hypot(fused.spread, abs(fused.level) * model.standard_uncertainty("share"))
            mass = check_mass(
                masses, found, reference.rigid_body.equivalent_mass_kg or 0.0, by_kilogram / spread, kept
            )
            (notes if mass.decision in ("torque", "declared") else wrong).append(mass.text)
        if misfit and found[0].name not in ("nut", "local", "torque"):
            wrong.append(f"no change of the nut explains all cells; the likeliest cause is {found[0].text}")
        elif misfit:
            notes.append(f"the cells differ more than they should; likeliest is {found[0].text}")
    parted = _frf(run, reference)
    if parted is not None and abs(parted[0]) > max(_FRF, far * parted[1]):
        wrong.append(
            f"its FRF is {100 * abs(parted[0]):.1f} % {'smaller' if parted[0] > 0 else 'larger'} than its "
            "rigid body says, against the epoch's reference: has the accelerometer moved or come loose?"
        )
    return wrong, notes


def _frf(run: Run, reference: Run) -> tuple[float, float] | None:
    """Change of ln (FRF's equivalent mass over the rigid body's), which only the accelerometer can do.

    But for friction, whose remainder is in the FRF's mass: it falls as the nut wears, and the stated
    uncertainty holds it.
    """
    logs, spreads = [], []
    for one in (run.rigid_body, reference.rigid_body):
        mass, whole = one.frf_equivalent_mass_kg, one.equivalent_mass_kg
        if mass is None or whole is None or not (mass > 0 and whole > 0):
            return None
        logs.append(math.log(mass / whole))
        spreads.append(_number(one.standard_uncertainty.get("frf_equivalent_mass_kg")) / mass)
    spread = max(spreads)
    return logs[0] - logs[1], spread if spread > 0 else 0.0


def _lost_motion(run: Run, reference: Run, softer: float) -> tuple[float, float]:
    """Lost motion beyond what friction winds up, mean over the stops that both have.

    A softer axis is wound up by more, without any backlash: as its compliance has grown by the frequencies.
    """
    now, then = ({round(one.position_m, 6): one for one in each.lost_motion} for each in (run, reference))
    common = sorted(now.keys() & then.keys())
    if not common:
        return math.nan, math.nan
    wound = np.array([then[x].lost_m for x in common])
    more = np.array([now[x].lost_m for x in common]) - wound * (1 + softer)
    own = np.array([[one[x].standard_uncertainty_m for x in common] for one in (now, then)])
    told = math.sqrt(float(np.nansum(own**2))) / len(common)
    scatter = float(np.std(more, ddof=1)) / math.sqrt(len(common)) if len(common) > 1 else 0.0
    spread = math.hypot(max(told, scatter), _WOUND * softer * abs(float(wound.mean())))
    return (float(more.mean()), spread) if spread > 0 else (math.nan, math.nan)


def _number(value: float | None) -> float:
    return math.nan if value is None else float(value)
