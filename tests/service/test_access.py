"""Every route and every kind of caller; hosts and sites that are not allowed."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator
from typing import NoReturn

import pytest
from fastapi.routing import APIRoute
from fastapi.testclient import TestClient
from starlette.routing import BaseRoute
from starlette.types import Message
from tests.service.conftest import SETUP, NewService, client_of, send, sha256
from tests.simulated_bench import AXIS
from tests.store.stored import count

from ballscrew.base.errors import InputError
from ballscrew.service.app import create_app
from ballscrew.service.serving import Service
from ballscrew.service.tokens import create_token, list_tokens, revoke_token
from ballscrew.store.tables import Token

FILE = f"/api/v1/axes/bench/runs/r/files/{sha256(b'x')}"
ALL, SEND, ADMIN = (200, 200, 200, 200), (401, 200, 403, 200), (401, 403, 403, 200)
"""Whether none, this machine, another machine and an administrator may use a route: 200 stands for a yes."""

ROUTES = {
    ("HEAD", "/api/v1/axes/{axis}/runs/{run}/files/{sha256}"): (FILE, SEND),
    ("PUT", "/api/v1/axes/{axis}/runs/{run}/files/{sha256}"): (FILE, SEND),
    ("POST", "/api/v1/axes/{axis}/runs/{run}/complete"): ("/api/v1/axes/bench/runs/r/complete", SEND),
    ("PUT", "/api/v1/axes/{axis}"): ("/api/v1/axes/bench", ADMIN),
    ("PUT", "/api/v1/axes/{axis}/model"): ("/api/v1/axes/bench/model", ADMIN),
    ("POST", "/api/v1/axes/{axis}/events"): ("/api/v1/axes/bench/events", ADMIN),
    ("POST", "/api/v1/axes/{axis}/runs/{run}/exclusion"): ("/api/v1/axes/bench/runs/r/exclusion", ADMIN),
    ("DELETE", "/api/v1/axes/{axis}/runs/{run}/exclusion"): ("/api/v1/axes/bench/runs/r/exclusion", ADMIN),
    ("POST", "/api/v1/axes/{axis}/events/{event}/exclusion"): (
        "/api/v1/axes/bench/events/e/exclusion",
        ADMIN,
    ),
    ("DELETE", "/api/v1/axes/{axis}/events/{event}/exclusion"): (
        "/api/v1/axes/bench/events/e/exclusion",
        ADMIN,
    ),
    ("POST", "/api/v1/axes/{axis}/calibration"): ("/api/v1/axes/bench/calibration", ADMIN),
    ("GET", "/api/v1/axes/{axis}/calibration"): ("/api/v1/axes/bench/calibration", ADMIN),
    ("GET", "/api/v1/axes"): ("/api/v1/axes", ADMIN),
    ("GET", "/api/v1/axes/{axis}"): ("/api/v1/axes/bench", ADMIN),
    ("GET", "/api/v1/axes/{axis}/state"): ("/api/v1/axes/bench/state", ADMIN),
    ("GET", "/api/v1/axes/{axis}/forecast"): ("/api/v1/axes/bench/forecast", ADMIN),
    ("GET", "/api/v1/axes/{axis}/runs"): ("/api/v1/axes/bench/runs", ADMIN),
    ("GET", "/api/v1/axes/{axis}/history"): ("/api/v1/axes/bench/history", ADMIN),
    ("GET", "/api/v1/axes/{axis}/trend"): ("/api/v1/axes/bench/trend", ADMIN),
    ("GET", "/api/v1/axes/{axis}/frequencies"): ("/api/v1/axes/bench/frequencies", ADMIN),
    ("GET", "/api/v1/axes/{axis}/mechanics"): ("/api/v1/axes/bench/mechanics", ADMIN),
    ("POST", "/api/v1/axes/{axis}/runs/{run}/correct"): ("/api/v1/axes/bench/runs/r/correct", ADMIN),
    ("GET", "/api/v1/runs/{run}"): ("/api/v1/runs/{sent}", SEND),
    ("GET", "/api/v1/runs/{run}/document"): ("/api/v1/runs/{sent}/document", SEND),
    ("GET", "/api/v1/runs/{run}/cells"): ("/api/v1/runs/{sent}/cells", ADMIN),
    ("GET", "/api/v1/runs/{run}/response"): ("/api/v1/runs/{sent}/response", ADMIN),
    ("GET", "/api/v1/runs/{run}/signals"): ("/api/v1/runs/{sent}/signals?file=9", ADMIN),
    ("GET", "/api/v1/jobs"): ("/api/v1/jobs", ADMIN),
    ("POST", "/api/v1/jobs/{job}/retry"): ("/api/v1/jobs/1/retry", ADMIN),
    ("GET", "/api/v1/events"): ("/api/v1/events", ADMIN),
    ("GET", "/api/v1/alarms"): ("/api/v1/alarms", ADMIN),
    ("POST", "/api/v1/alarms/{alarm}"): ("/api/v1/alarms/alarm-1", ADMIN),
    ("GET", "/api/v1/tokens"): ("/api/v1/tokens", ADMIN),
    ("POST", "/api/v1/tokens"): ("/api/v1/tokens", ADMIN),
    ("DELETE", "/api/v1/tokens/{token}"): ("/api/v1/tokens/9", ADMIN),
    ("GET", "/api/v1/messages"): ("/api/v1/messages", ADMIN),
    ("POST", "/api/v1/messages/test"): ("/api/v1/messages/test", ADMIN),
    ("GET", "/livez"): ("/livez", ALL),
    ("GET", "/readyz"): ("/readyz", ALL),
    ("GET", "/metrics"): ("/metrics", ADMIN),
}


@pytest.fixture
def remote(new_service: NewService) -> Service:
    """A service off loopback, with an axis on each of two machines."""
    service = new_service(host="0.0.0.0", allow_plain_http=True)  # noqa: S104
    local = Service(service.store, service.settings.model_copy(update={"host": "127.0.0.1"}))
    with client_of(local) as client:
        client.put("/api/v1/axes/bench", json=SETUP)
        other = SETUP | {"machine": "mill 5", "sheet": AXIS.replace('"bench"', '"Y axis"')}
        client.put("/api/v1/axes/Y axis", json=other)
    return service


@pytest.fixture
def clients(remote: Service) -> Iterator[list[TestClient]]:
    """Without a token, of this machine, of another, and of an administrator."""
    found = [client_of(remote, raise_server_exceptions=True)]
    for machine in ("mill 4", "mill 5", None):
        _, text = create_token(remote.store, machine, admin=machine is None)
        found.append(client_of(remote, headers={"Authorization": f"Bearer {text}"}))
    remote.stopping.set()  # a stream of events ends at once
    yield found
    for client in found:
        client.close()


def test_every_route_and_every_kind_of_caller(clients: list[TestClient], remote: Service) -> None:
    paths = create_app(remote).openapi()["paths"]
    routes = {(method.upper(), path) for path, methods in paths.items() for method in methods}
    assert routes == set(ROUTES)
    with client_of(remote, headers=clients[3].headers) as admin:
        sent = send(admin).json()["id"]
    for (method, _), (path, expected) in ROUTES.items():
        for client, allowed in zip(clients, expected, strict=True):
            status = client.request(method, path.format(sent=sent)).status_code
            if allowed == 200:
                assert status not in (401, 403), (method, path, status)
            else:
                assert status == allowed, (method, path)


def hidden_routes(service: Service) -> list[str]:
    """Paths of the routes that the schema does not list: pages."""
    routes: list[BaseRoute] = []
    for included in create_app(service).routes:
        router = getattr(included, "original_router", None)
        routes += getattr(router, "routes", ())
    return [each.path for each in routes if isinstance(each, APIRoute) and not each.include_in_schema]


def test_pages_are_for_this_computer_alone(service: Service) -> None:
    assert "/" in hidden_routes(service)


def test_routes_outside_the_table_are_the_page_and_the_schema(
    remote: Service, clients: list[TestClient]
) -> None:
    assert hidden_routes(remote) == []
    for path, known in (("/", 404), ("/openapi.json", 200), ("/docs", 404)):
        statuses = [client.get(path).status_code for client in clients]
        assert statuses == [401, known, known, known], path


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


def test_a_machine_sends_for_its_axes_alone(clients: list[TestClient]) -> None:
    _, this, other, admin = clients
    assert this.put(FILE, content=b"x").status_code == 201
    assert other.put(FILE.replace("bench", "Y axis"), content=b"x").status_code == 200
    for client in (other, this):
        status = client.put(FILE.replace("bench", "none"), content=b"x").status_code
        assert status == 403  # whether there is such an axis is not shown
    assert admin.put(FILE.replace("bench", "none"), content=b"x").status_code == 404


@pytest.mark.parametrize("given", ["", "Bearer", "Bearer x", "Basic YTpi", "Bearer bs_\x80", "x" * 10_000])
def test_what_is_no_token_is_401(remote: Service, given: str) -> None:
    with client_of(remote) as client:
        answer = client.get("/api/v1/axes", headers={"Authorization": given.encode("latin-1")})
    assert (answer.status_code, answer.headers["WWW-Authenticate"]) == (401, "Bearer")


def test_a_revoked_token_is_401_and_no_token_is_stored(remote: Service) -> None:
    number, text = create_token(remote.store, None, admin=True)
    with client_of(remote, headers={"Authorization": f"Bearer {text}"}) as client:
        assert client.get("/api/v1/axes").status_code == 200
        revoke_token(remote.store, number)
        revoke_token(remote.store, number)
        assert client.get("/api/v1/axes").status_code == 401
    assert count(remote.store, Token) == 1
    assert list_tokens(remote.store)[0]["revoked_at"] is not None
    assert text.encode() not in remote.store.folder.sqlite.read_bytes()
    with pytest.raises(InputError, match="no token 7"):
        revoke_token(remote.store, 7)
    with pytest.raises(InputError, match="no machine of the name 'lathe'"):
        create_token(remote.store, "lathe", admin=False)


def test_an_administrator_creates_lists_and_revokes_tokens_over_http(clients: list[TestClient]) -> None:
    *_, admin = clients
    answer = admin.post("/api/v1/tokens", json={"machine": "mill 5"})
    assert (answer.status_code, answer.headers["Cache-Control"]) == (201, "no-store")
    created = answer.json()
    headers = {"Authorization": f"Bearer {created['token']}"}
    file = FILE.replace("bench", "Y axis")
    assert admin.head(file, headers=headers).status_code == 204
    listed = admin.get("/api/v1/tokens").json()["tokens"]
    assert [each["machine"] for each in listed] == ["mill 4", "mill 5", None, "mill 5"]
    assert created["token"] not in str(listed)
    assert admin.delete(f"/api/v1/tokens/{created['id']}").json()["revoked"]
    assert admin.head(file, headers=headers).status_code == 401


@pytest.mark.parametrize("body", [{}, {"admin": True, "machine": "mill 4"}, {"machine": "lathe"}, {"all": 1}])
def test_a_token_without_an_owner_is_not_created(clients: list[TestClient], body: dict[str, object]) -> None:
    assert clients[3].post("/api/v1/tokens", json=body).status_code == 422
    assert len(clients[3].get("/api/v1/tokens").json()["tokens"]) == 3


@pytest.mark.parametrize("number", ["0", "-1", "9", "9" * 30])
def test_a_token_that_does_not_exist_is_404(clients: list[TestClient], number: str) -> None:
    assert clients[3].delete(f"/api/v1/tokens/{number}").status_code == 404


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


@pytest.mark.parametrize("given", ["9" * 5000, "x" * 99, "-1", ""])
def test_changes_after_what_is_no_number_are_those_from_now_on(service: Service, given: str) -> None:
    service.stopping.set()
    with client_of(service) as client:
        answer = client.get("/api/v1/events", headers={"Last-Event-ID": given})
    assert (answer.status_code, answer.text) == (200, ": connected\n\n")


@pytest.mark.parametrize(
    "headers",
    [
        {"Host": "plant.example"},
        {"X-Forwarded-For": "192.0.2.7"},
        {"X-Forwarded-Host": "localhost"},
        {"Forwarded": "for=192.0.2.7"},
        {"Via": "1.1 proxy"},
        {"X-Real-IP": ""},
    ],
)
def test_who_comes_through_a_proxy_on_this_computer_needs_a_token(
    new_service: NewService, headers: dict[str, str]
) -> None:
    service = new_service(allowed_hosts=("plant.example",))
    _, text = create_token(service.store, None, admin=True)
    with client_of(service) as client:
        for path in ("/", "/api/v1/tokens"):
            assert client.get(path).status_code == 200
            assert client.get(path, headers=headers).status_code == 401
            headers_of_admin = headers | {"Authorization": f"Bearer {text}"}
            assert client.get(path, headers=headers_of_admin).status_code == 200
        assert client.get("/livez", headers=headers).status_code == 200
