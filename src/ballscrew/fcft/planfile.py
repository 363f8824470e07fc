"""A plan as TOML, as :func:`~ballscrew.fcft.plan.read_plan` reads it."""

from __future__ import annotations

from ballscrew.fcft.plan import Motion, Plan

__all__ = ["plan_toml"]


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
    stops = ", ".join(_text(1e3 * position, "mm") for position in plan.positions)
    loads = ", ".join(_text(mass, "kg") for mass in plan.masses)
    lines = [
        "# One fixed cycle feature test (FCFT): where it stops, how it moves, how often.",
        f"positions = [{stops}]",
        f"repetitions = {plan.repetitions}",
        f"masses = [{loads}]",
        f"warm_up = {plan.warm_up}",
        f"temperature = {str(plan.temperature).lower()}",
    ]
    for motion in plan.motions:
        lines += ["", "[[motion]]", *_motion(motion)]
    return "\n".join(lines) + "\n"


def _motion(motion: Motion) -> list[str]:
    lines = [
        f"speed = {_text(1e3 * motion.speed, 'mm/s')}",
        f"acceleration = {_text(motion.acceleration, 'm/s^2')}",
        f"jerk = {_text(motion.jerk, 'm/s^3')}",
        f"dwell = {_text(1e3 * motion.dwell, 'ms')}",
    ]
    if motion.jerk_spread:
        lines.append(f"jerk_spread = {motion.jerk_spread!r}")
    if motion.start_spread:
        lines.append(f"start_spread = {_text(1e3 * motion.start_spread, 'ms')}")
    return lines


def _text(value: float, unit: str) -> str:
    # Nine digits: finer than any drive's own, and free of what changing the unit leaves behind.
    return f'"{value:.9g} {unit}"'
