"""Integrates a trip: the machine, its servo and its motion, sample by sample, compiled."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ballscrew.base.arrays import Array
from ballscrew.base.compilation import compiled
from ballscrew.testbed.forces import drag_share, guide_friction, spring_forces
from ballscrew.testbed.machine import Constants

# The film in the centre of a contact grows with the speed's power of 0.67 (Hamrock and Dowson, 1977,
# doi:10.1115/1.3453074), and fills within the time in which a ball rolls through its contact.
_FILM_SPEED, _FILM_EXPONENT, _FILM_TIME = 0.1, 0.67, 4e-3


class Loop(NamedTuple):
    """Servo in numbers, referred to the table: force for torque, way for angle.

    The position loop gives a speed, the speed loop a force, which the current loop follows with a lag and a
    dead time.

    Parameters
    ----------
    position_gain : float
        1/s.
    speed_gain : float
        N s/m.
    integral_gain : float
        N/m.
    speed_ahead : float
        Part of the wanted speed that is fed forward.
    mass_ahead : float
        By which the wanted acceleration is fed forward, kg.
    lag : float
        Time constant of the current loop, s; 0 for none.
    dead_samples : int
        From the controller's answer to the current loop.
    force_limit : float
        Most that the controller asks for, N; while it does, the integral stands still.
    resolution : float
        Of the motor encoder, m; 0 for none.
    filter : float
        Time constant of the measured speed, s; 0 for none.
    on : bool
        Whether there is control at all.
    """

    position_gain: float
    speed_gain: float
    integral_gain: float
    speed_ahead: float
    mass_ahead: float
    lag: float
    dead_samples: int
    force_limit: float
    resolution: float
    filter: float
    on: bool


@compiled(fastmath={"contract", "arcp", "nsz"})
def integrate(  # noqa: PLR0915  one compiled loop over the samples
    c: Constants,
    loop: Loop,
    wanted: Array,
    disturbance: Array,
    waves: Array,
    steps: int,
    rate: float,
    state: Array,
) -> tuple[Array, Array]:
    """Integrate one record.

    Semi-implicit: forces move speeds, new speeds move the machine. Without losses its energy then swings a
    little but does not drift. The bristle of the guide's friction is advanced exactly. Nothing here looks
    after the step: :func:`~ballscrew.testbed.linear.least_steps` says what a machine needs.

    Parameters
    ----------
    c : Constants
        The machine.
    loop : Loop
        Its servo.
    wanted : ndarray, shape (n, 3)
        Set-points: position, speed, acceleration.
    disturbance : ndarray, shape (n, 2)
        Force on the motor, and between screw and nut, positive where it drives the table forward, N.
    waves : ndarray, shape (waves, 4)
        Forces that go with the motor's way: phase over it, rad/m, and at 0, rad; sizes on the motor, and
        between screw and nut, N. Constant over a sample.
    steps : int
        Of the integrator, a sample.
    rate : float
        Samples per second, Hz.
    state : ndarray, shape (11,)
        Ways and speeds of motor, screw, rod, table and bed; the bristle. The table does not pitch, and the
        drive carries the weight.

    Returns
    -------
    records : ndarray, shape (n, 8)
        Motor force without the disturbance, N; accelerations of table, motor and bed, m/s²; the encoder's
        count and the table's place, m; force of the nut's spring on the table and force that the controller
        asks for, N. Count and place are where the sample begins, all else is a mean over it.
    state : ndarray, shape (11,)
        At the end.
    """
    n = wanted.shape[0]
    dt = 1.0 / (rate * steps)
    out = np.empty((n, 8))
    m, t, s, x, b = state[0], state[1], state[2], state[3], state[4]
    vm, vt, vs, vx, vb = state[5], state[6], state[7], state[8], state[9]
    z = state[10]
    am = at = ar = ax = ab = 0.0
    half = 0.5 * dt
    q = vq = aq = 0.0
    rigid = c.table - c.pitch_mass
    pitching = 1 / c.pitch_mass if c.pitch_mass > 0 else 0.0
    force = integral = -c.gravity if loop.on else 0.0
    speed = film = 0.0
    film_follow = 1 - math.exp(-1 / (rate * _FILM_TIME))
    count = round(m / loop.resolution) * loop.resolution if loop.resolution > 0 else m
    delay = np.full(loop.dead_samples + 1, force)
    follow = 1 - math.exp(-dt / loop.lag) if loop.lag > 0 else 1.0
    smooth = 1 - math.exp(-1 / (rate * loop.filter)) if loop.filter > 0 else 1.0
    sample = 1 / rate
    for i in range(n):
        new = round(m / loop.resolution) * loop.resolution if loop.resolution > 0 else m
        speed += smooth * ((new - count) * rate - speed)
        count = new
        asked = 0.0
        if loop.on:
            miss = loop.position_gain * (wanted[i, 0] - count) + loop.speed_ahead * wanted[i, 1] - speed
            asked = loop.speed_gain * miss + integral + loop.mass_ahead * wanted[i, 2]
            if abs(asked) < loop.force_limit:
                integral += loop.integral_gain * miss * sample
            else:
                asked = math.copysign(loop.force_limit, asked)
        for k in range(loop.dead_samples, 0, -1):
            delay[k] = delay[k - 1]
        delay[0] = asked
        target = delay[loop.dead_samples]
        out[i, 4] = count
        out[i, 5] = x
        out[i, 7] = asked
        sum_force = sum_table = sum_motor = sum_bed = sum_nut = 0.0
        film += film_follow * (c.film * (abs(vx - vb) / _FILM_SPEED) ** _FILM_EXPONENT - film)
        nut_drag = c.drag * drag_share(c, x - b)
        on_motor, on_nut = disturbance[i, 0], disturbance[i, 1]
        for k in range(waves.shape[0]):
            wave = math.sin(waves[k, 0] * m + waves[k, 1])
            on_motor += waves[k, 2] * wave
            on_nut += waves[k, 3] * wave
        for _ in range(steps):
            force += follow * (target - force)
            fm, ft, fs, fx, fb, twist, axial, rigidity, nut = spring_forces(c, m, t, s, x, b, film)
            if c.structural > 0:
                # Speeds lie half a step before the ways; taken as they are they would make the damping late,
                # and every mode ring high by ζω Δt/2.
                cut = c.structural * twist * (vm - vt + half * (am - at))
                fm -= cut
                ft += cut
                cut = c.structural * axial * (vs - vb + half * (ar - ab))
                fs -= cut
                fb += cut
                cut = c.structural * rigidity * (vt + vs - vx + half * (at + ar - ax))
                ft -= cut
                fs -= cut
                fx += cut
            drag, z = guide_friction(c, vx - vb, z, dt)
            fx -= drag
            fb += drag - c.bed_viscous * vb
            # Drag of the preloaded nut: smooth about standstill, over a twentieth of a millimetre a second.
            ft -= nut_drag * vt / math.sqrt(vt * vt + 2.5e-9)
            fm += force + on_motor - c.motor_viscous * vm
            fx += on_nut + c.gravity
            ft -= on_nut
            fs -= on_nut
            am, at, ar = fm / c.motor, ft / c.screw, fs / c.rod
            pull = c.pitch_stiffness * q + c.pitch_viscous * (vq + half * aq)
            ax, ab = (fx + pull) / rigid, fb / c.bed
            aq = -pull * pitching - ax
            vm += am * dt
            vt += at * dt
            vs += ar * dt
            vx += ax * dt
            vb += ab * dt
            vq += aq * dt
            m += vm * dt
            t += vt * dt
            s += vs * dt
            x += vx * dt
            b += vb * dt
            q += vq * dt
            sum_force += force
            sum_table += ax
            sum_motor += am
            sum_bed += ab
            sum_nut += nut
        out[i, 0] = sum_force / steps
        out[i, 1] = sum_table / steps
        out[i, 2] = sum_motor / steps
        out[i, 3] = sum_bed / steps
        out[i, 6] = sum_nut / steps
    return out, np.array([m, t, s, x, b, vm, vt, vs, vx, vb, z])
