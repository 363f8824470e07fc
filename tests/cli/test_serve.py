"""``ballscrew serve``, ``token`` and ``user``: what they call and print."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

from ballscrew.base.jsonfile import SCHEMA


def test_serve_passes_on_what_is_given_and_nothing_else(
    ballscrew, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls: list[tuple[Path | None, dict[str, Any]]] = []
    monkeypatch.setattr(
        "ballscrew.service.server.serve", lambda data, **options: calls.append((data, options))
    )
    assert ballscrew("serve", "--data", tmp_path / "data", "--port", "0").status == 0
    config = tmp_path / "server.toml"
    assert (
        ballscrew(
            "serve", "--data", tmp_path / "data", "--config", config, "--host", "::1", "--workers", "2"
        ).status
        == 0
    )
    assert calls == [
        (tmp_path / "data", {"config": None, "port": 0}),
        (tmp_path / "data", {"config": config, "host": "::1", "workers": 2}),
    ]


def test_a_token_of_a_reader_has_the_role_of_a_viewer_and_its_name(ballscrew, tmp_path: Path) -> None:
    data = ("--data", tmp_path / "data")
    created = ballscrew("token", "create", "--read-only", "dashboard", *data, "--json")
    assert (created.status, created.err) == (0, "")
    text = created.document["token"]
    assert text.startswith("bs_")
    assert created.document == {
        "schema": SCHEMA, "id": 1, "machine": None, "role": "viewer", "token": text,
    }  # fmt: skip
    (row,) = ballscrew("token", "list", *data, "--json").document["tokens"]
    assert (row["role"], row["name"]) == ("viewer", "dashboard")
    revoked = ballscrew("token", "revoke", "1", *data, "--json")
    assert revoked.document == {"schema": SCHEMA, "id": 1, "revoked": True}


def test_users_are_listed_with_their_state(ballscrew, tmp_path: Path) -> None:
    data = ("--data", tmp_path / "data")
    assert ballscrew("user", "add", "anna", "--role", "admin", *data).status == 0
    assert ballscrew("user", "add", "berta", *data).status == 0
    changed = ballscrew("user", "role", "berta", "maintainer", *data, "--json")
    assert changed.document == {"schema": SCHEMA, "name": "berta", "role": "maintainer"}
    disabled = ballscrew("user", "disable", "berta", *data, "--json")
    assert disabled.document == {"schema": SCHEMA, "name": "berta", "disabled": True}
    rows = re.findall(r"^│ (\w+) +│ (\w+) +│ (\w+) +│", ballscrew("user", "list", *data).out, re.MULTILINE)
    assert rows == [("anna", "admin", "invited"), ("berta", "maintainer", "disabled")]
    enabled = ballscrew("user", "disable", "berta", "--undo", *data, "--json")
    assert enabled.document == {"schema": SCHEMA, "name": "berta", "disabled": False}
    assert "disabled" not in ballscrew("user", "list", *data).out
