"""MODEL.json: a calibrated axis in plain JSON, with units and where it came from."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from ballscrew.axis.axial import PARAMETERS, AxialModel
from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError, field_error
from ballscrew.base.files import write_text
from ballscrew.base.jsonfile import SCHEMA, read_json, write_json
from ballscrew.base.provenance import Made
from ballscrew.calibration.calibrated_axis import Anchor, CalibratedAxis, CalibrationRun, Candidate, Tolerated
from ballscrew.calibration.plausible import LOGARITHM, RANGES, semidefinite, varies
from ballscrew.calibration.tolerances import part_of

__all__ = ["KIND", "UNITS", "model_json", "read_model", "write_model"]


KIND = "ballscrew model"

UNITS = {
    "centre": "m", "compliance": "m/N", "slope": "1/m", "curve": "1/m^2", "mass": "kg", "rotor": "kg",
    "share": "", "preload": "N",
}  # fmt: skip
"""Of the parameters as MODEL.json holds them."""

WORKING = ("ln compliance", "slope", "curve", "ln mass", "ln rotor", "logit share", "ln preload")

_LONGEST = 2_000_000  # characters; a model of 200 runs has a tenth of that
_MOST_GROUPS = 200
_MOST_TOLERATED = 30  # numbers of a data sheet; three are the rule
_FAR = 1e3  # standard uncertainties
_MOST = 1e12  # of any number of a run, anchor or form


def model_json(calibrated: CalibratedAxis) -> dict[str, Any]:
    """Turn a calibrated axis into the document that MODEL.json holds.

    Parameters
    ----------
    calibrated : CalibratedAxis
        The model.

    Returns
    -------
    dict
        Of plain types; an infinite rotor is null.
    """
    parameters = asdict(calibrated.model)
    if not math.isfinite(calibrated.model.rotor):
        parameters["rotor"] = None
    return {
        "schema": SCHEMA,
        "kind": KIND,
        "axis": calibrated.axis,
        "units": UNITS,
        "parameters": parameters,
        "working_vector": list(WORKING),
        "free": list(calibrated.free),
        "covariance": calibrated.covariance.tolist(),
        "prior_covariance": calibrated.prior_covariance.tolist(),
        "log_ratios": calibrated.log_ratios.tolist(),
        "log_ratio_covariance": calibrated.log_ratio_covariance.tolist(),
        "cross_covariance": calibrated.cross_covariance.tolist(),
        "chi2": calibrated.chi2,
        "degrees": calibrated.degrees,
        "load_rating_N": calibrated.load_rating,
        "nut_mass_kg": calibrated.nut_mass,
        "bearing_share": calibrated.bearing_share,
        "rotor": calibrated.rotor,
        "reasons": list(calibrated.reasons),
        "runs": [asdict(run) for run in calibrated.runs],
        "anchors": [asdict(anchor) for anchor in calibrated.anchors],
        "candidates": [asdict(candidate) for candidate in calibrated.candidates],
        "tolerated": [
            {"field": one.field, "effects": one.effects.tolist(), "found": one.found}
            for one in calibrated.tolerated
        ],
        "knowledge": [dict(one) for one in calibrated.knowledge],
        "made": asdict(calibrated.made),
    }


def write_model(calibrated: CalibratedAxis, path: str | Path) -> None:
    """Write MODEL.json.

    Parameters
    ----------
    calibrated : CalibratedAxis
        The model.
    path : path-like
        The file; overwritten where it is there.

    Raises
    ------
    InputError
        If it cannot be written.
    """
    write_text(path, write_json(model_json(calibrated)) + "\n")


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
        If it cannot be read, is no model, or holds what no model can.
    """
    path = Path(path)
    try:
        size = path.stat().st_size
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: cannot be read ({getattr(error, 'strerror', None) or error}).") from None
    if size > _LONGEST:
        raise InputError(f"{path}: holds {size} bytes; a model has {_LONGEST} at most.")
    document = read_json(path)
    source = path.name
    if document.get("kind") != KIND:
        raise InputError(f"{source}: is no model: its kind is {document.get('kind')!r:.40}, not {KIND!r}.")
    return _model(document, source)


