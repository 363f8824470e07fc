"""Simulation of the axial mode, in compiled loops.

One spring, the axis between motor and nut, connects the table to the motor; its stiffness depends on where
the table is. With q the spring's deflection and w(x) the angular frequency at the table's position,

    q'' = drive − w² q − 2 ζ w q',  a = w² q + 2 ζ w q',

where ζ is the damping ratio and a the table's acceleration. The same equation has two uses. With the motor's
force over the total mass as drive, w is the frequency with the rotor free, and q the deflection times the
rotor's part of the total mass. With the motor's measured acceleration as drive, w is the frequency with the
rotor held.

The spring pushes against the machine's frame. A frame with a mode near w, with angular frequency w_f and
damping ratio ζ_f, moves by x, which adds to the deflection:

    x'' = −ν a − w_f² x − 2 ζ_f w_f x',  q'' = drive − a + x''.

w is then the frequency with the frame blocked. The coupling ν is the moving mass over that of the frame, with
the rotor free times the field ``rotor_part`` of :class:`~ballscrew.modal.joint.mode.AxialMode`; 0 for a frame
that does not move. A part σ of the table's mass that pitches by q_p leads to the same equations with
x = σ q_p, ν = σ/(1 − σ) and w_f the frequency of pitching over sqrt(1 − σ).

In the compiled functions a stiffness is divided by the mass, so its unit is 1/s². Their common parameters:

``parameters``
    Parameters of the mode, see :func:`simulate_mode`.
``softening``
    :data:`SOFTENING`.
``square``
    w², the stiffness of the axis, 1/s².
``dt``
    Time between samples, s.
``starts``
    Index of the first sample of each window, and the number of samples, shape (windows + 1,).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ballscrew.base.arrays import Array
from ballscrew.base.compilation import compiled
from ballscrew.modal.joint.mode import AxialMode

LOAD_STEP = 0.02
"""Step of the loads F/P (load on the nut over its preload) at which :data:`SOFTENING` is tabulated."""

# Stiffnesses at which the factors of a step are tabulated, over the stiffness at rest in the middle of the
# axis. Beyond them the factors are computed, which takes longer.
_LEAST_TABULATED = 0.2
_LARGEST_TABULATED = 3.0
_NODES = 701  # number of tabulated stiffnesses

LEAST_COMPLIANCE = 0.1
"""Least compliance along the axis, over that in the middle: the fit may try profiles that fall below 0."""

_LEAST_SQUARE = 1.0  # 1/s²: a smaller stiffness, of a trial step of the fit, counts as this one
_LEAST_LINEAR_LOAD = 1e-3  # F/P: at smaller loads the secant stiffness is that at this load, and not 0/0

# Limits of the damping ratio: below the first the vibration would hardly decay, above the second (as in
# ballscrew.modal.joint.mode) the mode would not oscillate.
_LEAST_DAMPING = 1e-4
_MOST_DAMPING = 0.9

LEAST_NUT = 0.3
"""Least compliance of the nut along the axis, over that in the middle: a local stiffening has this limit."""

MOST_SHARE = 0.95
"""Largest share of the compliance that the nut can have: the other parts are never rigid."""

# Windows that are simulated side by side, sample by sample, so that the processor overlaps their operations:
# 38 % less time for 40 windows than in sequence. 4 and 16 take as long as 8.
_SIDE_BY_SIDE = 8

# Elements of ``parameters``.
_COMPLIANCE, _SLOPE, _CURVE, _DAMPING, _MASS_OVER_PRELOAD, _NUT_SHARE, _DAMPING_EXPONENT = range(7)
_COUPLING, _FRAME_FREQUENCY, _FRAME_DAMPING = range(7, 10)
# Elements of the state of a window: deflection of the spring (m), displacement of the frame (m), their rates.
_DEFLECTION, _RATE, _FRAME_DISPLACEMENT, _FRAME_RATE = range(4)
# Columns of the result of _along_axis, which describes them.
_SQUARE, _LINEAR_PER_DEFLECTION, _SHARE, _SLOW_LINEAR, _SLOW_RATIO = range(5)


def _softening() -> Array:
    """Relative growth of the nut's secant compliance, over that without load; shape (1500,).

    At the loads F/P = 0, LOAD_STEP, 2 LOAD_STEP and so on, up to 30.

    The nut's two flanks are pressed against each other by the preload P; each is a Hertz contact, force
    proportional to approach^1.5. A load F moves the nut by u, in units of the approach under P:

        F/P = (1 + u)^1.5 - (1 - u)^1.5,

    without the second term from u = 1 on, where that flank has lost contact. The stiffness without load is
    the slope at u = 0, 3 P per unit of u. With this stiffness F/P would be 3 u at any u; so the secant
    compliance at a load, over that without load, is 3 u / (F/P).
    """
    u = np.linspace(0.0, 10.0, 20001)[1:]
    load = (1 + u) ** 1.5 - np.maximum(1 - u, 0.0) ** 1.5
    grid = np.arange(0.0, 30.0, LOAD_STEP)
    out = np.interp(grid, load, 3 * u / load - 1)
    out[0] = 0.0  # at no load 3 u / (F/P) is 0/0
    return np.asarray(out)


SOFTENING = _softening()
"""Result of :func:`_softening`, an argument of compiled functions."""


def simulation_parameters(mode: AxialMode) -> Array:
    """Parameters of a mode, as an array for compiled functions.

    Parameters
    ----------
    mode : AxialMode
        The mode.

    Returns
    -------
    ndarray, shape (10,)
        Compliance (s²), slope (1/m), whole curve (1/m²), damping ratio, mass over preload (kg/N), share of
        the nut, and exponent of the damping ratio; of the frame: coupling, angular frequency (rad/s) and
        damping ratio.
    """
    out = np.empty(10)
    out[_COMPLIANCE] = mode.compliance
    out[_SLOPE] = mode.slope
    out[_CURVE] = mode.whole_curve
    out[_DAMPING] = mode.damping
    out[_MASS_OVER_PRELOAD] = mode.mass_over_preload
    out[_NUT_SHARE] = mode.nut_share
    out[_DAMPING_EXPONENT] = mode.damping_exponent
    out[_COUPLING] = mode.frame_coupling
    out[_FRAME_FREQUENCY] = 2 * math.pi * mode.frame
    out[_FRAME_DAMPING] = mode.frame_damping
    return out


@compiled(fastmath={"contract", "arcp", "nsz"})
def _compliance_growth(load: float, softening: Array) -> float:
    """Relative growth of the nut's secant compliance at a load F/P, from the table :data:`SOFTENING`."""
    # Position in the table, in nodes. With the arguments in this order nan gives the end of the table.
    position = min(softening.shape[0] - 2.0, abs(load) / LOAD_STEP)
    k = np.uint64(position)  # unsigned: an index that may be negative takes longer
    return float(softening[k] + (position - k) * (softening[k + np.uint64(1)] - softening[k]))


