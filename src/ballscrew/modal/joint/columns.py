"""From what the mode makes of a drive to the columns of a least squares; compiled."""

from __future__ import annotations

from numba import njit

from ballscrew.base.arrays import Array

__all__ = ["gathered"]


@njit(cache=True)
def _slope(columns: Array, of: int, to: int) -> None:
    """Differences between neighbours, halved; one-sided at both ends."""
    last = columns.shape[0] - 1
    columns[0, to] = columns[1, of] - columns[0, of]
    for i in range(1, last):
        columns[i, to] = 0.5 * (columns[i + 1, of] - columns[i - 1, of])
    columns[last, to] = columns[last, of] - columns[last - 1, of]


@njit(cache=True)
def gathered(answers: Array, beside: Array, moved: Array, nut: bool, columns: Array) -> None:
    """Fill the columns.

    Parameters
    ----------
    answers : ndarray, shape (2, n)
        Of the mode, and of what pitches with it; n is 2 at least.
    beside : ndarray, shape (n, m)
        What does not depend on the mode.
    moved : ndarray, shape (n, k)
        What the mode makes of the ripple.
    nut : bool
        Whether the nut answers: the rise of the gain and what pitches stand beside the answer and its
        delay then.
    columns : ndarray, shape (n, 2 + m + k) or (n, 5 + m + k)
        Filled, in this order.
    """
    own = 5 if nut else 2
    for i in range(columns.shape[0]):
        columns[i, 0] = answers[0, i]
        if nut:
            columns[i, 3] = answers[1, i]
        for k in range(beside.shape[1]):
            columns[i, own + k] = beside[i, k]
        for k in range(moved.shape[1]):
            columns[i, own + beside.shape[1] + k] = moved[i, k]
    _slope(columns, 0, 1)
    if nut:
        _slope(columns, 1, 2)
        _slope(columns, 3, 4)