def _model(document: Mapping[str, Any], source: str) -> CalibratedAxis:
    ratios = _array(document, "log_ratios", source, None)
    groups = len(ratios)
    if not 1 <= groups <= _MOST_GROUPS or ratios[0] != 0 or np.abs(ratios).max() > LOGARITHM:
        allowed = f"numbers from {-LOGARITHM:g} to {LOGARITHM:g}, the first of them 0"
        raise field_error(source, "log_ratios", document["log_ratios"], allowed)
    size = len(PARAMETERS)
    covariance = _array(document, "covariance", source, (size, size))
    ratio_covariance = _array(document, "log_ratio_covariance", source, (groups, groups))
    cross = _array(document, "cross_covariance", source, (size, groups))
    whole = np.block([[covariance, cross], [cross.T, ratio_covariance]])
    semidefinite(whole, source, "covariance")
    prior = _array(document, "prior_covariance", source, (size, size))
    semidefinite(prior, source, "prior_covariance")
    model, free = _parameters(document, source), tuple(_texts(document, "free", source, PARAMETERS))
    varies(model, covariance, free, source)
    rotor = _text(document, "rotor", source)
    if rotor != "free":
        raise field_error(source, "rotor", rotor, "'free'")
    runs = tuple(
        _row(CalibrationRun, row, f"{source}: runs[{i}]") for i, row in _rows(document, "runs", source)
    )
    if any(not 0 <= run.group < groups for run in runs):
        raise field_error(source, "runs.group", [run.group for run in runs], f"from 0 to {groups - 1}")
    return CalibratedAxis(
        axis=_text(document, "axis", source),
        model=model,
        covariance=covariance,
        free=free,
        runs=runs,
        log_ratios=ratios,
        log_ratio_covariance=ratio_covariance,
        cross_covariance=cross,
        prior_covariance=prior,
        chi2=_number(document, "chi2", source, 0.0),
        degrees=_number(document, "degrees", source, None),
        candidates=tuple(
            _row(Candidate, row, f"{source}: candidates[{i}]")
            for i, row in _rows(document, "candidates", source)
        ),
        anchors=tuple(
            _row(Anchor, row, f"{source}: anchors[{i}]") for i, row in _rows(document, "anchors", source)
        ),
        load_rating=_number(document, "load_rating_N", source, 1.0, most=1e10),
        nut_mass=_number(document, "nut_mass_kg", source, 1e-3, most=1e7),
        bearing_share=_number(document, "bearing_share", source, 0.0, most=1.0),
        reasons=tuple(_texts(document, "reasons", source)),
        tolerated=_tolerated(document, source, prior),
        knowledge=tuple(row for _, row in _rows(document, "knowledge", source)),
        made=_made(document, source),
    )


def _tolerated(document: Mapping[str, Any], source: str, prior: Array) -> tuple[Tolerated, ...]:
    """None in a document of before they were told."""
    if "tolerated" not in document:
        return ()
    found, rows = [], _rows(document, "tolerated", source)
    if len(rows) > _MOST_TOLERATED:
        raise field_error(source, "tolerated", rows, f"a list of {_MOST_TOLERATED} objects at most")
    for i, row in rows:
        where = f"{source}: tolerated[{i}]"
        effects = _array(row, "effects", where, None)
        if len(effects) != len(PARAMETERS) or np.abs(effects).max() > LOGARITHM:
            allowed = f"{len(PARAMETERS)} numbers from {-LOGARITHM:g} to {LOGARITHM:g}"
            raise field_error(where, "effects", row["effects"], allowed)
        at = _number(row, "found", where, -_FAR, most=_FAR)
        found.append(Tolerated(_text(row, "field", where), effects, at))
    if len({one.field for one in found}) < len(found):
        raise field_error(source, "tolerated.field", [one.field for one in found], "each once")
    if not part_of(found, prior):
        raise InputError(f"{source}: tolerated has effects that are no part of prior_covariance.")
    return tuple(found)


