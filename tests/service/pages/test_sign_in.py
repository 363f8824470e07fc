"""Pages of signing in, of the account, and of users and tokens."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from fastapi.testclient import TestClient
from tests.service.conftest import SETUP, NewService, client_of
from tests.service.pages.forms import HOSTILE, get
from tests.service.people import PASSWORD, anonymous, form_token, new_user, signed_in

from ballscrew.service import pages
from ballscrew.service.serving import Service
from ballscrew.service.tokens import create_token, list_tokens
from ballscrew.service.users import add_user, list_users

TEMPLATES = sorted((Path(pages.__path__[0]) / "templates").glob("*.html"))
OTHER = "another good password"


@pytest.fixture
def service(new_service: NewService) -> Service:
    """A service with an axis and users of each role."""
    found = new_service()
    with client_of(found) as client:
        client.put("/api/v1/axes/bench", json=SETUP)
    for name, role in {"anna": "admin", "max": "maintainer", "vera": "viewer"}.items():
        new_user(found, name, role)
    return found


@pytest.fixture
def admin(service: Service) -> Iterator[TestClient]:
    with signed_in(service, "anna") as client:
        yield client


@pytest.mark.parametrize("template", TEMPLATES, ids=lambda path: path.name)
def test_every_form_that_changes_something_contains_the_token(template: Path) -> None:
    """Those for people without a session have none."""
    forms = re.findall(r"<form [^>]*?(?:method=\"post\"|do\.post).*?</form>", template.read_text(), re.DOTALL)
    for form in forms:
        assert ("{{ form_field }}" in form) == (template.name not in ("sign_in.html", "link.html")), form


def test_there_are_such_forms() -> None:
    assert sum("{{ form_field }}" in path.read_text() for path in TEMPLATES) >= 7


@pytest.mark.parametrize("place", ["/axes/bench?run=1", "//evil.example", "https://evil.example", "/\\evil"])
def test_a_sign_in_leads_to_the_page_that_was_asked_for_and_to_no_other_site(
    service: Service, place: str
) -> None:
    wanted = place if place.startswith("/axes") else "/"
    with anonymous(service) as client:
        page = client.get("/sign-in", params={"next": place}).text
        (field,) = re.findall('name="next" value="([^"]*)"', page)
        assert field == wanted
        values = {"name": "vera", "password": PASSWORD, "next": place}
        assert client.post("/sign-in", data=values).headers["Location"] == wanted
        assert client.get("/sign-in", params={"next": place}).headers["Location"] == wanted


def test_a_wrong_password_shows_the_form_again_without_it(service: Service) -> None:
    with anonymous(service) as client:
        values = {"name": HOSTILE, "password": "a secret", "next": "/alarms"}
        answer = client.post("/sign-in", data=values)
    assert answer.status_code == 401
    assert "The name or the password is wrong." in answer.text
    assert 'value="/alarms"' in answer.text
    assert HOSTILE not in answer.text
    assert "a secret" not in answer.text


def test_pages_for_everybody_show_nothing_of_the_plant(service: Service) -> None:
    link = add_user(service.store, "carl", "viewer")
    with anonymous(service) as client:
        for path in ("/sign-in", f"/link/{link}", "/link/none"):
            text = client.get(path, headers={"Accept": "text/html"}).text
            assert 'href="/status"' not in text, path
            assert "bench" not in text, path
            assert "anna" not in text, path


def test_a_viewer_sees_no_button_of_what_a_viewer_may_not(service: Service) -> None:
    paths = ["/", "/alarms", "/axes/bench", "/axes/bench/actions", "/axes/bench/calibration", "/status"]
    with signed_in(service, "vera") as viewer, signed_in(service, "anna") as admin:
        for path in [*paths, "/help/start", "/compare"]:
            text = get(viewer, path)
            main = text[text.index("<main") : text.index("</main>")]
            assert 'method="post"' not in main, path
            assert 'class="upload"' not in main, path
            assert 'href="/setup"' not in text, path
            assert 'href="/users"' not in text, path
            assert 'href="/messages"' not in text, path
        setup = get(viewer, "/axes/bench/setup")
        assert "<fieldset disabled>" in setup
        assert 'value="save"' not in setup
        assert "Settings" not in get(viewer, "/status")
        assert str(service.store.path) not in get(viewer, "/status")
        assert "<fieldset>" in get(admin, "/axes/bench/setup")
        assert str(service.store.path) in get(admin, "/status")
    with signed_in(service, "max") as maintainer:
        assert "Add the event" in get(maintainer, "/axes/bench/actions")
        assert 'value="save"' not in get(maintainer, "/axes/bench/setup")
        assert "<h2>Calibrate</h2>" not in get(maintainer, "/axes/bench/calibration")


def test_what_was_done_is_by_the_name_of_the_user(service: Service) -> None:
    event = {"at": "2026-01-01T08:00", "kind": "note", "text": "x", "do": "store"}
    with signed_in(service, "max") as client:
        answer = client.post("/axes/bench/actions/events", data=event)
        assert answer.status_code == 303, answer.text
    with signed_in(service, "anna") as client:
        assert '"by": "max"' in _events(client, service)


def _events(client: TestClient, service: Service) -> str:
    service.stopping.set()
    return client.get("/api/v1/events", headers={"Last-Event-ID": "0"}).text


def test_a_password_is_changed_by_one_who_knows_it(service: Service) -> None:
    def change(client: TestClient, old: str, new: str, again: str) -> tuple[int, str]:
        values = {"old": old, "password": new, "again": again}
        answer = client.post("/account/password", data=values)
        assert new not in answer.text
        return answer.status_code, answer.text

    with signed_in(service, "vera") as client, signed_in(service, "vera") as other:
        for values, sentence in {
            ("wrong", OTHER, OTHER): "The present password is wrong.",
            (PASSWORD, OTHER, OTHER[:-1]): "The two passwords differ.",
            (PASSWORD, "x" * 11, "x" * 11): "The password must have 12 characters or more.",
        }.items():
            status, text = change(client, *values)
            assert (status, sentence in text) == (422, True)
        assert other.get("/account").status_code == 200
        before = client.cookies["ballscrew"]
        assert change(client, PASSWORD, OTHER, OTHER)[0] == 303
        assert client.cookies["ballscrew"] != before
        assert "The password is changed" in get(client, "/account?done=password")
        assert other.get("/account").status_code == 303
    with anonymous(service) as client:
        assert client.post("/sign-in", data={"name": "vera", "password": PASSWORD}).status_code == 401
        assert client.post("/sign-in", data={"name": "vera", "password": OTHER}).status_code == 303


def test_a_user_ends_sessions_of_the_own_account_alone(service: Service, admin: TestClient) -> None:
    with signed_in(service, "vera") as client, signed_in(service, "vera") as other:
        assert "Your sessions (2)" in " ".join(get(client, "/account").split())
        for number in ("1", "9", "x", "", "9" * 30):  # the first one is the administrator's
            client.post("/account/sessions", data={"do": "one", "session": number})
        assert admin.get("/account").status_code == other.get("/account").status_code == 200
        (number,) = re.findall('name="session" value="([0-9]+)"', get(client, "/account"))
        client.post("/account/sessions", data={"do": "one", "session": number})
        assert [each.get("/account").status_code for each in (client, other)] == [200, 303]
        third = signed_in(service, "vera")
        client.post("/account/sessions", data={"do": "all"})
        assert [each.get("/account").status_code for each in (client, third)] == [200, 303]
    assert admin.get("/account").status_code == 200


def test_an_administrator_invites_changes_and_disables(service: Service, admin: TestClient) -> None:
    text = admin.post("/users", data={"do": "invite", "name": "Carl <b>", "role": "viewer"}).text
    (link,) = re.findall(r"http://localhost(/link/[\w-]+)", text)
    assert "Link for Carl &lt;b&gt;" in text
    assert link not in get(admin, "/users")  # shown once
    with anonymous(service) as client:
        assert "Carl &lt;b&gt;" in client.get(link).text
        answer = client.post(link, data={"password": OTHER, "again": OTHER})
        assert (answer.status_code, answer.headers["Location"]) == (303, "/")
        assert client.get("/").status_code == 200
        about = {"name": "Carl <b>"}
        for do, words in {
            "role": "The role is changed",
            "disable": "The user is disabled.",
            "enable": "enabled again",
            "sessions": "The sessions have ended.",
        }.items():
            values = about | {"do": do, "role": "maintainer"}
            place = admin.post("/users", data=values).headers["Location"]
            assert words in get(admin, place)
            assert client.get("/").status_code == 303
    (carl,) = (each for each in list_users(service.store) if each["name"] == "Carl <b>")
    assert (carl["role"], carl["disabled_at"]) == ("maintainer", None)


def test_the_link_of_an_invitation_begins_with_the_public_address(
    service: Service, admin: TestClient
) -> None:
    service.settings = service.settings.model_copy(update={"public_url": "https://plant.example/ballscrew/"})
    cookie = {"Cookie": f"__Host-ballscrew={admin.cookies['ballscrew']}"}  # people use TLS there
    body = {"do": "invite", "name": "carl", "role": "viewer"}
    text = admin.post("/users", data=body, headers=cookie).text
    assert re.search(r"https://plant\.example/ballscrew/link/[\w-]+", text)


@pytest.mark.parametrize(
    ("values", "sentence"),
    [
        ({"do": "invite", "name": "anna", "role": "viewer"}, "there is a user &#39;anna&#39; already."),
        ({"do": "invite", "name": "x", "role": "root"}, "the role is &#39;root&#39;"),
        ({"do": "role", "name": "nobody", "role": "viewer"}, "there is no user &#39;nobody&#39;"),
        ({"do": "delete", "name": "anna"}, "The form states nothing to do."),
        ({}, "The form states nothing to do."),
    ],
)
def test_a_wrong_form_of_users_is_one_sentence(
    admin: TestClient, service: Service, values: dict[str, str], sentence: str
) -> None:
    answer = admin.post("/users", data=values)
    assert answer.status_code == 422
    assert sentence in answer.text
    assert len(list_users(service.store)) == 3


def test_tokens_are_created_shown_once_and_revoked(service: Service, admin: TestClient) -> None:
    for values in ({"role": "viewer", "name": "<i>"}, {"machine": "mill 4"}):
        text = admin.post("/users/tokens", data={"do": "create"} | values).text
        (token,) = re.findall(r"<pre[^>]*>(bs_[\w-]+)</pre>", text)
        assert token not in get(admin, "/users")
        assert "<i>" not in get(admin, "/users")
    dashboard = list_tokens(service.store)[0]
    assert (dashboard["role"], dashboard["name"]) == ("viewer", "<i>")
    for wrong in ({}, {"role": "viewer", "machine": "mill 4"}, {"do": "revoke", "token": "x"}):
        assert admin.post("/users/tokens", data={"do": "create"} | wrong).status_code == 422
    answer = admin.post("/users/tokens", data={"do": "revoke", "token": "1"})
    assert answer.headers["Location"] == "/users?done=revoke"
    assert list_tokens(service.store)[0]["revoked_at"] is not None


def test_the_token_of_a_dashboard_reads_pages_and_api_and_changes_nothing(service: Service) -> None:
    _, token = create_token(service.store, None, role="viewer", name="dashboard")
    with anonymous(service) as client:
        client.headers["Authorization"] = f"Bearer {token}"
        assert client.get("/api/v1/axes").status_code == client.get("/metrics").status_code == 200
        assert client.get("/").status_code == 200
        assert client.post("/api/v1/axes/bench/events", json=[]).status_code == 403
        assert client.get("/account").status_code == 403


def test_the_name_leads_to_the_account_and_the_button_out(service: Service, admin: TestClient) -> None:
    text = get(admin, "/")
    assert '<a href="/account">anna</a>' in text
    answer = admin.post("/sign-out", data={"csrf": form_token(admin)})
    assert answer.headers["Location"] == "/sign-in"
    with anonymous(service) as client:
        assert "Sign out" not in client.get("/sign-in").text


def test_an_administrator_makes_a_new_link_for_a_user_who_forgot_the_password(
    service: Service, admin: TestClient
) -> None:
    text = admin.post("/users", data={"do": "link", "name": "vera"}).text
    (link,) = re.findall(r"http://localhost(/link/[\w-]+)<", text)
    with anonymous(service) as client:
        assert client.post(link, data={"password": OTHER, "again": OTHER}).status_code == 303
        assert client.post("/sign-in", data={"name": "vera", "password": OTHER}).status_code == 303
        assert client.get(link).status_code == 404
