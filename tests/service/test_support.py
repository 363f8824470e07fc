"""Support bundle: what is in it, and that no secret, measurement or name of a person is."""

from __future__ import annotations

import json
import logging
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sqlalchemy
from pydantic import SecretStr
from sqlalchemy.orm import Session
from tests.service.conftest import client_of
from tests.store.stored import RUNS

from ballscrew.base.errors import InputError
from ballscrew.service import signing_in, support
from ballscrew.service.logs import LOG_FILE, logging_to, read_log
from ballscrew.service.serving import Service
from ballscrew.service.settings import ServerSettings
from ballscrew.service.support import write_bundle
from ballscrew.service.tokens import create_token
from ballscrew.store.checking import verify

PLANTED = ("s3cret-beat", "hunter2", "Erika Mustermann", "mustermann@example.com", "84.3125", "mustermann")


def read(path: Path) -> dict[str, str]:
    with zipfile.ZipFile(path) as bundle:
        assert bundle.testzip() is None
        return {name: bundle.read(name).decode() for name in bundle.namelist()}


@pytest.fixture
def planted(worn_service: Service, monkeypatch: pytest.MonkeyPatch) -> tuple[ServerSettings, str]:
    """Secrets, measurements and names wherever they can be."""
    monkeypatch.setenv("BALLSCREW_SERVER_SECRET", "hunter2")
    monkeypatch.setenv("BALLSCREW_STORE", "/home/Erika Mustermann/plant")
    verify(worn_service.store.path)
    _, token = create_token(worn_service.store, None, role="admin")
    log = logging.getLogger("ballscrew.service")
    with logging_to(worn_service.store.path, "json"), client_of(worn_service) as other:
        note = [{"at": RUNS[0].measured_at, "kind": "note", "text": "Erika Mustermann: 84.3125 Hz"}]
        assert other.post("/api/v1/axes/bench/events", json=note).status_code == 200
        other.get(
            f"/api/v1/axes/Erika Mustermann?token={token}", headers={"Authorization": f"Bearer {token}"}
        )
        other.get(f"/api/v1/runs/{token}")
        log.warning("%s %s: %s", "analyse", "mustermann@example.com", "84.3125 Hz is too high")
        try:
            raise ValueError("84.3125 Hz, hunter2, of Erika Mustermann")
        except ValueError:
            log.exception("worker %d", 1)
    settings = ServerSettings(
        heartbeat_url=SecretStr("https://example.com/s3cret-beat"),
        allowed_hosts=("Erika Mustermann",),
        certificate=Path("/home/Erika Mustermann/cert.pem"),
    )
    return settings, token


def test_the_bundle_has_no_secret_no_measurement_and_no_name(
    worn_service: Service, planted: tuple[ServerSettings, str], tmp_path: Path
) -> None:
    log = (worn_service.store.path / LOG_FILE).read_text(encoding="utf-8")
    assert "84.3125" in log
    assert "Erika Mustermann" in log
    origins = {"heartbeat_url": "/home/Erika Mustermann/server.toml", "port": "option"}
    settings, token = planted
    write_bundle(worn_service.store.path, settings, origins, tmp_path / "bundle.zip")
    parts = read(tmp_path / "bundle.zip")
    for name, text in parts.items():
        assert [each for each in (*PLANTED, token, token[:12]) if each in text] == [], name
        assert str(worn_service.store.path) not in text
        assert "bench" not in text
    shown = json.loads(parts["settings.json"])
    assert shown["heartbeat_url"] == {"value": "set", "from": "file"}
    assert shown["port"] == {"value": 8000, "from": "option"}
    store = json.loads(parts["store.json"])
    assert (store["rows"]["runs"], store["results"]["good"]) == (len(RUNS), len(RUNS))
    assert store["checks"]["verification"]["faults"] == 0
    lines = list(map(json.loads, parts["log.jsonl"].splitlines()))
    assert {"error": "ValueError", "event": "worker %d"}.items() <= lines[-1].items()
    requests = [line for line in lines if line["event"] == "request"]
    assert [line["status"] for line in requests] == [200, 404, 404]
    assert requests[0]["route"] == "/api/v1/axes/{axis}/events"


