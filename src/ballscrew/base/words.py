"""Numbers in words."""

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


def plural(number: int, noun: str) -> str:
    """Number and noun, ``"1 cell"`` or ``"3 cells"``."""
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def duration(seconds: float) -> str:
    """Duration in seconds, minutes or hours, ``"90.0 s"`` or ``"2.5 h"``."""
    if seconds < 120:
        return f"{seconds:.1f} s"
    minutes = seconds / 60
    return f"{minutes:.1f} min" if minutes < 120 else f"{minutes / 60:.1f} h"
