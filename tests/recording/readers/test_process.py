"""Files read in a process of their own: the same numbers, and one sentence for whatever happens to it."""

from __future__ import annotations

import ctypes
import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from tests.recording.readers.test_hostile import MAKERS

from ballscrew.base.errors import InputError, InterruptedReadError
from ballscrew.recording.readers import process, reader_for

needs_fork = pytest.mark.skipif(not process._CAN_FORK, reason="processes cannot be forked here")


@pytest.fixture(autouse=True)
def _own_process(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(process.IN_PROCESS)


def read(path: Path) -> tuple[Any, dict[str, Any]]:
    with process.opened(path) as file:
        return file.header, file.read([channel.name for channel in file.header.channels])


def assert_same(path: Path) -> None:
    reader = reader_for(path)
    header, values = read(path)
    assert header == reader.read_header(path)
    for name, expected in reader.read(path, list(values)).items():
        assert values[name].dtype == expected.dtype
        assert values[name].tobytes() == expected.tobytes()


@pytest.mark.parametrize("name", sorted(MAKERS))
def test_the_same_numbers_of_every_format(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    path = Path(f"relative-{name}")
    MAKERS[name](path)
    assert_same(path)


@pytest.mark.parametrize("codec", ["utf-8-sig", "utf-16", "utf-32", "latin-1"])
def test_every_encoding_of_text(tmp_path: Path, codec: str) -> None:
    path = tmp_path / "a.csv"
    lines = [f"{number},5;2" for number in range(100)]
    lines[50] = "# µ"
    path.write_text("\n".join(["Weg [µm];Strom", *lines, ""]), encoding=codec)
    assert_same(path)


@pytest.mark.parametrize(("kind", "names"), [("HDF5", ["a.h5"]), ("OTHER", sorted(MAKERS))])
def test_reading_imports_nothing_that_is_not_loaded_before(
    kind: str, names: list[str], tmp_path: Path
) -> None:
    for name in names:
        MAKERS[name](tmp_path / name)
    program = (
        "import sys; from pathlib import Path; from ballscrew.recording.readers import reader_for, server\n"
        f"server._preload(server.{kind}); loaded = set(sys.modules)\n"
        f"assert ('pint' in loaded) == (server.{kind} == server.OTHER)\n"
        "for path in Path(sys.argv[1]).iterdir():\n"
        "    reader = reader_for(path)\n"
        "    reader.read(path, [channel.name for channel in reader.read_header(path).channels])\n"
        "print(sorted(set(sys.modules) - loaded))"
    )
    done = subprocess.run(  # noqa: S603
        [sys.executable, "-c", program, str(tmp_path)],
        capture_output=True,
        text=True,
        check=True,
        timeout=600,
    )
    assert done.stdout == "[]\n"


def test_an_uncommon_unit_in_an_hdf5_file(tmp_path: Path) -> None:
    process.stop()  # a new server has not loaded the definitions for another file
    path = tmp_path / "a.h5"
    with h5py.File(path, "w") as file:
        file.create_dataset("x", data=np.zeros(100))
        file.attrs["sample_rate"] = "25.6 kilohertz"
    header, values = read(path)
    assert header.sample_rate == pytest.approx(25600)
    assert len(values["x"]) == 100


def test_without_fork(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(process, "_CAN_FORK", False)
    MAKERS["a.npz"](tmp_path / "a.npz")
    assert_same(tmp_path / "a.npz")


@needs_fork
def test_files_whose_reader_crashes_or_does_not_end(data: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = data / "hostile" / "hdf5-lzf-633.h5"
    with pytest.raises(InputError, match=r"hdf5-lzf-633\.h5: cannot be read"):
        read(path)
    monkeypatch.setattr(process, "_SECONDS", 0.05)
    for name in ("hdf5-contig-1454.h5", "netcdf4-761.nc"):
        with pytest.raises(InputError, match=f"{name}.*cannot be read within"):
            read(data / "hostile" / name)


@needs_fork
def test_a_reader_that_is_killed_says_nothing_about_its_file(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    MAKERS["a.npz"](path)
    with process.opened(path) as file:
        server = process._servers[os.getpid()].process.pid
        (reader,) = Path(f"/proc/{server}/task/{server}/children").read_text().split()
        os.kill(int(reader), signal.SIGKILL)
        with pytest.raises(InterruptedReadError, match="ended from outside; try again"):
            file.read([file.header.channels[0].name])
    assert_same(path)


@needs_fork
def test_a_file_that_needs_too_much_memory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a.h5"
    with h5py.File(path, "w") as file:
        file.create_dataset("x", data=np.zeros(2 * 10**7), chunks=(10**6,), compression="gzip")
    assert read(path)[1]["x"].size == 2 * 10**7
    monkeypatch.setattr(process, "_MEMORY", 10 << 20)
    with pytest.raises(InputError, match=r"memory|cannot be read"):
        read(path)


@needs_fork
def test_the_server_is_started_again(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    MAKERS["a.npz"](path)
    read(path)
    server = process._servers[os.getpid()]
    server.process.kill()
    server.process.wait()
    assert_same(path)
    process.stop()
    assert os.getpid() not in process._servers


@needs_fork
@pytest.mark.parametrize("ended_before", [False, True])
def test_a_server_that_cannot_start_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, ended_before: bool
) -> None:
    process.stop()
    start = process._start

    def start_and_wait(*arguments: Any, **options: Any) -> Any:
        server = start(*arguments, **options)
        server.wait()
        return server

    monkeypatch.setattr(process, "_PROGRAM", "raise SystemExit(3)")
    if ended_before:
        monkeypatch.setattr(process, "_start", start_and_wait)
    MAKERS["a.npz"](tmp_path / "a.npz")
    with pytest.raises(InputError, match="the process that reads files ends at once"):
        read(tmp_path / "a.npz")
    process.stop()


CURIOUS = """
import json, sys; sys.path[:] = json.loads(sys.argv[1])
from ballscrew.recording.readers.npz import NpzReader
from ballscrew.recording.readers.server import main
NpzReader.read_header = lambda self, path: open(path.with_name("secret")).read()
main()
"""


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="Landlock is a part of Linux")
def test_a_reader_that_opens_another_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    process.stop()
    monkeypatch.setattr(process, "_PROGRAM", CURIOUS)
    MAKERS["a.npz"](tmp_path / "a.npz")
    (tmp_path / "secret").write_text("42", encoding="ascii")
    with pytest.raises(InputError) as error:
        read(tmp_path / "a.npz")
    process.stop()
    if ctypes.CDLL(None).syscall(444, None, 0, 1) < 1:
        pytest.skip("this kernel has no Landlock")
    assert "Permission denied" in str(error.value)


@pytest.mark.parametrize("in_process", ["", "1"])
def test_a_file_that_changes_while_it_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, in_process: str
) -> None:
    monkeypatch.setenv(process.IN_PROCESS, in_process)
    path = tmp_path / "a.csv"
    MAKERS["a.csv"](path)

    def read_and_write() -> None:
        with process.opened(path) as file, path.open("a") as more:
            more.write(f"{len(file.header.channels)}\n")

    with pytest.raises(InputError, match="changed while it was read"):
        read_and_write()


RESTRICTED = """
import sys
from pathlib import Path
from ballscrew.recording.readers.sandbox import allow_only, limit_resources
given, other = Path(sys.argv[1]), Path(sys.argv[2])
with given.open("rb") as stream:
    limit_resources(1 << 30, 5.0)
    if not allow_only(stream.fileno()):
        sys.exit("no Landlock")
assert given.read_bytes() == b"given"
folder = other.parent
for attempt in (other.read_bytes, lambda: given.open("ab"), lambda: list(folder.iterdir()), other.unlink):
    try:
        attempt()
    except PermissionError:
        continue
    sys.exit("was allowed")
"""


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="Landlock is a part of Linux")
def test_no_other_file_can_be_read_or_written(tmp_path: Path) -> None:
    (tmp_path / "given").write_bytes(b"given")
    (tmp_path / "other").write_bytes(b"secret")
    command = [sys.executable, "-c", RESTRICTED, str(tmp_path / "given"), str(tmp_path / "other")]
    done = subprocess.run(command, capture_output=True, text=True, check=False)  # noqa: S603  this Python
    if done.stderr.strip() == "no Landlock":
        pytest.skip("this kernel has no Landlock")
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize("in_process", ["", "1"])
def test_a_link_to_a_recording_is_followed_and_one_in_a_circle_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, in_process: str
) -> None:
    monkeypatch.setenv(process.IN_PROCESS, in_process)
    MAKERS["a.npz"](tmp_path / "a.npz")
    try:
        (tmp_path / "link").symlink_to("a.npz")
        (tmp_path / "second").symlink_to(tmp_path / "link")
        (tmp_path / "circle").symlink_to("circle")
        (tmp_path / "device").symlink_to("/dev/zero")
        (tmp_path / "nowhere").symlink_to("nothing")
    except OSError:
        pytest.skip("links cannot be made here")
    np.testing.assert_array_equal(
        read(tmp_path / "second")[1]["torque"], read(tmp_path / "a.npz")[1]["torque"]
    )
    for name in ("circle", "device", "nowhere"):
        with pytest.raises(InputError, match=r"is a link that leads to no file|cannot be read"):
            read(tmp_path / name)
