"""Small tables of every kind."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import xarray as xr

from ballscrew.base.tables import FREQUENCY_RESPONSE, MODE_TABLE, TRANSIENTS, validate

DTYPES: dict[str, Any] = {"real": np.float64, "complex": np.complex128, "whole": np.int64, "text": "U9"}


def _table(schema: Any, sizes: dict[str, int]) -> xr.Dataset:
    """A table of a schema that holds running numbers."""

    def column(field: Any) -> xr.Variable:
        shape = tuple(sizes[dim] for dim in field.dims)
        values = np.arange(np.prod(shape, dtype=int)).reshape(shape)
        if field.kind == "complex":
            values = values * (1.5 - 0.25j)
        attrs = {"unit": field.units[0]} if len(field.units) > 1 else {}
        return xr.Variable(field.dims, values.astype(DTYPES[field.kind]), attrs)

    data = xr.Dataset(
        {name: column(field) for name, field in schema.variables.items()},
        coords={name: column(field) for name, field in schema.coords.items()},
    )
    return validate(data, schema)


@pytest.fixture(scope="session")
def table() -> Any:
    """The function that makes a table from a schema and the sizes of its dimensions."""
    return _table


@pytest.fixture(params=[TRANSIENTS, FREQUENCY_RESPONSE, MODE_TABLE], ids=lambda schema: schema.name)
def schema(request: pytest.FixtureRequest) -> Any:
    return request.param


@pytest.fixture
def full(schema: Any) -> xr.Dataset:
    return _table(schema, {"transient": 3, "sample": 5, "response": 2, "cell": 4, "frequency": 6})


@pytest.fixture
def empty(schema: Any) -> xr.Dataset:
    return _table(schema, {"transient": 0, "sample": 0, "response": 1, "cell": 0, "frequency": 0})
