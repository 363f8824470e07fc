"""Comparison of two runs or two axes."""

from __future__ import annotations

from urllib.parse import quote

import pytest
from fastapi.testclient import TestClient
from tests.service.conftest import SETUP, send_result
from tests.service.pages.test_run import page
from tests.simulated_bench import AXIS
from tests.store.stored import RUNS


@pytest.fixture
def filled(client: TestClient) -> TestClient:
    """Client of an axis with two runs, and another one without."""
    for number in range(2):
        send_result(client, number)
    client.put("/api/v1/axes/Y axis", json=SETUP | {"sheet": AXIS.replace('"bench"', '"Y axis"')})
    return client


def test_two_runs_are_side_by_side(filled: TestClient) -> None:
    text = page(filled, f"/compare?a={RUNS[1].id}&b={RUNS[0].id}")
    assert f"/api/v1/runs/{quote(RUNS[1].id)}/cells?against={quote(RUNS[0].id)}" in text
    assert "The cell that differs most" in text
    assert text.count("<tr") > len(RUNS[0].cells)


def test_two_axes_are_two_trends(filled: TestClient) -> None:
    text = page(filled, "/compare?a=bench&b=Y%20axis")
    assert 'data-source="/api/v1/axes/bench/history" data-other="/api/v1/axes/Y%20axis/history"' in text


@pytest.mark.parametrize(
    ("query", "status", "message"),
    [
        ("", 200, "choose an axis"),
        ("a=bench", 200, "choose an axis"),
        ("a=bench&b=" + RUNS[0].id, 200, "choose two runs, or two axes"),
        ("a=bench&b=%3Cb%3E", 404, "no axis and no run &#39;&lt;b&gt;&#39;"),
    ],
)
def test_other_choices_are_a_form_with_a_sentence(
    filled: TestClient, query: str, status: int, message: str
) -> None:
    assert message in page(filled, f"/compare?{query}", status)


def test_a_beginning_of_several_ids_is_a_form_with_the_reason(filled: TestClient) -> None:
    for number in (2, 3):
        assert send_result(filled, number, id=f"0123456789{number}").status_code == 202
    text = page(filled, f"/compare?a=0123456789&b={RUNS[0].id}", 409)
    assert "give more of it" in text
    assert "there is no axis and no run" not in text
