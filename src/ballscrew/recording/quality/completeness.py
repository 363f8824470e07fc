"""The gate's third part: whether a run is the plan's, and its mass the one that is said."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from ballscrew.axis.frequency import rotor_mass
from ballscrew.axis.sheet import DataSheet
from ballscrew.base.arrays import Array
from ballscrew.fcft.cells import cells
from ballscrew.fcft.plan import Plan
from ballscrew.recording.motions import look_alike
from ballscrew.recording.quality.finding import Finding
from ballscrew.recording.rigid_body import RigidBody

__all__ = ["check_run"]


_PLACE = 0.5e-3  # m: 1 mm reads as 1.1 % of the preload; a drive stops within some hundredths
# The rigid-body fit of good records is within 0.5 % of sheet and load; the sheet's inertias are good to 2 %.
_MASS = 0.025
_MASS_BAD = 0.3  # no slip in the load any more: another axis, unit or scale
_SIGMAS = 3.0
_COMMON = 0.8  # of the phases that must share an offset to call it the axis'
_SAME_LOAD = 1e-3  # kg


@dataclass(frozen=True, slots=True)
class _Places:
    """Where the phases stopped, beside the plan's stops."""

    nominal: Array
    reached: Array
    offset: float

    @property
    def strays(self) -> NDArray[np.bool_]:
        """Phases that belong to no stop, once the common offset is taken out."""
        return np.asarray(np.abs(self.reached - self.nominal - self.offset) > _PLACE)


def check_run(
    transients: xr.Dataset,
    plan: Plan | None,
    sheet: DataSheet | None,
    mass: float | None,
    rigid: RigidBody | None,
) -> tuple[Finding, ...]:
    """Find what is missing from a run, and what is not as it was said.

    Parameters
    ----------
    transients : Dataset
        The table *Transients* of all files of the run.
    plan : Plan, optional
        What should have been run; without one nothing can be missing.
    sheet : DataSheet, optional
        The axis; without one the mass is not judged.
    mass : float, optional
        Load on the table as declared, kg; where it is not declared, it is not judged.
    rigid : RigidBody, optional
        Of the whole run, in SI and referred to the table.

    Returns
    -------
    tuple of Finding
        Repetitions missing or too many, transients that are there twice, stops not reached, phases
        elsewhere, an axis whose zero has moved, a load that
        is not the plan's, an equivalent mass unlike what sheet and load say.
    """
    findings: list[Finding] = [*_copies(transients)]
    if plan is not None:
        findings += _check_places(transients, plan)
    if plan is not None and mass is not None:
        findings += _check_load(plan, mass)
    if sheet is not None and rigid is not None and mass is not None:
        findings += _check_mass(sheet, mass, rigid)
    return tuple(findings)


def _copies(transients: xr.Dataset) -> list[Finding]:
    """Transients that are there twice to the last sample, whose scatter would be a lie."""
    seen: dict[str, int] = {}
    at, file = transients["start_s"].to_numpy(), transients["file"].to_numpy()
    contents = transients["content"].values.tolist()
    twins = []
    for row, content in enumerate(contents):
        first = seen.setdefault(content, row) if content else row
        if first != row:
            twins.append((first, row))
    if not twins:
        return []
    one, other = twins[0]
    text = (
        f"{len(twins)} of {len(contents)} transients are there twice, to the last sample: that at "
        f"{at[one]:.4g} s of "
        f"recording {file[one] + 1} again at {at[other]:.4g} s of recording {file[other] + 1}; "
        "a file holds two runs, or was put together"
    )
    return [Finding("suspect", "copies", text)]


def _check_places(transients: xr.Dataset, plan: Plan) -> list[Finding]:
    whole = transients["complete"].to_numpy().astype(bool)
    if not whole.any():
        text = f"none of the plan's {_cell_count(plan)} cells was measured: no whole acceleration was found"
        return [Finding("bad", "repetitions", text)]
    nominal = transients["position_m"].to_numpy()[whole].astype(np.float64)
    reached = transients["reached_m"].to_numpy()[whole].astype(np.float64)
    offset = float(np.median(reached - nominal))
    if np.mean(np.abs(reached - nominal - offset) <= _PLACE) < _COMMON:
        offset = 0.0
    places = _Places(nominal, reached, offset)
    condition = transients["condition"].to_numpy()[whole].astype(str)
    motion = transients["motion"].to_numpy()[whole].astype(int)
    return [
        *_offset(places),
        *_stops(places, plan),
        *_repetitions(places, condition.tolist(), motion.tolist(), plan),
    ]


def _cell_count(plan: Plan) -> int:
    return len(cells(plan)) // len(plan.masses)


def _offset(places: _Places) -> list[Finding]:
    if abs(places.offset) <= _PLACE:
        return []
    text = (
        f"all positions lie {1e3 * places.offset:+.3g} mm off the plan's stops: "
        "the zero of the axis or the plan has moved"
    )
    return [Finding("suspect", "offset", text)]


