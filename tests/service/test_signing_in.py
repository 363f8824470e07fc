"""Attempts to sign in: pauses, the audit, links, and changes of passwords."""

from __future__ import annotations

import threading
import unicodedata
from typing import Any

import pytest
from argon2 import PasswordHasher
from sqlalchemy import select
from tests.service.conftest import NewService
from tests.service.people import PASSWORD, anonymous, new_user, signed_in

from ballscrew.service import passwords, signing_in, users
from ballscrew.service.server import _print_first_link
from ballscrew.service.serving import RefusedError, Service
from ballscrew.service.signing_in import Throttle
from ballscrew.service.users import add_user, disable_user, first_link, new_link
from ballscrew.store.service_tables import User
from ballscrew.store.store import Store
from ballscrew.store.tables import Audit


@pytest.fixture
def service(new_service: NewService) -> Service:
    """A service with a user anna."""
    found = new_service()
    new_user(found, "Anna", "admin")
    return found


def try_to(throttle: Throttle, name: str = "anna", address: str = "192.0.2.1") -> int:
    """Seconds to wait before another attempt; 0 if this one was counted."""
    try:
        throttle.begin(name, address)
    except RefusedError as error:
        return int(error.headers["Retry-After"])
    return 0


def test_each_attempt_at_a_name_waits_longer() -> None:
    at = [1000.0]
    throttle = Throttle(lambda: at[0])
    assert [try_to(throttle, address=f"192.0.2.{each}") for each in range(6)] == [0] * 6
    pauses = []
    for each in range(8):
        pauses.append(try_to(throttle, " ANNA", f"198.51.100.{each}"))
        at[0] += pauses[-1]
        assert try_to(throttle, address=f"203.0.113.{each}") == 0
    assert pauses == [2, 4, 8, 16, 32, 60, 60, 60]
    assert try_to(throttle, "berta") == 0  # another name has no part in it
    at[0] += 60 + 901
    assert [try_to(throttle, address=f"192.0.2.{each}") for each in range(6)] == [0] * 6


def test_each_attempt_from_an_address_waits_longer() -> None:
    at = [0.0]
    throttle = Throttle(lambda: at[0])
    assert [try_to(throttle, f"name {each}") for each in range(21)] == [0] * 21
    assert try_to(throttle, "another") == 2
    assert try_to(throttle, "another", "192.0.2.2") == 0
    for each in range(20):
        at[0] += try_to(throttle, f"more {each}")
        assert try_to(throttle, f"still more {each}") == 0
    assert try_to(throttle, "another") == 900


def test_each_way_to_write_a_name_is_the_same_name() -> None:
    throttle = Throttle(lambda: 0.0)
    ways = [
        "J\u00fcr\u00e9",
        "Ju\u0308r\u00e9",
        "J\u00fcre\u0301",
        "Ju\u0308re\u0301",
        " J\u00dcR\u00c9",
        "j\u00fcr\u00e9",
    ]
    for each, way in enumerate(ways):
        assert try_to(throttle, way, f"192.0.2.{each}") == 0
    assert try_to(throttle, ways[0], "198.51.100.1") == 2


def test_no_long_text_is_normalised(service: Service, monkeypatch: pytest.MonkeyPatch) -> None:
    """The time of it grows with the square of the length, and nothing else runs meanwhile."""
    lengths = []

    def normalise(form: str, text: str) -> str:
        lengths.append(len(text))
        return str(normalize(form, text))

    normalize = unicodedata.normalize
    monkeypatch.setattr(unicodedata, "normalize", normalise)
    long = "a" + "\u0301\u0323" * 4000
    with anonymous(service) as client:
        for name, password in (("Anna", long), (long, PASSWORD)):
            assert client.post("/sign-in", data={"name": name, "password": password}).status_code == 401
    assert lengths
    assert max(lengths) < 5000


def test_a_network_of_version_6_is_one_address_and_mapped_ones_are_not() -> None:
    throttle = Throttle(lambda: 0.0)
    for each in range(21):
        assert try_to(throttle, f"name {each}", f"2001:db8::{each}") == 0
        assert try_to(throttle, f"mapped {each}", f"::ffff:192.0.2.{each}") == 0
    assert try_to(throttle, "another", "2001:db8::ffff") == 2
    assert try_to(throttle, "another", "2001:db8:0:1::1") == 0


def test_success_forgets_the_failures_of_a_name_but_not_those_of_an_address() -> None:
    throttle = Throttle(lambda: 0.0)
    for each in range(40):
        if try_to(throttle, "anna") == 0:
            throttle.succeed("anna", "192.0.2.1")
        assert (try_to(throttle, f"name {each}") == 0) == (each <= 20)


