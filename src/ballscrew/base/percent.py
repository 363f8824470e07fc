"""Parts in words."""

from __future__ import annotations


def percent(part: float) -> str:
    """A part as per cent, two digits that count and no power of ten.

    Parameters
    ----------
    part : float
        Ratio; 1 is 100 %.

    Returns
    -------
    str
        ``"0.12 %"``, ``"100 %"``.
    """
    return f"{float(f'{100 * part:.2g}'):g} %"
