"""Schemas of the tables that the steps exchange, and their check.

A table may hold more than its schema names; what the schema names must be there, in that shape and unit.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

from ballscrew.base.errors import BallscrewError

if TYPE_CHECKING:
    import xarray as xr

Kind = Literal["real", "complex", "whole", "text"]

_DTYPES: dict[Kind, str] = {"real": "f", "complex": "c", "whole": "iu", "text": "UT"}
_WORDS: dict[Kind, str] = {
    "real": "real numbers",
    "complex": "complex numbers",
    "whole": "whole numbers",
    "text": "texts",
}


@dataclass(frozen=True, slots=True)
class Field:
    """One variable or coordinate of a table.

    Parameters
    ----------
    dims : tuple of str
        In this order.
    kind : str
        ``"real"``, ``"complex"``, ``"whole"`` or ``"text"``.
    units : tuple of str
        Units that its attribute ``unit`` may hold; where there is one only, :func:`validate` fills it in.
        Empty where the unit follows from others, or there is none.
    """

    dims: tuple[str, ...]
    kind: Kind = "real"
    units: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Schema:
    """Schema of a table.

    Parameters
    ----------
    name : str
        Name of the table.
    version : int
        Grows when a field is renamed or changes its meaning; a reader refuses a later one.
    variables, coords : mapping
        Name to :class:`Field`.
    """

    name: str
    version: int
    variables: Mapping[str, Field] = field(hash=False)
    coords: Mapping[str, Field] = field(hash=False)


_T = ("transient",)
_TS = ("transient", "sample")
_C = ("cell",)
_CF = ("cell", "frequency")
_CRF = ("cell", "response", "frequency")

_CELL_COORDS = {
    "position_m": Field(_C, "real", ("m",)),
    "condition": Field(_C, "text"),
    "motion": Field(_C, "whole"),
    "mass_kg": Field(_C, "real", ("kg",)),
}

TRANSIENTS = Schema(
    "transients",
    1,
    {
        "input": Field(_TS, "real", ("N m", "N", "A", "")),
        "position": Field(_TS, "real", ("m",)),
        "acceleration": Field(("response", "transient", "sample"), "real", ("m/s^2",)),
        "length": Field(_T, "whole"),
    },
    {
        "file": Field(_T, "whole"),
        "start_s": Field(_T, "real", ("s",)),
        "stop_s": Field(_T, "real", ("s",)),
        "position_m": Field(_T, "real", ("m",)),
        "condition": Field(_T, "text"),
        "motion": Field(_T, "whole"),
        "repetition": Field(_T, "whole"),
        "mass_kg": Field(_T, "real", ("kg",)),
        "response": Field(("response",), "text"),
    },
)

FREQUENCY_RESPONSE = Schema(
    "frequency-response",
    1,
    {
        "S_uu": Field(_CF),
        "S_yy": Field(_CRF),
        "S_uy": Field(_CRF, "complex"),
        "H1": Field(_CRF, "complex"),
        "H2": Field(_CRF, "complex"),
        "Hv": Field(_CRF, "complex"),
        "coherence": Field(_CRF, "real", ("1",)),
        "repetitions": Field(_C, "whole"),
    },
    {
        **_CELL_COORDS,
        "response": Field(("response",), "text"),
        "frequency": Field(("frequency",), "real", ("Hz",)),
    },
)

MODE_TABLE = Schema(
    "modes",
    1,
    {
        "frequency_Hz": Field(_C, "real", ("Hz",)),
        "standard_uncertainty_Hz": Field(_C, "real", ("Hz",)),
        "damping_ratio": Field(_C, "real", ("1",)),
        "method": Field(_C, "text"),
        "verdict": Field(_C, "text"),
        "reasons": Field(_C, "text"),
    },
    _CELL_COORDS,
)

SCHEMAS: Mapping[str, Schema] = {s.name: s for s in (TRANSIENTS, FREQUENCY_RESPONSE, MODE_TABLE)}


def validate(dataset: xr.Dataset, schema: Schema) -> xr.Dataset:
    """Check a table against its schema.

    Parameters
    ----------
    dataset : xarray.Dataset
        The table; it is not changed.
    schema : Schema
        Its schema.

    Returns
    -------
    xarray.Dataset
        The same data, with the units that go without saying and the schema's name and version as attributes.

    Raises
    ------
    BallscrewError
        Naming the first field that is missing, of other dimensions, of another kind or in another unit.
    """
    units: dict[str, str] = {}
    groups: tuple[tuple[str, Mapping[str, Field], Mapping[Hashable, xr.DataArray]], ...] = (
        ("variable", schema.variables, dataset.data_vars),
        ("coordinate", schema.coords, dataset.coords),
    )
    for role, fields, present in groups:
        for name, wanted in fields.items():
            where = f"the table {schema.name!r}: {role} {name}"
            if name not in present:
                raise BallscrewError(f"{where} is missing; it must lie along {', '.join(wanted.dims)}.")
            _check(present[name], wanted, where)
            if wanted.units:
                units[name] = _unit(present[name], wanted, where)
    out = dataset.copy(deep=False)
    for name, unit in units.items():
        if out[name].attrs.get("unit") != unit:
            out[name] = out[name].assign_attrs(unit=unit)
    return out.assign_attrs(schema=schema.name, schema_version=schema.version)


def table_rows(dataset: xr.Dataset, *names: str) -> Iterator[tuple[Any, ...]]:
    """Rows of one-dimensional variables of a table, as Python values in the order of the names."""
    return zip(*(dataset[name].values.tolist() for name in names), strict=True)


def group_rows(dataset: xr.Dataset, *names: str) -> dict[tuple[Any, ...], list[int]]:
    """Rows with the same values of one-dimensional variables, in the order of their first row."""
    rows: dict[tuple[Any, ...], list[int]] = {}
    for row, key in enumerate(table_rows(dataset, *names)):
        rows.setdefault(key, []).append(row)
    return rows


def _check(array: xr.DataArray, wanted: Field, where: str) -> None:
    if array.dims != wanted.dims:
        given = ", ".join(str(dim) for dim in array.dims) or "nothing"
        raise BallscrewError(f"{where} lies along {given}; it must lie along {', '.join(wanted.dims)}.")
    texts = array.dtype.kind == "O" and all(isinstance(item, str) for item in array.values.flat)
    if not (wanted.kind == "text" and texts) and array.dtype.kind not in _DTYPES[wanted.kind]:
        raise BallscrewError(f"{where} holds {array.dtype}; it must hold {_WORDS[wanted.kind]}.")


def _unit(array: xr.DataArray, wanted: Field, where: str) -> str:
    given = array.attrs.get("unit")
    if given is None and len(wanted.units) == 1:
        return wanted.units[0]
    if given not in wanted.units:
        raise BallscrewError(f"{where} has the unit {given!r}; it must be one of {', '.join(wanted.units)}.")
    return str(given)
