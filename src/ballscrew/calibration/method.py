"""Method by which runs were analysed: the errors of two methods differ, so their runs are not compared."""

from __future__ import annotations

from collections.abc import Sequence

from ballscrew.base.errors import InputError
from ballscrew.modal.run import Run


def method_of(run: Run) -> str | None:
    """Method of a run's cells; None for a run without cells."""
    methods = sorted({str(cell.method) for cell in run.cells})
    return " and ".join(methods) or None


def common_method(runs: Sequence[Run]) -> str | None:
    """Method that several runs have in common.

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
        If there are two methods.
    """
    first = next((run for run in runs if method_of(run)), None)
    if first is None:
        return None
    method = method_of(first)
    for run in runs:
        other = method_of(run)
        if other is not None and other != method:
            raise InputError(
                f"{run.name} is by method {other}, {first.name} by method {method}; runs that "
                "are compared must be by the same method: analyse them again."
            )
    return method
