"""Simulation of the axial mode, in compiled loops.

One spring, the axis between motor and nut, connects the table to the motor; its stiffness depends on where
the table is. With q the spring's deflection and w(x) the angular frequency at the table's position,

    q'' = drive − w² q − 2 ζ w q',  a = w² q + 2 ζ w q',

where ζ is the damping ratio and a the table's acceleration. The same equation has two uses. With the motor's
force over the total mass as drive, w is the frequency with the rotor free. With the motor's measured
acceleration as drive, w is the frequency with the rotor held.

The spring pushes against the machine's frame. A frame with a mode near w, with angular frequency w_f and
damping ratio ζ_f, moves by x, which adds to the deflection:

    x'' = −ν a − w_f² x − 2 ζ_f w_f x',  q'' = drive − a + x''.

w is then the frequency with the frame blocked. The coupling ν is the moving mass over that of the frame, with
the rotor free times the rotor's part of the total mass; 0 for a frame that does not move.

In the compiled functions a stiffness is divided by the mass, so its unit is 1/s²; ``parameters`` is the array
described in :func:`simulate_mode`.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ballscrew.base.arrays import Array
from ballscrew.base.compilation import compiled

LOAD_STEP = 0.02
"""Step of the loads F/P (load on the nut over its preload) at which :data:`SOFTENING` is tabulated."""

_LOW, _HIGH, _NODES = 0.2, 3.0, 701
"""Tabulated stiffnesses: least and largest, over that at rest in the middle of the axis, and number."""

LEAST_COMPLIANCE = 0.1
"""Least compliance along the axis, over that in the middle: the fit may try profiles that fall below 0."""

_LEAST_LINEAR_LOAD = 1e-3  # F/P: at smaller loads the secant stiffness is that at this load, and not 0/0

LEAST_NUT = 0.3
"""Least compliance of the nut at a stop, over that in the middle: a local stiffening goes no further."""

MOST_SHARE = 0.95
"""Largest share of the compliance that the nut can have: the other parts are never rigid."""


# Windows simulated sample by sample side by side, so that the processor overlaps their operations: 38 % less
# time for 40 windows than one after the other; 4 and 16 take as long as 8.
_TOGETHER = 8


def _softening() -> Array:
    """Relative growth of the nut's secant compliance at the loads F/P = 0, LOAD_STEP, ...; shape (1500,).

    The nut's two flanks are pressed against each other by the preload P; each is a Hertz contact, force
    proportional to approach^1.5. A load F moves the nut by u, in units of the approach under P:

        F/P = (1 + u)^1.5 - (1 - u)^1.5,

    without the second term from u = 1 on, where that flank has lost contact. The stiffness without load is
    the slope at u = 0, 3 P per unit of u. With it F/P would be 3 u; so the secant compliance at a load, over
    that without load, is 3 u / (F/P).
    """
    u = np.linspace(0.0, 10.0, 20001)[1:]
    load = (1 + u) ** 1.5 - np.maximum(1 - u, 0.0) ** 1.5
    grid = np.arange(0.0, 30.0, LOAD_STEP)
    out = np.interp(grid, load, 3 * u / load - 1)
    out[0] = 0.0
    return np.asarray(out)


SOFTENING = _softening()


@compiled(fastmath={"contract", "arcp", "nsz"})
def _growth(load: float, softening: Array) -> float:
    """Relative growth of the nut's secant compliance at a load F/P, from the table :data:`SOFTENING`."""
    at = min(softening.shape[0] - 2.0, abs(load) / LOAD_STEP)  # in this order nan gives the end of the table
    k = np.uint64(at)  # unsigned: an index that may be negative takes longer
    return float(softening[k] + (at - k) * (softening[k + np.uint64(1)] - softening[k]))


@compiled(fastmath={"contract", "arcp", "nsz"})
def _load_ratio(linear: float, share: float, softening: Array) -> float:
    """Load F/P of the nut from ``linear``, the F/P at the same deflection of a nut that does not soften.

    ``share`` is the nut's share of the compliance at rest. The softening depends on the load itself, which is
    found by two steps of a fixed-point iteration.
    """
    first = linear / (1 + share * _growth(linear, softening))
    return float(linear / (1 + share * _growth(first, softening)))


@compiled(fastmath={"contract", "arcp", "nsz"})
def _deflection(load: float, share: float, softening: Array) -> float:
    """Inverse of :func:`_load_ratio`: ``linear`` at a load F/P."""
    return float(load * (1 + share * _growth(load, softening)))


