"""Third part of the quality gate: a run against its plan, and its mass against data sheet and load."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from ballscrew.axis.compliance import transmission_ratio
from ballscrew.axis.model import pretension_reserve, rotor_mass, weight_on_nut
from ballscrew.axis.sheet import DataSheet
from ballscrew.base.arrays import Array
from ballscrew.fcft.cells import cells
from ballscrew.fcft.conditions import Condition
from ballscrew.fcft.nutload import hardest, nut_load
from ballscrew.fcft.plan import Plan
from ballscrew.recording.motions import indistinguishable_motions
from ballscrew.recording.quality.finding import Finding, severity
from ballscrew.recording.rigid_body import RigidBody

_PLACE = 0.5e-3  # m: 1 mm looks like 1.1 % of the preload; a drive stops within some hundredths
# The rigid-body fit of good records is within 0.5 % of sheet and load; the sheet's inertias are good to 2 %.
_MASS = 0.025
_MASS_BAD = 0.3  # too much for an error in the load: another axis, unit or scale
_SCALE = 0.1  # motors' torque constants are stated to within 10 %: beyond, the transmission is in doubt
_SIGMAS = 3.0
_LEAST_STEP = 1.2  # of a transmission: a smaller one resembles a wrong load
# Constant force on the nut over the nominal preload. By the rigidity of two Hertz contacts under load, a
# quarter makes a nut with half of its preload left seem to have 1 % less, a half 3 %.
_CONSTANT_FORCE = 0.25
_FRICTION_DIFFERENCE = 0.5  # of the mean: friction of the two directions may differ as much
_COMMON = 0.8  # of the phases that must have an offset in common for an offset of the axis
_SAME_LOAD = 1e-3  # kg


@dataclass(frozen=True, slots=True)
class _Places:
    """Stops of the phases, beside the plan's."""

    nominal: Array
    reached: Array
    offset: float

    @property
    def strays(self) -> NDArray[np.bool_]:
        """Phases that belong to no stop, without the common offset."""
        return np.asarray(np.abs(self.reached - self.nominal - self.offset) > _PLACE)


def check_run(
    transients: xr.Dataset,
    plan: Plan | None,
    sheet: DataSheet | None,
    mass: float | None,
    rigid: RigidBody | None,
) -> tuple[Finding, ...]:
    """Check a run against its plan, and its mass against data sheet and declared load.

    Parameters
    ----------
    transients : Dataset
        The table *Transients* of all files of the run.
    plan : Plan, optional
        Plan of the run; without it nothing can be missing.
    sheet : DataSheet, optional
        Data sheet of the axis; without it the mass is not checked.
    mass : float, optional
        Declared load on the table, kg; without it the mass is not checked.
    rigid : RigidBody, optional
        Fit of the whole run, in SI and referred to the table.

    Returns
    -------
    tuple of Finding
        Repetitions missing or too many, duplicate transients, stops not reached, phases elsewhere, an axis
        whose zero has moved, a nut off the screw, a load that is not the plan's, a nut load that uses up
        the screw's pretension, an equivalent mass or a constant force that does not agree with data sheet
        and load.
    """
    findings: list[Finding] = [*_copies(transients)]
    if plan is not None:
        findings += _check_places(transients, plan)
    if sheet is not None:
        findings += _check_travel(transients, sheet)
    if mass is not None:
        findings += check_load(plan, sheet, mass, rigid)
    return tuple(findings)


def _check_travel(transients: xr.Dataset, sheet: DataSheet) -> list[Finding]:
    """Check that the nut stays on the screw, where the model of the axis holds."""
    low, high = -sheet.screw.bearing_to_zero, sheet.travel_limit
    reached = transients["reached_m"].to_numpy().astype(np.float64)
    beyond = reached[(reached < low) | (reached > high)]
    if not beyond.size:
        return []
    farthest = beyond[np.argmax(np.abs(beyond - (low + high) / 2))]
    text = (
        f"the axis moves to {1e3 * farthest:.0f} mm, off the screw, which ends at {1e3 * low:.0f} and "
        f"{1e3 * high:.0f} mm: check polarity, offset and unit of the position, and length and "
        "bearing_to_zero of the data sheet"
    )
    return [Finding("bad", "places", text)]


