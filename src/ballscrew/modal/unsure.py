"""The one sentence for a frequency that is less sure than it should be."""

from __future__ import annotations

__all__ = ["unsure"]


def unsure(uncertainty: float, most: float) -> str:
    """Say that an uncertainty is too large, and what would not be.

    Parameters
    ----------
    uncertainty : float
        Standard uncertainty of a frequency, Hz.
    most : float
        What it may be, as a part of the frequency.

    Returns
    -------
    str
        Without a full stop.
    """
    return f"the standard uncertainty is ± {uncertainty:.1f} Hz, above {100 * most:.3g} % of the frequency"
