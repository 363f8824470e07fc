"""Whether a run, its baselines and a model belong together."""

from __future__ import annotations

from collections.abc import Sequence

from ballscrew.base.errors import InputError, shown
from ballscrew.calibration.calibrated_axis import CalibratedAxis
from ballscrew.calibration.method import common_method
from ballscrew.modal.run import Run

__all__ = ["check_comparable"]

_MOST_LOAD = 0.25  # of all that moves: beyond it the model's mass decides, not the nut


def check_comparable(run: Run, model: CalibratedAxis, baseline: Run | None, more: Sequence[Run]) -> None:
    """Refuse runs that no change is told of.

    Parameters
    ----------
    run, model, baseline, more
        As :func:`ballscrew.estimation.preload.preload`.

    Raises
    ------
    InputError
        If they are not of one axis, method, plan and about one load.
    """
    method = common_method([run, *([] if baseline is None else [baseline]), *more])
    for used in model.runs:
        if method is not None and used.method not in (None, method):
            raise InputError(
                f"the run is by method {method}, the model was calibrated with runs by method {used.method}; "
                "they must be by one method: analyse them again."
            )
    for one, what in ((run, "the run"), (baseline, "the baseline"), *((m, "a baseline") for m in more)):
        if one is None:
            continue
        if one.axis is not None and model.axis and one.axis != model.axis:
            raise InputError(
                f"{what} is of the axis {shown(one.axis)}, the model of {shown(model.axis)}; they must be of "
                "one axis."
            )
        if one.mass_kg is None:
            raise InputError(f"{what} {shown(one.id)[1:13]} tells no load; analyse it with --mass.")
        plan, other = one.made.inputs.get("plan"), run.made.inputs.get("plan")
        if plan is not None and other is not None and plan != other:
            raise InputError(
                f"{what} was measured by another plan than the run; a change takes the same plan for both."
            )
        moving = model.model.mass + (run.mass_kg or 0.0)
        if abs(one.mass_kg - (run.mass_kg or 0.0)) > _MOST_LOAD * moving:
            raise InputError(
                f"{what} was measured with {one.mass_kg:g} kg, the run with {run.mass_kg:g} kg; a change "
                "takes about the same load."
            )
