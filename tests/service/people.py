"""Users who have signed in, as clients with the cookie of a session and the token of its forms."""

from __future__ import annotations

import re
from typing import Any

from fastapi import FastAPI
from fastapi.testclient import TestClient
from sqlalchemy import select

from ballscrew.service.app import create_app
from ballscrew.service.passwords import hash_password
from ballscrew.service.serving import Service
from ballscrew.service.users import add_user, choose_password, list_users
from ballscrew.store.service_tables import User

PASSWORD = "correct horse battery"  # noqa: S105  of tests
OWN = {"Origin": "http://localhost"}


def anonymous(service: Service, **options: Any) -> TestClient:
    """A browser without a session, which follows no redirect."""
    base = options.pop("base_url", "http://localhost")
    return TestClient(app_of(service), base_url=base, headers=OWN, follow_redirects=False, **options)


def app_of(service: Service) -> FastAPI:
    """Application of a service, the same for all its clients."""
    found: FastAPI = vars(service).get("tested_app") or create_app(service)
    vars(service)["tested_app"] = found
    return found


def form_token(client: TestClient) -> str:
    """Token of the forms of a session, by a page."""
    (found,) = re.findall('<meta name="csrf" content="([^"]+)">', client.get("/help").text)
    return str(found)


def new_user(service: Service, name: str, role: str) -> None:
    """Add a user who has chosen a password; before the first one, an administrator."""
    if role != "admin" and not list_users(service.store):
        new_user(service, "first", "admin")
    add_user(service.store, name, role)
    with service.store.write("test") as session:
        user = session.scalars(select(User).where(User.name == name)).one()
        choose_password(session, user, "", hash_password(PASSWORD))


def signed_in(service: Service, name: str, role: str | None = None) -> TestClient:
    """Client of a user, who is added with a role where one is given."""
    if role is not None:
        new_user(service, name, role)
    client = anonymous(service)
    answer = client.post("/sign-in", data={"name": name, "password": PASSWORD})
    assert answer.status_code == 303, answer.text
    client.headers["X-CSRF-Token"] = form_token(client)
    return client