def _parameters(document: Mapping[str, Any], source: str) -> AxialModel:
    table = document.get("parameters")
    if not isinstance(table, dict):
        raise field_error(source, "parameters", table, "a table of numbers")
    values = {}
    for name in AxialModel.__dataclass_fields__:
        if name == "rotor" and name in table and table[name] is None:
            values[name] = math.inf
            continue
        low, high = RANGES[name]
        values[name] = _number(table, name, f"{source}: parameters", low, most=high)
    try:
        return AxialModel(**values)
    except InputError as error:
        raise InputError(f"{source}: {error}") from None


def _array(document: Mapping[str, Any], key: str, source: str, shape: tuple[int, int] | None) -> Array:
    given = document.get(key)
    allowed = "a list of numbers" if shape is None else f"{shape[0]} rows of {shape[1]} finite numbers"
    rows = [given] if shape is None else given
    if not isinstance(rows, list) or not all(
        isinstance(row, list) and row and all(_is_number(value) for value in row) for row in rows
    ):
        raise field_error(source, key, given, allowed)
    if shape is not None and (len(rows) != shape[0] or any(len(row) != shape[1] for row in rows)):
        raise field_error(source, key, given, allowed)
    return np.array(rows[0] if shape is None else rows, dtype=np.float64)


def _is_number(value: Any) -> bool:
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return False
    try:
        return math.isfinite(value)
    except OverflowError:
        return False


def _number(
    table: Mapping[str, Any],
    key: str,
    source: str,
    least: float | None,
    *,
    above: bool = False,
    most: float | None = None,
) -> float:
    value: Any = table.get(key)
    number = float(value) if _is_number(value) else math.nan
    low = least is None or (number > least if above else number >= least)
    if not (math.isfinite(number) and low and (most is None or number <= most)):
        bound = "" if least is None else f", {'above ' if above else 'at least '}{least:g}"
        upper = "" if most is None else f", at most {most:g}"
        raise field_error(source, key, value, f"a finite number{bound}{upper}")
    return number


def _text(table: Mapping[str, Any], key: str, source: str) -> str:
    value = table.get(key)
    if not isinstance(value, str):
        raise field_error(source, key, value, "a text")
    return value


def _texts(
    table: Mapping[str, Any], key: str, source: str, choices: Sequence[str] | None = None
) -> list[str]:
    value = table.get(key)
    if not isinstance(value, list) or not all(isinstance(one, str) for one in value):
        raise field_error(source, key, value, "a list of texts")
    if choices is not None and not set(value) <= set(choices):
        raise field_error(source, key, value, f"of {', '.join(choices)}")
    return value


def _rows(document: Mapping[str, Any], key: str, source: str) -> list[tuple[int, dict[str, Any]]]:
    value = document.get(key)
    if not isinstance(value, list) or not all(isinstance(row, dict) for row in value):
        raise field_error(source, key, value, "a list of objects")
    return list(enumerate(value))


def _row(kind: type[Any], row: Mapping[str, Any], where: str) -> Any:
    """Make a frozen result of the keys that it knows, each of the kind that it says."""
    known, values = kind.__dataclass_fields__, {}
    for name, field in known.items():
        if name not in row:
            continue
        value, told = row[name], str(field.type)
        if told == "float":
            good = _is_number(value) and abs(value) <= _MOST
        elif told == "int":
            good = isinstance(value, int) and not isinstance(value, bool)
        elif told == "bool":
            good = isinstance(value, bool)
        elif told.startswith("tuple"):
            good = isinstance(value, list) and all(isinstance(one, str) for one in value)
            value = tuple(value) if good else value
        else:
            good = isinstance(value, str) or (value is None and "None" in told)
        if not good:
            raise field_error(where, name, value, f"of the kind {told}")
        values[name] = value
    try:
        return kind(**values)
    except TypeError:
        missing = [name for name in known if name not in values]
        raise InputError(f"{where} lacks {', '.join(missing)}.") from None


def _made(document: Mapping[str, Any], source: str) -> Made:
    made = document.get("made")
    if (
        not isinstance(made, dict)
        or not isinstance(made.get("settings"), dict)
        or not isinstance(made.get("version"), str)
        or not isinstance(made.get("inputs"), dict)
    ):
        raise field_error(source, "made", made, "an object with version, settings and inputs")
    return Made(settings=made["settings"], version=made["version"], inputs=made["inputs"])
