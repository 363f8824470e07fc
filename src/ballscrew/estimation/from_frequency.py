"""Preload from natural frequencies that were measured by other means, without a recording."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from ballscrew.axis.sheet import DataSheet
from ballscrew.base.errors import InputError, shown
from ballscrew.base.provenance import Made, digest
from ballscrew.base.quantity import Quantity
from ballscrew.base.settings import check_setting
from ballscrew.base.units import parse_named
from ballscrew.calibration.assumptions import DEFAULT_ASSUMPTIONS, Assumptions
from ballscrew.calibration.calibrated_axis import CalibratedAxis
from ballscrew.calibration.calibration import axis_of_sheet
from ballscrew.calibration.modelfile import model_of
from ballscrew.estimation.estimate import PreloadEstimate
from ballscrew.estimation.preload import preload
from ballscrew.modal.cell import CellResult
from ballscrew.modal.natural_frequency import NaturalFrequency
from ballscrew.modal.reason import Reason
from ballscrew.modal.run import RigidBodyResult, Run
from ballscrew.recording.quality.finding import Quality

Frequency = Quantity | NaturalFrequency

_METHOD = "joint"  # if no run of the calibration states one; its frequencies are those of an unloaded nut too
_HIGHEST = 5000.0  # Hz, far above the axial mode of any machine
_CONDITION = "PA"  # of all cells; a cell has a condition, which has no effect here


def preload_from_frequency(
    frequency: Frequency | Sequence[Frequency],
    model: CalibratedAxis | DataSheet | str | Path,
    position: float | str | Sequence[float | str],
    load: float | str,
    *,
    baseline: Frequency | Sequence[Frequency] | None = None,
    assumptions: Assumptions = DEFAULT_ASSUMPTIONS,
    accept: Sequence[str] = (),
) -> PreloadEstimate:
    """Estimate the preload from axial natural frequencies, without a recording.

    Parameters
    ----------
    frequency : Quantity or NaturalFrequency, or sequence of these
        Undamped natural frequency with its standard uncertainty, Hz; motor free to turn, no outer force on
        the nut. Errors of several frequencies are independent of each other.
    model : CalibratedAxis, DataSheet or path-like
        Calibrated model of the axis, also as a file, or its data sheet alone, which makes the result suspect.
    position : float or str, or sequence of these
        Position of the table for each frequency, m, or with a unit: ``"200 mm"``.
    load : float or str
        On the table, kg.
    baseline : Quantity or NaturalFrequency, or sequence of these, optional
        The same frequencies at an earlier time, at the same positions and with the same load.
    assumptions, accept
        As for :func:`~ballscrew.estimation.preload.preload`.

    Returns
    -------
    PreloadEstimate
        As of :func:`~ballscrew.estimation.preload.preload` for a run with these frequencies.

    Raises
    ------
    InputError
        If a frequency has no standard uncertainty or is impossible, there is not one position for each, or
        a position is not on the screw.

    Examples
    --------
    >>> import ballscrew
    >>> f = ballscrew.Quantity(141.2, 0.3, "Hz")
    >>> model = ballscrew.read_model("MODEL.json")  # doctest: +SKIP
    >>> ballscrew.preload_from_frequency(f, model, "225 mm", "100 kg")  # doctest: +SKIP
    """
    positions = [parse_named("a position", each, "m") for each in _as_list(position)]
    mass = parse_named("the load", load, "kg")
    check_setting("the load in kg", mass, least=0.0)
    if not positions:
        raise InputError("no position was given; each frequency needs that of the table.")
    if not isinstance(model, DataSheet):
        model = model_of(model)
    else:
        for each in positions:
            model.check_position(each)
        model = axis_of_sheet(model, (min(positions) + max(positions)) / 2, mass)
    model.check_positions(positions, "the model")
    run = _run(_as_list(frequency), positions, mass, model)
    base = None if baseline is None else _run(_as_list(baseline), positions, mass, model)
    return preload(run, model, base, assumptions=assumptions, accept=accept)


def _as_list(given: Any) -> list[Any]:
    """Members of a sequence or array, or the single value."""
    if isinstance(given, str) or np.ndim(given) == 0:
        return [given]
    return [*given]


def _run(frequencies: list[Any], positions: list[float], load: float, model: CalibratedAxis) -> Run:
    """Run whose cells have the given frequencies; its method is that of the calibration."""
    if len(frequencies) != len(positions):
        raise InputError(
            f"each frequency needs a position; {len(frequencies)} and {len(positions)} were given."
        )
    method = _method_of_calibration(model)
    cells = tuple(
        _cell(frequency, position, number, method)
        for number, (frequency, position) in enumerate(zip(frequencies, positions, strict=True))
    )
    inputs = {"frequencies": digest([asdict(cell) for cell in cells])}
    return Run(
        id=digest([model.axis, load, inputs]),
        axis=model.axis,
        mass_kg=load,
        measured_at=None,
        temperature_C=None,
        files=(),
        quality=Quality("good"),
        rigid_body=RigidBodyResult(),
        transients=(),
        cells=cells,
        made=Made(inputs=inputs),
    )


def _method_of_calibration(model: CalibratedAxis) -> str:
    """Method of the runs of a calibration."""
    for used in model.runs:
        if used.method:
            return used.method
    return _METHOD


def _cell(frequency: Any, position: float, motion: int, method: str) -> CellResult:
    """Cell with a given frequency; ``motion`` distinguishes it from other cells at its position."""
    reasons: tuple[str, ...] = ()
    if isinstance(frequency, NaturalFrequency):
        reasons = frequency.reasons
        frequency = frequency.frequency
    if isinstance(frequency, Quantity):
        try:
            frequency = frequency.to("Hz")
        except InputError as error:
            raise InputError(f"the frequency is {frequency}: {error}.") from None
    if not (isinstance(frequency, Quantity) and frequency.standard_uncertainty > 0):
        raise InputError(
            f"the frequency is {shown(frequency)}; it must be a Quantity in Hz with a standard uncertainty, "
            "or what natural_frequency returns."
        )
    verdict = "suspect" if reasons else "good"
    value, spread = frequency.value, frequency.standard_uncertainty
    check_setting("the frequency in Hz", value, above=0.0, most=_HIGHEST)
    cell = CellResult(
        position_m=position,
        condition=_CONDITION,
        motion=motion,
        repetitions=1,
        frequency_Hz=value,
        standard_uncertainty_Hz=spread,
        damping_ratio=None,
        method=method,
        verdict=verdict,
        reasons=(),
    )
    return cell.with_reasons(*(Reason("other", text) for text in reasons))
