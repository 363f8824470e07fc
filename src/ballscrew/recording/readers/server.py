"""The process that reads recordings: it loads all readers, and forks a process of few rights per file.

A session with such a process: a request comes in, a header goes out; names of channels come in, their samples
go out. A message is JSON after its length in 8 bytes; samples follow as they are in memory.
"""

from __future__ import annotations

import json
import os
import selectors
import signal
import socket
import sys
from collections.abc import Sequence
from dataclasses import asdict
from functools import cache
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from ballscrew.base.errors import BallscrewError, InputError
from ballscrew.base.files import open_regular
from ballscrew.base.units import NoDefinitionsError, conversion_by_pint

HDF5, OTHER = b"h", b"o"
"""Kinds of file, sent with the socket of a session: HDF5 with common units needs the fewest libraries."""

UNCOMMON_UNIT = "uncommon unit"
"""Answer of a session for HDF5 that needs the definitions of pint: one for another kind has them."""

_LARGEST_MESSAGE = 1 << 28  # bytes
_CODECS = ("utf-8", "utf-16", "utf-32", "latin-1", "ascii", "unicode_escape", "idna", "cp437")


class SessionEndError(Exception):
    """The other process has ended or does not follow the protocol."""


def send(stream: BinaryIO, message: dict[str, Any]) -> None:
    """Write a message."""
    text = json.dumps(message).encode("ascii")
    stream.write(len(text).to_bytes(8, "little") + text)
    stream.flush()


def receive(stream: BinaryIO) -> dict[str, Any]:
    """Read a message; SessionEndError without one."""
    size = int.from_bytes(_exactly(stream, 8), "little")
    if size > _LARGEST_MESSAGE:
        raise SessionEndError
    message = json.loads(_exactly(stream, size))
    if not isinstance(message, dict):
        raise SessionEndError
    return message


def _exactly(stream: BinaryIO, size: int) -> bytes:
    content = stream.read(size)
    if len(content) != size:
        raise SessionEndError
    return content


def main() -> None:
    """Serve one session on standard input and output, or any number of them through a socket."""
    descriptor = int(sys.argv[2])
    if descriptor >= 0:
        _serve(socket.socket(fileno=descriptor))
        return
    _preload(OTHER)
    # A library that prints would otherwise write into the session.
    output = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    _session(sys.stdin.buffer, output)


def identity(path: Path) -> list[int]:
    """What changes when a file is replaced or written: device, number, size and time of its last change."""
    status = path.stat()
    return [status.st_dev, status.st_ino, status.st_size, status.st_mtime_ns]


@cache
def _preload(kind: bytes) -> None:
    """Import what reading needs, since a process that may open one file only cannot import."""
    import encodings
    import heapq  # noqa: F401  by Counter.most_common

    from ballscrew.recording.readers import hdf5, readers  # noqa: F401  hdf5 is the first that is asked

    for codec in _CODECS:
        encodings.search_function(codec)
    if kind == HDF5:
        return
    import pandas as pd

    readers()
    conversion_by_pint("Hz", "Hz")
    pd.read_csv(BytesIO(b"1\n"), encoding="latin-1")


def _serve(control: socket.socket) -> None:
    """Fork a process for every socket that comes in; report on its socket if it does not end well."""
    wake, woken = socket.socketpair()
    woken.setblocking(False)
    signal.set_wakeup_fd(woken.fileno(), warn_on_full_buffer=False)
    signal.signal(signal.SIGCHLD, lambda *_: None)
    sessions: dict[int, socket.socket] = {}
    selector = selectors.DefaultSelector()
    selector.register(control, selectors.EVENT_READ)
    selector.register(wake, selectors.EVENT_READ)
    while True:
        ready = [key.fileobj for key, _ in selector.select()]
        if wake in ready:
            wake.recv(4096)
            _reap(sessions)
        if control in ready:
            kind, descriptors, _, _ = socket.recv_fds(control, 1, 1)
            if not kind:
                return
            _preload(kind)
            session = socket.socket(fileno=descriptors[0])
            process = os.fork()
            if process == 0:
                for other in (control, wake, woken, *sessions.values()):
                    other.close()
                _run(session)
            sessions[process] = session


def _run(session: socket.socket) -> None:
    """Serve one session in a process of its own, and end it without the server's clean-up."""
    status = 1
    try:
        signal.set_wakeup_fd(-1)
        signal.signal(signal.SIGCHLD, signal.SIG_DFL)
        with session.makefile("rb") as source, session.makefile("wb") as sink:
            _session(source, sink)
        status = 0
    finally:
        os._exit(status)


def _reap(sessions: dict[int, socket.socket]) -> None:
    while sessions:
        process, status = os.waitpid(-1, os.WNOHANG)
        if process == 0:
            return
        with sessions.pop(process) as session:
            session.setblocking(False)
            if os.WIFSIGNALED(status):
                report = json.dumps({"signal": os.WTERMSIG(status)}).encode("ascii")
                try:
                    session.sendall(len(report).to_bytes(8, "little") + report)
                except OSError:  # the other side has gone or reads samples
                    continue


def _session(source: BinaryIO, sink: BinaryIO) -> None:
    try:
        _read_file(source, sink)
    except NoDefinitionsError:
        send(sink, {UNCOMMON_UNIT: True})
    except BallscrewError as error:
        send(sink, {"error": str(error)})
    except (OSError, SessionEndError):  # the other side has gone
        return


def _read_file(source: BinaryIO, sink: BinaryIO) -> None:
    from ballscrew.recording.readers import reader_for
    from ballscrew.recording.readers.guard import refusing
    from ballscrew.recording.readers.sandbox import allow_only, limit_resources

    request = receive(source)
    os.chdir(request["folder"])
    path = Path(request["path"])
    with open_regular(path, links=False) as stream:
        if identity(path) != request["identity"]:
            raise InputError(f"{path}: changed while it was read.")
        limit_resources(request["memory"], request["seconds"])
        allow_only(stream.fileno())
        reader = reader_for(path)
        with refusing(path, reader.name):
            header = reader.read_header(path)
            # Numbers of NumPy, which other packages may give, are none of JSON.
            message = json.dumps({"reader": reader.name, "header": asdict(header)}, default=_plain)
        send(sink, json.loads(message))
        names = receive(source)["names"]
        with refusing(path, reader.name):
            channels = reader.read(path, names)
            arrays = {name: _numbers(channels[name]) for name in names}
        _send_arrays(sink, arrays)


def _plain(value: Any) -> Any:
    return value.item()


def _numbers(values: Any) -> Any:
    """The samples; for what is no array of numbers, an array of no dimension, which is refused later."""
    if isinstance(values, np.ndarray) and values.dtype.kind == "f":
        return np.ascontiguousarray(values)
    return np.zeros(())


def _send_arrays(sink: BinaryIO, arrays: dict[str, Any]) -> None:
    described: Sequence[Any] = [[name, each.dtype.str, each.shape] for name, each in arrays.items()]
    send(sink, {"arrays": described})
    for each in arrays.values():
        sink.write(each.reshape(-1).view(np.uint8).data)
    sink.flush()
