"""MODEL.json: a calibrated axis in plain JSON, with units and provenance.

A file whose numbers no machine can have is refused, and so is a matrix that is not a covariance.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

import numpy as np

from ballscrew.axis.axial import PARAMETERS, AxialModel
from ballscrew.base import json_fields
from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError, field_error
from ballscrew.base.files import write_text
from ballscrew.base.jsonfile import SCHEMA, plain, read_json, write_json
from ballscrew.base.provenance import Made
from ballscrew.calibration.calibrated_axis import (
    UNITS,
    Anchor,
    CalibratedAxis,
    CalibrationRun,
    ConventionEvidence,
    Doubt,
    FormEvidence,
    TemperatureSlope,
    ToleranceEstimate,
)
from ballscrew.calibration.tolerances import is_part_of_prior

KIND = "ballscrew model"

WORKING = ("ln compliance", "slope", "curve", "ln mass", "ln rotor", "logit share", "ln preload")
"""Elements of the working vector, as named in MODEL.json."""

_LARGEST_FILE = 2_000_000  # bytes; a model of 200 runs has a tenth of that
_MOST_GROUPS = 200
_MOST_TOLERANCES = 30  # numbers of a data sheet; usually three
_MOST_DEVIATION = 1e3  # of a number of the sheet by the calibration, in standard uncertainties
_MOST = 1e12  # of any number of a run, anchor or form
_LARGEST = 1e300

# Ranges of the parameters of any machine, with a wide margin: outside, the file is wrong.
_RANGES = {
    "centre": (-1e3, 1e3), "compliance": (1e-12, 1e-4), "slope": (-1e3, 1e3), "curve": (-1e5, 1e5),
    "mass": (1e-3, 1e7), "rotor": (1e-3, 1e9), "share": (1e-3, 0.999), "preload": (0.1, 1e8),
}  # fmt: skip
_MOST_LOGARITHM = 10.0  # of a ratio, and its standard uncertainty
_MOST_SPREAD = {"slope": 1e3, "curve": 1e5}  # standard uncertainty; of the others as of a logarithm
_UNCERTAIN = ("compliance", "mass", "share", "preload")  # parameters that no calibration determines exactly
_LEAST_SPREAD = 1e-6  # their least standard uncertainty in the working vector
_NO_OVERFLOW = 1e100  # limit of a covariance that is divided by standard deviations
_ROUNDING = 1e-6  # of a correlation or probability, by numbers of nine digits

_MOST_SLOPE = 0.3  # of ln P per kelvin: ten times that of a screw which alone becomes warmer

_NUMBER = json_fields.number(-_MOST, _MOST)
_CELSIUS = json_fields.number(-273.15, 2000.0)
_TEXTS = json_fields.listed(json_fields.text())
_PARAMETER_NAMES = json_fields.listed(json_fields.choice(*PARAMETERS))
_MATRIX = json_fields.listed(json_fields.listed(json_fields.number(-_LARGEST, _LARGEST)))
_SEVEN = json_fields.listed(json_fields.number(-_MOST_LOGARITHM, _MOST_LOGARITHM), length=len(PARAMETERS))

_CHANGE = json_fields.listed(json_fields.number(*_RANGES["curve"]))  # the widest of the working vector


def _effects(value: Any, where: str) -> Array:
    """Effects of a number of the sheet on the working vector, shape (7,)."""
    return np.array(_SEVEN(value, where), dtype=np.float64)


def _change(value: Any, where: str) -> Array:
    """Change of the working vector and the log ratios by another convention."""
    return np.array(_CHANGE(value, where), dtype=np.float64)


def _estimates(value: Any, where: str) -> Array:
    """Estimates of the sheet's numbers by another convention."""
    return np.array(json_fields.listed(_DEVIATION)(value, where), dtype=np.float64)


def _row(kind: type[Any], **special: json_fields.Field) -> json_fields.Field:
    """Field of an object that is read as a dataclass; its floats are not null, except ``special``."""
    numbers = [field.name for field in fields(kind) if field.type == "float"]
    return json_fields.instance(kind, **(dict.fromkeys(numbers, _NUMBER) | special))