def check_load(
    plan: Plan | None, sheet: DataSheet | None, mass: float, rigid: RigidBody | None
) -> tuple[Finding, ...]:
    """Check the declared load against plan, data sheet and rigid-body fit.

    Parameters
    ----------
    plan, sheet, mass, rigid
        As for :func:`check_run`.

    Returns
    -------
    tuple of Finding
        Those of :func:`check_run` that depend on the load.
    """
    findings: list[Finding] = []
    if plan is not None:
        findings += _check_plan_load(plan, mass)
    if plan is not None and sheet is not None:
        findings += _check_pretension(plan, sheet, mass)
    if sheet is not None and rigid is not None:
        findings += _check_mass(sheet, mass, rigid)
        findings += _check_constant_force(sheet, mass, rigid)
    return tuple(findings)


def _copies(transients: xr.Dataset) -> list[Finding]:
    """Transients with equal samples, whose scatter would be too small."""
    first_rows: dict[str, int] = {}
    start, file = transients["start_s"].to_numpy(), transients["file"].to_numpy()
    contents = transients["content"].values.tolist()
    copies = []
    for row, content in enumerate(contents):
        if content and first_rows.setdefault(content, row) != row:
            copies.append(row)
    if not copies:
        return []
    copy = copies[0]
    original = first_rows[contents[copy]]
    text = (
        f"{len(copies)} of {len(contents)} transients occur twice, to the last sample: that at "
        f"{start[original]:.4g} s of recording {file[original] + 1} again at {start[copy]:.4g} s of "
        f"recording {file[copy] + 1}; a file contains two runs, or was assembled from others"
    )
    return [Finding("suspect", "copies", text)]


def _check_places(transients: xr.Dataset, plan: Plan) -> list[Finding]:
    whole = transients["complete"].to_numpy().astype(bool)
    if not whole.any():
        planned = _cell_count(plan)
        text = f"none of the {planned} planned cells was measured: no complete acceleration was found"
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
        text = (
            f"{int(stray.sum())} of {len(stray)} phases start or stop at places that are not the plan's: "
            f"one at {1e3 * places.reached[worst]:.4g} mm, where the nearest stop is "
            f"{1e3 * places.nominal[worst]:.4g} mm"
        )
        findings.append(Finding(severity(bad=bool(stray.all())), "places", text))
    stops = np.array(plan.positions)
    missed = stops[~np.isin(np.round(stops, 9), np.round(places.nominal[~stray], 9))]
    if len(missed):
        listed = ", ".join(f"{1e3 * stop:.4g}" for stop in missed[:5])
        if len(missed) > 5:
            listed += " …"
        text = f"{len(missed)} of the plan's {len(stops)} stops were not reached: {listed} mm"
        findings.append(Finding(severity(bad=len(missed) == len(stops)), "stops", text))
    return findings


def _repetitions(
    places: _Places, condition: Sequence[str], motion: Sequence[int], plan: Plan
) -> list[Finding]:
    """Check the number of repetitions of each cell: a sentence for all cells."""
    counts: Counter[tuple[float, str, int]] = Counter()
    stops = np.round(places.nominal, 9).tolist()
    for stop, kind, index, stray in zip(stops, condition, motion, places.strays, strict=True):
        if not stray:
            counts[stop, kind, index] += 1
    planned = dict.fromkeys((round(c.position, 9), str(c.condition), c.motion) for c in cells(plan))
    repetitions = np.array([counts[cell] for cell in planned])
    short = repetitions[repetitions < plan.repetitions]
    if not len(short):
        return _too_many(repetitions, plan)
    clauses = []
    for number, cell_count in sorted(Counter(short.tolist()).items(), reverse=True):
        verb = "have" if cell_count > 1 else "has"
        clauses.append(f"{cell_count} {verb} {_times(number)}")
    text = f"of the plan's {len(planned)} cells {', '.join(clauses)}, where {plan.repetitions} are planned"
    alike = indistinguishable_motions(plan)
    if alike:
        listed = " and ".join(map(str, alike))
        text += f"; motions {listed} differ in their order only, so they cannot be assigned"
    return [Finding(severity(bad=not repetitions.any()), "repetitions", text)]


def _times(repetitions: int) -> str:
    if repetitions == 0:
        return "none"
    return "1 repetition" if repetitions == 1 else f"{repetitions} repetitions"


def _too_many(repetitions: NDArray[np.int64], plan: Plan) -> list[Finding]:
    """Check for more repetitions than planned."""
    more = int(np.count_nonzero(repetitions > plan.repetitions))
    if not more:
        return []
    verb = "are" if plan.repetitions > 1 else "is"
    text = (
        f"{more} of the plan's {len(repetitions)} cells have up to {repetitions.max()} repetitions, where "
        f"{plan.repetitions} {verb} planned: two runs in one file, or more files than one run's"
    )
    return [Finding("suspect", "repetitions", text)]


