"""A plan as TOML, as :func:`~ballscrew.fcft.plan.read_plan` reads it."""

from __future__ import annotations

from ballscrew.base.units import parse
from ballscrew.fcft.plan import Motion, Plan


def plan_toml(plan: Plan) -> str:
    """Write a plan as TOML with units; to read it back gives the same plan.

    Parameters
    ----------
    plan : Plan
        The test.

    Returns
    -------
    str
        The file's text.
    """
    stops = ", ".join(_text(position, "m", 1e3 * position, "mm") for position in plan.positions)
    loads = ", ".join(_text(mass, "kg", mass, "kg") for mass in plan.masses)
    lines = [
        "# One fixed cycle feature test (FCFT): where it stops, how it moves, how often.",
        f"positions = [{stops}]",
        f"repetitions = {plan.repetitions}",
        f"masses = [{loads}]",
        f"warm_up = {plan.warm_up}",
        f"temperature = {str(plan.temperature).lower()}",
    ]
    if plan.preloads:
        preloads = ", ".join(_text(preload, "N", preload, "N") for preload in plan.preloads)
        lines.append(f"preloads = [{preloads}]")
    for motion in plan.motions:
        lines += ["", "[[motion]]", *_motion(motion)]
    return "\n".join(lines) + "\n"


def _motion(motion: Motion) -> list[str]:
    lines = [
        f"speed = {_text(motion.speed, 'm/s', 1e3 * motion.speed, 'mm/s')}",
        f"acceleration = {_text(motion.acceleration, 'm/s^2', motion.acceleration, 'm/s^2')}",
        f"jerk = {_text(motion.jerk, 'm/s^3', motion.jerk, 'm/s^3')}",
        f"dwell = {_text(motion.dwell, 's', 1e3 * motion.dwell, 'ms')}",
    ]
    if motion.jerk_spread:
        lines.append(f"jerk_spread = {motion.jerk_spread!r}")
    if motion.start_spread:
        lines.append(f"start_spread = {_text(motion.start_spread, 's', 1e3 * motion.start_spread, 'ms')}")
    return lines


def _text(value_si: float, si: str, value: float, unit: str) -> str:
    """As short as it can be and still exact: nine digits in the handy unit, or all of them in SI."""
    short = f"{value:.9g} {unit}"
    return f'"{short}"' if parse(short, si) == value_si else f'"{value_si!r} {si}"'