_DEVIATION = json_fields.number(-_MOST_DEVIATION, _MOST_DEVIATION)
_MODEL: dict[str, json_fields.Field] = {
    "axis": json_fields.text(),
    "parameters": json_fields.record(
        {
            name: json_fields.number(low, high, optional=name == "rotor")
            for name, (low, high) in _RANGES.items()
        }
    ),
    "free": _PARAMETER_NAMES,
    "covariance": _MATRIX,
    "prior_covariance": _MATRIX,
    "log_ratios": json_fields.listed(json_fields.number(-_MOST_LOGARITHM, _MOST_LOGARITHM)),
    "log_ratio_covariance": _MATRIX,
    "cross_covariance": _MATRIX,
    "chi2": json_fields.number(0.0, _LARGEST),
    "degrees": json_fields.number(-_LARGEST, _LARGEST),
    "load_rating_N": json_fields.number(1.0, 1e10),
    "nut_mass_kg": json_fields.number(1e-3, 1e7),
    "bearing_share": json_fields.number(0.0, 1.0),
    "rotor": json_fields.choice("free", "held"),
    "verdict": json_fields.choice("good", "suspect"),
    "reasons": json_fields.listed(_row(Doubt)),
    "notes": _TEXTS,
    "runs": json_fields.listed(_row(CalibrationRun, group=json_fields.whole(_MOST_GROUPS - 1))),
    "anchors": json_fields.listed(_row(Anchor)),
    "candidates": json_fields.listed(_row(FormEvidence, free=_PARAMETER_NAMES)),
    "tolerances": json_fields.listed(_row(ToleranceEstimate, effects=_effects, estimate=_DEVIATION)),
    "conventions": json_fields.listed(
        _row(
            ConventionEvidence,
            probability=json_fields.number(0.0, 1.0),
            change=_change,
            estimates=_estimates,
        )
    ),
    "temperature": json_fields.optional(
        _row(
            TemperatureSlope,
            value=json_fields.number(-_MOST_SLOPE, _MOST_SLOPE),
            standard_uncertainty=json_fields.number(_LEAST_SPREAD, _MOST_SLOPE),
            lowest=_CELSIUS,
            highest=_CELSIUS,
        )
    ),
    "knowledge": json_fields.listed(json_fields.mapping(json_fields.anything)),
    "made": json_fields.instance(Made),
}

_REQUIRED = tuple(key for key in _MODEL if key not in ("verdict", "conventions", "temperature"))


def model_json(calibrated: CalibratedAxis) -> dict[str, Any]:
    """The document of a calibrated axis.

    Parameters
    ----------
    calibrated : CalibratedAxis
        The model.

    Returns
    -------
    dict
        Of plain types; an infinite rotor is null.
    """
    values = asdict(calibrated)
    document = {
        "schema": SCHEMA,
        "kind": KIND,
        "units": UNITS,
        "parameters": values.pop("model"),
        "working_vector": WORKING,
        "load_rating_N": values.pop("load_rating"),
        "nut_mass_kg": values.pop("nut_mass"),
        "rotor": "free",
        "verdict": calibrated.verdict,
    }
    result: dict[str, Any] = plain(document | values)
    return result


def write_model(calibrated: CalibratedAxis, path: str | Path) -> None:
    """Write MODEL.json.

    Parameters
    ----------
    calibrated : CalibratedAxis
        The model.
    path : path-like
        The file; an existing one is overwritten.

    Raises
    ------
    InputError
        If it cannot be written.
    """
    write_text(path, write_json(model_json(calibrated)) + "\n")


def model_of(given: CalibratedAxis | str | Path) -> CalibratedAxis:
    """A model as given, or read from its path."""
    return given if isinstance(given, CalibratedAxis) else read_model(given)


def read_model(path: str | Path) -> CalibratedAxis:
    """Read MODEL.json.

    Parameters
    ----------
    path : path-like
        The file.

    Returns
    -------
    CalibratedAxis
        As :func:`write_model` wrote it, to nine digits.

    Raises
    ------
    InputError
        If it cannot be read, is not a model, or contains values that no model can have.
    """
    path = Path(path)
    try:
        size = path.stat().st_size
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: cannot be read ({getattr(error, 'strerror', None) or error}).") from None
    if size > _LARGEST_FILE:
        raise InputError(f"{path}: has {size} bytes; a model has {_LARGEST_FILE} at most.")
    return model_from_json(read_json(path), str(path))


def model_from_json(document: Mapping[str, Any], source: str) -> CalibratedAxis:
    """Model of the document that :func:`model_json` makes.

    Parameters
    ----------
    document : mapping
        The document.
    source : str
        Its name, for messages.

    Returns
    -------
    CalibratedAxis
        The model.

    Raises
    ------
    InputError
        If it is not a model, or contains values that no model can have.
    """
    if document.get("kind") != KIND:
        raise InputError(f"{source}: is not a model: it has no kind {KIND!r}.")
    try:
        row = json_fields.fields(_MODEL, document, "", required=_REQUIRED)
        return _model(row, source)
    except InputError as error:
        text = str(error)
        if not text.startswith(source):
            text = f"{source}: {text}"
        raise InputError(text) from None


