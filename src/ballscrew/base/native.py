"""Tables to and from native HDF5 files (a NetCDF-4 layout), lossless and uncompressed.

Complex variables become pairs of real ones, for NetCDF knows no complex numbers; attributes that are not
texts become JSON. Chunks are one leading index (a cell, a channel) of about a mebibyte, so that a cell can
be read alone.

The file ends with a seal, the SHA-256 of all before it, which other programs skip. It is checked before HDF5
opens the file: one damaged byte can keep that library busy for ever, or give other numbers without a word.
"""

from __future__ import annotations

import hashlib
import io
import json
import math
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import xarray as xr

from ballscrew.base.errors import BallscrewError, InputError
from ballscrew.base.files import replacing
from ballscrew.base.tables import SCHEMAS, validate

_REAL, _IMAG = "__real", "__imag"
_JSON = "json:"
_CHUNK_BYTES = 1 << 20
_OVERHEAD_BYTES = 1 << 20
_BLOCK_BYTES = 1 << 20
_SEAL = b"ballscrew-sha256:"
_SEAL_BYTES = len(_SEAL) + 64


def write_table(dataset: xr.Dataset, path: str | Path) -> None:
    """Write a table; a file of that name is replaced at once or not at all.

    Parameters
    ----------
    dataset : xarray.Dataset
        With the attributes ``schema`` and ``schema_version``, which
        :func:`ballscrew.base.tables.validate` sets.
    path : path-like
        The file.

    Raises
    ------
    BallscrewError
        If it is no table of a known schema, or the file cannot be written.
    """
    checked = _checked(dataset, "the table to be written")
    flat = _split(checked)
    encoding = {name: _encoding(flat[name]) for name in flat.variables}
    with replacing(path) as temporary:
        flat.to_netcdf(temporary, engine="h5netcdf", encoding=encoding)
        _seal(temporary)


def read_table(path: str | Path) -> xr.Dataset:
    """Read a table that :func:`write_table` wrote, whole, into memory.

    Parameters
    ----------
    path : path-like
        The file.

    Returns
    -------
    xarray.Dataset
        As it was written, checked against its schema.

    Raises
    ------
    InputError
        If the file cannot be read, is not such a table, is cut or damaged, or was written by a later version.
    """
    path = Path(path)
    try:
        _check_seal(path)
        _inspect(path)
        with xr.open_dataset(
            path,
            engine="h5netcdf",
            mask_and_scale=False,
            decode_times=False,
            decode_timedelta=False,
            cache=False,
        ) as lazy:
            flat = lazy.load()
        joined = _join(flat)
    except InputError:
        raise
    except OSError as error:
        # h5py's own texts run over several lines of C; what the system says is enough.
        reason = error.strerror or "it is not HDF5, or is cut"
        raise InputError(f"{path}: cannot be read ({reason}).") from None
    except Exception as error:  # noqa: BLE001  the libraries below raise what they like on a damaged file
        raise InputError(
            f"{path}: is not a table of ballscrew, or is damaged ({type(error).__name__})."
        ) from None
    return _checked(joined, str(path))


def _seal(path: Path) -> None:
    with path.open("rb+") as stream:
        seal = _SEAL + hashlib.file_digest(stream, "sha256").hexdigest().encode()
        stream.seek(0, io.SEEK_END)
        stream.write(seal)


def _check_seal(path: Path) -> None:
    content = path.stat().st_size - _SEAL_BYTES
    digest = hashlib.sha256()
    with path.open("rb") as stream:
        for start in range(0, content, _BLOCK_BYTES):
            digest.update(stream.read(min(content - start, _BLOCK_BYTES)))
        seal = stream.read(_SEAL_BYTES + 1)
    if not seal.startswith(_SEAL):
        raise InputError(f"{path}: is not a table of ballscrew, or is cut: it does not end with a seal.")
    if seal != _SEAL + digest.hexdigest().encode():
        raise InputError(f"{path}: is damaged or was changed: its content is not what its seal says.")


def _inspect(path: Path) -> None:
    """Refuse, before anything is loaded, a sealed file that no table of ours looks like."""
    size = path.stat().st_size
    claimed = 0
    with h5py.File(path, "r") as file:
        if "schema" not in file.attrs:
            raise InputError(f"{path}: is not a table of ballscrew: it names no schema.")
        for name in file:
            plain = isinstance(file.get(name, getlink=True), h5py.HardLink)
            item = file[name] if plain else None
            if not isinstance(item, h5py.Dataset) or item.is_virtual or item.external:
                raise InputError(f"{path}: is not a table of ballscrew: {name!r} is no plain column.")
            claimed += item.nbytes
    if claimed > size + _OVERHEAD_BYTES:
        raise InputError(
            f"{path}: is cut or not what it claims: it has {size} bytes and announces {claimed}."
        )


