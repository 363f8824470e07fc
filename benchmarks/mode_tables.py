"""Runs at the level of mode tables: what ``analyze --method joint`` would tell of a machine, in milliseconds.

The frequencies are the machine's own linear modes (:func:`ballscrew.testbed.linear.true_frequency`), rotor
free and held, never Eq. (3). On them lie the errors that the estimator of step 4 really makes, as
``docs/explanation/preload-accuracy.md`` compares them with real runs: all cells of a run share few errors,
a level and a tilt along the axis, of which a part stays with the axis and a part is random in every run. The
tilt is that of a compliance with a wrong slope. And the nut's load: its law depends on the preload of the
data sheet as far as a run does not move it, so that a nut with less preload is read too low.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta

import numpy as np

from ballscrew.axis.frequency import nut_share, predicted_frequency
from ballscrew.axis.model import guide_friction, rotor_mass
from ballscrew.axis.sheet import DataSheet
from ballscrew.base.arrays import Array
from ballscrew.base.provenance import FileRef, Made, digest
from ballscrew.base.quantity import Quantity
from ballscrew.fcft.cells import cells
from ballscrew.fcft.plan import Plan
from ballscrew.modal.cell import CellResult, SharedError
from ballscrew.modal.run import RigidBodyResult, Run
from ballscrew.recording.quality.finding import Quality
from ballscrew.testbed.linear import true_frequency
from ballscrew.testbed.machine import Constants, Machine
from ballscrew.testbed.trip import prepared

__all__ = ["Analyst", "analyst", "mode_table", "true_effects"]

_WARM = 20.0  # °C, recorded in every run; the machines keep it
_BEGIN = datetime(2024, 1, 1, 8, tzinfo=UTC)

# Parts of the frequency, by 174 runs of 29 random axes (340 to 368). Small axes are tested with little
# acceleration, so the noise goes with the frequency.
_AT = 150.0  # Hz
_NOISE = (1.12e-4, 1.5, 0.5)  # stated for the level in a run: at 150 Hz, its power, and how axes differ
_TRUE_NOISE = (0.72, 0.84)  # level and tilt, relative to the stated noise
_ODD, _ODD_SIZE = 0.03, 4.0  # runs that are off more than they say, and by how much
_MODEL = 7.5e-5  # stated, the same in every run
_BIAS = (0.3e-4, 0.8e-4, 0.74)  # mean and spread of the level, and what noisy axes add, of the stated noise
_TILT_BIAS = (0.6e-4, 0.85)
_WEIGHTS = (2.6e-5, 0.6)  # stated
_HELD_STATED, _HELD_BIAS, _HELD_NOISE = 2.5e-3, (2.8e-4, 2.8e-4), 1.2e-4
_LAW, _WORN, _UNHELD = 5e-4, 0.008, 0.66  # as the joint estimator tells its term "load"
_UNLOADED = (2.6e-3, 0.8)  # by share, load and logarithm of the wear: what it leaves, and how axes differ
_UNLOADED_NOISE = 5e-4  # in a run, where the nut is that much unloaded
_CELL = (3.25e-4, 3.1e-4)  # deviation of a cell, true and stated, at 150 Hz, by the square
_MASS_BIAS, _MASS_NOISE, _MASS_STATED = (0.0029, 0.0027), 1.8e-4, 8e-4  # of the equivalent mass
_SOFTENING_BIAS, _SOFTENING_NOISE = (-0.08, 0.05), 0.03  # of the moving mass over the preload
_FRICTION_NOISE = (0.02, 0.004)  # viscous and Coulomb
_DENT, _PLAIN = 3.0, 2e-3  # standard deviations, and part, from which on the estimator follows single stops
_BETWEEN = 0.03  # of a dent: its course between stops is not known


@dataclass(frozen=True, slots=True)
class Analyst:
    """One axis under one estimator: what repeats in every run.

    Parameters
    ----------
    sheet : DataSheet
        Data sheet given to the estimator.
    level, tilt, rotor_held, mass, anchor : float
        Persistent errors, as parts of frequency, rotor-held frequency, equivalent mass, and moving mass over
        preload.
    unloaded : float
        Part of the frequency by which a worn nut is read too low, by share, load and logarithm of the wear.
    noise, weights : float
        Stated in every run, as parts of the frequency.
    softening : float
        Relative standard uncertainty of the moving mass over the preload from two acceleration levels;
        infinite without them.
    """

    sheet: DataSheet
    level: float
    tilt: float
    rotor_held: float
    mass: float
    anchor: float
    unloaded: float
    noise: float
    weights: float
    softening: float = math.inf


def analyst(
    sheet: DataSheet, plan: Plan, random: np.random.Generator, softening: float = math.inf
) -> Analyst:
    """Draw what repeats on an axis.

    Parameters
    ----------
    sheet : DataSheet
        The sheet.
    plan : Plan
        The test.
    random : Generator
        Draws.
    softening : float
        See :class:`Analyst`.

    Returns
    -------
    Analyst
        With errors of the size that the real estimator has at the sheet's frequency.
    """
    middle = (plan.positions[0] + plan.positions[-1]) / 2
    size = float(predicted_frequency(sheet, middle, max(plan.masses))) / _AT
    z = random.standard_normal(9)
    noise = _NOISE[0] * size ** _NOISE[1] * math.exp(_NOISE[2] * z[5])
    return Analyst(
        sheet,
        level=_BIAS[0] + _BIAS[1] * z[0] + _BIAS[2] * noise * z[1],
        tilt=math.hypot(_TILT_BIAS[0], _TILT_BIAS[1] * noise) * z[2],
        rotor_held=_HELD_BIAS[0] + _HELD_BIAS[1] * z[3],
        mass=_MASS_BIAS[0] + _MASS_BIAS[1] * z[4],
        anchor=_SOFTENING_BIAS[0] + _SOFTENING_BIAS[1] * z[7],
        unloaded=_UNLOADED[0] * math.exp(_UNLOADED[1] * z[8]),
        noise=noise,
        weights=_WEIGHTS[0] * math.exp(_WEIGHTS[1] * z[6]),
        softening=softening,
    )


def mode_table(
    who: Analyst,
    machine: Machine,
    plan: Plan,
    load: float,
    random: np.random.Generator,
    *,
    declared: float | None = None,
    torque_scale: float = 1.0,
    day: float = 0.0,
) -> Run:
    """Analyse a run that was never recorded.

    Parameters
    ----------
    who : Analyst
        Repeats from run to run.
    machine : Machine
        As it is on that day.
    plan : Plan
        The test.
    load : float
        What lies on the table, kg.
    random : Generator
        Draws what is new in this run.
    declared : float, optional
        What is said to lie on the table, kg; by default what does.
    torque_scale : float
        Ratio of the stated to the true torque, by the motor's constant.
    day : float
        Of the run.

    Returns
    -------
    Run
        With its shared errors.
    """
    plan = replace(plan, masses=(load,))
    c = prepared(machine, load, plan)
    rows = cells(plan)
    stops = np.array(plan.positions)
    free = np.array([true_frequency(c, x) for x in plan.positions])
    rotor_held = np.array([true_frequency(c, x, rotor_fixed=True) for x in plan.positions])
    at = np.searchsorted(stops, [row.position for row in rows])
    tilt = _tilt(stops, free)
    loads, softer = _nut_loads(who, machine, plan, c, stops)
    softer = softer + _UNLOADED_NOISE * np.abs(softer) / (np.abs(softer) + 1e-3) * random.standard_normal()
    odd = _ODD_SIZE if random.uniform() < _ODD else 1.0
    level, slope = who.noise * odd * np.array(_TRUE_NOISE) * random.standard_normal(2)
    size = free.mean() / _AT
    alone = _CELL[1] * size**2
    smooth, dents = _dents(stops, free)
    # A stop that stands out plainly is followed; its cells' deviations tell it in any case.
    dented = bool(np.abs(dents).max() > max(_DENT * alone / 2, _PLAIN))
    off = who.level + level + (who.tilt + slope) * tilt - softer
    if dented:
        off = off + dents + alone / 2 * random.standard_normal(len(stops))
    shared = (
        ("noise", False, np.full_like(tilt, who.noise)),
        ("noise", False, 1.2 * who.noise * tilt),
        ("weights", True, np.full_like(tilt, who.weights)),
        ("model", True, np.full_like(tilt, _MODEL)),
        ("load", False, loads),
    )
    local = np.full_like(
        tilt, math.hypot(alone / 2, _BETWEEN * float(np.abs(dents).max())) if dented else 0.0
    )
    stated = np.sqrt(sum((effect**2 for _, _, effect in shared), local**2))
    frequency = smooth * np.exp(off)
    held_stated = np.hypot(stated, _HELD_STATED)
    held_frequency = (
        rotor_held
        * smooth
        / free
        * np.exp(off - who.level + who.rotor_held + _HELD_NOISE * random.standard_normal())
    )
    deviation = _CELL[0] * size**2 * random.standard_normal(len(rows))
    results = []
    for row, i, alone_off in zip(rows, at.tolist(), deviation.tolist(), strict=True):
        f = float(frequency[i])
        terms: dict[str, float] = {}
        for name, _, effect in shared:
            terms[name] = math.hypot(terms.get(name, 0.0), f * float(effect[i]))
        results.append(
            CellResult(
                row.position,
                str(row.condition),
                row.motion,
                plan.repetitions,
                f,
                f * float(stated[i]),
                machine.damping_ratio,
                "joint",
                "good",
                (),
                uncertainty_terms_Hz=terms | {"local": f * float(local[i])},
                rotor_held_frequency_Hz=float(held_frequency[i]),
                rotor_held_standard_uncertainty_Hz=float(held_frequency[i] * held_stated[i]),
                deviation_Hz=f * (alone_off + float(dents[i])),
                deviation_standard_uncertainty_Hz=f * alone,
            )
        )
    declared_load = load if declared is None else declared
    measured_at = (_BEGIN + timedelta(days=day)).isoformat()
    name = digest([who.sheet.name, measured_at, load, float(frequency[0]), machine.preload])
    return Run(
        id=name,
        axis=who.sheet.name,
        mass_kg=declared_load,
        measured_at=measured_at,
        temperature_C=_WARM,
        files=(FileRef("trip001.h5", name),),
        quality=Quality("good"),
        rigid_body=_rigid_body(who, c, torque_scale, random),
        transients=(),
        cells=tuple(results),
        made=Made({"method": "joint"}, inputs={"plan": digest(replace(plan, masses=()).to_settings())}),
        shared_errors=tuple(
            SharedError(label, repeats, tuple((frequency * effect)[at].tolist()))
            for label, repeats, effect in shared
        ),
        mass_over_preload_kg_per_N=_anchor(who, machine, c, random),
    )


def true_effects(who: Analyst, machine: Machine, plan: Plan, load: float) -> tuple[Array, Array]:
    """What the frequencies of a run truly err by, as standard deviations of independent causes.

    Parameters
    ----------
    who, machine, plan, load
        As :func:`mode_table`.

    Returns
    -------
    repeating : ndarray, shape (3, stops)
        Parts of the frequency, the same in every run of the axis.
    fresh : ndarray, shape (3, stops)
        Drawn in every run.
    """
    c = prepared(machine, load, replace(plan, masses=(load,)))
    stops = np.array(plan.positions)
    free = np.array([true_frequency(c, x) for x in plan.positions])
    tilt, level = _tilt(stops, free), np.ones_like(stops)
    softer = _nut_loads(who, machine, plan, c, stops)[1]
    repeating = (
        math.hypot(_BIAS[1], _BIAS[2] * who.noise) * level,
        math.hypot(_TILT_BIAS[0], _TILT_BIAS[1] * who.noise) * tilt,
        _UNLOADED[1] * softer,
    )
    fresh = (
        _TRUE_NOISE[0] * who.noise * level,
        _TRUE_NOISE[1] * who.noise * tilt,
        _UNLOADED_NOISE * np.abs(softer) / (np.abs(softer) + 1e-3),
    )
    return np.array(repeating), np.array(fresh)


def _tilt(stops: Array, free: Array) -> Array:
    """What a wrong slope of the compliance does to the frequencies, 1 in half of the way."""
    way = (stops - (stops[0] + stops[-1]) / 2) / (np.ptp(stops) / 2)
    slope, middle = np.polyfit(way, free**-2.0, 1)
    return np.asarray(way / (1 + slope / middle * way))


def _dents(stops: Array, free: Array) -> tuple[Array, Array]:
    """The frequencies on a straight compliance, and by how much each stop stands out of them."""
    slope, middle = np.polyfit(stops, free**-2.0, 1)
    smooth = 1 / np.sqrt(slope * stops + middle)
    return np.asarray(smooth), np.asarray(np.log(free / smooth))


def _nut_loads(who: Analyst, machine: Machine, plan: Plan, c: Constants, stops: Array) -> tuple[Array, Array]:
    """Estimated effect of the nut's load, and the resulting error, as parts of the frequency."""
    sheet = who.sheet
    share = nut_share(sheet, stops)
    force = c.table * max(m.peak_acceleration for m in plan.motions) + float(
        guide_friction(sheet, c.table - sheet.table.mass)
    )
    new = force / sheet.nominal_preload
    worn = np.log(sheet.nominal_preload / np.maximum(machine.local_preload(stops), 1.0))
    return (
        np.asarray(np.hypot(_LAW * new, _WORN * _UNHELD * new**2) * share),
        np.asarray(who.unloaded * share * new * worn),
    )


