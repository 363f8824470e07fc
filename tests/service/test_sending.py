"""``ballscrew send`` and the service together, over a socket: once, again, after a cut, and refused."""

from __future__ import annotations

import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from urllib.parse import urlsplit

import httpx
import pytest
import uvicorn
from fastapi import FastAPI
from tests.service.conftest import SETUP, NewService, client_of, sha256, wait_for, work_off
from tests.store.stored import count, imitate_analysis, write_recordings

from ballscrew.sending.outgoing import RunRule
from ballscrew.sending.sender import SendHooks, SendResult, send
from ballscrew.sending.settings import SendSettings
from ballscrew.service.app import create_app
from ballscrew.service.jobs import Lease
from ballscrew.service.serving import Service
from ballscrew.service.tokens import create_token, revoke_token
from ballscrew.service.working import do_task, task_of
from ballscrew.store.showing import show_axis, show_run
from ballscrew.store.store import Store
from ballscrew.store.tables import RawFile, RunRow


@dataclass
class Plant:
    """A service that listens, and a sender with the token of its machine."""

    service: Service
    app: FastAPI
    address: str
    settings: SendSettings
    token: Path

    def send(self, *files: Path, run: str | None = None) -> SendResult:
        hooks = SendHooks(lambda _: None, lambda _: None, sleep=lambda _: None)
        return send(files, self.address, run=run, settings=self.settings, hooks=hooks)

    def analyse(self) -> None:
        """Do all jobs in this process."""

        def outcome(lease: Lease) -> tuple[str, object]:
            return do_task(task_of(self.service, lease))  # type: ignore[arg-type]

        work_off(self.service, outcome)


@contextmanager
def listening(service: Service, app: FastAPI) -> Iterator[str]:
    """The address at which an application answers, in a thread."""
    server = uvicorn.Server(uvicorn.Config(app, log_level="warning", access_log=False))
    with socket.create_server(("127.0.0.1", 0)) as listener:
        thread = threading.Thread(target=server.run, kwargs={"sockets": [listener]})
        thread.start()
        try:
            yield f"http://127.0.0.1:{listener.getsockname()[1]}"
        finally:
            service.stopping.set()
            server.should_exit = True
            thread.join()


@pytest.fixture
def plant(new_service: NewService, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Plant]:
    for name in ("BALLSCREW_TOKEN", "HTTP_PROXY", "ALL_PROXY", "http_proxy", "all_proxy"):
        monkeypatch.delenv(name, raising=False)
    imitate_analysis(monkeypatch)
    service = new_service(host="0.0.0.0", allow_plain_http=True)  # noqa: S104  so that tokens are needed
    _, admin = create_token(service.store, None, role="admin")
    with client_of(service, headers={"Authorization": f"Bearer {admin}"}) as client:
        assert client.put("/api/v1/axes/bench", json=SETUP).status_code == 200
    token = tmp_path / "token.txt"
    token.write_text(create_token(service.store, "mill 4")[1])
    settings = SendSettings(spool=tmp_path / "spool", token_file=token, tries=3)
    app = create_app(service)
    with listening(service, app) as address:
        yield Plant(service, app, address, settings, token)


@pytest.fixture
def run_toml(tmp_path: Path) -> Path:
    return new_run(tmp_path / "run", 1.0)


def new_run(folder: Path, day: float, content: bytes = b"trip ") -> Path:
    """RUN.toml that names the data sheet of the axis, and its recordings."""
    path = write_recordings(folder, day, content)
    (folder / "axis.toml").write_text(SETUP["sheet"])
    path.write_text(path.read_text() + 'axis = "axis.toml"\n')
    return path


def recordings(path: Path) -> list[Path]:
    return sorted(path.parent.glob("*.bin"))


def test_a_run_is_sent_analysed_and_known_when_it_is_sent_again(plant: Plant, run_toml: Path) -> None:
    first = plant.send(run_toml)
    (answer,) = first.sent
    assert (answer.axis, answer.status, answer.new, first.waiting) == ("bench", "queued", True, 0)
    plant.analyse()
    (again,) = plant.send(run_toml).sent
    assert (again.id, again.run, again.status, again.new) == (answer.id, answer.run, "done", False)
    assert (count(plant.service.store, RunRow), count(plant.service.store, RawFile)) == (1, 2)
    assert Store.verify(plant.service.store.path).faults == ()


