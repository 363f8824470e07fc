"""Reading of a file in a process that ends with it: a crash, a hang or a bomb is one sentence."""

from __future__ import annotations

import atexit
import json
import os
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, cast

import numpy as np
from numpy.typing import NDArray

from ballscrew.base.errors import InputError, InterruptedReadError
from ballscrew.base.files import open_regular, regular_target
from ballscrew.recording.header import Header, RawChannel
from ballscrew.recording.readers import reader_for
from ballscrew.recording.readers.guard import check_size, refusing
from ballscrew.recording.readers.server import (
    HDF5,
    OTHER,
    UNCOMMON_UNIT,
    SessionEndError,
    identity,
    receive,
    send,
)

IN_PROCESS = "BALLSCREW_IN_PROCESS"
"""Environment variable; if it is not empty, files are read in this process, for debugging."""

_SECONDS, _SECONDS_PER_BYTE = 10.0, 2e-6  # of the processor
_MEMORY, _MEMORY_PER_BYTE = 2 << 30, 10
_CAN_FORK = hasattr(os, "fork") and hasattr(socket, "send_fds")
_HDF5_SIGNATURE = b"\x89HDF\r\n\x1a\n"
_PROGRAM = (
    "import json, sys; sys.path[:] = json.loads(sys.argv[1]);"
    "from ballscrew.recording.readers.server import main; main()"
)
_OUT_OF_TIME = {getattr(signal, name, -1) for name in ("SIGXCPU", "SIGALRM")}
_LATE = getattr(signal, "SIGXCPU", -1)
_CRASH_STATUS = 0xC0000000  # of a process on Windows, and above
_CONTROL_C = 0xC000013A  # the same, or its console was closed
_FROM_OUTSIDE = {0, signal.SIGTERM, signal.SIGINT, getattr(signal, "SIGKILL", -1)}  # 0: while it sent samples
_ENVIRONMENT = {  # few threads and arenas, each of which takes address space
    "OPENBLAS_NUM_THREADS": "1",
    "MALLOC_ARENA_MAX": "2",
    "ARROW_DEFAULT_MEMORY_POOL": "system",
}


@dataclass(frozen=True, slots=True)
class _Session:
    """Streams from and to a process that reads a file, and the signal that ended it: 0 if not known."""

    source: BinaryIO
    sink: BinaryIO
    ended_by: Callable[[], int] = lambda: 0


@dataclass(frozen=True, slots=True)
class OpenFile:
    """A file that is being read.

    Parameters
    ----------
    header : Header
        Its header.
    reader : str
        Name of its reader.
    read : callable
        Called with names of channels, gives their raw samples.
    """

    header: Header
    reader: str
    read: Callable[[Sequence[str]], dict[str, NDArray[Any]]]


@contextmanager
def opened(path: str | Path) -> Iterator[OpenFile]:
    """Read the header of a file, and then channels of it, in a process of its own.

    The process has limits of memory and time, cannot write, and on Linux can open no other file. It receives
    the target of a symbolic link, and follows no further one. Where
    processes cannot be forked (Windows), it has a limit of time only.

    Parameters
    ----------
    path : path-like
        The file.

    Yields
    ------
    OpenFile
        Until the end of the block.

    Raises
    ------
    InputError
        If the file cannot be read or changes meanwhile, or its reader crashes or exceeds a limit.
    InterruptedReadError
        If its reader was ended from outside.
    """
    path = regular_target(path)
    before = identity(path)
    if os.environ.get(IN_PROCESS):
        yield _open_here(path)
    else:
        with _in_process(path, before) as file:
            yield file
    if identity(path) != before:
        raise InputError(f"{path}: changed while it was read.")


def _open_here(path: Path) -> OpenFile:
    reader = reader_for(path)

    def read(names: Sequence[str]) -> dict[str, NDArray[Any]]:
        with refusing(path, reader.name):
            return reader.read(path, names)

    with refusing(path, reader.name):
        return OpenFile(reader.read_header(path), reader.name, read)


@contextmanager
def _in_process(path: Path, before: list[int]) -> Iterator[OpenFile]:
    seconds = _SECONDS + _SECONDS_PER_BYTE * before[2]
    request = {
        "path": str(path),
        "folder": str(Path.cwd()),
        "identity": before,
        "seconds": seconds,
        "memory": _MEMORY + _MEMORY_PER_BYTE * before[2],
    }
    with ExitStack() as stack:

        def begin(kind: bytes) -> _Session:
            try:
                return stack.enter_context(_session(kind, 6 * seconds + 30))
            except ConnectionError:
                raise _end_of_process(path, 0, seconds) from None

        def ask(message: dict[str, Any]) -> dict[str, Any]:
            try:
                send(session.sink, message)
                answer = receive(session.source)
            except (OSError, ValueError, SessionEndError):
                answer = {"signal": session.ended_by()}
            if "error" in answer:
                raise InputError(str(answer["error"]))
            if "signal" in answer:
                raise _end_of_process(path, int(answer["signal"]), seconds)
            return answer

        def read(names: Sequence[str]) -> dict[str, NDArray[Any]]:
            names = list(dict.fromkeys(names))
            described = ask({"names": names})["arrays"]
            try:
                return {each[0]: _array(session.source, path, *each) for each in described}
            except (OSError, ValueError, SessionEndError):
                raise _end_of_process(path, session.ended_by(), seconds) from None

        session = begin(_kind_of(path))
        answer = ask(request)
        if UNCOMMON_UNIT in answer:
            session = begin(OTHER)
            answer = ask(request)
        if "header" not in answer:
            raise _end_of_process(path, 0, seconds)
        yield OpenFile(_header(answer["header"]), str(answer["reader"]), read)


