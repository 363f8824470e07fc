"""Checks before a plan may move a machine: soft limits, speed and torque."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from ballscrew.axis.drag import preload_torque
from ballscrew.axis.model import guide_friction, motor_travel, rotor_mass, weight_on_nut
from ballscrew.axis.rigidity import at_preload
from ballscrew.axis.sheet import DataSheet
from ballscrew.base.errors import InputError
from ballscrew.fcft.plan import Motion, Plan, validate_plan
from ballscrew.fcft.schedule import trips

_NANOMETRE = 1e-9
_ROUNDING = 1e-9  # relative, of values that a file gives in other units


@dataclass(frozen=True, slots=True)
class LimitCheck:
    """Comparison of a plan with the limits of a machine.

    Parameters
    ----------
    broken : tuple of str
        Each limit that the plan breaks, in one sentence: where, what was given, what is allowed.
    unchecked : tuple of str
        What could not be checked since the data sheet does not state it, in one sentence each.
    """

    broken: tuple[str, ...]
    unchecked: tuple[str, ...]


def required_torque(sheet: DataSheet, motion: Motion, load: float, preload: float | None = None) -> float:
    r"""Highest torque that a motion asks of the motor.

    T = (β [(m_t + m_r) a + F_f + \|W\|] + T_p) / ratio: all that moves, rotor included, accelerated at the
    highest acceleration that the motion really reaches, against the guide's friction, the weight W that is
    not counterbalanced and the drag of the preloaded nut (at its nominal diameter). What grows with speed,
    seals and bearings are not in it: no data sheet states them.

    Parameters
    ----------
    sheet : DataSheet
        The axis.
    motion : Motion
        The motion.
    load : float
        What lies on the table, kg.
    preload : float, optional
        P, N; the nominal preload where it is not given.

    Returns
    -------
    float
        N m.

    Raises
    ------
    InputError
        If the preload is negative or not finite.
    """
    screw = sheet.screw
    mass = sheet.table.mass + load + rotor_mass(sheet)
    constant = float(guide_friction(sheet, load)) + abs(float(weight_on_nut(sheet, load)))
    force = mass * motion.peak_acceleration + constant
    if preload is None:
        preload = sheet.nominal_preload
    drag = preload_torque(preload, screw.lead, screw.nominal_diameter)
    return motor_travel(sheet) * force + float(drag) / sheet.drive.ratio


def check_limits(plan: Plan, sheet: DataSheet) -> LimitCheck:
    """Compare all round trips of a plan, varied ones too, with the limits of the machine.

    Parameters
    ----------
    plan : Plan
        The test; its heaviest load and highest preload are decisive.
    sheet : DataSheet
        The axis, with its limits.

    Returns
    -------
    LimitCheck
        Broken limits, and limits that could not be checked. The travel of the screw is
        :func:`~ballscrew.fcft.plan.validate_plan`'s.

    Raises
    ------
    InputError
        If there are more round trips than can be run.
    """
    sheet = at_preload(sheet, max(plan.preloads, default=None))
    limits = sheet.limits
    checks = (
        ("lowest_position", limits.lowest_position, "the travel towards it"),
        ("highest_position", limits.highest_position, "the travel towards it"),
        ("speed", limits.speed, "the speed"),
        ("torque", limits.torque, "the motor's torque"),
    )
    unchecked = []
    for field, limit, checked in checks:
        if limit is None:
            unchecked.append(f"{sheet.source} does not state limits.{field}, so {checked} was not checked.")
    return LimitCheck((*_positions(plan, sheet), *_motions(plan, sheet)), tuple(unchecked))


def require_safe(plan: Plan, sheet: DataSheet) -> LimitCheck:
    """Refuse a plan that the machine cannot do or may not do; every export asks this first.

    Parameters
    ----------
    plan : Plan
        The test.
    sheet : DataSheet
        The axis, with its limits.

    Returns
    -------
    LimitCheck
        With nothing broken.

    Raises
    ------
    InputError
        If the plan leaves the screw, has stops too close for its speed, or breaks a limit.
    """
    validate_plan(plan, sheet)
    check = check_limits(plan, sheet)
    if check.broken:
        raise InputError(" ".join(check.broken))
    return check


def _positions(plan: Plan, sheet: DataSheet) -> Iterator[str]:
    low, high = sheet.limits.lowest_position, sheet.limits.highest_position
    first, last = plan.positions[0], plan.positions[-1]
    if low is not None and first < low - _NANOMETRE:
        yield (
            f"{plan.source}: positions has {first:g} m; limits.lowest_position of {sheet.source} "
            f"allows {low:g} m or more."
        )
    if high is not None and last > high + _NANOMETRE:
        yield (
            f"{plan.source}: positions has {last:g} m; limits.highest_position of {sheet.source} "
            f"allows {high:g} m or less."
        )


def _motions(plan: Plan, sheet: DataSheet) -> Iterator[str]:
    executed = [{motion} for motion in plan.motions]
    for trip in trips(plan):
        executed[trip.motion].add(trip.executed)
    for index, motions in enumerate(executed):
        name = f"{plan.source}: motion"
        if len(plan.motions) > 1:
            name += f"[{index}]"
        yield from _distance(plan, sheet, name, plan.motions[index], motions)
        yield from _speed_and_torque(sheet, name, plan.motions[index], motions, max(plan.masses))


def _distance(
    plan: Plan, sheet: DataSheet, name: str, nominal: Motion, motions: set[Motion]
) -> Iterator[str]:
    # validate_plan checks the nominal motion; a lower jerk needs a longer distance.
    softest = max(motions, key=lambda motion: motion.acceleration_distance)
    distance, gap = 2 * softest.acceleration_distance, plan.smallest_gap
    if softest.jerk < nominal.jerk and gap < distance * (1 - _ROUNDING):
        yield (
            f"{name}.jerk_spread is {nominal.jerk_spread:g}, which brings the jerk down "
            f"to {softest.jerk:g} m/s³, for which the axis of {sheet.source} needs {distance:g} m to "
            f"accelerate and stop again; positions has stops {gap:g} m apart."
        )


def _speed_and_torque(
    sheet: DataSheet, name: str, nominal: Motion, motions: set[Motion], load: float
) -> Iterator[str]:
    speed, torque = sheet.limits.speed, sheet.limits.torque
    if speed is not None and nominal.speed > speed * (1 + _ROUNDING):
        yield (
            f"{name}.speed is {nominal.speed:g} m/s; limits.speed of {sheet.source} "
            f"allows {speed:g} m/s or less."
        )
    needed = max(required_torque(sheet, motion, load) for motion in motions)
    if torque is not None and needed > torque * (1 + _ROUNDING):
        yield (
            f"{name} needs a torque of {needed:.3g} N m with a load of {load:g} kg; "
            f"limits.torque of {sheet.source} allows {torque:.3g} N m or less."
        )
