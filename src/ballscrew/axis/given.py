"""Checks of the arguments of formulas; an impossible number is refused in one sentence."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError, shown


def finite(name: str, value: ArrayLike, unit: str = "") -> Array:
    """Return finite numbers as float64.

    Parameters
    ----------
    name : str
        Name of the quantity, for the message.
    value : array_like
        As given.
    unit : str
        Its unit, for the message; empty for a ratio.

    Returns
    -------
    ndarray
        The same as float64.

    Raises
    ------
    InputError
        If it is no number, NaN or infinite.
    """
    array = _array(name, value, unit)
    return _all(name, array, np.isfinite(array), f"a finite number{_of(unit)}")


def not_negative(name: str, value: ArrayLike, unit: str = "") -> Array:
    """Return finite numbers from 0 on; parameters, result and errors as :func:`finite`."""
    array = _array(name, value, unit)
    return _all(name, array, np.isfinite(array) & (array >= 0), f"0{_after(unit)} or more, and finite")


def positive(name: str, value: ArrayLike, unit: str = "") -> Array:
    """Return finite numbers above 0; parameters, result and errors as :func:`finite`."""
    array = _array(name, value, unit)
    return _all(name, array, np.isfinite(array) & (array > 0), f"more than 0{_after(unit)}, and finite")


def together(**arguments: ArrayLike) -> list[Array]:
    """Return numbers broadcast to a common shape.

    Parameters
    ----------
    **arguments : array_like
        By name; NaN is let through.

    Returns
    -------
    list of ndarray
        Arrays of the same shape, as float64, in the order given.

    Raises
    ------
    InputError
        If one is no number, or the shapes do not go together.
    """
    names = [key.replace("_", " ") for key in arguments]
    arrays = list(map(_array, names, arguments.values()))
    try:
        return list(np.broadcast_arrays(*arrays))
    except ValueError:
        shapes = ", ".join(f"{name} {array.shape}" for name, array in zip(names, arrays, strict=True))
        raise InputError(
            f"the shapes do not go together: {shapes}; each must be one number, or of one shape."
        ) from None


def _array(name: str, value: ArrayLike, unit: str = "") -> Array:
    try:
        array = np.asarray(value)
        if array.dtype.kind not in "iuf":
            raise ValueError
        return array.astype(np.float64)
    except (TypeError, ValueError, OverflowError):  # texts, ragged lists, complex numbers, truth values
        raise InputError(
            f"a {name} of {shown(value)} was given; it must be a number{_of(unit)}, or an array of them."
        ) from None


def _all(name: str, array: Array, good: NDArray[np.bool_], allowed: str) -> Array:
    if not np.all(good):
        wrong = array[~good].flat[0]
        raise InputError(f"a {name} of {wrong:g} was given; it must be {allowed}.")
    return array


def _of(unit: str) -> str:
    return f" of{_after(unit)}" * bool(unit)


def _after(unit: str) -> str:
    return f" {unit}".rstrip()
