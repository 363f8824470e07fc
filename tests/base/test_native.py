from __future__ import annotations

import contextlib
import hashlib
import os

import h5py
import numpy as np
import pytest
import xarray as xr
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from ballscrew.base import native
from ballscrew.base.errors import InputError
from ballscrew.base.native import read_table, write_table
from ballscrew.base.tables import FREQUENCY_RESPONSE, MODE_TABLE, TRANSIENTS


def test_a_table_comes_back_as_it_was(tmp_path, full):
    write_table(full, tmp_path / "t.h5")
    xr.testing.assert_identical(read_table(tmp_path / "t.h5"), full)


def test_an_empty_table_comes_back(tmp_path, empty):
    write_table(empty, tmp_path / "t.h5")
    back = read_table(tmp_path / "t.h5")
    xr.testing.assert_identical(back, empty)
    assert {n: v.dtype.kind for n, v in back.variables.items()} == {
        n: v.dtype.kind for n, v in empty.variables.items()
    }


def test_types_survive(tmp_path, full):
    def small(v: xr.DataArray) -> xr.DataArray:
        return v.astype({"f": "f4", "i": "i2", "c": "c8"}.get(v.dtype.kind, v.dtype))

    single = full.map(small, keep_attrs=True)
    write_table(single, tmp_path / "t.h5")
    back = read_table(tmp_path / "t.h5")
    numbers = [name for name, v in single.data_vars.items() if v.dtype.kind != "U"]
    assert {n: back[n].dtype for n in numbers} == {n: single[n].dtype for n in numbers}
    assert all(back[n].dtype.kind == "U" for n in single.data_vars if n not in numbers)


@settings(max_examples=5, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    values=arrays(np.complex128, (2, 1, 15), elements=st.complex_numbers(allow_nan=True, allow_infinity=True))
)
def test_every_complex_number_survives_to_the_bit(tmp_path, table, values):
    data = table(FREQUENCY_RESPONSE, {"cell": 2, "response": 1, "frequency": 15})
    data = data.assign(H1=(data["H1"].dims, values))
    write_table(data, tmp_path / "t.h5")
    assert read_table(tmp_path / "t.h5")["H1"].values.tobytes() == values.tobytes()


def test_truth_values_and_numbers_as_coordinates_survive(tmp_path, table):
    modes = table(MODE_TABLE, {"cell": 2}).assign_coords(
        complete=("cell", [True, False]), pole=("cell", [1 + 2j, 3 - 4j])
    )
    write_table(modes, tmp_path / "t.h5")
    back = read_table(tmp_path / "t.h5")
    xr.testing.assert_identical(back, modes)
    assert back["complete"].dtype == bool


def test_nan_and_other_alphabets_survive(tmp_path, table):
    modes = table(MODE_TABLE, {"cell": 2}).assign(
        frequency_Hz=("cell", np.array([np.nan, 171.5]), {"unit": "Hz"}),
        reasons=("cell", np.array(["", "no peak; Kohärenz 0.3 µ"])),
    )
    write_table(modes, tmp_path / "t.h5")
    xr.testing.assert_identical(read_table(tmp_path / "t.h5"), modes)


@pytest.mark.parametrize(
    "value",
    ["text", "", "json:[", 3, 2.5, True, None, [1, 2], {"a": {"b": [1.5, "x"]}}, float("inf"), 10**30],
)
def test_attributes_survive(tmp_path, full, value):
    marked = full.assign_attrs(made=value)
    marked["extra"] = ((), 1.0, {"how": value})
    write_table(marked, tmp_path / "t.h5")
    back = read_table(tmp_path / "t.h5")
    assert back.attrs["made"] == value
    assert type(back.attrs["made"]) is type(value)
    assert back["extra"].attrs["how"] == value


def test_nothing_is_compressed_and_a_cell_can_be_read_alone(tmp_path, table):
    data = table(TRANSIENTS, {"transient": 300, "sample": 1024, "response": 2})
    write_table(data, tmp_path / "t.h5")
    with h5py.File(tmp_path / "t.h5") as file:
        assert file["acceleration"].compression is None
        assert file["acceleration"].chunks == (1, 128, 1024)


