"""Every route and every kind of caller; tokens."""

from __future__ import annotations

from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import pytest
from fastapi.routing import APIRoute
from fastapi.testclient import TestClient
from starlette.routing import BaseRoute
from tests.service.conftest import SETUP, NewService, client_of, send, sha256
from tests.service.people import anonymous, signed_in
from tests.simulated_bench import AXIS
from tests.store.stored import count

from ballscrew.base.errors import InputError
from ballscrew.service.access import caller_of
from ballscrew.service.app import create_app
from ballscrew.service.serving import RefusedError, Service
from ballscrew.service.tokens import create_token, list_tokens, revoke_token
from ballscrew.store.service_tables import Token

FILE = f"/api/v1/axes/bench/runs/r/files/{sha256(b'x')}"
CALLERS = (
    "nobody", "this machine", "other machine", "viewer's token",
    "viewer", "maintainer", "admin", "admin's token",
)  # fmt: skip
"""By a session where no token is stated; in what follows, 200 stands for a yes."""
ALL = (200,) * 8
READ = (401, 403, 403, 200, 200, 200, 200, 200)
MAINTAIN = (401, 403, 403, 403, 403, 200, 200, 200)
ADMIN = (401, 403, 403, 403, 403, 403, 200, 200)
SEND = (401, 200, 403, 403, 403, 200, 200, 200)
SENT = (401, 200, 403, 200, 200, 200, 200, 200)
SIGNED_IN = (401, 403, 403, 403, 200, 200, 200, 403)

