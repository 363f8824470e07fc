"""What a store that is served answers when it is damaged."""

from __future__ import annotations

import importlib
import importlib.util
import sqlite3

import pytest
from fastapi.testclient import TestClient
from sqlalchemy.orm import Session
from tests.service.conftest import SETUP
from tests.service.people import PASSWORD, anonymous, new_user, signed_in

from ballscrew.base.errors import InputError
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


@pytest.mark.parametrize(("error", "status"), [("database or disk is full", 507), ("disk I/O error", 503)])
def test_a_request_is_to_be_repeated_after_an_error_of_the_database(
    client: TestClient, monkeypatch: pytest.MonkeyPatch, error: str, status: int
) -> None:
    def fail(*_: object) -> None:
        raise sqlite3.OperationalError(error)

    monkeypatch.setattr(Session, "flush", fail)
    answer = client.put("/api/v1/axes/bench", json=SETUP | {"site": "hall 9"})
    assert answer.status_code == status
    assert int(answer.headers["Retry-After"]) > 0
    monkeypatch.undo()
    assert client.put("/api/v1/axes/bench", json=SETUP).status_code == 200


def test_the_service_says_which_packages_it_needs(monkeypatch: pytest.MonkeyPatch) -> None:
    import ballscrew.service

    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None if name == "uvicorn" else name)
    with pytest.raises(InputError, match=r'install them by python -m pip install "ballscrew\[server\]"'):
        importlib.reload(ballscrew.service)