def _header(fields: dict[str, Any]) -> Header:
    return Header(**{**fields, "channels": tuple(RawChannel(**each) for each in fields["channels"])})


def _array(source: BinaryIO, path: Path, name: str, kind: str, shape: Sequence[int]) -> NDArray[Any]:
    """Samples of a channel, received at the place where they stay."""
    dtype = np.dtype(kind)
    if dtype.kind != "f":
        raise SessionEndError
    check_size(path, name, int(np.prod(shape, dtype=object)) * dtype.itemsize)
    values = np.empty(shape, dtype)
    content = values.reshape(-1).view(np.uint8).data
    at = 0
    while at < len(content):
        count = source.readinto(content[at:])  # type: ignore[attr-defined]
        if not count:
            raise SessionEndError
        at += count
    return values


def _end_of_process(path: Path, number: int, seconds: float) -> InputError:
    """Sentence for a reading process that ended without an answer."""
    if number == 0 and not _server_runs():
        return InterruptedReadError(f"{path}: cannot be read: the process that reads files ends at once.")
    if number in _OUT_OF_TIME:
        return InputError(f"{path}: cannot be read within {seconds:.0f} s; it is probably damaged.")
    if number in _FROM_OUTSIDE:
        return InterruptedReadError(f"{path}: cannot be read: its reader was ended from outside; try again.")
    return InputError(f"{path}: cannot be read: its reader crashes; it is probably damaged.")


def _start(descriptor: int, **options: Any) -> subprocess.Popen[bytes]:
    """Start a process with the modules of this one, but never with its script or what lies in its folder."""
    folders = json.dumps([folder for folder in sys.path if folder])
    command = [sys.executable, "-P", "-c", _PROGRAM, folders, str(descriptor)]
    try:
        return subprocess.Popen(  # noqa: S603  this Python
            command, stderr=subprocess.DEVNULL, env={**os.environ, **_ENVIRONMENT}, **options
        )
    except OSError as error:
        raise InputError(
            f"the process that reads files cannot be started ({error.strerror or error})."
        ) from None


def _kind_of(path: Path) -> bytes:
    if not _CAN_FORK:
        return OTHER
    with open_regular(path, links=False) as stream:
        return HDF5 if stream.read(len(_HDF5_SIGNATURE)) == _HDF5_SIGNATURE else OTHER


@contextmanager
def _session(kind: bytes, seconds: float) -> Iterator[_Session]:
    """Session with a process that reads one file, with the libraries for a kind."""
    if not _CAN_FORK:
        with _own_process(seconds) as session:
            yield session
        return
    with _connect(kind) as connection:
        connection.settimeout(seconds)
        with connection.makefile("rb") as source:
            sink = connection.makefile("wb")
            try:
                yield _Session(source, sink)
            finally:
                with suppress(OSError):  # what the other side can no longer receive
                    sink.close()


@contextmanager
def _own_process(seconds: float) -> Iterator[_Session]:
    """Session with a process that is started for one file."""
    late = threading.Event()

    def end() -> None:
        late.set()
        process.kill()

    def ended_by() -> int:
        with suppress(subprocess.TimeoutExpired):
            process.wait(0.5)  # the end of its streams comes before its own
        status = process.returncode or 0
        if late.is_set():
            return _LATE
        if status == _CONTROL_C:
            return signal.SIGINT
        if status >= _CRASH_STATUS:
            return signal.SIGSEGV
        return max(-status, 0)

    with _start(-1, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        timer = threading.Timer(seconds, end)
        timer.start()
        try:
            yield _Session(cast("BinaryIO", process.stdout), cast("BinaryIO", process.stdin), ended_by)
        finally:
            timer.cancel()
            process.kill()


class _Server:
    """The process that forks one process per file, and the socket to it."""

    def __init__(self) -> None:
        self.control, other = socket.socketpair()
        with other:
            self.process = _start(
                other.fileno(), pass_fds=[other.fileno()], stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL, start_new_session=True,
            )  # fmt: skip

    def connect(self, kind: bytes) -> socket.socket:
        connection, other = socket.socketpair()
        try:
            with other:
                socket.send_fds(self.control, [kind], [other.fileno()])
        except OSError:
            connection.close()
            raise
        return connection

    def stop(self) -> None:
        self.control.close()
        with suppress(OSError):
            os.killpg(self.process.pid, signal.SIGKILL)
        self.process.wait()


_servers: dict[int, _Server] = {}  # by process: a fork of this one must not use its server
_lock = threading.Lock()


def _connect(kind: bytes) -> socket.socket:
    with _lock:
        server = _servers.get(os.getpid())
        if server is not None and server.process.poll() is None:
            with suppress(OSError):
                return server.connect(kind)
        stop()
        server = _servers[os.getpid()] = _Server()
        return server.connect(kind)


def _server_runs() -> bool:
    server = _servers.get(os.getpid())
    if server is None:
        return True
    with suppress(subprocess.TimeoutExpired):
        server.process.wait(0.5)  # the end of its stream comes before its own
    return server.process.returncode is None


@atexit.register
def stop() -> None:
    """End the process that reads files; the next file starts it again."""
    server = _servers.pop(os.getpid(), None)
    if server is not None:
        server.stop()