def test_attempts_at_once_are_all_counted() -> None:
    throttle = Throttle(lambda: 0.0)
    waits: list[int] = []
    threads = [threading.Thread(target=lambda: waits.append(try_to(throttle))) for _ in range(20)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sorted(waits) == [0] * 6 + [2] * 14


def test_the_memory_of_attempts_is_bounded() -> None:
    throttle = Throttle(lambda: 0.0)
    for each in range(12_000):
        throttle.begin(f"name {each}", f"10.{each >> 16}.{each >> 8 & 255}.{each & 255}")
    assert len(throttle._known) == 10_000


def audit_of(service: Service, action: str) -> list[tuple[str, dict[str, Any]]]:
    with service.store.read() as session:
        rows = session.scalars(select(Audit).where(Audit.action == action).order_by(Audit.id)).all()
        return [(row.subject, row.detail) for row in rows]


def test_attempts_are_in_the_audit_with_their_address_and_no_text_that_is_no_name(service: Service) -> None:
    with anonymous(service) as client:
        for name in ("Anna", "my secret password"):
            answer = client.post("/sign-in", data={"name": name, "password": "wrong"})
            assert answer.status_code == 401
            assert "The name or the password is wrong." in answer.text
            assert "wrong</" not in answer.text.replace("is wrong.</", "")
    signed_in(service, "anna").close()
    refused = audit_of(service, "refuse sign-in")
    assert [subject for subject, _ in refused] == ["user Anna", "somebody unknown"]
    assert {detail["address"] for _, detail in refused} == {"testclient"}
    ((subject, detail),) = audit_of(service, "sign in")
    assert (subject, detail["by"], detail["address"]) == ("user Anna", "Anna", "testclient")
    assert b"secret password" not in service.store.folder.sqlite.read_bytes()
    assert Store.verify(service.store.path).faults == ()


def test_too_many_attempts_are_429_also_with_the_password(service: Service) -> None:
    with anonymous(service) as client:
        for _ in range(6):
            assert client.post("/sign-in", data={"name": "anna", "password": "wrong"}).status_code == 401
        answer = client.post("/sign-in", data={"name": "anna", "password": PASSWORD})
    assert (answer.status_code, answer.headers["Retry-After"]) == (429, "2")
    assert "Too many attempts to sign in: try again in 2 s." in answer.text


def test_a_hash_is_renewed_when_its_parameters_change(
    service: Service, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(passwords, "hasher", PasswordHasher(time_cost=2, memory_cost=8, parallelism=1))
    for _ in range(2):
        signed_in(service, "anna").close()
        with service.store.read() as session:
            assert "t=2" in str(session.scalar(select(User.password)))


def test_who_is_disabled_or_has_no_password_is_refused_as_one_who_is_unknown(service: Service) -> None:
    new_user(service, "berta", "viewer")
    disable_user(service.store, "berta")
    add_user(service.store, "carl", "viewer")
    sentences = set()
    with anonymous(service) as client:
        for name in ("berta", "carl", "nobody", ""):
            answer = client.post("/sign-in", data={"name": name, "password": PASSWORD})
            assert answer.status_code == 401
            sentences.add(answer.text.replace(f'value="{name}"', ""))
    assert len(sentences) == 1


def follow(service: Service, link: str, **values: str) -> Any:
    with anonymous(service) as client:
        return client.post(f"/link/{link}", data={"password": PASSWORD, "again": PASSWORD} | values)


def test_a_link_is_valid_once_and_for_a_day(service: Service, monkeypatch: pytest.MonkeyPatch) -> None:
    link = add_user(service.store, "berta", "viewer")
    assert follow(service, link, again="another password").status_code == 422
    assert follow(service, link, password="x" * 11, again="x" * 11).status_code == 422
    assert follow(service, link, name="Anna").status_code == 303  # the name of another has no effect
    assert follow(service, link).status_code == 404
    signed_in(service, "berta").close()
    old, new = new_link(service.store, "berta"), new_link(service.store, "berta")
    assert follow(service, old).status_code == 404
    begun = users.time.time()
    monkeypatch.setattr(users.time, "time", lambda: begun + 24 * 3600 + 1)
    assert follow(service, new).status_code == 404
    monkeypatch.undo()
    disable_user(service.store, "berta")
    assert follow(service, new).status_code == 404
    assert new not in str(audit_of(service, "link"))


def test_a_password_that_was_replaced_meanwhile_is_not_changed_again(
    service: Service, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Who knows the old password has lost the account once its owner has chosen another one."""
    other = passwords.hash_password("chosen by the owner")

    def verify(password: str, stored: str | None) -> bool:  # noqa: ARG001  as it is called
        with service.store.write("test") as session:
            session.scalars(select(User).where(User.name == "Anna")).one().password = other
        return True

    with signed_in(service, "Anna") as client:
        monkeypatch.setattr("ballscrew.service.signing_in.is_password", verify)
        values = {"old": PASSWORD, "password": "of an intruder", "again": "of an intruder"}
        assert client.post("/account/password", data=values).status_code == 422
    with service.store.read() as session:
        assert session.scalars(select(User.password).where(User.name == "Anna")).one() == other


def test_a_link_of_a_user_who_forgot_ends_the_sessions(service: Service) -> None:
    with signed_in(service, "anna") as client:
        link = new_link(service.store, "anna")
        assert client.get("/account").status_code == 200
        changed = "another good password"
        assert follow(service, link, password=changed, again=changed).status_code == 303
        assert client.get("/account").status_code == 303


def test_the_first_administrator_chooses_a_name(new_service: NewService) -> None:
    service = new_service(require_login=True)
    old, link = first_link(service.store), first_link(service.store)
    assert old is not None
    assert link is not None
    with anonymous(service) as client:
        assert "You become the first administrator" in client.get(f"/link/{link}").text
        assert client.get(f"/link/{old}").status_code == 404
    for name in ("", " ", "x" * 81, "a\u202eb", "a\nb", "local", "Token 1"):
        assert follow(service, link, name=name).status_code == 422, name
    assert follow(service, link, name=" Anna ").status_code == 303
    assert first_link(service.store) is None
    assert [each["name"] for each in users.list_users(service.store)] == ["Anna"]


def test_the_first_link_ends_with_another_administrator(new_service: NewService) -> None:
    service = new_service(require_login=True)
    link = first_link(service.store)
    assert link is not None
    new_user(service, "anna", "admin")
    assert follow(service, link, name="eve").status_code == 404


@pytest.mark.parametrize(
    ("settings", "is_printed"),
    [({}, False), ({"require_login": True}, True), ({"host": "0.0.0.0", "allow_plain_http": True}, True)],  # noqa: S104
)
def test_a_server_prints_the_first_link_until_there_is_a_user(
    new_service: NewService, capsys: pytest.CaptureFixture[str], settings: dict[str, Any], is_printed: bool
) -> None:
    service = new_service(**settings)
    _print_first_link(service, 8123)
    assert (":8123/link/" in capsys.readouterr().out) == is_printed
    new_user(service, "anna", "admin")
    _print_first_link(service, 8123)
    assert capsys.readouterr().out == ""


def test_a_password_that_is_changed_during_a_sign_in_is_no_longer_right(
    service: Service, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nor is that of a user who is disabled meanwhile."""

    def check(password: str, stored: str | None) -> bool:
        change()
        return is_password(password, stored)

    def change_hash() -> None:
        with service.store.write("test") as session:
            user = session.scalars(select(User).where(User.name == "Anna")).one()
            user.password = passwords.hash_password("another good password")

    is_password = signing_in.is_password
    new_user(service, "Berta", "admin")
    for change in (change_hash, lambda: disable_user(service.store, "Anna")):
        with anonymous(service) as client:
            monkeypatch.setattr(signing_in, "is_password", check)
            password = PASSWORD if change is change_hash else "another good password"
            answer = client.post("/sign-in", data={"name": "Anna", "password": password})
            assert (answer.status_code, client.cookies) == (401, {})
            assert "The name or the password is wrong." in answer.text


def test_a_link_that_is_used_at_the_same_time_by_another_has_ended(
    service: Service, monkeypatch: pytest.MonkeyPatch
) -> None:
    link = add_user(service.store, "Carl", "viewer")
    hash_password = signing_in.hash_password

    def hash_later(password: str) -> str:
        monkeypatch.setattr(signing_in, "hash_password", hash_password)
        with anonymous(service) as other:
            values = {"password": PASSWORD, "again": PASSWORD}
            assert other.post(f"/link/{link}", data=values).status_code == 303
        return hash_password(password)

    monkeypatch.setattr(signing_in, "hash_password", hash_later)
    values = {"password": "another good password", "again": "another good password"}
    with anonymous(service) as client:
        assert client.post(f"/link/{link}", data=values).status_code == 404
        answer = client.post("/sign-in", data={"name": "Carl", "password": PASSWORD})
        assert answer.status_code == 303
