"""Users: by functions and by command, beside a running server."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from sqlalchemy import select
from tests.service.conftest import NewService
from tests.service.people import PASSWORD, anonymous, new_user, signed_in

from ballscrew.base.errors import InputError
from ballscrew.cli import shell
from ballscrew.service.server import check
from ballscrew.service.serving import Service
from ballscrew.service.settings import ServerSettings
from ballscrew.service.tokens import create_token, revoke_token
from ballscrew.service.users import (
    ADDRESS_FILE,
    add_user,
    address_last_served,
    address_of_server,
    change_role,
    disable_user,
    first_link,
    list_users,
    new_link,
)
from ballscrew.store.folder import DataFolder, now
from ballscrew.store.service_tables import User
from ballscrew.store.store import Store
from ballscrew.store.tables import Audit


def test_the_first_user_is_an_administrator(service: Service) -> None:
    with pytest.raises(InputError, match="first user must be an administrator"):
        add_user(service.store, "berta", "viewer")
    add_user(service.store, "anna", "admin")
    add_user(service.store, "berta", "viewer")
    assert [(each["name"], each["link"]) for each in list_users(service.store)] == [
        ("anna", True),
        ("berta", True),
    ]


@pytest.mark.parametrize(
    ("name", "role", "sentence"),
    [
        ("", "admin", "1 to 80 printable"),
        ("x" * 81, "admin", "1 to 80 printable"),
        ("a\x00b", "admin", "1 to 80 printable"),
        ("a\u202eb", "admin", "1 to 80 printable"),
        ("LOCAL", "admin", "the audit uses it"),
        ("token 7", "admin", "the audit uses it"),
        ("anna", "owner", "must be one of viewer, maintainer, admin"),
        ("ÄNNE ", "viewer", "there is a user 'ÄNNE' already"),
        ("A\u0308nne", "viewer", "already"),
    ],
)
def test_a_wrong_user_is_one_sentence(service: Service, name: str, role: str, sentence: str) -> None:
    add_user(service.store, "Änne", "admin")
    with pytest.raises(InputError, match=sentence):
        add_user(service.store, name, role)
    assert len(list_users(service.store)) == 1


def test_the_last_administrator_stays(service: Service) -> None:
    new_user(service, "anna", "admin")
    add_user(service.store, "berta", "admin")  # who has no password yet
    for change in (
        lambda: disable_user(service.store, "anna"),
        lambda: change_role(service.store, "anna", "viewer"),
    ):
        with pytest.raises(InputError, match="'anna' is the last administrator"):
            change()
    new_user(service, "carl", "admin")
    disable_user(service.store, "anna")
    with pytest.raises(InputError, match="'anna' is disabled"):
        new_link(service.store, "anna")
    with pytest.raises(InputError, match="last administrator"):
        change_role(service.store, "carl", "viewer")


def test_every_change_is_in_the_audit(service: Service) -> None:
    new_user(service, "anna", "admin")
    add_user(service.store, "berta", "viewer", by="anna")
    change_role(service.store, "berta", "maintainer", by="anna")
    new_link(service.store, "berta", by="anna")
    disable_user(service.store, "berta", by="anna")
    disable_user(service.store, "berta", undo=True, by="anna")
    with service.store.read() as session:
        rows = session.scalars(select(Audit).where(Audit.subject == "user berta").order_by(Audit.id)).all()
    actions = ["create", "link", "change role", "link", "disable", "enable"]
    assert [(row.action, row.detail["by"]) for row in rows] == [(each, "anna") for each in actions]
    assert (rows[2].detail["old"], rows[2].detail["new"]) == ("viewer", "maintainer")


@pytest.mark.parametrize(
    ("settings", "address"),
    [
        ({}, "http://127.0.0.1:8000"),
        ({"public_url": "https://plant.example/"}, "https://plant.example"),
        ({"host": "::1", "port": 81}, "http://[::1]:81"),
        ({"host": "0.0.0.0", "allowed_hosts": ("plant.example", "x")}, "http://plant.example:8000"),  # noqa: S104
        ({"certificate": Path("a"), "private_key": Path("b")}, "https://127.0.0.1:8000"),
    ],
)
def test_a_link_has_the_address_of_the_server(settings: dict[str, object], address: str) -> None:
    assert address_of_server(ServerSettings(**settings)) == address  # type: ignore[arg-type]  # of each setting


def test_a_link_has_the_address_at_which_the_server_was_started(tmp_path: Path) -> None:
    settings = ServerSettings()
    assert address_last_served(tmp_path, settings) == "http://127.0.0.1:8000"
    (tmp_path / ADDRESS_FILE).write_text("http://127.0.0.1:8102", encoding="utf-8")
    assert address_last_served(tmp_path, settings) == "http://127.0.0.1:8102"
    public = ServerSettings(public_url="https://plant.example/")
    assert address_last_served(tmp_path, public) == "https://plant.example"


def test_users_are_managed_by_command_beside_a_server(
    new_service: NewService, capsys: pytest.CaptureFixture[str]
) -> None:
    service = new_service()
    data = ["--data", str(service.store.path)]

    def run(*arguments: str) -> tuple[int, str, str]:
        status = shell.run(["user", *arguments, *data])
        printed = capsys.readouterr()
        return status, printed.out, printed.err

    with DataFolder(service.store.path).locked("serve", serving=True), anonymous(service) as client:
        status, out, err = run("add", "anna", "--role", "admin")
        assert (status, err) == (0, "Valid once, for 24 h; it cannot be printed again.\n")
        link = re.fullmatch(r"http://127\.0\.0\.1:8000(/link/\S+)\n", out)
        assert link is not None
        answer = client.post(link[1], data={"password": PASSWORD, "again": PASSWORD})
        assert answer.status_code == 303
        assert run("add", "berta", "--json")[0] == 0
        assert run("role", "berta", "maintainer")[:2] == (0, "berta: maintainer.\n")
        assert run("disable", "berta")[:2] == (0, "Disabled: berta.\n")
        assert run("disable", "berta", "--undo")[:2] == (0, "Enabled: berta.\n")
        status, out, _ = run("link", "berta", "--json")
        assert json.loads(out)["link"].startswith("http://127.0.0.1:8000/link/")
        found = json.loads(run("list", "--json")[1])["users"]
        assert [(each["name"], each["role"]) for each in found] == [
            ("anna", "admin"),
            ("berta", "maintainer"),
        ]
        assert "berta" in run("list")[1]
        for wrong, sentence in {
            ("link", "carl"): "no user 'carl'",
            ("role", "berta", "x"): "must be one of",
            ("disable", "anna"): "last administrator",
        }.items():
            status, out, err = run(*wrong)
            assert (status, out) == (2, "")
            assert sentence in err
            assert err.count("\n") == 1
    signed_in(service, "anna").close()


def test_the_settings_of_sessions_are_checked(tmp_path: Path) -> None:
    settings, problems = check(tmp_path, require_login=True, session_idle_h=1.0)
    assert (settings["session_idle_h"], problems) == ((1.0, "option"), [])
    for wrong in ({"session_idle_h": 0}, {"session_days": 366}):
        with pytest.raises(InputError, match="session_"):
            check(tmp_path, **wrong)  # type: ignore[arg-type]


def test_users_tokens_and_sessions_are_in_a_backup(new_service: NewService, tmp_path: Path) -> None:
    """On another computer: the same password, token and cookie are valid, and a revoked token is not."""
    service = new_service(host="0.0.0.0", allow_plain_http=True)  # noqa: S104
    browser = signed_in(service, "anna", "maintainer")
    number, revoked = create_token(service.store, None, role="viewer", name="old")
    _, token = create_token(service.store, None, role="viewer", name="dashboard")
    revoke_token(service.store, number)
    Store.restore(Store(service.store.path).backup(tmp_path / "backup"), tmp_path / "elsewhere")
    other = new_service(tmp_path / "elsewhere", host="0.0.0.0", allow_plain_http=True)  # noqa: S104
    assert list_users(other.store) == list_users(service.store)
    with anonymous(other, cookies=browser.cookies) as client:
        assert client.get("/").status_code == 200
        client.cookies.clear()
        statuses = []
        for text in (token, revoked):
            answer = client.get("/api/v1/axes", headers={"Authorization": f"Bearer {text}"})
            statuses.append(answer.status_code)
        assert statuses == [200, 401]
    assert signed_in(other, "anna").get("/").status_code == 200


def test_a_user_who_is_disabled_already_stays_so_without_another_line_of_the_audit(service: Service) -> None:
    for name in ("anna", "berta"):
        new_user(service, name, "admin")
    for undo in (False, True):
        for _ in range(2):
            disable_user(service.store, "berta", undo=undo)
        (found,) = [each for each in list_users(service.store) if each["name"] == "berta"]
        assert (found["disabled_at"] is None) is undo
    with service.store.read() as session:
        rows = session.scalars(select(Audit.action).where(Audit.subject == "user berta")).all()
    assert [action for action in rows if action in ("disable", "enable")] == ["disable", "enable"]


def test_the_first_administrator_chooses_a_name_that_no_other_user_has(service: Service) -> None:
    link = first_link(service.store)
    with service.store.write("test") as session:
        session.add(User(name="anna", role="viewer", password=None, created_at=now(), disabled_at=None))
    with anonymous(service) as client:
        values = {"name": "ANNA", "password": PASSWORD, "again": PASSWORD}
        answer = client.post(f"/link/{link}", data=values)
        assert answer.status_code == 422
        assert "there is a user &#39;ANNA&#39; already." in answer.text
        assert client.post(f"/link/{link}", data=values | {"name": "berta"}).status_code == 303
