"""A mode of the axis runs along it on one smooth curve, through most cells; ripple and noise do not."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

__all__ = ["off_the_curve", "too_few"]

_TOLERANCE = 0.08  # of the frequency: a local defect changes it by 1 or 2 %, a wrong peak by more
_SCALE = 0.02  # of the frequency, beyond which a cell's pull on the curve fades
_LEAST_PART = 1 / 3  # of the measured cells that must show the mode


def off_the_curve(position: Sequence[float], frequency: Sequence[float]) -> NDArray[np.bool_]:
    """Which cells' peaks do not lie on the curve of the others.

    The curve is 1/f² as a polynomial of the position, which is what Eq. (3) says: of first degree where one
    end of the screw is free, of second where both are fixed. It is fitted with a loss that outliers cannot
    pull far.

    Parameters
    ----------
    position : sequence of float
        Stops, m.
    frequency : sequence of float
        Peaks, Hz.

    Returns
    -------
    ndarray of bool
        True for those off the curve.
    """
    x, f = np.asarray(position, dtype=np.float64), np.asarray(frequency, dtype=np.float64)
    stops = len(np.unique(x))
    if len(f) < 3:
        return np.zeros(len(f), dtype=bool)
    span = np.ptp(x) or 1.0
    centre = np.median(f)
    basis = np.vander((x - x.mean()) / span, 1 + min(2, max(0, (stops - 1) // 2)), increasing=True)

    def residual(coefficients: NDArray[np.float64]) -> NDArray[np.float64]:
        # d(1/f²)·f²/2 is the relative deviation of the frequency
        return np.asarray((basis @ coefficients - (centre / f) ** 2) * (f / centre) ** 2 / 2)

    start = np.zeros(basis.shape[1])
    start[0] = 1.0
    fit = least_squares(residual, start, loss="cauchy", f_scale=_SCALE)
    return np.abs(residual(fit.x)) > _TOLERANCE


def too_few(shown: int, measured: int) -> bool:
    """Whether too few of the measured cells show the mode for it to be one of the axis.

    Parameters
    ----------
    shown : int
        Cells with a peak on one curve.
    measured : int
        Cells with transients.

    Returns
    -------
    bool
        True below a third.
    """
    return shown < _LEAST_PART * measured