@compiled(fastmath={"contract", "arcp", "nsz"})
def _load_ratio(linear: float, share: float, softening: Array) -> float:
    """Load F/P on the nut at a deflection of the axis.

    ``linear`` is the F/P at the same deflection if the nut did not soften, and ``share`` the nut's share of
    the compliance at rest. The softening depends on the load itself, which is found by two steps of a
    fixed-point iteration.
    """
    first = linear / (1 + share * _compliance_growth(linear, softening))
    return float(linear / (1 + share * _compliance_growth(first, softening)))


@compiled(fastmath={"contract", "arcp", "nsz"})
def _linear_load_ratio(load: float, share: float, softening: Array) -> float:
    """Inverse of :func:`_load_ratio`: its parameter ``linear`` at a load F/P."""
    return float(load * (1 + share * _compliance_growth(load, softening)))


@compiled(fastmath={"contract", "arcp", "nsz"})
def _factors(square: float, parameters: Array, dt: float) -> tuple[float, float]:
    """Stiffness (1/s²) and damping (1/s): factors of deflection and rate in the acceleration a of a step.

    With them the difference equation has the poles of the differential equation at ``square``. Damping acts
    on the rate at the start of the step.
    """
    compliance, damping = parameters[_COMPLIANCE], parameters[_DAMPING]
    exponent = parameters[_DAMPING_EXPONENT]
    # ζ is proportional to w^exponent. The first terms of the series by w² about its value in the middle
    # suffice: stiffnesses along an axis differ by tens of percent.
    excess = square * compliance - 1
    zeta = damping * (1 + 0.5 * exponent * excess * (1 + 0.25 * (exponent - 2) * excess))
    return _exact_factors(math.sqrt(square), min(max(zeta, _LEAST_DAMPING), _MOST_DAMPING), dt)


