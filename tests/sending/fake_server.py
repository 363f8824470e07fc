"""A server that follows the contract, in a thread, and fails when it is asked to."""

from __future__ import annotations

import hashlib
import json
import re
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any
from urllib.parse import unquote

_PATH = re.compile(r"/api/v1/axes/([^/]+)/runs/([^/]+)/(?:files/([0-9a-f]{64})|complete)")


@dataclass
class Fault:
    """What happens to a request: a status, or ``cut``, ``lost``, ``slow``, ``offset``, ``proxy``.

    cut: the connection ends in the middle of the body. lost: all is done, and the answer is not sent.
    The status of a proxy is without the header of the server.
    """

    method: str
    kind: str | int
    headers: dict[str, str] = field(default_factory=dict)
    detail: str = "as asked"
    times: int = 1
    of_proxy: bool = False


@dataclass
class FakeServer:
    """Content of the server."""

    axes: set[str] = field(default_factory=lambda: {"X axis"})
    token: str | None = None
    files: dict[str, bytes] = field(default_factory=dict)
    parts: dict[str, bytes] = field(default_factory=dict)
    runs: dict[tuple[str, str], dict[str, Any]] = field(default_factory=dict)
    faults: list[Fault] = field(default_factory=list)
    log: list[str] = field(default_factory=list)
    received: int = 0
    address: str = ""
    doubt: str | None = None
    release: threading.Event = field(default_factory=threading.Event)

    def fault(self, method: str) -> Fault | None:
        for fault in self.faults:
            if fault.method in (method, "*") and fault.times > 0:
                fault.times -= 1
                return fault
        return None


class _Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    fake: FakeServer

    def log_message(self, *_: object) -> None:
        pass

    def do_HEAD(self) -> None:
        self.handle_request()

    def do_PUT(self) -> None:
        self.handle_request()

    def do_POST(self) -> None:
        self.handle_request()

    def handle_request(self) -> None:
        fake = self.fake
        fake.log.append(self.command)
        fault = fake.fault(self.command)
        kind = fault.kind if fault else ""
        if kind == "slow":
            fake.release.wait(10)
        if kind in ("slow", "away") or (kind == "cut" and self.command != "PUT"):
            self.drop()
            return
        body = self.body(half=kind == "cut")
        if fault and isinstance(kind, int):
            self.answer(kind, {"detail": fault.detail}, fault.headers, of_proxy=fault.of_proxy)
        elif fault and kind == "proxy":
            self.answer(200, fault.detail, of_proxy=True)
        elif kind == "offset" and fault:
            self.answer(200, None, fault.headers)
        elif fake.token is not None and self.headers["Authorization"] != f"Bearer {fake.token}":
            self.answer(401, {"detail": "no token"})
        else:
            self.route(body, kind)

    def body(self, *, half: bool) -> bytes:
        size = int(self.headers["Content-Length"] or 0)
        return self.rfile.read(size // 2 if half else size)

    def route(self, body: bytes, kind: str | int) -> None:
        match = _PATH.fullmatch(self.path)
        assert match, self.path
        axis, run, sha256 = unquote(match[1]), unquote(match[2]), match[3]
        if axis not in self.fake.axes:
            self.answer(404, {"detail": f"there is no axis {axis!r}"})
        elif sha256 is None:
            self.complete(axis, run, json.loads(body), kind)
        elif self.command == "HEAD":
            self.head(sha256)
        else:
            self.put(sha256, body, kind)

    def head(self, sha256: str) -> None:
        fake = self.fake
        if sha256 in fake.files:
            size = len(fake.files[sha256])
            self.answer(200, None, {"Upload-Offset": str(size), "Upload-Complete": "?1"})
        elif sha256 in fake.parts:
            self.answer(200, None, {"Upload-Offset": str(len(fake.parts[sha256])), "Upload-Complete": "?0"})
        else:
            self.answer(204, None)

    def put(self, sha256: str, body: bytes, kind: str | int) -> None:
        fake = self.fake
        fake.received += len(body)
        start, total = 0, int(self.headers["Content-Length"])
        if self.headers["Content-Range"]:
            match = re.fullmatch(r"bytes (\d+)-(\d+)/(\d+)", self.headers["Content-Range"])
            assert match
            start, total = int(match[1]), int(match[3])
        there = fake.parts.get(sha256, b"")
        if start and start != len(there):
            self.answer(409, {"detail": "offset"}, {"Upload-Offset": str(len(there))})
            return
        content = there[:start] + body
        if kind == "cut":
            fake.parts[sha256] = content
            self.drop()
        elif len(content) < total:
            fake.parts[sha256] = content
            self.answer(202, None, {"Upload-Offset": str(len(content))})
        elif hashlib.sha256(content).hexdigest() != sha256:
            fake.parts.pop(sha256, None)
            self.answer(422, {"detail": "the content has another hash"})
        else:
            fake.parts.pop(sha256, None)
            fake.files[sha256] = content
            self.finish(201, None, kind)

    def complete(self, axis: str, run: str, document: dict[str, Any], kind: str | int) -> None:
        fake = self.fake
        needed = [file["sha256"] for file in document["files"]]
        if document["run_json"]:
            needed.append(document["run_json"])
        if any(sha256 not in fake.files for sha256 in needed):
            self.answer(422, {"detail": "a file is missing"})
            return
        known = fake.runs.get((axis, run))
        answer = {"run": run, "id": "f" * 64, "status": "queued", "doubt": fake.doubt}
        if known is None:
            fake.runs[axis, run] = document
            self.finish(202, answer, kind)
        elif known["files"] == document["files"]:
            self.finish(200, answer, kind)
        else:
            self.answer(409, {"detail": "another content has this key"})

    def finish(self, status: int, document: Any, kind: str | int) -> None:
        if kind == "lost":
            self.drop()
        else:
            self.answer(status, document)

    def drop(self) -> None:
        self.close_connection = True
        self.connection.shutdown(socket.SHUT_RDWR)

    def answer(
        self, status: int, document: Any, headers: dict[str, str] | None = None, *, of_proxy: bool = False
    ) -> None:
        content = b""
        if document is not None:
            content = (document if isinstance(document, str) else json.dumps(document)).encode()
        self.send_response(status)
        if not of_proxy:
            self.send_header("Ballscrew-API", "1")
        for name, value in (headers or {}).items():
            self.send_header(name, value)
        self.send_header("Content-Length", str(len(content)))
        self.end_headers()
        if self.command != "HEAD":
            self.wfile.write(content)


class _Threads(ThreadingHTTPServer):
    daemon_threads = True

    def handle_error(self, *_: object) -> None:
        pass  # a connection that the sender has cut


@contextmanager
def fake_server() -> Iterator[FakeServer]:
    fake = FakeServer()
    handler = type("Handler", (_Handler,), {"fake": fake})
    with _Threads(("127.0.0.1", 0), handler) as server:
        fake.address = f"http://127.0.0.1:{server.server_address[1]}"
        thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01})
        thread.start()
        try:
            yield fake
        finally:
            fake.release.set()
            server.shutdown()
            thread.join()
