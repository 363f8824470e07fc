"""Reading of foreign files: any failure of a library becomes one sentence, declared sizes are checked."""

from __future__ import annotations

import math
import re
import struct
import warnings
from collections.abc import Container, Iterator, Sequence
from contextlib import contextmanager
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ballscrew.base.errors import BallscrewError, InputError

_ALWAYS_ALLOWED = 1 << 30
_MOST_COMPRESSED = 100  # deflate reaches 1032 on zeros; a measurement hardly ever 10
_LONGEST_REASON = 160
_CUT = re.compile(r"truncated file: eof = (\d+),.* stored_eof = (\d+)")  # as HDF5 says it


def reason(error: BaseException) -> str:
    """First line of a library's message, short enough for a sentence."""
    text = str(error).strip().partition("\n")[0].strip().rstrip(".:")
    cut = _CUT.search(text)
    if cut:
        return f"the file is cut off: it holds {cut[1]} of {cut[2]} bytes; copy or export it again"
    if isinstance(error, struct.error | EOFError):
        return "the file ends too early: it is cut off or damaged; copy or export it again"
    if len(text) > _LONGEST_REASON:
        text = text[:_LONGEST_REASON] + "…"
    return text or type(error).__name__


@contextmanager
def refusing(path: Path, kind: str) -> Iterator[None]:
    """Turn whatever a library raises on a broken file into an InputError.

    Parameters
    ----------
    path : path-like
        The file, for the message.
    kind : str
        What it was read as, ``"HDF5"``.

    Raises
    ------
    InputError
        In place of any other exception.
    """
    try:
        with warnings.catch_warnings():
            # A library's warnings are not shown: all that is used is checked later.
            warnings.simplefilter("ignore")
            yield
    except BallscrewError:
        raise
    except MemoryError:
        raise InputError(f"{path}: declares more data than this machine's memory can hold.") from None
    except Exception as error:  # noqa: BLE001  parsers raise anything at all on hostile bytes
        raise InputError(f"{path}: cannot be read as {kind} ({reason(error)}).") from None


def check_size(path: Path, name: str, size: int) -> None:
    """Refuse a size in bytes, of one channel or of all together, that the file cannot contain.

    Parameters
    ----------
    path : path-like
        The file.
    name : str
        The channel, or the channels.
    size : int
        Declared size in memory, bytes.

    Raises
    ------
    InputError
        If it is beyond 1 GiB and a hundred times the file.
    """
    if size > _ALWAYS_ALLOWED and size > _MOST_COMPRESSED * path.stat().st_size:
        raise InputError(f"{path}: {name!r} declares {size} bytes, more than a file of this size can hold.")


def is_channel(dtype: np.dtype[Any], shape: Sequence[int]) -> bool:
    """True if an array is one channel: real numbers in one dimension, or in one row or one column."""
    if dtype.kind not in "iuf":
        return False
    return len(shape) == 1 or (len(shape) == 2 and 1 in shape and math.prod(shape) > 1)


def as_channel(values: NDArray[Any]) -> NDArray[Any]:
    """Values in one dimension and native byte order; float32 is preserved, all else becomes float64."""
    flat = np.asarray(values).reshape(-1)
    if flat.dtype.kind == "f" and flat.dtype.itemsize == 4:
        return np.ascontiguousarray(flat, dtype=np.float32)
    return np.ascontiguousarray(flat, dtype=np.float64)


def missing_channel(path: Path, name: str) -> InputError:
    """Error for a channel that a file does not have."""
    return InputError(f"{path}: has no channel {name!r}.")


def unique(name: str, names: Container[str]) -> str:
    """Name that is not among others: the second ``"Voltage"`` is ``"Voltage (2)"``."""
    if name not in names:
        return name
    return next(each for each in (f"{name} ({number})" for number in count(2)) if each not in names)
