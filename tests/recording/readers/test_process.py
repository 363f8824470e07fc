"""Files read in a process of their own: the same numbers, and one sentence for whatever happens to it."""

from __future__ import annotations

import ctypes
import io
import json
import os
import signal
import socket
import subprocess
import sys
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from tests.recording.readers.test_hostile import MAKERS

from ballscrew.base.errors import InputError, InterruptedReadError
from ballscrew.base.units import NoDefinitionsError
from ballscrew.recording.header import Header, RawChannel
from ballscrew.recording.readers import process, reader_for, sandbox, server
from ballscrew.recording.readers.server import SessionEndError

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


@pytest.mark.parametrize("fork", [pytest.param(True, marks=needs_fork), False])
def test_files_whose_reader_crashes_or_does_not_end(
    data: Path, monkeypatch: pytest.MonkeyPatch, fork: bool
) -> None:
    monkeypatch.setattr(process, "_CAN_FORK", fork)
    path = data / "hostile" / "hdf5-lzf-633.h5"
    with pytest.raises(InputError, match=r"hdf5-lzf-633\.h5: cannot be read"):
        read(path)
    monkeypatch.setattr(process, "_SECONDS", 0.05)
    for name in ("hdf5-contig-1454.h5", "netcdf4-761.nc"):
        with pytest.raises(InputError, match=f"{name}.*cannot be read within"):
            read(data / "hostile" / name)


READER_THAT_ENDS = """
import json, os, signal, sys, time; sys.path[:] = json.loads(sys.argv[1])
from ballscrew.recording.readers.npz import NpzReader
from ballscrew.recording.readers.server import main
NpzReader.read_header = lambda self, path: {end}
main()
"""


@pytest.mark.parametrize(
    ("end", "message"),
    [
        ("os.kill(os.getpid(), signal.SIGSEGV)", "its reader crashes"),
        ("os.kill(os.getpid(), signal.SIGTERM)", "ended from outside; try again"),
        ("os._exit(1)", "ended from outside; try again"),
        ("time.sleep(60)", "cannot be read within"),
    ],
)
def test_how_a_reader_ended_without_fork(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, end: str, message: str
) -> None:
    monkeypatch.setattr(process, "_CAN_FORK", False)
    monkeypatch.setattr(process, "_PROGRAM", READER_THAT_ENDS.format(end=end))
    if "sleep" in end:
        timer = process.threading.Timer
        monkeypatch.setattr(process.threading, "Timer", lambda _, end: timer(5.0, end))
    MAKERS["a.npz"](tmp_path / "a.npz")
    with pytest.raises(InputError, match=message):
        read(tmp_path / "a.npz")


@pytest.mark.parametrize(("status", "number"), [(0xC0000005, signal.SIGSEGV), (0xC000013A, signal.SIGINT)])
def test_status_of_a_crash_on_windows(monkeypatch: pytest.MonkeyPatch, status: int, number: int) -> None:
    class Crashed:
        returncode = status
        stdin = stdout = io.BytesIO()

        def __enter__(self) -> Crashed:
            return self

        def __exit__(self, *_: object) -> None: ...

        def wait(self, _: float) -> None: ...

        def kill(self) -> None: ...

    monkeypatch.setattr(process, "_start", lambda *_, **__: Crashed())
    with process._own_process(10.0) as session:
        assert session.ended_by() == number


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


def test_without_another_process_there_is_a_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object, **__: object) -> None:
        raise OSError(11, "Resource temporarily unavailable")

    process.stop()
    MAKERS["a.npz"](tmp_path / "a.npz")
    monkeypatch.setattr(subprocess, "Popen", fail)
    with pytest.raises(InputError, match=r"cannot be started \(Resource temporarily unavailable\)"):
        read(tmp_path / "a.npz")


@needs_fork
@pytest.mark.parametrize("answer", [{}, {"arrays": []}])
def test_an_answer_of_another_kind_is_no_header(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, answer: dict[str, Any]
) -> None:
    MAKERS["a.npz"](tmp_path / "a.npz")
    monkeypatch.setattr(process, "receive", lambda _: answer)
    with pytest.raises(InterruptedReadError, match="ended from outside; try again"):
        read(tmp_path / "a.npz")


@needs_fork
def test_samples_that_end_too_early_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    MAKERS["a.npz"](tmp_path / "a.npz")
    received = process._array
    monkeypatch.setattr(process, "_array", lambda _, *given: received(io.BytesIO(b"123"), *given))
    with pytest.raises(InterruptedReadError, match="ended from outside; try again"):
        read(tmp_path / "a.npz")


@pytest.mark.parametrize(
    ("kind", "content"), [("<f8", bytes(23)), ("<f8", b""), ("<i8", bytes(24)), ("|O", bytes(24))]
)
def test_only_whole_arrays_of_floats_are_received(kind: str, content: bytes) -> None:
    samples = np.array([1.5, -2.0, np.inf])
    source = io.BytesIO(samples.tobytes() + b"more")
    found = process._array(source, Path("a.h5"), "x", "<f8", [3])
    np.testing.assert_array_equal(found, samples)
    assert source.read() == b"more"
    with pytest.raises(SessionEndError):
        process._array(io.BytesIO(content), Path("a.h5"), "x", kind, [3])


