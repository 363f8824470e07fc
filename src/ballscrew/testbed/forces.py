"""The forces of the machine, compiled: all springs from one potential, then what takes energy out.

The generalised coordinates, referred to the table (an angle times the lead per radian), are the motor u_m,
the screw at the nut u_φ, the screw along its axis u_s, the table x_t and the bed x_b. The potential is

    V = ½ k_θ(x) (u_m − u_φ)² + ½ k_a(x) (u_s − x_b)² + W(u_φ + u_s − x_t) + ½ k_b x_b²,  x = x_t − x_b

with W the nut's: 2/5 K_h [(δ₀ + δ)₊^2.5 + (δ₀ − δ)₊^2.5], in which δ₀ < 0 is half a backlash. With a bearing
of two Hertz flanks, or ends that only pull, ½ k_a (u_s − x_b)² becomes the energy of one or two chains of
bearing and shaft (:func:`end_force`).
"""

from __future__ import annotations

import math

import numpy as np

from ballscrew.base.compilation import compiled
from ballscrew.testbed.machine import Constants

_MOST_ITERATIONS = 20  # of Newton's method for the bearing; from the linear start two or three are needed
_EXACT = 1e-15  # m


@compiled(inline="always")
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


@compiled(inline="always")
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


@compiled(inline="always")
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


@compiled(inline="always")
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
        k_θ of shaft and coupling, and k_a of shaft and bearing, or of both sides where both ends are held, at
        rest, N/m.
    twist_slope, axial_slope : float
        dk_θ/dx and dk_a/dx, N/m².
    """
    distance = place + c.to_zero
    twist = 1 / (c.coupling + c.twist * distance)
    near = c.bearing + c.shaft * distance
    if c.far_bearing == np.inf or c.pretension <= 0:
        axial = 1 / near
        return twist, axial, -c.twist * twist * twist, -c.shaft * axial * axial
    far = c.far_bearing + c.shaft * (c.length - distance)
    slope = c.shaft / (far * far) - c.shaft / (near * near)
    return twist, 1 / near + 1 / far, -c.twist * twist * twist, slope


@compiled()
def end_force(c: Constants, distance: float, bearing: float, extension: float) -> tuple[float, float, float]:
    """Force of one end of the screw: a bearing of two Hertz flanks in series with the shaft.

    Parameters
    ----------
    c : Constants
        The machine.
    distance : float
        From the bearing to the nut, m.
    bearing : float
        Compliance of the bearing at rest, m/N.
    extension : float
        Extension of the chain beyond that of the pretension, m.

    Returns
    -------
    force : float
        Tension beyond the pretension, N; never below its loss.
    rigidity : float
        dF/de, N/m.
    slope : float
        Derivative of the chain's energy by the distance, N: −F²/(2AE).
    """
    soft = c.shaft * distance
    rigidity = 1 / (bearing + soft)
    force = rigidity * extension
    if c.bearing_preload < np.inf:
        # The two flanks of the bearing: 3 P_b of its rigidity at rest is their approach.
        pressed = 3 * c.bearing_preload * bearing
        flank = 1 / (3 * bearing * math.sqrt(pressed))
        deflection = force * bearing
        for _ in range(_MOST_ITERATIONS):
            force, tangent = nut_force(deflection, flank, pressed)
            change = (extension - deflection - soft * force) / (1 + soft * tangent)
            deflection += change
            if abs(change) < _EXACT:
                break
        force, tangent = nut_force(deflection, flank, pressed)
        rigidity = tangent / (1 + soft * tangent)
    if force < -c.pretension:
        force, rigidity = -c.pretension, 0.0
    return force, rigidity, -0.5 * c.shaft * force * force


@compiled(inline="always")
def support_force(c: Constants, place: float, extension: float) -> tuple[float, float, float]:
    """Force that holds the screw along its axis.

    Parameters
    ----------
    c : Constants
        The machine.
    place : float
        x = x_t − x_b, m.
    extension : float
        u_s − x_b, m.

    Returns
    -------
    force, rigidity, slope : float
        F, N, its tangent, N/m, and the derivative of its energy by x, N.
    """
    if c.bearing_preload == np.inf and c.pretension == np.inf:
        _, axial, _, axial_slope = stiffnesses(c, place)
        return axial * extension, axial, 0.5 * axial_slope * extension * extension
    distance = place + c.to_zero
    force, rigidity, slope = end_force(c, distance, c.bearing, extension)
    if c.far_bearing < np.inf:
        far, far_rigidity, far_slope = end_force(c, c.length - distance, c.far_bearing, -extension)
        force -= far
        rigidity += far_rigidity
        slope -= far_slope
    return force, rigidity, slope


@compiled(inline="always")
def spring_forces(
    c: Constants, motor: float, turn: float, rod: float, table: float, bed: float, film: float = 0.0
) -> tuple[float, float, float, float, float, float, float, float, float]:
    """Minus the potential's gradient in all five coordinates; and what the damping needs.

    Parameters
    ----------
    c : Constants
        The machine.
    motor, turn, rod, table, bed : float
        The coordinates, m.
    film : float
        By which the oil presses each flank more, m.

    Returns
    -------
    motor, turn, rod, table, bed : float
        Forces, N.
    twist, axial, nut : float
        k_θ and the tangents of the screw's support and of the nut, N/m.
    force : float
        Force of the nut on the table, N.
    """
    place = table - bed
    twist, _, twist_slope, _ = stiffnesses(c, place)
    pressed, pressed_slope = pressed_at(c, place)
    pressed += film
    force, rigidity = nut_force(turn + rod - table, c.flank, pressed)
    torsion = motor - turn
    support, axial, support_slope = support_force(c, place, rod - bed)
    shift = -0.5 * twist_slope * torsion * torsion - support_slope
    if pressed_slope != 0:
        # A nut that is tighter on one side of where it is gets pushed to the other.
        up, down = max(pressed + turn + rod - table, 0.0), max(pressed - turn - rod + table, 0.0)
        shift -= c.flank * (up * math.sqrt(up) + down * math.sqrt(down)) * pressed_slope
    return (
        -twist * torsion,
        twist * torsion - force,
        -support - force,
        force + shift,
        support - c.bed_stiffness * bed - shift,
        twist,
        axial,
        rigidity,
        force,
    )


@compiled(inline="always")
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
