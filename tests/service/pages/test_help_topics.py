"""Help, and pages in place of refusals."""

from __future__ import annotations

import re

import pytest
from fastapi.testclient import TestClient
from tests.service.conftest import send_result
from tests.service.pages.forms import get
from tests.store.stored import RUNS

from ballscrew.service.pages.help_topics import TOPICS


@pytest.mark.parametrize("topic", TOPICS)
def test_every_topic_is_a_page_that_links_to_the_others(client: TestClient, topic: str) -> None:
    page = get(client, f"/help/{topic}")
    for other in TOPICS:
        assert f'href="/help/{other}"' in page
    assert page.count("<h1>") == 1


def test_the_help_without_a_topic_is_the_first_steps(client: TestClient) -> None:
    assert "<h1>First steps</h1>" in get(client, "/help")


@pytest.mark.parametrize("path", ["/nothing", "/help/nothing", "/axes/none/actions", "/axes/none/setup"])
def test_an_unknown_page_is_a_page_for_a_browser_and_json_for_others(client: TestClient, path: str) -> None:
    answer = client.get(path, headers={"Accept": "text/html,*/*;q=0.8"})
    assert (answer.status_code, answer.headers["Content-Type"]) == (404, "text/html; charset=utf-8")
    assert 'href="/">' in answer.text.split("<main")[1]
    assert set(client.get(path, headers={"Accept": "application/json"}).json()) == {"detail"}


def test_the_api_answers_a_browser_as_before(client: TestClient) -> None:
    headers = {"Accept": "text/html"}
    assert set(client.get("/api/v1/axes/none", headers=headers).json()) == {"detail"}
    assert set(client.get("/api/v1/nothing", headers=headers).json()) == {"detail"}


def test_a_hostile_address_is_escaped(client: TestClient) -> None:
    answer = client.get("/help/<script>x", headers={"Accept": "text/html"})
    assert answer.status_code == 404
    assert "<script>x" not in answer.text


def test_a_wrong_value_in_an_address_is_a_page_with_a_sentence(client: TestClient) -> None:
    send_result(client, 0)
    path = f"/runs/{RUNS[0].id}?cell=first"
    answer = client.get(path, headers={"Accept": "text/html"})
    assert (answer.status_code, answer.headers["Content-Type"]) == (422, "text/html; charset=utf-8")
    assert "unable to parse string as an integer" in answer.text
    assert set(client.get(path, headers={"Accept": "application/json"}).json()) == {"detail"}


def test_a_file_of_the_pages_that_there_is_not_is_404(client: TestClient) -> None:
    (script,) = re.findall(r'src="(/static/\w+)/pages\.js"', get(client, "/help"))
    assert client.get(f"{script}/pages.js").status_code == 200
    answer = client.get(f"{script}/none.js")
    assert (answer.status_code, answer.json()["detail"]) == (404, "there is no such file.")
