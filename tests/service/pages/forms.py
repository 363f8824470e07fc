"""Forms as a browser posts them, and the axis that their tests use."""

from __future__ import annotations

import re
from functools import cache
from html import unescape
from typing import Any
from urllib.parse import urlencode

import pytest
from fastapi.testclient import TestClient
from tests.service.conftest import send_result, work_off
from tests.store.stored import MODEL, RUNS

from ballscrew.calibration.modelfile import model_json
from ballscrew.service.serving import Service

HOSTILE = "<script>alert('x')</script>\"><img src=x onerror=y>"
_HEADERS = {"Accept": "text/html", "Content-Type": "application/x-www-form-urlencoded"}


def post(client: TestClient, path: str, **values: Any) -> Any:
    """Post a form, without following the answer."""
    content = urlencode(values, doseq=True)
    return client.post(path, content=content, headers=_HEADERS, follow_redirects=False)


def get(client: TestClient, path: str) -> str:
    """Text of a page."""
    answer = client.get(path, headers={"Accept": "text/html"})
    assert answer.status_code == 200, answer.text
    assert "script-src 'self'" in answer.headers["Content-Security-Policy"]
    assert answer.headers["Referrer-Policy"] == "same-origin"  # else the origin of a form is null
    assert " style=" not in answer.text
    assert "hx-on" not in answer.text
    return answer.text


def problem(answer: Any) -> str:
    """The sentence beside the form that was refused."""
    (found,) = re.findall(r'<p class="message" role="alert">([^<]+)</p>', answer.text)
    return unescape(found)


@cache
def _model() -> dict[str, Any]:
    return model_json(MODEL)


def fill_axis(client: TestClient, service: Service, number: int = len(RUNS)) -> list[str]:
    """Send runs of a worn axis and its model, and assess it; the ids of the runs."""
    for each in range(number):
        assert send_result(client, each).status_code == 202
    assert client.put("/api/v1/axes/bench/model", json=_model()).status_code == 200
    work_off(service, lambda _: pytest.fail("no analysis"))
    return [run["run"] for run in client.get("/api/v1/axes/bench").json()["runs"]]
