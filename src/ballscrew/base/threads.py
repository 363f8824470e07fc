"""One thread for the linear algebra, so that results do not depend on how many cores a machine has."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import ParamSpec, TypeVar

_Arguments = ParamSpec("_Arguments")
_Result = TypeVar("_Result")


def single_threaded(function: Callable[_Arguments, _Result]) -> Callable[_Arguments, _Result]:
    """Wrap a function so that BLAS has one thread while it runs.

    The order in which several threads add up a product moves its last digits. The matrices here are small, so
    that further threads cost time as well.

    Parameters
    ----------
    function : callable
        Function of the public interface.

    Returns
    -------
    callable
        The same with one thread; the caller's number of threads is restored afterwards.
    """

    @wraps(function)
    def limited(*args: _Arguments.args, **kwargs: _Arguments.kwargs) -> _Result:
        import scipy.linalg  # noqa: F401  its BLAS is another one than numpy's, and is limited once it is loaded
        from threadpoolctl import threadpool_limits

        with threadpool_limits(limits=1, user_api="blas"):
            return function(*args, **kwargs)

    return limited
