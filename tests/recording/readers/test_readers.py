"""Readers found by entry points, other packages' faults survived."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from ballscrew.base.errors import InputError
from ballscrew.recording import readers as module
from ballscrew.recording.header import Header, RawChannel
from ballscrew.recording.readers import Reader, reader_for, readers


class GoodPlugin:
    name = "acme"

    def can_open(self, path: Path, head: bytes) -> bool:
        return path.suffix == ".acme" and head.startswith(b"ACME")

    def read_header(self, path: Path) -> Header:
        return Header((RawChannel("a", int(path.stat().st_size)),), reader=self.name)

    def read(self, path: Path, names: Sequence[str]) -> dict[str, NDArray[Any]]:
        return {name: np.zeros(path.stat().st_size) for name in names}


class PoorPlugin(GoodPlugin):
    name = "poor"

    def can_open(self, path: Path, head: bytes) -> bool:  # noqa: ARG002
        raise RuntimeError("out of order")


class NoReader:
    name = "none"


@pytest.fixture
def plugins(monkeypatch: pytest.MonkeyPatch) -> None:
    names = {"absent": "no_such_package:Reader", "none": f"{__name__}:NoReader"}
    points = [EntryPoint(name, value, module.GROUP) for name, value in names.items()]
    loaded = {"acme": GoodPlugin, "poor": PoorPlugin, "none": NoReader}
    genuine = EntryPoint.load
    monkeypatch.setattr(EntryPoint, "load", lambda point: loaded.get(point.name) or genuine(point))
    points += [EntryPoint(name, "x:y", module.GROUP) for name in ("poor", "acme")]
    monkeypatch.setattr(module, "entry_points", lambda group: points if group == module.GROUP else [])


def test_own_readers_without_metadata(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "entry_points", lambda group: [])  # noqa: ARG005
    assert [reader.name for reader in readers()] == ["hdf5", "mat", "parquet", "npz", "text"]
    assert all(isinstance(reader, Reader) for reader in readers())


@pytest.mark.usefixtures("plugins")
def test_another_package_is_asked_before_text(tmp_path: Path) -> None:
    assert [reader.name for reader in readers()][-3:] == ["poor", "acme", "text"]
    path = tmp_path / "a.acme"
    path.write_bytes(b"ACME 1 2 3")
    assert reader_for(path).name == "acme"
    path.write_bytes(b"1 2 3\n")
    assert reader_for(path).name == "text"


@pytest.mark.usefixtures("plugins")
def test_broken_packages_are_named_where_nothing_opens_the_file(tmp_path: Path) -> None:
    path = tmp_path / "a.tdms"
    path.write_bytes(b"TDSm\0\0\0\0")
    with pytest.raises(InputError, match="no reader knows") as caught:
        reader_for(path)
    for part in (
        "absent: No module named",
        "none: it has not the methods",
        "poor: out of order",
        "acme, text",
    ):
        assert part in str(caught.value)


@pytest.mark.parametrize("name", ["a.h5", "a.hdf5", "a.mat", "a.npz", "a.parquet"])
def test_a_file_is_not_what_its_name_says(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    path.write_text("a,b\n1,2\n")
    with pytest.raises(InputError, match=r"is named as .*, but its content is not"):
        reader_for(path)


def test_empty_absent_and_folder(tmp_path: Path) -> None:
    (tmp_path / "empty.csv").touch()
    with pytest.raises(InputError, match="is empty"):
        reader_for(tmp_path / "empty.csv")
    with pytest.raises(InputError, match="cannot be read"):
        reader_for(tmp_path / "absent.csv")
    with pytest.raises(InputError, match="cannot be read"):
        reader_for(tmp_path)
    with pytest.raises(InputError, match="cannot be read"):
        reader_for("a\0b")


def test_a_spreadsheet_is_no_npz(tmp_path: Path) -> None:
    import zipfile

    with zipfile.ZipFile(tmp_path / "a.xlsx", "w") as archive:
        archive.writestr("[Content_Types].xml", "<a/>" * 100)
    with pytest.raises(InputError, match="no reader knows"):
        reader_for(tmp_path / "a.xlsx")