def test_an_incomplete_run_and_its_late_trip_are_one_run_that_counts(plant: Plant, tmp_path: Path) -> None:
    rule = RunRule(axis="bench", pattern="{run}_trip{trip}.bin", trips=3, incomplete=True)
    folder = tmp_path / "night"
    folder.mkdir()
    for trip in (1, 2, 3):
        (folder / f"night_trip{trip}.bin").write_bytes(b"trip %d" % trip * 1000)
        if trip > 1:
            assert send([folder], plant.address, rule=rule, settings=plant.settings).sent[0].new
    plant.analyse()
    store = plant.service.store
    axis = show_axis(store, "bench")
    trips = {len(show_run(store, run["run"])["recordings"]): run["counts"] for run in axis["runs"]}
    assert trips == {2: False, 3: True}
    assert (axis["shared_recordings"], axis["exclusions"][0]["actor"]) == ([], "token 2")


def test_other_content_under_a_key_is_refused_and_the_first_stays(
    plant: Plant, run_toml: Path, tmp_path: Path
) -> None:
    (answer,) = plant.send(run_toml, run="night-1").sent
    result = plant.send(new_run(tmp_path / "other", 2.0), run="night-1")
    assert (result.sent, result.waiting) == ((), 0)
    assert "409 the run 'night-1' has other content, which stays" in result.rejected[0]
    plant.analyse()
    assert plant.send(run_toml, run="night-1").sent[0].id == answer.id
    assert count(plant.service.store, RunRow) == 1


def test_a_file_that_was_cut_is_resumed(
    plant: Plant, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = new_run(tmp_path / "large", 1.0, bytes(range(256)) * 16)  # 4 MB each
    first, _ = recordings(path)
    content = first.read_bytes()
    cut_off(plant, f"/api/v1/axes/bench/runs/r/files/{sha256(content)}", content, len(content) // 2)
    partial = plant.service.partial / sha256(content)
    wait_for(lambda: partial.is_file() and not plant.app.state.receiving)
    there = partial.stat().st_size
    assert 0 < there <= len(content) // 2
    ranges = []
    request = httpx.Client.request

    def recorded(self: httpx.Client, method: str, url: str, **options: dict[str, str]) -> httpx.Response:
        ranges.append(options.get("headers", {}).get("Content-Range"))
        return request(self, method, url, **options)  # type: ignore[arg-type]

    with monkeypatch.context() as patched:
        patched.setattr(httpx.Client, "request", recorded)
        assert len(plant.send(path).sent) == 1
    assert [each for each in ranges if each] == [f"bytes {there}-{len(content) - 1}/{len(content)}"]
    assert Store.verify(plant.service.store.path).faults == ()


def cut_off(plant: Plant, path: str, content: bytes, stop: int) -> None:
    """Send the beginning of a file, and close the connection."""
    head = (
        f"PUT {path} HTTP/1.1\r\nHost: localhost\r\nAuthorization: Bearer {plant.token.read_text()}\r\n"
        f"Content-Length: {len(content)}\r\n\r\n"
    )
    host, port = urlsplit(plant.address).netloc.split(":")
    with socket.create_connection((host, int(port))) as connection:
        connection.sendall(head.encode() + content[:stop])
        with suppress(OSError):
            connection.shutdown(socket.SHUT_WR)


@pytest.mark.parametrize("kind", ["unknown", "none", "revoked", "of another machine"])
def test_a_run_with_a_wrong_token_waits_in_the_spool(plant: Plant, run_toml: Path, kind: str) -> None:
    right = plant.token.read_text()
    settings = plant.settings
    store = plant.service.store
    if kind == "unknown":
        plant.token.write_text("bs_unknown")
    elif kind == "none":
        plant.settings = replace(settings, token_file=None)
    elif kind == "revoked":
        number, text = create_token(store, "mill 4")
        plant.token.write_text(text)
        revoke_token(store, number)
    else:
        other = SETUP | {"machine": "mill 5", "sheet": SETUP["sheet"].replace('"bench"', '"Y axis"')}
        local = Service(store, plant.service.settings.model_copy(update={"host": "127.0.0.1"}))
        with client_of(local) as client:
            assert client.put("/api/v1/axes/Y axis", json=other).status_code == 200
        plant.token.write_text(create_token(store, "mill 5")[1])
    result = plant.send(run_toml)
    assert (result.sent, result.rejected, result.waiting) == ((), (), 1)
    assert "'ballscrew token list' at the server" in result.reason
    assert count(store, RawFile) == 0
    plant.settings = settings
    plant.token.write_text(right)
    assert len(plant.send().sent) == 1
