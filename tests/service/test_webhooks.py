"""Requests to webhooks: signed, to addresses that were checked, without redirects."""

from __future__ import annotations

import hashlib
import hmac
import socket
import ssl
import threading
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest
from tests.service.sinks import HookSink, hook_sink, make_certificate

from ballscrew.base.errors import InputError
from ballscrew.service import webhooks
from ballscrew.service.recipients import WebhookRecipient
from ballscrew.service.webhooks import DeliveryError, delivering, post_webhook, resolve

AT = datetime(2026, 3, 2, 10, tzinfo=UTC)
SECRET = "between us"  # noqa: S105


@pytest.fixture(scope="module")
def tls(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, ssl.SSLContext]:
    return make_certificate(tmp_path_factory.mktemp("certificate"))


@pytest.fixture
def sink(tls: tuple[Path, ssl.SSLContext], monkeypatch: pytest.MonkeyPatch) -> Iterator[HookSink]:
    monkeypatch.setenv("HOOK_SECRET", SECRET)
    with hook_sink(tls[1]) as found:
        yield found


def webhook(url: str, **changes: Any) -> WebhookRecipient:
    settings = {"name": "cmms", "url": url, "secret_env": "HOOK_SECRET", "allow_private": True}
    return WebhookRecipient(**(settings | changes))


def post(hook: WebhookRecipient, limit: float = 60.0) -> None:
    post_webhook(hook, b'{"a": 1}', "key-1", AT, limit)


def test_a_request_is_signed_and_the_receiver_can_verify_it(
    sink: HookSink, tls: tuple[Path, ssl.SSLContext]
) -> None:
    post(webhook(f"{sink.url}/hook?plant=1", ca_file=tls[0]))
    ((headers, body),) = sink.requests
    assert body == b'{"a": 1}'
    assert headers["Idempotency-Key"] == "key-1"
    timestamp = headers["Ballscrew-Timestamp"]
    assert int(timestamp) == int(AT.timestamp())
    signature = hmac.new(SECRET.encode(), f"{timestamp}.".encode() + body, hashlib.sha256).hexdigest()
    assert headers["Ballscrew-Signature"] == f"sha256={signature}"
    assert headers["Host"] == sink.url.removeprefix("https://")
    assert SECRET not in str(headers)


@pytest.mark.parametrize("status", [301, 302, 307, 308, 400, 404, 500, 503])
def test_only_2xx_is_accepted_and_no_redirect_is_followed(
    sink: HookSink, tls: tuple[Path, ssl.SSLContext], status: int
) -> None:
    sink.statuses = [status]
    with pytest.raises(DeliveryError, match=f"cmms: it answered {status}"):
        post(webhook(sink.url, ca_file=tls[0]))
    assert len(sink.requests) == 1
    sink.statuses = [204]
    post(webhook(sink.url, ca_file=tls[0]))


