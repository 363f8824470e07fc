"""Numbers in words."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence

NONE = "–"
"""In place of a number that is not known."""
_NARROW = 0.02  # width of an interval of P/P₀ below which tenths of a percent count
_LEAST = 40  # characters of the end of a sentence that are not repeated


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


def fixed(value: float, decimals: int) -> str:
    """A number with fixed decimals."""
    return f"{value:.{decimals}f}"


def plural(number: int, noun: str) -> str:
    """Number and noun, ``"1 cell"`` or ``"3 cells"``."""
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def duration(seconds: float) -> str:
    """Duration in seconds, minutes or hours, ``"90.0 s"`` or ``"2.5 h"``."""
    if seconds < 120:
        return f"{seconds:.1f} s"
    minutes = seconds / 60
    return f"{minutes:.1f} min" if minutes < 120 else f"{minutes / 60:.1f} h"


def interval_decimals(numbers: Sequence[float]) -> int:
    """Decimals in percent of P/P₀ with its interval: one where the interval is narrower than ± 1 %."""
    _, low, high = numbers
    return 1 if high - low < _NARROW else 0


def interval_words(
    numbers: Sequence[float] | None,
    number: Callable[[float, int], str] = fixed,
    gettext: Callable[[str], str] = str,
) -> str:
    """P/P₀ in percent with its interval, wherever one is printed or shown.

    Parameters
    ----------
    numbers : sequence of float or None
        Value and both ends of its interval.
    number : callable
        Writes a number with some decimals.
    gettext : callable
        Translates.

    Returns
    -------
    str
        ``"88 (83 to 94) %"``; ``"below 55 %"`` where it has an upper limit alone.
    """
    if numbers is None:
        return NONE
    decimals = interval_decimals(numbers)
    value, low, high = (number(100 * each, decimals) for each in numbers)
    if numbers[1] <= 0:
        return gettext("below {high} %").format(high=high)
    return gettext("{value} ({low} to {high}) %").format(value=value, low=low, high=high)


def life_words(quantiles: Mapping[str, float | None]) -> str:
    """Median and 90 % interval of the remaining life in days, ``"31 (20 to 50)"``.

    An end that is open is ∞, and ``"open"`` are all three.
    """
    numbers = []
    for name in ("0.5", "0.05", "0.95"):
        if name not in quantiles:
            return NONE
        days = quantiles[name]
        numbers.append("∞" if days is None else f"{days:.0f}")
    if set(numbers) == {"∞"}:
        return "open"
    return f"{numbers[0]} ({numbers[1]} to {numbers[2]})"


def form(text: str) -> str:
    """A text without its numbers and final marks: sentences that differ in nothing else are alike."""
    return re.sub(r"[-+−]?\d[\d.]*(e[-+]?\d+)?", "#", text).rstrip(" .?")


def without_repeats(sentences: Iterable[str]) -> list[str]:
    """Sentences whose ends, apart from numbers, are printed once; ``"run 2 is suspect: as above"``.

    Parameters
    ----------
    sentences : iterable of str
        In the order of printing. An end begins after a colon or a semicolon.

    Returns
    -------
    list of str
        As many.
    """
    shortened, printed = [], set()
    for sentence in sentences:
        starts = [match.end() for match in re.finditer("[:;] ", sentence)]
        ends = {start: form(sentence[start:]) for start in starts}
        repeated = [start for start, end in ends.items() if len(end) >= _LEAST and end in printed]
        printed |= set(ends.values()) | {form(sentence)}
        shortened.append(f"{sentence[: repeated[0]]}as above" if repeated else sentence)
    return shortened
