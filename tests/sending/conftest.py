"""Runs on disk, a server, and a time that passes only when it is waited for."""

from __future__ import annotations

import ssl
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import pytest
from tests.sending.fake_server import FakeServer, fake_server

from ballscrew.sending.sender import SendHooks, SendResult, send
from ballscrew.sending.server import Answer
from ballscrew.sending.settings import SendSettings

CONTEXT = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
AXIS = 'name = "X axis"\n'
RUN = 'axis = "axis.toml"\nchannels = "channels.toml"\nmeasured_at = 2026-01-31T08:00:00Z\n'


class StopError(Exception):
    """Ends a watch."""


@dataclass
class Scene:
    """A sender's hooks with their own time."""

    answers: list[Answer] = field(default_factory=list)
    sentences: list[str] = field(default_factory=list)
    waits: list[float] = field(default_factory=list)
    time: float = 0.0
    actions: dict[int, Callable[[], object]] = field(default_factory=dict)
    most: int = 1000

    def sleep(self, seconds: float) -> None:
        self.waits.append(seconds)
        self.time += seconds
        action = self.actions.get(len(self.waits))
        if action:
            action()
        if len(self.waits) >= self.most:
            raise StopError

    def clock(self) -> float:
        return self.time

    @property
    def hooks(self) -> SendHooks:
        return SendHooks(
            self.answers.append,
            self.sentences.append,
            clock=self.clock,
            sleep=self.sleep,
            random=lambda: 1.0,
        )


def write_run(folder: Path, contents: Sequence[bytes] = (b"one" * 1000, b"two" * 1000)) -> Path:
    """RUN.toml in a folder, with its recordings."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "axis.toml").write_text(AXIS)
    names = []
    for number, content in enumerate(contents, 1):
        (folder / f"trip{number}.h5").write_bytes(content)
        names.append(f'"trip{number}.h5"')
    (folder / "run.toml").write_text(f"{RUN}files = [{', '.join(names)}]\n")
    return folder / "run.toml"


@pytest.fixture
def server() -> Iterator[FakeServer]:
    with fake_server() as fake:
        yield fake


@pytest.fixture
def scene() -> Scene:
    return Scene()


@pytest.fixture(autouse=True)
def _no_surroundings(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("BALLSCREW_TOKEN", "HTTP_PROXY", "HTTPS_PROXY", "ALL_PROXY", "http_proxy", "all_proxy"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(ssl, "create_default_context", lambda **_: CONTEXT)  # reads certificates for 30 ms


@pytest.fixture
def settings(tmp_path: Path) -> SendSettings:
    return SendSettings(spool=tmp_path / "spool")


@pytest.fixture
def run_toml(tmp_path: Path) -> Path:
    return write_run(tmp_path / "run")


@pytest.fixture
def send_files(server: FakeServer, settings: SendSettings, scene: Scene) -> Callable[..., SendResult]:
    """Send files to the server."""

    def call(*files: Path, **options: object) -> SendResult:
        options = {"settings": settings, "hooks": scene.hooks} | options
        return send(files, server.address, **options)

    return call