def test_the_log_of_an_error_has_no_link_and_no_parameter_of_the_database(
    worn_service: Service, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(session: Session, secret: str) -> None:
        session.execute(
            sqlalchemy.text("SELECT abs(-9223372036854775808), :digest"), {"digest": secret.upper()}
        )

    monkeypatch.setattr(signing_in, "invited_user", fail)
    secret = "s3cret-link-" * 4
    with (
        logging_to(worn_service.store.path, "json"),
        client_of(worn_service, raise_server_exceptions=False) as other,
    ):
        assert other.get(f"/link/{secret}").status_code == 500
    log = (worn_service.store.path / LOG_FILE).read_text(encoding="utf-8")
    assert "integer overflow" in log
    assert secret not in log
    assert secret.upper() not in log


def test_a_line_of_the_log_ends_at_its_end_alone(tmp_path: Path) -> None:
    lines = [{"path": "/a\u2028b\x85c"}, {"path": "/d"}]
    text = "\n".join(json.dumps(line, ensure_ascii=False) for line in lines)
    (tmp_path / LOG_FILE).write_text(f"{text}\n", encoding="utf-8", newline="\n")
    assert read_log(tmp_path, 9) == lines
    assert read_log(tmp_path, 1) == lines[1:]


@pytest.mark.usefixtures("planted")
def test_the_log_has_callers_and_no_token(worn_service: Service) -> None:
    text = (worn_service.store.path / LOG_FILE).read_text(encoding="utf-8")
    lines: list[dict[str, Any]] = list(map(json.loads, text.splitlines()))
    requests = [line for line in lines if line["event"] == "request"]
    assert [line["caller"] for line in requests] == ["local", "token 1", "local"]
    assert {line["address"] for line in requests} == {"testclient"}
    assert "token=" not in text
    assert "bs_" in requests[2]["path"]
    assert len(requests[2]["path"]) < 30  # of the token in the path, a few characters alone


def test_a_folder_without_a_store_or_with_a_damaged_one_has_a_bundle_too(
    worn_service: Service, tmp_path: Path
) -> None:
    write_bundle(tmp_path / "none", ServerSettings(), {}, tmp_path / "one.zip")
    assert json.loads(read(tmp_path / "one.zip")["store.json"])["exists"] is False
    worn_service.store.folder.sqlite.write_bytes(b"no database" * 1000)
    write_bundle(worn_service.store.path, ServerSettings(), {}, tmp_path / "two.zip")
    assert json.loads(read(tmp_path / "two.zip")["store.json"])["error"].endswith("Error")


def test_it_is_written_whole_or_not_at_all(
    worn_service: Service, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "bundle.zip"
    path.write_text("earlier")

    def fail(*_: Any, **__: Any) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(zipfile.ZipFile, "writestr", fail)
    with pytest.raises(InputError, match="No space left"):
        write_bundle(worn_service.store.path, ServerSettings(), {}, path)
    assert path.read_text() == "earlier"
    assert [each.name for each in tmp_path.glob("*.zip")] == ["bundle.zip"]
    with pytest.raises(InputError, match="make the folder"):
        write_bundle(worn_service.store.path, ServerSettings(), {}, tmp_path / "missing" / "x.zip")


def test_a_package_that_is_not_installed_is_named_as_such(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(support, "_PACKAGES", ("numpy", "no-such-package"))
    packages = support._versions()["packages"]
    assert packages == {"numpy": np.__version__, "no-such-package": "not installed"}


def test_a_line_of_the_log_that_was_cut_is_omitted(tmp_path: Path) -> None:
    lines = ['{"message": "a"}', '{"message": "b', "3", "\xff", '{"message": "c"}']
    (tmp_path / LOG_FILE).write_text("\n".join(lines), encoding="latin-1")
    assert [line["message"] for line in read_log(tmp_path, 10)] == ["a", "c"]


def test_a_log_that_cannot_be_written_is_no_error(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Nor is anything printed of it: the service goes on, and on stderr is what was logged."""
    (tmp_path / LOG_FILE).mkdir()
    log = logging.getLogger("ballscrew.service")
    with logging_to(tmp_path, "text"):
        log.warning("the disk is full")
    assert capsys.readouterr().err == "the disk is full\n"
