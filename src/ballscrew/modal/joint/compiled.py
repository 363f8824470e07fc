"""Compiled loops of the joint estimator: simulation of the mode, columns of its blocks, whitening.

The table on its spring is driven along a window.

With q the spring's deflection and w(x) the angular frequency where the table is,

    q'' = drive − w² q − 2 ζ w q',  a = w² q + 2 ζ w q'

holds twice: driven by the motor's force over the whole mass, w is the free frequency; driven by the motor's
acceleration, w is the one with the rotor held. a is the table's acceleration in both.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ballscrew.base.arrays import Array

LOAD_STEP = 0.02
_LOW, _HIGH, _NODES = 0.2, 3.0, 701
"""Tabled range of the stiffness, over that in the middle of the axis at rest."""


def _softening() -> Array:
    """Relative growth of the nut's secant compliance at loads F/P on an even grid.

    Two flanks press against each other, F = P [(1 + u)^1.5 - (1 - u)^1.5] with the second one gone from
    u = 1 on, and 3 u is what F/P would be if the nut kept its stiffness at rest.
    """
    u = np.linspace(0.0, 10.0, 20001)[1:]
    load = (1 + u) ** 1.5 - np.maximum(1 - u, 0.0) ** 1.5
    grid = np.arange(0.0, 30.0, LOAD_STEP)
    out = np.interp(grid, load, 3 * u / load - 1)
    out[0] = 0.0
    return np.asarray(out)


SOFTENING = _softening()


@njit(cache=True, fastmath={"contract", "arcp", "nsz"})
def _load_ratio(strain: float, share: float, softening: Array) -> float:
    """Force over preload, from what it would be if nothing softened.

    The softening depends on the force itself: two steps of the fixed point.
    """
    last = softening.shape[0] - 2.0
    at = min(abs(strain) / LOAD_STEP, last)
    k = int(at)
    growth = softening[k] + (at - k) * (softening[k + 1] - softening[k])
    at = min(at / (1 + share * growth), last)
    k = int(at)
    growth = softening[k] + (at - k) * (softening[k + 1] - softening[k])
    return float(strain / (1 + share * growth))


@njit(cache=True, fastmath={"contract", "arcp", "nsz"})
def _factors(square: float, shape: Array, dt: float) -> tuple[float, float]:
    """Factors of the deflection and its rate in the acceleration of a step, 1/s² and 1/s."""
    compliance, damping, power = shape[0], shape[3], shape[6]
    angle = min(math.sqrt(square) * dt, 2.0)
    # A power of the frequency, by its series: stiffnesses along an axis differ by tens of percent.
    excess = square * compliance - 1
    zeta = damping * (1 + 0.5 * power * excess * (1 + 0.25 * (power - 2) * excess))
    zeta = min(max(zeta, 1e-4), 0.9)
    decay = math.exp(-zeta * angle)
    cosine = math.cos(angle * math.sqrt(1 - zeta * zeta))
    return (1 + decay * decay - 2 * decay * cosine) / (dt * dt), (1 - decay * decay) / dt


@njit(cache=True, fastmath={"contract", "arcp", "nsz"})
def _factor_table(shape: Array, dt: float) -> Array:
    """Both factors on the nodes, each with a parabola through its neighbours; shape (nodes, 6).

    They depend on the stiffness alone, and cosine and exponential in every sample would be half of the time.
    """
    width = (_HIGH - _LOW) / (_NODES - 1)
    value = np.empty((_NODES + 2, 2))
    for k in range(_NODES + 2):
        value[k] = _factors((_LOW + (k - 1) * width) / shape[0], shape, dt)
    out = np.empty((_NODES, 6))
    for k in range(_NODES):
        for which in range(2):
            before, here, after = value[k, which], value[k + 1, which], value[k + 2, which]
            out[k, 3 * which] = here
            out[k, 3 * which + 1] = (after - before) / 2
            out[k, 3 * which + 2] = (after - 2 * here + before) / 2
    return out


@njit(cache=True, fastmath={"contract", "arcp", "nsz"})
def simulate_mode(  # noqa: PLR0913, PLR0915  one compiled loop over the samples
    drive: Array,
    place: Array,
    local: Array,
    friction: Array,
    ripple: Array,
    first: NDArray[np.int64],
    shape: Array,
    softening: Array,
    numerator: Array,
    denominator: Array,
    dt: float,
    out: Array,
    ripple_response: Array,
) -> None:
    """Simulate all windows, each from rest.

    The step is exact for a constant stiffness: frequency and damping of the difference equation are those of
    the differential one. A common semi-implicit step rings too high by half of ζ w Δt.

    Parameters
    ----------
    drive : ndarray, shape (n,)
        m/s², about 0 where a window starts.
    place : ndarray, shape (n,)
        Of the table, m, from the middle of the axis.
    local : ndarray, shape (n,)
        Compliance there beyond its smooth profile, as a part of that in the middle.
    friction : ndarray, shape (n,)
        Friction on the table, as an acceleration, m/s².
    ripple : ndarray, shape (n, k)
        Further forces, too small to soften the nut further, m/s²; about 0 where a window starts.
    first : ndarray, shape (windows + 1,)
        First sample of each window.
    shape : ndarray, shape (7,)
        1/w² in the middle, its relative slope and curvature along the axis, the damping ratio in the middle,
        the nut's load over its preload per m/s², the nut's share of the compliance in the middle, and the
        power of the frequency with which the damping ratio grows.
    softening : ndarray
        :data:`SOFTENING`.
    numerator, denominator : ndarray, shape (sections, 3) and (sections, 2)
        The band's filter, second-order sections.
    dt : float
        s.
    out : ndarray, shape (n,)
        Filled with a in the band.
    ripple_response : ndarray, shape (n, k)
        Filled with a in the band under each force of ``ripple``, on the spring as softened by ``drive``.
    """
    compliance, slope, curve, load, nut_share = shape[0], shape[1], shape[2], shape[4], shape[5]
    sections, count = numerator.shape[0], ripple.shape[1]
    table, per_node = _factor_table(shape, dt), (_NODES - 1) / (_HIGH - _LOW)
    for window in range(first.shape[0] - 1):
        start, stop = first[window], first[window + 1]
        memory = np.zeros((sections, 2))
        state, filtered = np.zeros((2, count)), np.zeros((sections, 2, count))
        q = rate = 0.0
        for i in range(start, stop):
            x = place[i]
            relative = max(1 + slope * x + curve * x * x + local[i], 0.1)
            square = 1 / (compliance * relative)
            if load > 0:
                # A worn nut gives more, in proportion to P^(-1/3).
                nut = max(nut_share + local[i], 0.3 * nut_share)
                share = min(nut / relative, 0.95)
                load_there = load * (nut / nut_share) ** 3
                strain = load_there * square * q
                if abs(strain) < 1e-3:
                    strain = 1e-3
                still = load_there * friction[i]
                square *= (
                    _load_ratio(strain + still, share, softening) - _load_ratio(still, share, softening)
                ) / strain
            square = max(square, 1.0)
            at = (square * compliance - _LOW) * per_node
            if 0 <= at <= _NODES - 1:
                node = int(at + 0.5)
                off = at - node
                stiff = table[node, 0] + off * (table[node, 1] + off * table[node, 2])
                damp = table[node, 3] + off * (table[node, 4] + off * table[node, 5])
            else:
                stiff, damp = _factors(square, shape, dt)
            y = stiff * q + damp * rate
            rate += (drive[i] - y) * dt
            q += rate * dt
            for s in range(sections):
                filtered_y = numerator[s, 0] * y + memory[s, 0]
                memory[s, 0] = numerator[s, 1] * y - denominator[s, 0] * filtered_y + memory[s, 1]
                memory[s, 1] = numerator[s, 2] * y - denominator[s, 1] * filtered_y
                y = filtered_y
            out[i] = y
            for c in range(count):
                y = stiff * state[0, c] + damp * state[1, c]
                state[1, c] += (ripple[i, c] - y) * dt
                state[0, c] += state[1, c] * dt
                ripple_response[i, c] = y
            for s in range(sections):
                for c in range(count):
                    y = ripple_response[i, c]
                    filtered_y = numerator[s, 0] * y + filtered[s, 0, c]
                    filtered[s, 0, c] = (
                        numerator[s, 1] * y - denominator[s, 0] * filtered_y + filtered[s, 1, c]
                    )
                    filtered[s, 1, c] = numerator[s, 2] * y - denominator[s, 1] * filtered_y
                    ripple_response[i, c] = filtered_y


@njit(cache=True, fastmath={"contract", "arcp", "nsz"})
def pitching_response(
    acceleration: Array, first: NDArray[np.int64], frequency: float, damping: float, dt: float, out: Array
) -> None:
    """Response of the pitching mode of the table to its acceleration, each window from rest.

    Parameters
    ----------
    acceleration : ndarray, shape (n,)
        m/s².
    first : ndarray, shape (windows + 1,)
        First sample of each window.
    frequency, damping : float
        Angular frequency, rad/s, and damping ratio.
    dt : float
        s.
    out : ndarray, shape (n,)
        Filled.
    """
    # Bilinear transform, warped so that the resonance stays in place.
    square = frequency * frequency
    k = frequency / math.tan(frequency * dt / 2)
    a0 = k * k + 2 * damping * frequency * k + square
    b0 = square / a0
    a1, a2 = 2 * (square - k * k) / a0, (k * k - 2 * damping * frequency * k + square) / a0
    for window in range(first.shape[0] - 1):
        memory_0 = memory_1 = 0.0
        for i in range(first[window], first[window + 1]):
            x = acceleration[i]
            y = b0 * x + memory_0
            memory_0 = 2 * b0 * x - a1 * y + memory_1
            memory_1 = b0 * x - a2 * y
            out[i] = y


@njit(cache=True)
def _gradient(values: Array) -> Array:
    """Central differences, one-sided at both ends."""
    last = values.shape[0] - 1
    out = np.empty(last + 1)
    out[0], out[last] = values[1] - values[0], values[last] - values[last - 1]
    for i in range(1, last):
        out[i] = 0.5 * (values[i + 1] - values[i - 1])
    return out


@njit(cache=True)
def fill_columns(response: Array, pitching: Array, known: Array, ripple: Array, columns: Array) -> None:
    """Fill the columns of the linear least-squares problem of a block.

    Parameters
    ----------
    response : ndarray, shape (n,)
        Of the axial mode; n is 2 at least.
    pitching : ndarray, shape (n,)
        Response of the pitching mode; empty unless the response of the block is that of the nut. Then second
        derivative and pitching mode have columns too.
    known : ndarray, shape (n, m)
        Columns that do not depend on the mode.
    ripple : ndarray, shape (n, k)
        Response of the mode to the ripple.
    columns : ndarray, shape (n, 2 + m + k) or (n, 5 + m + k)
        Filled, in this order.
    """
    nut = pitching.shape[0] > 0
    own = 5 if nut else 2
    derivative = _gradient(response)
    for i in range(columns.shape[0]):
        columns[i, 0] = response[i]
        columns[i, 1] = derivative[i]
        for k in range(known.shape[1]):
            columns[i, own + k] = known[i, k]
        for k in range(ripple.shape[1]):
            columns[i, own + known.shape[1] + k] = ripple[i, k]
    if nut:
        second, pitching_derivative = _gradient(derivative), _gradient(pitching)
        for i in range(columns.shape[0]):
            columns[i, 2] = second[i]
            columns[i, 3] = pitching[i]
            columns[i, 4] = pitching_derivative[i]


@njit(cache=True)
def whiten_windows(
    values: Array,
    first: NDArray[np.int64],
    taps: Array,
    keep: NDArray[np.bool_],
    free: Array,
    out: Array,
) -> None:
    """Filter every window from rest, with 0 where a sample does not count, orthogonal to two columns.

    Parameters
    ----------
    values : ndarray, shape (n, columns)
        Of all windows, one after the other.
    first : ndarray, shape (windows + 1,)
        First sample of each.
    taps : ndarray
        Of the filter.
    keep : ndarray of bool, shape (n,)
        Samples that count.
    free : ndarray, shape (n, 2)
        Orthonormal in every window.
    out : ndarray, shape (n, columns)
        Filled.
    """
    columns = values.shape[1]
    for window in range(first.shape[0] - 1):
        start, stop = first[window], first[window + 1]
        parts = np.zeros((2, columns))
        for i in range(start, stop):
            if not keep[i]:
                out[i] = 0.0
                continue
            for c in range(columns):
                out[i, c] = taps[0] * values[i, c]
            for k in range(1, min(len(taps), i - start + 1)):
                for c in range(columns):
                    out[i, c] += taps[k] * values[i - k, c]
            for c in range(columns):
                parts[0, c] += free[i, 0] * out[i, c]
                parts[1, c] += free[i, 1] * out[i, c]
        for i in range(start, stop):
            if keep[i]:
                for c in range(columns):
                    out[i, c] -= free[i, 0] * parts[0, c] + free[i, 1] * parts[1, c]


@njit(cache=True)
def free_responses(
    first: NDArray[np.int64],
    begin: NDArray[np.int64],
    omega: Array,
    damping: Array,
    dt: float,
    taps: Array,
    keep: NDArray[np.bool_],
    out: Array,
) -> None:
    """Orthonormal free response of every window, filtered, 0 where a sample does not count.

    Parameters
    ----------
    first : ndarray, shape (windows + 1,)
        First sample of each window.
    begin : ndarray, shape (windows,)
        First sample of each that counts.
    omega : ndarray, shape (windows,)
        Angular frequency, rad/s.
    damping : ndarray, shape (windows,)
        Ratio.
    dt : float
        s.
    taps, keep
        As for :func:`whiten_windows`.
    out : ndarray, shape (n, 2)
        Filled; 0 where nothing counts.
    """
    for window in range(first.shape[0] - 1):
        start, stop = first[window], first[window + 1]
        pair = np.empty((stop - start, 2))
        for i in range(stop - start):
            time = (start + i - begin[window]) * dt
            zeta = damping[window]
            swing = omega[window] * math.sqrt(1 - zeta * zeta) * time
            fade = math.exp(-zeta * omega[window] * max(time, 0.0))
            pair[i, 0], pair[i, 1] = fade * math.cos(swing), fade * math.sin(swing)
        for i in range(stop - start):
            a = b = 0.0
            if keep[start + i]:
                for k in range(min(len(taps), i + 1)):
                    a += taps[k] * pair[i - k, 0]
                    b += taps[k] * pair[i - k, 1]
            out[start + i, 0], out[start + i, 1] = a, b
        _normalise(out[start:stop, 0])
        for _ in range(2):  # once more, since rounding leaves a little
            part = 0.0
            for i in range(start, stop):
                part += out[i, 0] * out[i, 1]
            for i in range(start, stop):
                out[i, 1] -= part * out[i, 0]
            _normalise(out[start:stop, 1])


@njit(cache=True)
def _normalise(x: Array) -> None:
    total = 0.0
    for i in range(x.shape[0]):
        total += x[i] * x[i]
    size = math.sqrt(total)
    for i in range(x.shape[0]):
        x[i] = x[i] / size if size > 0 else 0.0