ROUTES: dict[tuple[str, str], tuple[str, tuple[int, ...]]] = {
    ("HEAD", "/api/v1/axes/{axis}/runs/{run}/files/{sha256}"): (FILE, SEND),
    ("PUT", "/api/v1/axes/{axis}/runs/{run}/files/{sha256}"): (FILE, SEND),
    ("POST", "/api/v1/axes/{axis}/runs/{run}/complete"): ("/api/v1/axes/bench/runs/r/complete", SEND),
    ("PUT", "/api/v1/axes/{axis}"): ("/api/v1/axes/bench", ADMIN),
    ("PUT", "/api/v1/axes/{axis}/model"): ("/api/v1/axes/bench/model", ADMIN),
    ("POST", "/api/v1/axes/{axis}/events"): ("/api/v1/axes/bench/events", MAINTAIN),
    ("POST", "/api/v1/axes/{axis}/{kind}/{subject}/exclusion"): (
        "/api/v1/axes/bench/runs/r/exclusion",
        MAINTAIN,
    ),
    ("DELETE", "/api/v1/axes/{axis}/{kind}/{subject}/exclusion"): (
        "/api/v1/axes/bench/events/e/exclusion",
        MAINTAIN,
    ),
    ("POST", "/api/v1/axes/{axis}/calibration"): ("/api/v1/axes/bench/calibration", ADMIN),
    ("GET", "/api/v1/axes/{axis}/calibration"): ("/api/v1/axes/bench/calibration", READ),
    ("GET", "/api/v1/axes"): ("/api/v1/axes", READ),
    ("GET", "/api/v1/axes/{axis}"): ("/api/v1/axes/bench", READ),
    ("GET", "/api/v1/axes/{axis}/state"): ("/api/v1/axes/bench/state", READ),
    ("GET", "/api/v1/axes/{axis}/forecast"): ("/api/v1/axes/bench/forecast", READ),
    ("GET", "/api/v1/axes/{axis}/runs"): ("/api/v1/axes/bench/runs", READ),
    ("GET", "/api/v1/axes/{axis}/history"): ("/api/v1/axes/bench/history", READ),
    ("GET", "/api/v1/axes/{axis:path}/trend"): ("/api/v1/axes/bench/trend", READ),
    ("GET", "/api/v1/axes/{axis:path}/frequencies"): ("/api/v1/axes/bench/frequencies", READ),
    ("GET", "/api/v1/axes/{axis:path}/mechanics"): ("/api/v1/axes/bench/mechanics", READ),
    ("GET", "/api/v1/axes/{axis:path}/responses"): ("/api/v1/axes/bench/responses", READ),
    ("POST", "/api/v1/axes/{axis}/runs/{run}/correct"): ("/api/v1/axes/bench/runs/r/correct", MAINTAIN),
    ("GET", "/api/v1/runs/{run}"): ("/api/v1/runs/{sent}", SENT),
    ("GET", "/api/v1/runs/{run}/document"): ("/api/v1/runs/{sent}/document", SENT),
    ("GET", "/api/v1/runs/{run}/cells"): ("/api/v1/runs/{sent}/cells", READ),
    ("GET", "/api/v1/runs/{run}/magnitude"): (
        "/api/v1/runs/{sent}/magnitude?low=1&high=2&position_m=0&condition=a&motion=0",
        READ,
    ),
    ("GET", "/api/v1/runs/{run}/response"): ("/api/v1/runs/{sent}/response", READ),
    ("GET", "/api/v1/runs/{run}/signals"): ("/api/v1/runs/{sent}/signals?file=9", READ),
    ("GET", "/api/v1/jobs"): ("/api/v1/jobs", READ),
    ("POST", "/api/v1/jobs/{job}/retry"): ("/api/v1/jobs/1/retry", MAINTAIN),
    ("GET", "/api/v1/events"): ("/api/v1/events", READ),
    ("GET", "/api/v1/alarms"): ("/api/v1/alarms", READ),
    ("POST", "/api/v1/alarms/{alarm}"): ("/api/v1/alarms/alarm-1", MAINTAIN),
    ("GET", "/api/v1/findings"): ("/api/v1/findings", READ),
    ("GET", "/api/v1/audit"): ("/api/v1/audit", ADMIN),
    ("GET", "/api/v1/tokens"): ("/api/v1/tokens", ADMIN),
    ("POST", "/api/v1/tokens"): ("/api/v1/tokens", ADMIN),
    ("DELETE", "/api/v1/tokens/{token}"): ("/api/v1/tokens/9", ADMIN),
    ("GET", "/api/v1/messages"): ("/api/v1/messages", ADMIN),
    ("POST", "/api/v1/messages/test"): ("/api/v1/messages/test", ADMIN),
    ("GET", "/livez"): ("/livez", ALL),
    ("GET", "/readyz"): ("/readyz", ALL),
    ("GET", "/metrics"): ("/metrics", READ),
}