def _stops(places: _Places, plan: Plan) -> list[Finding]:
    findings = []
    stray = places.strays
    if stray.any():
        worst = int(np.argmax(np.abs(places.reached - places.nominal)))
        at, near = float(places.reached[worst]), float(places.nominal[worst])
        text = (
            f"{int(stray.sum())} of {len(stray)} phases start or stop at places that are not the plan's: "
            f"one at {1e3 * at:.4g} mm, where the nearest stop is {1e3 * near:.4g} mm"
        )
        findings.append(Finding("bad" if stray.all() else "suspect", "places", text))
    seen = set(np.round(places.nominal[~stray], 9).tolist())
    missed = [stop for stop in plan.positions if round(stop, 9) not in seen]
    if missed:
        named = ", ".join(f"{1e3 * stop:.4g}" for stop in missed[:5]) + (" …" if len(missed) > 5 else "")
        text = f"{len(missed)} of the plan's {len(plan.positions)} stops were not reached: {named} mm"
        findings.append(Finding("bad" if len(missed) == len(plan.positions) else "suspect", "stops", text))
    return findings


def _repetitions(
    places: _Places, condition: Sequence[str], motion: Sequence[int], plan: Plan
) -> list[Finding]:
    """One sentence on all cells that have fewer repetitions than planned."""
    at = np.round(places.nominal, 9).tolist()
    counts = Counter(
        key
        for key, stray in zip(zip(at, condition, motion, strict=True), places.strays, strict=True)
        if not stray
    )
    wanted = dict.fromkeys((round(c.position, 9), str(c.condition), c.motion) for c in cells(plan))
    short = Counter(counts[cell] for cell in wanted if counts[cell] < plan.repetitions)
    if not short:
        return _too_many([counts[cell] for cell in wanted], plan)
    named = [
        f"{cells_of} {'have' if cells_of > 1 else 'has'} "
        + (f"{repetitions} repetition{'s' * (repetitions > 1)}" if repetitions else "none")
        for repetitions, cells_of in sorted(short.items(), reverse=True)
    ]
    text = f"of the plan's {len(wanted)} cells {', '.join(named)}, where {plan.repetitions} are planned"
    alike = look_alike(plan)
    if alike:
        listed = " and ".join(str(index) for index in alike)
        text += f"; only their order tells motions {listed} apart, so which is which is not known"
    return [Finding("bad" if short[0] == len(wanted) else "suspect", "repetitions", text)]


def _too_many(counts: Sequence[int], plan: Plan) -> list[Finding]:
    """A run in which no cell has too few repetitions, and one or more too many."""
    if not counts or max(counts) <= plan.repetitions:
        return []
    more = sum(count > plan.repetitions for count in counts)
    text = (
        f"{more} of the plan's {len(counts)} cells have up to {max(counts)} repetitions, where "
        f"{plan.repetitions} {'are' if plan.repetitions > 1 else 'is'} planned: two runs in one file, "
        "or more files than one run's"
    )
    return [Finding("suspect", "repetitions", text)]


def _check_load(plan: Plan, mass: float) -> list[Finding]:
    if any(abs(mass - planned) <= _SAME_LOAD for planned in plan.masses):
        return []
    planned = ", ".join(f"{value:g}" for value in plan.masses)
    return [
        Finding("suspect", "load", f"the declared load of {mass:g} kg is none of the plan's ({planned} kg)")
    ]


def _check_mass(sheet: DataSheet, mass: float, rigid: RigidBody) -> list[Finding]:
    seen = rigid.equivalent_mass
    own = sheet.table.mass + rotor_mass(sheet)
    expected = own + mass
    said = f"table, rotor and a load of {mass:g} kg make {expected:.4g} kg"
    if not np.isfinite(seen):
        return []
    if seen < 0:
        text = (
            f"the equivalent mass is {seen:.4g} kg, where {said}: "
            "the polarity of torque or position is inverted"
        )
        return [Finding("suspect", "polarity", text)]
    if abs(seen / expected - 1) <= max(_MASS, _SIGMAS * rigid.uncertainty[0] / expected):
        return []
    off = seen / expected - 1
    told = f"the equivalent mass is {seen:.4g} kg, {100 * off:+.3g} % off: {said}"
    load = seen - own
    if abs(off) > _MASS_BAD:
        why = "that is no slip in the load, but the unit or scale of torque or position, or another axis"
        return [Finding("bad", "load", f"{told}; {why}")]
    # A fit within half a per cent says no more of the load than whole kilograms.
    if load >= 0:
        why = f"a load of {load:.0f} kg would explain it, as would a wrong scale of the torque"
    else:
        why = "no load explains it; a wrong scale of the torque, or a wrong lead in the data sheet, would"
    return [Finding("suspect", "load", f"{told}; {why}")]
