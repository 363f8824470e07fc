"""What parts two accelerometers on one nut: a mount that gave way, or a table that pitches.

Each sees a = (1 + p X) a₀, where X = ω² / (ω₀² − ω² + jβω) is the answer of a mode of its carrier and p its
share of it. A table that pitches gives its two ends shares of some hundredths to some tenths; a loose sensor
*is* the mass of its mode, p = 1. So for two of them

    A₂ (1 + jbω − cω²) = A₁ (g + jdω − geω²),  c = (1 − p₁) / ω₀²,  e = (1 − p₂) / ω₀²,

which is linear in its five unknowns. c over e is near one for a pitching table, and zero or infinite for a
loose sensor.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ballscrew.base.arrays import Array

__all__ = ["is_pitching"]

Spectra = NDArray[np.complexfloating[Any, Any]]

_BAND = (10.0, 300.0)  # Hz; a pitching mode lies at up to 2.2 times the axial one
_AT = 2 * np.pi * 100.0  # rad/s, that makes all unknowns about one
_SHARES = 2.0  # c over e, or e over c: 1.2 / 0.8 with shares of ±0.2, and 1.4 / 0.6 with ±0.4
_LEFT = 0.2  # of the motion that the relation may leave: it must explain what it excuses


def is_pitching(frequency: Array, one: Spectra, other: Spectra) -> bool:
    """Whether two accelerometers differ as both ends of a pitching table do.

    Parameters
    ----------
    frequency : ndarray, shape (n_frequencies,)
        Hz.
    one, other : ndarray, shape (n_pieces, n_frequencies)
        Spectra of the two, over the same pieces of the record.

    Returns
    -------
    bool
        False where the relation of one mode does not explain them, or explains them by a loose sensor.
    """
    inside = (frequency >= _BAND[0]) & (frequency <= _BAND[1])
    a, b = one[:, inside].ravel(), other[:, inside].ravel()
    x = np.broadcast_to(2 * np.pi * frequency[inside] / _AT, one[:, inside].shape).ravel()
    weight = 1 / (1 + x**2)  # or the highest frequencies, where the motion has died, decide
    columns = np.stack([1j * x * b, -(x**2) * b, -a, -1j * x * a, x**2 * a]) * weight
    wanted = -b * weight
    whole = np.concatenate([columns.real, columns.imag], axis=1)
    aim = np.concatenate([wanted.real, wanted.imag])
    size = float(np.linalg.norm(aim))
    if whole.shape[1] < 4 * len(whole) or size == 0 or not np.isfinite(whole).all():
        return False
    answer = np.linalg.lstsq(whole.T, aim, rcond=1e-12)[0]
    left = float(np.linalg.norm(aim - answer @ whole)) / size
    c, g, ge = float(answer[1]), float(answer[2]), float(answer[4])
    if g == 0 or left > _LEFT:
        return False
    e = ge / g
    return bool(min(c, e) > 0 and max(c, e) < _SHARES * min(c, e))
