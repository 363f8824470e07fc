"""Samples of a signal on a disk, with minima and maxima of blocks, so that any part of it is read at once."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ballscrew.base.arrays import Array

_FACTOR = 16  # blocks of a level in one of the next
_FEWEST = 1024  # blocks of the last level, about


@dataclass(frozen=True, slots=True, eq=False)
class Envelope:
    """Lowest and highest values of successive blocks of samples.

    Parameters
    ----------
    first : ndarray of int, shape (n,)
        Number of the first sample of each block.
    end : int
        Number of the sample after the last block.
    low, high : ndarray, shape (n,)
        Lowest and highest finite value of each block; NaN where it has none.
    """

    first: NDArray[np.int64]
    end: int
    low: Array
    high: Array

    @property
    def has_samples(self) -> bool:
        """Whether each block is a single sample."""
        return self.end - int(self.first[0]) == len(self.first)


def write_envelope(folder: Path, samples: NDArray[Any]) -> None:
    """Write the samples of a signal, and the minima and maxima of their blocks, to a new folder.

    Parameters
    ----------
    folder : Path
        The folder.
    samples : ndarray, shape (n,)
        Finite or not; n is 1 or more.
    """
    folder.mkdir()
    np.save(folder / "0.npy", samples)
    low = high = np.where(np.isfinite(samples), samples, np.nan)
    level = 0
    while len(low) > _FEWEST:
        starts = np.arange(0, len(low), _FACTOR)
        low, high = np.fmin.reduceat(low, starts), np.fmax.reduceat(high, starts)
        level += 1
        np.save(folder / f"{level}.npy", np.stack([low, high]))


def read_envelope(folder: Path, first: int, end: int, columns: int) -> Envelope:
    """Read a part of a signal as at most two blocks for each column of a picture.

    Parameters
    ----------
    folder : Path
        As :func:`write_envelope` wrote it.
    first, end : int
        Number of the first sample, and of the sample after the last one.
    columns : int
        Number of columns.

    Returns
    -------
    Envelope
        The samples themselves where there are few. Otherwise the blocks contain all samples of the part, and
        the first and the last of them may contain some beyond it, fewer than there are in a column.
    """
    level = 0
    while _FACTOR ** (level + 1) * columns <= end - first and (folder / f"{level + 1}.npy").exists():
        level += 1
    rows = np.atleast_2d(np.load(folder / f"{level}.npy", mmap_mode="r"))
    size = _FACTOR**level
    begin, stop = first // size, min(-(-end // size), rows.shape[1])
    part = np.array(rows[:, begin:stop], dtype=np.float64)
    part[~np.isfinite(part)] = np.nan
    count = part.shape[1]
    starts = np.arange(count)
    if count > 2 * columns:
        starts = np.linspace(0, count, columns, endpoint=False).astype(np.int64)
    last = np.load(folder / "0.npy", mmap_mode="r").shape[0]
    return Envelope(
        first=(begin + starts) * size,
        end=min(stop * size, last),
        low=np.fmin.reduceat(part[0], starts),
        high=np.fmax.reduceat(part[-1], starts),
    )
