"""Page of the server, and what all pages do with languages."""

from __future__ import annotations

import re

import pytest
from fastapi.testclient import TestClient
from tests.service.conftest import NewService, client_of, send, send_result, work_off

from ballscrew.service.pages.rendering import format_moment
from ballscrew.service.serving import Service
from ballscrew.service.settings import ServerSettings
from ballscrew.service.tokens import create_token, revoke_token


def test_the_page_shows_health_queue_and_runs_and_no_markup_of_names(client: TestClient) -> None:
    send(client, "/api/v1/axes/bench/runs/<img src=x onerror=alert(1)>")
    send_result(client, 0)
    answer = client.get("/status")
    assert answer.status_code == 200
    assert "Not ready: no worker is ready yet." in answer.text
    assert "&lt;img src=x onerror=alert(1)&gt;" in answer.text
    assert "<img" not in answer.text
    assert '<a href="/axes/bench">' in answer.text
    policy = answer.headers["Content-Security-Policy"]
    assert "unsafe" not in policy
    assert not re.search(r"\sstyle=|<style|\son\w+=", answer.text.replace("&lt;img src=x onerror", ""))


def test_a_part_of_the_page_is_what_changes(client: TestClient) -> None:
    part = client.get("/status?part=health").text
    assert "<html" not in part
    assert "Workers ready" in part
    assert part.strip() in client.get("/status").text


def test_a_run_that_was_set_aside_is_counted_with_its_reason(client: TestClient, service: Service) -> None:
    service.settings = service.settings.model_copy(update={"attempts": 1})
    send(client)
    work_off(service, lambda _: ("failed", "it ended with signal 9"))
    text = client.get("/status?part=health").text
    assert re.search(r"<dt>Set aside</dt><dd>1</dd>", text)
    assert re.search(r"<dt>In the queue</dt><dd>0</dd>", text)


def test_each_setting_has_its_value_meaning_and_origin(service: Service) -> None:
    service.origins = {"port": "option", "workers": "BALLSCREW_SERVER_WORKERS", "method": "<b>server.toml"}
    with client_of(service) as client:
        text = client.get("/settings").text
    for name, field in ServerSettings.model_fields.items():
        assert f"<code>{name}</code>" in text
        assert field.description is not None
        assert field.description in text
    assert "<td>option</td>" in text
    assert "<td>BALLSCREW_SERVER_WORKERS</td>" in text
    assert "<td>&lt;b&gt;server.toml</td>" in text


def test_tokens_are_counted_and_not_shown(client: TestClient, service: Service) -> None:
    numbers = []
    for machine in (None, "mill 4", "mill 4"):
        number, token = create_token(service.store, machine, role=None if machine else "admin")
        numbers.append(number)
        assert token not in client.get("/status").text
    revoke_token(service.store, numbers[1])
    text = " ".join(client.get("/status").text.split())
    assert "1 with a role, 1 of a machine, 1 revoked" in text


def test_a_damaged_store_and_a_full_disk_are_stated(new_service: NewService) -> None:
    service = new_service(min_free_bytes=1 << 62)
    with client_of(service) as client:
        assert "Not ready: the disk is full." in client.get("/status").text
        service.store.folder.mark_damaged(["a row differs"])
        assert "the store is damaged and only read (a row differs)" in client.get("/status").text


def test_the_switch_of_the_language_preserves_the_query(client: TestClient) -> None:
    text = client.get("/status?a=x%26y&lang=en&b=&a=2").text
    assert '<html lang="en">' in text
    assert 'href="?a=x%26y&amp;b=&amp;a=2&amp;lang=de" lang="de" hreflang="de"' in text
    answer = client.get("/status?a=1&lang=de")
    assert '<html lang="de">' in answer.text
    assert 'href="?a=1&amp;lang=en"' in answer.text
    assert '<html lang="de">' in client.get("/status").text  # by its cookie


@pytest.mark.parametrize(
    ("header", "language"),
    [("de-AT,de;q=0.9", "de"), ("fr,de;q=0.5", "de"), ("fr", "en"), ("", "en"), (";,=de", "en")],
)
def test_the_language_follows_the_browser(service: Service, header: str, language: str) -> None:
    with client_of(service, headers={"Accept-Language": header}) as client:
        assert f'<html lang="{language}">' in client.get("/status?lang=xx").text


def test_times_are_written_as_the_language_does() -> None:
    text = "2026-02-03T04:05:06+01:00"
    assert format_moment(text, "en") == "3 Feb 2026, 03:05 UTC"
    assert format_moment(text, "de") == "03.02.2026, 03:05 UTC"
    assert format_moment(None, "de") == "–"
