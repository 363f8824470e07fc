"""Compiled functions, stored for the next process where a folder for them can be written."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from typing import Any, TypeVar

from numba import njit
from numba.core.caching import FunctionCache

_Function = TypeVar("_Function", bound=Callable[..., Any])


class _OptionalCache(FunctionCache):
    """Store of a compiled function; on a full disk nothing is stored."""

    def save_overload(self, sig: Any, data: Any) -> None:
        with suppress(OSError):
            super().save_overload(sig, data)  # type: ignore[no-untyped-call]  # numba has no types


def compiled(**options: Any) -> Callable[[_Function], _Function]:
    """Decorator: compile a function when it is first called. A division by 0 gives inf or nan, as in NumPy.

    The result is stored beside the source or in the user's cache folder, or else not at all: an account of a
    service may have no folder that it can write. The variable ``NUMBA_CACHE_DIR`` names another folder.

    Parameters
    ----------
    **options
        As for :func:`numba.njit`, but ``cache``.

    Returns
    -------
    callable
        The decorator.
    """

    def decorate(function: _Function) -> _Function:
        dispatcher = njit(error_model="numpy", **options)(function)
        if hasattr(dispatcher, "enable_caching"):  # not with NUMBA_DISABLE_JIT
            with suppress(RuntimeError):  # there is no such folder
                dispatcher._cache = _OptionalCache(function)  # type: ignore[no-untyped-call]
        return dispatcher  # type: ignore[no-any-return]

    return decorate