@compiled(fastmath={"contract", "arcp", "nsz"})
def _factors(square: float, parameters: Array, dt: float) -> tuple[float, float]:
    """Factors of the deflection (1/s²) and of its rate (1/s) in the acceleration a of a step.

    With them the difference equation has the poles of the differential equation at ``square`` = w².
    """
    compliance, damping, power = parameters[0], parameters[3], parameters[6]
    # ζ ∝ w^power, by the first terms of its series: stiffnesses along an axis differ by tens of percent.
    excess = square * compliance - 1
    zeta = damping * (1 + 0.5 * power * excess * (1 + 0.25 * (power - 2) * excess))
    return _exact_factors(math.sqrt(square), min(max(zeta, 1e-4), 0.9), dt)


@compiled(fastmath={"contract", "arcp", "nsz"})
def _exact_factors(omega: float, zeta: float, dt: float) -> tuple[float, float]:
    """As :func:`_factors`, for a frequency (rad/s) and a damping ratio."""
    angle = min(omega * dt, 2.0)  # rad per sample; beyond 2 the mode is not sampled
    decay = math.exp(-zeta * angle)
    cosine = math.cos(angle * math.sqrt(1 - zeta * zeta))
    return (1 + decay * decay - 2 * decay * cosine) / (dt * dt), (1 - decay * decay) / dt


@compiled(fastmath={"contract", "arcp", "nsz"})
def _central(stiff: float, damp: float, dt: float) -> tuple[float, float]:
    """Stiffness (1/s²) and damping times Δt/2 that give the same poles if the rate is the mean over a step.

    ``stiff`` and ``damp`` are the factors of :func:`_factors`, for the rate at the start of a step.
    """
    half = damp * dt / (2 - damp * dt)
    return stiff * (1 + half), half


@compiled(fastmath={"contract", "arcp", "nsz"})
def _frame_factors(square: float, parameters: Array, dt: float) -> tuple[float, float, float]:
    """Coupling of the frame, and its stiffness and damping as of :func:`_central`; ``square`` is w².

    A difference equation with the stiffness w² oscillates at w (1 + (w Δt)²/24). The exact factors correct
    this for each mode alone; the factor of the coupling corrects it for the coupled modes, to first order in
    their distance from w.
    """
    angular = parameters[8]
    stiff, half = _central(*_exact_factors(angular, parameters[9], dt), dt)
    return parameters[7] * (1 - (square + angular * angular) * dt * dt / 12), stiff, half


@compiled(fastmath={"contract", "arcp", "nsz"})
def _step_with_frame(
    drive: float, stiff: float, damp: float, frame: tuple[float, float, float], dt: float, state: Array
) -> float:
    """One step of axis and frame; returns the acceleration a of the table, m/s².

    ``state`` is changed: deflection (m) and its rate, displacement of the frame (m) and its rate. Damping
    acts on the mean rate over the step, so that its force is in phase also at the frequencies of the coupled
    modes, which are not those of the exact factors.
    """
    coupling, frame_stiff, frame_half = frame
    stiff, half = _central(stiff, damp, dt)
    share = 1 / (1 + frame_half)
    # Forces by the state before the step; damping by the step's own accelerations is solved for below.
    spring = stiff * state[0] + 2 * half / dt * state[1]
    mounts = frame_stiff * state[2] + 2 * frame_half / dt * state[3]
    change = (drive - spring - share * (coupling * spring + mounts)) / (1 + half * (1 + share * coupling))
    y = spring + half * change
    push = -share * (coupling * y + mounts)
    state[1] += change * dt
    state[0] += state[1] * dt
    state[3] += push * dt
    state[2] += state[3] * dt
    return float(y)


@compiled(fastmath={"contract", "arcp", "nsz"})
def _factor_table(parameters: Array, dt: float) -> Array:
    """Both factors of :func:`_factors` at the nodes of the table; shape (nodes, 6).

    Three columns for each factor: coefficients of the parabola through a node and its neighbours, by powers
    of the distance in nodes. Cosine and exponential in every sample would take half of the time of a
    simulation.
    """
    width = (_HIGH - _LOW) / (_NODES - 1)
    value = np.empty((_NODES + 2, 2))
    for k in range(_NODES + 2):
        # Each element by itself: assignment of a tuple to a row takes seconds to compile.
        value[k, 0], value[k, 1] = _factors((_LOW + (k - 1) * width) / parameters[0], parameters, dt)
    out = np.empty((_NODES, 6))
    for k in range(_NODES):
        for which in range(2):
            before, here, after = value[k, which], value[k + 1, which], value[k + 2, which]
            out[k, 3 * which] = here
            out[k, 3 * which + 1] = (after - before) / 2
            out[k, 3 * which + 2] = (after - 2 * here + before) / 2
    return out


