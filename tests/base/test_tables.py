from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

from ballscrew.base.errors import BallscrewError
from ballscrew.base.tables import FREQUENCY_RESPONSE, MODE_TABLE, SCHEMAS, TRANSIENTS, validate


def test_a_whole_table_passes_and_says_what_it_is(full, schema):
    checked = validate(full, schema)
    assert checked.attrs == {"schema": schema.name, "schema_version": schema.version}
    xr.testing.assert_equal(checked, full)


def test_an_empty_table_passes(empty, schema):
    assert validate(empty, schema).attrs["schema"] == schema.name


def test_a_table_may_hold_more_than_its_schema(full, schema):
    assert "more" in validate(full.assign(more=1.0), schema)


def test_the_check_changes_nothing_in_place(full, schema):
    bare = full.copy(deep=True).assign_attrs({})
    bare.attrs = {}
    for variable in bare.variables.values():
        if variable.attrs.get("unit") in {"m", "kg", "Hz", "s", "1", "m/s^2"}:
            variable.attrs = {}
    before = bare.copy(deep=True)
    validate(bare, schema)
    xr.testing.assert_identical(bare, before)


def test_units_that_go_without_saying_are_filled_in(full, schema):
    for name, field in (schema.variables | schema.coords).items():
        if len(field.units) == 1:
            assert full[name].attrs["unit"] == field.units[0]


def test_every_field_that_is_missing_is_named(full, schema):
    for name in (*schema.variables, *schema.coords):
        with pytest.raises(BallscrewError, match=rf"{schema.name}.* {name} is missing; it must lie along"):
            validate(full.drop_vars(name), schema)


def test_other_dimensions_are_named(full):
    wrong = full.rename({name: f"other_{name}" for name in full.dims if name in ("cell", "transient")})
    schema = SCHEMAS[full.attrs["schema"]]
    with pytest.raises(BallscrewError, match=r"lies along .*other_.*; it must lie along"):
        validate(wrong, schema)


@pytest.mark.parametrize("schema", [TRANSIENTS, FREQUENCY_RESPONSE], indirect=True)
def test_the_order_of_dimensions_counts(full, schema):
    with pytest.raises(BallscrewError, match="it must lie along"):
        validate(full.transpose(), schema)


@pytest.mark.parametrize(
    ("name", "values", "words"),
    [
        ("frequency_Hz", ["a", "b", "c", "d"], "real numbers"),
        ("frequency_Hz", [1j, 1j, 1j, 1j], "real numbers"),
        ("method", [1.0, 2.0, 3.0, 4.0], "texts"),
        ("method", np.array(["a", None, "c", "d"], dtype=object), "texts"),
    ],
)
def test_another_kind_of_value_is_named(table, name, values, words):
    modes = table(MODE_TABLE, {"cell": 4})
    with pytest.raises(BallscrewError, match=f"{name} holds .*; it must hold {words}"):
        validate(modes.assign({name: ("cell", np.asarray(values))}), MODE_TABLE)


@pytest.mark.parametrize("unit", [None, "mm", 3])
def test_an_input_without_a_unit_of_its_kinds_is_refused(table, unit):
    data = table(TRANSIENTS, {"transient": 2, "sample": 3, "response": 1})
    attrs = {} if unit is None else {"unit": unit}
    wrong = data.assign(input=(data["input"].dims, data["input"].values, attrs))
    with pytest.raises(BallscrewError, match=r"variable input has the unit .*; it must be one of N m, N, A"):
        validate(wrong, TRANSIENTS)


def test_a_wrong_unit_is_refused_where_only_one_is_allowed(table):
    modes = table(MODE_TABLE, {"cell": 2})
    wrong = modes.assign(frequency_Hz=modes["frequency_Hz"].assign_attrs(unit="rad/s"))
    with pytest.raises(BallscrewError, match="frequency_Hz has the unit 'rad/s'"):
        validate(wrong, MODE_TABLE)


def test_texts_may_be_objects(table):
    modes = table(MODE_TABLE, {"cell": 2})
    assert validate(modes.assign(method=("cell", np.array(["a", "bc"], dtype=object))), MODE_TABLE)