def _check_plan_load(plan: Plan, mass: float) -> list[Finding]:
    if np.abs(mass - np.array(plan.masses)).min() <= _SAME_LOAD:
        return []
    planned = ", ".join(f"{value:g}" for value in plan.masses)
    text = f"the declared load of {mass:g} kg is not in the plan ({planned} kg)"
    return [Finding("suspect", "load", text)]


def _check_pretension(plan: Plan, sheet: DataSheet, mass: float) -> list[Finding]:
    """Check the plan's nut load against the one that unloads an end of a screw fixed at both."""
    reserve = pretension_reserve(sheet, plan.positions)
    motion = hardest(plan.motions)
    largest = max(abs(nut_load(sheet, motion, mass, condition)) for condition in Condition)
    if reserve is None or largest <= reserve[0]:
        return []
    text = (
        f"the plan's nut load of {largest:.0f} N uses up the screw's pretension, of which an end loses the "
        f"last at {reserve[0]:.0f} N: an end that no longer pulls lowers the frequency as lost preload does"
    )
    return [Finding("suspect", "pretension", text)]


def _check_mass(sheet: DataSheet, mass: float, rigid: RigidBody) -> list[Finding]:
    measured = rigid.equivalent_mass
    own = sheet.table.mass + rotor_mass(sheet)
    expected = own + mass
    if not np.isfinite(measured):
        return []
    text = f"the equivalent mass is {measured:.4g} kg, "
    cause = f"table, rotor and a load of {mass:g} kg make {expected:.4g} kg"
    if measured < 0:
        text += f"where {cause}: the polarity of torque or position is inverted"
        return [Finding("suspect", "polarity", text)]
    off = measured / expected - 1
    if abs(off) <= max(_MASS, _SIGMAS * rigid.uncertainty[0] / expected):
        return []
    text += f"{100 * off:+.3g} % off: {cause}; "
    load = measured - own
    if abs(off) > _MASS_BAD:
        text += "too much for a wrong load: check the unit and scale of torque and position, and the axis"
        return [Finding("bad", "load", text + _transmission(sheet, mass, measured))]
    # The fit is within half a per cent, which is no more than whole kilograms of the load.
    if load >= 0:
        text += f"a load of {load:.0f} kg would explain it, as would a wrong scale of the torque"
    else:
        text += "no load explains it; a wrong scale of the torque, or a wrong lead in the data sheet, would"
    if abs(off) > _SCALE:
        text += _transmission(sheet, mass, measured)
    return [Finding("suspect", "load", text)]


def _transmission(sheet: DataSheet, mass: float, measured: float) -> str:
    """Question after a transmission, with the ratios that explain an equivalent mass.

    By a torque at the motor, a ratio i is measured as (m_t + m_s + i² J/β²) i₀/i with the sheet's ratio i₀.
    """
    drive = sheet.drive
    motor = drive.rotor_inertia / transmission_ratio(sheet.screw.lead) ** 2
    rest = sheet.table.mass + mass + rotor_mass(sheet) - motor * drive.ratio**2
    roots = np.roots([motor, -measured / drive.ratio, rest])
    found = [
        f"{ratio:.2g}"
        for ratio in sorted(roots[np.isreal(roots)].real.tolist())
        if ratio > 0 and abs(np.log(ratio / drive.ratio)) > np.log(_LEAST_STEP)
    ]
    ratios = f" of {' or '.join(found)} motor turns per screw turn" if found else ""
    return f"; is there a belt or gear{ratios} between motor and screw (drive.ratio)?"


def _check_constant_force(sheet: DataSheet, mass: float, rigid: RigidBody) -> list[Finding]:
    """Check the constant force against the weight that the data sheet states."""
    weight = float(weight_on_nut(sheet, mass))
    excess = rigid.offset - weight
    least = max(
        _CONSTANT_FORCE * sheet.nominal_preload,
        _FRICTION_DIFFERENCE * abs(rigid.coulomb),
        _SIGMAS * rigid.uncertainty[3],
    )
    if rigid.equivalent_mass < 0 or not abs(excess) > least:
        return []
    ratio = abs(rigid.offset) / sheet.nominal_preload
    text = f"a constant force of {rigid.offset:.0f} N acts on the axis, {ratio:.2g} times the nominal preload"
    if sheet.orientation == "horizontal":
        text += (
            ", as of its own weight: is this axis vertical or inclined? State orientation (and "
            "table.counterbalance) in the data sheet; it softens the nut"
        )
    else:
        text += (
            f", where orientation, mass and counterbalance of the data sheet make {weight:.0f} N: check "
            "them, and positive"
        )
    return [Finding("suspect", "constant-force", f"{text}; or the torque has an offset")]