def _anchor(who: Analyst, machine: Machine, c: Constants, random: np.random.Generator) -> Quantity | None:
    if not math.isfinite(who.softening):
        return None
    value = c.table / machine.preload * math.exp(who.anchor + _SOFTENING_NOISE * random.standard_normal())
    return Quantity(value, who.softening * value, "kg/N")


def _rigid_body(
    who: Analyst, c: Constants, torque_scale: float, random: np.random.Generator
) -> RigidBodyResult:
    noise = random.standard_normal(3)
    whole = (c.motor + c.screw + c.table) * torque_scale * (1 + who.mass + _MASS_NOISE * noise[0])
    viscous = (c.viscous + c.motor_viscous) * torque_scale * (1 + _FRICTION_NOISE[0] * noise[1])
    coulomb = (c.coulomb + c.drag) * torque_scale * (1 + _FRICTION_NOISE[1] * noise[2])
    rotor = rotor_mass(who.sheet)
    return RigidBodyResult(
        equivalent_mass_kg=whole,
        moving_mass_kg=whole - rotor,
        viscous_N_s_per_m=viscous,
        coulomb_N=coulomb,
        offset_N=0.0,
        frf_equivalent_mass_kg=None,
        standard_uncertainty={
            "equivalent_mass_kg": _MASS_STATED * whole,
            "viscous_N_s_per_m": _FRICTION_NOISE[0] * viscous,
            "coulomb_N": _FRICTION_NOISE[1] * coulomb,
            "offset_N": 0.1,
            "moving_mass_kg": math.hypot(_MASS_STATED * whole, 0.02 * rotor),
        },
    )