@compiled(fastmath={"contract", "arcp", "nsz"})
def _tabled_factors(square: float, parameters: Array, table: Array, dt: float) -> tuple[float, float]:
    """As :func:`_factors`, from the table of :func:`_factor_table` within its range."""
    at = (square * parameters[0] - _LOW) * (_NODES - 1) / (_HIGH - _LOW)
    if not 0 <= at <= _NODES - 1:
        return _factors(square, parameters, dt)
    node = np.uint64(at + 0.5)
    off = at - node
    stiff = table[node, 0] + off * (table[node, 1] + off * table[node, 2])
    return stiff, table[node, 3] + off * (table[node, 4] + off * table[node, 5])


@compiled(fastmath={"contract", "arcp", "nsz"})
def _along_axis(
    place: Array, local: Array, constant_force: Array, parameters: Array, softening: Array
) -> Array:
    """Quantities that depend on the position alone, for every sample, shape (n, 5).

    Columns: w² at rest, rad²/s²; and, of a nut that softens (else 0), ``linear`` of :func:`_load_ratio` per
    deflection, 1/m; the nut's share of the compliance; ``linear`` and F/P of the constant force.
    """
    slope, curve, nut_share = parameters[1], parameters[2], parameters[5]
    square, per_share = 1 / parameters[0], 1 / nut_share
    out = np.zeros((place.shape[0], 5))
    for i in range(place.shape[0]):
        x = place[i]
        stiffness = 1 / max(1 + slope * x + curve * x * x + local[i], LEAST_COMPLIANCE)  # relative
        out[i, 0] = square * stiffness
        if parameters[4] > 0:
            # The nut's compliance is proportional to P^(-1/3): local wear is a lower preload there.
            nut = max(nut_share + local[i], LEAST_NUT * nut_share)
            share = min(nut * stiffness, MOST_SHARE)
            mass_over_preload = parameters[4] * (nut * per_share) ** 3
            constant = _deflection(mass_over_preload * constant_force[i], share, softening)
            out[i, 1] = mass_over_preload * square * stiffness
            out[i, 2] = share
            out[i, 3] = constant
            out[i, 4] = _load_ratio(constant, share, softening)
    return out


@compiled(fastmath={"contract", "arcp", "nsz"})
def _secant(linear: float, share: float, constant: float, constant_ratio: float, softening: Array) -> float:
    """Secant stiffness over that at rest, from the constant force to the load of the moment.

    ``constant`` and ``constant_ratio`` are ``linear`` and F/P of the constant force, friction and weight.
    """
    if abs(linear) < _LEAST_LINEAR_LOAD:
        linear = _LEAST_LINEAR_LOAD
    return float((_load_ratio(linear + constant, share, softening) - constant_ratio) / linear)


@compiled(fastmath={"contract", "arcp", "nsz"})
def simulate_mode(  # noqa: PLR0913  the compiled part of a simulation
    drive: Array,
    place: Array,
    local: Array,
    constant_force: Array,
    ripple: Array,
    first: NDArray[np.int64],
    order: NDArray[np.int64],
    parameters: Array,
    softening: Array,
    numerator: Array,
    denominator: Array,
    dt: float,
    out: Array,
    ripple_response: Array,
) -> None:
    """Simulate all windows, each from rest.

    The step is exact for a constant stiffness: frequency and damping of the difference equation are those of
    the differential equation. The usual semi-implicit step would ring at a frequency that is too high, by the
    relative amount ζ w Δt / 2.

    Parameters
    ----------
    drive : ndarray, shape (n,)
        m/s², about 0 where a window starts.
    place : ndarray, shape (n,)
        Position of the table from the middle of the axis, m.
    local : ndarray, shape (n,)
        Compliance added by local wear there, over the compliance in the middle.
    constant_force : ndarray, shape (n,)
        Friction and weight on the nut over the moving mass, m/s².
    ripple : ndarray, shape (n, k)
        Further forces, as accelerations, m/s², about 0 where a window starts. They are too small to soften
        the nut, so the response to each is linear in it.
    first : ndarray, shape (windows + 1,)
        First sample of each window, and the end of the last.
    order : ndarray, shape (windows,)
        Indices of the windows, the longest first: those simulated side by side are then of similar length.
    parameters : ndarray, shape (10,)
        Of :class:`~ballscrew.modal.joint.mode.AxialMode`: compliance, slope, curve, damping,
        mass_over_preload, nut_share, power; of the frame: coupling, angular frequency (rad/s), damping ratio.
    softening : ndarray
        :data:`SOFTENING`.
    numerator, denominator : ndarray, shape (sections, 3) and (sections, 2)
        Filter of the band, as second-order sections.
    dt : float
        Time between samples, s.
    out : ndarray, shape (n,)
        Filled with the table's acceleration a in the band, m/s².
    ripple_response : ndarray, shape (n, k)
        Filled with a in the band under each force of ``ripple`` alone, m/s², at the stiffness that results
        from ``drive``.
    """
    frame = _frame_factors(1 / parameters[0], parameters, dt)
    table = _factor_table(parameters, dt)
    along = _along_axis(place, local, constant_force, parameters, softening)
    factors = np.empty((place.shape[0], 2))
    _respond_to_drive(drive, along, first, order, parameters, softening, frame, table, dt, factors, out)
    pass_band(first, numerator, denominator, out.reshape(out.shape[0], 1))
    if ripple.shape[1] > 0:
        _respond_to_ripple(ripple, factors, first, frame, dt, ripple_response)
        pass_band(first, numerator, denominator, ripple_response)