def test_a_certificate_of_another_name_or_authority_is_refused(
    sink: HookSink, tls: tuple[Path, ssl.SSLContext], monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(DeliveryError, match="certificate verify failed"):
        post(webhook(sink.url))
    addresses = socket.getaddrinfo("127.0.0.1", int(sink.url.rpartition(":")[2]), type=socket.SOCK_STREAM)
    monkeypatch.setattr(socket, "getaddrinfo", lambda *_, **__: addresses)
    with pytest.raises(DeliveryError, match="Hostname mismatch"):
        post(webhook(sink.url.replace("localhost", "other.example"), ca_file=tls[0]))
    assert sink.requests == []


def test_a_name_is_looked_up_once_and_the_checked_address_is_connected_to(
    sink: HookSink, tls: tuple[Path, ssl.SSLContext], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A second answer of the name server, such as a private address, has no effect."""
    port, look_up = int(sink.url.rpartition(":")[2]), socket.getaddrinfo
    asked = []

    def rebind(host: str, *given: Any, **options: Any) -> Any:
        if host == "localhost":
            asked.append(host)
            host = "127.0.0.1" if len(asked) == 1 else "192.0.2.1"
        return look_up(host, *given, **options)

    monkeypatch.setattr(socket, "getaddrinfo", rebind)
    post(webhook(f"https://localhost:{port}", ca_file=tls[0]))
    assert asked == ["localhost"]


@pytest.mark.parametrize(
    "host",
    ["localhost", "127.0.0.1", "127.1", "2130706433", "0x7f.1", "0.0.0.0", "10.1.2.3",  # noqa: S104
     "172.16.0.1", "192.168.1.1", "169.254.169.254", "100.100.100.200", "224.0.0.1", "255.255.255.255", "::1",
     "::", "fe80::1", "fd00:ec2::254", "fc00::1", "ff02::1", "::ffff:127.0.0.1", "::ffff:a9fe:a9fe",
     "64:ff9b::7f00:1", "2002:7f00:1::", "fec0::1", "2001:0:7f00:1::80ff:fffe"],
)  # fmt: skip
def test_addresses_that_are_not_of_the_internet_are_refused(
    monkeypatch: pytest.MonkeyPatch, host: str
) -> None:
    monkeypatch.setenv("HOOK_SECRET", SECRET)
    with pytest.raises((ValueError, OSError)):
        resolve(host, 443, allow_private=False)
    named = f"[{host}]" if ":" in host else host
    with pytest.raises(DeliveryError, match="cmms: "):
        post(webhook(f"https://{named}/", allow_private=False))


@pytest.mark.parametrize("host", ["8.8.8.8", "2606:4700::1111", "::ffff:8.8.8.8", "64:ff9b::808:808"])
def test_addresses_of_the_internet_are_permitted(host: str) -> None:
    assert resolve(host, 443, allow_private=False)


@pytest.mark.parametrize(
    ("host", "permitted"),
    [("10.1.2.3", True), ("127.0.0.1", True), ("::1", True), ("fd00::1", True), ("169.254.169.254", False),
     ("fd00:ec2::254", False), ("fe80::1", False), ("224.0.0.1", False), ("0.0.0.0", False),  # noqa: S104
     ("::ffff:169.254.169.254", False), ("255.255.255.255", False)],
)  # fmt: skip
def test_where_private_addresses_are_allowed_those_of_metadata_are_not(host: str, permitted: bool) -> None:
    if permitted:
        assert resolve(host, 443, allow_private=True) == [host]
        return
    with pytest.raises(ValueError, match="not permitted"):
        resolve(host, 443, allow_private=True)


def test_a_name_with_one_private_address_among_others_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    rows = [(0, 0, 0, "", (address, 443)) for address in ("8.8.8.8", "10.0.0.1")]
    monkeypatch.setattr(socket, "getaddrinfo", lambda *_, **__: rows)
    with pytest.raises(ValueError, match=r"10\.0\.0\.1"):
        resolve("mixed.example", 443, allow_private=False)


def test_a_receiver_that_does_not_answer_ends_by_the_time_limit(
    sink: HookSink, tls: tuple[Path, ssl.SSLContext]
) -> None:
    sink.statuses = [0]
    with pytest.raises(DeliveryError, match="no answer within 1 s"):
        post(webhook(sink.url, ca_file=tls[0]), limit=1.0)


def test_a_receiver_that_answers_byte_by_byte_ends_by_the_time_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each byte comes in time, the answer as a whole does not."""
    monkeypatch.setenv("HOOK_SECRET", SECRET)
    done = threading.Event()
    with socket.create_server(("127.0.0.1", 0)) as listener:

        def dribble() -> None:
            connection, _ = listener.accept()
            with connection:
                connection.recv(65536)
                try:
                    for _ in range(6000):  # five minutes: without the limit the test fails
                        if done.wait(0.05):
                            return
                        connection.sendall(b"H")
                except OSError:
                    return

        thread = threading.Thread(target=dribble)
        thread.start()
        try:
            with pytest.raises(DeliveryError, match="no answer within 1 s"):
                post(webhook(f"http://127.0.0.1:{listener.getsockname()[1]}", allow_http=True), limit=1.0)
        finally:
            done.set()
            thread.join()


def test_without_its_secret_nothing_is_sent(
    sink: HookSink, tls: tuple[Path, ssl.SSLContext], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("HOOK_SECRET")
    with pytest.raises(InputError, match="the secret of the webhook cmms"):
        post(webhook(sink.url, ca_file=tls[0]))
    assert sink.requests == []


def test_a_connection_that_is_made_after_the_limit_is_closed_too() -> None:
    """A slow look-up, then a recipient that says nothing."""
    ours, theirs = socket.socketpair()
    found: list[socket.socket | None] = [None, None, None]

    def socket_of() -> socket.socket | None:
        return found.pop() if found else ours

    def receive() -> None:
        with delivering("cmms", 0.05, socket_of, ValueError):
            if not ours.recv(1):
                raise ConnectionResetError

    with ours, theirs, pytest.raises(DeliveryError, match="no answer within"):
        receive()
    assert found == []


def test_the_next_address_is_tried_where_the_first_does_not_answer(
    sink: HookSink, tls: tuple[Path, ssl.SSLContext], monkeypatch: pytest.MonkeyPatch
) -> None:
    addresses = ["127.0.0.2", "127.0.0.1"]
    monkeypatch.setattr(webhooks, "resolve", lambda *_, **__: addresses)
    post(webhook(sink.url, ca_file=tls[0]))
    assert len(sink.requests) == 1
    addresses.pop()
    with pytest.raises(DeliveryError, match="cmms: "):
        post(webhook(sink.url, ca_file=tls[0]))
    assert len(sink.requests) == 1
