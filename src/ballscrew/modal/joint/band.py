"""The band in which a mode is sought, as a filter."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ballscrew.base.arrays import Array

__all__ = ["Band", "band_filter"]


@dataclass(frozen=True, slots=True)
class Band:
    """A band-pass of second-order sections; ``low`` and ``high`` in Hz."""

    low: float
    high: float
    numerator: Array
    denominator: Array

    @property
    def sections(self) -> Array:
        """As scipy wants them, shape (sections, 6)."""
        return np.hstack([self.numerator, np.ones((len(self.numerator), 1)), self.denominator])


def band_filter(low: float, high: float, rate: float) -> Band:
    """Butterworth sections, second order at either end."""
    from scipy.signal import butter

    high = min(high, 0.42 * rate)
    sections = np.concatenate(
        [butter(2, low, "high", fs=rate, output="sos"), butter(2, high, "low", fs=rate, output="sos")]
    )
    return Band(low, high, np.ascontiguousarray(sections[:, :3]), np.ascontiguousarray(sections[:, 4:]))