@compiled(fastmath={"contract", "arcp", "nsz"})
def _respond_to_drive(
    drive: Array,
    along: Array,
    first: NDArray[np.int64],
    order: NDArray[np.int64],
    parameters: Array,
    softening: Array,
    frame: tuple[float, float, float],
    table: Array,
    dt: float,
    factors: Array,
    out: Array,
) -> None:
    """Fill ``out`` with a before the filter of the band, and ``factors`` with those of each step."""
    states = np.empty((_TOGETHER, 4))  # deflection and frame, each with its rate
    for begin in range(0, order.shape[0], _TOGETHER):
        windows = order[begin : begin + _TOGETHER]
        states[:] = 0.0
        for step in range(first[windows[0] + 1] - first[windows[0]]):
            for k in range(windows.shape[0]):
                i = first[windows[k]] + step
                if i >= first[windows[k] + 1]:
                    break
                square = along[i, 0]
                if along[i, 1] > 0:
                    linear = along[i, 1] * states[k, 0]
                    square *= _secant(linear, along[i, 2], along[i, 3], along[i, 4], softening)
                stiff, damp = _tabled_factors(max(square, 1.0), parameters, table, dt)
                factors[i, 0], factors[i, 1] = stiff, damp
                if frame[0] > 0:
                    y = _step_with_frame(drive[i], stiff, damp, frame, dt, states[k])
                else:
                    y = stiff * states[k, 0] + damp * states[k, 1]
                    states[k, 1] += (drive[i] - y) * dt
                    states[k, 0] += states[k, 1] * dt
                out[i] = y


@compiled(fastmath={"contract", "arcp", "nsz"})
def _respond_to_ripple(
    ripple: Array,
    factors: Array,
    first: NDArray[np.int64],
    frame: tuple[float, float, float],
    dt: float,
    out: Array,
) -> None:
    """Fill ``out`` with a under each force of the ripple, before the filter of the band."""
    for window in range(first.shape[0] - 1):
        states, with_frame = np.zeros((2, ripple.shape[1])), np.zeros((ripple.shape[1], 4))
        for i in range(first[window], first[window + 1]):
            stiff, damp = factors[i, 0], factors[i, 1]
            if frame[0] > 0:
                for c in range(ripple.shape[1]):
                    out[i, c] = _step_with_frame(ripple[i, c], stiff, damp, frame, dt, with_frame[c])
            else:
                for c in range(ripple.shape[1]):
                    y = stiff * states[0, c] + damp * states[1, c]
                    states[1, c] += (ripple[i, c] - y) * dt
                    states[0, c] += states[1, c] * dt
                    out[i, c] = y


@compiled(fastmath={"contract", "arcp", "nsz"})
def pass_band(first: NDArray[np.int64], numerator: Array, denominator: Array, values: Array) -> None:
    """Filter columns in place, each window from rest.

    Parameters
    ----------
    first : ndarray, shape (windows + 1,)
        First sample of each window, and the end of the last.
    numerator, denominator : ndarray, shape (sections, 3) and (sections, 2)
        Filter as second-order sections.
    values : ndarray, shape (n, columns)
        Overwritten.
    """
    for window in range(first.shape[0] - 1):
        memory = np.zeros((values.shape[1], numerator.shape[0], 2))
        for i in range(first[window], first[window + 1]):
            for c in range(values.shape[1]):
                x = values[i, c]
                for s in range(numerator.shape[0]):
                    y = numerator[s, 0] * x + memory[c, s, 0]
                    memory[c, s, 0] = numerator[s, 1] * x - denominator[s, 0] * y + memory[c, s, 1]
                    memory[c, s, 1] = numerator[s, 2] * x - denominator[s, 1] * y
                    x = y
                values[i, c] = x
