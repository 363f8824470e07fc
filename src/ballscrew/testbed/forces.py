"""The forces of the machine, compiled: all springs from one potential, then what takes energy out.

The generalised coordinates, referred to the table (an angle times the lead per radian), are the motor u_m,
the screw at the nut u_φ, the screw along its axis u_s, the table x_t and the bed x_b. The potential is

    V = ½ k_θ(x) (u_m − u_φ)² + ½ k_a(x) (u_s − x_b)² + W(u_φ + u_s − x_t) + ½ k_b x_b²,  x = x_t − x_b

with W the nut's: 2/5 K_h [(δ₀ + δ)₊^2.5 + (δ₀ − δ)₊^2.5], in which δ₀ < 0 is half a backlash.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from ballscrew.testbed.machine import Constants


@njit(cache=True, inline="always")
def nut_force(deflection: float, flank: float, pressed: float) -> tuple[float, float]:
    """Force of the nut and its tangent rigidity.

    Parameters
    ----------
    deflection : float
        δ, of the screw's thread against the nut, m.
    flank : float
        K_h of one flank, N/m^1.5.
    pressed : float
        δ₀, by which the preload presses each flank, m; below 0 half a backlash.

    Returns
    -------
    force : float
        F = K_h [(δ₀ + δ)₊^1.5 − (δ₀ − δ)₊^1.5], on the table, N.
    rigidity : float
        dF/dδ, N/m.
    """
    up, down = pressed + deflection, pressed - deflection
    force = rigidity = 0.0
    if up > 0:
        root = math.sqrt(up)
        force += flank * up * root
        rigidity += 1.5 * flank * root
    if down > 0:
        root = math.sqrt(down)
        force -= flank * down * root
        rigidity += 1.5 * flank * root
    return force, rigidity


@njit(cache=True, inline="always")
def pressed_at(c: Constants, place: float) -> tuple[float, float]:
    """Approach of each flank by the preload at the nut.

    Parameters
    ----------
    c : Constants
        The machine.
    place : float
        x = x_t − x_b, m.

    Returns
    -------
    pressed : float
        δ₀(x), m.
    slope : float
        dδ₀/dx.
    """
    count = c.lost.size
    if count == 0:
        return c.pressed, 0.0
    steps = (place - c.lost_from) / c.lost_step
    if steps <= 0:
        return c.pressed - c.lost[0], 0.0
    if steps >= count - 1:
        return c.pressed - c.lost[count - 1], 0.0
    cell = int(steps)
    rise = c.lost[cell + 1] - c.lost[cell]
    return c.pressed - c.lost[cell] - rise * (steps - cell), -rise / c.lost_step


@njit(cache=True, inline="always")
def drag_share(c: Constants, place: float) -> float:
    """The nut's drag where it is over its drag where nothing is lost; both are proportional to the preload.

    Parameters
    ----------
    c : Constants
        The machine.
    place : float
        x = x_t − x_b, m.

    Returns
    -------
    float
        P(x)/P.
    """
    if c.lost.size == 0 or c.pressed <= 0:
        return 1.0
    here = max(pressed_at(c, place)[0], 0.0) / c.pressed
    return here * math.sqrt(here)


@njit(cache=True, inline="always")
def stiffnesses(c: Constants, place: float) -> tuple[float, float, float, float]:
    """Stiffness of the shaft in torsion and in tension where the nut is.

    Parameters
    ----------
    c : Constants
        The machine.
    place : float
        x = x_t − x_b, m.

    Returns
    -------
    twist, axial : float
        k_θ of shaft and coupling, and k_a of shaft and bearing, or of both sides where both ends are held,
        N/m.
    twist_slope, axial_slope : float
        dk_θ/dx and dk_a/dx, N/m².
    """
    distance = place + c.to_zero
    twist = 1 / (c.coupling + c.twist * distance)
    near = c.bearing + c.shaft * distance
    if c.far_bearing == np.inf:
        axial = 1 / near
        return twist, axial, -c.twist * twist * twist, -c.shaft * axial * axial
    far = c.far_bearing + c.shaft * (c.length - distance)
    slope = c.shaft / (far * far) - c.shaft / (near * near)
    return twist, 1 / near + 1 / far, -c.twist * twist * twist, slope


@njit(cache=True, inline="always")
def spring_forces(
    c: Constants, motor: float, turn: float, rod: float, table: float, bed: float
) -> tuple[float, float, float, float, float, float, float, float]:
    """Minus the potential's gradient in all five coordinates; and what the damping needs.

    Parameters
    ----------
    c : Constants
        The machine.
    motor, turn, rod, table, bed : float
        The coordinates, m.

    Returns
    -------
    motor, turn, rod, table, bed : float
        Forces, N.
    twist, axial, nut : float
        k_θ, k_a and the nut's tangent rigidity, N/m.
    """
    twist, axial, twist_slope, axial_slope = stiffnesses(c, table - bed)
    pressed, pressed_slope = pressed_at(c, table - bed)
    force, rigidity = nut_force(turn + rod - table, c.flank, pressed)
    torsion, extension = motor - turn, rod - bed
    shift = -0.5 * (twist_slope * torsion * torsion + axial_slope * extension * extension)
    if pressed_slope != 0:
        # A nut that is tighter on one side of where it is gets pushed to the other.
        up, down = max(pressed + turn + rod - table, 0.0), max(pressed - turn - rod + table, 0.0)
        shift -= c.flank * (up * math.sqrt(up) + down * math.sqrt(down)) * pressed_slope
    return (
        -twist * torsion,
        twist * torsion - force,
        -axial * extension - force,
        force + shift,
        axial * extension - c.bed_stiffness * bed - shift,
        twist,
        axial,
        rigidity,
    )


@njit(cache=True, inline="always")
def guide_friction(c: Constants, slide: float, bristle: float, dt: float) -> tuple[float, float]:
    r"""Friction of the guide over one step, LuGre (Canudas de Wit et al., 1995, doi:10.1109/9.376053).

    dz/dt = v − σ₀ \|v\| z / g(v), F = σ₀ z + σ₁ dz/dt + σ₂ v, g = F_c + (F_s − F_c) exp(−(v/v_s)²). With the
    speed held over the step z is a decay, written down exactly: its own pole σ₀\|v\|/g is faster than
    the step where the table moves quickly.

    Parameters
    ----------
    c : Constants
        The machine.
    slide : float
        v of the table on the bed, m/s.
    bristle : float
        z, m.
    dt : float
        Step, s.

    Returns
    -------
    force : float
        F, against the table's motion, mean over the step, N.
    bristle : float
        z after the step, m.
    """
    if c.bristle <= 0:
        return c.viscous * slide, bristle
    ratio = slide / c.stribeck
    level = c.coulomb
    if ratio * ratio < 30:
        level += (c.breakaway - c.coulomb) * math.exp(-ratio * ratio)
    pole = c.bristle * abs(slide) / level * dt
    if pole > 1e-9:
        rest = math.copysign(level / c.bristle, slide)
        fresh = rest + (bristle - rest) * math.exp(-pole) if pole < 30 else rest
    else:
        fresh = bristle + slide * dt
    dry = c.bristle * 0.5 * (bristle + fresh) + c.bristle_damping * (fresh - bristle) / dt
    return dry + c.viscous * slide, fresh
