"""The mode in which the table pitches: two accelerometers see it, each in its own measure.

What one accelerometer tells of the other is a filter with that mode's poles, whatever moves the table: no
model of the axis is needed.
"""

from __future__ import annotations

import math

import numpy as np

from ballscrew.base.arrays import Array
from ballscrew.modal.joint.model import orthonormal
from ballscrew.modal.joint.windows import Windows

__all__ = ["pitching_mode"]

_TOLD = 0.6  # of what a plain gain leaves unexplained; more is not told
_MOST_DAMPING = 0.1
_ALIKE = 1e-12  # of eigenvalues: columns below are told apart by nothing


def pitching_mode(w: Windows, low: float, high: float) -> tuple[float, float] | None:
    """Find the mode between the accelerometers.

    Parameters
    ----------
    w : Windows
        Averaged windows.
    low, high : float
        Where to look, Hz.

    Returns
    -------
    frequency, damping : float
        Hz and ratio; None where there are no two accelerometers, or they see no difference.
    """
    if len(w.nut) < 2:
        return None
    from scipy.optimize import minimize

    high = min(high, 0.4 * w.rate)
    grid = [(f, z) for f in np.geomspace(low, high, 30) for z in (0.02, 0.06)]
    left = [_unexplained(w, f, z) for f, z in grid]
    f, z = grid[int(np.argmin(left))]

    def miss(v: Array) -> float:
        return math.log(_unexplained(w, math.exp(v[0]), math.exp(v[1])))

    best = minimize(
        miss,
        np.log([f, z]),
        method="Nelder-Mead",
        options={"maxiter": 40, "xatol": 1e-3, "fatol": 1e-3},
    )
    f, z = math.exp(best.x[0]), math.exp(best.x[1])
    told = math.exp(best.fun) < _TOLD * max(left) and low < f < high and z < _MOST_DAMPING
    return (f, z) if told else None


def _unexplained(w: Windows, frequency: float, damping: float) -> float:
    """Part of the second accelerometer that a mode of this frequency cannot make of the first."""
    from scipy.signal import lfilter

    wp = 2 * math.pi * min(frequency, 0.45 * w.rate)
    k = wp / math.tan(wp / w.rate / 2)
    whole = k * k + 2 * damping * wp * k + wp * wp
    b = np.array([1.0, 2.0, 1.0]) * (wp * wp / whole)
    a = [1.0, 2 * (wp * wp - k * k) / whole, (k * k - 2 * damping * wp * k + wp * wp) / whole]
    one, other = w.nut[0], w.nut[1]
    seen = np.concatenate([lfilter(b, a, one[i:j]) for i, j in w.spans])
    columns = np.stack([one, np.gradient(one), seen, np.gradient(seen)])[:, w.early]
    wanted = other[w.early]
    part = orthonormal(columns @ columns.T, _ALIKE).T @ (columns @ wanted)
    return max(1 - float(part @ part) / float(wanted @ wanted), 1e-12)