PAGES: dict[tuple[str, str], tuple[str, tuple[int, ...]]] = {
    ("GET", "/"): ("/", READ),
    ("GET", "/runs/{run}"): ("/runs/{sent}", READ),
    ("GET", "/runs/{run}/signals"): ("/runs/{sent}/signals", READ),
    ("GET", "/compare"): ("/compare", READ),
    ("GET", "/alarms"): ("/alarms", READ),
    ("POST", "/alarms/{alarm}"): ("/alarms/alarm-1", MAINTAIN),
    ("GET", "/axes/{axis}/actions"): ("/axes/bench/actions", READ),
    ("POST", "/axes/{axis}/actions/events"): ("/axes/bench/actions/events", MAINTAIN),
    ("POST", "/axes/{axis}/actions/exclusions"): ("/axes/bench/actions/exclusions", MAINTAIN),
    ("GET", "/setup"): ("/setup", ADMIN),
    ("GET", "/messages"): ("/messages", ADMIN),
    ("POST", "/messages/test"): ("/messages/test", ADMIN),
    ("POST", "/setup"): ("/setup", ADMIN),
    ("GET", "/axes/{axis}/setup"): ("/axes/bench/setup", READ),
    ("POST", "/axes/{axis}/setup"): ("/axes/bench/setup", ADMIN),
    ("GET", "/axes/{axis}/gcode"): ("/axes/bench/gcode?dialect=none", READ),
    ("GET", "/axes/{axis}/calibration"): ("/axes/bench/calibration", READ),
    ("POST", "/axes/{axis}/calibration"): ("/axes/bench/calibration", ADMIN),
    ("GET", "/axes/{axis}/calibration/model"): ("/axes/bench/calibration/model", READ),
    ("GET", "/help"): ("/help", READ),
    ("GET", "/help/{topic}"): ("/help/fleet", READ),
    ("GET", "/status"): ("/status", READ),
    ("GET", "/settings"): ("/settings", ADMIN),
    ("GET", "/findings"): ("/findings", READ),
    ("GET", "/audit"): ("/audit", ADMIN),
    ("GET", "/static/{digest}/{name}"): ("/static/0/pages.css", ALL),
    ("GET", "/axes/{axis:path}/report.{kind}"): ("/axes/none/report.html", READ),
    ("GET", "/axes/{axis:path}"): ("/axes/bench", READ),
    ("GET", "/sign-in"): ("/sign-in", ALL),
    ("POST", "/sign-in"): ("/sign-in", ALL),
    ("GET", "/link/{link}"): ("/link/none", ALL),
    ("POST", "/link/{link}"): ("/link/none", ALL),
    ("GET", "/account"): ("/account", SIGNED_IN),
    ("POST", "/account/password"): ("/account/password", SIGNED_IN),
    ("POST", "/account/sessions"): ("/account/sessions", SIGNED_IN),
    ("GET", "/users"): ("/users", ADMIN),
    ("POST", "/users"): ("/users", ADMIN),
    ("POST", "/users/tokens"): ("/users/tokens", ADMIN),
    ("POST", "/sign-out"): ("/sign-out", SIGNED_IN),  # the last one: it ends the session
}
"""Those that the schema does not list."""


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
def clients(remote: Service) -> Iterator[dict[str, TestClient]]:
    """A client of each kind of caller."""
    found = {"nobody": anonymous(remote)}
    tokens = {
        "this machine": create_token(remote.store, "mill 4"),
        "other machine": create_token(remote.store, "mill 5"),
        "viewer's token": create_token(remote.store, None, role="viewer", name="dashboard"),
        "admin's token": create_token(remote.store, None, role="admin"),
    }
    for name, (_, text) in tokens.items():
        found[name] = anonymous(remote)
        found[name].headers["Authorization"] = f"Bearer {text}"
    for role in ("admin", "maintainer", "viewer"):
        found[role] = signed_in(remote, f"the {role}", role)
    remote.stopping.set()  # a stream of events ends at once
    yield {name: found[name] for name in CALLERS}
    for client in found.values():
        client.close()


def routes_of(service: Service) -> set[tuple[str, str]]:
    """Method and path of every route."""
    routes: list[BaseRoute] = []
    for included in create_app(service).routes:
        router = getattr(included, "original_router", None)
        routes += getattr(router, "routes", ())
    found = set()
    for each in routes:
        if isinstance(each, APIRoute):
            found |= {(method, each.path) for method in each.methods}
    return found


def status_of(answer: Any) -> int:
    """200 for whatever a route answers, 401 or 303 to one who must sign in, 403 to one who may not."""
    if answer.status_code == 401 and "WWW-Authenticate" in answer.headers:
        return 401
    if answer.headers.get("Location", "").startswith("/sign-in?next="):
        return 303
    return 403 if answer.status_code == 403 else 200


def test_the_table_has_every_route(remote: Service) -> None:
    assert routes_of(remote) == set(ROUTES) | set(PAGES)


def test_every_route_and_every_kind_of_caller(clients: dict[str, TestClient], remote: Service) -> None:
    with client_of(remote, headers=clients["admin's token"].headers) as admin:
        sent = send(admin).json()["id"]
    wrong = []
    for table in (ROUTES, PAGES):
        for (method, route), (path, expected) in table.items():
            for (kind, client), allowed in zip(clients.items(), expected, strict=True):
                status = status_of(client.request(method, path.format(sent=sent)))
                if allowed == 401 and table is PAGES:
                    allowed = 303
                if status != allowed:
                    wrong.append(f"{kind}: {method} {route} is {status}, not {allowed}")
    assert wrong == []


