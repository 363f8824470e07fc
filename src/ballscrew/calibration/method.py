"""By which method a run was analysed: two methods err differently, and what they say does not mix."""

from __future__ import annotations

from collections.abc import Sequence

from ballscrew.base.errors import InputError
from ballscrew.modal.run import Run

__all__ = ["common_method", "method_of"]


def method_of(run: Run) -> str | None:
    """Return the method of a run's cells; None where it has none."""
    methods = sorted({str(cell.method) for cell in run.cells})
    return " and ".join(methods) or None


def common_method(runs: Sequence[Run]) -> str | None:
    """Return the one method of several runs.

    Parameters
    ----------
    runs : sequence of Run
        Analysed.

    Returns
    -------
    str or None
        None where no run has a cell.

    Raises
    ------
    InputError
        If there are two.
    """
    first = next((run for run in runs if method_of(run)), None)
    if first is None:
        return None
    method = method_of(first)
    for run in runs:
        other = method_of(run)
        if other is not None and other != method:
            raise InputError(
                f"run {run.id[:12]} is by method {other}, run {first.id[:12]} by method {method}; runs that "
                "are compared must be by one method: analyse them again."
            )
    return method