def _model(row: dict[str, Any], source: str) -> CalibratedAxis:
    """The axis of a document, the fields of which were checked one by one; here they are checked together."""
    ratios = np.array(row["log_ratios"], dtype=np.float64)
    groups, size = len(ratios), len(PARAMETERS)
    if not 1 <= groups <= _MOST_GROUPS or ratios[0] != 0:
        allowed = f"1 to {_MOST_GROUPS} numbers, the first of them 0"
        raise field_error(source, "log_ratios", row["log_ratios"], allowed)
    for run in row["runs"]:
        if run.group >= groups:
            raise field_error(source, "runs.group", run.group, f"from 0 to {groups - 1}")
    covariance = _matrix(row, "covariance", source, (size, size))
    ratio_covariance = _matrix(row, "log_ratio_covariance", source, (groups, groups))
    cross = _matrix(row, "cross_covariance", source, (size, groups))
    whole = np.block([[covariance, cross], [cross.T, ratio_covariance]])
    _check_covariance(whole, source, "covariance")
    prior = _matrix(row, "prior_covariance", source, (size, size))
    _check_covariance(prior, source, "prior_covariance")
    parameters = row.pop("parameters")
    if parameters["rotor"] is None:
        parameters["rotor"] = math.inf
    model = AxialModel(**parameters)
    _check_free(model, covariance, row["free"], source)
    rotor = row.pop("rotor")
    if rotor != "free":
        raise field_error(source, "rotor", rotor, "'free'")
    _check_tolerances(row["tolerances"], prior, source)
    _check_conventions(row.get("conventions", ()), size + groups, len(row["tolerances"]), source)
    row["model"] = model
    row["log_ratios"] = ratios
    row["covariance"] = covariance
    row["log_ratio_covariance"] = ratio_covariance
    row["cross_covariance"] = cross
    row["prior_covariance"] = prior
    row["load_rating"] = row.pop("load_rating_N")
    row["nut_mass"] = row.pop("nut_mass_kg")
    verdict = row.pop("verdict", None)
    axis = CalibratedAxis(**row)
    if verdict not in (None, axis.verdict):
        raise field_error(source, "verdict", verdict, f"{axis.verdict!r}, by its reasons")
    return axis


def _matrix(row: Mapping[str, Any], key: str, source: str, shape: tuple[int, int]) -> Array:
    """Matrix of a document, of a given shape."""
    rows = row[key]
    lengths = {len(values) for values in rows}
    if len(rows) != shape[0] or lengths != {shape[1]}:
        raise field_error(source, key, rows, f"{shape[0]} rows of {shape[1]} finite numbers")
    return np.array(rows, dtype=np.float64)


def _check_tolerances(estimates: Sequence[ToleranceEstimate], prior: Array, source: str) -> None:
    """Refuse too many numbers of the sheet, one given twice, and effects larger than the prior."""
    if len(estimates) > _MOST_TOLERANCES:
        raise field_error(source, "tolerances", estimates, f"a list of {_MOST_TOLERANCES} objects at most")
    if len({number.field for number in estimates}) < len(estimates):
        raise InputError(f"{source}: tolerances has a field twice; it must have each once.")
    if not is_part_of_prior(estimates, prior):
        raise InputError(f"{source}: tolerances has effects that are not part of prior_covariance.")


def _check_conventions(found: Sequence[ConventionEvidence], size: int, numbers: int, source: str) -> None:
    """Refuse changes and estimates of another size, and probabilities that exceed 1."""
    if any(len(reading.change) != size for reading in found):
        raise InputError(f"{source}: conventions has a change without {size} numbers.")
    if any(len(reading.estimates) != numbers for reading in found):
        raise InputError(f"{source}: conventions has estimates other than those of {numbers} tolerances.")
    if sum(reading.probability for reading in found) > 1 + _ROUNDING:
        raise InputError(f"{source}: conventions has probabilities of more than 1 in all.")


def _check_covariance(matrix: Array, source: str, key: str) -> None:
    """Refuse a matrix that is not a covariance of the working vector, and of log ratios after it."""
    variances = np.diag(matrix)
    most = np.full(len(matrix), _MOST_LOGARITHM**2)
    for name, spread in _MOST_SPREAD.items():
        most[PARAMETERS.index(name)] = spread**2
    for value, limit in zip(variances, most, strict=True):
        if not 0 <= value <= limit:
            raise InputError(f"{source}: {key} has a variance of {value:g}; it must be 0 to {limit:g}.")
    scale = np.sqrt(np.where(variances > 0, variances, 1.0))
    correlation = np.clip(matrix, -_NO_OVERFLOW, _NO_OVERFLOW) / scale[:, None] / scale
    symmetric = np.allclose(correlation, correlation.T, atol=_ROUNDING)
    possible = np.all(np.abs(correlation) <= 1 + _ROUNDING)
    if not (symmetric and possible and np.linalg.eigvalsh(correlation).min() >= -_ROUNDING):
        raise InputError(
            f"{source}: {key} is not a covariance: it must be symmetric and positive semi-definite."
        )


def _check_free(model: AxialModel, covariance: Array, free: Sequence[str], source: str) -> None:
    """Refuse a parameter without uncertainty that must have one, and an infinite rotor that has one."""
    for name in _UNCERTAIN:
        at = PARAMETERS.index(name)
        if not covariance[at, at] > _LEAST_SPREAD**2:
            raise InputError(
                f"{source}: covariance of {name} is {covariance[at, at]:g}; it must be more than "
                f"{_LEAST_SPREAD**2:g}: no calibration determines it better."
            )
    at = PARAMETERS.index("rotor")
    if not math.isfinite(model.rotor) and ("rotor" in free or covariance[at].any()):
        raise InputError(f"{source}: parameters.rotor is null; it must then be neither free nor uncertain.")
