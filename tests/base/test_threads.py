from __future__ import annotations

import numpy as np
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from ballscrew.base.threads import single_threaded


def threads() -> set[int]:
    np.linalg.inv(np.eye(2))
    return {library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas"}


def test_blas_has_one_thread_inside_and_as_many_as_before_afterwards() -> None:
    with threadpool_limits(2, user_api="blas"):
        before = threads()
        assert single_threaded(threads)() == {1}
        assert single_threaded(single_threaded(threads))() == {1}
        assert threads() == before


def test_the_number_of_threads_is_restored_after_an_error() -> None:
    @single_threaded
    def fail() -> None:
        raise ValueError("no")

    with threadpool_limits(2, user_api="blas"):
        before = threads()
        with pytest.raises(ValueError, match="no"):
            fail()
        assert threads() == before


def test_name_arguments_and_documentation_stay() -> None:
    @single_threaded
    def add(a: int, *, b: int = 1) -> int:
        """Sum."""
        return a + b

    assert (add.__name__, add.__doc__, add(1), add(1, b=2)) == ("add", "Sum.", 2, 3)
