"""Array type used in every signature: NumPy, double precision."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def real_samples(values: Any) -> Array:
    """Samples in float64; masked ones are NaN.

    Raises
    ------
    TypeError
        If they are complex or boolean: their conversion would lose what they mean.
    ValueError
        If they are no numbers.
    """
    if np.ma.isMaskedArray(values):
        values = np.ma.filled(values.astype(np.float64), np.nan)
    samples = np.asarray(values)
    if samples.dtype.kind in "bc":
        raise TypeError(f"samples are {samples.dtype}")
    return samples.astype(np.float64, copy=False)
