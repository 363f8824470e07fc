"""CUSUM of the residuals against a fixed baseline (Page, 1954, DOI 10.1093/biomet/41.1-2.100)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["cusum"]

Array = NDArray[np.float64]


def cusum(standard: Array, slack: Array, begin: int = 0, most: Array | None = None) -> Array:
    """Sum what exceeds the slack, upwards only.

    Parameters
    ----------
    standard : ndarray, shape (n, ...)
        Standardised residuals, in time order.
    slack : ndarray, shape (n, ...)
        Half of the shift that it is made for, and what the baseline may err by: a wrong baseline must not
        sum up.
    begin : int
        First run that counts.
    most : ndarray, shape (n, ...), optional
        What it is drawn back to, so that it falls again once the shift is gone.

    Returns
    -------
    ndarray, shape (n, ...)
        0 or more.
    """
    sums = np.zeros_like(standard)
    for k in range(begin, len(standard)):
        sums[k] = np.maximum((sums[k - 1] if k > begin else 0.0) + standard[k] - slack[k], 0.0)
        if most is not None:
            sums[k] = np.minimum(sums[k], most[k])
    return sums
