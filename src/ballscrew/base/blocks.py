"""Blocks of the runs of a history: the newest singly, older ones together, in blocks that never move."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_SMALLEST = 3  # runs of a block
_BLOCKS = 16  # its age over a block's size, from which on it is joined with its neighbour


def anchored_blocks(count: int, singles: int) -> NDArray[np.int_]:
    """Begin of each block of a history.

    A block begins at a multiple of its size, three times a power of two. With more runs a block is joined
    with its neighbour, and no run ever leaves its block, so that what is computed of a block need not be
    computed again.

    Parameters
    ----------
    count : int
        Number of runs.
    singles : int
        Newest runs that are blocks of their own, at least.

    Returns
    -------
    ndarray of int
        Ascending, from 0 on; eight more for each doubling of the number of runs.
    """
    index = np.arange(max(count - singles, 0) // _SMALLEST + 1)
    age = count - _SMALLEST * index
    some = (index == 0) | (age <= _BLOCKS * _SMALLEST * (index & -index)) | (index == index[-1])
    older = _SMALLEST * index[some]
    return np.concatenate([older, np.arange(older[-1] + 1, count)])[: max(count, 0)]
