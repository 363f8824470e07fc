"""Outbound heartbeat: sent while runs are received, silent otherwise, and its address is never in the log."""

from __future__ import annotations

import logging
import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, HTTPServer
from types import SimpleNamespace
from typing import Any

import pytest
from tests.service.conftest import NewService, client_of

from ballscrew.service import health
from ballscrew.service.health import beat, beat_regularly
from ballscrew.service.serving import Service
from ballscrew.service.settings import ServerSettings

READY: Any = [SimpleNamespace(is_ready=True)]


class Sink(BaseHTTPRequestHandler):
    """Counts calls, and answers with a status."""

    status, calls = 200, 0

    def do_GET(self) -> None:
        type(self).calls += 1
        self.send_response(self.status)
        self.end_headers()

    def log_message(self, *_: Any) -> None:
        return


@pytest.fixture
def address() -> Iterator[str]:
    Sink.status, Sink.calls = 200, 0
    server = HTTPServer(("127.0.0.1", 0), Sink)
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    yield f"http://127.0.0.1:{server.server_port}/s3cret"
    server.shutdown()
    server.server_close()
    thread.join()


def test_it_is_sent_while_runs_are_received(new_service: NewService, address: str) -> None:
    service = new_service(heartbeat_url=address)
    beat(service, READY)
    assert (Sink.calls, service.heartbeats) == (1, {"sent": 1})
    with client_of(service) as client:
        text = client.get("/metrics").text
    assert 'ballscrew_heartbeats_total{result="sent"} 1' in text
    assert 'ballscrew_heartbeats_total{result="failed"} 0' in text


@pytest.mark.parametrize("fault", ["no worker", "refused", "redirect", "error"])
def test_a_failure_is_counted_and_logged_without_the_address(
    new_service: NewService, address: str, caplog: pytest.LogCaptureFixture, fault: str
) -> None:
    workers, calls = READY, 1
    if fault == "no worker":
        workers, calls = [], 0
    if fault == "refused":
        address, calls = "http://127.0.0.1:9/s3cret", 0
    Sink.status = {"redirect": 302, "error": 500}.get(fault, 200)
    service = new_service(heartbeat_url=address)
    with caplog.at_level(logging.WARNING, "ballscrew.service"):
        beat(service, workers)
    assert (Sink.calls, service.heartbeats) == (calls, {"failed": 1})
    assert "no heartbeat" in caplog.text
    assert "s3cret" not in caplog.text


def test_without_an_address_there_is_none_and_a_stop_ends_it(new_service: NewService, address: str) -> None:
    beat_regularly(new_service(), READY)
    service = new_service(heartbeat_url=address)
    service.stopping.set()
    beat_regularly(service, READY)
    assert Sink.calls == 0


@pytest.mark.parametrize("url", ["ftp://example.com", "example.com", "https://", "http://[", ""])
def test_an_address_that_is_no_web_address_is_named_without_it(url: str) -> None:
    (problem,) = ServerSettings(heartbeat_url=url).problems()
    assert problem == "heartbeat_url: is no address that begins with https:// or http://."


def test_it_is_sent_regularly_until_the_service_stops_and_soon_after_the_start(
    new_service: NewService, monkeypatch: pytest.MonkeyPatch
) -> None:
    service = new_service(heartbeat_url="https://example.com")
    pauses: list[float] = []

    def wait(pause: float) -> bool:
        pauses.append(pause)
        return len(pauses) > 3

    monkeypatch.setattr(service, "stopping", SimpleNamespace(wait=wait))
    monkeypatch.setattr(health, "beat", lambda service, _: service.heartbeats.update(["sent"]))
    beat_regularly(service, READY)
    assert pauses == [60.0, 300.0, 300.0, 300.0]
    assert service.heartbeats == {"sent": 3}


def test_without_an_address_none_is_sent(service: Service) -> None:
    beat(service, READY)
    assert service.heartbeats == {}