def test_a_table_without_a_schema_is_not_written(tmp_path):
    with pytest.raises(InputError, match="its schema is None; it must be one of"):
        write_table(xr.Dataset({"a": 1}), tmp_path / "t.h5")
    assert not list(tmp_path.iterdir())


def test_a_folder_that_is_not_there_is_said(tmp_path, full):
    with pytest.raises(InputError, match="cannot be written"):
        write_table(full, tmp_path / "none" / "t.h5")


def test_writing_again_replaces_and_leaves_nothing_else(tmp_path, full):
    write_table(full, tmp_path / "t.h5")
    write_table(full.assign_attrs(second="yes"), tmp_path / "t.h5")
    assert read_table(tmp_path / "t.h5").attrs["second"] == "yes"
    assert os.listdir(tmp_path) == ["t.h5"]  # noqa: PTH208


def _sentence(error: pytest.ExceptionInfo[InputError]) -> str:
    text = str(error.value)
    assert "\n" not in text
    assert text.endswith(".")
    return text


def test_no_file(tmp_path):
    with pytest.raises(InputError) as error:
        read_table(tmp_path / "none.h5")
    assert "none.h5: cannot be read" in _sentence(error)


@pytest.mark.parametrize("content", [b"", b"\x89HDF\r\n\x1a\n", b"not HDF5 at all" * 100, bytes(4096)])
def test_a_foreign_file(tmp_path, content):
    (tmp_path / "t.h5").write_bytes(content)
    with pytest.raises(InputError) as error:
        read_table(tmp_path / "t.h5")
    assert "t.h5" in _sentence(error)


def test_an_hdf5_file_of_another_program(tmp_path):
    with h5py.File(tmp_path / "t.h5", "w") as file:
        file["torque"] = np.zeros(5)
    with pytest.raises(InputError) as error:
        read_table(tmp_path / "t.h5")
    assert "t.h5" in _sentence(error)


@pytest.mark.parametrize("part", [0.02, 0.3, 0.6, 0.9, 0.999])
def test_a_cut_file(tmp_path, full, part):
    write_table(full, tmp_path / "t.h5")
    content = (tmp_path / "t.h5").read_bytes()
    (tmp_path / "t.h5").write_bytes(content[: int(part * len(content))])
    with pytest.raises(InputError) as error:
        read_table(tmp_path / "t.h5")
    _sentence(error)


@contextlib.contextmanager
def _opened(path):
    """Change a file behind its seal's back and seal it again, as only a deliberate hand does."""
    with h5py.File(path, "a") as file:
        yield file
    content = path.read_bytes().split(b"ballscrew-sha256:")[0]
    path.write_bytes(content + b"ballscrew-sha256:" + hashlib.sha256(content).hexdigest().encode())


def _rewritten(path, full, **attrs):
    write_table(full, path)
    with _opened(path) as file:
        for key, value in attrs.items():
            file.attrs[key] = value


def test_a_later_schema(tmp_path, full):
    _rewritten(tmp_path / "t.h5", full, schema_version="json:99")
    with pytest.raises(InputError) as error:
        read_table(tmp_path / "t.h5")
    assert "was written by a later version of ballscrew" in _sentence(error)


@pytest.mark.parametrize("version", ["json:0", "json:true", "json:null", "json:[", "one", -3, 1.5])
def test_an_impossible_schema_version(tmp_path, full, version):
    _rewritten(tmp_path / "t.h5", full, schema_version=version)
    with pytest.raises(InputError) as error:
        read_table(tmp_path / "t.h5")
    _sentence(error)


def test_an_unknown_schema(tmp_path, full):
    _rewritten(tmp_path / "t.h5", full, schema="of someone else")
    with pytest.raises(InputError, match="its schema is 'of someone else'; it must be one of transients"):
        read_table(tmp_path / "t.h5")


