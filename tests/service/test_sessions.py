"""Sessions: cookies, their end, and that none is fixed beforehand."""

from __future__ import annotations

import re
from typing import Any

import pytest
from fastapi.testclient import TestClient
from sqlalchemy import select
from tests.service.conftest import NewService
from tests.service.people import PASSWORD, anonymous, form_token, new_user, signed_in

from ballscrew.service import access, reading, sessions
from ballscrew.service.app import create_app
from ballscrew.service.serving import Service
from ballscrew.service.tokens import create_token, revoke_token
from ballscrew.service.users import change_role, disable_user
from ballscrew.store.opened import record
from ballscrew.store.service_tables import UserSession
from ballscrew.store.store import Store


@pytest.fixture
def service(new_service: NewService) -> Service:
    """A service off loopback with users."""
    found = new_service(host="0.0.0.0", allow_plain_http=True)  # noqa: S104
    new_user(found, "anna", "admin")
    new_user(found, "berta", "maintainer")
    return found


def cookie(answer: Any) -> tuple[str, str, set[str]]:
    """Name, value and attributes of the cookie of an answer."""
    first, *attributes = answer.headers["Set-Cookie"].split("; ")
    name, _, value = first.partition("=")
    return name, value, set(attributes)


def sign_in(client: TestClient, name: str = "anna") -> Any:
    return client.post("/sign-in", data={"name": name, "password": PASSWORD})


def move(service: Service, **shift: float) -> None:
    """Move times of all sessions."""
    with service.store.write("test") as session:
        for row in session.scalars(select(UserSession)):
            for name, seconds in shift.items():
                setattr(row, name, getattr(row, name) + seconds)


def test_the_cookie_is_for_this_host_and_not_for_scripts(service: Service) -> None:
    with anonymous(service) as client:
        name, value, attributes = cookie(sign_in(client))
    assert (name, attributes) == ("ballscrew", {"HttpOnly", "Path=/", "SameSite=lax"})
    assert re.fullmatch(r"[\w-]{43}", value)  # 256 bits
    assert value.encode() not in service.store.folder.sqlite.read_bytes()


def test_under_tls_the_cookie_is_secure_and_no_other_is_read(service: Service) -> None:
    options: dict[str, Any] = {"headers": {"Origin": "https://plant"}, "follow_redirects": False}
    with TestClient(create_app(service), base_url="https://plant", **options) as client:
        name, value, attributes = cookie(sign_in(client))
        assert (name, attributes) == ("__Host-ballscrew", {"HttpOnly", "Path=/", "SameSite=lax", "Secure"})
        assert client.get("/account").status_code == 200
        client.cookies.clear()
        assert client.get("/account", headers={"Cookie": f"ballscrew={value}"}).status_code == 303


def test_behind_a_proxy_that_encrypts_the_cookie_is_secure(new_service: NewService) -> None:
    """Also where the proxy does not forward the scheme."""
    service = new_service(public_url="https://plant")
    new_user(service, "anna", "admin")
    with anonymous(service) as client:
        name, value, attributes = cookie(sign_in(client))
        assert (name, "Secure" in attributes) == ("__Host-ballscrew", True)
        assert client.get("/account", headers={"Cookie": f"{name}={value}"}).status_code == 200


def test_a_sign_in_gives_a_new_session_and_ends_the_one_before(service: Service) -> None:
    with anonymous(service) as client:
        client.cookies.set("ballscrew", "chosen-by-an-attacker")
        _, first, _ = cookie(sign_in(client))
        _, second, _ = cookie(sign_in(client))
    assert len({"chosen-by-an-attacker", first, second}) == 3
    with anonymous(service) as client:
        for value, status in ((first, 303), ("chosen-by-an-attacker", 303), (second, 200)):
            assert client.get("/account", headers={"Cookie": f"ballscrew={value}"}).status_code == status


@pytest.mark.parametrize("value", ["", "x", "x" * 5000, "é", '"', "a=b", "0" * 43])
def test_what_is_no_session_is_none(service: Service, value: str) -> None:
    with anonymous(service) as client:
        given: Any = {"Cookie": f"ballscrew={value}".encode("latin-1")}
        assert client.get("/account", headers=given).status_code == 303
        assert client.get("/api/v1/axes", headers=given).status_code == 401


def test_a_session_ends_when_nobody_uses_it_and_after_its_longest_time(service: Service) -> None:
    with signed_in(service, "anna") as client:
        move(service, used=-11 * 3600)
        assert client.get("/account").status_code == 200  # which counts as use
        move(service, used=-11 * 3600)
        part = {"HX-Request": "true"}
        assert client.get("/alarms", headers=part).status_code == 200  # which does not
        assert client.get("/api/v1/axes").status_code == 200
        move(service, used=-2 * 3600)
        assert client.get("/alarms", headers=part).status_code == 401
        assert client.get("/api/v1/axes").status_code == 401
        sign_in(client)
        move(service, begun=-30 * 86400 - 1)
        assert client.get("/account").status_code == 303
        sign_in(client)
    with service.store.read() as session:
        assert len(session.scalars(select(UserSession)).all()) == 1  # others are removed
    assert Store.verify(service.store.path).faults == ()


