"""Readers found by entry points, other packages' faults survived."""

from __future__ import annotations

import bz2
import gzip
import importlib.util
import io
import lzma
import sys
import zipfile
from collections.abc import Sequence
from importlib.metadata import EntryPoint
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from ballscrew import __version__
from ballscrew.base.errors import InputError
from ballscrew.recording import readers as module
from ballscrew.recording.header import Header, RawChannel
from ballscrew.recording.readers import Reader, reader_for, readers
from ballscrew.recording.readers.guard import refusing


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
    assert [reader.name for reader in readers()] == list(module._BUILT_IN)
    assert list(module._BUILT_IN)[-1] == "text"
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
    path = tmp_path / "a.rec"
    path.write_bytes(b"\0\0\0\0\0\0")
    with pytest.raises(InputError, match="no reader knows") as caught:
        reader_for(path)
    for part in (
        "absent: No module named",
        "none: it has not the methods",
        "poor: out of order",
        "acme, text",
    ):
        assert part in str(caught.value)


@pytest.mark.parametrize(
    "name", ["a.h5", "a.hdf5", "a.mat", "a.npz", "a.parquet", "a.uff", "a.wav", "a.tdms"]
)
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


def zip_of(member: str, content: str) -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        archive.writestr(member, content)
    return buffer.getvalue()


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        (
            "a.xlsx",
            zip_of("[Content_Types].xml", "<a/>" * 100),
            "Excel or other Office.*save the sheet as CSV",
        ),
        (
            "a.ods",
            zip_of("mimetype", "application/vnd.oasis.opendocument.spreadsheet"),
            "OpenDocument.*as CSV",
        ),
        ("a.xls", b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1\0", "old Excel.*as CSV"),
        (
            "a.xls",
            b'<?xml version="1.0"?>\n<?mso-application progid="Excel.Sheet"?>',
            "Excel workbook as XML",
        ),
        ("a.zip", zip_of("trip1.csv", "a,b"), "zip archive.*unpack it"),
        ("a.csv.gz", gzip.compress(b"a,b\n1,2\n", mtime=0), "gzip archive.*unpack it"),
        ("a.bz2", bz2.compress(b"a,b"), "unpack it"),
        ("a.xz", lzma.compress(b"a,b"), "unpack it"),
        ("a.mdf", b"MDF     3.30    \0", "MDF file before version 4.*save it as MDF 4 where"),
        ("a.tdms_index", b"TDSh\0", "index of a TDMS file.*give the .tdms"),
        ("a.db", b"SQLite format 3\0\x10", "SQLite database.*as CSV"),
        ("a.pcap", b"\xd4\xc3\xb2\xa1\2\0\4\0", "network capture"),
        ("a.pcapng", b"\x0a\x0d\x0d\x0a\x1c\0\0\0\x4d\x3c\x2b\x1a", "network capture"),
        ("a.dxd", b"DX\0\1", "Dewesoft recording.*in Dewesoft"),
        ("a.D7D", b"D7\0\1", "Dewesoft recording"),
        ("a.ldsf", b"\1\0", "Simcenter Testlab.*UFF58"),
        ("a.hdf", b"HEADER\r\nstart of data : 65536\r\nnbr of channel : 2\r\n", "HEAD acoustics"),
        ("a.dat", b"\1\0", r"binary \.dat"),
        ("a.bin", b"\x94\x13\x10\0\0\0", "catman file.*in catman"),
        ("a.pti", b"\1\0", "Brüel & Kjær"),
        ("a.npy", b"\x93NUMPY\1\0", r"numpy\.savez"),
        ("a.pkl", b"\x80\4\x95", "pickle"),
        ("a.raw", b"|CF,2,1,1;|CK,1,3,1,1;", "imc FAMOS"),
        ("a.xml", b"<?xml version='1.0'?><a/>", "XML of an unknown kind"),
        ("a.pdf", b"%PDF-1.7", "PDF document.*the recording itself"),
    ],
)
def test_a_known_format_that_is_not_read_is_named_with_what_to_do(
    tmp_path: Path, name: str, content: bytes, message: str
) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match=rf"is .*{message}"):
        reader_for(tmp_path / name)


def test_text_is_read_whatever_its_name(tmp_path: Path) -> None:
    for name in ("a.dat", "a.bin", "a.xls", "a.lms"):
        (tmp_path / name).write_text("torque [Nm]\tpos [mm]\n1\t2\n")
        assert reader_for(tmp_path / name).name == "text"


def test_the_version_of_a_reader_is_that_of_its_package(monkeypatch: pytest.MonkeyPatch) -> None:
    package = SimpleNamespace(name="acme-reader", version="1.2")
    points = {"acme": [SimpleNamespace(dist=None), SimpleNamespace(dist=package)]}
    monkeypatch.setattr(module, "entry_points", lambda group, name: points.get(name, []) if group else [])
    assert module.version_of("npz") == f"ballscrew {__version__}"
    assert module.version_of("acme") == "acme-reader 1.2"
    assert module.version_of("none") == ""


def test_a_reader_that_wants_more_memory_than_there_is_is_a_sentence() -> None:
    with (
        pytest.raises(InputError, match=r"^a\.h5: declares more data than this machine's memory can hold\.$"),
        refusing(Path("a.h5"), "HDF5"),
    ):
        raise MemoryError


@pytest.mark.parametrize(
    ("name", "library", "reader", "head"),
    [
        ("mdf4", "asammdf", "Mdf4Reader", b"MDF     4"),
        ("parquet", "pyarrow", "ParquetReader", b"PAR1"),
        ("tdms", "nptdms", "TdmsReader", b"TDSm"),
    ],
)
def test_a_reader_whose_library_is_not_installed_is_there_and_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, library: str, reader: str, head: bytes
) -> None:
    spec = importlib.util.find_spec(f"ballscrew.recording.readers.{name}")
    assert spec is not None
    assert spec.loader is not None
    monkeypatch.setitem(sys.modules, library, None)
    fresh = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, spec.name, fresh)
    spec.loader.exec_module(fresh)
    (tmp_path / "a").write_bytes(head)
    found = getattr(fresh, reader)()
    assert found.can_open(tmp_path / "a", head)
    with pytest.raises(InputError, match=rf"ballscrew\[{name}\]"):
        found.read_header(tmp_path / "a")
