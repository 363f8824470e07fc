"""The reason given by both methods for a cell whose frequency is too uncertain."""

from __future__ import annotations


def large_uncertainty(uncertainty: float, limit: float) -> str:
    """Return the sentence, without a full stop.

    Parameters
    ----------
    uncertainty : float
        Standard uncertainty of a frequency, Hz.
    limit : float
        Its upper limit, as a part of the frequency.
    """
    return f"the standard uncertainty is ± {uncertainty:.1f} Hz, above {100 * limit:.3g} % of the frequency"