def test_signing_out_ends_the_session_itself(service: Service) -> None:
    with signed_in(service, "anna") as client:
        value = client.cookies["ballscrew"]
        answer = client.post("/sign-out")
        assert (answer.status_code, answer.headers["Location"]) == (303, "/sign-in")
        assert cookie(answer)[1] == '""'
        assert client.get("/account", headers={"Cookie": f"ballscrew={value}"}).status_code == 303


def test_a_new_role_and_disabling_end_all_sessions(service: Service) -> None:
    with signed_in(service, "berta") as client:
        change_role(service.store, "berta", "maintainer")  # as it is
        assert client.get("/account").status_code == 200
        change_role(service.store, "berta", "viewer")
        assert client.get("/account").status_code == 303
        sign_in(client, "berta")
        disable_user(service.store, "berta")
        assert client.get("/account").status_code == 303
        disable_user(service.store, "berta", undo=True)
        assert client.get("/account").status_code == 303


@pytest.mark.parametrize("role", ["maintainer", "admin"])
def test_a_stream_of_changes_ends_with_the_session(
    service: Service, monkeypatch: pytest.MonkeyPatch, role: str
) -> None:
    """Changes of users are in that of an administrator alone."""
    monkeypatch.setattr(reading, "_QUIET", 0.0)
    monkeypatch.setattr(reading, "_POLL", 0.01)
    looks = []

    def look(service: Service, number: int) -> bool:
        looks.append(number)
        if len(looks) == 3:
            disable_user(service.store, "carl")
        return sessions.is_session_open(service, number)

    monkeypatch.setattr(access, "is_session_open", look)
    with service.store.write("test") as session:
        record(session, "set up", "axis bench")
    with signed_in(service, "carl", role) as client:
        text = client.get("/api/v1/events", headers={"Last-Event-ID": "0"}).text
    assert len(looks) == 3
    assert '"subject": "axis bench"' in text
    assert ('"subject": "user carl"' in text) == (role == "admin")


@pytest.mark.parametrize("is_local", [False, True])
def test_a_stream_of_changes_ends_with_the_token_and_at_this_computer_with_the_first_user(
    new_service: NewService, monkeypatch: pytest.MonkeyPatch, is_local: bool
) -> None:
    monkeypatch.setattr(reading, "_QUIET", 0.0)
    monkeypatch.setattr(reading, "_POLL", 0.01)
    service, looks, headers = new_service(), [], {"Last-Event-ID": "0"}
    number, text = create_token(service.store, None, role="viewer")
    if not is_local:
        headers["Authorization"] = f"Bearer {text}"

    def look(service: Service, caller: access.Caller) -> bool:
        looks.append(caller.name)
        if len(looks) == 3 and is_local:
            new_user(service, "anna", "admin")
        elif len(looks) == 3:
            revoke_token(service.store, number)
        elif len(looks) > 3:
            service.stopping.set()
        return access.is_admitted(service, caller)

    monkeypatch.setattr(reading, "is_admitted", look)
    with anonymous(service) as client:
        assert client.get("/api/v1/events", headers=headers).status_code == 200
    assert looks == ["local" if is_local else f"token {number}"] * 3


def test_a_damaged_store_is_read_by_those_who_have_signed_in(service: Service) -> None:
    with signed_in(service, "anna") as client:
        move(service, used=-3600)
        service.store.folder.mark_damaged(["a row differs"])
        assert client.get("/").status_code == 200


def test_on_loopback_everybody_is_the_administrator_until_there_is_a_user(new_service: NewService) -> None:
    service = new_service()
    with anonymous(service) as client:
        assert client.get("/users").status_code == 200
        assert client.get("/account").status_code == 403  # of nobody
        assert "There is no user yet" in client.get("/users").text
        assert client.get("/sign-in").headers["Location"] == "/"
        new_user(service, "anna", "admin")
        for path in ("/users", "/"):
            assert client.get(path).status_code == 303
        assert client.get("/api/v1/axes").status_code == 401
        assert client.get("/livez").status_code == 200
    with signed_in(service, "anna") as client:
        assert form_token(client)
        assert client.get("/users").status_code == 200


def test_login_can_be_required_on_loopback_too(new_service: NewService) -> None:
    with anonymous(new_service(require_login=True)) as client:
        assert client.get("/").headers["Location"] == "/sign-in?next=%2F"
        assert client.get("/api/v1/axes").status_code == 401
