"""What a store that is served answers when it is damaged."""

from __future__ import annotations

from tests.service.people import PASSWORD, anonymous, new_user, signed_in

from ballscrew.service.serving import Service


def test_a_damaged_store_is_read_and_a_sign_in_is_refused_without_its_folder(service: Service) -> None:
    new_user(service, "anna", "admin")
    client = signed_in(service, "anna")
    service.store.folder.mark_damaged(["database: a row is missing"])
    with anonymous(service) as other:
        answer = other.post("/sign-in", data={"name": "anna", "password": PASSWORD})
    assert answer.status_code == 503
    assert "the store is damaged and only read" in answer.text
    assert str(service.store.path) not in answer.text
    assert client.get("/").status_code == 200