@compiled(fastmath={"contract", "arcp", "nsz"})
def _exact_factors(omega: float, zeta: float, dt: float) -> tuple[float, float]:
    """As :func:`_factors`, from an angular frequency (rad/s) and a damping ratio."""
    angle = min(omega * dt, 2.0)  # rad per sample; the rate is too low for a mode beyond 2
    decay = math.exp(-zeta * angle)
    cosine = math.cos(angle * math.sqrt(1 - zeta * zeta))
    return (1 + decay * decay - 2 * decay * cosine) / (dt * dt), (1 - decay * decay) / dt


@compiled(fastmath={"contract", "arcp", "nsz"})
def _central_factors(stiff: float, damp: float, dt: float) -> tuple[float, float]:
    """Stiffness (1/s²) and damping times dt/2 (without unit) where damping acts on the mean rate of a step.

    ``stiff`` and ``damp`` are the factors of :func:`_factors`, for the rate at the start of a step. Both
    pairs give the difference equation the same poles.
    """
    half = damp * dt / (2 - damp * dt)
    return stiff * (1 + half), half


@compiled(fastmath={"contract", "arcp", "nsz"})
def _frame_factors(square: float, parameters: Array, dt: float) -> tuple[float, float, float]:
    """Coupling of the frame (without unit), and its stiffness and damping as of :func:`_central_factors`.

    A difference equation with the stiffness w² oscillates at w (1 + (w dt)²/24). The exact factors correct
    this for each mode alone. A coupled mode of frequency W needs the factor 1 − (W² + w_f²) dt²/12 of the
    coupling; here W is that of the axial mode in the middle of the axis, w.
    """
    angular = parameters[_FRAME_FREQUENCY]
    stiff, half = _central_factors(*_exact_factors(angular, parameters[_FRAME_DAMPING], dt), dt)
    return parameters[_COUPLING] * (1 - (square + angular * angular) * dt * dt / 12), stiff, half


@compiled(fastmath={"contract", "arcp", "nsz"})
def _step_with_frame(
    drive: float, stiff: float, damp: float, frame: tuple[float, float, float], dt: float, state: Array
) -> float:
    """Advance axis and frame by one step; return the acceleration a of the table, m/s².

    Damping acts on the mean rate over the step, so that its force is in phase also at the frequencies of the
    coupled modes, which are not those of the exact factors.

    Parameters
    ----------
    drive : float
        m/s².
    stiff, damp : float
        Factors of the axis, as of :func:`_factors`.
    frame : tuple of float
        Result of :func:`_frame_factors`.
    dt : float
        Time between samples, s.
    state : ndarray, shape (4,)
        Deflection (m) and its rate (m/s), displacement of the frame (m) and its rate (m/s); changed.
    """
    coupling, frame_stiff, frame_half = frame
    stiff, half = _central_factors(stiff, damp, dt)
    mobility = 1 / (1 + frame_half)  # factor by the damping due to the acceleration in the step
    # Forces over the masses, by the state before the step. Damping by the accelerations in the step is added
    # by solving for these accelerations.
    spring = stiff * state[_DEFLECTION] + 2 * half / dt * state[_RATE]
    mounts = frame_stiff * state[_FRAME_DISPLACEMENT] + 2 * frame_half / dt * state[_FRAME_RATE]
    deflection_acceleration = (drive - spring - mobility * (coupling * spring + mounts)) / (
        1 + half * (1 + mobility * coupling)
    )
    acceleration = spring + half * deflection_acceleration  # of the table
    frame_acceleration = -mobility * (coupling * acceleration + mounts)
    state[_RATE] += deflection_acceleration * dt
    state[_DEFLECTION] += state[_RATE] * dt
    state[_FRAME_RATE] += frame_acceleration * dt
    state[_FRAME_DISPLACEMENT] += state[_FRAME_RATE] * dt
    return float(acceleration)


