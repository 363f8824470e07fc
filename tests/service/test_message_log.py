"""Log of the messages, as JSON and as a page, and the test message."""

from __future__ import annotations

import ssl
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from fastapi.testclient import TestClient
from sqlalchemy import select
from tests.service.conftest import SETUP, NewService, client_of
from tests.service.sinks import HookSink, hook_sink, make_certificate

from ballscrew.service.delivering import plan_messages, send_messages
from ballscrew.service.serving import Service
from ballscrew.service.tokens import create_token
from ballscrew.store.service_tables import Message
from ballscrew.store.tables import AlarmRow, Audit, Axis


@pytest.fixture(scope="module")
def tls(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, ssl.SSLContext]:
    return make_certificate(tmp_path_factory.mktemp("certificate"))


@pytest.fixture
def hooks(tls: tuple[Path, ssl.SSLContext], monkeypatch: pytest.MonkeyPatch) -> Iterator[HookSink]:
    monkeypatch.setenv("HOOK_SECRET", "between us")
    with hook_sink(tls[1]) as sink:
        yield sink


@pytest.fixture
def informing(new_service: NewService, hooks: HookSink, tls: tuple[Path, ssl.SSLContext]) -> Service:
    """A service with one webhook, and an alarm of an axis."""
    hook = {
        "name": "cmms", "url": f"{hooks.url}/T0KEN", "secret_env": "HOOK_SECRET", "ca_file": tls[0],
        "allow_private": True,
    }  # fmt: skip
    service = new_service(public_url="http://plant", webhook=[hook], messages={"timeout_s": 300.0})
    with client_of(service) as client:
        client.put("/api/v1/axes/bench", json=SETUP)
    at = datetime.now(UTC).isoformat()
    with service.store.write("test") as session:
        axis = session.scalars(select(Axis.id)).one()
        session.add(AlarmRow(axis_id=axis, epoch=0, began_at=at, raised_at=at))
        detail = {"subject": "alarm-1", "axis": "bench", "began_at": at}
        session.add(Message(key="alarm-1/1", axis_id=axis, kind="raised", detail=detail, at=at))
    return service


@pytest.fixture
def client(informing: Service) -> Iterator[TestClient]:
    with client_of(informing) as client:
        yield client


def test_a_test_message_says_what_happened(client: TestClient, hooks: HookSink, informing: Service) -> None:
    answer = client.post("/api/v1/messages/test", json={"recipient": "cmms"})
    assert (answer.status_code, answer.json()["status"], answer.json()["error"]) == (200, "sent", None)
    assert b"Test message of ballscrew" in hooks.requests[0][1]
    hooks.statuses = [503]
    found = client.post("/api/v1/messages/test", json={"recipient": "cmms"}).json()
    assert (found["status"], found["error"]) == ("failed", "cmms: it answered 503.")
    assert hooks.requests[0][0]["Idempotency-Key"] != hooks.requests[1][0]["Idempotency-Key"]
    assert send_messages(informing, lambda: datetime.now(UTC) + timedelta(days=9)) == 0
    with informing.store.read() as session:
        actions = session.scalars(select(Audit.action)).all()
    assert actions[-2:] == ["test message", "test message"]
    assert "was given up" not in client.get("/status").text  # a test is none


def test_recipients_are_in_the_changes_of_an_administrator_alone(
    client: TestClient, informing: Service
) -> None:
    client.post("/api/v1/messages/test", json={"recipient": "cmms"})
    informing.stopping.set()
    for role, is_shown in (("admin", True), ("viewer", False)):
        _, token = create_token(informing.store, None, role=role)
        headers = {"Authorization": f"Bearer {token}", "Last-Event-ID": "0"}
        text = client.get("/api/v1/events", headers=headers).text
        assert "axis bench" in text
        assert ("cmms" in text) == is_shown


@pytest.mark.parametrize(
    ("body", "status"),
    [({"recipient": "nobody"}, 404), ({"recipient": "x\r\nBcc: y"}, 404), ({}, 422), ({"to": "cmms"}, 422),
     ({"recipient": "x" * 999}, 422)],
)  # fmt: skip
def test_only_recipients_of_the_settings_receive_a_test(
    client: TestClient, hooks: HookSink, body: dict[str, str], status: int
) -> None:
    assert client.post("/api/v1/messages/test", json=body).status_code == status
    assert hooks.requests == []


def test_the_log_lists_what_was_sent_waits_and_failed(
    client: TestClient, hooks: HookSink, informing: Service
) -> None:
    hooks.statuses = [500]
    at = datetime.now(UTC)
    plan_messages(informing, at)
    send_messages(informing, lambda: at)
    found = client.get("/api/v1/messages").json()
    assert found["recipients"] == [
        {
            "recipient": "cmms",
            "by": "webhook",
            "level": "alarm",
            "machines": [],
            "language": "en",
            "escalation": False,
        }
    ]
    (message,) = found["messages"]
    assert (message["status"], message["attempts"], message["axes"]) == ("queued", 1, ["bench"])
    assert message["error"] == "cmms: it answered 500."
    assert message["next_at"] > at.isoformat()
    send_messages(informing, lambda: at + timedelta(minutes=1))
    found = client.get("/api/v1/messages").json()
    assert found["counts"] == {"queued": 0, "sent": 1, "failed": 0}
    with informing.store.write("test") as session:
        session.scalars(select(AlarmRow)).one().retracted_at = at.isoformat()
        detail = {"subject": "alarm-1", "axis": "bench"}
        axis = session.scalars(select(Axis.id)).one()
        session.add(
            Message(key="alarm-1/2", axis_id=axis, kind="retracted", detail=detail, at=at.isoformat())
        )
    (waits,) = client.get("/api/v1/messages").json()["waiting"]
    assert (waits["axis"], waits["kind"], waits["reason"]) == ("bench", "retracted", "hold time")


def test_the_page_shows_the_log_and_sends_a_test(client: TestClient, hooks: HookSink) -> None:
    text = client.get("/messages").text
    assert "No message was made yet." in text
    assert "T0KEN" not in text
    form = {"recipient": "cmms"}
    answer = client.post("/messages/test", data=form, follow_redirects=False)
    assert (answer.status_code, answer.headers["Location"]) == (303, "/messages?done=test")
    assert "The recipient accepted the test message." in client.get("/messages?done=test").text
    hooks.statuses = [302]
    answer = client.post("/messages/test", data=form)
    assert answer.status_code == 502
    assert "cmms: it answered 302, and redirects are not followed." in answer.text
    assert client.post("/messages/test", data={"recipient": "<b>"}).status_code == 404
    assert client.post("/messages/test", data={}).status_code in (404, 422)


def test_without_recipients_the_page_says_so(new_service: NewService) -> None:
    with client_of(new_service()) as client:
        assert "Nobody receives messages" in client.get("/messages").text