def test_a_role_that_is_missing_is_one_sentence(clients: dict[str, TestClient]) -> None:
    viewer = clients["viewer"]
    answer = viewer.post("/api/v1/alarms/alarm-1", json={"action": "acknowledge"})
    assert answer.json() == {"detail": "this needs the role maintainer; 'the viewer' has viewer."}
    page = viewer.get("/setup", headers={"Accept": "text/html"})
    assert (page.status_code, page.headers["Content-Type"]) == (403, "text/html; charset=utf-8")
    assert "this needs the role admin; &#39;the viewer&#39; has viewer." in page.text


def test_routes_outside_the_tables_are_the_schema(clients: dict[str, TestClient]) -> None:
    for path, known in (("/openapi.json", 200), ("/docs", 404)):
        statuses = [client.get(path).status_code for client in clients.values()]
        assert statuses == [401 if path == "/openapi.json" else 303] + [known] * 7, path


def test_a_machine_sends_for_its_axes_alone(clients: dict[str, TestClient]) -> None:
    this, other, admin = (clients[name] for name in ("this machine", "other machine", "admin's token"))
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
    number, text = create_token(remote.store, None, role="admin")
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
        create_token(remote.store, "lathe")


def test_an_administrator_creates_lists_and_revokes_tokens_over_http(clients: dict[str, TestClient]) -> None:
    admin = clients["admin's token"]
    answer = admin.post("/api/v1/tokens", json={"machine": "mill 5"})
    assert (answer.status_code, answer.headers["Cache-Control"]) == (201, "no-store")
    created = answer.json()
    headers = {"Authorization": f"Bearer {created['token']}"}
    file = FILE.replace("bench", "Y axis")
    assert admin.head(file, headers=headers).status_code == 204
    listed = admin.get("/api/v1/tokens").json()["tokens"]
    assert [each["machine"] for each in listed] == ["mill 4", "mill 5", None, None, "mill 5"]
    assert [each["role"] for each in listed] == [None, None, "viewer", "admin", None]
    assert listed[2]["name"] == "dashboard"
    assert listed[3]["used_at"] is not None
    assert created["token"] not in str(listed)
    assert admin.delete(f"/api/v1/tokens/{created['id']}").json()["revoked"]
    assert admin.head(file, headers=headers).status_code == 401


@pytest.mark.parametrize(
    "body",
    [
        {},
        {"admin": True, "machine": "mill 4"},
        {"role": "viewer", "machine": "mill 4"},
        {"admin": True, "role": "viewer"},
        {"role": "owner"},
        {"role": "viewer", "name": "a\nb"},
        {"machine": "lathe"},
        {"all": 1},
    ],
)
def test_a_token_without_an_owner_is_not_created(
    clients: dict[str, TestClient], body: dict[str, object]
) -> None:
    assert clients["admin's token"].post("/api/v1/tokens", json=body).status_code == 422
    assert len(clients["admin's token"].get("/api/v1/tokens").json()["tokens"]) == 4


@pytest.mark.parametrize("number", ["0", "-1", "9", "9" * 30])
def test_a_token_that_does_not_exist_is_404(clients: dict[str, TestClient], number: str) -> None:
    assert clients["admin's token"].delete(f"/api/v1/tokens/{number}").status_code == 404


def test_a_route_that_anybody_reaches_knows_no_caller() -> None:
    """If it asks for one, it is not answered."""
    request: Any = SimpleNamespace(state=SimpleNamespace())
    with pytest.raises(RefusedError, match="sign in first") as caught:
        caller_of(request)
    assert caught.value.status == 401
    assert "WWW-Authenticate" in caught.value.headers