@compiled(fastmath={"contract", "arcp", "nsz"})
def _factor_table(parameters: Array, dt: float) -> Array:
    """Both factors of :func:`_factors` at equidistant stiffnesses, the nodes; shape (nodes, 6).

    Three columns for each factor: coefficients of the parabola through a node and its neighbours, by
    ascending powers of the distance in nodes. Cosine and exponential in every sample would take half of the
    time of a simulation.
    """
    width = (_LARGEST_TABULATED - _LEAST_TABULATED) / (_NODES - 1)
    value = np.empty((_NODES + 2, 2))  # with a node before the first and one after the last
    for k in range(_NODES + 2):
        square = (_LEAST_TABULATED + (k - 1) * width) / parameters[_COMPLIANCE]
        # Each element by itself: assignment of a tuple to a row takes seconds to compile.
        value[k, 0], value[k, 1] = _factors(square, parameters, dt)
    out = np.empty((_NODES, 6))
    for k in range(_NODES):
        for factor in range(2):
            before, here, after = value[k, factor], value[k + 1, factor], value[k + 2, factor]
            out[k, 3 * factor] = here
            out[k, 3 * factor + 1] = (after - before) / 2
            out[k, 3 * factor + 2] = (after - 2 * here + before) / 2
    return out


@compiled(fastmath={"contract", "arcp", "nsz"})
def _interpolated_factors(square: float, parameters: Array, table: Array, dt: float) -> tuple[float, float]:
    """As :func:`_factors`, but from the table of :func:`_factor_table` within its range."""
    relative = square * parameters[_COMPLIANCE]
    position = (relative - _LEAST_TABULATED) * (_NODES - 1) / (_LARGEST_TABULATED - _LEAST_TABULATED)
    if not 0 <= position <= _NODES - 1:
        return _factors(square, parameters, dt)
    node = np.uint64(position + 0.5)  # the nearest one
    distance = position - node
    stiff = table[node, 0] + distance * (table[node, 1] + distance * table[node, 2])
    damp = table[node, 3] + distance * (table[node, 4] + distance * table[node, 5])
    return stiff, damp


@compiled(fastmath={"contract", "arcp", "nsz"})
def _along_axis(
    centred_position: Array, local: Array, slow_force: Array, parameters: Array, softening: Array
) -> Array:
    """Quantities that do not depend on the vibration, for every sample, shape (n, 5).

    Columns: w² at rest, 1/s²; and for a nut that softens (else 0) ``linear`` of :func:`_load_ratio` per
    deflection, 1/m; the nut's share of the compliance; ``linear`` by the slow force; and F/P by it.

    Parameters
    ----------
    centred_position, local, slow_force, parameters, softening
        As for :func:`simulate_mode`.
    """
    slope, curve, nut_share = parameters[_SLOPE], parameters[_CURVE], parameters[_NUT_SHARE]
    square, per_share = 1 / parameters[_COMPLIANCE], 1 / nut_share
    out = np.zeros((centred_position.shape[0], 5))
    for i in range(centred_position.shape[0]):
        x = centred_position[i]
        stiffness = 1 / max(1 + slope * x + curve * x * x + local[i], LEAST_COMPLIANCE)  # relative
        out[i, _SQUARE] = square * stiffness
        if parameters[_MASS_OVER_PRELOAD] > 0:
            # Local wear is a lower preload there: the nut's compliance is proportional to P^(-1/3).
            nut = max(nut_share + local[i], LEAST_NUT * nut_share)  # compliance, over that in the middle
            share = min(nut * stiffness, MOST_SHARE)
            mass_over_preload = parameters[_MASS_OVER_PRELOAD] * (nut * per_share) ** 3
            slow = _linear_load_ratio(mass_over_preload * slow_force[i], share, softening)
            out[i, _LINEAR_PER_DEFLECTION] = mass_over_preload * square * stiffness
            out[i, _SHARE] = share
            out[i, _SLOW_LINEAR] = slow
            out[i, _SLOW_RATIO] = _load_ratio(slow, share, softening)
    return out


