"""Checks before the route: hosts, sites, proxies, sizes, and the token of forms."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator
from typing import Any, NoReturn

import pytest
from fastapi.testclient import TestClient
from starlette.types import Message
from tests.service.conftest import NewService, client_of
from tests.service.people import OWN, anonymous, form_token, signed_in

from ballscrew.service import guard
from ballscrew.service.app import create_app
from ballscrew.service.pages.sign_in import local_address
from ballscrew.service.serving import Service
from ballscrew.service.tokens import create_token


@pytest.fixture
def remote(new_service: NewService) -> Service:
    """A service off loopback."""
    return new_service(host="0.0.0.0", allow_plain_http=True)  # noqa: S104


def test_a_body_without_a_token_is_not_read(remote: Service) -> None:
    async def receive() -> NoReturn:
        pytest.fail("the body is read")

    async def send(message: Message) -> None:
        statuses.append(message.get("status"))

    statuses: list[int | None] = []
    app = create_app(remote)
    scope = {
        "type": "http",
        "method": "PUT",
        "path": "/api/v1/axes/bench",
        "query_string": b"",
        "headers": [],
    }
    asyncio.run(app(scope, receive, send))
    assert statuses == [401, None]


@pytest.mark.parametrize(
    ("headers", "status"),
    [
        ({"Host": "evil.example"}, 400),
        ({"Host": "localhost.evil.example:8000"}, 400),
        ({"Host": "["}, 400),
        ({"Origin": "http://evil.example"}, 403),
        ({"Origin": "null"}, 403),
        ({"Origin": "http://["}, 403),
        ({"Content-Length": "9" * 5000}, 413),
        ({"Origin": "http://localhost:9999"}, 403),
        ({"Origin": "http://localhost"}, 200),
        ({"Host": "127.0.0.1:8000"}, 200),
        ({"Host": "[::1]:8000"}, 200),
    ],
)
def test_other_hosts_and_sites_are_refused_on_loopback(
    client: TestClient, headers: dict[str, str], status: int
) -> None:
    answer = client.get("/api/v1/axes", headers=headers)
    assert (answer.status_code, answer.headers["Ballscrew-API"]) == (status, "1")


LINK = {"Sec-Fetch-Site": "cross-site", "Sec-Fetch-Mode": "navigate", "Sec-Fetch-Dest": "document"}


@pytest.mark.parametrize(
    ("method", "changes", "status"),
    [
        ("GET", {}, 200),
        ("POST", {}, 403),
        ("GET", {"Sec-Fetch-Mode": "no-cors", "Sec-Fetch-Dest": "image"}, 403),
        ("GET", {"Sec-Fetch-Dest": "iframe"}, 403),
        ("GET", {"Sec-Fetch-Mode": "cors", "Sec-Fetch-Dest": "empty"}, 403),
        ("GET", {"Sec-Fetch-Site": "same-origin", "Sec-Fetch-Dest": "image"}, 200),
        ("GET", {"Sec-Fetch-Site": "none"}, 200),
    ],
)
def test_another_site_can_link_to_a_page_and_nothing_else(
    client: TestClient, method: str, changes: dict[str, str], status: int
) -> None:
    answer = client.request(method, "/alarms", headers=LINK | changes)
    assert answer.status_code == status


def test_hosts_can_be_allowed(new_service: NewService) -> None:
    with client_of(new_service(allowed_hosts=("plant.example",))) as client:
        assert client.get("/livez", headers={"Host": "plant.example:443"}).status_code == 200
        assert client.get("/livez", headers={"Host": "other.example"}).status_code == 400


def test_a_body_that_states_no_length_is_refused_once_it_is_too_large(client: TestClient) -> None:
    def blocks() -> Iterator[bytes]:
        for _ in range(70):
            yield b" " * (1 << 20)

    answer = client.put("/api/v1/axes/bench", content=blocks())
    assert (answer.status_code, answer.json()) == (413, {"detail": "the body is too large."})
    assert answer.headers["X-Content-Type-Options"] == "nosniff"
    assert client.get("/metrics").text.count('refusals_total{status="413"} 1') == 1


@pytest.mark.parametrize(
    "headers",
    [
        {"Host": "plant.example"},
        {"X-Forwarded-For": "192.0.2.7"},
        {"X-Forwarded-Host": "localhost"},
        {"Forwarded": "for=192.0.2.7"},
        {"Via": "1.1 proxy"},
        {"X-Real-IP": ""},
        {"X-Forwarded-Proto": "https"},
        {"X-Client-IP": "192.0.2.7"},
        {"True-Client-IP": "192.0.2.7"},
        {"CF-Connecting-IP": "192.0.2.7"},
    ],
)
def test_who_comes_through_a_proxy_on_this_computer_needs_a_token(
    new_service: NewService, headers: dict[str, str]
) -> None:
    service = new_service(allowed_hosts=("plant.example",))
    _, text = create_token(service.store, None, role="admin")
    with client_of(service) as client:
        for path in ("/", "/api/v1/tokens"):
            assert client.get(path).status_code == 200
            assert client.get(path, headers=headers, follow_redirects=False).status_code in (303, 401)
            headers_of_admin = headers | {"Authorization": f"Bearer {text}"}
            assert client.get(path, headers=headers_of_admin).status_code == 200
        assert client.get("/livez", headers=headers).status_code == 200


@pytest.fixture
def admin(remote: Service) -> Iterator[TestClient]:
    """An administrator with a session."""
    with signed_in(remote, "anna", "admin") as client:
        yield client


NEW = {"do": "invite", "name": "bob", "role": "viewer"}


@pytest.mark.parametrize("token", [None, "", "0" * 64, "é"])
def test_a_change_by_a_session_needs_the_token_of_its_forms(admin: TestClient, token: str | None) -> None:
    good = admin.headers.pop("X-CSRF-Token")
    given: Any = {} if token is None else {"X-CSRF-Token": token.encode()}
    refused = [admin.post("/users", data=NEW, headers=given), admin.delete("/api/v1/tokens/1", headers=given)]
    if token is not None:
        refused.append(admin.post("/users", data=NEW | {"csrf": token}))
    for answer in refused:
        assert answer.status_code == 403
        assert "reload the page" in answer.text
    assert admin.post("/users", data=NEW | {"csrf": good}).status_code == 200
    again = NEW | {"name": "eve"}
    assert admin.post("/users", data=again, headers={"X-CSRF-Token": good}).status_code == 200
    assert admin.get("/users").status_code == 200  # reading needs none


def test_the_token_of_one_session_is_not_that_of_another(remote: Service, admin: TestClient) -> None:
    with signed_in(remote, "bob", "admin") as bob:
        assert form_token(bob) != form_token(admin)
        headers = {"X-CSRF-Token": form_token(bob)}
        assert admin.post("/users", data=NEW, headers=headers).status_code == 403
    again = signed_in(remote, "anna")
    assert form_token(again) != form_token(admin)


@pytest.mark.parametrize(
    ("headers", "status"),
    [
        ({}, 403),
        ({"Origin": "http://evil.example"}, 403),
        ({"Origin": "null"}, 403),
        ({"Sec-Fetch-Site": "same-site"}, 403),
        ({"Sec-Fetch-Site": "same-origin"}, 200),
        (OWN, 200),
    ],
)
def test_a_change_by_a_session_states_its_site(
    admin: TestClient, headers: dict[str, str], status: int
) -> None:
    del admin.headers["Origin"]
    assert admin.post("/users", data=NEW | {"csrf": form_token(admin)}, headers=headers).status_code == status


def test_a_sign_in_from_another_site_is_refused(remote: Service, admin: TestClient) -> None:  # noqa: ARG001
    with anonymous(remote) as client:
        del client.headers["Origin"]
        for headers in ({}, {"Origin": "http://evil.example"}):
            for path in ("/sign-in", "/link/x"):
                assert client.post(path, data={"name": "anna"}, headers=headers).status_code == 403


@pytest.mark.parametrize("path", ["/sign-in", "/link/x"])
def test_nobody_can_send_a_large_form_without_a_session(remote: Service, path: str) -> None:
    """Neither with its length stated nor without."""

    def blocks() -> Iterator[bytes]:
        for _ in range(5):
            yield b"x" * (1 << 14)

    headers = {"Content-Type": "application/x-www-form-urlencoded"}
    with anonymous(remote) as client:
        for content in (b"x" * ((1 << 16) + 1), blocks()):
            assert client.post(path, content=content, headers=headers).status_code == 413


def test_the_large_body_of_a_viewer_is_not_parsed(remote: Service) -> None:
    _, token = create_token(remote.store, None, role="viewer", name="dashboard")
    headers = {"Authorization": f"Bearer {token}", "Content-Type": "application/json"}
    with anonymous(remote) as client:
        large = client.put("/api/v1/axes/bench", content=b"[" * ((1 << 16) + 1), headers=headers)
        small = client.put("/api/v1/axes/bench", content=b"{}", headers=headers)
    assert (large.status_code, small.status_code) == (413, 403)


def test_a_form_that_is_too_large_is_refused(admin: TestClient) -> None:
    del admin.headers["X-CSRF-Token"]

    def blocks() -> Iterator[bytes]:
        for _ in range(70):
            yield b" " * (1 << 20)

    headers = {"Content-Type": "application/x-www-form-urlencoded"}
    assert admin.post("/users", content=blocks(), headers=headers).status_code == 413


def test_who_must_sign_in_is_led_back_to_the_page(remote: Service) -> None:
    with anonymous(remote) as client:
        answer = client.get("/axes/a%2Fb%20%3F?run=1&x=%26")
        assert answer.status_code == 303
        place = "/sign-in?next=%2Faxes%2Fa%252Fb%2520%253F%3Frun%3D1%26x%3D%2526"
        assert answer.headers["Location"] == place
        assert client.post("/users", data=NEW).headers["Location"] == "/sign-in?next=%2F"
        part = {"HX-Request": "true", "HX-Current-URL": "http://localhost/alarms?show=ended"}
        answer = client.get("/alarms", headers=part)
        assert answer.status_code == 401
        assert answer.headers["HX-Redirect"] == "/sign-in?next=%2Falarms%3Fshow%3Dended"
        answer = client.get("/alarms", headers=part | {"HX-Current-URL": "http://["})
        assert answer.headers["HX-Redirect"] == "/sign-in"


@pytest.mark.parametrize(
    "text",
    [
        "", "x", "//evil.example", "/\\evil.example", "\\/evil.example", "http://evil.example",
        "javascript:alert(1)", "///evil.example", "/\t/evil.example", "\n//evil.example",
        "https:/evil.example", " //evil.example", "/a\nb",
    ],
)  # fmt: skip
def test_what_is_no_address_of_this_server_is_the_first_page(text: str) -> None:
    assert local_address(text) == "/"


@pytest.mark.parametrize("text", ["/", "/axes/a%2Fb?run=1", "/alarms?show=http://x"])
def test_an_address_of_this_server_stays(text: str) -> None:
    assert local_address(text) == text


def test_answers_to_a_session_are_not_stored(admin: TestClient) -> None:
    for path in ("/", "/account", "/api/v1/axes", "/api/v1/tokens", "/metrics"):
        assert admin.get(path).headers["Cache-Control"] == "no-store", path


def test_after_a_body_that_was_read_comes_what_the_client_does_next() -> None:
    async def receive() -> Message:
        return {"type": "http.disconnect"}

    async def messages() -> list[Message]:
        again = guard._again(b"a=1", receive)
        return [await again(), await again()]

    first, second = asyncio.run(messages())
    assert first == {"type": "http.request", "body": b"a=1", "more_body": False}
    assert second == {"type": "http.disconnect"}