def test_without_a_server_none_has_ended() -> None:
    process.stop()
    assert process._server_runs()


def message(document: object) -> bytes:
    content = json.dumps(document).encode()
    return len(content).to_bytes(8, "little") + content


@pytest.mark.parametrize(
    "content",
    [b"", bytes(7), message({"a": 1})[:-1], message([1]), message(3), (1 << 62).to_bytes(8, "little")],
)
def test_what_is_no_message_ends_the_session(content: bytes) -> None:
    assert server.receive(io.BytesIO(message({"a": 1}))) == {"a": 1}
    with pytest.raises(SessionEndError):
        server.receive(io.BytesIO(content))


@pytest.fixture
def unrestricted(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """A session in this process, which is not restricted; what it would have been restricted to."""
    limits: list[Any] = []
    monkeypatch.setattr(sandbox, "limit_resources", lambda *given: limits.append(given))
    monkeypatch.setattr(sandbox, "allow_only", lambda descriptor: limits.append(os.fstat(descriptor).st_size))
    monkeypatch.chdir(Path.cwd())
    return limits


def session(path: Path, names: list[str], **changes: Any) -> io.BytesIO:
    """What a session answers to a request and to the names of channels."""
    request = {"path": path.name, "folder": str(path.parent), "identity": server.identity(path)}
    request |= {"memory": 1 << 30, "seconds": 5.0} | changes
    sink = io.BytesIO()
    server._session(io.BytesIO(message(request) + message({"names": names})), sink)
    sink.seek(0)
    return sink


def test_a_session_sends_the_header_and_then_the_channels(tmp_path: Path, unrestricted: list[Any]) -> None:
    path = tmp_path / "a.npz"
    values = {"a": np.arange(40.0), "b": np.arange(20, dtype=np.float32)}
    np.savez(path, **values, fs=1000)
    sink = session(path, ["b", "a"])
    assert unrestricted == [(1 << 30, 5.0), path.stat().st_size]
    found = server.receive(sink)
    assert (found["reader"], found["header"]["sample_rate"]) == ("npz", 1000.0)
    arrays = server.receive(sink)["arrays"]
    assert arrays == [["b", "<f4", [20]], ["a", "<f8", [40]]]
    for name, kind, shape in arrays:
        np.testing.assert_array_equal(process._array(sink, path, name, kind, shape), values[name])
    assert sink.read() == b""


@pytest.mark.usefixtures("unrestricted")
def test_a_session_answers_with_a_sentence_or_asks_for_a_process_with_uncommon_units(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.npz"
    np.savez(path, a=np.arange(40.0))
    answer = server.receive(session(path, [], identity=[0, 0, 0, 0]))
    assert answer == {"error": "a.npz: changed while it was read."}
    sink = session(path, ["none"])
    assert "header" in server.receive(sink)
    assert "has no channel 'none'" in server.receive(sink)["error"]

    def fail(*_: object) -> None:
        raise NoDefinitionsError("the unit needs pint")

    monkeypatch.setattr("ballscrew.recording.readers.npz.NpzReader.read_header", fail)
    assert server.receive(session(path, [])) == {server.UNCOMMON_UNIT: True}
    sink = io.BytesIO()
    server._session(io.BytesIO(b""), sink)  # the other side has gone
    assert sink.getvalue() == b""


@pytest.mark.usefixtures("unrestricted")
def test_what_a_reader_of_another_package_gives_is_sent_as_it_can_be(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Numbers of NumPy in a header; for what is no array of floats, an array without a sample."""
    path = tmp_path / "a.npz"
    np.savez(path, a=np.arange(40.0))
    header = Header((RawChannel("a", 3), RawChannel("b", 3)), np.float32(500.0), reader="acme")
    given = {"a": np.arange(6.0)[::2], "b": [1, 2, 3]}
    monkeypatch.setattr("ballscrew.recording.readers.npz.NpzReader.read_header", lambda *_: header)
    monkeypatch.setattr("ballscrew.recording.readers.npz.NpzReader.read", lambda *_: given)
    sink = session(path, ["a", "b"])
    assert server.receive(sink)["header"]["sample_rate"] == 500.0
    assert server.receive(sink)["arrays"] == [["a", "<f8", [3]], ["b", "<f8", []]]
    np.testing.assert_array_equal(process._array(sink, path, "a", "<f8", [3]), [0.0, 2.0, 4.0])


@needs_fork
def test_the_signal_that_ended_a_reader_is_reported_on_its_socket(monkeypatch: pytest.MonkeyPatch) -> None:
    """One that is closed does not prevent it."""
    ended = {5: signal.SIGSEGV, 6: 0, 8: signal.SIGSEGV}
    pairs = {number: socket.socketpair() for number in (5, 6, 7, 8)}
    pairs[8][0].close()
    sessions = {number: theirs for number, (_, theirs) in pairs.items()}
    monkeypatch.setattr(os, "waitpid", lambda *_: ended.popitem() if ended else (0, 0))
    server._reap(sessions)
    assert list(sessions) == [7]
    for number, expected in ((5, message({"signal": int(signal.SIGSEGV)})), (6, b"")):
        with pairs[number][0] as ours:
            ours.settimeout(60)
            assert ours.makefile("rb").read() == expected
    for each in pairs[7]:
        each.close()