@compiled(fastmath={"contract", "arcp", "nsz"})
def _secant(linear: float, share: float, slow: float, slow_ratio: float, softening: Array) -> float:
    """Secant stiffness of the axis from the slow force to the momentary load, over that at rest.

    ``linear`` and ``share`` are those of :func:`_load_ratio`, at the momentary deflection. ``slow`` and
    ``slow_ratio`` are ``linear`` and F/P by the slow force.
    """
    if abs(linear) < _LEAST_LINEAR_LOAD:
        linear = _LEAST_LINEAR_LOAD
    return float((_load_ratio(linear + slow, share, softening) - slow_ratio) / linear)


@compiled(fastmath={"contract", "arcp", "nsz"})
def simulate_mode(  # noqa: PLR0913  the compiled part of a simulation
    drive: Array,
    centred_position: Array,
    local: Array,
    slow_force: Array,
    ripple: Array,
    starts: NDArray[np.int64],
    longest_first: NDArray[np.int64],
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
    the differential equation. The usual semi-implicit step would give a frequency that is too high, by the
    relative amount ζ w dt / 2.

    Parameters
    ----------
    drive : ndarray, shape (n,)
        Force of the motor over the total mass, or acceleration of the motor, m/s²; about 0 where a window
        starts.
    centred_position : ndarray, shape (n,)
        Position of the table from the middle of the axis, m.
    local : ndarray, shape (n,)
        Compliance added by local wear there, over the compliance in the middle.
    slow_force : ndarray, shape (n,)
        Slow load on the nut beside the force of the drive, over the moving mass, m/s²: friction of the guide
        and weight, less the part of the drive that overcomes friction.
    ripple : ndarray, shape (n, k)
        Further forces, as accelerations, m/s², about 0 where a window starts. They are too small to soften
        the nut, so the response to each is linear in it.
    starts : ndarray, shape (windows + 1,)
        Index of the first sample of each window, and the number of samples.
    longest_first : ndarray, shape (windows,)
        Indices of the windows, the longest first: those simulated side by side are then of similar length.
    parameters : ndarray, shape (10,)
        Result of :func:`simulation_parameters`.
    softening : ndarray, shape (1500,)
        :data:`SOFTENING`.
    numerator, denominator : ndarray, shape (sections, 3) and (sections, 2)
        Coefficients of the filter of the band, see :class:`~ballscrew.modal.joint.windows.Band`.
    dt : float
        Time between samples, s.
    out : ndarray, shape (n,)
        Filled with the table's acceleration a in the band, m/s².
    ripple_response : ndarray, shape (n, k)
        Filled with a in the band under each force of ``ripple`` alone, m/s², at the stiffness that results
        from ``drive``.
    """
    frame = _frame_factors(1 / parameters[_COMPLIANCE], parameters, dt)
    table = _factor_table(parameters, dt)
    along = _along_axis(centred_position, local, slow_force, parameters, softening)
    factors = np.empty((centred_position.shape[0], 2))
    _respond_to_drive(
        drive, along, starts, longest_first, parameters, softening, frame, table, dt, factors, out
    )
    pass_band(starts, numerator, denominator, out.reshape(out.shape[0], 1))
    if ripple.shape[1] > 0:
        _respond_to_ripple(ripple, factors, starts, frame, dt, ripple_response)
        pass_band(starts, numerator, denominator, ripple_response)


@compiled(fastmath={"contract", "arcp", "nsz"})
def _respond_to_drive(
    drive: Array,
    along: Array,
    starts: NDArray[np.int64],
    longest_first: NDArray[np.int64],
    parameters: Array,
    softening: Array,
    frame: tuple[float, float, float],
    table: Array,
    dt: float,
    factors: Array,
    out: Array,
) -> None:
    """Simulate the response to the drive, before the filter of the band.

    Parameters
    ----------
    drive, starts, longest_first, parameters, softening, dt
        As for :func:`simulate_mode`.
    along : ndarray, shape (n, 5)
        Result of :func:`_along_axis`.
    frame : tuple of float
        Result of :func:`_frame_factors`.
    table : ndarray, shape (nodes, 6)
        Result of :func:`_factor_table`.
    factors : ndarray, shape (n, 2)
        Filled with the factors of each step, as of :func:`_factors`.
    out : ndarray, shape (n,)
        Filled with a, m/s².
    """
    states = np.empty((_SIDE_BY_SIDE, 4))
    for begin in range(0, longest_first.shape[0], _SIDE_BY_SIDE):
        windows = longest_first[begin : begin + _SIDE_BY_SIDE]
        states[:] = 0.0  # each window begins at rest
        for step in range(starts[windows[0] + 1] - starts[windows[0]]):
            for k in range(windows.shape[0]):
                i = starts[windows[k]] + step
                if i >= starts[windows[k] + 1]:
                    break  # this window and all after it, which are no longer, have ended
                square = along[i, _SQUARE]
                if along[i, _LINEAR_PER_DEFLECTION] > 0:
                    linear = along[i, _LINEAR_PER_DEFLECTION] * states[k, _DEFLECTION]
                    share, slow = along[i, _SHARE], along[i, _SLOW_LINEAR]
                    square *= _secant(linear, share, slow, along[i, _SLOW_RATIO], softening)
                stiff, damp = _interpolated_factors(max(square, _LEAST_SQUARE), parameters, table, dt)
                factors[i, 0], factors[i, 1] = stiff, damp
                if frame[0] > 0:
                    acceleration = _step_with_frame(drive[i], stiff, damp, frame, dt, states[k])
                else:
                    acceleration = stiff * states[k, _DEFLECTION] + damp * states[k, _RATE]
                    states[k, _RATE] += (drive[i] - acceleration) * dt
                    states[k, _DEFLECTION] += states[k, _RATE] * dt
                out[i] = acceleration


@compiled(fastmath={"contract", "arcp", "nsz"})
def _respond_to_ripple(
    ripple: Array,
    factors: Array,
    starts: NDArray[np.int64],
    frame: tuple[float, float, float],
    dt: float,
    out: Array,
) -> None:
    """Simulate the response to each force of the ripple, before the filter of the band.

    Parameters
    ----------
    ripple, starts, dt
        As for :func:`simulate_mode`.
    factors : ndarray, shape (n, 2)
        Factors of each step, as filled by :func:`_respond_to_drive`.
    frame : tuple of float
        Result of :func:`_frame_factors`.
    out : ndarray, shape (n, k)
        Filled with a under each force alone, m/s².
    """
    for window in range(starts.shape[0] - 1):
        # One row for deflections and one for their rates, so that the loop over the forces is vectorised.
        states, with_frame = np.zeros((2, ripple.shape[1])), np.zeros((ripple.shape[1], 4))
        for i in range(starts[window], starts[window + 1]):
            stiff, damp = factors[i, 0], factors[i, 1]
            if frame[0] > 0:
                for c in range(ripple.shape[1]):
                    out[i, c] = _step_with_frame(ripple[i, c], stiff, damp, frame, dt, with_frame[c])
            else:
                for c in range(ripple.shape[1]):
                    acceleration = stiff * states[_DEFLECTION, c] + damp * states[_RATE, c]
                    states[_RATE, c] += (ripple[i, c] - acceleration) * dt
                    states[_DEFLECTION, c] += states[_RATE, c] * dt
                    out[i, c] = acceleration


@compiled(fastmath={"contract", "arcp", "nsz"})
def pass_band(starts: NDArray[np.int64], numerator: Array, denominator: Array, values: Array) -> None:
    """Filter columns in place; each window begins at rest.

    Parameters
    ----------
    starts : ndarray, shape (windows + 1,)
        Index of the first sample of each window, and the number of samples.
    numerator, denominator : ndarray, shape (sections, 3) and (sections, 2)
        Coefficients of the filter, second-order sections; the leading 1 of the denominators is omitted.
    values : ndarray, shape (n, columns)
        Signals; overwritten.
    """
    for window in range(starts.shape[0] - 1):
        memory = np.zeros((values.shape[1], numerator.shape[0], 2))
        for i in range(starts[window], starts[window + 1]):
            for c in range(values.shape[1]):
                x = values[i, c]
                for s in range(numerator.shape[0]):  # the output of a section is the input of the next
                    y = numerator[s, 0] * x + memory[c, s, 0]
                    memory[c, s, 0] = numerator[s, 1] * x - denominator[s, 0] * y + memory[c, s, 1]
                    memory[c, s, 1] = numerator[s, 2] * x - denominator[s, 1] * y
                    x = y
                values[i, c] = x