def test_a_file_that_lost_a_field(tmp_path, table):
    write_table(table(MODE_TABLE, {"cell": 3}), tmp_path / "t.h5")
    with _opened(tmp_path / "t.h5") as file:
        del file["verdict"]
    with pytest.raises(InputError, match="verdict is missing"):
        read_table(tmp_path / "t.h5")


def test_a_small_file_that_announces_a_huge_table_is_not_loaded(tmp_path):
    with _opened(tmp_path / "t.h5") as file:
        file.attrs["schema"] = "modes"
        file.attrs["schema_version"] = "json:1"
        scale = file.create_dataset("cell", (1 << 40,), "f8", chunks=(1 << 20,))
        scale.make_scale("cell")
        data = file.create_dataset("frequency_Hz", (1 << 40,), "f8", chunks=(1 << 20,))
        data.dims[0].attach_scale(scale)
    with pytest.raises(InputError) as error:
        read_table(tmp_path / "t.h5")
    assert "is cut or not what it claims" in _sentence(error)


def test_a_file_that_points_into_another_file_is_not_followed(tmp_path, table):
    write_table(table(MODE_TABLE, {"cell": 3}), tmp_path / "other.h5")
    write_table(table(MODE_TABLE, {"cell": 3}), tmp_path / "t.h5")
    with _opened(tmp_path / "t.h5") as file:
        del file["verdict"]
        file["verdict"] = h5py.ExternalLink(str(tmp_path / "other.h5"), "/verdict")
    with pytest.raises(InputError) as error:
        read_table(tmp_path / "t.h5")
    assert "'verdict' is no plain column" in _sentence(error)


@given(where=st.floats(0, 1, exclude_max=True), bit=st.integers(0, 7))
@settings(deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_every_damaged_bit_is_seen(tmp_path, table, where, bit):
    path = tmp_path / "t.h5"
    if not path.exists():
        write_table(table(MODE_TABLE, {"cell": 3}), path)
    content = bytearray(path.read_bytes())
    content[int(where * len(content))] ^= 1 << bit
    (tmp_path / "damaged.h5").write_bytes(content)
    with pytest.raises(InputError, match=r"damaged\.h5: is (damaged|not a table of ballscrew)") as error:
        read_table(tmp_path / "damaged.h5")
    _sentence(error)


def test_other_programs_can_read_a_sealed_file(tmp_path, table):
    write_table(table(MODE_TABLE, {"cell": 3}), tmp_path / "t.h5")
    assert (tmp_path / "t.h5").read_bytes()[-81:].startswith(b"ballscrew-sha256:")
    with h5py.File(tmp_path / "t.h5") as file:
        assert file["frequency_Hz"][:].tolist() == [0, 1, 2]
    with xr.open_dataset(tmp_path / "t.h5", engine="h5netcdf") as data:
        assert data["frequency_Hz"].attrs["unit"] == "Hz"


def test_something_after_the_seal_is_seen(tmp_path, full):
    write_table(full, tmp_path / "t.h5")
    with (tmp_path / "t.h5").open("ab") as stream:
        stream.write(b"x")
    with pytest.raises(InputError, match="is not a table of ballscrew, or is cut"):
        read_table(tmp_path / "t.h5")


def test_a_sealed_file_that_names_no_schema_is_refused(tmp_path, full):
    path = tmp_path / "t.h5"
    write_table(full, path)
    with _opened(path) as file:
        del file.attrs["schema"]
    with pytest.raises(InputError, match="is not a table of ballscrew: it names no schema"):
        read_table(path)


@pytest.mark.parametrize("kind", [object, "S9"])
def test_texts_are_those_of_numpy_whatever_type_a_library_reads_them_as(kind):
    texts = np.array(["suspect", ""]).astype(kind)
    found = native._join(xr.Dataset({"verdict": ("cell", texts)}))
    assert found["verdict"].dtype.kind == "U"
    assert found["verdict"].values.tolist() == ["suspect", ""]