def _checked(dataset: xr.Dataset, where: str) -> xr.Dataset:
    name, version = dataset.attrs.get("schema"), dataset.attrs.get("schema_version")
    schema = SCHEMAS.get(name) if isinstance(name, str) else None
    if schema is None:
        raise InputError(f"{where}: its schema is {name!r}; it must be one of {', '.join(SCHEMAS)}.")
    if isinstance(version, bool) or not isinstance(version, int) or version < 1:
        raise InputError(
            f"{where}: its schema_version is {version!r}; "
            f"it must be a whole number from 1 to {schema.version}."
        )
    if version > schema.version:
        raise InputError(
            f"{where}: was written by a later version of ballscrew "
            f"({schema.name} {version}; this one reads up to {schema.version})."
        )
    try:
        return validate(dataset, schema)
    except BallscrewError as error:
        raise InputError(f"{where}: {error}") from None


def _split(dataset: xr.Dataset) -> xr.Dataset:
    coords = list(dataset.coords)
    columns: dict[Any, xr.Variable] = {}
    for name, variable in dataset.variables.items():
        attrs = {key: _encoded(value) for key, value in variable.attrs.items()}
        if variable.dtype.kind == "c":
            coords = [f"{name}{_REAL}" if coord == name else coord for coord in coords]
            columns[f"{name}{_REAL}"] = xr.Variable(variable.dims, variable.values.real, attrs)
            columns[f"{name}{_IMAG}"] = xr.Variable(variable.dims, variable.values.imag)
        elif variable.dtype.kind in "UTO":
            columns[name] = xr.Variable(variable.dims, variable.values.astype(object), attrs)
        else:
            columns[name] = xr.Variable(variable.dims, variable.values, attrs)
    attrs = {key: _encoded(value) for key, value in dataset.attrs.items()}
    return xr.Dataset(columns, attrs=attrs).set_coords([name for name in coords if name in columns])


def _join(flat: xr.Dataset) -> xr.Dataset:
    coords = list(flat.coords)
    columns: dict[Any, xr.Variable] = {}
    for key, variable in flat.variables.items():
        name = str(key)
        attrs = {k: _decoded(v) for k, v in variable.attrs.items()}
        values = variable.values
        if name.endswith(_IMAG) and f"{name.removesuffix(_IMAG)}{_REAL}" in flat.variables:
            continue
        if name.endswith(_REAL) and f"{name.removesuffix(_REAL)}{_IMAG}" in flat.variables:
            coords = [name.removesuffix(_REAL) if coord == key else coord for coord in coords]
            name = name.removesuffix(_REAL)
            joined = np.empty(values.shape, np.result_type(values.dtype, np.complex64))
            joined.real, joined.imag = values, flat[f"{name}{_IMAG}"].values
            values = joined
        elif values.dtype.kind in "OST":
            values = values.astype(str)
        columns[name] = xr.Variable(variable.dims, values, attrs)
    attrs = {key: _decoded(value) for key, value in flat.attrs.items()}
    return xr.Dataset(columns, attrs=attrs).set_coords([name for name in coords if name in columns])


def _encoding(array: xr.DataArray) -> dict[str, Any]:
    encoding: dict[str, Any] = {"_FillValue": None}
    if array.dtype.kind == "O":
        return {**encoding, "dtype": str}
    if array.ndim < 2 or not array.size:
        return encoding
    rows = max(1, _CHUNK_BYTES // (array.dtype.itemsize * array.shape[-1]))
    chunks = [1] * (array.ndim - 2) + [min(rows, array.shape[-2]), array.shape[-1]]
    return {**encoding, "chunksizes": tuple(chunks)}


def _encoded(value: Any) -> str:
    if isinstance(value, str) and not value.startswith(_JSON) and value:
        return value
    return _JSON + json.dumps(value.tolist() if hasattr(value, "tolist") else value, ensure_ascii=True)


def _decoded(value: Any) -> Any:
    if isinstance(value, str) and value.startswith(_JSON):
        return json.loads(value.removeprefix(_JSON))
    if isinstance(value, np.generic) and math.prod(value.shape) == 1:
        return value.item()
    return value
